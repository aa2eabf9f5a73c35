//! Delays at standstill: of spindle and coolant after the door, of the drivers before and after a motion, of the
//! notice that nothing moves.

use super::Motion;
use crate::{
    machine::{Ending, Event},
    model::{Notice, timing::IDLE_DELAY_INFINITE},
};

/// Time for the spindle to come up to speed after the safety door was open, ms, as in Grbl.
const SPINDLE_DELAY_MS: u16 = 4000;
/// Time for the coolant to flow after the safety door was open, ms, as in Grbl.
const COOLANT_DELAY_MS: u16 = 1000;

/// Time without motion up to [`Notice::Standstill`], ms: longer than a sender takes for the next line.
const STANDSTILL_DELAY_MS: u16 = 1000;

/// The next step of switching on again after the safety door was open.
#[derive(Debug, Clone, Copy, PartialEq, Eq)]
pub(super) enum Restoring {
    None,
    Spindle,
    Coolant,
    Done,
    /// Spindle or coolant has been switched on, and the delay for it is not yet over.
    Delay,
}

/// The delay that the platform's timer measures.
#[derive(Debug, Clone, Copy, PartialEq, Eq)]
pub(super) enum Delay {
    None,
    /// `$786`: the drivers are enabled, and nothing moves yet.
    Enable,
    /// `$1`: the drivers stay enabled at rest.
    StepIdle,
    Spindle,
    Coolant,
    /// Up to the notice that nothing moves.
    Standstill,
}

/// The delays at standstill.
#[derive(Debug)]
pub(super) struct Delays {
    pub(super) restoring: Restoring,
    /// The delay that is measured, and one to be begun, ms.
    pub(super) running: Delay,
    pub(super) requested_ms: Option<u16>,
    /// `$1`.
    pub(super) idle_ms: u8,
    /// `$786`.
    pub(super) enable_ms: u16,
    /// The drivers are disabled after an alarm whatever `$1` says.
    pub(super) disables_drivers: bool,
    /// The notice that nothing moves is wanted, and its delay has not begun.
    watches_standstill: bool,
}

impl Delays {
    pub(super) const fn new() -> Self {
        Self {
            restoring: Restoring::None,
            running: Delay::None,
            requested_ms: None,
            idle_ms: 25,
            enable_ms: 0,
            disables_drivers: false,
            watches_standstill: false,
        }
    }
}

impl Motion {
    /// Ends the delay.
    pub(super) fn end_delay(&mut self) {
        match self.delays.running {
            Delay::None | Delay::Enable => {}
            Delay::StepIdle => self.disable_drivers(),
            Delay::Spindle => self.delays.restoring = Restoring::Coolant,
            Delay::Coolant => self.delays.restoring = Restoring::Done,
            Delay::Standstill => self.published.notices.push(Notice::Standstill),
        }
        self.delays.running = Delay::None;
        self.start_standstill_delay();
    }

    /// Has a notice published if nothing moves in the next second.
    pub(super) fn watch_standstill(&mut self) {
        self.delays.watches_standstill = true;
        self.start_standstill_delay();
    }

    /// Begins the delay of a notice that is wanted, after the other delays.
    fn start_standstill_delay(&mut self) {
        let is_free =
            self.delays.running == Delay::None && self.delays.restoring == Restoring::None;
        if is_free && core::mem::take(&mut self.delays.watches_standstill) {
            self.start_delay(Delay::Standstill, STANDSTILL_DELAY_MS);
        }
    }

    fn start_delay(&mut self, delay: Delay, milliseconds: u16) {
        self.delays.running = delay;
        self.delays.requested_ms = Some(milliseconds);
        self.published.outputs_changed = true;
    }

    /// Begins to switch on again: the door is closed, and Z where spindle and coolant may run.
    pub(super) fn begin_restoring(&mut self) {
        self.delays.restoring = Restoring::Spindle;
    }

    /// Switches on what was on before the door was opened, one after the other; then goes on.
    #[cold]
    #[inline(never)]
    pub(super) fn restore(&mut self) {
        let (has_spindle, has_coolant) = self.accessories.has_to_restore();
        if self.delays.restoring == Restoring::Spindle {
            self.accessories.restore_spindle();
            // A laser comes on with the motion, and at once.
            if has_spindle && !self.accessories.is_laser() {
                self.delays.restoring = Restoring::Delay;
                self.start_delay(Delay::Spindle, SPINDLE_DELAY_MS);
            } else {
                self.delays.restoring = Restoring::Coolant;
            }
        }
        if self.delays.restoring == Restoring::Coolant {
            self.accessories.restore_coolant();
            if has_coolant {
                self.delays.restoring = Restoring::Delay;
                self.start_delay(Delay::Coolant, COOLANT_DELAY_MS);
            } else {
                self.delays.restoring = Restoring::Done;
            }
        }
        if self.delays.restoring == Restoring::Done {
            self.delays.restoring = Restoring::None;
            if !self.parking.begin_plunge() {
                self.transition(Event::Restored);
            }
        }
    }

    /// Ends switching on: the door has been opened again, or no longer matters.
    pub(super) fn stop_restoring(&mut self) {
        self.delays.restoring = Restoring::None;
        match self.delays.running {
            Delay::Spindle | Delay::Coolant => self.delays.running = Delay::None,
            Delay::None | Delay::Enable | Delay::StepIdle | Delay::Standstill => {}
        }
    }

    /// Enables the drivers before axes begin to move from rest, and gives those that were disabled the time
    /// that they need.
    pub(super) fn prepare_drivers(&mut self) {
        let were_off = !self.published.outputs.drivers;
        self.enable_drivers();
        if were_off && self.delays.enable_ms != 0 && self.delays.running == Delay::None {
            self.start_delay(Delay::Enable, self.delays.enable_ms);
        }
    }

    /// Whether the drivers are not ready yet for what is to move, and is not to end.
    pub(super) fn waits_for_drivers(&self) -> bool {
        self.delays.running == Delay::Enable && self.control.ending == Ending::None
    }

    /// Enables the drivers: axes are about to move.
    pub(super) fn enable_drivers(&mut self) {
        self.published.outputs_changed |= !self.published.outputs.drivers;
        self.published.outputs.drivers = true;
        self.delays.watches_standstill = false;
        if matches!(self.delays.running, Delay::StepIdle | Delay::Standstill) {
            self.delays.running = Delay::None;
        }
    }

    /// Begins the delay after which the drivers are disabled, at rest.
    pub(super) fn start_idle_delay(&mut self) {
        let moves = !self.plan.is_empty() && self.control.executes();
        let stays = self.delays.idle_ms == IDLE_DELAY_INFINITE && !self.delays.disables_drivers;
        if self.delays.running != Delay::None || !self.published.outputs.drivers || moves || stays {
            return;
        }
        if self.delays.restoring == Restoring::None {
            self.start_delay(Delay::StepIdle, u16::from(self.delays.idle_ms));
        }
    }

    /// Switches the drivers on, up to the end of the idle delay, or off.
    pub(super) fn switch_drivers(&mut self, are_on: bool) {
        self.disable_drivers();
        self.published.outputs.drivers = are_on;
    }

    pub(super) fn disable_drivers(&mut self) {
        self.published.outputs_changed = true;
        self.published.outputs.drivers = false;
        self.delays.disables_drivers = false;
        if matches!(self.delays.running, Delay::Enable | Delay::StepIdle) {
            self.delays.running = Delay::None;
        }
    }
}
