//! What happens before the tasks run: clocks, pins and peripherals.

use cortex_m::Peripherals as Core;
use leadscrew::{model::HAS_REPRAP, units::TICKS_PER_SECOND};
use stm32f4xx_hal::{
    rcc::{BusClock, Config, Enable, Rcc, RccExt},
    time::Hertz,
};

use super::{
    Actuators, Board, InputInterrupts, Memory, Receiver, StepPins, StepTimerToken, TIMERS_MHZ,
    bootloader,
    chosen::{self, Usart, WIRING},
    emulation,
    flash::SettingsFlash,
    flash_access, host_clock, pac, pins, pwm,
    step_timer::StepTimer,
};

/// Bits a second that sender and firmware exchange.
const BAUD: u32 = 115_200;
/// Priority of `serial_rx` in `src/app.rs`.
const SERIAL_PRIORITY: u8 = 4;

/// Sets up clocks and pins.
///
/// # Panics
///
/// If the clocks are not what the ticks need.
#[must_use]
pub(crate) fn init(device: pac::Peripherals, mut core: Core, memory: Memory) -> Board {
    super::panic::init();
    super::stack::guard(&core.MPU);
    super::trace::init(&mut core.DCB, &mut core.DWT);
    if WIRING.has_bootloader {
        bootloader::undo(&device.RCC, &mut core.SYST, &mut core.NVIC);
    }
    // The emulator's PLL would never report ready.
    let config = if emulation::detect(&device.RCC) {
        emulation::init(&device.TIM2, &mut core.NVIC);
        Config::hsi()
    } else {
        chip_clocks()
    };
    let mut rcc = start_clocks(device.RCC, &device.FLASH, config);
    start_peripherals(&mut rcc);
    chosen::enable_clocks(&mut rcc);
    for &(pin, high) in WIRING.at_boot {
        pin.set(high);
        pin.make_output();
    }
    pwm::init();
    // Before the journal is read, which takes long: spindle and laser must be off.
    let actuators = Actuators::new(device.TIM9);
    let usart = start_serial(chosen::sender!(device), &rcc, &mut core.NVIC);
    host_clock::init(&device.TIM4);
    let (session, storage) = memory.power_up(SettingsFlash::new(device.FLASH));
    pins::init(session.settings());
    Board {
        step_timer: StepTimerToken::new(),
        output: StepPins::new(StepTimer::new(core.SYST)),
        receiver: Receiver::new(usart),
        inputs: InputInterrupts::new(device.TIM10, device.EXTI, &device.SYSCFG, &mut core.NVIC),
        actuators,
        storage,
        session,
    }
}

/// Returns the clocks of the board's chip, from its crystal.
fn chip_clocks() -> Config {
    let config = Config::hse(Hertz::from_raw(WIRING.crystal_hz));
    let config = if WIRING.is_crystal_bypassed {
        config.bypass_hse_oscillator()
    } else {
        config
    };
    config.sysclk(Hertz::from_raw(WIRING.core_hz))
}

/// Sets the clocks to those of `config`, and reads flash without prefetch.
///
/// # Panics
///
/// If the core does not count half ticks, or TIM9 and TIM10 do not count its cycles: every time would be wrong.
fn start_clocks(rcc: pac::RCC, flash: &pac::FLASH, config: Config) -> Rcc {
    let rcc = rcc.freeze(config);
    let (core_hz, timers_hz) = (rcc.clocks.hclk().raw(), rcc.clocks.timclk2().raw());
    assert!(
        emulation::is_emulated()
            || core_hz == 2 * TICKS_PER_SECOND && timers_hz == u32::from(TIMERS_MHZ) * 1_000_000,
        "the step timer counts half ticks, and TIM9 and TIM10 count what their dividers are for"
    );
    flash.acr().write(|w| flash_access(w).dcen().set_bit());
    rcc
}

/// Starts the clocks of the peripherals that all boards use.
fn start_peripherals(rcc: &mut Rcc) {
    pac::TIM9::enable(rcc);
    pac::TIM10::enable(rcc);
    if HAS_REPRAP {
        pac::TIM4::enable(rcc);
    }
    pac::SYSCFG::enable(rcc);
}

/// Sets up the sender's USART but for its interrupt, which [`Receiver`] switches on.
fn start_serial(usart: Usart, rcc: &Rcc, nvic: &mut pac::NVIC) -> Usart {
    let clock_hz = <Usart as BusClock>::clock(&rcc.clocks).raw();
    // RM0090 30.3.4: with 16 samples a bit, the divider in sixteenths is the ratio of the frequencies.
    let divider = (clock_hz + BAUD / 2) / BAUD;
    usart.brr().write(|w| {
        w.div_mantissa().set((divider / 16) as u16);
        w.div_fraction().set((divider % 16) as u8)
    });
    for pin in [WIRING.transmit, WIRING.receive] {
        pin.make_alternate(WIRING.serial_function);
    }
    chosen::unmask_sender(nvic, SERIAL_PRIORITY);
    usart
}
