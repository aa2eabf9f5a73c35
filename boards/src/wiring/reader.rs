//! Reads which pin has which function, and remembers what each pin is for.

mod motors;

use std::collections::BTreeMap;

use super::{AXES, EepromPins, GANGED_AXES, Input, USB_PINS, Wiring};
use crate::{
    Chip, Fault, Part, Pin, PwmOutput, SerialPins, SignedPin,
    board::missing,
    entries::{Entries, Entry, Place},
    pin::Pull,
};

/// Ports that one step event may write.
const MAX_STEP_PORTS: usize = 6;
/// Inputs that a machine may have: more would make the task that looks at them longer than it is proven to be.
const MAX_INPUTS: usize = 11;
/// The KiB that an EEPROM must have: two copies of everything (`src/settings/storage/eeprom.rs`).
const MIN_EEPROM_KIB: u32 = 4;
/// The KiB that it must have for more than [`MAX_AXES_IN_SMALL_EEPROM`] axes, and for more than 16 tools.
const MIN_EEPROM_KIB_FOR_ALL: u32 = 8;
/// The axes whose settings fit the least EEPROM.
const MAX_AXES_IN_SMALL_EEPROM: usize = 4;
/// The most that an address of two bytes reaches.
const MAX_EEPROM_KIB: u32 = 64;
/// What second motors are called.
const SECOND_MOTORS: [&str; GANGED_AXES] = ["X2", "Y2", "Z2"];
/// Keys of the functions of an axis.
const AXIS_KEYS: [&str; 5] = ["step", "direction", "phases", "enable", "limit"];
/// Keys of other functions.
const NON_AXIS_KEYS: [&str; 16] = [
    "outputs.enable",
    "outputs.spindle",
    "outputs.counter_clockwise",
    "outputs.flood",
    "outputs.mist",
    "outputs.pwm",
    "inputs.probe",
    "inputs.reset",
    "inputs.hold",
    "inputs.start",
    "inputs.door",
    "serial.tx",
    "serial.rx",
    "eeprom.kib",
    "eeprom.scl",
    "eeprom.sda",
];

/// Reads the functions of the pins, and remembers which pin has which.
pub(crate) struct WiringReader<'a> {
    functions: Entries,
    chip: &'a Chip,
    part: &'a Part,
    has_debug_pins: bool,
    used: BTreeMap<Pin, (String, Place)>,
}

impl<'a> WiringReader<'a> {
    /// Returns a reader of functions: `axes.X.step`, `inputs.probe` and so on.
    pub(crate) fn new(
        functions: Entries,
        chip: &'a Chip,
        part: &'a Part,
        has_debug_pins: bool,
    ) -> Self {
        Self {
            functions,
            chip,
            part,
            has_debug_pins,
            used: BTreeMap::new(),
        }
    }

