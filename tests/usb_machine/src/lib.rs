//! The simulated machine behind the model of a chip's USB core, with the firmware's tasks of USB between them.
//!
//! ```text
//!  host ⇄ otg::Core ⇄ usb, usb_control ⇄ Simulator
//! ```

use leadscrew::{
    sim::{Edge, Simulator},
    units::TICKS_PER_MS,
    usb::{ControlBus, Driver, Mailbox, Registers, UsbControl, serial_number},
};
use otg::Core;

/// A period of `usb`, µs.
pub const PERIOD_US: u64 = 500;

const TICKS_PER_US: u64 = TICKS_PER_MS as u64 / 1000;

/// The registers of the model.
#[derive(Debug)]
pub struct Bus<'a>(pub &'a mut Core);

impl Registers for Bus<'_> {
    fn read(&mut self, offset: usize) -> u32 {
        self.0.read(offset)
    }

    fn write(&mut self, offset: usize, value: u32) {
        self.0.write(offset, value);
    }
}

/// Both tasks of USB, out of a reset, with the name of a board and the unique number of its chip.
///
/// Their memory is never freed: they live as long as the process, as on a chip.
///
/// # Panics
/// If the name is longer than [`leadscrew::usb::LONGEST_NAME`].
#[must_use]
pub fn tasks(name: &'static str, unique: [u32; 3]) -> (Driver<'static>, UsbControl<'static>) {
    let mailbox: &'static Mailbox = Box::leak(Box::new(Mailbox::new()));
    let allocator = Box::leak(Box::new(ControlBus::allocator(mailbox)));
    let digits = Box::leak(Box::new(serial_number(unique)));
    let serial = std::str::from_utf8(digits).expect("digits are text");
    let control = UsbControl::new(allocator, name, serial).expect("the names are short");
    (Driver::new(mailbox), control)
}

/// The machine with its tasks of USB. The core is the caller's, as hosts need it, too.
pub struct Device {
    /// The machine.
    pub simulator: Box<Simulator>,
    driver: Driver<'static>,
    control: UsbControl<'static>,
}

impl Device {
    /// A machine that has been switched on, whose board has a name and its chip a unique number.
    ///
    /// # Panics
    /// As [`tasks`].
    #[must_use]
    pub fn new(simulator: Box<Simulator>, name: &'static str, unique: [u32; 3]) -> Self {
        let (driver, control) = tasks(name, unique);
        Self {
            simulator,
            driver,
            control,
        }
    }

    /// Returns the time since power-up, µs.
    #[must_use]
    pub fn now_us(&self) -> u64 {
        self.simulator.now() / TICKS_PER_US
    }

    /// A period passes; `watch` gets what the step pins do.
    pub fn period(&mut self, core: &mut Core, watch: &mut impl FnMut(&Edge)) {
        let end = self.simulator.now() + PERIOD_US * TICKS_PER_US;
        while self.simulator.now() < end {
            if let Some(edge) = self.simulator.advance(end) {
                watch(&edge);
            }
        }
        core.pass(PERIOD_US);
        if self.simulator.serve_usb(&mut self.driver, &mut Bus(core)) {
            self.simulator.serve_usb_control(&mut self.control);
        }
        self.simulator.settle();
    }
}
