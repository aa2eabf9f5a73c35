//! Spindle, laser, coolant and motor drivers against the recorded ones.

use leadscrew::model::State;

use super::{DEAF_S, Exchange, Played, stops::Stops};
use crate::{compare::Difference, deviation::Deviation};
use simulation::machine::Event;

/// Two times that are the same, s.
const SAME_S: f64 = 0.05;
/// How much later Grbl acts on an override of the spindle: its segment buffer, s.
const GRBL_SEGMENTS_S: f64 = 0.06;
/// How far two PWM values may be apart, of 255.
const PWM_SAME: i64 = 1;

/// A level over time: when each level begins, and the level.
type Levels = Vec<(f64, i64)>;

/// A signal's levels.
fn levels(events: &[Event], name: &str, shift_s: impl Fn(f64) -> f64) -> Levels {
    let mut levels: Levels = events
        .iter()
        .filter(|Event(_, known, _)| known == name)
        .map(|Event(time, _, value)| (shift_s(*time), *value))
        .collect();
    levels.dedup_by_key(|(_, value)| *value);
    levels
}

/// The power that reaches the spindle or the laser; negative when it turns the other way. Without
/// power, which way it would turn is nobody's business.
fn power(events: &[Event], shift_s: impl Fn(f64) -> f64) -> Levels {
    let (mut value, mut enabled, mut turned) = (0, 0, 0);
    let mut levels = Levels::new();
    for Event(time, name, level) in events {
        match name.as_str() {
            "spindle_pwm_value" => value = *level,
            "spindle_pwm_enabled" => enabled = *level,
            "spindle_dir_ccw" => turned = *level,
            _ => continue,
        }
        levels.push((shift_s(*time), value * enabled * (1 - 2 * turned)));
    }
    levels.dedup_by_key(|(_, value)| *value);
    levels
}

/// The levels between two times.
fn between(levels: &Levels, from_s: f64, to_s: f64) -> impl Iterator<Item = i64> {
    let first = levels.partition_point(|(time, _)| *time <= from_s);
    let end = levels.partition_point(|(time, _)| *time <= to_s);
    levels[first.saturating_sub(1)..end]
        .iter()
        .map(|(_, value)| *value)
}

/// Whether a level of theirs is one of ours at nearly the same time, or between two of them.
fn has(ours: &Levels, time_s: f64, tolerance_s: f64, theirs: i64, tolerance: i64) -> bool {
    let near: Vec<_> = between(ours, time_s - tolerance_s, time_s + tolerance_s).collect();
    match (near.iter().min(), near.iter().max()) {
        (Some(least), Some(most)) => (least - tolerance..=most + tolerance).contains(&theirs),
        _ => theirs == 0,
    }
}

pub(super) fn compare(
    exchange: &Exchange,
    played: &Played,
    stops: &Stops,
    found: &mut Vec<Difference>,
) {
    if exchange.signals.is_empty() {
        return;
    }
    // Our time to the recording's: by the step that was being played.
    let shift = |time: f64| {
        let step = played.began_s.partition_point(|began| *began <= time);
        time + played
            .shift_s
            .get(step.saturating_sub(1))
            .copied()
            .unwrap_or(0.0)
    };
    let own = |time: f64| time;
    let ours = |name: &str| levels(&played.signals, name, shift);
    let theirs = |name: &str| levels(&exchange.signals, name, own);
    let mut signals = vec![(
        "spindle power",
        power(&played.signals, shift),
        power(&exchange.signals, own),
        PWM_SAME,
    )];
    for name in ["coolant_flood", "steppers_disabled"] {
        signals.push((name, ours(name), theirs(name), 0));
    }
    for (name, ours, theirs, tolerance) in &signals {
        let first = first_difference(exchange, played, stops, (ours, theirs), *tolerance);
        if let Some((text, by_design)) = first {
            found.push(Difference {
                what: "output",
                text: format!("{name}: {text}"),
                by_design,
            });
        }
    }
}

