//! Bytes to lines and back: realtime bytes, lines, `$` commands, reports.

pub mod realtime;
