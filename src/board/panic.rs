//! Panics and processor faults: everything stops, and a debug probe reads the message.
//!
//! Spindle, laser and coolant are switched off first: a timer would keep the beam on for ever. Faults
//! of the processor and interrupts without a task do the same. The message of a panic goes to an RTT
//! channel that nothing else uses: no task logs.

use core::{fmt::Write as _, panic::PanicInfo};

use rtt_target::UpChannel;
#[cfg(not(feature = "trace"))]
use rtt_target::{ChannelMode, rtt_init};

use super::outputs;

/// Number of the RTT channel.
const CHANNEL: usize = 0;

/// Sets up the channel, so that a debug probe finds it.
pub(super) fn init() {
    // With the feature, `trace` has the channel.
    #[cfg(not(feature = "trace"))]
    let _ = rtt_init! {
        up: { 0: { size: 256, mode: ChannelMode::NoBlockTrim, name: "panic" } }
    };
}

/// Stops every task and switches the outputs off; not the drivers: an axis that they hold must not
/// fall.
#[panic_handler]
#[expect(unsafe_code, reason = "a panic handler has no arguments of its own")]
fn panic(info: &PanicInfo) -> ! {
    cortex_m::interrupt::disable();
    outputs::switch_off();
    // SAFETY: nothing else has the channel, and nothing else runs any more.
    if let Some(mut channel) = unsafe { UpChannel::conjure(CHANNEL) } {
        let _ = writeln!(channel, "{info}");
    }
    halt()
}

/// Handlers of faults.
#[expect(unsafe_code, reason = "the runtime wants such functions")]
mod faults {
    use cortex_m_rt::{ExceptionFrame, exception};

    /// A fault of the processor, for instance a stack that has grown into its guard.
    #[exception]
    unsafe fn HardFault(_: &ExceptionFrame) -> ! {
        super::stop()
    }

    /// An exception or an interrupt without a task.
    #[exception]
    unsafe fn DefaultHandler(_: i16) -> ! {
        super::stop()
    }
}

/// Stops as a panic does, without a message.
pub(super) fn stop() -> ! {
    cortex_m::interrupt::disable();
    outputs::switch_off();
    halt()
}

fn halt() -> ! {
    loop {
        cortex_m::asm::wfi();
    }
}