/// The end of the recording of the outputs. A recording broke off early if it shows a spindle or coolant on that Grbl
/// reports as off.
fn recorded_until(exchange: &Exchange) -> f64 {
    let same = |time: f64| time;
    let is_on = |levels: Levels| levels.last().is_some_and(|(_, value)| *value != 0);
    let power = is_on(power(&exchange.signals, same));
    let flood = is_on(levels(&exchange.signals, "coolant_flood", same));
    let end = exchange.end.as_ref();
    let off = |group: usize| end.is_some_and(|end| end.modal.get(group) == Some(&0));
    let contradicts = (power && off(SPINDLE)) || (flood && off(COOLANT));
    let last_s = exchange.signals.last().map(|Event(at_s, ..)| *at_s);
    match last_s {
        Some(last_s) if contradicts => last_s,
        _ => exchange.end_s(),
    }
}

/// Places in the list of modes.
const COOLANT: usize = 8;
const SPINDLE: usize = 9;

/// Whether a laser is held at rest, at a time of ours.
fn is_dark_hold(exchange: &Exchange, played: &Played, own_s: f64) -> bool {
    let sample = played.track.at(own_s);
    exchange.is_laser() && sample.is_some_and(|sample| sample.state == State::HoldComplete)
}

/// The first time at which one of the two has a level that the other has not.
fn first_difference(
    exchange: &Exchange,
    played: &Played,
    stops: &Stops,
    (ours, theirs): (&Levels, &Levels),
    tolerance: i64,
) -> Option<(String, Option<Deviation>)> {
    let end_s = recorded_until(exchange);
    let mut excused = None;
    let mut changes: Vec<(f64, i64, bool)> = Vec::new();
    for (index, levels) in [ours, theirs].into_iter().enumerate() {
        for (position, (time, value)) in levels.iter().enumerate() {
            // A level that does not last cannot be told from none.
            let until = levels.get(position + 1).map_or(end_s, |(next, _)| *next);
            if *time >= 0.0 && *time < end_s && until - time > SAME_S {
                changes.push((*time, *value, index == 0));
            }
        }
    }
    changes.sort_by(|a, b| a.0.total_cmp(&b.0));
    for (time, value, is_ours) in changes {
        let other = if is_ours { theirs } else { ours };
        let has_override = tolerance == PWM_SAME && exchange.has_spindle_override(time);
        let lag_s = if has_override { GRBL_SEGMENTS_S } else { 0.0 };
        if has(other, time, SAME_S + lag_s, value, tolerance) {
            continue;
        }
        let step = exchange.step_at(time);
        let allowed = stops.allowance(played.own_time_s(step, time));
        let ahead_s = exchange.ahead_s(time);
        let is_deaf = exchange
            .alarms_s()
            .any(|alarm_s| (alarm_s..alarm_s + DEAF_S).contains(&time));
        if is_deaf && has(other, time, SAME_S + DEAF_S, value, tolerance) {
            let text = format!("{value} at {time:.3} s, with the alarm");
            excused.get_or_insert((text, Some(Deviation::NoDeafness)));
            continue;
        }
        if tolerance == PWM_SAME && is_dark_hold(exchange, played, played.own_time_s(step, time)) {
            let text = format!("{value} at {time:.3} s, in a hold");
            excused.get_or_insert((text, Some(Deviation::DarkHold)));
            continue;
        }
        let whose = ["Grbl's alone", "not Grbl's"][usize::from(is_ours)];
        let text = format!("{value} at {time:.3} s is {whose}");
        if has(
            other,
            time,
            SAME_S + allowed.seconds + ahead_s,
            value,
            tolerance,
        ) {
            let why = if allowed.mm > 0.0 {
                Deviation::ShortStops
            } else {
                Deviation::NoPause
            };
            excused.get_or_insert((text, Some(why)));
            continue;
        }
        if exchange.is_after_spindle_stop(step) {
            excused.get_or_insert((text, Some(Deviation::SpindleTime)));
            continue;
        }
        return Some((text, None));
    }
    excused
}
