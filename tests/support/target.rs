//! Needed by every test on the target: interrupt table, start-up code, log, panic handler.

use {cortex_m_rt as _, defmt_semihosting as _, stm32f4xx_hal as _};

/// Ends the emulator with a failure; `defmt` has already printed the message.
#[panic_handler]
fn panic(_: &core::panic::PanicInfo) -> ! {
    semihosting::process::exit(1)
}
