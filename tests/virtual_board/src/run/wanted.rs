//! What a script wants, compared with what a run has shown.

use rigless::session::Session;

use super::Run;
use crate::{compare, job, machine::Machine, rehearsal::STEPS_PER_MM, script::Wanted};

/// What starts `TinyUF2` as if the reset button had been pressed twice: `DBL_TAP_MAGIC` in its `board_api.h`.
const UF2_MARK: u64 = 0xF016_69EF;

impl Run {
    /// Looks whether something is as it should be.
    pub(super) fn compare(&mut self, wanted: &Wanted, session: &mut Session<Machine>) {
        let fault = match wanted {
            Wanted::Lines(beginning, times) => {
                let count = self.count(beginning);
                (count != *times)
                    .then(|| format!("{beginning:?} comes {count} times instead of {times}"))
            }
            Wanted::OneOf(beginnings) => {
                let is_there = beginnings.iter().any(|it| self.count(it) > 0);
                (!is_there).then(|| format!("no line is one of {beginnings:?}"))
            }
            Wanted::No(beginning) => {
                (self.count(beginning) > 0).then(|| format!("{beginning:?} comes"))
            }
            Wanted::Position => self.misplaced(),
            Wanted::Remembered(but) => self.other_settings(but),
            Wanted::Resets(wanted) => self.other_resets(wanted, session),
            Wanted::Inactive(name) => self.active_at_reset(name, session),
            Wanted::Active(name) => {
                let mut switchings = self.plant.switchings[self.marks.switchings..].iter();
                let was_active = switchings.any(|(_, of, is_active)| of == name && *is_active);
                (!was_active).then(|| format!("{name} is not switched on"))
            }
            Wanted::Off(name) => self.still_on(name),
            Wanted::Moved(count) => {
                self.plant
                    .not_moved(self.marks.steps, self.marks.energised, *count)
            }
            Wanted::NoStep => {
                let steps = self.plant.steps.len() - self.marks.steps;
                let count = steps + self.plant.energised - self.marks.energised;
                (count != 0).then(|| format!("{count} steps are made"))
            }
            Wanted::Steps(events) => {
                let steps = &self.plant.steps[self.marks.steps..];
                job::difference(steps, events).unwrap_or_else(|error| Some(format!("{error:#}")))
            }
            Wanted::PwmOn => compare::pwm_is_high(&self.bench, session.board_mut())
                .is_some_and(|is_high| !is_high)
                .then(|| "the PWM is off while the spindle is on".into()),
            Wanted::PwmOff => compare::pwm_is_high(&self.bench, session.board_mut())
                .is_some_and(|is_high| is_high)
                .then(|| "the PWM is on while nothing moves".into()),
            Wanted::Cut => {
                let is_cut = session.board_mut().chip.flash.is_cut || self.plant.is_cut();
                (!is_cut).then(|| "the supply is not cut: less is stored than before".into())
            }
            Wanted::HandedOver(count) => self.not_handed_over(*count),
            Wanted::Uf2Mark => self.other_uf2_mark(),
            Wanted::Erased(count) => self.otherwise_erased(*count),
            Wanted::CoreMhz(mhz) => {
                let hz = session.board_mut().chip.frequencies()[0];
                (hz != mhz * 1_000_000)
                    .then(|| format!("the core runs at {hz} Hz instead of {mhz} MHz"))
            }
        };
        if let Some(fault) = fault {
            self.watch.fault(fault, None);
        }
    }

    /// Lines of this case with a beginning.
    fn count(&self, beginning: &str) -> usize {
        let lines = self.lines[self.marks.lines..].iter();
        lines.filter(|line| line.starts_with(beginning)).count()
    }

    fn other_settings(&self, but: &str) -> Option<String> {
        let but_one = |mut all: Vec<String>| {
            all.retain(|line| !line.starts_with(but));
            all
        };
        let is_same = but_one(self.settings_listed()) == but_one(self.remembered.clone());
        (!is_same).then(|| format!("other settings than {but} have changed"))
    }

    fn still_on(&self, name: &str) -> Option<String> {
        let switchings = self.plant.switchings[self.marks.switchings..].iter();
        let last = switchings.rev().find(|(_, of, _)| of == name);
        let is_on = last.is_none_or(|(_, _, is_active)| *is_active);
        is_on.then(|| format!("{name} is not switched off"))
    }

    fn other_resets(&self, wanted: &[&str], session: &Session<Machine>) -> Option<String> {
        let resets = session.resets()[self.marks.resets..].iter();
        let causes: Vec<_> = resets.map(|reset| format!("{:?}", reset.cause)).collect();
        let mut pairs = causes.iter().zip(wanted);
        let is_right = causes.len() == wanted.len() && pairs.all(|(cause, of)| cause.contains(of));
        (!is_right).then(|| format!("resets: {causes:?} instead of {wanted:?}"))
    }

    fn active_at_reset(&self, name: &str, session: &Session<Machine>) -> Option<String> {
        let reset = session.resets().last().map_or(u64::MAX, |reset| reset.at.0);
        let switchings = self.plant.switchings[self.marks.switchings..].iter();
        let mut before = switchings.filter(|(at, of, _)| of == name && at.0 < reset);
        let is_on = before
            .next_back()
            .is_none_or(|(_, _, is_active)| *is_active);
        is_on.then(|| format!("{name} is on when the chip is reset"))
    }

    /// The chip's own bootloader has begun more often than that without a reset, or less often.
    fn not_handed_over(&self, count: usize) -> Option<String> {
        let entered = self.handed_over - self.marks.handed_over;
        (entered != count)
            .then(|| format!("the chip's own bootloader begins {entered} times instead of {count}"))
    }

    /// More sectors were erased, or fewer.
    fn otherwise_erased(&self, count: usize) -> Option<String> {
        let erased = self.watch.erased - self.marks.erased;
        (erased != count).then(|| format!("{erased} sectors are erased instead of {count}"))
    }

    /// Something else was in RAM where the mark of a UF2 bootloader belongs.
    fn other_uf2_mark(&self) -> Option<String> {
        let word = self.uf2_word;
        (word != UF2_MARK).then(|| format!("TinyUF2 finds {word:#x} instead of its mark"))
    }

    /// What the last report says of X is not where its motor is.
    fn misplaced(&self) -> Option<String> {
        let position = self.plant.position(0)?;
        let lines = self.lines[self.marks.lines..].iter();
        let reported = lines.rev().find_map(|line| {
            let (_, tail) = line.split_once("|MPos:")?;
            tail.split(',').next()?.parse::<f64>().ok()
        });
        let reported = reported.map(|mm| (mm * STEPS_PER_MM).round() as i32);
        (reported != Some(position))
            .then(|| format!("X is at step {position} and reported at {reported:?}"))
    }
}
