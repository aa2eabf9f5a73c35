//! What happens when the program contradicts itself: everything stops, and a debug probe reads why.
//!
//! Spindle, laser and coolant are switched off first: a timer would keep the beam on for ever. The
//! same for faults of the processor and vectors without a task. The message goes to an RTT channel
//! of its own, which nothing else uses: no task ever logs.

use core::{fmt::Write as _, panic::PanicInfo};

use rtt_target::UpChannel;
#[cfg(not(feature = "trace"))]
use rtt_target::{ChannelMode, rtt_init};

use super::outputs;

/// Number of the channel.
const CHANNEL: usize = 0;

/// Lets a debug probe find the channel.
pub(super) fn init() {
    // With the feature, its channel is among those of `trace`.
    #[cfg(not(feature = "trace"))]
    let _ = rtt_init! {
        up: { 0: { size: 256, mode: ChannelMode::NoBlockTrim, name: "panic" } }
    };
}

/// Stops every task, and all outputs but the drivers: an axis that is held must not fall.
#[panic_handler]
#[expect(unsafe_code, reason = "nobody can hand the channel to a panic")]
fn panic(info: &PanicInfo) -> ! {
    cortex_m::interrupt::disable();
    outputs::switch_off();
    // SAFETY: nothing else has the channel, and nothing else runs any more.
    if let Some(mut channel) = unsafe { UpChannel::conjure(CHANNEL) } {
        let _ = writeln!(channel, "{info}");
    }
    stand()
}

/// What the processor calls instead of a task.
#[expect(unsafe_code, reason = "the runtime wants such functions")]
mod faults {
    use cortex_m_rt::{ExceptionFrame, exception};

    /// A fault of the processor, as of a stack that has left the RAM.
    #[exception]
    unsafe fn HardFault(_: &ExceptionFrame) -> ! {
        super::stop()
    }

    /// An exception or an interrupt that no task is for.
    #[exception]
    unsafe fn DefaultHandler(_: i16) -> ! {
        super::stop()
    }
}

/// The same as a panic, without a message.
fn stop() -> ! {
    cortex_m::interrupt::disable();
    outputs::switch_off();
    stand()
}

fn stand() -> ! {
    loop {
        cortex_m::asm::wfi();
    }
}
