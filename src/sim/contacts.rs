//! The contacts at the inputs: switches that axes close, and contacts held by the operator.

use heapless::Vec;

use super::Edge;
use crate::{
    axis::{AXES, Axes},
    model::{GANGED_AXES, Levels, StandingMotors, core_xy},
};

/// Largest number of switches: two for each of six axes, and four more.
const SWITCHES: usize = 16;

/// The positions at which a switch is closed, in physical steps from the position at power-up.
#[derive(Debug, Clone, Copy, PartialEq, Eq)]
pub enum Closes {
    /// This position and all positions above.
    From(i32),
    /// This position and all positions below.
    DownFrom(i32),
}

/// A switch that an axis closes.
#[derive(Debug, Clone, Copy, PartialEq, Eq)]
pub struct Switch {
    /// The axis, 0 = X; not the motor, on a `CoreXY` machine.
    pub axis: usize,
    /// The positions at which it is closed.
    pub closes: Closes,
    /// The inputs that it closes.
    pub input: Levels,
}

impl Switch {
    /// Returns whether the switch is closed while the axis is at `steps`.
    #[must_use]
    pub const fn is_closed_at(&self, steps: i32) -> bool {
        match self.closes {
            Closes::From(first) => steps >= first,
            Closes::DownFrom(first) => steps <= first,
        }
    }
}

/// A block on the table: the positions of X, Y and Z at which the tool touches it, in physical steps from the position at
/// power-up.
#[derive(Debug, Clone, Copy, PartialEq, Eq)]
pub struct ProbeBlock {
    /// The least position of each axis.
    pub low: [i32; 3],
    /// The greatest.
    pub high: [i32; 3],
    /// The inputs that a touch closes.
    pub input: Levels,
}

impl ProbeBlock {
    /// Returns whether the tool touches it with the axes at `steps`.
    fn is_touched_at(&self, steps: &Axes<i32>) -> bool {
        let ends = self.low.iter().zip(&self.high);
        { steps.iter().zip(ends) }.all(|(steps, (low, high))| (low..=high).contains(&steps))
    }
}

/// The positions of the axes, and the contacts.
#[derive(Debug)]
pub(super) struct Contacts {
    switches: Vec<Switch, SWITCHES>,
    /// Those that second motors close.
    second_switches: Vec<Switch, GANGED_AXES>,
    block: Option<ProbeBlock>,
    /// Contacts that the operator closes.
    held: Levels,
    /// Position of each axis, steps from power-up: homing does not change it.
    steps: Axes<i32>,
    /// The same of second motors.
    second_steps: Axes<i32>,
    /// Motors that are left out of the steps of their axis.
    standing: StandingMotors,
    /// The motors of X and Y are those of `CoreXY`.
    pub(super) is_core_xy: bool,
    /// Closed contacts.
    pub(super) closed: Levels,
}

impl Contacts {
    pub(super) const fn new() -> Self {
        Self {
            switches: Vec::new(),
            second_switches: Vec::new(),
            block: None,
            held: Levels::NONE,
            steps: Axes([0; AXES]),
            second_steps: Axes([0; AXES]),
            standing: StandingMotors::NONE,
            is_core_xy: false,
            closed: Levels::NONE,
        }
    }

    pub(super) const fn steps(&self) -> Axes<i32> {
        self.steps
    }

    /// Returns where the axes are.
    pub(super) fn position(&self) -> Axes<i32> {
        if self.is_core_xy {
            core_xy::steps_of(self.steps)
        } else {
            self.steps
        }
    }

    /// Mounts a switch. Returns false without such an axis, or without room.
    pub(super) fn mount(&mut self, switch: Switch) -> bool {
        switch.axis < AXES && self.switches.push(switch).is_ok()
    }

    /// Puts a block on the table, in place of any other.
    pub(super) const fn put(&mut self, block: ProbeBlock) {
        self.block = Some(block);
    }

    /// Takes away the switches of all axes, and the block.
    pub(super) fn dismount(&mut self) {
        self.switches.clear();
        self.block = None;
    }

    /// Mounts a switch that the second motor of an axis closes. Returns false without room.
    pub(super) fn mount_second(&mut self, switch: Switch) -> bool {
        switch.axis < AXES && self.second_switches.push(switch).is_ok()
    }

    /// Puts a second motor some steps ahead of the first.
    pub(super) fn skew(&mut self, axis: usize, steps: i32) {
        self.second_steps[axis] = self.second_steps[axis].wrapping_add(steps);
    }

    pub(super) const fn second_steps(&self) -> Axes<i32> {
        self.second_steps
    }

    /// Leaves motors out of the steps of their axis.
    pub(super) const fn leave_out(&mut self, standing: StandingMotors) {
        self.standing = standing;
    }

    pub(super) fn hold(&mut self, inputs: Levels, closed: bool) {
        self.held = if closed {
            self.held | inputs
        } else {
            self.held & !inputs
        };
    }

    /// Moves the axes by the pulses of an edge.
    pub(super) fn step(&mut self, edge: &Edge) {
        let motors = [
            (&mut self.steps, self.standing.first),
            (&mut self.second_steps, self.standing.second),
        ];
        for (steps, standing) in motors {
            for (axis, steps) in steps.iter_mut().enumerate() {
                if edge.raise & !u32::from(standing) & 1 << axis != 0 {
                    let is_negative = edge.directions >> axis & 1 != 0;
                    *steps = steps.wrapping_add(if is_negative { -1 } else { 1 });
                }
            }
        }
    }

    /// Updates every contact. Returns whether any has changed.
    pub(super) fn update(&mut self) -> bool {
        let mut closed = self.held;
        let steps = self.position();
        let first = self.switches.iter().map(|switch| (switch, &steps));
        let second = self.second_switches.iter();
        for (switch, steps) in first.chain(second.map(|switch| (switch, &self.second_steps))) {
            if switch.is_closed_at(steps[switch.axis]) {
                closed = closed | switch.input;
            }
        }
        let touched = self.block.filter(|block| block.is_touched_at(&steps));
        if let Some(block) = touched {
            closed = closed | block.input;
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
            is_rapid: false,
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

    #[test]
    fn a_block_is_touched_where_all_axes_are_within_it() {
        let mut contacts = Contacts::new();
        contacts.put(ProbeBlock {
            low: [-1, 2, -5],
            high: [1, 3, -4],
            input: Levels::PROBE,
        });
        for (place, closed) in [
            ([0, 2, -4], Levels::PROBE),
            ([1, 3, -5], Levels::PROBE),
            ([2, 2, -4], Levels::NONE),
            ([0, 1, -4], Levels::NONE),
            ([0, 2, -3], Levels::NONE),
        ] {
            contacts.steps.0[..3].copy_from_slice(&place);
            contacts.update();
            assert_eq!(contacts.closed, closed, "{place:?}");
        }
    }
}
