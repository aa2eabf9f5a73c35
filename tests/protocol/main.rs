//! The conversation with a sender: lines in, answers out.

mod bench;
mod compensation;
mod contour;
mod deviations;
mod drilling;
mod flow;
mod laws;
mod machine;
mod operator_messages;
mod position_stream;
mod positions;
mod program;
#[path = "../support/random_lines.rs"]
mod random_lines;
mod random_programs;
mod receiving;
mod rejected;
mod reports;
mod stages;
mod statements;
#[path = "../support/mod.rs"]
mod support;
mod tool_table;
mod tools;

use support::cases;
