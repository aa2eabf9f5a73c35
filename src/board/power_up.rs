//! What happens before the tasks run: clocks, pins and peripherals.

use cortex_m::Peripherals as Core;
#[cfg(feature = "usb")]
use leadscrew::model::{ResetCause, SelfTestFault};
use leadscrew::{
    model::{Alarm, HAS_REPRAP},
    protocol::Session,
};
use stm32f4xx_hal::rcc::{BusClock, Enable, Rcc, RccExt};

#[cfg(not(feature = "usb"))]
use super::serial::Receiver;
#[cfg(feature = "usb")]
use super::serial::UsbPort;
use super::{
    actuators::Actuators,
    backup_domain,
    chosen::{self, Usart, WIRING},
    clocks::{self, Clocks},
    fault, host_clock, image_check,
    inputs::InputInterrupts,
    motion_clock, outputs, pac, pins, pwm, reset_state, stack,
    step_output::{StepPins, StepTimerToken},
    step_timer::StepTimer,
    storage::{Medium, Memory, Storage},
    supply, trace, watchdog,
    wiring::Pull,
};

/// Bits a second that sender and firmware exchange.
pub(super) const BAUD: u32 = 115_200;
/// Priority of `serial_rx` in `src/app.rs`.
#[cfg(not(feature = "usb"))]
const SERIAL_PRIORITY: u8 = 4;

/// The peripherals the tasks drive.
pub(crate) struct Board {
    /// Step and direction pins, and their timer.
    pub(crate) output: StepPins,
    /// Token of the tasks that start and stop that timer.
    pub(crate) step_timer: StepTimerToken,
    /// Receiving half of the sender's USART.
    #[cfg(not(feature = "usb"))]
    pub(crate) receiver: Receiver,
    /// The USB socket.
    #[cfg(feature = "usb")]
    pub(crate) usb: UsbPort,
    /// Switches, probe and buttons.
    pub(crate) inputs: InputInterrupts,
    /// Spindle, coolant and drivers, and the timer that releases `prepare`.
    pub(crate) actuators: Actuators,
    /// The journal in flash.
    pub(crate) storage: &'static mut Storage,
    /// The session, with the contents of the journal.
    pub(crate) session: &'static mut Session,
    /// The alarm with which the machine comes up.
    pub(crate) alarm: Option<Alarm>,
}

/// Sets up clocks and pins.
///
/// # Panics
///
/// If the clocks are not what the ticks need.
#[must_use]
pub(crate) fn init(device: pac::Peripherals, mut core: Core, memory: Memory) -> Board {
    // From here on, it resets a chip that waits for ever.
    watchdog::start(&device.IWDG, &device.DBGMCU);
    fault::init();
    stack::guard(&core.MPU);
    trace::init(&mut core.DCB, &mut core.DWT, &device.DBGMCU);
    reset_state::undo(&device.RCC, &device.EXTI, &core.NVIC);
    let cause = fault::take_cause(&device.RCC);
    // Before anything that takes long, as the crystal and the journal: the pins float until then.
    let mut rcc = device.RCC.constrain();
    chosen::enable_ports(&mut rcc);
    outputs::make_safe();
    watchdog::set_period(&device.IWDG);
    chosen::enable_clocks(&mut rcc);
    if !is_right_chip(&device.DBGMCU) {
        refuse_chip(chosen::sender!(device), &rcc);
    }
    supply::watch(&device.PWR, &mut rcc, &mut core.NVIC);
    backup_domain::release_pins(&rcc, &device.PWR);
    let Clocks { mut rcc, fault } = clocks::start(rcc, &device.FLASH);
    start_peripherals(&mut rcc);
    pwm::init();
    #[cfg_attr(feature = "usb", expect(unused, reason = "it is for faults"))]
    let usart = start_serial(chosen::sender!(device), &rcc);
    if !image_check::is_whole() {
        fault::refuse(&["Firmware in flash is damaged: write it again"], None);
    }
    #[cfg(feature = "usb")]
    if let Some(fault) = fault {
        refuse_without_usb(fault, cause);
    }
    let actuators = Actuators::new(device.TIM9);
    motion_clock::start(&device.TIM5);
    host_clock::init(&device.TIM4);
    let (session, storage) = memory.power_up(Medium::new(device.FLASH));
    session.set_reset_cause(cause);
    session.set_self_test_fault(fault);
    session.set_bootloaders(WIRING.bootloaders);
    pins::configure(session.settings());
    pwm::configure(session.settings());
    let inputs = InputInterrupts::new(device.TIM10, device.EXTI, &device.SYSCFG, &mut core.NVIC);
    // At full speed the supply was good: at the internal oscillator's, nothing moves, and no reset would help.
    if fault.is_none() {
        supply::check();
    }
    Board {
        step_timer: StepTimerToken::new(),
        output: StepPins::new(StepTimer::new(core.SYST)),
        #[cfg(not(feature = "usb"))]
        receiver: start_receiver(usart, &mut core.NVIC),
        #[cfg(feature = "usb")]
        usb: UsbPort::new(device.TIM11),
        inputs,
        actuators,
        storage,
        session,
        alarm: fault.map(|_| Alarm::SelfTest).or(cause.alarm()),
    }
}

