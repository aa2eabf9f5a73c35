//! The constants that the proof of the timing counts on, as absolute symbols of the program file.
//!
//! `schedule.toml` names these constants where it needs their values, and never repeats a value: a changed constant
//! changes what is proven. An absolute symbol takes no memory.

#![expect(unsafe_code, reason = "assembly defines the symbols")]

use core::arch::global_asm;

use leadscrew::{
    machine::{SAMPLE_TICKS, SAMPLES},
    model::{
        queues::{RECEIVED_RING, SENT_RING},
        timing::{
            EVENT_SPACING_TICKS, MAX_SEGMENT_TICKS, QUEUED_AHEAD_TICKS, REFERENCE_SAMPLE_US,
            SPARSE_SEGMENT_TICKS,
        },
    },
    motion::{
        BLOCKS_PER_PART, MAX_STEP_RATE_HZ, MEAN_SEGMENT_US, REQUEST_INTERVAL_TICKS,
        STEPS_PER_SEGMENT, TARGETS_AHEAD,
    },
    stepper::{END_SLOTS, SLOTS, WORD_BITS},
};

use super::{
    contacts::IDLE_PERIOD_US, power_up, stack::GUARD_BYTES, watchdog::RELOAD as WATCHDOG_RELOAD,
};

/// Bits a second of the sender; 0 over USB.
const BAUD: u32 = if cfg!(feature = "usb") {
    0
} else {
    power_up::BAUD
};

/// Defines a symbol for each constant.
macro_rules! symbols {
    ($($name:ident)*) => {
        $(
            global_asm!(
                concat!(".global _constant_", stringify!($name)),
                concat!(".set _constant_", stringify!($name), ", {}"),
                const $name
            );
        )*
    };
}

symbols! {
    BAUD
    BLOCKS_PER_PART
    END_SLOTS
    EVENT_SPACING_TICKS
    GUARD_BYTES
    IDLE_PERIOD_US
    MAX_SEGMENT_TICKS
    MAX_STEP_RATE_HZ
    MEAN_SEGMENT_US
    QUEUED_AHEAD_TICKS
    RECEIVED_RING
    REFERENCE_SAMPLE_US
    REQUEST_INTERVAL_TICKS
    SAMPLES
    SAMPLE_TICKS
    SENT_RING
    SLOTS
    SPARSE_SEGMENT_TICKS
    STEPS_PER_SEGMENT
    TARGETS_AHEAD
    WATCHDOG_RELOAD
    WORD_BITS
}

#[cfg(arc_machine)]
use leadscrew::stepper::{MAX_ARC_STEPS, MAX_ARC_STRETCHES};

#[cfg(arc_machine)]
symbols! {
    MAX_ARC_STEPS
    MAX_ARC_STRETCHES
}

#[cfg(feature = "usb")]
use leadscrew::usb::{MOST_FIFO_ENTRIES, PACKET_BYTES, PACKET_WORDS};

#[cfg(feature = "usb")]
use super::serial::USB_PERIOD_US;

#[cfg(feature = "usb")]
symbols! {
    MOST_FIFO_ENTRIES
    PACKET_BYTES
    PACKET_WORDS
    USB_PERIOD_US
}
