//! Parking: lifts Z out of the work while the safety door is open, and brings it back.
//!
//! ```text
//!        $58 -------------- parked
//!             fast, $59 |  ^
//!   waypoint - - - - - -v- |-   $56 above the work: spindle and coolant go off and on here
//!             slow, $57 |  ^
//!       work -----------v--'
//! ```
//!
//! The plan is untouched meanwhile: Z comes back to exactly where it was. Read with Grbl 1.1
//! `PARKING_ENABLE`.

use super::cycle_move::{CycleLimits, CycleMove};
use crate::{
    axis::{AXES, Axes, Z},
    machine::Ending,
    model::timing::SEGMENT_TICKS,
    motion::executor::Goal,
    settings::Settings,
    stepper::Segment,
    units::FineSteps,
};

/// Where Z is.
#[derive(Debug, Clone, Copy, PartialEq, Eq)]
enum ParkingStage {
    AtWork,
    PullOut,
    ToTarget,
    Parked,
    ToWaypoint,
    AtWaypoint,
    Plunge,
    /// The motor goes to where it was in its backlash, and Z stays.
    TakeUp,
    /// Coming to rest, to be parked again: the door was opened while Z came back.
    Stop,
}

/// What Z has reached at the end of a motion.
#[derive(Debug, Clone, Copy, PartialEq, Eq)]
pub(crate) enum Reached {
    /// The waypoint, on the way out: the tool is out of the work.
    PulledOut,
    Target,
    /// The waypoint, on the way back.
    Waypoint,
    Work,
}

/// The backlash of Z, and where in it the motor is.
#[derive(Debug, Clone, Copy)]
pub(crate) struct ZBacklash {
    /// All of it, steps.
    pub(crate) steps: i32,
    /// How far the motor is ahead in the positive direction, steps.
    pub(crate) lead: i32,
}

/// Parking: Z, its motion and its parameters.
#[derive(Debug)]
pub(crate) struct Parking {
    limits: CycleLimits,
    cycle_move: CycleMove,
    /// The target and the speed, mm/s, of a move that begins.
    requested: Option<(FineSteps, f32)>,
    stage: ParkingStage,
    is_enabled: bool,
    target: FineSteps,
    /// Distance of the pull-out, steps with 32 binary places.
    pull_out: i64,
    slow_mm_s: f32,
    fast_mm_s: f32,
    work: FineSteps,
    /// How far the motor was ahead there, steps, once it has begun to move away.
    lead_at_work: Option<i32>,
    waypoint: FineSteps,
}

impl Parking {
    pub(crate) const fn new() -> Self {
        Self {
            limits: CycleLimits::NONE,
            cycle_move: CycleMove::new(),
            requested: None,
            stage: ParkingStage::AtWork,
            is_enabled: false,
            target: FineSteps(0),
            pull_out: 0,
            slow_mm_s: 0.0,
            fast_mm_s: 0.0,
            work: FineSteps(0),
            lead_at_work: None,
            waypoint: FineSteps(0),
        }
    }

    /// Takes over the settings. A machine that is not homed has no target to park at; a laser
    /// must not burn meanwhile.
    pub(crate) fn configure(&mut self, settings: &Settings) {
        let steps_per_mm = settings.steps_per_mm[Z].to_f32();
        self.is_enabled = settings.parking && settings.is_homing_on() && !settings.laser;
        self.target = FineSteps(whole(settings.parking_target_mm * steps_per_mm));
        self.pull_out = whole(settings.parking_pull_out_mm * steps_per_mm);
        self.slow_mm_s = settings.parking_pull_out_mm_min / 60.0;
        self.fast_mm_s = settings.parking_mm_min / 60.0;
        self.limits.configure(settings);
    }

    /// Whether Z is away from the work.
    pub(crate) fn is_away(&self) -> bool {
        self.stage != ParkingStage::AtWork
    }

    /// Whether Z is in motion.
    pub(crate) fn is_moving(&self) -> bool {
        match self.stage {
            ParkingStage::AtWork | ParkingStage::Parked | ParkingStage::AtWaypoint => false,
            ParkingStage::PullOut
            | ParkingStage::ToTarget
            | ParkingStage::ToWaypoint
            | ParkingStage::Plunge
            | ParkingStage::TakeUp
            | ParkingStage::Stop => true,
        }
    }

    /// Whether there is a next segment.
    pub(crate) fn has_segment(&self, ending: Ending) -> bool {
        if self.stops(ending) {
            self.cycle_move.is_moving()
        } else {
            self.cycle_move.is_active() || self.requested.is_some()
        }
    }

    /// Whether Z is to come to rest before the end of its motion.
    fn stops(&self, ending: Ending) -> bool {
        ending != Ending::None || self.stage == ParkingStage::Stop
    }

    /// Returns the move of the motor of Z.
    pub(in crate::motion) const fn of_motor(&mut self) -> &mut CycleMove {
        &mut self.cycle_move
    }

    /// Whether the next segment begins a move.
    pub(crate) fn begins_move(&self, ending: Ending) -> bool {
        !self.stops(ending) && self.requested.is_some()
    }

