//! Stops and overrides in motion, after which the axes may be at another place than Grbl's.
//!
//! A hold or an override acts within milliseconds here and after up to 60 ms in Grbl; a reset
//! decelerates here. So after such a request the way differs by no more than what the axes travel in
//! that time, along the path, until both machines stand in the same place again.

use leadscrew::axis::AXES;

use super::{Exchange, Played, pairs::Paired};
use simulation::{
    machine::{Event, Pin},
    session::{
        step::{Act, Step},
        track::Track,
    },
};

/// How much later than ours Grbl acts on a hold: its segment buffer, and the look at the time, s.
const GRBL_HOLD_S: f64 = 0.08;
/// How long before and after a stop the direction of the path is looked at, s.
const DIRECTION_S: f64 = 0.03;

/// What a stop allows.
#[derive(Debug, Clone, Copy, Default, PartialEq)]
pub(super) struct Allowance {
    /// Distance, mm.
    pub(super) mm: f64,
    /// Time, s.
    pub(super) seconds: f64,
}

/// One stop.
#[derive(Debug, Clone, Copy)]
struct Stop {
    /// In our time.
    at_s: f64,
    allowance: Allowance,
    direction: [f64; AXES],
    /// When both machines stood in the same place again, in our time.
    until_s: f64,
}

/// Every stop of an exchange.
#[derive(Debug, Default)]
pub(super) struct Stops(Vec<Stop>);

/// What makes a stop.
#[derive(Debug, Clone, Copy, PartialEq)]
enum Cause {
    Hold,
    /// Grbl stops dead.
    Reset,
}

impl Stops {
    pub(super) fn of(exchange: &Exchange, played: &Played, reports: &[Paired]) -> Self {
        let mut causes = Vec::new();
        for (index, step) in exchange.session.steps().enumerate() {
            if let Some(cause) = cause(step) {
                causes.push((played.began_s[index], cause));
            }
        }
        for Event(time, name, _) in &played.signals {
            if name.starts_with("switch") {
                causes.push((*time, Cause::Hold));
            }
        }
        causes.extend(soft_limits(exchange, played).map(|at_s| (at_s, Cause::Hold)));
        for received in played
            .received
            .iter()
            .filter(|received| received.text.starts_with("ALARM:"))
        {
            if let Some(time_s) = received.time_s {
                causes.push((played.own_time_s(received.step, time_s), Cause::Reset));
            }
        }
        let scale = exchange.scale();
        let least = exchange.least_acceleration();
        let stops = causes.into_iter().filter_map(|(at_s, cause)| {
            let mut stop = stop(&played.track, at_s, cause, &scale, least)?;
            let mut same_again = reports
                .iter()
                .filter(|pair| pair.own_s > at_s && pair.stand_in_same_place);
            stop.until_s = same_again.next().map_or(f64::INFINITY, |pair| pair.own_s);
            Some(stop)
        });
        Self(stops.collect())
    }

    /// What the stops so far allow at a time of ours.
    pub(super) fn allowance(&self, own_s: f64) -> Allowance {
        let mut sum = Allowance::default();
        for stop in self.active(own_s) {
            sum.mm += stop.allowance.mm;
            sum.seconds += stop.allowance.seconds;
        }
        sum
    }

    fn active(&self, own_s: f64) -> impl Iterator<Item = &Stop> {
        let stops = self.0.iter();
        stops.filter(move |stop| stop.at_s <= own_s && own_s < stop.until_s)
    }

    /// Whether there is one between two times of ours.
    pub(super) fn any_between(&self, from_s: f64, to_s: f64) -> bool {
        let mut stops = self.0.iter();
        stops.any(|stop| stop.at_s > from_s && stop.at_s <= to_s)
    }

    /// Whether a displacement, mm, can come from the stops: not too far, and along the path.
    pub(super) fn explain(&self, own_s: f64, displacement: &[f64], step_mm: f64) -> bool {
        let allowed = self.allowance(own_s).mm;
        let length = norm(displacement);
        if allowed == 0.0 || length > allowed + step_mm {
            return false;
        }
        // Along the path of a stop, up to the bend of an arc over this length.
        let slack = step_mm * 2.0 + length * 0.1;
        self.active(own_s).any(|stop| {
            let along: f64 = (displacement.iter().zip(&stop.direction))
                .map(|(d, e)| d * e)
                .sum();
            let across = (displacement.iter().zip(&stop.direction))
                .map(|(d, e)| (d - along * e).powi(2))
                .sum::<f64>()
                .sqrt();
            across <= slack
        }) || self.active(own_s).count() > 1
    }
}

/// When lines were sent that leave the travel: the axes slow down before the alarm.
fn soft_limits(exchange: &Exchange, played: &Played) -> impl Iterator<Item = f64> {
    let alarms = played
        .received
        .iter()
        .filter(|received| received.text == "ALARM:2");
    alarms.filter_map(|received| {
        let line = (0..=received.step)
            .rev()
            .find(|step| exchange.step(*step).is_some_and(|step| step.line.is_some()))?;
        played.began_s.get(line).copied()
    })
}

fn cause(step: &Step) -> Option<Cause> {
    match step.act() {
        Ok(Act::Pin {
            pin: Pin::Reset,
            closed: true,
        }) => Some(Cause::Reset),
        Ok(Act::Pin { pin, closed }) if closed || pin == Pin::Probe => Some(Cause::Hold),
        _ => {
            let bytes = step.sends();
            if bytes.contains(&0x18) {
                Some(Cause::Reset)
            } else {
                let is_hold = |byte: &u8| matches!(byte, b'!' | 0x84 | 0x85 | 0x90..=0x97);
                bytes.iter().any(is_hold).then_some(Cause::Hold)
            }
        }
    }
}

/// The stop, if the machine moves then.
fn stop(
    track: &Track,
    at_s: f64,
    cause: Cause,
    scale: &[f64; AXES],
    least_mm_s2: f64,
) -> Option<Stop> {
    let samples = track.between(at_s - DIRECTION_S, at_s + DIRECTION_S);
    let (first, last) = (samples.first()?, samples.last()?);
    let mut direction = [0.0; AXES];
    for axis in 0..AXES {
        direction[axis] = f64::from(last.steps[axis] - first.steps[axis]) / scale[axis];
    }
    let length = norm(&direction);
    if length == 0.0 {
        return None;
    }
    for part in &mut direction {
        *part /= length;
    }
    let fastest = samples.iter().fold(0.0_f64, |fastest, sample| {
        fastest.max(f64::from(sample.feed_mm_min))
    });
    let speed = fastest / 60.0;
    let mut allowance = Allowance {
        mm: speed * GRBL_HOLD_S,
        seconds: 0.1,
    };
    if cause == Cause::Reset {
        allowance.mm += speed * speed / (2.0 * least_mm_s2);
        allowance.seconds += speed / least_mm_s2;
    }
    Some(Stop {
        at_s,
        allowance,
        direction,
        until_s: f64::INFINITY,
    })
}

fn norm(vector: &[f64]) -> f64 {
    vector.iter().map(|part| part * part).sum::<f64>().sqrt()
}
