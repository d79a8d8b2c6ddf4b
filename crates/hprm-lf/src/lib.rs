//! The front end for Lingua Franca: `.lf` text to a checked program, or to diagnostics.
//!
//! This crate is pure: text goes in through a [`SourceLoader`], data comes out. It opens no file
//! and runs no Python; bodies stay text, moved to the left margin, with their line numbers.
//!
//! The stages of a compilation: `lexer` and `parser` make a tree of each file, `library` loads the imported
//! files and knows which name means which class, `model` and `resolve` sort the members of a class and
//! resolve its references, `slots` finds the arguments of a reaction's function, `check` has the rules of
//! the language, `instance`, `reaction` and `connections` build the instance graph, `class` brings bodies
//! and values into the form that Python gets. [`compile()`] runs them in that order.
//!
//! The parser knows the whole grammar; watchdogs are parsed and then refused.

#![deny(clippy::disallowed_methods, clippy::disallowed_types)]
#![forbid(unsafe_code)]

mod ast;
mod check;
mod class;
mod clock_property;
mod code;
mod compile;
mod compiled;
mod connections;
mod diagnostic;
mod environment;
mod fingerprint;
mod inherit;
mod instance;
mod legacy;
mod lexer;
mod library;
mod lower;
mod model;
mod modules;
mod overrides;
mod package;
mod parser;
mod parts;
mod properties;
mod property_rules;
mod property_values;
mod reaction;
mod render;
mod resolve;
mod slots;
mod source;
mod spacing;
mod token;
mod transitions;
mod unclosed;
mod unconnected;
mod value;

pub use code::Code;
pub use compile::{check, compile, compile_with};
pub use compiled::{
    Access, Argument, Class, CompileFailure, Compiled, ContainedPort, Instance, Method,
    ParameterDecl, PlacedAt, Ports, ReactionBody, ReactionCode, ReactorPart, Runs, StateDecl,
};
pub use diagnostic::{Diagnostic, Label, Severity};
pub use overrides::{PARAMETER, expected_spin, expected_time};
pub use properties::Settings;
pub use render::{render, render_all};
pub use source::{FileId, Position, SourceLoader, Sources, Span};
pub use value::{Value, is_unit};