    /// Reads all functions of a machine with a number of axes.
    pub(crate) fn read(
        mut self,
        axes: usize,
        polled: &[String],
        file: &Place,
    ) -> Result<Wiring, Fault> {
        let at_boot = self.at_boot()?;
        let (serial, has_usb) = (self.serial(file)?, self.has_usb()?);
        let (mut step, mut direction, mut enable) = (Vec::new(), Vec::new(), Vec::new());
        let (mut phases, mut limits) = (Vec::new(), Vec::new());
        let has_phases = self.functions.get("axes.X.phases").is_some();
        let eeprom = self.eeprom(axes)?;
        for (axis, letter) in (0..).zip(&AXES[..axes]) {
            if has_phases {
                phases.push(self.phases(&format!("axes.{letter}.phases"), file)?);
            } else {
                step.push(self.step(&format!("axes.{letter}.step"), file)?);
                direction.push(
                    self.motor_output(&format!("axes.{letter}.direction"), file)?
                        .0,
                );
            }
            enable.extend(self.enable(letter)?);
            limits.push(Input::Limit(axis));
        }
        let second = self.second_motors(has_phases, &mut enable, &mut limits)?;
        enable.extend(self.enable("")?);
        let (enabled, enable): (Vec<_>, Vec<_>) = enable.into_iter().unzip();
        refuse_enable_of_phases(has_phases, &enable, file)?;
        for letter in &AXES[axes..] {
            self.functions.take_all(&format!("axes.{letter}."));
        }
        let mut wiring = Wiring {
            step,
            direction,
            second,
            phases,
            enable,
            enabled,
            spindle: self.output("outputs.spindle")?,
            counter_clockwise: self.output("outputs.counter_clockwise")?,
            flood: self.output("outputs.flood")?,
            mist: self.output("outputs.mist")?,
            pwm: self.pwm()?,
            inputs: Vec::new(),
            at_boot,
            serial,
            has_usb,
            eeprom,
        };
        self.inputs(&mut wiring, limits, polled)?;
        refuse_rest(&self.functions)?;
        let ports = wiring.step_ports();
        if ports.len() > MAX_STEP_PORTS {
            let names: Vec<_> = { ports.iter() }
                .map(|port| char::from(b'A' + port).to_string())
                .collect();
            let message = format!(
                "steps and directions are on {} ports, {}: put them on {MAX_STEP_PORTS} at most",
                ports.len(),
                names.join(" ")
            );
            return Err(file.fault(message));
        }
        Ok(wiring)
    }

    fn at_boot(&mut self) -> Result<Vec<(Pin, bool)>, Fault> {
        let entries = self.functions.take_all("at_boot.");
        let levels = entries.iter().map(|(name, entry)| {
            let pin: Pin = name
                .parse()
                .map_err(|error: String| entry.place.fault(error))?;
            let is_high = match entry.text()? {
                "high" => true,
                "low" => false,
                other => {
                    let message = format!("a pin is \"high\" or \"low\" at boot, not {other:?}");
                    return Err(entry.place.fault(message));
                }
            };
            self.use_pin(pin, &format!("at_boot.{name}"), &entry.place)?;
            Ok((pin, is_high))
        });
        levels.collect()
    }

    fn serial(&mut self, file: &Place) -> Result<SerialPins, Fault> {
        let mut pin = |key: &str| {
            let entry = self.functions.take(key);
            let entry = entry.ok_or_else(|| missing(file, key))?;
            let signed = signed_pin(&entry)?;
            self.use_pin(signed.pin, key, &entry.place)?;
            Ok((signed.pin, entry.place))
        };
        let (transmit, place) = pin("serial.tx")?;
        let (receive, _) = pin("serial.rx")?;
        SerialPins::of(transmit, receive, &self.chip.usarts).ok_or_else(|| {
            let known = SerialPins::known(&self.chip.usarts);
            let message =
                format!("{transmit} and {receive} are not TX and RX of one USART: {known}");
            place.fault(message)
        })
    }

    /// Reads where the sender is: at a UART, if nothing is said.
    fn has_usb(&mut self) -> Result<bool, Fault> {
        let Some(entry) = self.functions.take("link") else {
            return Ok(false);
        };
        match entry.text()? {
            "uart" => return Ok(false),
            "usb" => {}
            other => {
                let message = format!("the sender is at \"usb\" or at \"uart\", not at {other:?}");
                return Err(entry.place.fault(message));
            }
        }
        for pin in USB_PINS {
            self.use_pin(pin, "link", &entry.place)?;
        }
        Ok(true)
    }

