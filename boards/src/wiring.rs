//! The pins of a machine with some number of axes, and what cannot work of them.

mod reader;

use crate::{Pin, PwmOutput, SerialPins, SignedPin};

pub(crate) use reader::WiringReader;

/// Letters of the axes.
pub const AXES: [&str; 6] = ["X", "Y", "Z", "A", "B", "C"];
/// Axes that may have a second motor: X, Y and Z.
const GANGED_AXES: usize = 3;
/// Coils of a motor that is driven by phases.
pub(crate) const COILS: usize = 4;

/// The pins of the USB socket, D- and D+: the full-speed core of each chip has no others.
pub(crate) const USB_PINS: [Pin; 2] = [
    Pin {
        port: 0,
        number: 11,
    },
    Pin {
        port: 0,
        number: 12,
    },
];

/// An input.
#[derive(Debug, Clone, Copy, PartialEq, Eq, PartialOrd, Ord)]
pub enum Input {
    /// The probe.
    Probe,
    /// The limit switch of an axis, 0 = X.
    Limit(u8),
    /// The limit switch of an axis at its second motor.
    SecondLimit(u8),
    /// Feed hold button.
    Hold,
    /// Cycle start button.
    Start,
    /// Safety door.
    Door,
    /// Reset button.
    Reset,
}

impl Input {
    /// Returns the keys of all inputs.
    pub(crate) fn keys() -> Vec<String> {
        let limits = (0..AXES.len() as u8).map(Self::Limit);
        let others = [
            Self::Probe,
            Self::Hold,
            Self::Start,
            Self::Door,
            Self::Reset,
        ];
        let second = (0..GANGED_AXES as u8).map(Self::SecondLimit);
        limits.chain(second).chain(others).map(Self::key).collect()
    }

    /// Returns the key of the input in a file.
    pub fn key(self) -> String {
        match self {
            Self::Probe => "inputs.probe".into(),
            Self::Limit(axis) => format!("axes.{}.limit", AXES[usize::from(axis)]),
            Self::SecondLimit(axis) => format!("axes.{}2.limit", AXES[usize::from(axis)]),
            Self::Hold => "inputs.hold".into(),
            Self::Start => "inputs.start".into(),
            Self::Door => "inputs.door".into(),
            Self::Reset => "inputs.reset".into(),
        }
    }
}

/// The second motor of an axis.
#[derive(Debug, Clone, Copy, PartialEq, Eq)]
pub struct SecondMotor {
    /// The axis, 0 = X.
    pub axis: usize,
    /// Its step output.
    pub step: Pin,
    /// Its direction output, low active where it turns the other way than the first motor.
    pub direction: SignedPin,
}

/// The pins of a machine.
#[derive(Debug, Clone, PartialEq, Eq)]
pub struct Wiring {
    /// Step outputs, X first.
    pub step: Vec<Pin>,
    /// Direction outputs.
    pub direction: Vec<Pin>,
    /// The second motors of axes that have one.
    pub second: Vec<SecondMotor>,
    /// Instead of both, IN1 to IN4 of each motor: what energises its four coils.
    pub phases: Vec<[Pin; COILS]>,
    /// Outputs that enable drivers.
    pub enable: Vec<SignedPin>,
    /// The motor of each of them, as `X` or `Y2`; empty for all motors.
    pub enabled: Vec<String>,
    /// High while the spindle turns, or the laser may shine.
    pub spindle: Option<SignedPin>,
    /// Active for `M4`.
    pub counter_clockwise: Option<SignedPin>,
    /// `M8`.
    pub flood: Option<SignedPin>,
    /// `M7`.
    pub mist: Option<SignedPin>,
    /// Spindle PWM.
    pub pwm: Option<(Pin, PwmOutput)>,
    /// Inputs. Of those that share an interrupt line, only the first interrupts.
    pub inputs: Vec<(Input, SignedPin)>,
    /// Pins that get a level before all others, and keep it.
    pub at_boot: Vec<(Pin, bool)>,
    /// The sender's, or where the sender is at the USB socket, those of what is said when the firmware does not start.
    pub serial: SerialPins,
    /// The sender is at the USB socket, on [`USB_PINS`].
    pub has_usb: bool,
    /// Those of the EEPROM that has the settings.
    pub eeprom: Option<EepromPins>,
}

