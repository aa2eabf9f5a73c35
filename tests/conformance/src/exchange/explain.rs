//! Answers and messages against recorded ones.

use leadscrew::gcode::LineError;

use super::{
    DEAF_S, Exchange, Played,
    received::{Pair, ReceivedLine, align},
    rules::{
        differs_in_mist, differs_in_tool, displacement, is_arc, is_build_options, is_consequence,
        is_setting_out_of_range, of_dollar, stores,
    },
    status::is_rounded_otherwise,
    stops::Stops,
};
use crate::{
    compare::Difference,
    deviation::{Deviation, of_answers, of_message},
};
use simulation::{
    machine::Pin,
    sender,
    session::step::{Act, Step},
};

/// In a dwell, Grbl looks at requests and at the time every 50 ms; a hold in it takes two looks.
const GRBL_DWELL_S: f64 = 0.1;
/// Two times that are the same, s.
const SAME_S: f64 = 0.05;
/// The longest that Grbl's EEPROM needs for one line (`$RST=*`), s.
const STORAGE_S: f64 = 0.3;
/// Moves that Grbl's look-ahead holds, and bytes that its receive buffer holds.
const GRBL_BLOCKS: usize = 15;
const GRBL_BUFFER: usize = 128;
/// Part of the time of a homing cycle by which ours may differ.
const HOMING_SHARE: f64 = 0.35;

/// Compares lines and knows the excuses.
pub(super) struct LineComparison<'a> {
    exchange: &'a Exchange,
    played: &'a Played,
    stops: &'a Stops,
    theirs: Vec<ReceivedLine>,
}

impl<'a> LineComparison<'a> {
    pub(super) fn new(exchange: &'a Exchange, played: &'a Played, stops: &'a Stops) -> Self {
        Self {
            exchange,
            played,
            stops,
            theirs: exchange.received(),
        }
    }

    /// Compares everything that is no report. Returns the step from which on the two machines are not
    /// the same any more, by a deviation.
    pub(super) fn lines(
        &self,
        ours: &[ReceivedLine],
        theirs: &[ReceivedLine],
        found: &mut Vec<Difference>,
    ) -> Option<usize> {
        let mut diverged = None;
        for pair in align(ours, theirs) {
            let (what, step, text, by_design) = match pair {
                Pair::Both(i, j) if ours[i].text == theirs[j].text => {
                    match self.time(&ours[i], &theirs[j]) {
                        Some((text, reason)) => ("time", theirs[j].step, text, reason),
                        None => continue,
                    }
                }
                Pair::Both(i, j) | Pair::Changed(i, j) => {
                    let (our, their) = (&ours[i], &theirs[j]);
                    let text = format!("`{}`, Grbl `{}`", our.text, their.text);
                    let answers = theirs[..j].iter().filter(|received| received.is_answer());
                    let reason = self.changed(our, their, answers.count());
                    ("line", their.step, text, reason)
                }
                Pair::Ours(i, _) => {
                    let text = format!("`{}`, Grbl nothing", ours[i].text);
                    ("line", ours[i].step, text, self.surplus(&ours[i]))
                }
                Pair::Theirs(j, _) => {
                    let text = format!("nothing, Grbl `{}`", theirs[j].text);
                    ("line", theirs[j].step, text, None)
                }
            };
            let text_of = |index: usize| {
                theirs
                    .get(index)
                    .map_or("", |received| received.text.as_str())
            };
            let divergence = self.divergence(step);
            let by_design = by_design
                .or(divergence.map(|(deviation, _)| deviation))
                .or_else(|| match pair {
                    Pair::Changed(i, j) | Pair::Both(i, j) if diverged.is_some() => {
                        is_consequence(&ours[i].text, text_of(j)).then_some(Deviation::Follows)
                    }
                    Pair::Ours(i, _) if diverged.is_some() => {
                        is_consequence(&ours[i].text, "").then_some(Deviation::Follows)
                    }
                    Pair::Theirs(j, _) if diverged.is_some() => {
                        is_consequence("", text_of(j)).then_some(Deviation::Follows)
                    }
                    Pair::Both(..) | Pair::Changed(..) | Pair::Ours(..) | Pair::Theirs(..) => None,
                });
            if diverged.is_none()
                && by_design.is_some_and(|deviation| deviation.row().has_consequences)
            {
                diverged = Some(divergence.map_or(step, |(_, since)| since));
            }
            let name = self.exchange.step_name(step);
            found.push(Difference {
                what,
                text: format!("step {} {name}: {text}", step + 1),
                by_design,
            });
        }
        diverged
    }

