//! The types of `serial.rs` that tasks of other images own: RTIC asserts that they may be sent, also where no such task is.

/// The receiving half of a USART.
pub(crate) enum Receiver {}
