//! The inputs of the machine: levels that every task may read, and the orders of `prepare`.
//!
//! `inputs` alone writes the levels, after its filter. `prepare` sets which inputs are inverted, which
//! limit switches stop the machine, and which change of the probe is awaited; `inputs` latches the
//! number of events output at that change.
//!
//! Limit switches are counted: those of the axes, and behind them those of second motors. Which motors stand is
//! an order of `prepare`, too, for the task that makes the table of outputs.

use crate::{
    atomic::{
        AtomicU32,
        Ordering::{Relaxed, SeqCst},
        compiler_fence,
    },
    axis::AXES,
    model::{HAS_SECOND_MOTORS, LIMIT_SWITCHES, Levels, StandingMotors},
    settings::Settings,
};

/// An awaited change of the probe.
#[derive(Debug, Clone, Copy, PartialEq, Eq)]
#[repr(u32)]
pub enum Contact {
    /// The probe becomes active.
    Made = 1,
    /// The probe becomes inactive.
    Broken = 2,
}

/// No change is awaited.
const UNARMED: u32 = 0;
/// Bits beside the contact: it has come, and the filter does not agree yet; or agrees.
const LATCHED: u32 = 4;
const CONFIRMED: u32 = 8;

/// The inputs. A set bit of [`Levels`] is a closed contact: the pin is low.
#[derive(Debug)]
pub struct Inputs {
    /// Inputs that have a pin. The others are never active.
    wired: Levels,
    /// Contacts that are closed; written by `inputs`.
    closed: AtomicU32,
    /// Inputs that are active while open; written by `prepare`.
    inverted: AtomicU32,
    /// Limit switches that stop the machine; written by `prepare`.
    armed: AtomicU32,
    /// A [`Contact`] or [`UNARMED`], written by `prepare`; and [`LATCHED`] or [`CONFIRMED`], which `inputs`
    /// adds to a contact.
    probing: AtomicU32,
    /// Number of events output when the probe changed; written by `inputs`.
    probe_latch: AtomicU32,
    /// Number of events output when each limit switch last became active; written by `inputs`.
    limit_latches: [AtomicU32; LIMIT_SWITCHES],
    /// Motors that are to stand, written by `prepare`; and standing motors, written by the task that makes the table of
    /// outputs.
    standing: [AtomicU32; if HAS_SECOND_MOTORS { 2 } else { 0 }],
}

impl Inputs {
    /// Returns inputs with all contacts open and none inverted; no axis has a second motor.
    #[must_use]
    pub const fn new() -> Self {
        Self::wired(Levels(!Levels::SECOND_LIMITS.0))
    }

    /// Returns the inputs of a board with pins for the `wired` ones only. The others are never
    /// active: an inverted one would always be.
    #[must_use]
    pub const fn wired(wired: Levels) -> Self {
        Self {
            wired,
            closed: AtomicU32::new(0),
            inverted: AtomicU32::new(0),
            armed: AtomicU32::new(0),
            probing: AtomicU32::new(UNARMED),
            probe_latch: AtomicU32::new(0),
            limit_latches: [const { AtomicU32::new(0) }; LIMIT_SWITCHES],
            standing: [const { AtomicU32::new(0) }; if HAS_SECOND_MOTORS { 2 } else { 0 }],
        }
    }

    /// Returns the closed contacts.
    #[must_use]
    pub fn closed(&self) -> Levels {
        Levels(self.closed.load(Relaxed) as u16)
    }

    /// Stores the closed contacts; for `inputs` alone.
    pub fn set_closed(&self, closed: Levels) {
        self.closed.store(u32::from(closed.0), Relaxed);
    }

    /// Returns the active inputs, under the settings of the last [`Inputs::configure`]. An axis with two switches
    /// is at its limit where one of them is active.
    #[must_use]
    pub fn active(&self) -> Levels {
        (self.closed() ^ self.inverted()).with_second_as_first()
    }

