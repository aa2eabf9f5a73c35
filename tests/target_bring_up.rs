//! What a board has, and whether the board does everything that the firmware counts on: `cargo xtask bring-up --board
//! NAME`.
//!
//! The program is the firmware's own board folder without its tasks: clocks, step timer, USART, fault handlers
//! and watchdog are those files, compiled once more. It measures, and judges nothing: each fact is a line of
//! a name and a number, which `proof/target/src/bring_up/` reads. Faults end in a reset each, so the facts are
//! in memory that outlives it, and go to RTT channel 0 at the end, or by semihosting in the emulator.
#![cfg_attr(target_os = "none", no_std, no_main)]

#[cfg(not(target_os = "none"))]
fn main() {
    println!("skipped on the host: `cargo xtask bring-up --board NAME` runs it on a board");
}

#[cfg(target_os = "none")]
#[path = "bring_up/board.rs"]
mod board;

#[cfg(target_os = "none")]
mod target {
    use defmt_semihosting as _;

    #[cortex_m_rt::entry]
    fn main() -> ! {
        crate::board::bring_up()
    }
}