    /// Reads what an EEPROM has, where one is named.
    fn eeprom(&mut self, axes: usize) -> Result<Option<EepromPins>, Fault> {
        let Some(table) = self.functions.place_of("eeprom.").cloned() else {
            return Ok(None);
        };
        let mut wanted = |key: &str| {
            let entry = self.functions.take(key);
            entry.ok_or_else(|| missing(&table, key))
        };
        let [kib, clock, data] = [
            wanted("eeprom.kib")?,
            wanted("eeprom.scl")?,
            wanted("eeprom.sda")?,
        ];
        let mut pin = |key: &str, entry: &Entry| {
            let signed = signed_pin(entry)?;
            if signed.is_active_low || signed.pull != Pull::None {
                let message = "the pins of an EEPROM have no sign: they are pulled up";
                return Err(entry.place.fault(message));
            }
            self.use_pin(signed.pin, key, &entry.place)?;
            Ok(signed.pin)
        };
        let clock = pin("eeprom.scl", &clock)?;
        let data = pin("eeprom.sda", &data)?;
        if !(MIN_EEPROM_KIB..=MAX_EEPROM_KIB).contains(&kib.number()?) {
            let message =
                format!("the settings need an EEPROM of {MIN_EEPROM_KIB} to {MAX_EEPROM_KIB} KiB");
            return Err(kib.place.fault(message));
        }
        let is_small = kib.number()? < MIN_EEPROM_KIB_FOR_ALL;
        if is_small && axes > MAX_AXES_IN_SMALL_EEPROM {
            let letter = AXES[MAX_AXES_IN_SMALL_EEPROM];
            let message = format!(
                "an EEPROM of less than {MIN_EEPROM_KIB_FOR_ALL} KiB has room for the settings of {MAX_AXES_IN_SMALL_EEPROM} axes: \
                 [with_{axes}_axes] with eeprom = \"none\" puts them into flash, {letter} = {{ step = \"none\" }} leaves it at these"
            );
            return Err(kib.place.fault(message));
        }
        Ok(Some(EepromPins {
            clock,
            data,
            is_small,
        }))
    }

    fn output(&mut self, key: &str) -> Result<Option<SignedPin>, Fault> {
        let Some(entry) = self.present(key)? else {
            return Ok(None);
        };
        let signed = signed_pin(&entry)?;
        if signed.pull != Pull::None {
            return Err(entry.place.fault("an output has no pull-up or pull-down"));
        }
        self.use_pin(signed.pin, key, &entry.place)?;
        Ok(Some(signed))
    }

    fn pwm(&mut self) -> Result<Option<(Pin, PwmOutput)>, Fault> {
        let key = "outputs.pwm";
        let Some(entry) = self.present(key)? else {
            return Ok(None);
        };
        let signed = signed_pin(&entry)?;
        if signed.is_active_low || signed.pull != Pull::None {
            return Err(entry.place.fault("the PWM has no sign: it is active high"));
        }
        let output = PwmOutput::of(signed.pin, &self.chip.timers).ok_or_else(|| {
            let free = PwmOutput::pins(&self.chip.timers, |pin| self.part.has(pin));
            let message = format!(
                "{} is no output of a timer that is free; those are {free}",
                signed.pin
            );
            entry.place.fault(message)
        })?;
        self.use_pin(signed.pin, key, &entry.place)?;
        Ok(Some((signed.pin, output)))
    }

    /// Reads the inputs: first those that must interrupt, last those that may be polled.
    fn inputs(
        &mut self,
        wiring: &mut Wiring,
        limits: Vec<Input>,
        polled: &[String],
    ) -> Result<(), Fault> {
        let mut order = vec![Input::Probe];
        order.extend(limits);
        order.extend([Input::Hold, Input::Start, Input::Door, Input::Reset]);
        order.sort_by_key(|input| polled.contains(&input.key()));
        for input in order {
            let key = input.key();
            let Some(entry) = self.present(&key)? else {
                continue;
            };
            let signed = signed_pin(&entry)?;
            self.use_pin(signed.pin, &key, &entry.place)?;
            let mut before = wiring.inputs.iter();
            let sharing = before.find(|(_, other)| other.pin.number == signed.pin.number);
            if let Some((other, pin)) = sharing
                && matches!(
                    input,
                    Input::Probe | Input::Limit(_) | Input::SecondLimit(_)
                )
                && !polled.contains(&key)
            {
                let message = format!(
                    "{key} ({}) shares its interrupt line with {} ({}): it would be looked at twice a millisecond \
                     only; take another pin, or add {key:?} to `polled`",
                    signed.pin,
                    other.key(),
                    pin.pin
                );
                return Err(entry.place.fault(message));
            }
            if wiring.inputs.len() == MAX_INPUTS {
                let message = format!(
                    "`{key}` is one input more than the {MAX_INPUTS} that a machine may have"
                );
                return Err(entry.place.fault(message));
            }
            wiring.inputs.push((input, signed));
        }
        Ok(())
    }

