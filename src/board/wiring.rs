//! How the machine is wired: the function of each pin, and the modes of a pin.
//!
//! Registers of the ports: RM0090 8.4, the same on all parts.

#[cfg(feature = "phases")]
use leadscrew::stepper::COILS;
use leadscrew::{
    axis::AXES,
    model::{Bootloaders, Levels},
};

/// A pin.
#[derive(Clone, Copy, PartialEq, Eq)]
pub(super) struct Pin {
    /// The port, 0 for A.
    port: u8,
    /// The number in the port.
    number: u8,
}

/// An output with its active level.
#[derive(Clone, Copy)]
pub(super) struct Output {
    pub(super) pin: Pin,
    pub(super) is_active_low: bool,
}

/// An input with the level of a closed contact.
pub(super) struct Input {
    pub(super) levels: Levels,
    pub(super) pin: Pin,
    pub(super) is_active_low: bool,
    pub(super) pull: Pull,
}

/// The resistor of an input.
#[derive(Clone, Copy)]
#[allow(dead_code, reason = "a board has some of them")]
pub(super) enum Pull {
    /// None.
    None = 0b00,
    /// To the supply: high while the contact is open.
    Up = 0b01,
    /// To ground.
    Down = 0b10,
}

/// The output of a timer.
pub(super) struct Pwm {
    pub(super) pin: Pin,
    /// The alternate function that brings the timer to the pin.
    pub(super) function: u32,
    /// Address of the timer's registers.
    pub(super) timer: usize,
    /// Channel, 1 to 4.
    pub(super) channel: usize,
    /// Divider of the timer's clock.
    pub(super) prescaler: u32,
    /// Whether a register holds back all outputs of the timer.
    pub(super) has_break: bool,
}

/// The pins of the EEPROM that has the settings.
#[cfg(feature = "eeprom")]
pub(super) struct EepromPins {
    pub(super) clock: Pin,
    pub(super) data: Pin,
}

/// A sector of the journal of settings.
#[cfg(not(feature = "eeprom"))]
pub(super) struct JournalPage {
    pub(super) sector: u8,
    pub(super) address: usize,
}

/// The clocks and pins of all functions.
pub(super) struct Wiring {
    /// Frequency of the crystal.
    pub(super) crystal_hz: u32,
    /// Whether it is a clock signal instead.
    pub(super) is_crystal_bypassed: bool,
    /// Frequency of the core.
    pub(super) core_hz: u32,
    /// Wait states of the flash at that frequency.
    pub(super) flash_wait_states: u8,
    /// TX of the sender's USART, RX, and their alternate function.
    pub(super) transmit: Pin,
    pub(super) receive: Pin,
    pub(super) serial_function: u32,
    /// Outputs of the motors.
    pub(super) motors: MotorPins,
    /// Enable outputs of the drivers.
    pub(super) enable: &'static [Output],
    /// Outputs of spindle and coolant.
    pub(super) accessories: AccessoryPins,
    /// Spindle PWM.
    pub(super) pwm: Option<Pwm>,
    /// Inputs. Of two pins with one number, only the first interrupts.
    pub(super) inputs: &'static [Input],
    /// Pins that get a level before all others, high or low, and keep it.
    pub(super) at_boot: &'static [(Pin, bool)],
    /// The part, as it is printed behind `STM32`.
    #[allow(dead_code, reason = "the bring-up does not refuse a chip")]
    pub(super) chip: &'static str,
    /// What chips say that they are, on which the firmware runs.
    #[allow(dead_code, reason = "the bring-up does not refuse a chip")]
    pub(super) dev_ids: &'static [u16],
    /// The bootloaders that `$DFU` and `$UF2` may start.
    #[allow(dead_code, reason = "the bring-up starts none")]
    pub(super) bootloaders: Bootloaders,
    /// The sectors of the journal of settings.
    #[cfg(not(feature = "eeprom"))]
    pub(super) journal: [JournalPage; 2],
    /// The EEPROM of the settings.
    #[cfg(feature = "eeprom")]
    pub(super) eeprom: EepromPins,
}

/// Outputs of the motors: of their drivers, or of their coils.
pub(super) struct MotorPins {
    #[cfg(not(feature = "phases"))]
    pub(super) step: [Pin; AXES],
    #[cfg(not(feature = "phases"))]
    pub(super) direction: [Pin; AXES],
    /// Those of second motors.
    #[cfg(not(feature = "phases"))]
    pub(super) second: &'static [SecondMotor],
    /// IN1 to IN4.
    #[cfg(feature = "phases")]
    pub(super) phases: [[Pin; COILS]; AXES],
}

