//! The firmware's board folder, and the order in which it is looked at.
//!
//! Files of `src/board/` find each other by `super`, so this module has them all, with stand-ins for what
//! drives motors or keeps settings.

#[path = "../../src/board/backup_domain.rs"]
mod backup_domain;
#[path = "../../src/board/chosen.rs"]
#[allow(dead_code, reason = "not all that a board has is used")]
mod chosen;
#[cfg_attr(feature = "qemu", path = "../../src/board/qemu/clocks.rs")]
#[cfg_attr(not(feature = "qemu"), path = "../../src/board/clocks.rs")]
mod clocks;
#[cfg(not(feature = "qemu"))]
#[path = "../../src/board/crystal.rs"]
mod crystal;
#[path = "../../src/board/fault.rs"]
#[allow(dead_code, reason = "the firmware refuses to start")]
mod fault;
#[path = "../../src/board/fault_port.rs"]
#[allow(dead_code, reason = "the firmware refuses to start")]
mod fault_port;
#[path = "../../src/board/motion_clock.rs"]
#[allow(dead_code, reason = "there are no tasks")]
mod motion_clock;
#[path = "../../src/board/pre_init.rs"]
mod pre_init;
#[path = "../../src/board/pwm.rs"]
#[allow(dead_code, reason = "there are no settings")]
mod pwm;
#[path = "../../src/board/release.rs"]
#[allow(dead_code, reason = "there are no tasks")]
mod release;
#[path = "../../src/board/reset_state.rs"]
mod reset_state;
#[path = "../../src/board/serial.rs"]
#[allow(dead_code, reason = "nothing is sent in bulk")]
mod serial;
#[path = "../../src/board/stack.rs"]
mod stack;
#[path = "../../src/board/supply.rs"]
#[allow(dead_code, reason = "there are no inputs")]
mod supply;
#[path = "../../src/board/no_trace.rs"]
#[allow(dead_code, reason = "there are no tasks")]
mod trace;
#[path = "../../src/board/vectors.rs"]
#[allow(
    dead_code,
    unused_imports,
    unused_macros,
    reason = "a board may need none"
)]
mod vectors;
#[path = "../../src/board/watchdog.rs"]
#[allow(dead_code, reason = "there are no tasks")]
mod watchdog;
#[path = "../../src/board/wiring.rs"]
#[allow(dead_code, reason = "there are no inputs")]
mod wiring;

#[path = "chip.rs"]
mod chip;
#[path = "clock.rs"]
mod clock;
#[path = "echo.rs"]
mod echo;
#[path = "emulation.rs"]
mod emulation;
#[path = "faults.rs"]
mod faults;
#[path = "flash.rs"]
#[cfg_attr(
    feature = "qemu",
    allow(dead_code, unused_imports, reason = "the emulator's flash is memory")
)]
mod flash;
#[path = "kept.rs"]
mod kept;
#[path = "line.rs"]
mod line;
#[path = "outputs.rs"]
mod outputs;
#[path = "player.rs"]
mod player;
#[path = "priorities.rs"]
mod priorities;
#[path = "sequence.rs"]
mod sequence;
#[path = "stream.rs"]
mod stream;

use cortex_m::Peripherals as Core;
use stm32f4xx_hal::rcc::{BusClock, RccExt as _};

use self::{
    chosen::{Usart, WIRING},
    clocks::Clocks,
    kept::{Facts, Kept},
    wiring::Pull,
};
use stm32f4xx_hal::pac;

/// Bits a second, as in the firmware.
const BAUD: u32 = 115_200;

/// The pins of the motors stay as [`outputs::make_safe`] leaves them.
mod pins {
    /// Never called: nothing enables the drivers.
    pub(super) const fn enable(_: bool) {}
}

/// Looks at the board, with a reset after each fault, until everything has been told.
pub(crate) fn bring_up() -> ! {
    let device = pac::Peripherals::take().expect("this is the first time");
    let mut core = Core::take().expect("this is the first time");
    cortex_m::interrupt::disable();
    fault::init();
    if !emulation::has_flaw(c"unguarded") {
        stack::guard(&core.MPU);
    }
    clock::start(&mut core, &device.DBGMCU);
    if !emulation::is_emulated() {
        reset_state::undo(&device.RCC, &device.EXTI, &core.NVIC);
    }
    let reset_flags = device.RCC.csr().read().bits();
    let cause = fault::take_cause(&device.RCC);
    let mut rcc = device.RCC.constrain();
    chosen::enable_ports(&mut rcc);
    outputs::make_safe();
    supply::watch(&device.PWR, &mut rcc, &mut core.NVIC);
    let has_supply = !supply::is_low();
    backup_domain::release_pins(&rcc, &device.PWR);
    let Clocks { mut rcc, fault } = clocks::start(rcc, &device.FLASH);
    chosen::enable_clocks(&mut rcc);
    // A timer of the emulator is no PWM.
    if !emulation::is_emulated() {
        pwm::init();
    }
    priorities::set(&mut core.NVIC);
    let serial_hz = <Usart as BusClock>::clock(&rcc.clocks).raw();
    let usart = start_serial(chosen::sender!(device), serial_hz, &mut core.NVIC);
    let divider = usart.brr().read().bits();
    let receiver = serial::Receiver::new(usart);

    let mut kept = Kept::take();
    if kept.stage() == 0 {
        let facts = kept.begin();
        facts.put("crystal", fault.is_none().into());
        facts.put("supply", has_supply.into());
        facts.put("serial.clock_hz", serial_hz.into());
        facts.put("serial.divider", divider.into());
        chip::read(facts, &device.FLASH, &device.DBGMCU, reset_flags);
        echo::await_early_byte();
        player::play_all(facts, &mut core.SCB, core.SYST);
        priorities::read(facts);
    } else {
        faults::record(cause, reset_flags, &mut kept);
    }
    faults::go_on(&mut kept, &device.IWDG, &device.DBGMCU, &core.MPU);
    echo::end(kept.end(), receiver, device.FLASH)
}

/// Sets up the sender's USART as `power_up` of the firmware does.
fn start_serial(usart: Usart, clock_hz: u32, nvic: &mut pac::NVIC) -> Usart {
    let divider = (clock_hz + BAUD / 2) / BAUD;
    usart.brr().write(|w| {
        w.div_mantissa().set((divider / 16) as u16);
        w.div_fraction().set((divider % 16) as u8)
    });
    WIRING
        .transmit
        .make_alternate(WIRING.serial_function, Pull::None);
    WIRING
        .receive
        .make_alternate(WIRING.serial_function, Pull::Up);
    chosen::unmask_sender(nvic, priorities::SERIAL);
    echo::unmask(nvic);
    usart
}
