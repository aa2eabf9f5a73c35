//! Recorded exchanges: single lines with their answers, and sessions with times.

mod end;
mod explain;
mod known;
mod outputs;
mod pairs;
mod reader;
mod received;
mod reports;
mod rules;
mod status;
mod stops;

use std::{fs, path::Path};

use anyhow::{Context, Result};
use leadscrew::{axis::AXES, model::Override};
use serde::Deserialize;
use serde_json::Value;

pub(super) use self::{
    rules::{differs_in_tool, tools},
    status::{Report, is_rounded_otherwise, is_tie},
};

use self::received::ReceivedLine;
use super::{compare::Difference, deviation::has_mist};
use simulation::{
    machine::Event,
    sender,
    session::{
        Session,
        player::{Patience, Player},
        state::End,
        step::{Act, Step},
        track::Track,
    },
};

/// A recorded exchange.
#[derive(Debug, Clone)]
pub(super) struct Exchange {
    /// `error_cases`, `transcripts`, or a topic of the repository's own.
    pub(super) category: String,
    /// Its name in the file.
    pub(super) name: String,
    session: Session,
    /// What Grbl said at power-up.
    boot: Vec<String>,
    /// The repository's own have none.
    end: Option<End>,
    /// What its outputs did; recordings of single lines have none.
    signals: Vec<Event>,
}

/// What every recording has beside its session.
#[derive(Debug, Deserialize)]
struct Recorded {
    #[serde(default)]
    boot: Vec<String>,
    #[serde(rename = "final")]
    end: Option<End>,
    #[serde(default)]
    aux_events: Vec<Event>,
}

/// The files and what is in them.
pub(super) const SUITES: [(&str, &str); 2] = [
    ("error_cases", "suites/grbl_error_cases.json"),
    ("transcripts", "suites/grbl_transcripts.json"),
];

/// Reads the suites that are there, or those of some categories.
pub(super) fn load(dir: &Path, categories: &[String]) -> Result<Vec<Exchange>> {
    let mut exchanges = Vec::new();
    for (category, file) in SUITES {
        let path = dir.join(file);
        let wanted = categories.is_empty() || categories.iter().any(|name| name == category);
        if !wanted || !path.exists() {
            continue;
        }
        let name = path.display();
        let text = fs::read(&path).with_context(|| format!("cannot read {name}"))?;
        let form = || format!("{name} has no recorded exchanges");
        let recorded: Vec<Value> = serde_json::from_slice(&text).with_context(form)?;
        for value in &recorded {
            exchanges.push(Exchange::read(category, value).with_context(form)?);
        }
    }
    Ok(exchanges)
}

impl Exchange {
    pub(super) fn read(category: &str, value: &Value) -> Result<Self> {
        let session = Session::read(value)?;
        let Recorded {
            mut boot,
            end,
            aux_events,
        } = Recorded::deserialize(value)?;
        if let Some(step) = session.steps().find(|step| step.boot.is_some()) {
            boot.clone_from(&step.recv);
        }
        let id = &session.id;
        Ok(Self {
            category: category.into(),
            name: id.as_str().map_or_else(|| id.to_string(), str::to_owned),
            session,
            boot,
            end,
            signals: aux_events,
        })
    }

    /// Whether the recording has times.
    fn is_timed(&self) -> bool {
        self.session.steps().any(|step| step.t.is_some())
    }

    /// The time limit for the answer to a line.
    ///
    /// Where Grbl answered a line, the limit exceeds Grbl's time, so that a late answer is not lost.
    fn patience(&self, step: &Step) -> Patience {
        if step
            .recv
            .iter()
            .any(|text| text == "ok" || text.starts_with("error:"))
        {
            return Patience {
                at_rest_s: 6.0,
                longest_s: 120.0,
            };
        }
        let is_arc = step.line.as_deref().is_some_and(has_arc);
        Patience::of(match (self.is_timed(), is_arc) {
            (true, _) => 6.0,
            (false, true) => 60.0,
            (false, false) => 4.0,
        })
    }

    /// Plays it and compares.
    ///
    /// # Errors
    /// The recording cannot be played.
    pub(super) fn replay(&self) -> Result<Vec<Difference>> {
        let played = Played::of(self)?;
        Ok(compare(self, &played))
    }

    /// What Grbl sent, in order.
    fn received(&self) -> Vec<ReceivedLine> {
        let steps = self.session.steps().enumerate();
        let steps = steps.filter(|(_, step)| step.boot.is_none());
        steps
            .flat_map(|(index, step)| {
                step.recv
                    .iter()
                    .enumerate()
                    .map(move |(line, text)| ReceivedLine {
                        step: index,
                        time_s: step.recv_t.get(line).copied(),
                        text: text.clone(),
                    })
            })
            .collect()
    }
}

/// What the comparisons ask of a recording.
impl Exchange {
    fn step(&self, index: usize) -> Option<&Step> {
        self.session.steps().nth(index)
    }