/// Outputs of the second motor of an axis.
#[cfg(not(feature = "phases"))]
#[allow(dead_code, reason = "a board may have none")]
pub(super) struct SecondMotor {
    /// The axis, 0 = X.
    pub(super) axis: usize,
    pub(super) step: Pin,
    pub(super) direction: Pin,
    /// Whether it turns the other way than the first motor.
    pub(super) is_reversed: bool,
}

/// Outputs of spindle and coolant.
pub(super) struct AccessoryPins {
    /// Active while the spindle turns, or the laser may shine.
    pub(super) spindle: Option<Output>,
    /// Active for `M4`.
    pub(super) counter_clockwise: Option<Output>,
    /// `M8`.
    pub(super) flood: Option<Output>,
    /// `M7`.
    pub(super) mist: Option<Output>,
}

/// The number of ports that a chip may have: A to I.
const PORTS: usize = 9;

/// Ports in the order of their letters, and the number of each that is in use.
pub(super) struct PortList {
    ports: [u8; PORTS],
    pub(super) length: usize,
}

impl PortList {
    /// Returns an empty list.
    const fn new() -> Self {
        Self {
            ports: [0; PORTS],
            length: 0,
        }
    }

    /// Returns the list with the ports of some pins, a bit for each port.
    const fn of(bits: u16) -> Self {
        let mut list = Self::new();
        let mut port = 0;
        while port < PORTS {
            if bits >> port & 1 != 0 {
                list.ports[list.length] = port as u8;
                list.length += 1;
            }
            port += 1;
        }
        list
    }

    /// Returns the index of a port of the list.
    pub(super) const fn index(&self, port: u8) -> usize {
        let mut index = 0;
        while self.ports[index] != port {
            index += 1;
        }
        index
    }

    /// Returns the port at an index below the length.
    pub(super) const fn port(&self, index: usize) -> u8 {
        self.ports[index]
    }
}

#[cfg(not(feature = "phases"))]
impl MotorPins {
    /// Returns the number of pins.
    pub(super) const fn count(&self) -> usize {
        2 * (AXES + self.second.len())
    }

    /// Returns the pin of an index below [`Self::count`].
    pub(super) const fn pin(&self, index: usize) -> Pin {
        if index < AXES {
            return self.step[index];
        }
        if index < 2 * AXES {
            return self.direction[index - AXES];
        }
        let motor = &self.second[(index - 2 * AXES) / 2];
        if index.is_multiple_of(2) {
            motor.step
        } else {
            motor.direction
        }
    }
}

#[cfg(feature = "phases")]
impl MotorPins {
    /// Returns the number of pins.
    #[expect(clippy::unused_self, reason = "as for motors with drivers")]
    pub(super) const fn count(&self) -> usize {
        COILS * AXES
    }

    /// Returns the pin of an index below [`Self::count`].
    pub(super) const fn pin(&self, index: usize) -> Pin {
        self.phases[index / COILS][index % COILS]
    }
}

impl Wiring {
    /// Returns the ports that events change.
    pub(super) const fn event_ports(&self) -> PortList {
        let mut bits = 0;
        let mut index = 0;
        while index < self.motors.count() {
            bits |= 1 << self.motors.pin(index).port;
            index += 1;
        }
        PortList::of(bits)
    }

    /// Returns the ports of the enable outputs.
    #[cfg(not(feature = "phases"))]
    pub(super) const fn enable_ports(&self) -> PortList {
        let mut bits = 0;
        let mut index = 0;
        while index < self.enable.len() {
            bits |= 1 << self.enable[index].pin.port;
            index += 1;
        }
        PortList::of(bits)
    }

    /// Returns the ports of the inputs.
    pub(super) const fn input_ports(&self) -> PortList {
        let mut bits = 0;
        let mut index = 0;
        while index < self.inputs.len() {
            bits |= 1 << self.inputs[index].pin.port;
            index += 1;
        }
        PortList::of(bits)
    }
}

impl Pin {
    /// Returns the pin of a port, `'A'` to `'I'`, and a number.
    pub(super) const fn new(port: char, number: u8) -> Self {
        let port = port as u8 - b'A';
        assert!((port as usize) < PORTS && number < 16);
        Self { port, number }
    }

    /// Returns the port, A = 0.
    pub(super) const fn port(self) -> u8 {
        self.port
    }

