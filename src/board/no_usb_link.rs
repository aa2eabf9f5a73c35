//! The types of `usb_link.rs` that tasks of other images own: RTIC asserts that they may be sent, also where no such task
//! is.

/// The driver and its timer.
pub(crate) enum UsbLink {}

/// The device as the host sees it.
pub(crate) enum UsbControl {}
