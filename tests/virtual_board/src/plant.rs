//! The plant wired to a board: motors that follow the steps, switches that follow the motors, a probe, the EEPROM, and
//! a record of each output.

use board_data::{Input, Pin, SignedPin, Wiring};
use rigless::{device::Level, time::VirtualNanos};

use crate::{
    chip::{Chip, Edge},
    eeprom::Eeprom,
};

/// A motor of an axis.
#[derive(Debug)]
struct Motor {
    axis: usize,
    step: Pin,
    direction: Pin,
    is_reversed: bool,
    /// It is the axis' second one.
    is_second: bool,
    position: i32,
}

/// A step of an axis' first motor.
#[derive(Debug, Clone, Copy, PartialEq, Eq)]
pub(crate) struct Step {
    pub(crate) at: VirtualNanos,
    pub(crate) axis: usize,
    pub(crate) is_forward: bool,
}

/// Where a motor closes a contact.
#[derive(Debug, Clone, Copy)]
pub(crate) enum Closes {
    /// At this position and above.
    From(i32),
    /// At this position and below.
    DownFrom(i32),
}

#[derive(Debug)]
struct Contact {
    input: Input,
    pin: SignedPin,
    axis: usize,
    closes: Vec<Closes>,
    is_closed: bool,
}

/// An output that switches something.
#[derive(Debug)]
struct Switched {
    name: String,
    pin: Pin,
    inactive: Level,
}

/// What is wired to a board.
#[derive(Debug)]
pub(crate) struct Plant {
    levels: [[Level; 16]; 11],
    motors: Vec<Motor>,
    /// The coils of each motor that is driven by phases, and which are energised.
    coils: Vec<([Pin; 4], u8)>,
    pub(crate) steps: Vec<Step>,
    /// How often the energised coils of a motor have changed: a motor that is driven by phases moves then.
    pub(crate) energised: usize,
    contacts: Vec<Contact>,
    eeprom: Option<Eeprom>,
    /// The EEPROM, where it is taken away.
    missing_eeprom: Option<Eeprom>,
    eeprom_pins: Option<[Pin; 2]>,
    switched: Vec<Switched>,
    /// Changes of outputs that are not motors', by their names; whether they are active.
    pub(crate) switchings: Vec<(VirtualNanos, String, bool)>,
    /// Outputs that were active before the firmware's greeting, or motors that moved.
    pub(crate) unsafe_outputs: Vec<String>,
    /// The firmware has said what it is.
    pub(crate) is_greeted: bool,
    /// Edges that were not looked at yet.
    edges: Vec<Edge>,
}

impl Plant {
    /// The plant of a board, with its EEPROM where it has one.
    pub(crate) fn new(wiring: &Wiring) -> Self {
        let first = { wiring.step.iter().zip(&wiring.direction).enumerate() }.map(
            |(axis, (&step, &direction))| Motor {
                axis,
                step,
                direction,
                is_reversed: false,
                is_second: false,
                position: 0,
            },
        );
        let second = wiring.second.iter().map(|motor| Motor {
            axis: motor.axis,
            step: motor.step,
            direction: motor.direction.pin,
            is_reversed: motor.direction.is_active_low,
            is_second: true,
            position: 0,
        });
        let contacts = wiring.inputs.iter().map(|&(input, pin)| Contact {
            input,
            pin,
            axis: match input {
                Input::Limit(axis) | Input::SecondLimit(axis) => axis.into(),
                _ => Z,
            },
            closes: Vec::new(),
            is_closed: false,
        });
        let eeprom = wiring.eeprom;
        Self {
            levels: [[Level::Low; 16]; 11],
            motors: first.chain(second).collect(),
            coils: wiring.phases.iter().map(|&pins| (pins, 0)).collect(),
            steps: Vec::new(),
            energised: 0,
            contacts: contacts.collect(),
            eeprom: eeprom.map(|pins| Eeprom::new(pins.is_small)),
            missing_eeprom: None,
            eeprom_pins: eeprom.map(|pins| [pins.clock, pins.data]),
            switched: switched(wiring),
            switchings: Vec::new(),
            unsafe_outputs: Vec::new(),
            is_greeted: false,
            edges: Vec::new(),
        }
    }

    /// Holds what the board itself holds: the wires of the EEPROM.
    pub(crate) fn connect(&self, chip: &mut Chip) {
        for pin in self.eeprom_pins.into_iter().flatten() {
            chip.hold(VirtualNanos(0), pin, Some(Level::High));
        }
    }

    /// Follows all edges of pins since it has last looked.
    pub(crate) fn follow(&mut self, chip: &mut Chip) {
        while !chip.exti.edges.is_empty() {
            let mut edges =
                std::mem::replace(&mut chip.exti.edges, std::mem::take(&mut self.edges));
            for edge in edges.drain(..) {
                self.take(edge, chip);
            }
            self.edges = edges;
            self.count_coil_changes(chip);
        }
    }

