//! Reads the outputs of motors: steps, directions, phases and second motors.

use super::{SECOND_MOTORS, WiringReader, signed_pin};
use crate::{
    Fault, Pin, SignedPin,
    board::missing,
    entries::Place,
    pin::Pull,
    wiring::{COILS, Input, SecondMotor, is_slow},
};

impl WiringReader<'_> {
    /// Reads a step or direction output, which must be there.
    pub(super) fn motor_output(&mut self, key: &str, file: &Place) -> Result<(Pin, Place), Fault> {
        let Some(entry) = self.functions.take(key) else {
            let axis = &key[..=key.rfind('.').unwrap_or(0)];
            let place = self.functions.place_of(axis.trim_end_matches('.'));
            return Err(missing(place.unwrap_or(file), key));
        };
        let signed = signed_pin(&entry)?;
        if signed.is_active_low || signed.pull != Pull::None {
            let message = "steps and directions have no sign here: `$2` and `$3` invert them";
            return Err(entry.place.fault(message));
        }
        self.use_pin(signed.pin, key, &entry.place)?;
        Ok((signed.pin, entry.place))
    }

    /// Reads the second motors of axes that have one, with their enable outputs and limit switches.
    pub(super) fn second_motors(
        &mut self,
        has_phases: bool,
        enable: &mut Vec<(String, SignedPin)>,
        limits: &mut Vec<Input>,
    ) -> Result<Vec<SecondMotor>, Fault> {
        let mut second = Vec::new();
        for (axis, name) in (0_u8..).zip(SECOND_MOTORS) {
            let group = format!("axes.{name}");
            let Some(place) = self.functions.place_of(&format!("{group}.")).cloned() else {
                continue;
            };
            if has_phases {
                return Err(place.fault("an axis with `phases` has one motor"));
            }
            second.push(self.second_motor(axis.into(), &group, &place)?);
            enable.extend(self.enable(name)?);
            limits.push(Input::SecondLimit(axis));
        }
        Ok(second)
    }

    /// Reads what enables a motor, or all of them where none is named.
    pub(super) fn enable(&mut self, motor: &str) -> Result<Option<(String, SignedPin)>, Fault> {
        let key = match motor {
            "" => "outputs.enable".into(),
            motor => format!("axes.{motor}.enable"),
        };
        Ok(self.output(&key)?.map(|pin| (motor.to_owned(), pin)))
    }

    /// Reads the outputs of a second motor.
    fn second_motor(
        &mut self,
        axis: usize,
        group: &str,
        place: &Place,
    ) -> Result<SecondMotor, Fault> {
        let step = self.step(&format!("{group}.step"), place)?;
        let key = format!("{group}.direction");
        let Some(entry) = self.functions.take(&key) else {
            return Err(missing(place, &key));
        };
        let direction = signed_pin(&entry)?;
        if direction.pull != Pull::None {
            return Err(entry.place.fault("an output has no pull-up or pull-down"));
        }
        self.use_pin(direction.pin, &key, &entry.place)?;
        Ok(SecondMotor {
            axis,
            step,
            direction,
        })
    }

    /// Reads IN1 to IN4 of a motor that is driven by phases.
    pub(super) fn phases(&mut self, key: &str, file: &Place) -> Result<[Pin; COILS], Fault> {
        let axis = key.trim_end_matches("phases");
        let Some(entry) = self.functions.take(key) else {
            let place = self.functions.place_of(axis);
            return Err(missing(place.unwrap_or(file), key));
        };
        for other in ["step", "direction"].map(|other| format!("{axis}{other}")) {
            if let Some(entry) = self.functions.get(&other) {
                let message =
                    format!("`{key}` takes the place of `{other}`: one of them is enough");
                return Err(entry.place.fault(message));
            }
        }
        let mut pins = Vec::new();
        for text in entry.texts()? {
            let pin: Pin = text
                .parse()
                .map_err(|error: String| entry.place.fault(error))?;
            self.use_pin(pin, key, &entry.place)?;
            pins.push(pin);
        }
        pins.try_into().map_err(|pins: Vec<Pin>| {
            let message = format!("`{key}` are the pins of IN1 to IN4, not {}", pins.len());
            entry.place.fault(message)
        })
    }

    /// Reads a step output: a direction may be on a slow pin, it stands longer than that needs.
    pub(super) fn step(&mut self, key: &str, file: &Place) -> Result<Pin, Fault> {
        let (pin, place) = self.motor_output(key, file)?;
        if is_slow(pin) {
            return Err(place.fault(format!(
                "{pin} is too slow for steps, as C13 to C15 are (2 MHz)"
            )));
        }
        Ok(pin)
    }
}
