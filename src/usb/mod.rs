//! The link to the sender by USB: a serial port of the class CDC ACM on the chip's OTG full-speed core.
//!
//! Read with RM0090 34 (RM0390 31, RM0383 22), USB 2.0 chapters 5, 8 and 9, and CDC 1.2 with its subclass PSTN.
//!
//! ```text
//!              task `usb`, each 500 µs                      task `usb_control`
//!  host ⇄ OTG core ⇄ Driver ── bytes ──▶ Incoming
//!                       │ ◀── bytes ── sent
//!                       └── Mailbox: events ──▶ UsbControl: usb-device, class CDC ACM
//!                              ◀── answers ──
//! ```
//!
//! One task touches the registers: [`Driver::serve`] does a bounded piece of work in each period, and waits for nothing.
//! A bit that starts something in the core is set in a run and looked at in the next ones; what does not end is
//! begun anew. Meanwhile the core answers the host with NAK, so no byte is lost.
//!
//! A packet of the host is taken only when the one before has gone to the queue of received bytes. So at most one waits
//! for room, and its realtime bytes are requests at once, however full the queue.
//!
//! Requests on endpoint 0 have time: [`UsbControl`] answers them in a task without a deadline, from a copy in the
//! [`Mailbox`]. Each event has a number, and only the answer to the newest event counts. So a reset or another SETUP in the
//! middle of a transfer leaves nothing of that transfer behind.

mod bus;
mod class;
mod control;
mod driver;
mod endpoints;
mod mailbox;
mod packet;
pub mod registers;

pub use bus::{ControlBus, ControlBusAllocator};
pub use control::{LONGEST_NAME, SERIAL_NUMBER_LENGTH, UsbControl, serial_number};
pub use driver::{Driver, MOST_FIFO_ENTRIES, SenderQueues};
pub use mailbox::Mailbox;
pub use registers::Registers;

/// Bytes of a full packet of the endpoints 0 and [`DATA_ENDPOINT`].
pub const PACKET_BYTES: usize = 64;
/// Words of such a packet in a FIFO of the core.
pub const PACKET_WORDS: usize = PACKET_BYTES / 4;

/// The endpoints of the data, one for each direction.
pub const DATA_ENDPOINT: u8 = 1;
/// The endpoint of notifications of the class, of which none is sent.
pub const NOTIFICATION_ENDPOINT: u8 = 2;
/// Bytes of a packet of notifications.
const NOTIFICATION_BYTES: u16 = 8;