    /// Takes the entry of a function, unless it is `none`.
    fn present(&mut self, key: &str) -> Result<Option<Entry>, Fault> {
        let Some(entry) = self.functions.take(key) else {
            return Ok(None);
        };
        let is_none = entry.text()? == "none";
        Ok((!is_none).then_some(entry))
    }

    /// Gives a pin a function.
    fn use_pin(&mut self, pin: Pin, key: &str, place: &Place) -> Result<(), Fault> {
        if pin.port == 7 && pin.number < 2 {
            return Err(place.fault(format!("{pin} is a pin of the crystal")));
        }
        if !self.part.has(pin) {
            let message = format!("this part has no pin {pin}, it has {}", self.part.pins());
            return Err(place.fault(message));
        }
        if pin.port == 0 && matches!(pin.number, 13 | 14) && !self.has_debug_pins {
            let message = format!(
                "{pin} is a pin of the debug probe; with `debug_pins = true` the board gives it up"
            );
            return Err(place.fault(message));
        }
        let use_ = (key.to_owned(), place.clone());
        match self.used.insert(pin, use_) {
            None => Ok(()),
            Some((other, _)) => Err(place.fault(format!("{pin} is {other} already"))),
        }
    }
}

/// Refuses functions that nobody has asked for.
fn refuse_rest(functions: &Entries) -> Result<(), Fault> {
    let unknown = functions.iter().find(|(key, _)| {
        let axis = key.strip_prefix("axes.");
        let axis = axis.and_then(|key| key.split('.').next());
        let is_second = |letter: &str| SECOND_MOTORS.contains(&letter);
        axis.is_some_and(|letter| !AXES.contains(&letter) && !is_second(letter))
    });
    if let Some((key, entry)) = unknown {
        let message = format!(
            "`{key}` is not known; axes are {}, second motors {}",
            AXES.join(", "),
            SECOND_MOTORS.join(", ")
        );
        return Err(entry.place.fault(message));
    }
    let of_axes = AXES.iter().flat_map(|letter| {
        let keys = AXIS_KEYS.iter();
        keys.map(move |key| format!("axes.{letter}.{key}"))
    });
    let of_second = SECOND_MOTORS.iter().flat_map(|name| {
        let keys = ["step", "direction", "enable", "limit"].into_iter();
        keys.map(move |key| format!("axes.{name}.{key}"))
    });
    let known = of_axes
        .chain(of_second)
        .chain(NON_AXIS_KEYS.map(str::to_owned));
    let known: Vec<String> = known.collect();
    let known: Vec<&str> = known.iter().map(String::as_str).collect();
    functions.refuse_rest(&known)
}

/// Refuses what enables drivers where there are none.
fn refuse_enable_of_phases(
    has_phases: bool,
    enable: &[SignedPin],
    file: &Place,
) -> Result<(), Fault> {
    if has_phases && !enable.is_empty() {
        let message = "motors with phases are released by their coils: there is nothing to enable";
        return Err(file.fault(message));
    }
    Ok(())
}

fn signed_pin(entry: &Entry) -> Result<SignedPin, Fault> {
    entry
        .text()?
        .parse()
        .map_err(|error: String| entry.place.fault(error))
}
