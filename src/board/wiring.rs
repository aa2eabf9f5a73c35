//! How the machine is wired: the function of each pin, and the modes of a pin.
//!
//! Registers of the ports: RM0090 8.4, the same on all parts.

use leadscrew::{axis::AXES, model::Levels};

use super::{chosen, pac};

/// A pin of ports A, B or C.
#[derive(Clone, Copy, PartialEq, Eq)]
pub(super) enum Pin {
    /// Port A.
    A(u8),
    /// Port B.
    B(u8),
    /// Port C.
    C(u8),
}

/// The pins of all functions.
pub(super) struct Wiring {
    /// Step outputs, on ports A and B only.
    pub(super) step: [Pin; 6],
    /// Direction outputs.
    pub(super) direction: [Pin; 6],
    /// Enable output of all drivers, active low.
    pub(super) enable: Pin,
    /// Outputs of spindle and coolant, active high.
    pub(super) accessories: AccessoryPins,
    /// Spindle PWM, and the alternate function that brings its timer there.
    pub(super) pwm: Option<(Pin, u32)>,
    /// Inputs, closed when low. Of two pins with one number, only the first interrupts.
    pub(super) inputs: &'static [(Levels, Pin)],
}

/// Outputs of spindle and coolant.
pub(super) struct AccessoryPins {
    /// High while the spindle turns, or the laser may shine.
    pub(super) spindle: Option<Pin>,
    /// High for `M4`.
    pub(super) counter_clockwise: Option<Pin>,
    /// `M8`.
    pub(super) flood: Option<Pin>,
    /// `M7`.
    pub(super) mist: Option<Pin>,
}

/// Returns the limit switch of an axis, 0 = X.
pub(super) const fn limit_switch(axis: u8) -> Levels {
    Levels::limits(1 << axis)
}

impl Wiring {
    /// Returns whether all step outputs are on ports A and B, which alone are written at a step.
    pub(super) const fn has_steps_on_a_and_b(&self) -> bool {
        let mut axis = 0;
        while axis < AXES {
            if matches!(self.step[axis], Pin::C(_)) {
                return false;
            }
            axis += 1;
        }
        true
    }

    /// Returns whether no pin has two functions.
    pub(super) const fn uses_each_pin_once(&self) -> bool {
        let mut used = UsedPins([0; 3]);
        let mut is_free = used.add(self.enable);
        let mut axis = 0;
        while axis < AXES {
            is_free &= used.add(self.step[axis]) && used.add(self.direction[axis]);
            axis += 1;
        }
        let accessories = &self.accessories;
        let mut outputs = [
            accessories.spindle,
            accessories.counter_clockwise,
            accessories.flood,
            accessories.mist,
            None,
        ];
        if let Some((pin, _)) = self.pwm {
            outputs[4] = Some(pin);
        }
        let mut output = 0;
        while output < outputs.len() {
            if let Some(pin) = outputs[output] {
                is_free &= used.add(pin);
            }
            output += 1;
        }
        let mut input = 0;
        while input < self.inputs.len() {
            is_free &= used.add(self.inputs[input].1);
            input += 1;
        }
        is_free
    }
}

/// The pins that have a function, a bit for each number of each port.
struct UsedPins([u16; 3]);

impl UsedPins {
    /// Adds a pin. Returns whether it had no function.
    const fn add(&mut self, pin: Pin) -> bool {
        let (port, number) = pin.port_and_number();
        let is_free = self.0[port] & 1 << number == 0;
        self.0[port] |= 1 << number;
        is_free
    }
}

const _: () = assert!(
    chosen::WIRING.has_steps_on_a_and_b(),
    "a step output is on port C, which `pins::write` does not write at a step"
);
const _: () = assert!(
    chosen::WIRING.uses_each_pin_once(),
    "a pin of the wiring has two functions"
);

impl Pin {
    /// Returns the port, A = 0, and the number in it.
    pub(super) const fn port_and_number(self) -> (usize, u8) {
        match self {
            Self::A(number) => (0, number),
            Self::B(number) => (1, number),
            Self::C(number) => (2, number),
        }
    }

    /// Returns the word for each port's set/reset register that drives the pin.
    pub(super) const fn word(self, high: bool) -> [u32; 3] {
        let (port, number) = self.port_and_number();
        let mut words = [0; 3];
        words[port] = if high { 1 << number } else { 1 << number << 16 };
        words
    }

    /// Returns whether the pin is low, from the levels of the ports.
    #[inline]
    pub(super) const fn is_low(self, [a, b, c]: [u32; 3]) -> bool {
        let (level, number) = match self {
            Self::A(number) => (a, number),
            Self::B(number) => (b, number),
            Self::C(number) => (c, number),
        };
        level & 1 << number == 0
    }

    /// Makes the pin a push-pull output.
    pub(super) fn make_output(self) {
        self.set_field(MODER, 2, 0b01);
    }

    /// Makes the pin an input with a pull-up: high while its contact is open.
    pub(super) fn make_input(self) {
        self.set_field(PUPDR, 2, 0b01);
        self.set_field(MODER, 2, 0b00);
    }

    /// Makes the pin an output of a peripheral, by the number of the alternate function.
    pub(super) fn make_alternate(self, function: u32) {
        self.set_field(AFR, 4, function);
        self.set_field(MODER, 2, 0b10);
    }

    /// Changes the pin's field in a register of its port, or in one of two registers where fields
    /// are wide.
    #[expect(unsafe_code, reason = "pins are chosen by a table, not by type")]
    fn set_field(self, register: usize, width: u32, value: u32) {
        let (port, number) = self.port_and_number();
        let bit = u32::from(number) * width;
        let first = [
            pac::GPIOA::ptr().cast::<u32>(),
            pac::GPIOB::ptr().cast(),
            pac::GPIOC::ptr().cast(),
        ][port];
        let mask = (1 << width) - 1;
        // SAFETY: the register exists. `init` alone calls this, before any task runs, for pins of
        // the wiring, which nothing else uses; only the pin's field changes.
        unsafe {
            let register = first.cast_mut().add(register + (bit / 32) as usize);
            let others = register.read_volatile() & !(mask << (bit % 32));
            register.write_volatile(others | value << (bit % 32));
        }
    }
}

/// Registers of a port, in words from its first.
const MODER: usize = 0;
const PUPDR: usize = 3;
const AFR: usize = 8;
