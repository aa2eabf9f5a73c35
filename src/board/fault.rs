//! Faults: everything stops, the sender is told, a record outlives the reset that follows.
//!
//! Spindle, laser and coolant are switched off first: a timer would keep the beam on for ever. The drivers
//! keep what they hold until the reset, which lets all pins float for a moment. Panics, faults of the
//! processor, interrupts without a task, a crystal that stops and a supply that falls end here. A task that
//! hangs does not: the watchdog resets the chip.
//!
//! Registers: RM0090 7.3.21 (causes of a reset).

use core::{
    fmt::{self, Write},
    mem::MaybeUninit,
    panic::PanicInfo,
};

use cortex_m::peripheral::SCB;
use leadscrew::model::ResetCause;
use rtt_target::UpChannel;
#[cfg(not(feature = "trace"))]
use rtt_target::{ChannelMode, rtt_init};

use super::{fault_port::FaultPort, outputs, pac, watchdog};

/// Number of the RTT channel.
const CHANNEL: usize = 0;
/// The upper half of the record's first word.
const MAGIC: u32 = 0x1ead_0000;

/// The record of the last fault: the cause with [`MAGIC`], the same inverted, and the number of faults since
/// power-up. Memory that nothing initialises keeps its contents through a reset.
#[unsafe(no_mangle)]
#[unsafe(link_section = ".uninit.fault")]
#[expect(unsafe_code, reason = "a section, and a symbol that a test can find")]
static FAULT: MaybeUninit<[u32; 3]> = MaybeUninit::uninit();

/// Sets up the channel, so that a debug probe finds it.
pub(super) fn init() {
    // With the feature, `trace` has the channel.
    #[cfg(not(feature = "trace"))]
    let _ = rtt_init! {
        up: { 0: { size: 256, mode: ChannelMode::NoBlockTrim, name: "panic" } }
    };
}

/// Takes the cause of the last reset, once.
pub(super) fn take_cause(rcc: &pac::RCC) -> ResetCause {
    let flags = rcc.csr().read();
    rcc.csr().modify(|_, w| w.rmvf().set_bit());
    let [word, inverted, faults] = read_record();
    let recorded = ResetCause::ALL
        .into_iter()
        .find(|cause| word == MAGIC | *cause as u32 && inverted == !word);
    let cause = ResetCause::of(recorded, |cause| match cause {
        ResetCause::Power => flags.porrstf().bit_is_set(),
        ResetCause::Supply => flags.borrstf().bit_is_set(),
        ResetCause::Watchdog => flags.wdgrstf().bit_is_set(),
        ResetCause::Software => flags.sftrstf().bit_is_set(),
        ResetCause::Pin => flags.padrstf().bit_is_set(),
        ResetCause::Panic | ResetCause::Processor | ResetCause::Interrupt | ResetCause::Clock => {
            false
        }
    });
    let faults = if cause == ResetCause::Power {
        0
    } else {
        faults
    };
    write_record([0, 0, faults]);
    cause
}

#[expect(unsafe_code, reason = "memory that nothing initialises")]
fn read_record() -> [u32; 3] {
    // SAFETY: every word is a number; only this file uses the memory.
    unsafe { FAULT.as_ptr().read_volatile() }
}

#[expect(unsafe_code, reason = "memory that nothing initialises")]
fn write_record(record: [u32; 3]) {
    // SAFETY: as for the read; interrupts are off.
    unsafe { FAULT.as_ptr().cast_mut().write_volatile(record) };
}

/// Stops every task, and switches the outputs off. Interrupts stay off: a part of functions that never return.
#[inline(always)]
#[expect(
    clippy::inline_always,
    reason = "the proof wants interrupts on where a function ends"
)]
pub(super) fn stop_machine(cause: ResetCause) {
    cortex_m::interrupt::disable();
    outputs::switch_off();
    let [_, _, faults] = read_record();
    record(cause, faults.wrapping_add(1));
}

/// Keeps the cause of a reset for the time after it.
fn record(cause: ResetCause, faults: u32) {
    let word = MAGIC | cause as u32;
    write_record([word, !word, faults]);
}

/// Stops the machine, tells the sender, and resets the chip.
pub(super) fn stop(cause: ResetCause) -> ! {
    stop_machine(cause);
    // The baud rate is wrong without the crystal.
    if cause != ResetCause::Clock {
        send_fault(format_args!("{}", cause.text()));
    }
    SCB::sys_reset()
}

/// Says again and again what keeps the firmware from starting, as alarm 16. Its USART must be set up. What may end by
/// itself is tried again, with the cause of the last reset, which is not lost meanwhile.
pub(super) fn refuse(words: &[&str], cause: Option<ResetCause>) -> ! {
    /// A second at the frequency of the internal oscillator, a tenth of it at full speed.
    const PAUSE_CYCLES: u32 = 16_000_000;
    FaultPort::open();
    loop {
        let _ = FaultPort.write_str("\r\nALARM:16\r\n[MSG:");
        for word in words {
            watchdog::feed();
            let _ = FaultPort.write_str(word);
        }
        let _ = FaultPort.write_str("]\r\n");
        watchdog::pause(PAUSE_CYCLES);
        if let Some(cause) = cause {
            let [_, _, faults] = read_record();
            record(cause, faults);
            SCB::sys_reset();
        }
    }
}

/// Sends a message to the sender and to a debug probe.
fn send_fault(what: fmt::Arguments<'_>) {
    let _ = write!(FaultPort, "\r\n[MSG:Fault: {what}]\r\n");
    FaultPort::drain();
}

#[panic_handler]
#[expect(unsafe_code, reason = "a panic handler has no arguments of its own")]
fn panic(info: &PanicInfo) -> ! {
    stop_machine(ResetCause::Panic);
    // SAFETY: nothing else has the channel, and nothing else runs any more.
    if let Some(mut channel) = unsafe { UpChannel::conjure(CHANNEL) } {
        let _ = writeln!(channel, "{info}");
    }
    match info.location() {
        Some(place) => send_fault(format_args!("panic at {}:{}", place.file(), place.line())),
        None => send_fault(format_args!("panic")),
    }
    SCB::sys_reset()
}

/// Handlers of faults.
#[expect(unsafe_code, reason = "the runtime wants such functions")]
mod handlers {
    use cortex_m_rt::{ExceptionFrame, exception};
    use leadscrew::model::ResetCause;

    /// A fault of the processor, for instance a stack that has grown into its guard.
    #[exception]
    unsafe fn HardFault(_: &ExceptionFrame) -> ! {
        super::stop(ResetCause::Processor)
    }

    /// The crystal has stopped, RM0090 7.2.7. The flag stays: this never returns.
    #[exception]
    unsafe fn NonMaskableInt() -> ! {
        super::stop(ResetCause::Clock)
    }

    /// An exception or an interrupt without a task.
    #[exception]
    unsafe fn DefaultHandler(_: i16) -> ! {
        super::stop(ResetCause::Interrupt)
    }
}