    /// Returns whether a limit switch is active, by its number.
    #[must_use]
    pub fn is_switch_active(&self, switch: usize) -> bool {
        (self.closed() ^ self.inverted()).has(switch_level(switch))
    }

    /// Returns the axes with two motors that have a switch each, bit 0 = X.
    #[must_use]
    pub const fn ganged_axes(&self) -> u8 {
        if HAS_SECOND_MOTORS {
            self.wired.second_axes()
        } else {
            0
        }
    }

    /// Orders which motors stand; returns whether they do. At rest, for `prepare` alone, which makes no step
    /// before.
    pub fn order_standing(&self, motors: StandingMotors) -> bool {
        let [ordered, standing] = self.standing.as_slice() else {
            return true;
        };
        ordered.store(motors.bits(), Relaxed);
        standing.load(Relaxed) == motors.bits()
    }

    /// Returns an order that has not been carried out: for the task that makes the table of outputs.
    #[must_use]
    #[inline]
    pub fn standing_order(&self) -> Option<StandingMotors> {
        let [ordered, standing] = self.standing.as_slice() else {
            return None;
        };
        let bits = ordered.load(Relaxed);
        (bits != standing.load(Relaxed)).then_some(StandingMotors::from_bits(bits))
    }

    /// Notes that an order has been carried out.
    pub fn carry_out(&self, motors: StandingMotors) {
        // The table is written before.
        compiler_fence(SeqCst);
        if let [_, standing] = self.standing.as_slice() {
            standing.store(motors.bits(), Relaxed);
        }
    }

    /// Returns the motors that stand.
    #[must_use]
    pub fn standing(&self) -> StandingMotors {
        let bits = self.standing.get(1).map_or(0, |bits| bits.load(Relaxed));
        StandingMotors::from_bits(bits)
    }

    pub(super) fn inverted(&self) -> Levels {
        Levels(self.inverted.load(Relaxed) as u16)
    }

    /// Applies `$5` and `$6`; for `prepare` alone.
    pub fn configure(&self, settings: &Settings) {
        let inverted = inverted(settings) & self.wired;
        self.inverted.store(u32::from(inverted.0), Relaxed);
    }

    /// Sets the limit switches that stop the machine when they become active: none while homing or at
    /// rest in alarm. For `prepare` alone.
    pub fn arm_limits(&self, limits: Levels) {
        self.armed.store(u32::from(limits.with_second().0), Relaxed);
    }

    pub(super) fn armed_limits(&self) -> Levels {
        Levels(self.armed.load(Relaxed) as u16)
    }

    /// Awaits a change of the probe from now on; for `prepare` alone.
    pub fn arm_probe(&self, contact: Contact) {
        compiler_fence(SeqCst);
        self.probing.store(contact as u32, Relaxed);
    }

    /// Ends the wait for a change of the probe; for `prepare` alone.
    pub fn disarm_probe(&self) {
        self.probing.store(UNARMED, Relaxed);
    }

    /// Returns the number of events output at the awaited change of the probe, if it has come. It may turn out
    /// to be a spike, which is forgotten.
    #[must_use]
    pub fn probe_latch(&self) -> Option<u32> {
        let is_latched = self.probing.load(Relaxed) & (LATCHED | CONFIRMED) != 0;
        compiler_fence(SeqCst);
        is_latched.then(|| self.probe_latch.load(Relaxed))
    }

    /// Returns whether the awaited change of the probe has lasted as long as the filter wants.
    #[must_use]
    pub fn is_probe_confirmed(&self) -> bool {
        self.probing.load(Relaxed) & CONFIRMED != 0
    }

    /// Returns whether the awaited change of the probe comes with these levels.
    pub(super) fn is_contact(&self, raw: Levels) -> bool {
        let is_active = (raw ^ self.inverted()).has(Levels::PROBE);
        let awaited = self.probing.load(Relaxed);
        awaited == Contact::Made as u32 && is_active
            || awaited == Contact::Broken as u32 && !is_active
    }