/// The pins of an EEPROM, both of which have pull-ups.
#[derive(Debug, Clone, Copy, PartialEq, Eq)]
pub struct EepromPins {
    /// Its clock.
    pub clock: Pin,
    /// Its data.
    pub data: Pin,
    /// Whether it has less than what all settings and 32 tools need.
    pub is_small: bool,
}

impl Wiring {
    /// Returns the number of axes.
    pub fn axes(&self) -> usize {
        self.step.len().max(self.phases.len())
    }

    /// Returns the outputs that turn motors.
    fn motor_pins(&self) -> Vec<Pin> {
        let pins = self.step.iter().chain(&self.direction);
        let pins = pins.chain(self.phases.as_flattened()).copied();
        let second = self.second.iter();
        pins.chain(second.flat_map(|motor| [motor.step, motor.direction.pin]))
            .collect()
    }

    /// Returns the ports that step events write, 0 = A.
    pub fn step_ports(&self) -> Vec<u8> {
        ports(&self.motor_pins())
    }

    /// Returns the ports of all pins, 0 = A.
    pub fn ports(&self) -> Vec<u8> {
        let signed = [self.spindle, self.counter_clockwise, self.flood, self.mist];
        let signed = signed
            .into_iter()
            .flatten()
            .chain(self.enable.iter().copied());
        let mut pins: Vec<Pin> = signed.map(|signed| signed.pin).collect();
        pins.extend(self.motor_pins());
        pins.extend(self.pwm.map(|(pin, _)| pin));
        pins.extend(self.inputs.iter().map(|(_, signed)| signed.pin));
        pins.extend(self.at_boot.iter().map(|(pin, _)| *pin));
        pins.extend([self.serial.transmit, self.serial.receive]);
        pins.extend(self.usb_pins());
        pins.extend(
            self.eeprom
                .into_iter()
                .flat_map(|pins| [pins.clock, pins.data]),
        );
        ports(&pins)
    }

    /// Returns the pins of the USB socket, where the sender is there: D- and D+.
    pub fn usb_pins(&self) -> impl Iterator<Item = Pin> {
        USB_PINS.into_iter().filter(|_| self.has_usb)
    }

    /// Returns the outputs on C13 to C15, which the chip's switch for its battery supplies.
    ///
    /// RM0090 8.3.13 and the data sheets: 3 mA, 2 MHz and 30 pF at most, and no source for an LED.
    pub fn weak_outputs(&self) -> Vec<Pin> {
        let signed = [self.spindle, self.counter_clockwise, self.flood, self.mist];
        let signed = signed.into_iter().flatten();
        let signed = signed.chain(self.enable.iter().copied());
        let outputs = signed.map(|signed| signed.pin).chain(self.motor_pins());
        let outputs = outputs.chain(self.at_boot.iter().map(|(pin, _)| *pin));
        let mut weak: Vec<_> = outputs.filter(|&pin| is_slow(pin)).collect();
        weak.sort_unstable();
        weak.dedup();
        weak
    }

    /// Returns the inputs that share their interrupt line with one before them: they are looked at twice in a
    /// millisecond.
    pub fn polled(&self) -> Vec<Input> {
        let numbers: Vec<u8> = self.inputs.iter().map(|(_, pin)| pin.pin.number).collect();
        let inputs = self.inputs.iter().enumerate();
        let polled = inputs.filter(|(index, _)| numbers[..*index].contains(&numbers[*index]));
        polled.map(|(_, (input, _))| *input).collect()
    }
}

/// Returns the ports of some pins.
fn ports(pins: &[Pin]) -> Vec<u8> {
    let mut ports: Vec<u8> = pins.iter().map(|pin| pin.port).collect();
    ports.sort_unstable();
    ports.dedup();
    ports
}

/// Pins of the backup domain: 3 mA and 2 MHz at most (data sheets, note to the table of pins).
fn is_slow(pin: Pin) -> bool {
    pin.port == 2 && pin.number >= 13
}
