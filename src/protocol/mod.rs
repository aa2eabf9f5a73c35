//! Bytes to lines and back: realtime bytes, lines, `$` commands, reports.

mod line;
pub mod realtime;
mod text;

pub use line::{LINE_BYTES, Line, TooLong};
pub use text::{MESSAGE_BYTES, ReportUnit, Text};
