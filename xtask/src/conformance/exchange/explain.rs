//! Answers and messages against recorded ones.

use leadscrew::gcode::LineError;

use super::{
    DEAF_S, Exchange, Played,
    heard::{Heard, Pair, align},
    status::{is_rounded_otherwise, numbers},
    stops::Stops,
};
use crate::{
    conformance::{
        compare::Difference,
        deviation::{Deviation, of_answers},
    },
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
/// Part of the time of a homing cycle by which ours may differ.
const HOMING_SHARE: f64 = 0.35;

/// Compares lines and knows the excuses.
pub(super) struct Judge<'a> {
    exchange: &'a Exchange,
    played: &'a Played,
    stops: &'a Stops,
    theirs: Vec<Heard>,
}

impl<'a> Judge<'a> {
    pub(super) fn new(exchange: &'a Exchange, played: &'a Played, stops: &'a Stops) -> Self {
        Self {
            exchange,
            played,
            stops,
            theirs: exchange.heard(),
        }
    }

    /// Compares everything that is no report. Tells from which step on the machines are in
    /// different states by design.
    pub(super) fn lines(
        &self,
        ours: &[Heard],
        theirs: &[Heard],
        found: &mut Vec<Difference>,
    ) -> Option<usize> {
        let mut changed_at = None;
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
                    ("line", their.step, text, self.changed(our, their))
                }
                Pair::Ours(i, _) => {
                    let text = format!("`{}`, Grbl nothing", ours[i].text);
                    ("line", ours[i].step, text, self.surplus(&ours[i]))
                }
                Pair::Theirs(j, _) => {
                    let text = format!("nothing, Grbl `{}`", theirs[j].text);
                    ("line", theirs[j].step, text, self.missing(&theirs[j]))
                }
            };
            if by_design.is_some_and(Deviation::changes_state) {
                changed_at.get_or_insert(step);
            }
            let follows = || changed_at.map(|_| Deviation::Follows);
            let overflows = || {
                let may = self.exchange.may_overflow(step);
                may.then_some(Deviation::Buffers)
            };
            let by_design = by_design.or_else(follows).or_else(overflows);
            let name = self.exchange.step_name(step);
            found.push(Difference {
                what,
                text: format!("step {} {name}: {text}", step + 1),
                by_design,
            });
        }
        changed_at
    }

    fn line_of(&self, step: usize) -> String {
        let line = self.exchange.step(step).and_then(|step| step.line.clone());
        let code = sender::code(line.unwrap_or_default().as_bytes());
        String::from_utf8_lossy(&code).into_owned()
    }

    /// Another text in the same place.
    fn changed(&self, our: &Heard, their: &Heard) -> Option<Deviation> {
        let line = self.line_of(their.step);
        let their_ok = their.text == "ok";
        if is_build_options(&our.text, &their.text) {
            return Some(Deviation::Buffers);
        }
        if differs_in_tool(&our.text, &their.text) {
            return Some(Deviation::ToolIsModal);
        }
        if our.text.starts_with('[') && is_rounded_otherwise(&our.text, &their.text) {
            return Some(Deviation::Rounding);
        }
        if our.text.starts_with('[')
            && let Some(by) = displacement(&our.text, &their.text)
        {
            return self.why_elsewhere(our, &by);
        }
        if let Some(deviation) = homing(&line, our, their) {
            return Some(deviation);
        }
        if self.is_of_opened_limit(their) {
            return Some(Deviation::LimitOpens);
        }
        if let Some(deviation) = of_answers(&line, &our.text, &their.text) {
            return Some(deviation);
        }
        if their_ok && our.is_error(LineError::NoAxisWords) {
            let jog = line.strip_prefix("$J=");
            let has_none = jog.is_some_and(|jog| !jog.contains(['X', 'Y', 'Z', 'A', 'B', 'C']));
            return has_none.then_some(Deviation::JogWithoutAxes);
        }
        if their_ok && line.starts_with("$N") && our.is_error(LineError::InvalidStatement) {
            let exists = line.starts_with("$N0=") || line.starts_with("$N1=");
            return (!exists).then_some(Deviation::StartupLines);
        }
        if their_ok && our.is_error(LineError::InvalidTarget) {
            return self.is_far(&line).then_some(Deviation::FarTargets);
        }
        if their_ok && our.is_error(LineError::StepRateTooHigh) {
            let is_rate = ["$10", "$11"].iter().any(|name| line.starts_with(name));
            return is_rate.then_some(Deviation::StepRates);
        }
        // `$0=256` is 0 for Grbl.
        let is_taken = their_ok || their.is_error(LineError::StepPulseTooShort);
        if is_taken && is_setting_out_of_range(&line) {
            let refused = [LineError::NegativeValue, LineError::SettingOutOfRange];
            let is_refused = refused.into_iter().any(|error| our.is_error(error));
            return is_refused.then_some(Deviation::SettingRanges);
        }
        // The list of settings shows what Grbl stored.
        let same_setting = |text: &str| text.split_once('=').map(|(name, _)| name.to_owned());
        if our.text.starts_with('$') && same_setting(&our.text) == same_setting(&their.text) {
            let name = same_setting(&our.text)?;
            let before = (0..their.step).map(|step| self.line_of(step));
            let was_cut = before
                .filter(|line| line.starts_with(&format!("{name}=")))
                .any(|line| is_setting_out_of_range(&line));
            return was_cut.then_some(Deviation::SettingRanges);
        }
        None
    }

    /// Other coordinates in a message: those of a place that a stop or a failed homing has changed.
    fn why_elsewhere(&self, our: &Heard, by: &[f64]) -> Option<Deviation> {
        if self.exchange.has_failed_homing(our.step) {
            return Some(Deviation::HomingMotion);
        }
        let own_s = our
            .time_s
            .map_or(f64::MAX, |time_s| self.played.own_time_s(our.step, time_s));
        let is_stop = self.stops.explain(own_s, by, self.exchange.step_mm());
        is_stop.then_some(Deviation::ShortStops)
    }

    /// Whether this is the alarm of a limit switch that opens.
    fn is_of_opened_limit(&self, their: &Heard) -> bool {
        let opened = self.exchange.step(their.step).map(Step::act);
        let is_limit = matches!(
            opened,
            Some(Ok(Act::Pin {
                pin: Pin::Limit(_),
                closed: false
            }))
        );
        is_limit && their.text == "ALARM:1"
    }

    /// Grbl alone said something.
    fn missing(&self, their: &Heard) -> Option<Deviation> {
        if self.is_of_opened_limit(their) {
            return Some(Deviation::LimitOpens);
        }
        // A line that waited for room when a reset came.
        let is_full = self.exchange.may_fill_plan(their.step);
        (is_full && their.text == "ok").then_some(Deviation::Buffers)
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
    fn surplus(&self, our: &Heard) -> Option<Deviation> {
        let line = self.line_of(our.step);
        let recorded = self.exchange.step(our.step)?;
        let unanswered = !recorded
            .recv
            .iter()
            .any(|text| text == "ok" || text.starts_with("error:"));
        if unanswered && our.text == "ok" && is_arc(&line) {
            return Some(Deviation::Arcs);
        }
        if line.starts_with("$H") && our.text == "[MSG:Check Limits]" {
            return Some(Deviation::ClosedSwitch);
        }
        if our.text == "ok" && self.exchange.may_fill_plan(our.step) {
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
    fn time(&self, our: &Heard, their: &Heard) -> Option<(String, Option<Deviation>)> {
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

    fn why_at_another_time(&self, our: &Heard, their: &Heard, late_s: f64) -> Option<Deviation> {
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
        if let Some(since_s) = self.homing_since(their.step)
            && late_s.abs() <= SAME_S + (their_s - since_s) * HOMING_SHARE
        {
            return Some(Deviation::HomingMotion);
        }
        if late_s < 0.0 && their.text == "ok" && self.is_withheld_for_room(their.step) {
            return Some(Deviation::Arcs);
        }
        if late_s < 0.0 && their.text == "ok" && self.exchange.may_fill_plan(their.step) {
            return Some(Deviation::Buffers);
        }
        if self.exchange.is_dwelling(their.step) && late_s.abs() <= SAME_S + GRBL_DWELL_S {
            return Some(Deviation::PromptReports);
        }
        let is_soft_limit = our.text == "ALARM:2" || our.text == "[MSG:Reset to continue]";
        if late_s < 0.0 && is_soft_limit && is_arc(&line) {
            return Some(Deviation::ArcLimits);
        }
        if (-SAME_S - self.exchange.ahead_s(their_s)..0.0).contains(&late_s) {
            return Some(Deviation::NoPause);
        }
        self.has_inverse_time_arc(their.step)
            .then_some(Deviation::InverseTimeArcs)
    }

    /// Whether Grbl's look-ahead may have been full of the chords of an arc.
    fn is_withheld_for_room(&self, step: usize) -> bool {
        (0..=step).any(|index| is_arc(&self.line_of(index)))
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

/// `$H` where ours refuses it, or homes and Grbl does not.
fn homing(line: &str, our: &Heard, their: &Heard) -> Option<Deviation> {
    let axis = line.strip_prefix("$H")?;
    if our.is_error(LineError::LimitsEngaged) || our.text == "[MSG:Check Limits]" {
        return Some(Deviation::ClosedSwitch);
    }
    let is_axis = ["X", "Y", "Z"].contains(&axis);
    (is_axis && their.is_error(LineError::InvalidStatement)).then_some(Deviation::SingleAxes)
}

/// How far the coordinates of two messages of one kind are apart, mm; in inches, what that is.
fn displacement(ours: &str, theirs: &str) -> Option<Vec<f64>> {
    let read = |text: &str| -> Option<(String, Vec<f64>, f64)> {
        let (name, rest) = text.strip_prefix('[')?.strip_suffix(']')?.split_once(':')?;
        let is_place = name.starts_with('G') && name != "GC" || name == "PRB" || name == "TLO";
        let (rest, result) = rest.split_once(':').unwrap_or((rest, ""));
        let decimals = rest.rsplit_once('.')?.1.len();
        let unit_mm = if decimals == 4 { 25.4 } else { 1.0 };
        is_place.then(|| numbers(rest).map(|at| (format!("{name}{result}"), at, unit_mm)))?
    };
    let (our_name, ours, _) = read(ours)?;
    let (their_name, theirs, unit_mm) = read(theirs)?;
    let is_same = our_name == their_name && ours.len() == theirs.len();
    is_same.then(|| {
        (ours.iter().zip(&theirs))
            .map(|(a, b)| (a - b) * unit_mm)
            .collect()
    })
}

/// `[OPT:…]` with Grbl's letters and more, and larger buffers.
fn is_build_options(ours: &str, theirs: &str) -> bool {
    let read = |text: &str| -> Option<(String, u32, u32)> {
        let inner = text.strip_prefix("[OPT:")?.strip_suffix(']')?.to_owned();
        let mut parts = inner.split(',');
        let letters = parts.next()?.to_owned();
        let (blocks, bytes) = (parts.next()?.parse().ok()?, parts.next()?.parse().ok()?);
        parts.next().is_none().then_some((letters, blocks, bytes))
    };
    match (read(ours), read(theirs)) {
        (Some((ours, blocks, bytes)), Some((theirs, their_blocks, their_bytes))) => {
            theirs.chars().all(|letter| ours.contains(letter))
                && blocks >= their_blocks
                && bytes >= their_bytes
        }
        _ => false,
    }
}

/// Two `$G` that differ in nothing but a `T0` of Grbl's.
pub(in crate::conformance) fn differs_in_tool(ours: &str, theirs: &str) -> bool {
    let without_tool = |text: &str| -> Option<(String, String)> {
        let words = text.strip_prefix("[GC:")?.split(' ');
        let (tool, rest): (Vec<_>, Vec<_>) = words.partition(|word| word.starts_with('T'));
        Some((rest.join(" "), tool.concat()))
    };
    match (without_tool(ours), without_tool(theirs)) {
        (Some((ours, tool)), Some((theirs, their_tool))) => {
            ours == theirs && their_tool == "T0" && tool != "T0"
        }
        _ => false,
    }
}

/// Whether a line moves along an arc: only those have a centre or a radius.
fn is_arc(line: &str) -> bool {
    !line.starts_with('$') && line.contains(['I', 'J', 'K', 'R'])
}

/// Whether Grbl writes its EEPROM for a line.
fn stores(line: &str) -> bool {
    let g = |wanted: f64| sender::g_numbers(line.as_bytes()).any(|number| number == wanted);
    match line.strip_prefix('$') {
        Some(statement) => statement.contains('=') && !statement.starts_with("J="),
        None => g(10.0) || g(28.1) || g(30.1),
    }
}

/// Whether a line sets what Grbl stores and makes no sense: no steps, no speed, no acceleration,
/// no travel, or an integer that does not fit.
fn is_setting_out_of_range(line: &str) -> bool {
    let Some((number, value)) = line
        .strip_prefix('$')
        .and_then(|statement| statement.split_once('='))
    else {
        return false;
    };
    let (Ok(number), Ok(value)) = (number.parse::<u16>(), value.parse::<f64>()) else {
        return false;
    };
    match number {
        100..=135 | 24 | 25 => value <= 0.0,
        0..=10 | 23 | 26 => value > 255.0,
        _ => false,
    }
}

#[cfg(test)]
mod tests {
    use super::*;

    #[test]
    fn only_larger_buffers_are_excused() {
        assert!(is_build_options("[OPT:VNM,127,1024]", "[OPT:V,15,128]"));
        assert!(!is_build_options("[OPT:VNM,14,1024]", "[OPT:V,15,128]"));
        assert!(!is_build_options("[OPT:N,127,1024]", "[OPT:V,15,128]"));
        assert!(!is_build_options("[OPT:V,127]", "[OPT:V,15,128]"));
    }

    #[test]
    fn only_a_kept_tool_is_excused() {
        assert!(differs_in_tool("[GC:G0 M5 T3 F0]", "[GC:G0 M5 T0 F0]"));
        assert!(!differs_in_tool("[GC:G0 M5 T0 F0]", "[GC:G0 M5 T3 F0]"));
        assert!(!differs_in_tool("[GC:G1 M5 T3 F0]", "[GC:G0 M5 T0 F0]"));
        assert!(!differs_in_tool("ok", "ok"));
    }

    #[test]
    fn only_senseless_settings_are_excused() {
        for line in ["$100=0", "$110=0", "$122=0.0", "$1=256", "$26=300"] {
            assert!(is_setting_out_of_range(line), "{line}");
        }
        for line in ["$100=80", "$1=255", "$30=1000", "$27=0", "$N0=G0", "$11=0"] {
            assert!(!is_setting_out_of_range(line), "{line}");
        }
    }

    #[test]
    fn what_takes_grbl_long_is_known() {
        for line in ["$110=5", "$N0=G20", "$RST=*", "$I=x", "G10L2P1X1", "G28.1"] {
            assert!(stores(line), "{line}");
        }
        for line in ["$J=X1F100", "$$", "G28", "G0X1"] {
            assert!(!stores(line), "{line}");
        }
    }
}
