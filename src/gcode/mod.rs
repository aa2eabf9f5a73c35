//! G-code text to words and modal groups: pure, nothing is remembered between lines.
//!
//! Read with NIST RS274NGC 3 and Grbl 1.1's table of errors. A line arrives as the line assembler
//! leaves it: upper case, without blanks and comments.

mod block;
mod error;
pub mod interpreter;
mod modal;
mod word;
mod word_reader;

pub use block::{AxisCommand, NonModal, ParsedLine, Reference};
pub use error::LineError;
pub use modal::{Distance, FeedMode, Flow, Modal, MotionMode, ProbeMode, ToolLength, Units};
pub use word::{Code, Word, Words};
pub use word_reader::WordReader;
