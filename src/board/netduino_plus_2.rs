//! Netduino Plus 2, STM32F405RG, with the Arduino CNC shield V3; also as QEMU emulates it.
//!
//! | axis | step      | direction  | limit switch                     |
//! |------|-----------|------------|----------------------------------|
//! | X    | PA3 (D2)  | PB8 (D5)   | PA6 (D9); from 5 axes PC0 (A0)   |
//! | Y    | PA2 (D3)  | PB9 (D6)   | PB10 (D10); from 5 axes PC1 (A1) |
//! | Z    | PB12 (D4) | PA1 (D7)   | PB14 (D12); with 4 axes PC7 (D0), from 5 axes PC2 (A2) |
//! | A    | PB14 (D12)| PB13 (D13) | none                             |
//! | B    | PA6 (D9)  | PB10 (D10) | none                             |
//! | C    | PB15 (D11)| PC7 (D0)   | none                             |
//!
//! | input       | pin      | axes    | output                | pin        | axes    |
//! |-------------|----------|---------|-----------------------|------------|---------|
//! | probe       | PC5 (A5) | any     | enable of the drivers | PA0 (D8)   | any     |
//! | reset       | PC0 (A0) | up to 4 | spindle PWM           | PB15 (D11) | up to 5 |
//! | feed hold   | PC1 (A1) | up to 4 | spindle on            | PC6 (D1)   | any     |
//! | cycle start | PC2 (A2) | up to 4 | spindle direction     | PB13 (D13) | 3       |
//! | door        | PC7 (D0) | 3, 5    | flood                 | PC3 (A3)   | any     |
//! |             |          |         | mist                  | PC4 (A4)   | any     |
//!
//! Inputs are closed when connected to ground. The sender is on USART1, 115 200 baud, PB6 (TX) and
//! PB7 (RX): the header's SDA and SCL. The shield's pins are those of Grbl with variable spindle:
//! Z's switch is at the spindle enable pins, and the PWM at those of Z. With more axes, other
//! functions leave their pins to them, as the tables show.

use cortex_m::Peripherals as Core;
use leadscrew::{
    axis::AXES,
    model::{Levels, Outputs},
};
use stm32f4xx_hal::{
    prelude::*,
    rcc::{Config, Enable, Rcc},
    serial,
};

use super::{
    Actuators, Board, InputInterrupts, Memory, Receiver, StepPins, StepTimerToken, emulation,
    flash::SettingsFlash,
    host_clock, pac, pins,
    step_timer::StepTimer,
    wiring::{AccessoryPins, Pin, Wiring, limit_switch},
};

/// The USART of the sender.
pub(super) type Usart = pac::USART1;

/// The pins of the shield.
pub(super) static WIRING: Wiring = Wiring {
    step: [
        Pin::A(3),
        Pin::A(2),
        Pin::B(12),
        Pin::B(14),
        Pin::A(6),
        Pin::B(15),
    ],
    direction: [
        Pin::B(8),
        Pin::B(9),
        Pin::A(1),
        Pin::B(13),
        Pin::B(10),
        Pin::C(7),
    ],
    enable: Pin::A(0),
    accessories: AccessoryPins {
        spindle: Some(Pin::C(6)),
        counter_clockwise: if AXES == 3 { Some(Pin::B(13)) } else { None },
        flood: Some(Pin::C(3)),
        mist: Some(Pin::C(4)),
    },
    // TIM12, channel 2.
    pwm: if AXES == 6 {
        None
    } else {
        Some((Pin::B(15), 9))
    },
    inputs: match AXES {
        3 => &[
            (Levels::PROBE, Pin::C(5)),
            (limit_switch(0), Pin::A(6)),
            (limit_switch(1), Pin::B(10)),
            (limit_switch(2), Pin::B(14)),
            (Levels::RESET, Pin::C(0)),
            (Levels::HOLD, Pin::C(1)),
            (Levels::START, Pin::C(2)),
            (Levels::DOOR, Pin::C(7)),
        ],
        4 => &[
            (Levels::PROBE, Pin::C(5)),
            (limit_switch(0), Pin::A(6)),
            (limit_switch(1), Pin::B(10)),
            (limit_switch(2), Pin::C(7)),
            (Levels::RESET, Pin::C(0)),
            (Levels::HOLD, Pin::C(1)),
            (Levels::START, Pin::C(2)),
        ],
        5 => &[
            (Levels::PROBE, Pin::C(5)),
            (limit_switch(0), Pin::C(0)),
            (limit_switch(1), Pin::C(1)),
            (limit_switch(2), Pin::C(2)),
            (Levels::DOOR, Pin::C(7)),
        ],
        _ => &[
            (Levels::PROBE, Pin::C(5)),
            (limit_switch(0), Pin::C(0)),
            (limit_switch(1), Pin::C(1)),
            (limit_switch(2), Pin::C(2)),
        ],
    },
};

