//! What is wired to the inputs: switches at positions, and pins held by whoever uses the machine.

use heapless::Vec;

use super::Edge;
use crate::{
    axis::{AXES, Axes},
    model::Levels,
};

/// Switches that can be mounted.
const SWITCHES: usize = 16;

/// Where a switch closes, in physical steps from where the axis stood at power-up.
#[derive(Debug, Clone, Copy, PartialEq, Eq)]
pub enum Closes {
    /// There and farther in the positive direction.
    From(i32),
    /// There and farther in the negative direction.
    DownFrom(i32),
}

/// A switch that an axis closes.
#[derive(Debug, Clone, Copy, PartialEq, Eq)]
pub struct Switch {
    /// The axis, 0 = X.
    pub axis: usize,
    /// Where it closes.
    pub closes: Closes,
    /// The inputs whose contact it is.
    pub input: Levels,
}

impl Switch {
    /// Returns whether it is closed while the axis is at `steps`.
    #[must_use]
    pub const fn is_closed_at(&self, steps: i32) -> bool {
        match self.closes {
            Closes::From(first) => steps >= first,
            Closes::DownFrom(first) => steps <= first,
        }
    }
}

/// The axes as they stand, and the contacts.
#[derive(Debug)]
pub(super) struct Contacts {
    switches: Vec<Switch, SWITCHES>,
    /// Contacts closed by the user.
    held: Levels,
    /// Steps of each axis from where it stood at power-up: no homing changes them.
    steps: Axes<i32>,
    /// Contacts that are closed.
    pub(super) closed: Levels,
}

impl Contacts {
    pub(super) const fn new() -> Self {
        Self {
            switches: Vec::new(),
            held: Levels::NONE,
            steps: Axes([0; AXES]),
            closed: Levels::NONE,
        }
    }

    pub(super) const fn steps(&self) -> Axes<i32> {
        self.steps
    }

    /// Mounts a switch. Returns whether there are such an axis and room.
    pub(super) fn mount(&mut self, switch: Switch) -> bool {
        switch.axis < AXES && self.switches.push(switch).is_ok()
    }

    pub(super) fn hold(&mut self, inputs: Levels, closed: bool) {
        self.held = if closed {
            self.held | inputs
        } else {
            self.held & !inputs
        };
    }

    /// The axes step.
    pub(super) fn step(&mut self, edge: &Edge) {
        for (axis, steps) in self.steps.iter_mut().enumerate() {
            if edge.raise >> axis & 1 != 0 {
                let is_negative = edge.directions >> axis & 1 != 0;
                *steps = steps.wrapping_add(if is_negative { -1 } else { 1 });
            }
        }
    }

    /// Updates every contact. Returns whether any has changed.
    pub(super) fn update(&mut self) -> bool {
        let mut closed = self.held;
        for switch in &self.switches {
            if switch.is_closed_at(self.steps[switch.axis]) {
                closed = closed | switch.input;
            }
        }
        let has_changed = closed != self.closed;
        self.closed = closed;
        has_changed
    }
}

#[cfg(test)]
mod tests {
    use super::*;

    #[test]
    fn a_contact_is_closed_by_its_switch_or_by_hand() {
        let mut contacts = Contacts::new();
        let forward = Edge {
            ticks: 0,
            raise: 1,
            drop: 0,
            directions: 0,
            duty: 0,
        };
        let back = Edge {
            directions: 1,
            ..forward
        };
        assert!(contacts.mount(Switch {
            axis: 0,
            closes: Closes::From(2),
            input: Levels::PROBE,
        }));
        assert!(contacts.mount(Switch {
            axis: 0,
            closes: Closes::DownFrom(-1),
            input: Levels::limits(1),
        }));
        for (edge, closed) in [
            (forward, Levels::NONE),
            (forward, Levels::PROBE),
            (forward, Levels::PROBE),
            (back, Levels::PROBE),
            (back, Levels::NONE),
            (back, Levels::NONE),
            (back, Levels::limits(1)),
        ] {
            contacts.step(&edge);
            contacts.update();
            assert_eq!(contacts.closed, closed);
        }
        contacts.hold(Levels::DOOR, true);
        assert!(contacts.update());
        assert_eq!(contacts.closed, Levels::DOOR | Levels::limits(1));
        contacts.hold(Levels::DOOR | Levels::limits(1), false);
        assert!(contacts.update());
        assert!(!contacts.update());
        assert_eq!(contacts.closed, Levels::limits(1));
    }
}
