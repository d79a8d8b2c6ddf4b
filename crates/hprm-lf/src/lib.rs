//! The front end for Lingua Franca: `.lf` text to what it declares, for `hprm-model` to check.
//!
//! This crate is pure: text goes in through a [`SourceLoader`], data comes out. It opens no file
//! and runs no Python; bodies stay text.
//!
//! `lexer` and `parser` make a tree of each file, `load` reads the imported files and fills the library of
//! classes, `overrides` parses what the command line states, `declared` compiles programs in other languages, for which the
//! command line is the same, `modules` finds the Python beside a program.
//! [`compile()`] has the library checked and gives the program.
//!
//! The parser knows the whole grammar; what is not supported yet is refused by the rules.

#![deny(clippy::disallowed_methods, clippy::disallowed_types)]
#![forbid(unsafe_code)]

mod ast;
mod body;
mod compile;
mod declared;
mod files;
mod lexer;
mod literal;
mod load;
mod modules;
mod overrides;
mod package;
mod parser;
mod source;
mod token;
mod unclosed;

pub use compile::{check, compile, compile_with, draw};
pub use declared::compile_declared;
pub use files::check_files;
pub use literal::{WrongTime, is_unit, parse_time};
pub use overrides::{PARAMETER, expected_spin, expected_time, overrides};
pub use source::SourceLoader;
