//! Delays at standstill: of a spindle that has been switched on, of the coolant after the door, of the drivers before
//! and after a motion, of the notice that nothing moves.

use super::Motion;
use crate::{
    machine::{Ending, Event},
    model::{Notice, Spindle, timing::IDLE_DELAY_INFINITE},
    settings::Settings,
};

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
    /// `$392`, `$394`: the spindle has been switched on, and nothing moves yet.
    Spindle,
    /// `$393`: the same of the coolant after the door.
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
    /// `$394`.
    spindle_ms: u16,
    /// The longer of `$392` and `$394`.
    resumed_spindle_ms: u16,
    /// `$393`.
    coolant_ms: u16,
    /// The direction of the spindle when it was looked at last.
    rotation: Spindle,
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
            spindle_ms: 0,
            resumed_spindle_ms: 0,
            coolant_ms: 0,
            rotation: Spindle::Off,
            disables_drivers: false,
            watches_standstill: false,
        }
    }

    /// Applies the settings.
    pub(super) fn configure(&mut self, settings: &Settings) {
        self.idle_ms = settings.idle_delay_ms;
        self.enable_ms = settings.enable_delay_ms as u16;
        self.spindle_ms = milliseconds(settings.spindle_delay_s);
        self.resumed_spindle_ms = milliseconds(settings.door_spindle_delay_s).max(self.spindle_ms);
        self.coolant_ms = milliseconds(settings.door_coolant_delay_s);
    }
}

/// Returns a setting in milliseconds.
fn milliseconds(seconds: f32) -> u16 {
    (seconds * 1000.0 + 0.5) as u16
}

impl Motion {
    /// Ends the delay.
    pub(super) fn end_delay(&mut self) {
        match self.delays.running {
            Delay::StepIdle => self.disable_drivers(),
            Delay::Spindle if self.delays.restoring == Restoring::Delay => {
                self.delays.restoring = Restoring::Coolant;
            }
            Delay::None | Delay::Enable | Delay::Spindle => {}
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

    /// Begins the time of a spindle that has been switched on or turns the other way, and ends the time of a spindle
    /// which has been switched off. Called in each standstill, and before each motion from it: either call follows at
    /// once, whatever switches the spindle.
    #[inline(never)]
    pub(super) fn watch_spindle(&mut self) {
        let rotation = self.accessories.rotation();
        let is_same = rotation == self.delays.rotation;
        self.delays.rotation = rotation;
        // Behind the door, `restore` measures the time.
        if is_same || self.delays.restoring != Restoring::None {
            return;
        }
        let is_resumed = self.accessories.is_resumed();
        let milliseconds = if is_resumed {
            self.delays.resumed_spindle_ms
        } else {
            self.delays.spindle_ms
        };
        if rotation != Spindle::Off && milliseconds != 0 {
            let was_enabling = self.delays.running == Delay::Enable;
            let enable_ms = if was_enabling {
                self.delays.enable_ms
            } else {
                0
            };
            self.start_delay(Delay::Spindle, milliseconds.max(enable_ms));
            if !is_resumed {
                self.published.notices.push(Notice::SpindleDelay);
            }
        } else if self.delays.running == Delay::Spindle {
            self.delays.running = Delay::None;
        }
    }

    /// Gives a spindle that has just been switched on no time.
    pub(super) fn skip_spindle_delay(&mut self) {
        self.delays.rotation = self.accessories.rotation();
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
            let delay_ms = self.delays.resumed_spindle_ms;
            // A laser comes on with the motion, and at once.
            if has_spindle && !self.accessories.is_laser() && delay_ms != 0 {
                self.delays.restoring = Restoring::Delay;
                self.start_delay(Delay::Spindle, delay_ms);
            } else {
                self.delays.restoring = Restoring::Coolant;
            }
        }
        if self.delays.restoring == Restoring::Coolant {
            self.accessories.restore_coolant();
            if has_coolant && self.delays.coolant_ms != 0 {
                self.delays.restoring = Restoring::Delay;
                self.start_delay(Delay::Coolant, self.delays.coolant_ms);
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
        let was_waiting = self.delays.restoring == Restoring::Delay;
        self.delays.restoring = Restoring::None;
        if was_waiting {
            self.delays.running = Delay::None;
        }
    }

    /// Enables the drivers before axes begin to move from rest, and gives drivers that were disabled the time that they
    /// need.
    pub(super) fn prepare_drivers(&mut self) {
        if self.delays.running == Delay::Spindle && self.delays.enable_ms != 0 {
            // The first segment, which the spindle precedes, asks again.
            return;
        }
        let were_off = !self.published.outputs.drivers;
        self.enable_drivers();
        if were_off && self.delays.enable_ms != 0 && self.delays.running == Delay::None {
            self.start_delay(Delay::Enable, self.delays.enable_ms);
        }
    }

    /// Gives spindle and drivers the time that they need before a motion from rest. Returns whether it can begin.
    pub(super) fn is_ready_for_motion(&mut self) -> bool {
        self.watch_spindle();
        if self.delays.enable_ms != 0 {
            self.prepare_drivers();
        }
        !self.waits_before_motion()
    }

    /// Whether the drivers, or the spindle, are not ready yet for what is to move, and is not to end. Z is parked
    /// whatever the spindle does.
    pub(super) fn waits_before_motion(&self) -> bool {
        let waits = match self.delays.running {
            Delay::Enable => true,
            Delay::Spindle => !self.parking.is_moving(),
            Delay::None | Delay::StepIdle | Delay::Coolant | Delay::Standstill => false,
        };
        waits && self.control.ending == Ending::None
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
        let moves = self.has_path() && self.control.executes();
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
