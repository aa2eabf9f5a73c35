//! The power fails and comes back: what is stored then is old or new, and not half.

use std::collections::VecDeque;

use leadscrew::{
    axis::Axes,
    gcode::Units,
    model::{Levels, WorkCoordinates},
    settings::{Stored, TOOLS, ToolTable},
    sim::Simulator,
};

use super::{Bench, Fault, RESET_TICKS, SECOND};
use crate::{reports::ReportRules, rules::MotionRules};

impl Bench {
    /// The power fails, and comes back.
    pub(super) fn fail_power(&mut self) {
        self.note_stored();
        let units = self.simulator.session().interpreter().modal().units;
        self.before += self.simulator.now();
        for (moved, steps) in self.moved.iter_mut().zip(self.motion.steps().iter()) {
            *moved += steps;
        }
        let new = Box::new(Simulator::first_boot(self.step_rate));
        let mut flash = std::mem::replace(&mut self.simulator, new).into_flash();
        if self.fault == Some(Fault::RecordLost) {
            flash.contents_mut().fill(0xff);
        }
        *self.simulator = Simulator::power_up(flash, self.step_rate);
        self.setup.mount(&mut self.simulator, &self.moved);
        let session = self.simulator.session();
        let stored = (session.stored().clone(), session.tools().clone());
        let is_known = self.may_be_stored.contains(&stored)
            || self.has_postponed && are_records_of(&stored, &self.may_be_stored);
        self.has_postponed = false;
        let old = std::mem::replace(&mut self.may_be_stored, vec![stored]);
        self.motion = MotionRules::new(&self.simulator, self.setup);
        self.reports = ReportRules::default();
        (self.is_statement, self.is_alarm_of_probe) = (false, false);
        (self.on_since, self.held_behind_door_since) = (None, None);
        (self.line, self.urgent) = (VecDeque::new(), VecDeque::new());
        (self.next_in, self.next_out) = (0, 0);
        self.received.clear();
        (self.received_lines, self.answers, self.resets) = (0, 0, 0);
        self.refusals = 0;
        self.forget_lines();
        self.lost = 0;
        (self.welcomes, self.silent_at) = (1, SECOND);
        self.asked = None;
        (self.offset, self.may_have_homed) = (Axes::all(0), false);
        self.second_offset = Axes::all(0);
        let closed = std::mem::replace(&mut self.closed, Levels::NONE);
        self.hold(closed);
        self.note_reset();
        self.run(SECOND / 10);
        let writing = self.writing.take();
        if !is_known {
            self.check_stored_by_line(old.last(), writing.as_deref(), units);
        }
    }

    /// Checks that a stored record other than the old record is the new one: the same line changes nothing when sent
    /// again, in the same units.
    fn check_stored_by_line(
        &mut self,
        old: Option<&(Stored, ToolTable)>,
        writing: Option<&str>,
        units: Units,
    ) {
        let new = self.may_be_stored.clone();
        let changes = old
            .zip(new.first())
            .map(|(old, new)| changed_records(old, new));
        let is_stored = writing.is_some() && changes == Some(1);
        assert!(is_stored, "what is stored is neither old nor new");
        let line = writing.unwrap_or_default();
        // A contact that is still closed may hold the machine.
        self.recover_for_line();
        self.send("$X");
        if units == Units::Inches {
            self.send("G20");
        }
        self.send(line);
        assert!(
            self.reaches_standstill(RESET_TICKS),
            "{line} is not answered"
        );
        assert!(self.may_be_stored == new, "{line} was stored in part");
    }
}

/// Whether each record is in a state that may be stored.
fn are_records_of(stored: &(Stored, ToolTable), all: &[(Stored, ToolTable)]) -> bool {
    let any = |is_same: &dyn Fn(&Stored, &ToolTable) -> bool| {
        all.iter().any(|(stored, tools)| is_same(stored, tools))
    };
    let (now, tools) = stored;
    let mut startup = now.startup.iter().enumerate();
    any(&|then, _| then.settings == now.settings)
        && any(&|then, _| then.origins == now.origins)
        && any(&|then, _| then.build_info == now.build_info)
        && startup.all(|(line, text)| any(&|then, _| then.startup.get(line) == Some(text)))
        && (0..TOOLS).all(|slot| any(&|_, then| then.slot(slot) == tools.slot(slot)))
}

/// How many records differ: the settings, an origin, a startup line, the build info, a tool.
fn changed_records(one: &(Stored, ToolTable), other: &(Stored, ToolTable)) -> usize {
    let ((old, old_tools), (new, new_tools)) = (one, other);
    let origins = WorkCoordinates::ALL.into_iter().filter(|&system| {
        let of = |stored: &Stored| {
            let origins = &stored.origins;
            (origins.coordinates[system], origins.rotations[system])
        };
        of(old) != of(new)
    });
    let startup = old.startup.iter().zip(&new.startup);
    let tools = (0..TOOLS).filter(|&slot| old_tools.slot(slot) != new_tools.slot(slot));
    let others = [
        old.settings != new.settings,
        old.origins.g28 != new.origins.g28,
        old.origins.g30 != new.origins.g30,
        old.build_info != new.build_info,
    ];
    origins.count()
        + startup.filter(|(old, new)| old != new).count()
        + tools.count()
        + others.into_iter().filter(|&differs| differs).count()
}
