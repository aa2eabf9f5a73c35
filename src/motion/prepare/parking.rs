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

use super::Motion;
use crate::{
    axis::{AXES, Axes, Z},
    machine::{Ending, Event},
    math,
    model::{Laser, State},
    motion::{
        executor::{Executor, Goal},
        lookahead::Plan,
    },
    path::{Block, MoveKind},
    settings::Settings,
    units::FineSteps,
};

/// Where Z is on its way.
#[derive(Debug, Clone, Copy, PartialEq, Eq)]
enum ParkingStage {
    /// Where the work is.
    AtWork,
    PullOut,
    ToTarget,
    Parked,
    AtWaypoint,
    Waypoint,
    Plunge,
    /// The door was opened on the way back: coming to rest, to be parked again.
    Stop,
}

/// The motion of Z.
#[derive(Debug)]
pub(super) struct Parking {
    plan: Plan<2>,
    executor: Executor,
    stage: ParkingStage,
    is_enabled: bool,
    target: FineSteps,
    /// Way of the pull-out, steps with 32 binary places.
    pull_out: i64,
    slow_mm_s: f32,
    fast_mm_s: f32,
    limit_mm_s: f32,
    acceleration_mm_s2: f32,
    steps_per_mm: f32,
    work: FineSteps,
    waypoint: FineSteps,
}

impl Parking {
    pub(super) const fn new() -> Self {
        Self {
            plan: Plan::new(),
            executor: Executor::new(),
            stage: ParkingStage::AtWork,
            is_enabled: false,
            target: FineSteps(0),
            pull_out: 0,
            slow_mm_s: 0.0,
            fast_mm_s: 0.0,
            limit_mm_s: 0.0,
            acceleration_mm_s2: 0.0,
            steps_per_mm: 1.0,
            work: FineSteps(0),
            waypoint: FineSteps(0),
        }
    }

    /// Takes over the settings. A machine that is not homed knows no place to park; a laser must
    /// not burn on its way.
    pub(super) fn configure(&mut self, settings: &Settings) {
        let steps_per_mm = settings.steps_per_mm[Z].to_f32();
        self.is_enabled = settings.parking && settings.homing && !settings.laser;
        self.steps_per_mm = steps_per_mm;
        self.target = FineSteps(whole(settings.parking_target_mm * steps_per_mm));
        self.pull_out = whole(settings.parking_pull_out_mm * steps_per_mm);
        self.slow_mm_s = settings.parking_pull_out_mm_min / 60.0;
        self.fast_mm_s = settings.parking_mm_min / 60.0;
        self.limit_mm_s = math::min(
            settings.max_rate_mm_min[Z] / 60.0,
            settings.greatest_step_rate_hz() / steps_per_mm,
        );
        self.acceleration_mm_s2 = settings.acceleration_mm_s2[Z];
    }

    /// Whether Z is not where the work is.
    pub(super) fn is_away(&self) -> bool {
        self.stage != ParkingStage::AtWork
    }

    /// Whether Z is on its way.
    pub(super) fn is_moving(&self) -> bool {
        match self.stage {
            ParkingStage::AtWork | ParkingStage::Parked | ParkingStage::Waypoint => false,
            ParkingStage::PullOut
            | ParkingStage::ToTarget
            | ParkingStage::AtWaypoint
            | ParkingStage::Plunge
            | ParkingStage::Stop => true,
        }
    }

    /// Whether there is something to play on the way.
    pub(super) fn has_segment(&self, ending: Ending) -> bool {
        let has_way = !self.plan.is_empty();
        has_way && (!self.stops(ending) || self.executor.is_moving())
    }

    /// Whether Z is to come to rest on its way.
    fn stops(&self, ending: Ending) -> bool {
        ending != Ending::None || self.stage == ParkingStage::Stop
    }

    /// Forgets the way: the machine stays where it is.
    pub(super) fn abandon(&mut self) {
        self.plan.clear();
        self.executor.abandon();
        self.stage = ParkingStage::AtWork;
    }

    /// Begins to park from `z`, if that is possible.
    fn begin(&mut self, z: FineSteps) -> bool {
        match self.stage {
            ParkingStage::AtWork => {
                if !self.is_enabled || z.0 >= self.target.0 {
                    return false;
                }
                self.work = z;
                let waypoint = z.0.wrapping_add(self.pull_out);
                self.waypoint = FineSteps(waypoint.min(self.target.0));
                self.pull_out_from(z);
            }
            ParkingStage::AtWaypoint | ParkingStage::Plunge => self.stage = ParkingStage::Stop,
            ParkingStage::Waypoint => self.pull_out_from(z),
            ParkingStage::PullOut
            | ParkingStage::ToTarget
            | ParkingStage::Parked
            | ParkingStage::Stop => {}
        }
        true
    }