    fn take(&mut self, edge: Edge, chip: &mut Chip) {
        let level = &mut self.levels[usize::from(edge.pin.port)][usize::from(edge.pin.number)];
        let is_edge = *level != edge.level;
        *level = edge.level;
        if self
            .eeprom_pins
            .is_some_and(|pins| pins.contains(&edge.pin))
        {
            return self.clock_eeprom(edge, chip);
        }
        if edge.level == Level::High && is_edge {
            self.step(edge, chip);
        }
        self.switch(edge, chip);
    }

    /// The rising edge of a step pin moves its motor.
    fn step(&mut self, edge: Edge, chip: &mut Chip) {
        let Some(nth) = self.motors.iter().position(|it| it.step == edge.pin) else {
            return;
        };
        if !is_output(chip, edge.pin) {
            return;
        }
        let motor = &self.motors[nth];
        let direction = self.level(motor.direction);
        // High is the negative direction, as Grbl has it.
        let is_forward = (direction == Level::Low) != motor.is_reversed;
        let (axis, is_second) = (motor.axis, motor.is_second);
        let motor = &mut self.motors[nth];
        motor.position += if is_forward { 1 } else { -1 };
        if !is_second {
            self.steps.push(Step {
                at: edge.at,
                axis,
                is_forward,
            });
            self.move_contacts(edge.at, axis, chip);
        }
        if !self.is_greeted {
            let message = format!("{} has a step before the greeting", name_of_axis(axis));
            self.unsafe_outputs.push(message);
        }
    }

    /// Closes and opens what the motor of an axis moves.
    fn move_contacts(&mut self, at: VirtualNanos, axis: usize, chip: &mut Chip) {
        let Some(position) = self.position(axis) else {
            return;
        };
        for contact in &mut self.contacts {
            if contact.axis == axis && !contact.closes.is_empty() {
                let is_closed = contact.closes.iter().any(|closes| match *closes {
                    Closes::From(limit) => position >= limit,
                    Closes::DownFrom(limit) => position <= limit,
                });
                contact.set(is_closed, at, chip);
            }
        }
    }

    /// Mounts a contact that a motor closes.
    pub(crate) fn mount(&mut self, input: Input, closes: Closes) {
        for contact in self.contacts.iter_mut().filter(|it| it.input == input) {
            contact.closes.push(closes);
        }
    }

    /// Closes or opens a contact by hand.
    pub(crate) fn press(
        &mut self,
        input: Input,
        is_closed: bool,
        at: VirtualNanos,
        chip: &mut Chip,
    ) {
        for contact in self.contacts.iter_mut().filter(|it| it.input == input) {
            contact.set(is_closed, at, chip);
        }
    }

    /// Where the first motor of an axis is, steps, if it has steps.
    pub(crate) fn position(&self, axis: usize) -> Option<i32> {
        let mut motors = self.motors.iter();
        let motor = motors.find(|it| it.axis == axis && !it.is_second);
        motor.map(|motor| motor.position)
    }

    /// Second motors that are not where the first one is.
    fn skewed(&self) -> Vec<usize> {
        let second = self.motors.iter().filter(|it| it.is_second);
        let skewed = second.filter(|it| Some(it.position) != self.position(it.axis));
        skewed.map(|it| it.axis).collect()
    }

    /// The supply has been off: positions are counted anew, contacts are open, and nothing is mounted.
    pub(crate) fn restart(&mut self, has_eeprom: bool, at: VirtualNanos, chip: &mut Chip) {
        for motor in &mut self.motors {
            motor.position = 0;
        }
        for contact in &mut self.contacts {
            contact.closes.clear();
            contact.set(false, at, chip);
        }
        let eeprom = self.eeprom.take().or_else(|| self.missing_eeprom.take());
        if has_eeprom {
            self.eeprom = eeprom.map(Eeprom::restarted);
        } else {
            self.missing_eeprom = eeprom;
        }
    }

    /// Bytes that the EEPROM has written.
    pub(crate) fn eeprom_written(&self) -> usize {
        self.eeprom.as_ref().map_or(0, |eeprom| eeprom.written)
    }

    /// Whether the EEPROM has written what it may.
    pub(crate) fn is_cut(&self) -> bool {
        let eeprom = self.eeprom.as_ref();
        eeprom.is_some_and(|eeprom| eeprom.written >= eeprom.cut_after)
    }

    /// Which motors have not made so many steps since a time: motors that are driven by phases have none, and must have
    /// moved.
    pub(crate) fn not_moved(&self, from: usize, energised: usize, count: usize) -> Option<String> {
        if !self.coils.is_empty() {
            let is_still = self.energised == energised;
            return is_still.then(|| "no motor has moved".into());
        }
        let steps = |axis: usize| {
            let steps = self.steps[from..].iter();
            steps
                .filter(|step| step.axis == axis && step.is_forward)
                .count()
        };
        let motors = self.motors.iter().map(|motor| motor.axis);
        let wrong: Vec<_> = motors
            .filter(|axis| steps(*axis) != count)
            .map(|axis| format!("{} {}", name_of_axis(axis), steps(axis)))
            .collect();
        (!wrong.is_empty())
            .then(|| format!("steps are not {count} of each axis: {}", wrong.join(", ")))
    }