    /// What makes Grbl do something else in a step altogether, and since which step.
    fn divergence(&self, step: usize) -> Option<(Deviation, usize)> {
        if self.loses_bytes(step) {
            return Some((Deviation::LostBytes, step));
        }
        if let Some(since) = self.opened_limit(step) {
            return Some((Deviation::LimitOpens, since));
        }
        // The homing that the step belongs to.
        let home = (0..=step).rev().find(|index| {
            let has_line = self
                .exchange
                .step(*index)
                .is_some_and(|step| step.line.is_some());
            has_line || *index == 0
        })?;
        let line = self.line_of(home);
        let axes = line.strip_prefix("$H")?;
        let refused_by_grbl = self
            .theirs
            .iter()
            .any(|their| their.step == home && their.is_error(LineError::InvalidStatement));
        if !axes.is_empty() && refused_by_grbl {
            return Some((Deviation::SingleAxisHoming, home));
        }
        let refused_by_us =
            self.played.received.iter().any(|our| {
                (home..=step).contains(&our.step) && our.is_error(LineError::LimitsEngaged)
            });
        refused_by_us.then_some((Deviation::HomingOnSwitch, home))
    }

    /// The step in which Grbl took the opening of a limit switch for its closing.
    fn opened_limit(&self, step: usize) -> Option<usize> {
        (0..=step).find(|index| {
            let opens = self
                .exchange
                .step(*index)
                .map(Step::act)
                .is_some_and(|act| {
                    matches!(
                        act,
                        Ok(Act::Pin {
                            pin: Pin::Limit(_),
                            closed: false
                        })
                    )
                });
            let alarms = |their: &ReceivedLine| their.step == *index && their.text == "ALARM:1";
            opens && self.theirs.iter().any(alarms)
        })
    }

    /// Other coordinates in a message: those of a place that a stop or a failed homing has changed.
    fn why_elsewhere(&self, our: &ReceivedLine, by: &[f64]) -> Option<Deviation> {
        if self.exchange.has_failed_homing(our.step) {
            return Some(Deviation::HomingMotion);
        }
        let own_s = our
            .time_s
            .map_or(f64::MAX, |time_s| self.played.own_time_s(our.step, time_s));
        let is_stop = self.stops.explain(own_s, by, self.exchange.step_mm());
        is_stop.then_some(Deviation::ShortStops)
    }

    /// Whether Grbl has had to keep more bytes than it can, up to a step.
    fn loses_bytes(&self, step: usize) -> bool {
        let (mut unanswered, mut bytes) = (0_usize, 0);
        for (index, step) in self.exchange.session.steps().enumerate().take(step + 1) {
            let sent = step.sends();
            if unanswered > 0 {
                bytes += sent.len();
            }
            let ends = sent.iter().filter(|byte| matches!(byte, b'\n' | b'\r'));
            unanswered += ends.collect::<Vec<_>>().len();
            if bytes > GRBL_BUFFER {
                return true;
            }
            let answers = self.theirs.iter().filter(|their| their.step == index);
            let answers = answers.filter(|their| their.is_answer()).count();
            unanswered = unanswered.saturating_sub(answers);
            if unanswered == 0 {
                bytes = 0;
            }
        }
        false
    }

    fn line_of(&self, step: usize) -> String {
        let line = self.exchange.step(step).and_then(|step| step.line.clone());
        let code = sender::code(line.unwrap_or_default().as_bytes());
        String::from_utf8_lossy(&code).into_owned()
    }

    /// The line that an answer belongs to, where several were sent at once: each has one answer.
    fn answered(&self, answers_before: usize) -> String {
        let steps = self.exchange.session.steps().enumerate();
        let mut sent = steps.filter(|(_, step)| step.line.is_some());
        sent.nth(answers_before)
            .map_or(String::new(), |(step, _)| self.line_of(step))
    }