/// Sets up clocks and pins: 168 MHz from the 25 MHz crystal.
///
/// # Panics
///
/// If the baud rate cannot be made from the clocks.
#[must_use]
pub(crate) fn init(device: pac::Peripherals, mut core: Core, memory: Memory) -> Board {
    super::panic::init();
    super::stack::guard(&core.MPU);
    super::trace::init(&mut core.DCB, &mut core.DWT);
    // The emulator's PLL would never report ready.
    let is_emulated = emulation::detect(&device.RCC);
    let config = if is_emulated {
        emulation::init(&device.TIM2, &mut core.NVIC);
        Config::hsi()
    } else {
        Config::hse(25.MHz()).sysclk(168.MHz())
    };
    let mut rcc = super::start_clocks(device.RCC, &device.FLASH, config);
    super::enable_clocks(&mut rcc);
    let _ = device.GPIOA.split(&mut rcc);
    let gpiob = device.GPIOB.split(&mut rcc);
    let _ = device.GPIOC.split(&mut rcc);
    let pins = (gpiob.pb6, gpiob.pb7);
    let config = serial::Config::default().baudrate(115_200.bps());
    let serial = serial::Serial::<_, u8>::new(device.USART1, pins, config, &mut rcc)
        .expect("115200 baud divides the APB2 clock");
    let (usart, _) = serial.release();
    init_pwm(&device.TIM12, &mut rcc);
    // Before the journal is read, which takes long: spindle and laser must be off.
    let actuators = Actuators::new(device.TIM6);
    host_clock::init(&device.TIM4);
    let (session, storage) = memory.power_up(SettingsFlash::new(device.FLASH));
    pins::init(session.settings());
    Board {
        step_timer: StepTimerToken::new(),
        output: StepPins::new(StepTimer::new(core.SYST)),
        receiver: Receiver::new(usart),
        inputs: InputInterrupts::new(device.TIM7, device.EXTI, &device.SYSCFG, &mut core.NVIC),
        actuators,
        storage,
        session,
    }
}

/// Starts the PWM at 5.1 kHz: 84 MHz through 16 and [`Outputs::FULL`].
fn init_pwm(timer: &pac::TIM12, rcc: &mut Rcc) {
    pac::TIM12::enable(rcc);
    timer.psc().write(|w| w.psc().set(16 - 1));
    timer.arr().write(|w| w.arr().set(Outputs::FULL - 1));
    timer
        .ccmr1_output()
        .write(|w| w.oc2m().pwm_mode1().oc2pe().set_bit());
    timer.ccer().write(|w| w.cc2e().set_bit());
    timer.egr().write(|w| w.ug().set_bit());
    timer.cr1().write(|w| w.cen().set_bit());
}

/// Sets the high time of the PWM from its next period on, 0 to [`Outputs::FULL`].
#[inline]
#[expect(
    unsafe_code,
    reason = "two tasks set the register, never at the same time"
)]
pub(super) fn set_pulse(duty: u32) {
    // SAFETY: a single write to a register that only this function uses.
    unsafe { (*pac::TIM12::ptr()).ccr2().write(|w| w.bits(duty)) };
}
