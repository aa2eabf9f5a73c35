//! Needed by every test on the target: interrupt table, start-up code, log, panic handler, and how tests are run.

use {cortex_m_rt as _, defmt_semihosting as _, stm32f4xx_hal as _};

/// Runs tests, and ends the emulator: what is false in one ends it before, see [`panic`].
macro_rules! run {
    ($($test:path),+) => {{
        $(
            defmt::println!("running `{=str}`", stringify!($test));
            $test();
        )+
        defmt::println!("all tests passed");
        semihosting::process::exit(0)
    }};
}
pub(crate) use run;

/// Ends the emulator with a failure; `defmt` has already printed the message.
#[panic_handler]
fn panic(_: &core::panic::PanicInfo) -> ! {
    semihosting::process::exit(1)
}
