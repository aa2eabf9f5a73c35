//! Bytes to lines and back: realtime bytes, lines, `$` commands, reports.
//!
//! `serial_rx` sorts bytes ([`realtime`]); [`Session`] makes lines of them ([`Line`]), dispatches them
//! (`$` statements: [`Dollar`], everything else: the interpreter) and answers in Grbl's words
//! ([`report`], [`listing`], written into a [`Text`]).

mod bytes;
mod checked;
mod checked_lines;
mod dialect;
mod dollar;
mod incoming;
mod line;
pub mod listing;
pub mod realtime;
pub mod report;
mod reprap;
mod session;
mod text;
mod utf8_requests;

pub use bytes::{ByteCount, ByteReader, ByteRing, ByteWriter, Bytes, Waiting};
pub use checked::{Emergency, FailedCheck, MAX_NUMBER, RAW_BYTES, RawLine, Verdict};
pub use dialect::Dialect;
pub use dollar::{Condition, Described, Dollar, List, STATEMENTS, Statement};
pub use incoming::{Incoming, IncomingWriter};
pub use line::{LINE_BYTES, Line, TooLong};
pub use realtime::DamagedByte;
pub use reprap::replies;
pub use session::{Progress, Session};
pub use text::{MESSAGE_BYTES, ReportUnit, Text};
pub use utf8_requests::Utf8RequestWatch;