    fn pull_out_from(&mut self, z: FineSteps) {
        self.stage = ParkingStage::PullOut;
        if z.0 < self.waypoint.0 {
            self.move_to(z, self.waypoint, self.slow_mm_s);
        }
    }

    fn move_to(&mut self, from: FineSteps, to: FineSteps, mm_s: f32) {
        let delta = to.0.wrapping_sub(from.0);
        // To a 4096th of a step: the length only sets the pace.
        let steps = (delta.unsigned_abs() >> 20) as u32 as f32 / 4096.0;
        if delta == 0 || steps <= 0.0 {
            return;
        }
        let along = if delta < 0 {
            -self.steps_per_mm
        } else {
            self.steps_per_mm
        };
        let speed_mm_s = math::min(mm_s, self.limit_mm_s);
        let mut block = Block {
            delta: Axes([0; AXES]),
            steps_per_mm: Axes([0.0; AXES]),
            length_mm: steps / self.steps_per_mm,
            nominal_mm_s: speed_mm_s,
            programmed_mm_s: speed_mm_s,
            limit_mm_s: self.limit_mm_s,
            kind: MoveKind::Fixed,
            laser: Laser::None,
            acceleration_mm_s2: self.acceleration_mm_s2,
            junction_sqr: 0.0,
            curve: None,
            line: 0,
        };
        block.delta[Z] = delta;
        block.steps_per_mm[Z] = along;
        self.plan.push_alone(&block);
    }
}

impl Motion {
    /// The door is open and the machine at rest: parks, or only switches everything off.
    pub(super) fn park(&mut self) {
        let z = self.generator.position()[Z];
        if self.parking.begin(z) {
            // Spindle and coolant stay on until Z is out of the work.
            self.control = self.control.after(Event::Park).0;
        } else {
            self.accessories.suspend();
        }
    }

    /// Brings Z back as far as the waypoint; false where it is not away.
    pub(super) fn unpark(&mut self) -> bool {
        let is_parked = self.parking.stage == ParkingStage::Parked;
        if is_parked {
            let (z, to) = (self.generator.position()[Z], self.parking.waypoint);
            self.parking.stage = ParkingStage::AtWaypoint;
            self.parking.move_to(z, to, self.parking.fast_mm_s);
        }
        is_parked
    }

    /// Brings Z from the waypoint into the work; false where it is there.
    pub(super) fn plunge(&mut self) -> bool {
        let is_above = self.parking.stage == ParkingStage::Waypoint;
        if is_above {
            let (z, to) = (self.generator.position()[Z], self.parking.work);
            self.parking.stage = ParkingStage::Plunge;
            self.parking.move_to(z, to, self.parking.slow_mm_s);
        }
        is_above
    }

    /// Z has come to rest.
    pub(super) fn next_parking_stage(&mut self) {
        let z = self.generator.position()[Z];
        match self.parking.stage {
            ParkingStage::AtWork | ParkingStage::Parked | ParkingStage::Waypoint => {}
            ParkingStage::PullOut => {
                self.accessories.suspend();
                self.parking.stage = ParkingStage::ToTarget;
                let (to, speed) = (self.parking.target, self.parking.fast_mm_s);
                self.parking.move_to(z, to, speed);
            }
            ParkingStage::ToTarget => {
                self.parking.stage = ParkingStage::Parked;
                self.transition(Event::Parked);
            }
            ParkingStage::AtWaypoint => {
                self.parking.stage = ParkingStage::Waypoint;
                self.begin_restoring();
            }
            ParkingStage::Plunge => {
                self.parking.abandon();
                self.transition(Event::Restored);
            }
            ParkingStage::Stop => {
                self.parking.plan.clear();
                self.parking.executor.abandon();
                self.parking.pull_out_from(z);
            }
        }
    }

    #[inline(never)]
    pub(super) fn parking_segment(&mut self) -> bool {
        let stops = self.parking.stops(self.control.ending);
        let goal = if stops { Goal::Stop } else { Goal::Run };
        let position = self.generator.position();
        let (parking, segment) = (&mut self.parking, &mut self.segment);
        let plan = &mut parking.plan;
        if !parking.executor.next(plan, position, goal, segment) {
            return false;
        }
        self.segment.power = self.accessories.power_at_rest();
        self.enable_drivers();
        true
    }

    /// A reset while Z moves is one in motion, also on the way back.
    pub(super) fn reset_parking(&mut self) {
        if self.parking.is_moving() {
            self.control.state = State::DoorRetracting;
        }
    }
}

/// The nearest whole number of steps, with 32 binary places.
fn whole(steps: f32) -> i64 {
    let half = if steps < 0.0 { -0.5 } else { 0.5 };
    i64::from((steps + half) as i32) << 32
}
