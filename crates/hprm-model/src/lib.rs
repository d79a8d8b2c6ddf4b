//! The model of a program: what front ends declare, the rules of the language, and the instance graph that
//! runs.
//!
//! This crate is pure: it reads no text but Python's, opens no file and knows no clock. A front end puts
//! files, reactor classes and imports into a [`Library`], and [`compile()`] gives the program, or
//! [diagnostics](Diagnostic) with their places. Whatever a program is written in, it is checked by the same
//! rules, with the same codes, and becomes the same [`Program`](hprm_core::Program).
//!
//! [`declaration`] has what can be declared. The stages: `model` and `resolve` sort the members of a class
//! and resolve its references, `inherit` merges those of its superclasses, `slots` finds the arguments of a
//! reaction's function, `check` has the rules of the language, `properties` those of target properties,
//! `executable` finds the reactors that executables declare, `variants` which values their parameters have, `instance`, `reaction` and `connections` build the instance graph, `class` brings bodies and values into
//! the form that Python gets, `fingerprint` states what processes compare. [`outline`] is a program as people draw it, and
//! `sketch` makes it.
//!
//! A front end uses it like this; the program is one reactor without a name:
//!
//! ```
//! use hprm_model::declaration::{Body, Member, ReactionNode, ReactorKind, ReactorNode, TriggerNode};
//! use hprm_model::{FileId, Library, Overrides, Purpose, Report, Span, TargetProperties, compile};
//!
//! let text = "def main():\n    print('hello')\n";
//! let place = |word: &str| {
//!     let start = text.find(word).unwrap();
//!     Span::new(FileId::MAIN, start..start + word.len())
//! };
//! let mut main = ReactorNode::new(ReactorKind::Main, None, place("def main()"));
//! let body = Body::Text(place("print('hello')"));
//! let mut reaction = ReactionNode::new(body, place("def main()"));
//! reaction.triggers.push(TriggerNode::Startup);
//! main.members.push(Member::Reaction(reaction));
//!
//! let mut report = Report::default();
//! let mut library = Library::new("Hello.py", text.to_owned());
//! library.add_reactor(FileId::MAIN, main, &mut report);
//! let overrides = Overrides::default();
//! let properties = TargetProperties::read(&library, &overrides, &mut report);
//! let compiled = compile(library, properties, &overrides, Purpose::Run, report).unwrap();
//! assert_eq!(compiled.program.name, "Hello");
//! assert_eq!(compiled.classes[0].reactions[0].line, 1);
//! ```

#![deny(clippy::disallowed_methods, clippy::disallowed_types)]
#![forbid(unsafe_code)]

mod check;
mod class;
mod clock_property;
mod code;
mod compile;
mod compiled;
mod connections;
mod container_property;
pub mod declaration;
mod diagnostic;
mod environment;
mod executable;
pub mod explanation;
mod fingerprint;
mod given;
mod inherit;
mod instance;
mod legacy;
mod library;
mod lower;
mod model;
pub mod outline;
mod overrides;
mod parts;
mod properties;
mod property_rules;
mod property_values;
pub mod python;
mod reaction;
mod render;
mod resolve;
mod sketch;
mod slots;
mod source;
mod spacing;
mod syntax;
mod transitions;
mod unconnected;
mod value;
mod variants;

pub use code::Code;
pub use compile::{Purpose, compile};
pub use compiled::{
    Access, Argument, Class, CompileFailure, Compiled, ContainedPort, ExecutableFederate, Instance,
    Method, ParameterDecl, PlacedAt, Ports, ReactionBody, ReactionCode, ReactorPart, Runs,
    StateDecl,
};
pub use container_property::Containers;
pub use diagnostic::{Diagnostic, Label, Report, Severity, did_you_mean, existing};
pub use executable::{Executable, GivenParameter, Refusal, Refused};
pub use given::{Given, OtherGiven};
pub use library::{ClassId, Library};
pub use overrides::{Overrides, ParameterOverride};
pub use properties::{Settings, StatedFile, TargetProperties};
pub use render::{render, render_all};
pub use source::{FileId, Position, Sources, Span};
pub use syntax::Syntax;
pub use value::Value;

/// Reading the values of single target properties, for what is stated elsewhere too.
pub mod property {
    pub use crate::properties::spin;
    pub use crate::property_values::{Read, time};
}
