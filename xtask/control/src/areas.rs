//! The areas of the page: a component each, and what it computes, which needs no browser.

pub mod connection;
pub mod console;
pub mod jog;
pub mod program;
pub mod setup;
pub mod state;
