//! G-code text to words and modal groups: pure, nothing is remembered between lines.
//!
//! Read with NIST RS274NGC 3 and Grbl 1.1's table of errors. A line arrives as the line assembler
//! leaves it: upper case, without blanks and comments.

pub mod codes;
mod error;
pub mod interpreter;
mod modal;
mod parsed_line;
pub mod reprap;
mod word;
mod word_reader;

pub use error::LineError;
pub use modal::{
    ArcDistance, CompensationMode, Cycle, Distance, FeedMode, Flow, Modal, MotionMode, ProbeMode,
    RetractMode, ToolLength, Units,
};
use modal::{FEEDS_MM_MIN, INVERSE_TIMES};
use parsed_line::tool_number;
pub use parsed_line::{
    AxisCommand, NonModal, ParsedLine, StoredPosition, SwitchedOverride, ToolCommand,
};
pub use word::{CodeNumber, Word, Words};
use word_reader::MAX_LINE_NUMBER;
pub use word_reader::{NotPlain, PlainPrefix, WordReader};
