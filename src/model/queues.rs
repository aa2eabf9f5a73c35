//! Sizes of the queues between the tasks.

use super::timing::MAX_SEGMENT_EVENTS;

/// Bytes that may wait for `interpret`, and one more.
pub const RECEIVED_RING: usize = 1024;
/// Bytes that may wait to be sent, and one more.
pub const SENT_RING: usize = 1024;
/// Entries that may wait for `prepare`, and one more.
pub const ENTRY_RING: usize = 8;
/// Segments that may wait for the step interrupt, and one more: a power of two.
pub const SEGMENT_RING: usize = 32;
/// Events that may wait in a ring.
///
/// The start of a segment releases `prepare`, so a full ring must hold one start, and behind it the
/// events of half of the longest segment at the shortest spacing, in which `prepare` catches up.
pub const EVENT_RING: usize = 2048;
const _: () = assert!(EVENT_RING as u32 >= MAX_SEGMENT_EVENTS * 3 / 2);
