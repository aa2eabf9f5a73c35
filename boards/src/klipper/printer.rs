//! The motors, switches and other pins that a configuration has.

use crate::{Fault, SignedPin};

use super::{
    configuration::{Configuration, Section},
    pins::{Aliases, Meaning},
};

/// A pin with what the printer uses it for.
#[derive(Debug, Clone, PartialEq, Eq)]
pub(crate) struct NamedPin {
    /// `heater_pin of [extruder]`.
    pub(crate) name: String,
    pub(crate) pin: SignedPin,
}

/// What ends the homing of a motor.
#[derive(Debug, Clone, PartialEq, Eq)]
pub(crate) enum Limit {
    None,
    Switch(SignedPin),
    /// Something else than a pin of the chip: `probe:z_virtual_endstop`.
    Other(String),
}

/// A motor.
#[derive(Debug, Clone, PartialEq, Eq)]
pub(crate) struct Motor {
    /// Its axis; with a number behind it, a further motor of the axis: `Y2`.
    pub(crate) axis: String,
    pub(crate) section: String,
    pub(crate) step: SignedPin,
    pub(crate) direction: SignedPin,
    pub(crate) enable: Option<SignedPin>,
    pub(crate) limit: Limit,
}

/// What a configuration tells of a board.
#[derive(Debug)]
pub(crate) struct Printer {
    /// The motors: X, Y and Z first, further motors of axes last.
    pub(crate) motors: Vec<Motor>,
    pub(crate) probe: Option<SignedPin>,
    /// Heaters, fans and the like.
    pub(crate) outputs: Vec<NamedPin>,
    /// Switches that are neither limits nor the probe.
    pub(crate) inputs: Vec<NamedPin>,
    /// Pins by which drivers are set up.
    pub(crate) drivers: Vec<NamedPin>,
    /// Sentences on what is left out.
    pub(crate) left_out: Vec<String>,
    /// Comments of the configuration that tell of the chip.
    pub(crate) remarks: Vec<String>,
}

/// The motors that each machine has: their axes, and their sections, those of deltas behind the others.
const MAIN: [(&str, [&str; 2]); 3] = [
    ("X", ["stepper_x", "stepper_a"]),
    ("Y", ["stepper_y", "stepper_b"]),
    ("Z", ["stepper_z", "stepper_c"]),
];
/// The axes of other motors.
const OTHERS: [&str; 3] = ["A", "B", "C"];

/// Kinds of sections whose `pin` is an output.
const OUTPUTS: [&str; 11] = [
    "fan",
    "heater_fan",
    "controller_fan",
    "temperature_fan",
    "fan_generic",
    "output_pin",
    "pwm_tool",
    "pwm_cycle_time",
    "servo",
    "neopixel",
    "dotstar",
];

impl Printer {
    /// Reads what a configuration tells of a board.
    pub(crate) fn of(configuration: &Configuration) -> Result<Self, Fault> {
        let mut printer = Self {
            motors: Vec::new(),
            probe: None,
            outputs: Vec::new(),
            inputs: Vec::new(),
            drivers: Vec::new(),
            left_out: Vec::new(),
            remarks: configuration.remarks.clone(),
        };
        let pins = Pins {
            aliases: Aliases::of(configuration)?,
        };
        printer.add_motors(configuration, &pins)?;
        for section in &configuration.sections {
            printer.add_others(section, &pins)?;
        }
        Ok(printer)
    }

    fn add_motors(&mut self, configuration: &Configuration, pins: &Pins) -> Result<(), Fault> {
        let mut main = Vec::new();
        for (axis, names) in MAIN {
            let found = names.iter().find_map(|name| configuration.section(name));
            let section = found.ok_or_else(|| {
                let message = format!("there is no [{}]: X, Y and Z have a motor each", names[0]);
                configuration.place.fault(message)
            })?;
            let motor = pins.motor(section, axis)?;
            let motor = motor.map_err(|pin| {
                let message = format!("{axis} has its motor at another chip, {pin}");
                section.place.fault(message)
            })?;
            self.motors.push(motor);
            main.push(section);
        }
        let mut free = OTHERS.iter();
        let mut further = Vec::new();
        for section in &configuration.sections {
            if main.contains(&section) || section.value("step_pin").is_none() {
                continue;
            }
            let second = further_motor_of(section, &main);
            let Some(axis) = second.or_else(|| free.next().map(|axis| (*axis).to_owned())) else {
                let message = format!("[{}]: a machine has six axes at most", section.name);
                self.left_out.push(message);
                continue;
            };
            let is_further = axis.len() > 1;
            match pins.motor(section, &axis)? {
                Ok(motor) if is_further => further.push(motor),
                Ok(motor) => self.motors.push(motor),
                Err(pin) => self.leave_out(&section.name, &pin),
            }
        }
        self.motors.extend(further);
        Ok(())
    }

