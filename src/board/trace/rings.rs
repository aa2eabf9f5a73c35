//! The rings of the records in the layout of SEGGER's RTT: a control block that lists buffers.
//!
//! Each ring has one writer, which never interrupts itself, and one reader, the debugger: no lock
//! is needed. Where the debugger is too slow, records are dropped, and the next record has their
//! number. The control block also has the channel for the message of a panic, as without the
//! feature.

use core::{
    ffi::CStr,
    sync::atomic::{
        AtomicPtr, AtomicU32,
        Ordering::{Relaxed, Release},
        compiler_fence,
    },
};

use super::TASKS;

/// Words of a record: start, duration, latency, and the number of records dropped before.
const WORDS: usize = 4;
const RECORD_BYTES: u32 = 4 * WORDS as u32;
/// Records in a ring, one of which is always free: those of `step` in 0.1 ms at 300 kHz.
const SLOTS: usize = 32;
const RING_BYTES: u32 = RECORD_BYTES * SLOTS as u32;
const _: () = assert!(SLOTS.is_power_of_two(), "indices wrap by a mask");

/// Bytes for the message of a panic.
const MESSAGE_BYTES: usize = 256;

type Ring = [[AtomicU32; WORDS]; SLOTS];

/// A channel to the debugger.
#[repr(C)]
struct Channel {
    name: AtomicPtr<u8>,
    buffer: AtomicPtr<u8>,
    size: u32,
    /// Offset of the next byte to be written; the chip changes it.
    write: AtomicU32,
    /// Offset of the next byte to be read; the debugger changes it.
    read: AtomicU32,
    /// 0: bytes that do not fit are dropped.
    flags: u32,
}

/// The control block, which a debugger finds by its mark.
#[repr(C)]
struct ControlBlock {
    mark: [u8; 16],
    channels: u32,
    channels_down: u32,
    panic: Channel,
    tasks: [Channel; TASKS],
}

static RINGS: [Ring; TASKS] =
    [const { [const { [const { AtomicU32::new(0) }; WORDS] }; SLOTS] }; TASKS];

static PANIC: [AtomicU32; MESSAGE_BYTES / 4] = [const { AtomicU32::new(0) }; MESSAGE_BYTES / 4];

/// Found by its symbol or its mark; `rtt_target` also finds the channel of panics in it.
#[unsafe(no_mangle)]
#[expect(unsafe_code, reason = "a symbol that a debugger can find")]
static _SEGGER_RTT: ControlBlock = ControlBlock {
    mark: *b"SEGGER RTT\0\0\0\0\0\0",
    channels: 1 + TASKS as u32,
    channels_down: 0,
    panic: Channel::new(c"panic", (&raw const PANIC).cast(), MESSAGE_BYTES as u32),
    tasks: [
        ring(c"step", 0),
        ring(c"stand-in", 1),
        ring(
            if cfg!(feature = "usb") {
                c"usb"
            } else {
                c"serial_rx"
            },
            2,
        ),
        ring(c"segment_start", 3),
        ring(c"inputs", 4),
        ring(c"prepare", 5),
    ],
};

/// Number of dropped records of each task; found by its symbol.
#[unsafe(no_mangle)]
#[expect(unsafe_code, reason = "a symbol that a debugger can find")]
static TRACE_DROPPED: [AtomicU32; TASKS] = [const { AtomicU32::new(0) }; TASKS];

impl Channel {
    const fn new(name: &'static CStr, buffer: *const u8, size: u32) -> Self {
        Self {
            name: AtomicPtr::new(name.as_ptr().cast_mut().cast()),
            buffer: AtomicPtr::new(buffer.cast_mut()),
            size,
            write: AtomicU32::new(0),
            read: AtomicU32::new(0),
            flags: 0,
        }
    }
}

const fn ring(name: &'static CStr, task: usize) -> Channel {
    Channel::new(name, (&raw const RINGS[task]).cast(), RING_BYTES)
}

/// Writes a record of a task, or drops it when there is no room. For the task itself alone.
pub(super) fn write<const TASK: usize>([start, duration, latency]: [u32; 3]) {
    let dropped = TRACE_DROPPED[TASK].load(Relaxed);
    let channel = &_SEGGER_RTT.tasks[TASK];
    let offset = channel.write.load(Relaxed);
    let next = (offset + RECORD_BYTES) % RING_BYTES;
    if next == channel.read.load(Relaxed) {
        TRACE_DROPPED[TASK].store(dropped.wrapping_add(1), Relaxed);
        return;
    }
    let slot = &RINGS[TASK][(offset / RECORD_BYTES) as usize % SLOTS];
    slot[0].store(start, Relaxed);
    slot[1].store(duration, Relaxed);
    slot[2].store(latency, Relaxed);
    slot[3].store(dropped, Relaxed);
    // The debugger may read the record after the next write. The core writes in the order of the
    // program.
    compiler_fence(Release);
    channel.write.store(next, Relaxed);
}