    /// Another text in the same place, after a number of answers.
    fn changed(
        &self,
        our: &ReceivedLine,
        their: &ReceivedLine,
        answers_before: usize,
    ) -> Option<Deviation> {
        let mut line = self.line_of(their.step);
        if line.is_empty() && their.is_answer() {
            line = self.answered(answers_before);
        }
        let their_ok = their.text == "ok";
        if is_build_options(&our.text, &their.text) {
            return Some(Deviation::Buffers);
        }
        if differs_in_tool(&our.text, &their.text) {
            return Some(Deviation::ToolIsModal);
        }
        if differs_in_mist(&our.text, &their.text) && self.exchange.has_mist(their.step) {
            return Some(Deviation::Mist);
        }
        if our.text.starts_with('[') && is_rounded_otherwise(&our.text, &their.text) {
            return Some(Deviation::Rounding);
        }
        if our.text.starts_with('[')
            && let Some(by) = displacement(&our.text, &their.text)
        {
            return self.why_elsewhere(our, &by);
        }
        if let Some(deviation) = of_message(&our.text) {
            return Some(deviation);
        }
        if let Some(deviation) = of_answers(&line, &our.text, &their.text) {
            return Some(deviation);
        }
        if their_ok && our.is_error(LineError::NoAxisWords) {
            let jog = line.strip_prefix("$J=");
            let has_none = jog.is_some_and(|jog| !jog.contains(['X', 'Y', 'Z', 'A', 'B', 'C']));
            return has_none.then_some(Deviation::JogWithoutAxes);
        }
        if their_ok && let Some(deviation) = of_dollar(&line, our) {
            return Some(deviation);
        }
        if their_ok && our.is_error(LineError::InvalidTarget) {
            return self.is_far(&line).then_some(Deviation::FarTargets);
        }
        if their_ok && our.is_error(LineError::StepRateTooHigh) {
            return Some(Deviation::StepRates);
        }
        let was_limited = their_ok || their.is_error(LineError::StepPulseTooShort);
        if was_limited && is_setting_out_of_range(&line) {
            let refused = [LineError::NegativeValue, LineError::SettingOutOfRange];
            let is_refused = refused.into_iter().any(|error| our.is_error(error));
            return is_refused.then_some(Deviation::SettingRanges);
        }
        // The list of settings shows what Grbl stored.
        let same_setting = |text: &str| text.split_once('=').map(|(name, _)| name.to_owned());
        if our.text.starts_with('$') && same_setting(&our.text) == same_setting(&their.text) {
            let name = same_setting(&our.text)?;
            let before = (0..their.step).map(|step| self.line_of(step));
            let was_limited = before
                .filter(|line| line.starts_with(&format!("{name}=")))
                .any(|line| is_setting_out_of_range(&line));
            return was_limited.then_some(Deviation::SettingRanges);
        }
        None
    }

    /// Whether a line has a target that no step counter can hold.
    fn is_far(&self, line: &str) -> bool {
        let most = self
            .exchange
            .scale()
            .iter()
            .fold(0.0_f64, |most, scale| most.max(*scale));
        let farthest_mm = f64::from(i32::MAX) / most / 2.0;
        line.split(|c: char| c.is_ascii_alphabetic())
            .filter_map(|number| number.parse::<f64>().ok())
            .any(|number| number.abs() > farthest_mm)
    }

    /// Ours alone said something.
    fn surplus(&self, our: &ReceivedLine) -> Option<Deviation> {
        let line = self.line_of(our.step);
        let recorded = self.exchange.step(our.step)?;
        if line == "$I" && our.text.starts_with("[MSG:Step rate: ") {
            return Some(Deviation::BuildInfo);
        }
        // Behind the message that tells which word is missing.
        if our.is_error(LineError::MissingWord) {
            let reason = of_answers(&line, &our.text, "error:20");
            return reason.filter(|reason| *reason == Deviation::CannedCycles);
        }
        // All that a probing move has to say.
        let theirs = recorded.recv.first().map_or("", String::as_str);
        if of_answers(&line, &our.text, theirs) == Some(Deviation::ProbedValue) {
            return Some(Deviation::ProbedValue);
        }
        let unanswered = !recorded
            .recv
            .iter()
            .any(|text| text == "ok" || text.starts_with("error:"));
        if unanswered && our.text == "ok" && is_arc(&line) {
            return Some(Deviation::Arcs);
        }
        if our.text == "ok" && self.is_withheld_for_room(our.step) {
            return Some(Deviation::Buffers);
        }
        // What was sent while Grbl did not listen.
        let sent_s = recorded.t?;
        let is_deaf = self.theirs.iter().any(|their| {
            their.text.starts_with("ALARM:")
                && their
                    .time_s
                    .is_some_and(|alarm_s| (0.0..DEAF_S).contains(&(sent_s - alarm_s)))
        });
        (unanswered && is_deaf && recorded.line.is_some()).then_some(Deviation::NoDeafness)
    }