    /// Returns the number in the port.
    pub(super) const fn number(self) -> u8 {
        self.number
    }

    /// Returns the word for the port's set/reset register that drives the pin.
    pub(super) const fn word(self, high: bool) -> u32 {
        if high {
            1 << self.number
        } else {
            1 << self.number << 16
        }
    }

    /// Drives the pin.
    pub(super) fn set(self, high: bool) {
        write_port(self.port, self.word(high));
    }

    /// Makes the pin a push-pull output with slow edges and no resistor: after a reset, some pins have fast
    /// edges or a pull-up.
    pub(super) fn make_output(self) {
        self.set_driver(Pull::None);
        self.set_field(MODER, 2, 0b01);
    }

    /// Makes the pin an end of a wire that either side pulls low: an output that does not drive the high level, with a
    /// pull-up.
    #[cfg(feature = "eeprom")]
    pub(super) fn make_open_drain(self) {
        self.set(true);
        self.set_driver(Pull::Up);
        self.set_field(OTYPER, 1, 1);
        self.set_field(MODER, 2, 0b01);
    }

    /// Returns whether the pin is high.
    #[cfg(feature = "eeprom")]
    pub(super) fn is_high(self) -> bool {
        read_port(self.port) >> self.number & 1 != 0
    }

    /// Makes the pin an input with a resistor.
    pub(super) fn make_input(self, pull: Pull) {
        self.set_field(PUPDR, 2, pull as u32);
        self.set_field(MODER, 2, 0b00);
    }

    /// Makes the pin one of a peripheral, by the number of the alternate function, with a resistor and slow
    /// edges.
    pub(super) fn make_alternate(self, function: u32, pull: Pull) {
        self.set_driver(pull);
        self.set_field(AFR, 4, function);
        self.set_field(MODER, 2, 0b10);
    }

    /// The same with the fastest edges.
    #[cfg(feature = "usb")]
    pub(super) fn make_fast_alternate(self, function: u32, pull: Pull) {
        self.make_alternate(function, pull);
        self.set_field(OSPEEDR, 2, 0b11);
    }

    /// Sets what a pin has as an output: push-pull, edges of 100 ns (data sheet, I/O AC characteristics), and
    /// a resistor.
    fn set_driver(self, pull: Pull) {
        self.set_field(OTYPER, 1, 0);
        self.set_field(OSPEEDR, 2, 0b00);
        self.set_field(PUPDR, 2, pull as u32);
    }

    /// Changes the pin's field in a register of its port, or in one of two registers where fields
    /// are wide.
    #[expect(unsafe_code, reason = "pins are chosen by a table, not by type")]
    fn set_field(self, register: usize, width: u32, value: u32) {
        let bit = u32::from(self.number) * width;
        let first = register_of(self.port, 0);
        let mask = (1 << width) - 1;
        // SAFETY: the register exists. `init` alone calls this, before any task runs, for pins of
        // the wiring, which nothing else uses; only the pin's field changes.
        unsafe {
            let register = first.add(register + (bit / 32) as usize);
            let others = register.read_volatile() & !(mask << (bit % 32));
            register.write_volatile(others | value << (bit % 32));
        }
    }
}

/// Registers of a port, in words from its first.
const MODER: usize = 0;
const OTYPER: usize = 1;
const OSPEEDR: usize = 2;
const PUPDR: usize = 3;
const IDR: usize = 4;
const BSRR: usize = 6;
const AFR: usize = 8;

/// The registers of port A, and the bytes from one port's to the next's: RM0090 2.3.
const FIRST_PORT: usize = 0x4002_0000;
const PORT_BYTES: usize = 0x400;

/// Returns the address of a register of a port.
const fn register_of(port: u8, register: usize) -> *mut u32 {
    (FIRST_PORT + PORT_BYTES * port as usize + 4 * register) as *mut u32
}

/// Sets and resets pins of a port.
#[expect(unsafe_code, reason = "a port by its number")]
pub(super) fn write_port(port: u8, word: u32) {
    // SAFETY: a write to BSRR is atomic and changes only the pins whose bits are set: pins of the wiring, which
    // nothing else drives. The chip has the port: `build.rs` has looked.
    unsafe { register_of(port, BSRR).write_volatile(word) };
}

/// Returns the levels of a port's pins.
#[expect(unsafe_code, reason = "a port by its number")]
pub(super) fn read_port(port: u8) -> u32 {
    // SAFETY: reads a register without side effects of a port that the chip has.
    unsafe { register_of(port, IDR).read_volatile() }
}