    /// Adds what is no motor.
    fn add_others(&mut self, section: &Section, pins: &Pins) -> Result<(), Fault> {
        let (kind, _) = section.kind();
        let probe = match kind {
            "probe" | "smart_effector" => "pin",
            "bltouch" => "sensor_pin",
            _ => "",
        };
        match pins.pin(section, probe)? {
            Some(Meaning::Own(pin)) => self.probe = Some(pin),
            Some(Meaning::Foreign(pin)) => self.leave_out(&section.name, &pin),
            None => {}
        }
        let is_output = OUTPUTS.contains(&kind);
        let is_driver = kind.starts_with("tmc");
        let mut of_probe_control = ["heater_pin", "control_pin"].to_vec();
        of_probe_control.extend(is_output.then_some("pin"));
        for key in of_probe_control {
            Self::add_named(&mut self.outputs, section, key, pins)?;
        }
        let is_button = kind == "gcode_button" && section.value("analog_range").is_none();
        Self::add_named(&mut self.inputs, section, "switch_pin", pins)?;
        if is_button {
            Self::add_named(&mut self.inputs, section, "pin", pins)?;
        }
        if is_driver {
            for key in ["uart_pin", "cs_pin"] {
                Self::add_named(&mut self.drivers, section, key, pins)?;
            }
            for key in ["diag_pin", "diag0_pin", "diag1_pin"] {
                Self::add_named(&mut self.inputs, section, key, pins)?;
            }
        }
        Ok(())
    }

    /// Adds the pin of a key, where it is one of the chip and not there already.
    fn add_named(
        to: &mut Vec<NamedPin>,
        section: &Section,
        key: &str,
        pins: &Pins,
    ) -> Result<(), Fault> {
        let Some(Meaning::Own(pin)) = pins.pin(section, key)? else {
            return Ok(());
        };
        if to.iter().all(|other| other.pin.pin != pin.pin) {
            let name = format!("{key} of [{}]", section.name);
            to.push(NamedPin { name, pin });
        }
        Ok(())
    }

    fn leave_out(&mut self, section: &str, pin: &str) {
        let message = format!("[{section}]: {pin} is no pin of this chip");
        self.left_out.push(message);
    }
}

/// Returns the name of a further motor of an axis, for `stepper_y1`: `Y2`.
fn further_motor_of(section: &Section, main: &[&Section]) -> Option<String> {
    let mut axes = MAIN.iter().zip(main);
    axes.find_map(|((axis, _), first)| {
        let number: u32 = section.name.strip_prefix(&first.name)?.parse().ok()?;
        Some(format!("{axis}{}", number + 1))
    })
}

/// Reads the pins of sections.
struct Pins {
    aliases: Aliases,
}

impl Pins {
    /// Returns what the pin of a key is, where the section has one.
    fn pin(&self, section: &Section, key: &str) -> Result<Option<Meaning>, Fault> {
        let value = section.value(key);
        value.map(|value| self.aliases.meaning(value)).transpose()
    }

    /// Reads a motor; where it is at another chip, only the name of its pin.
    fn motor(&self, section: &Section, axis: &str) -> Result<Result<Motor, String>, Fault> {
        let wanted = |key: &str| {
            let pin = self.pin(section, key)?;
            pin.ok_or_else(|| {
                let message = format!("[{}] has no {key}", section.name);
                section.place.fault(message)
            })
        };
        let (step, direction) = match (wanted("step_pin")?, wanted("dir_pin")?) {
            (Meaning::Own(step), Meaning::Own(direction)) => (step, direction),
            (Meaning::Foreign(pin), _) | (_, Meaning::Foreign(pin)) => return Ok(Err(pin)),
        };
        let enable = match self.pin(section, "enable_pin")? {
            Some(Meaning::Own(enable)) => Some(enable),
            Some(Meaning::Foreign(_)) | None => None,
        };
        let limit = match self.pin(section, "endstop_pin")? {
            Some(Meaning::Own(limit)) => Limit::Switch(limit),
            Some(Meaning::Foreign(pin)) => Limit::Other(pin),
            None => Limit::None,
        };
        Ok(Ok(Motor {
            axis: axis.to_owned(),
            section: section.name.clone(),
            step,
            direction,
            enable,
            limit,
        }))
    }
}
