//! The areas of the page: a component each, and what it computes, which needs no browser.

pub mod check;
pub mod connection;
pub mod console;
pub mod editor;
pub mod entry;
pub mod field;
pub mod job;
pub mod jog;
pub mod macros;
pub mod probe;
pub mod program;
pub mod progress;
pub mod settings;
pub mod setup;
pub mod state;
pub mod tables;
pub mod view;
