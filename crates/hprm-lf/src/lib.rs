//! The front end for Lingua Franca: `.lf` text to a checked program, or to diagnostics.
//!
//! This crate is pure: text goes in through a [`SourceLoader`], data comes out. It opens no file
//! and runs no Python; bodies pass through it as text, at the left margin and with their lines.
//!
//! The way of a program: `lexer` and `parser` make a tree of each file, `library` loads what is
//! imported and knows which name means which class, `model` and `resolve` sort a class's members
//! and follow its references, `slots` says what a reaction's function gets, `check` holds the rules, `instance`, `reaction` and `wiring` build
//! the instance graph, `class` brings bodies and values into the form that Python gets. [`compile()`]
//! runs them in that order.
//!
//! The grammar is whole; watchdogs are parsed and then refused.

#![deny(clippy::disallowed_methods, clippy::disallowed_types)]
#![forbid(unsafe_code)]

mod ast;
mod check;
mod class;
mod clock_property;
mod code;
mod compile;
mod compiled;
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
mod reaction;
mod render;
mod resolve;
mod slots;
mod source;
mod spacing;
mod token;
mod unclosed;
mod unconnected;
mod value;
mod wiring;

pub use code::Code;
pub use compile::{check, compile, compile_with};
pub use compiled::{
    Access, Argument, Class, Compiled, ContainedPort, Failure, Instance, Method, ParameterDecl,
    Part, PlacedAt, Ports, ReactionBody, ReactionCode, Runs, StateDecl,
};
pub use diagnostic::{Diagnostic, Label, Severity};
pub use overrides::PARAMETER;
pub use properties::Settings;
pub use render::{render, render_all};
pub use source::{FileId, Position, SourceLoader, Sources, Span};
pub use value::{Value, is_unit};