    /// Whether mist may have been switched before a step ends.
    fn has_mist(&self, until: usize) -> bool {
        self.session.steps().take(until + 1).any(|step| {
            let sent = step.sends();
            sent.contains(&(Override::Mist as u8)) || has_mist(&String::from_utf8_lossy(&sent))
        })
    }

    fn step_name(&self, index: usize) -> String {
        self.step(index).map_or_else(String::new, Step::name)
    }

    /// Steps per mm.
    fn scale(&self) -> [f64; AXES] {
        let settings = self.session.settings().unwrap_or_default();
        settings
            .steps_per_mm
            .0
            .map(|scale| scale.millionths() as f64 * 1e-6)
    }

    /// The least acceleration of an axis, mm/s².
    fn least_acceleration(&self) -> f64 {
        let settings = self.session.settings().unwrap_or_default();
        let accelerations = settings.acceleration_mm_s2.0.into_iter();
        accelerations.fold(f64::INFINITY, |least, one| least.min(f64::from(one)))
    }

    /// The step that was being played at a time of the recording.
    fn step_at(&self, time_s: f64) -> usize {
        let times = self.session.steps().map(|step| step.t.unwrap_or(0.0));
        times.take_while(|t| *t <= time_s).count().saturating_sub(1)
    }

    /// When the recording ended, about.
    fn end_s(&self) -> f64 {
        let last = self.session.steps().last();
        let received = self.received().last().and_then(|received| received.time_s);
        let begun = last.and_then(|step| step.t).unwrap_or(0.0);
        let after = last.and_then(|step| step.after).unwrap_or(0.0);
        (begun + after).max(received.unwrap_or(0.0))
    }

    /// When Grbl told an alarm, s.
    fn alarms_s(&self) -> impl Iterator<Item = f64> {
        let received = self.received().into_iter();
        received
            .filter(|received| received.text.starts_with("ALARM:"))
            .filter_map(|received| received.time_s)
    }

    /// How far ours may be ahead at a time: whenever a motion ends, Grbl waits for the delay of its
    /// drivers before it goes on. Counts the ends that follow each other without another wait.
    fn ahead_s(&self, time_s: f64) -> f64 {
        /// From the end of a motion to the beginning of the next that waited for it, s.
        const NEXT_S: f64 = 0.06;
        /// From the end of a motion to an answer that waited for it, s.
        const ANSWER_S: f64 = 0.1;
        let delay_ms = self.session.settings().unwrap_or_default().idle_delay_ms;
        if delay_ms == u8::MAX {
            return 0.0;
        }
        let drivers = self
            .signals
            .iter()
            .filter(|Event(at, name, _)| name == "steppers_disabled" && *at <= time_s + 0.03)
            .map(|Event(at, _, value)| (*at, *value));
        let mut ends = 0;
        let mut later_s = time_s;
        let mut most_s = ANSWER_S;
        for (at_s, value) in drivers.collect::<Vec<_>>().into_iter().rev() {
            if value == 1 {
                if later_s - at_s > most_s {
                    break;
                }
                ends += 1;
            } else {
                most_s = NEXT_S;
            }
            later_s = at_s;
        }
        f64::from(ends) * (f64::from(delay_ms) * 1e-3 + 0.005)
    }

    /// Whether the machine has resumed in a step, or before it without a rest since, with a spindle that Grbl had
    /// stopped in the hold and gives no time.
    fn is_after_spindle_stop(&self, step: usize) -> bool {
        let steps: Vec<_> = self.session.steps().take(step + 1).collect();
        let is_restored = |text: &String| text == "[MSG:Restoring spindle]";
        let resumed = steps
            .iter()
            .rposition(|step| step.sends().contains(&b'~') && step.recv.iter().any(is_restored));
        let standstill = steps.iter().rposition(|step| step.idle.is_some());
        !self.is_laser() && resumed.is_some() && (standstill < resumed || standstill == Some(step))
    }

    /// Whether a line up to a step has given a spindle another speed, without switching it.
    fn is_after_speed(&self, step: usize) -> bool {
        let lines = self.session.steps().take(step + 1);
        let has_speed =
            |line: &str| !line.starts_with('$') && line.contains('S') && !line.contains('M');
        !self.is_laser() && lines.filter_map(|step| step.line.as_deref()).any(has_speed)
    }

    /// Whether a dwell had begun before a step and no answer to it had come.
    fn is_dwelling(&self, step: usize) -> bool {
        let before = self.session.steps().take(step).collect::<Vec<_>>();
        let Some(dwell) = before.iter().rposition(|step| {
            step.line.as_deref().is_some_and(|line| {
                sender::g_numbers(&sender::code(line.as_bytes())).any(|number| number == 4.0)
            })
        }) else {
            return false;
        };
        !before[dwell..]
            .iter()
            .any(|step| step.recv.iter().any(|text| text == "ok"))
    }

