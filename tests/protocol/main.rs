//! The conversation with a sender: lines in, answers out.

mod bench;
mod deviations;
mod flow;
mod laws;
mod program;
mod receiving;
mod rejected;
mod reports;
mod statements;
mod tools;
