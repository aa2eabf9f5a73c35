//! What happens when the program contradicts itself: all tasks stop, and a debug probe reads why.
//!
//! The message goes to an RTT channel of its own, which nothing else uses: no task ever logs.

use core::{fmt::Write as _, panic::PanicInfo};

use rtt_target::{ChannelMode, UpChannel, rtt_init};

/// Number of the channel.
const CHANNEL: usize = 0;

/// Lets a debug probe find the channel.
pub(super) fn init() {
    let _ = rtt_init! {
        up: { 0: { size: 256, mode: ChannelMode::NoBlockTrim, name: "panic" } }
    };
}

/// Stops every task. The drivers stay as they are: an axis that is held must not fall.
#[panic_handler]
#[expect(unsafe_code, reason = "nobody can hand the channel to a panic")]
fn panic(info: &PanicInfo) -> ! {
    cortex_m::interrupt::disable();
    // SAFETY: nothing else has the channel, and nothing else runs any more.
    if let Some(mut channel) = unsafe { UpChannel::conjure(CHANNEL) } {
        let _ = writeln!(channel, "{info}");
    }
    loop {
        cortex_m::asm::wfi();
    }
}
