//! Sizes of the queues between the tasks.

use super::timing::MAX_SEGMENT_EVENTS;

/// Slots for bytes that wait for `interpret`, one more than can wait: a power of two.
pub const RECEIVED_RING: usize = 1024;
/// Slots for bytes to be sent, one more than can wait: a power of two.
pub const SENT_RING: usize = 1024;
/// Slots for entries that wait for `prepare`, one more than can wait.
pub const ENTRY_RING: usize = 8;
/// Segments that may wait for the step interrupt, and one more: a power of two.
pub const SEGMENT_RING: usize = 32;
/// Events that may wait for the step interrupt: a power of two.
///
/// The start of a segment releases `prepare`. So a full ring must hold one start and, after it, the
/// events of half of the longest segment at the shortest spacing, during which `prepare` catches up.
pub const EVENT_RING: usize = 2048;
const _: () = assert!(EVENT_RING as u32 >= MAX_SEGMENT_EVENTS * 3 / 2);
