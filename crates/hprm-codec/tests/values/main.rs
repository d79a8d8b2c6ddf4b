//! Values through the codec and back.

mod arrays;
mod common;
mod hostile;
mod mapping;
mod worked_example;