    /// Returns how far the motor of Z moves without it before Z moves, steps.
    fn take_up(&mut self, backlash: ZBacklash) -> i32 {
        let at_work = *self.lead_at_work.get_or_insert(backlash.lead);
        let ahead = match self.stage {
            ParkingStage::ToWaypoint | ParkingStage::Plunge => 0,
            ParkingStage::TakeUp => at_work,
            ParkingStage::AtWork
            | ParkingStage::PullOut
            | ParkingStage::ToTarget
            | ParkingStage::Parked
            | ParkingStage::AtWaypoint
            | ParkingStage::Stop => backlash.steps,
        };
        ahead.wrapping_sub(backlash.lead)
    }

    /// Makes the next segment, from `position`; returns false when there is none.
    pub(crate) fn next(
        &mut self,
        position: &Axes<FineSteps>,
        ending: Ending,
        backlash: ZBacklash,
        segment: &mut Segment,
    ) -> bool {
        let goal = if self.stops(ending) {
            Goal::Stop
        } else {
            Goal::Run
        };
        if goal == Goal::Run
            && let Some((to, mm_s)) = self.requested.take()
        {
            // A run that begins a move makes none of its segments.
            let mut delta = Axes([0; AXES]);
            let take_up = i64::from(self.take_up(backlash)) << 32;
            delta[Z] = to.0.wrapping_sub(position[Z].0).wrapping_add(take_up);
            self.cycle_move.begin(delta, mm_s, &self.limits);
            *segment = Segment::standstill(SEGMENT_TICKS, position);
            return true;
        }
        self.cycle_move.next(position, goal, segment)
    }

    /// Ends the motion: the machine stays where it is.
    pub(crate) fn abandon(&mut self) {
        self.abandon_move();
        self.stage = ParkingStage::AtWork;
    }

    /// Begins to park from `z`, if that is possible.
    pub(crate) fn begin(&mut self, z: FineSteps) -> bool {
        match self.stage {
            ParkingStage::AtWork => {
                if !self.is_enabled || z.0 >= self.target.0 {
                    return false;
                }
                self.work = z;
                self.lead_at_work = None;
                let waypoint = z.0.wrapping_add(self.pull_out);
                self.waypoint = FineSteps(waypoint.min(self.target.0));
                self.pull_out_from(z);
            }
            ParkingStage::ToWaypoint | ParkingStage::Plunge | ParkingStage::TakeUp => {
                self.stage = ParkingStage::Stop;
            }
            ParkingStage::AtWaypoint => self.pull_out_from(z),
            ParkingStage::PullOut
            | ParkingStage::ToTarget
            | ParkingStage::Parked
            | ParkingStage::Stop => {}
        }
        true
    }

    /// Begins to bring Z back from the target to the waypoint; returns false where Z is not parked.
    pub(crate) fn begin_return(&mut self) -> bool {
        let is_parked = self.stage == ParkingStage::Parked;
        if is_parked {
            self.stage = ParkingStage::ToWaypoint;
            self.requested = Some((self.waypoint, self.fast_mm_s));
        }
        is_parked
    }

    /// Begins to bring Z from the waypoint into the work; returns false where Z is not there.
    pub(crate) fn begin_plunge(&mut self) -> bool {
        let is_above = self.stage == ParkingStage::AtWaypoint;
        if is_above {
            self.stage = ParkingStage::Plunge;
            self.requested = Some((self.work, self.slow_mm_s));
        }
        is_above
    }

    /// Goes on to the next stage from `z`, where Z has come to rest; returns what has been reached.
    pub(crate) fn next_stage(&mut self, z: FineSteps) -> Option<Reached> {
        match self.stage {
            ParkingStage::AtWork | ParkingStage::Parked | ParkingStage::AtWaypoint => None,
            ParkingStage::PullOut => {
                self.stage = ParkingStage::ToTarget;
                self.requested = Some((self.target, self.fast_mm_s));
                Some(Reached::PulledOut)
            }
            ParkingStage::ToTarget => {
                self.stage = ParkingStage::Parked;
                Some(Reached::Target)
            }
            ParkingStage::ToWaypoint => {
                self.stage = ParkingStage::AtWaypoint;
                Some(Reached::Waypoint)
            }
            ParkingStage::Plunge if self.lead_at_work.is_some_and(|steps| steps != 0) => {
                self.stage = ParkingStage::TakeUp;
                self.requested = Some((self.work, self.slow_mm_s));
                None
            }
            ParkingStage::Plunge | ParkingStage::TakeUp => {
                self.abandon();
                Some(Reached::Work)
            }
            ParkingStage::Stop => {
                self.abandon_move();
                self.pull_out_from(z);
                None
            }
        }
    }

    fn pull_out_from(&mut self, z: FineSteps) {
        self.stage = ParkingStage::PullOut;
        if z.0 < self.waypoint.0 {
            self.requested = Some((self.waypoint, self.slow_mm_s));
        }
    }

    fn abandon_move(&mut self) {
        self.requested = None;
        self.cycle_move.abandon();
    }
}

/// Returns the nearest whole number of steps, with 32 binary places.
fn whole(steps: f32) -> i64 {
    let half = if steps < 0.0 { -0.5 } else { 0.5 };
    i64::from((steps + half) as i32) << 32
}
