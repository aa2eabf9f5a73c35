//! Needed by every test on the target: interrupt table, start-up code, log, panic handler.

use {cortex_m_rt as _, defmt_semihosting as _, stm32f4xx_hal as _};

/// The virtual machine is built on the stack and moved, so it needs more than the smallest chip has:
/// here the stack begins at the end of the 192 KiB of the emulated one.
#[expect(unsafe_code, reason = "a symbol of the linker script")]
mod stack {
    core::arch::global_asm!(".global _stack_start", ".set _stack_start, 0x20030000");
}

/// Ends the emulator with a failure; `defmt` has already printed the message.
#[panic_handler]
fn panic(_: &core::panic::PanicInfo) -> ! {
    semihosting::process::exit(1)
}