    /// Forgets what was recorded.
    pub(crate) fn forget(&mut self) {
        self.steps.clear();
        self.switchings.clear();
        self.unsafe_outputs.clear();
    }

    /// The EEPROM writes so many bytes, and no more until the supply has been off.
    pub(crate) fn cut_after(&mut self, bytes: usize) {
        if let Some(eeprom) = &mut self.eeprom {
            eeprom.cut_after = eeprom.written + bytes;
        }
    }

    /// What must not have been since this was asked before.
    pub(crate) fn take_faults(&mut self) -> Vec<String> {
        let mut faults = std::mem::take(&mut self.unsafe_outputs);
        faults.dedup();
        let eeprom = self.eeprom.iter_mut();
        faults.extend(eeprom.flat_map(|it| std::mem::take(&mut it.faults)));
        let skewed = self.skewed().into_iter().map(name_of_axis);
        faults.extend(
            skewed.map(|axis| format!("the second motor of {axis} is not where the first one is")),
        );
        faults
    }

    fn level(&self, pin: Pin) -> Level {
        self.levels[usize::from(pin.port)][usize::from(pin.number)]
    }

    fn switch(&mut self, edge: Edge, chip: &mut Chip) {
        let Some(output) = self.switched.iter().find(|it| it.pin == edge.pin) else {
            return;
        };
        if !is_output(chip, edge.pin) {
            return;
        }
        let is_active = edge.level != output.inactive;
        if is_active && !self.is_greeted {
            let message = format!(
                "{} ({}) is active before the greeting",
                output.name, edge.pin
            );
            self.unsafe_outputs.push(message);
        }
        self.switchings
            .push((edge.at, output.name.clone(), is_active));
    }

    fn clock_eeprom(&mut self, edge: Edge, chip: &mut Chip) {
        let (Some([clock, data]), Some(_)) = (self.eeprom_pins, &self.eeprom) else {
            return;
        };
        let (is_clock_high, level) = (self.level(clock) == Level::High, self.level(data));
        let Some(eeprom) = &mut self.eeprom else {
            return;
        };
        let pulls = if edge.pin == data {
            if !is_clock_high {
                return;
            }
            eeprom.condition(level, edge.at);
            false
        } else if edge.level == Level::High {
            return eeprom.rise(level);
        } else {
            eeprom.fall(edge.at)
        };
        chip.hold(edge.at, data, Some(Level::from(!pulls)));
    }

    /// Counts changes of the coils that are energised.
    fn count_coil_changes(&mut self, chip: &mut Chip) {
        for axis in 0..self.coils.len() {
            let (pins, before) = self.coils[axis];
            let mut now = 0;
            for (bit, &pin) in pins.iter().enumerate() {
                let is_high = self.level(pin) == Level::High && is_output(chip, pin);
                now |= u8::from(is_high) << bit;
            }
            self.coils[axis].1 = now;
            if now == before || now == 0 {
                continue;
            }
            self.energised += 1;
            if !self.is_greeted {
                let axis = name_of_axis(axis);
                let message = format!("a coil of {axis} is energised before the greeting");
                self.unsafe_outputs.push(message);
            }
        }
    }
}

const Z: usize = 2;

impl Contact {
    fn set(&mut self, is_closed: bool, at: VirtualNanos, chip: &mut Chip) {
        if self.is_closed != is_closed {
            self.is_closed = is_closed;
            // An open contact leaves the pin to its resistor.
            let closed = Level::from(!self.pin.is_active_low);
            chip.hold(at, self.pin.pin, is_closed.then_some(closed));
        }
    }
}

/// The letter of an axis.
pub(crate) fn name_of_axis(axis: usize) -> char {
    char::from(b"XYZABC"[axis])
}

/// Whether a pin is an output, whatever its level may be.
fn is_output(chip: &mut Chip, pin: Pin) -> bool {
    chip.mode(pin) == 1
}

/// The outputs of a board that are not motors'.
fn switched(wiring: &Wiring) -> Vec<Switched> {
    let signed = [
        ("spindle", wiring.spindle),
        ("counter-clockwise", wiring.counter_clockwise),
        ("flood", wiring.flood),
        ("mist", wiring.mist),
    ];
    let signed = signed
        .into_iter()
        .filter_map(|(name, pin)| Some((name.to_owned(), pin?)));
    let enables = wiring.enable.iter().enumerate();
    let enables = enables.map(|(nth, &pin)| (format!("enable {nth}"), pin));
    let mut switched: Vec<_> = { signed.chain(enables) }
        .map(|(name, signed)| Switched {
            name,
            pin: signed.pin,
            inactive: Level::from(signed.is_active_low),
        })
        .collect();
    // Drivers of several axes may share a pin.
    switched.sort_by_key(|output| output.pin);
    switched.dedup_by_key(|output| output.pin);
    switched
}
