//! Netduino Plus 2, STM32F405RG, with the Arduino CNC shield V3; also as QEMU emulates it.
//!
//! | axis | step      | direction  |
//! |------|-----------|------------|
//! | X    | PA3 (D2)  | PB8 (D5)   |
//! | Y    | PA2 (D3)  | PB9 (D6)   |
//! | Z    | PB12 (D4) | PA1 (D7)   |
//! | A    | PB14 (D12)| PB13 (D13) |
//! | B    | PA6 (D9)  | PB10 (D10) |
//! | C    | PB15 (D11)| PC7 (D0)   |
//!
//! Enable is PA0 (D8). The sender is on USART1, 115 200 baud, PB6 (TX) and PB7 (RX): the header's
//! SDA and SCL. A fifth and a sixth axis take the shield's limit inputs.

use cortex_m::Peripherals as Core;
use stm32f4xx_hal::{
    prelude::*,
    rcc::{Config, Enable},
    serial,
};

use super::{
    Board, Flash, SerialPort, StepOutput, emulation, pac,
    pins::{self, Pin, Wiring},
    step_timer::StepTimer,
};

pub(super) use emulation::is_emulated;

/// The port of the sender.
pub(super) type Usart = pac::USART1;
/// Its vector.
pub(super) const USART_VECTOR: pac::Interrupt = pac::Interrupt::USART1;

/// The shield's pins.
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
};

/// Sets up clocks and pins, and reads what is stored: 168 MHz from the 25 MHz crystal.
///
/// # Panics
///
/// If the baud rate cannot be made from the clocks.
#[must_use]
pub(crate) fn init(device: pac::Peripherals, mut core: Core) -> Board {
    super::panic::init();
    // The emulator's PLL would never report ready.
    let is_emulated = emulation::detect(&device.RCC);
    let (config, prescaler) = if is_emulated {
        emulation::init(&mut core.SYST, &mut core.SCB);
        (Config::hsi(), emulation::PRESCALER)
    } else {
        (Config::hse(25.MHz()).sysclk(168.MHz()), 0)
    };
    let mut rcc = super::start_clocks(device.RCC, &device.FLASH, config);
    pac::TIM2::enable(&mut rcc);
    let _ = device.GPIOA.split(&mut rcc);
    let gpiob = device.GPIOB.split(&mut rcc);
    let _ = device.GPIOC.split(&mut rcc);
    let pins = (gpiob.pb6, gpiob.pb7);
    let config = serial::Config::default().baudrate(115_200.bps());
    let serial = serial::Serial::<_, u8>::new(device.USART1, pins, config, &mut rcc)
        .expect("115200 baud divides the APB2 clock");
    let (usart, _) = serial.release();
    let (journal, loaded) = Flash::new(device.FLASH, is_emulated).load();
    pins::init(&loaded.stored.settings);
    Board {
        output: StepOutput::new(StepTimer::new(device.TIM2, prescaler)),
        serial: SerialPort::new(usart),
        journal,
        loaded,
    }
}