    /// The same text at another time. `None`: the times agree.
    fn time(
        &self,
        our: &ReceivedLine,
        their: &ReceivedLine,
    ) -> Option<(String, Option<Deviation>)> {
        let (Some(our_s), Some(their_s)) = (our.time_s, their.time_s) else {
            let text = || format!("`{}` in the step before", our.text);
            return (our.step != their.step).then(|| (text(), Some(Deviation::NoPause)));
        };
        let late_s = our_s - their_s;
        if late_s.abs() <= SAME_S {
            return None;
        }
        let text = format!("`{}` {:+.0} ms", our.text, late_s * 1e3);
        Some((text, self.why_at_another_time(our, their, late_s)))
    }

    fn why_at_another_time(
        &self,
        our: &ReceivedLine,
        their: &ReceivedLine,
        late_s: f64,
    ) -> Option<Deviation> {
        let their_s = their.time_s?;
        let line = self.line_of(their.step);
        let after_alarm = self.theirs.iter().any(|alarm| {
            alarm.text.starts_with("ALARM:")
                && alarm
                    .time_s
                    .is_some_and(|alarm_s| alarm_s <= their_s && their_s - alarm_s <= DEAF_S)
        });
        let own_s = self.played.own_time_s(our.step, our.time_s?);
        let allowed_s = self.stops.allowance(own_s).seconds;
        if after_alarm && (-DEAF_S..0.0).contains(&late_s) {
            return Some(Deviation::NoDeafness);
        }
        if stores(&line) && (-STORAGE_S..0.0).contains(&late_s) {
            return Some(Deviation::QuickStorage);
        }
        if allowed_s > 0.0 && late_s.abs() <= SAME_S + allowed_s {
            return Some(Deviation::ShortStops);
        }
        if self.exchange.is_dwelling(their.step) && late_s.abs() <= SAME_S + GRBL_DWELL_S {
            return Some(Deviation::PromptReports);
        }
        let is_soft_limit = our.text == "ALARM:2" || our.text == "[MSG:Reset to continue]";
        if late_s < 0.0 && is_soft_limit && is_arc(&line) {
            return Some(Deviation::ArcLimits);
        }
        if let Some(since_s) = self.homing_since(their.step)
            && late_s.abs() <= SAME_S + (their_s - since_s) * HOMING_SHARE
        {
            return Some(Deviation::HomingMotion);
        }
        if late_s < 0.0 && their.text == "ok" && self.follows_an_arc(their.step) {
            return Some(Deviation::Arcs);
        }
        if late_s < 0.0 && their.text == "ok" && self.exchange.is_after_speed(their.step) {
            return Some(Deviation::SpeedInMotion);
        }
        if late_s < 0.0 && their.text == "ok" && self.is_withheld_for_room(their.step) {
            return Some(Deviation::Buffers);
        }
        if (-SAME_S - self.exchange.ahead_s(their_s)..0.0).contains(&late_s) {
            return Some(Deviation::NoPause);
        }
        self.has_inverse_time_arc(their.step)
            .then_some(Deviation::InverseTimeArcs)
    }

    /// Whether Grbl's look-ahead may have been full of the chords of an arc.
    fn follows_an_arc(&self, step: usize) -> bool {
        (0..=step).any(|index| is_arc(&self.line_of(index)))
    }

    /// Whether Grbl's look-ahead may have been full of lines.
    fn is_withheld_for_room(&self, step: usize) -> bool {
        let moves = |line: &str| {
            (!line.starts_with('$') || line.starts_with("$J=")) && line.contains(['X', 'Y', 'Z'])
        };
        let lines = (0..=step).filter(|index| moves(&self.line_of(*index)));
        lines.count() > GRBL_BLOCKS
    }

    /// When the homing began that a step belongs to.
    fn homing_since(&self, step: usize) -> Option<f64> {
        let home = (0..=step)
            .rev()
            .find(|step| self.line_of(*step).starts_with("$H"))?;
        let answered = |index: usize| {
            let recv = &self.exchange.step(index)?.recv;
            recv.iter().any(|text| text == "ok").then_some(())
        };
        let is_over = (home..step).any(|index| answered(index).is_some());
        if is_over {
            None
        } else {
            self.exchange.step(home)?.t
        }
    }

    /// Whether an arc under `G93` came before, without a rest since.
    fn has_inverse_time_arc(&self, step: usize) -> bool {
        let mut is_inverse = false;
        let mut found = false;
        for index in 0..=step {
            let line = self.line_of(index);
            for number in sender::g_numbers(line.as_bytes()) {
                if number == 93.0 {
                    is_inverse = true;
                } else if number == 94.0 {
                    is_inverse = false;
                }
            }
            found |= is_inverse && is_arc(&line);
        }
        found
    }
}