    /// Latches the change of the probe after a number of events; for `inputs` alone.
    pub(super) fn latch_probe(&self, events: u32) {
        self.probe_latch.store(events, Relaxed);
        compiler_fence(SeqCst);
        let contact = self.probing.load(Relaxed);
        self.probing.store(contact | LATCHED, Relaxed);
    }

    /// Returns whether a change of the probe has been latched that the filter has not confirmed.
    #[inline]
    pub(super) fn is_probe_unconfirmed(&self) -> bool {
        self.probing.load(Relaxed) & LATCHED != 0
    }

    /// Confirms the change of the probe that has been latched; for `inputs` alone.
    #[inline]
    pub(super) fn confirm_probe(&self) {
        let latched = self.probing.load(Relaxed);
        self.probing.store(latched ^ (LATCHED | CONFIRMED), Relaxed);
    }

    /// Forgets the change of the probe that has been latched, and awaits another; for `inputs` alone.
    #[inline]
    pub(super) fn forget_probe(&self) {
        let latched = self.probing.load(Relaxed);
        self.probing.store(latched ^ LATCHED, Relaxed);
    }

    /// Returns the number of events output when a limit switch last became active, by its number.
    #[must_use]
    pub fn limit_latch(&self, switch: usize) -> u32 {
        self.limit_latches
            .get(switch)
            .map_or(0, |events| events.load(Relaxed))
    }

    /// Returns the number of the switch of an axis that is active: of two, the first.
    #[must_use]
    pub fn active_switch(&self, axis: usize) -> usize {
        let second = AXES + axis;
        if HAS_SECOND_MOTORS && !self.is_switch_active(axis) && self.is_switch_active(second) {
            second
        } else {
            axis
        }
    }

    /// Latches limit switches that become active after a number of events; for `inputs` alone.
    pub(super) fn latch_limits(&self, limits: Levels, events: u32) {
        for (axis, reached) in self.limit_latches.iter().take(AXES).enumerate() {
            if limits.has(Levels::limits(1 << axis)) {
                reached.store(events, Relaxed);
            }
        }
        if HAS_SECOND_MOTORS && limits.has(Levels::SECOND_LIMITS) {
            for (axis, reached) in self.limit_latches.iter().skip(AXES).enumerate() {
                if limits.has(Levels::second_limits(1 << axis)) {
                    reached.store(events, Relaxed);
                }
            }
        }
    }
}

impl Default for Inputs {
    fn default() -> Self {
        Self::new()
    }
}

/// Returns the input of a limit switch, by its number.
fn switch_level(switch: usize) -> Levels {
    match switch.checked_sub(AXES) {
        Some(axis) => Levels::second_limits(1 << axis),
        None => Levels::limits(1 << switch),
    }
}

/// Returns the inputs that are active while their contact is open, under `$5` and `$6`.
fn inverted(settings: &Settings) -> Levels {
    let mut inverted = Levels::NONE;
    if settings.limit_invert {
        // Only axes that exist have a switch.
        inverted = Levels((1 << AXES) - 1).with_second();
    }
    if settings.probe_invert {
        inverted = inverted | Levels::PROBE;
    }
    inverted
}

#[cfg(test)]
mod tests {
    use super::*;

    #[test]
    fn inverted_limits_and_probe_are_active_while_open() {
        let inputs = Inputs::new();
        let mut settings = Settings::default();
        let closed = Levels(0b1) | Levels::DOOR;
        inputs.set_closed(closed);
        assert_eq!(inputs.active(), closed);
        settings.limit_invert = true;
        inputs.configure(&settings);
        let others = Levels::limits((1 << AXES) - 2);
        assert_eq!(inputs.active(), others | Levels::DOOR);
        settings.probe_invert = true;
        inputs.configure(&settings);
        assert!(inputs.active().has(Levels::PROBE));
        inputs.set_closed(closed | Levels::PROBE);
        assert!(!inputs.active().has(Levels::PROBE));
    }
}