/// Returns whether the chip's identifier is of a chip that the firmware runs on, or is absent: RM0090 38.6.1.
fn is_right_chip(debug: &pac::DBGMCU) -> bool {
    let dev_id = debug.idcode().read().dev_id().bits();
    dev_id == 0 || WIRING.dev_ids.contains(&dev_id)
}

/// Says for ever that the firmware is for another chip: one with less memory or of a lower frequency may do anything.
#[cold]
fn refuse_chip(usart: Usart, rcc: &Rcc) -> ! {
    let _usart = start_serial(usart, rcc);
    let words = ["Firmware is for another chip, the STM32", WIRING.chip];
    fault::refuse(&words, None)
}

/// Says why the clock of USB does not run, where nothing else could be said to anybody.
#[cold]
#[cfg(feature = "usb")]
fn refuse_without_usb(fault: SelfTestFault, cause: ResetCause) -> ! {
    let words = match fault {
        SelfTestFault::NoCrystal => "Crystal does not run",
        SelfTestFault::OtherCrystal { .. } => "Crystal of another frequency",
        SelfTestFault::LowSupply => "Supply too low",
    };
    fault::refuse(&[words], Some(cause))
}

/// Starts the clocks of the peripherals that all boards use.
fn start_peripherals(rcc: &mut Rcc) {
    pac::TIM5::enable(rcc);
    pac::TIM9::enable(rcc);
    pac::TIM10::enable(rcc);
    #[cfg(feature = "usb")]
    {
        // The measurement of the crystal, which has the timer before, is over.
        pac::TIM11::enable(rcc);
        pac::OTG_FS_GLOBAL::enable(rcc);
    }
    if HAS_REPRAP {
        pac::TIM4::enable(rcc);
    }
    pac::SYSCFG::enable(rcc);
}

/// Sets up the sender's USART, or that of [`FaultPort`](super::fault_port::FaultPort) alone.
fn start_serial(usart: Usart, rcc: &Rcc) -> Usart {
    let clock_hz = <Usart as BusClock>::clock(&rcc.clocks).raw();
    // RM0090 30.3.4: with 16 samples a bit, the divider in sixteenths is the ratio of the frequencies.
    let divider = (clock_hz + BAUD / 2) / BAUD;
    usart.brr().write(|w| {
        w.div_mantissa().set((divider / 16) as u16);
        w.div_fraction().set((divider % 16) as u8)
    });
    let function = WIRING.serial_function;
    WIRING.transmit.make_alternate(function, Pull::None);
    // A line that nobody drives must not read as bytes.
    WIRING.receive.make_alternate(function, Pull::Up);
    usart
}

/// Switches the sender's USART on.
#[cfg(not(feature = "usb"))]
fn start_receiver(usart: Usart, nvic: &mut pac::NVIC) -> Receiver {
    chosen::unmask_sender(nvic, SERIAL_PRIORITY);
    Receiver::new(usart)
}
