//! What takes its time at standstill: spindle and coolant after the door, drivers after a motion.

use super::Motion;
use crate::machine::Event;

/// `$1` of drivers that are never released.
pub(super) const ALWAYS_ENABLED: u8 = 255;
/// Time for the spindle to come up to speed after the safety door was open, ms, as in Grbl.
const SPINDLE_DELAY_MS: u16 = 4000;
/// Time for the coolant to flow after the safety door was open, ms, as in Grbl.
const COOLANT_DELAY_MS: u16 = 1000;

/// What has to be switched on next after the safety door was open.
#[derive(Debug, Clone, Copy, PartialEq, Eq)]
pub(super) enum Restoring {
    None,
    Spindle,
    Coolant,
    Done,
    /// Something has been switched on, and the time for it is not yet over.
    Delay,
}

/// What the shell's timer tells the end of.
#[derive(Debug, Clone, Copy, PartialEq, Eq)]
pub(super) enum Delay {
    None,
    /// The time for which the drivers stay on at rest.
    StepIdle,
    Spindle,
    Coolant,
}

impl Motion {
    /// The time that was asked for is over.
    pub(super) fn end_delay(&mut self) {
        match self.delay {
            Delay::None => {}
            Delay::StepIdle => self.disable_drivers(),
            Delay::Spindle => self.restoring = Restoring::Coolant,
            Delay::Coolant => self.restoring = Restoring::Done,
        }
        self.delay = Delay::None;
    }

    fn start_delay(&mut self, wait: Delay, milliseconds: u16) {
        self.delay = wait;
        self.delay_ms = Some(milliseconds);
        self.outputs_changed = true;
    }

    /// The door is closed, and Z where spindle and coolant may run.
    pub(super) fn begin_restoring(&mut self) {
        self.restoring = Restoring::Spindle;
    }

    /// Switches on what was on before the door was opened, one after the other; then goes on.
    #[cold]
    #[inline(never)]
    pub(super) fn restore(&mut self) {
        let (has_spindle, has_coolant) = self.accessories.has_to_restore();
        if self.restoring == Restoring::Spindle {
            self.accessories.restore_spindle();
            // A laser comes on with the motion, and at once.
            if has_spindle && !self.accessories.is_laser() {
                self.restoring = Restoring::Delay;
                self.start_delay(Delay::Spindle, SPINDLE_DELAY_MS);
            } else {
                self.restoring = Restoring::Coolant;
            }
        }
        if self.restoring == Restoring::Coolant {
            self.accessories.restore_coolant();
            if has_coolant {
                self.restoring = Restoring::Delay;
                self.start_delay(Delay::Coolant, COOLANT_DELAY_MS);
            } else {
                self.restoring = Restoring::Done;
            }
        }
        if self.restoring == Restoring::Done {
            self.restoring = Restoring::None;
            if !self.plunge() {
                self.transition(Event::Restored);
            }
        }
    }

    /// The door has been opened again, or it is no longer of interest.
    pub(super) fn stop_restoring(&mut self) {
        self.restoring = Restoring::None;
        match self.delay {
            Delay::Spindle | Delay::Coolant => self.delay = Delay::None,
            Delay::None | Delay::StepIdle => {}
        }
    }

    /// The drivers are switched on: axes are about to move.
    pub(super) fn enable_drivers(&mut self) {
        self.outputs_changed |= !self.outputs.drivers;
        self.outputs.drivers = true;
        if self.delay == Delay::StepIdle {
            self.delay = Delay::None;
        }
    }

    /// At rest: the drivers stay on for a while.
    pub(super) fn start_idle_delay(&mut self) {
        let moves = !self.plan.is_empty() && self.control.executes();
        let stays = self.idle_delay_ms == ALWAYS_ENABLED && !self.disables_drivers;
        if self.delay != Delay::None || !self.outputs.drivers || moves || stays {
            return;
        }
        if self.restoring == Restoring::None {
            self.start_delay(Delay::StepIdle, u16::from(self.idle_delay_ms));
        }
    }

    pub(super) fn disable_drivers(&mut self) {
        self.outputs_changed = true;
        self.outputs.drivers = false;
        self.disables_drivers = false;
        if self.delay == Delay::StepIdle {
            self.delay = Delay::None;
        }
    }
}
