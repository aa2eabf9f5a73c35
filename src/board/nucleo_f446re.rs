//! NUCLEO-F446RE with the Arduino CNC shield V3.
//!
//! | axis | step      | direction  | limit switch                               |
//! |------|-----------|------------|--------------------------------------------|
//! | X    | PA10 (D2) | PB4 (D5)   | PC7 (D9)                                   |
//! | Y    | PB3 (D3)  | PB10 (D6)  | PB6 (D10)                                  |
//! | Z    | PB5 (D4)  | PA8 (D7)   | PA6 (D12); from 4 axes PC10 (CN7-1)        |
//! | A    | PA6 (D12) | PA5 (D13)  | PC11 (CN7-2)                               |
//! | B    | PB8 (D15) | PB9 (D14)  | PC12 (CN7-3)                               |
//! | C    | PB14 (CN10-28) | PB13 (CN10-30) | PC2 (CN7-35)                        |
//!
//! | input       | pin          | output                | pin                          |
//! |-------------|--------------|-----------------------|------------------------------|
//! | probe       | PC0 (A5)     | enable of the drivers | PA9 (D8)                     |
//! | reset       | PA0 (A0)     | spindle PWM           | PA7 (D11)                    |
//! | feed hold   | PA1 (A1)     | spindle on            | PC5 (CN10-6)                 |
//! | cycle start | PA4 (A2)     | spindle direction     | PA5 (D13); from 4 axes PC6 (CN10-4) |
//! | door        | PC3 (CN7-37) | flood                 | PB0 (A3)                     |
//! |             |              | mist                  | PC1 (A4)                     |
//!
//! Inputs are closed when connected to ground. The sender is on USART2, 115 200 baud, PA2 (TX) and
//! PA3 (RX): the virtual serial port of the ST-LINK. The shield's pins are those of Grbl with
//! variable spindle: Z's switch is at the spindle enable pins, and the PWM at those of Z.
//! CN7 and CN10 are the Morpho headers. Two pins of one number share an interrupt line: reset, and
//! Z's switch on D12, are read once a millisecond instead.

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
    Actuators, Board, InputInterrupts, Memory, Receiver, StepPins, StepTimerToken,
    flash::SettingsFlash,
    host_clock, pac, pins,
    step_timer::StepTimer,
    vectors,
    wiring::{AccessoryPins, Pin, Wiring, limit_switch},
};

/// The USART of the sender.
pub(super) type Usart = pac::USART2;

/// Priority of `serial_rx` in `src/app.rs`.
const SERIAL_PRIORITY: u8 = 4;

vectors::forward_vectors!(USART2 => USART1);

/// The pins of the shield.
pub(super) static WIRING: Wiring = Wiring {
    step: [
        Pin::A(10),
        Pin::B(3),
        Pin::B(5),
        Pin::A(6),
        Pin::B(8),
        Pin::B(14),
    ],
    direction: [
        Pin::B(4),
        Pin::B(10),
        Pin::A(8),
        Pin::A(5),
        Pin::B(9),
        Pin::B(13),
    ],
    enable: Pin::A(9),
    accessories: AccessoryPins {
        spindle: Some(Pin::C(5)),
        counter_clockwise: Some(if AXES == 3 { Pin::A(5) } else { Pin::C(6) }),
        flood: Some(Pin::B(0)),
        mist: Some(Pin::C(1)),
    },
    // TIM14, channel 1.
    pwm: Some((Pin::A(7), 9)),
    inputs: match AXES {
        3 => &[
            (Levels::PROBE, Pin::C(0)),
            (limit_switch(0), Pin::C(7)),
            (limit_switch(1), Pin::B(6)),
            (limit_switch(2), Pin::A(6)),
            (Levels::HOLD, Pin::A(1)),
            (Levels::START, Pin::A(4)),
            (Levels::DOOR, Pin::C(3)),
            (Levels::RESET, Pin::A(0)),
        ],
        axes => INPUTS.split_at(axes + 5).0,
    },
};

/// Inputs with more than three axes; the limit switches of axes that the machine may lack come last.
const INPUTS: &[(Levels, Pin)] = &[
    (Levels::PROBE, Pin::C(0)),
    (Levels::HOLD, Pin::A(1)),
    (Levels::START, Pin::A(4)),
    (Levels::DOOR, Pin::C(3)),
    (Levels::RESET, Pin::A(0)),
    (limit_switch(0), Pin::C(7)),
    (limit_switch(1), Pin::B(6)),
    (limit_switch(2), Pin::C(10)),
    (limit_switch(3), Pin::C(11)),
    (limit_switch(4), Pin::C(12)),
    (limit_switch(5), Pin::C(2)),
];

/// Sets up clocks and pins: 168 MHz from the ST-LINK's 8 MHz.
///
/// # Panics
///
/// If the baud rate cannot be made from the clocks.
#[must_use]
pub(crate) fn init(device: pac::Peripherals, mut core: Core, memory: Memory) -> Board {
    super::panic::init();
    super::stack::guard(&core.MPU);
    super::trace::init(&mut core.DCB, &mut core.DWT);
    let config = Config::hse(8.MHz())
        .bypass_hse_oscillator()
        .sysclk(168.MHz());
    let mut rcc = super::start_clocks(device.RCC, &device.FLASH, config);
    super::enable_clocks(&mut rcc);
    let gpioa = device.GPIOA.split(&mut rcc);
    let _ = device.GPIOB.split(&mut rcc);
    let _ = device.GPIOC.split(&mut rcc);
    let pins = (gpioa.pa2, gpioa.pa3);
    let config = serial::Config::default().baudrate(115_200.bps());
    let serial = serial::Serial::<_, u8>::new(device.USART2, pins, config, &mut rcc)
        .expect("115200 baud divides the APB1 clock");
    let (usart, _) = serial.release();
    vectors::unmask(&mut core.NVIC, &[pac::Interrupt::USART2], SERIAL_PRIORITY);
    init_pwm(&device.TIM14, &mut rcc);
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
fn init_pwm(timer: &pac::TIM14, rcc: &mut Rcc) {
    pac::TIM14::enable(rcc);
    timer.psc().write(|w| w.psc().set(16 - 1));
    timer.arr().write(|w| w.arr().set(Outputs::FULL - 1));
    timer
        .ccmr1_output()
        .write(|w| w.oc1m().pwm_mode1().oc1pe().set_bit());
    timer.ccer().write(|w| w.cc1e().set_bit());
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
    unsafe { (*pac::TIM14::ptr()).ccr1().write(|w| w.bits(duty)) };
}
