//! NUCLEO-F446RE with the Arduino CNC shield V3.
//!
//! | axis | step      | direction  |
//! |------|-----------|------------|
//! | X    | PA10 (D2) | PB4 (D5)   |
//! | Y    | PB3 (D3)  | PB10 (D6)  |
//! | Z    | PB5 (D4)  | PA8 (D7)   |
//! | A    | PA6 (D12) | PA5 (D13)  |
//! | B    | PB8 (D15) | PB9 (D14)  |
//! | C    | PB14      | PC8        |
//!
//! Enable is PA9 (D8). The sender is on USART2, 115 200 baud, PA2 (TX) and PA3 (RX): the virtual
//! serial port of the ST-LINK. The last axis is on the Morpho header.

use cortex_m::Peripherals as Core;
use stm32f4xx_hal::{
    prelude::*,
    rcc::{Config, Enable},
    serial,
};

use super::{
    Board, Flash, SerialPort, StepOutput, pac,
    pins::{self, Pin, Wiring},
    step_timer::StepTimer,
};

/// The port of the sender.
pub(super) type Usart = pac::USART2;
/// Its vector.
pub(super) const USART_VECTOR: pac::Interrupt = pac::Interrupt::USART2;

/// RTIC's priority 3 as the NVIC has it.
const SERIAL_PRIORITY: u8 = (16 - 3) << 4;

/// The shield's pins.
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
        Pin::C(8),
    ],
    enable: Pin::A(9),
};

/// Whether the firmware runs in an emulator: there is none for this board.
pub(super) const fn is_emulated() -> bool {
    false
}

/// The table of tasks binds `serial_rx` to USART1; on this board it is USART2 that calls.
#[unsafe(no_mangle)]
#[expect(unsafe_code, reason = "the handler is RTIC's")]
extern "C" fn USART2() {
    unsafe extern "C" {
        fn USART1();
    }
    // SAFETY: `serial_rx`'s vector. USART1 is not in use, and USART2 has the priority that RTIC
    // gives USART1, so this is the task's only activation.
    unsafe { USART1() }
}

/// Sets up clocks and pins, and reads what is stored: 168 MHz from the ST-LINK's 8 MHz.
///
/// # Panics
///
/// If the baud rate cannot be made from the clocks.
#[must_use]
pub(crate) fn init(device: pac::Peripherals, mut core: Core) -> Board {
    super::panic::init();
    let config = Config::hse(8.MHz())
        .bypass_hse_oscillator()
        .sysclk(168.MHz());
    let mut rcc = super::start_clocks(device.RCC, &device.FLASH, config);
    pac::TIM2::enable(&mut rcc);
    let gpioa = device.GPIOA.split(&mut rcc);
    let _ = device.GPIOB.split(&mut rcc);
    let _ = device.GPIOC.split(&mut rcc);
    let pins = (gpioa.pa2, gpioa.pa3);
    let config = serial::Config::default().baudrate(115_200.bps());
    let serial = serial::Serial::<_, u8>::new(device.USART2, pins, config, &mut rcc)
        .expect("115200 baud divides the APB1 clock");
    let (usart, _) = serial.release();
    release_usart2(&mut core.NVIC);
    let (journal, loaded) = Flash::new(device.FLASH, false).load();
    pins::init(&loaded.stored.settings);
    Board {
        output: StepOutput::new(StepTimer::new(device.TIM2, 0)),
        serial: SerialPort::new(usart),
        journal,
        loaded,
    }
}

/// Gives USART2 the priority of `serial_rx` and lets it interrupt, once `init` has returned.
#[expect(unsafe_code, reason = "a vector that RTIC does not manage")]
fn release_usart2(nvic: &mut pac::NVIC) {
    // SAFETY: RTIC keeps interrupts off until `init` has returned, and no lock of a lower ceiling
    // guards what `serial_rx` uses.
    unsafe {
        nvic.set_priority(pac::Interrupt::USART2, SERIAL_PRIORITY);
        pac::NVIC::unmask(pac::Interrupt::USART2);
    }
}
