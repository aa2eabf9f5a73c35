//! Cycles of instructions, buses and exceptions: `cargo xtask calibrate --board NAME`.
//!
//! Each class of the analysis' cycle table is measured with the processor's cycle counter, as the
//! difference between so many repetitions in a row and twice as many, from a warm cache, several
//! times. The results go to RTT channel 0, one line each, as `proof/target/src/calibrate.rs` reads them. An
//! emulator has no cycle counter: then the program says so, there and by semihosting, and ends.
#![cfg_attr(target_os = "none", no_std, no_main)]

#[cfg(not(target_os = "none"))]
fn main() {
    println!("skipped on the host: `cargo xtask calibrate --board NAME` runs it on a board");
}

// A bootloader may have run before.
#[cfg(target_os = "none")]
#[path = "../src/board/pre_init.rs"]
mod pre_init;

#[cfg(target_os = "none")]
#[path = "calibrate/cycles.rs"]
mod cycles;
#[cfg(target_os = "none")]
#[path = "calibrate/exceptions.rs"]
mod exceptions;
#[cfg(target_os = "none")]
#[path = "calibrate/instructions.rs"]
mod instructions;
#[cfg(target_os = "none")]
#[path = "calibrate/regions.rs"]
mod regions;

#[cfg(target_os = "none")]
mod target {
    use core::fmt::Write as _;

    use cortex_m::peripheral::Peripherals as Core;
    use defmt_semihosting as _;
    use rtt_target::{ChannelMode, UpChannel, rtt_init};
    use stm32f4xx_hal::{
        pac,
        rcc::{Config, Enable as _, RccExt as _},
        time::Hertz,
    };

    use super::{cycles::Sample, exceptions, instructions, regions};

    /// Destination of the samples.
    pub(crate) struct Samples(UpChannel);

    impl Samples {
        /// Writes a sample of a class: `sample CLASS VARIANT REPETITIONS LEAST MOST`.
        pub(crate) fn put(&mut self, class: &str, variant: &str, sample: &Sample) {
            let Sample {
                repetitions,
                least,
                most,
            } = sample;
            let line = writeln!(
                self.0,
                "sample {class} {variant} {repetitions} {least} {most}"
            );
            line.expect("the channel takes everything");
        }
    }

    #[panic_handler]
    fn panic(_: &core::panic::PanicInfo) -> ! {
        // Without the line `end` the host says that the program has failed.
        loop {
            cortex_m::asm::nop();
        }
    }

    /// The clocks of the firmware: what a bus costs depends on them.
    fn start_clocks(rcc: pac::RCC, flash: &pac::FLASH) {
        let config = Config::hse(Hertz::from_raw(number(env!("LEADSCREW_CRYSTAL_HZ"))));
        let config = match env!("LEADSCREW_CRYSTAL_BYPASSED") {
            "true" => config.bypass_hse_oscillator(),
            _ => config,
        };
        let config = config.sysclk(Hertz::from_raw(number(env!("LEADSCREW_CORE_HZ"))));
        let mut rcc = rcc.freeze(config);
        flash.acr().modify(|_, w| w.prften().clear_bit());
        pac::GPIOA::enable(&mut rcc);
        pac::TIM2::enable(&mut rcc);
        pac::SYSCFG::enable(&mut rcc);
        #[cfg(feature = "usb")]
        pac::OTG_FS_GLOBAL::enable(&mut rcc);
    }

    /// The number that the build script has made of the board's file.
    fn number(text: &str) -> u32 {
        text.parse().expect("the build script writes numbers")
    }

    #[cortex_m_rt::entry]
    fn main() -> ! {
        let channels = rtt_init! {
            up: { 0: { size: 8192, mode: ChannelMode::NoBlockTrim, name: "calibrate" } }
        };
        let mut samples = Samples(channels.up.0);
        let device = pac::Peripherals::take().expect("this is the first time");
        let mut core = Core::take().expect("this is the first time");
        cortex_m::interrupt::disable();
        core.DCB.enable_trace();
        core.DWT.enable_cycle_counter();
        if cfg!(feature = "qemu") {
            let _ = writeln!(samples.0, "no cycle counter");
            semihosting::println!("no cycle counter");
            semihosting::process::exit(0)
        }
        start_clocks(device.RCC, &device.FLASH);
        instructions::measure(&mut samples);
        regions::measure(&mut samples);
        exceptions::measure(&mut samples);
        let _ = writeln!(samples.0, "end");
        loop {
            cortex_m::asm::nop();
        }
    }
}
