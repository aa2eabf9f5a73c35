//! What takes its time at standstill: spindle and coolant after the door, drivers after a motion.

use super::Motion;
use crate::machine::Event;

/// `$1` of drivers that are never released.
pub(super) const ALWAYS_ON: u8 = 255;
/// Time for the spindle to come up to speed after the safety door was open, ms, as in Grbl.
const SPINDLE_MS: u16 = 4000;
/// Time for the coolant to flow after the safety door was open, ms, as in Grbl.
const COOLANT_MS: u16 = 1000;

/// What has to be switched on next after the safety door was open.
#[derive(Debug, Clone, Copy, PartialEq, Eq)]
pub(super) enum Restoring {
    No,
    Spindle,
    Coolant,
    Done,
    /// Something has been switched on, and the time for it is not yet over.
    Waits,
}

/// What the shell's timer tells the end of.
#[derive(Debug, Clone, Copy, PartialEq, Eq)]
pub(super) enum Wait {
    Nothing,
    /// The time for which the drivers stay on at rest.
    Drivers,
    Spindle,
    Coolant,
}

impl Motion {
    /// The time that was asked for is over.
    pub(super) fn wake(&mut self) {
        match self.wait {
            Wait::Nothing => {}
            Wait::Drivers => self.release_drivers(),
            Wait::Spindle => self.restoring = Restoring::Coolant,
            Wait::Coolant => self.restoring = Restoring::Done,
        }
        self.wait = Wait::Nothing;
    }

    fn wait(&mut self, wait: Wait, milliseconds: u16) {
        self.wait = wait;
        self.wake_in_ms = Some(milliseconds);
        self.switches = true;
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
                self.restoring = Restoring::Waits;
                self.wait(Wait::Spindle, SPINDLE_MS);
            } else {
                self.restoring = Restoring::Coolant;
            }
        }
        if self.restoring == Restoring::Coolant {
            self.accessories.restore_coolant();
            if has_coolant {
                self.restoring = Restoring::Waits;
                self.wait(Wait::Coolant, COOLANT_MS);
            } else {
                self.restoring = Restoring::Done;
            }
        }
        if self.restoring == Restoring::Done {
            self.restoring = Restoring::No;
            if !self.plunge() {
                self.on(Event::Restored);
            }
        }
    }

    /// The door has been opened again, or it is no longer of interest.
    pub(super) fn stop_restoring(&mut self) {
        self.restoring = Restoring::No;
        match self.wait {
            Wait::Spindle | Wait::Coolant => self.wait = Wait::Nothing,
            Wait::Nothing | Wait::Drivers => {}
        }
    }

    /// The drivers are switched on: axes are about to move.
    pub(super) fn need_drivers(&mut self) {
        self.switches |= !self.outputs.drivers;
        self.outputs.drivers = true;
        if self.wait == Wait::Drivers {
            self.wait = Wait::Nothing;
        }
    }

    /// At rest: the drivers stay on for a while.
    pub(super) fn rest_drivers(&mut self) {
        let moves = !self.plan.is_empty() && self.control.executes();
        let stays = self.idle_delay_ms == ALWAYS_ON && !self.releases_drivers;
        if self.wait != Wait::Nothing || !self.outputs.drivers || moves || stays {
            return;
        }
        if self.restoring == Restoring::No {
            self.wait(Wait::Drivers, u16::from(self.idle_delay_ms));
        }
    }

    pub(super) fn release_drivers(&mut self) {
        self.switches = true;
        self.outputs.drivers = false;
        self.releases_drivers = false;
        if self.wait == Wait::Drivers {
            self.wait = Wait::Nothing;
        }
    }
}
