//! Bytes to lines and back: realtime bytes, lines, `$` commands, reports.

mod dollar;
mod line;
pub mod realtime;
pub mod report;
mod session;
mod text;

pub use dollar::{Condition, Dollar};
pub use line::{LINE_BYTES, Line, TooLong};
pub use session::{Progress, Session};
pub use text::{MESSAGE_BYTES, ReportUnit, Text};
