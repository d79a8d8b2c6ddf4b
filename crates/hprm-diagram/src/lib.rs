//! Diagrams of programs: boxes, ports and lines by the conventions of Lingua Franca, as SVG, PNG or a page.
//!
//! [`build`] makes a [`Graph`] of an [outline](hprm_model::outline), [`layout`] gives everything a place,
//! [`svg`] and [`png`] draw it, and [`page`] is an HTML page whose reactors open and close. [`Diagram`] does these one
//! after the other.
//!
//! `text` measures, `cycle` finds what a causality loop consists of, `scope` has the boxes of one reactor between which
//! lines lead. What is drawn is a list of shapes (`scene`), which every format draws alike.
//!
//! This crate is pure: an outline goes in, a picture comes out, the same for the same outline. It reads no clock and
//! opens no file.

#![deny(clippy::disallowed_methods, clippy::disallowed_types)]
#![forbid(unsafe_code)]

mod build;
mod cycle;
pub mod graph;
mod layout;
mod page;
mod png;
mod scene;
mod scope;
mod shape;
mod svg;
mod symbol;
mod text;
mod time;

pub use build::build;
pub use graph::Graph;
pub use layout::{NoLayout, layout};
pub use page::page;
pub use png::png;
pub use svg::svg;