    /// Whether Grbl had said `ALARM` and nothing about a reset since, or that less than 600 ms ago.
    fn is_after_alarm(&self, step: usize) -> bool {
        let received = self.received();
        let is_known = |text: &str| {
            received
                .iter()
                .filter(|h| h.step <= step)
                .rfind(|h| h.text.starts_with(text))
                .cloned()
        };
        let Some(alarm) = is_known("ALARM:") else {
            return false;
        };
        let welcomed = is_known("Grbl ").is_some_and(|welcome| {
            (welcome.step, welcome.time_s) > (alarm.step, alarm.time_s)
                && welcome.time_s < self.step(step).and_then(|step| step.t)
        });
        let is_recent = match (alarm.time_s, self.step(step).and_then(|step| step.t)) {
            (Some(alarm_s), Some(asked_s)) => asked_s - alarm_s < DEAF_S,
            _ => false,
        };
        let is_critical = alarm.text == "ALARM:1" || alarm.text == "ALARM:2";
        is_recent || (is_critical && !welcomed)
    }
}

/// How long Grbl does nothing after an alarm, and the reset that may follow, s.
const DEAF_S: f64 = 0.6;

/// Whether a line has a `G2` or a `G3`.
fn has_arc(line: &str) -> bool {
    sender::g_numbers(&sender::code(line.as_bytes())).any(|number| number == 2.0 || number == 3.0)
}

/// An exchange as our machine had it.
struct Played {
    boot: Vec<String>,
    received: Vec<ReceivedLine>,
    /// When each step began, from the first.
    began_s: Vec<f64>,
    /// From our time to the recording's, at each step.
    shift_s: Vec<f64>,
    track: Track,
    signals: Vec<Event>,
    end: End,
}

/// How long the end of a recording without times waited for standstill, s.
const END_S: f64 = 3.0;
/// How long ours waits where Grbl came to rest: an arc's `ok` comes at its beginning here.
const STANDSTILL_S: f64 = 120.0;

impl Played {
    fn of(exchange: &Exchange) -> Result<Self> {
        let session = &exchange.session;
        let is_timed = exchange.is_timed();
        let mut player = Player::new(session)?;
        let boot = player.take_lines();
        let mut received = Vec::new();
        let (mut began_s, mut shift_s) = (Vec::new(), Vec::new());
        for (index, step) in session.steps().enumerate() {
            let act = step.act()?;
            player.wait_for(step);
            let began = player.now_s();
            let shift = step.t.map_or(0.0, |recorded| recorded - began);
            began_s.push(began);
            shift_s.push(shift);
            if act == Act::Boot {
                continue;
            }
            player.play(step, &act, exchange.patience(step));
            received.extend(
                player
                    .take_lines()
                    .into_iter()
                    .map(|(time, text)| ReceivedLine {
                        step: index,
                        time_s: is_timed.then_some(time + shift),
                        text,
                    }),
            );
        }
        if !is_timed {
            let end = exchange.end.as_ref();
            let stands_still = end.is_some_and(|end| end.idle == Some(true));
            player.wait_for_standstill(if stands_still { STANDSTILL_S } else { END_S });
        }
        Ok(Self {
            boot: boot.into_iter().map(|(_, text)| text).collect(),
            received,
            began_s,
            shift_s,
            end: End::of(&player.machine),
            signals: player.signals(),
            track: player.into_track(),
        })
    }

    /// Our time of something in the recording's time, near a step.
    fn own_time_s(&self, step: usize, time_s: f64) -> f64 {
        time_s - self.shift_s.get(step).copied().unwrap_or(0.0)
    }
}

/// Every difference between a recording and what our machine did.
fn compare(exchange: &Exchange, played: &Played) -> Vec<Difference> {
    let mut found = Vec::new();
    if played.boot != exchange.boot {
        found.push(Difference {
            what: "power-up",
            text: format!("{:?}, Grbl {:?}", played.boot, exchange.boot),
            by_design: None,
        });
    }
    let (our_reports, our_lines): (Vec<_>, Vec<_>) = played
        .received
        .iter()
        .cloned()
        .partition(ReceivedLine::is_report);
    let (their_reports, their_lines): (Vec<_>, Vec<_>) = exchange
        .received()
        .into_iter()
        .partition(ReceivedLine::is_report);
    let pairs = pairs::pair(exchange, played, &our_reports, &their_reports);
    let stops = stops::Stops::of(exchange, played, &pairs);
    let comparison = explain::LineComparison::new(exchange, played, &stops);
    let diverged = comparison.lines(&our_lines, &their_lines, &mut found);
    if let Some(end) = &exchange.end {
        end::compare(exchange, (&played.end, end), &stops, &mut found);
    }
    // What the two machines do once they are in different places cannot be compared.
    let until = diverged.unwrap_or(usize::MAX);
    let is_before = |pair: &&pairs::Paired| pair.step < until;
    let pairs: Vec<_> = pairs.iter().filter(is_before).collect();
    reports::compare(exchange, played, &stops, &pairs, &mut found);
    if diverged.is_none() {
        outputs::compare(exchange, played, &stops, &mut found);
    }
    found
}

#[cfg(test)]
mod tests;
