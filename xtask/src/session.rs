//! Recorded exchanges, replayed in virtual time.
//!
//! The form of the files is fixed: other tools write and read it. A step is sent, and what arrives
//! until the next step belongs to it.

use std::{fs, path::Path};

use anyhow::{Context, Result, bail, ensure};
use leadscrew::settings::Settings;
use serde::{Deserialize, Serialize};
use serde_json::Value;

use crate::{machine::Machine, sender::Response, settings, ui};

/// How long a line is waited for that is never answered, s: while nothing moves, and at all.
const PATIENCE_S: f64 = 6.0;
const LONGEST_S: f64 = 60.0;
/// How long the machine runs between an answer and the next step, s.
const AFTER_ANSWER_S: f64 = 0.005;
/// How long it runs after a realtime byte or raw bytes, s.
const AFTER_BYTES_S: f64 = 0.02;
/// How often standstill is looked for, s, and how long bytes may be on their way.
const LOOK_S: f64 = 0.01;
/// How long the machine has for its welcome, s.
const POWER_UP_S: f64 = 0.1;
/// How long the end waits for standstill, s.
const END_S: f64 = 3.0;

/// One exchange.
#[derive(Debug, Deserialize)]
struct Session {
    id: Value,
    /// Settings stored before power-up.
    #[serde(default)]
    settings: Vec<String>,
    /// Switches that close at a position.
    #[serde(default)]
    switches: Vec<Value>,
    transcript: Vec<Step>,
}

/// One step: exactly one of its first fields.
#[derive(Debug, Clone, Default, Serialize, Deserialize)]
#[serde(default)]
struct Step {
    /// Sent with a line feed.
    #[serde(skip_serializing_if = "Option::is_none")]
    line: Option<String>,
    /// Sent as it is, hexadecimal.
    #[serde(skip_serializing_if = "Option::is_none")]
    raw: Option<String>,
    /// One byte, hexadecimal.
    #[serde(skip_serializing_if = "Option::is_none")]
    rt: Option<String>,
    /// Seconds to wait.
    #[serde(skip_serializing_if = "Option::is_none")]
    wait: Option<f64>,
    /// Wait for standstill, at most so many seconds.
    #[serde(skip_serializing_if = "Option::is_none")]
    idle: Option<f64>,
    /// An input and its level.
    #[serde(skip_serializing_if = "Option::is_none")]
    pin: Option<Value>,
    /// Recordings list what arrived at power-up as a first step.
    #[serde(skip_serializing_if = "Option::is_none")]
    boot: Option<Value>,
    /// Earliest time of the step, seconds from the first.
    #[serde(skip_serializing_if = "Option::is_none")]
    t: Option<f64>,
    /// Run this long before the next step, s.
    #[serde(skip_serializing_if = "Option::is_none")]
    after: Option<f64>,
    /// Do not wait for the answer.
    #[serde(skip_serializing_if = "Option::is_none")]
    nowait: Option<Value>,
    /// Lines that arrived, without line ends.
    #[serde(skip_deserializing)]
    recv: Vec<String>,
    /// When, seconds from the first step.
    #[serde(skip_deserializing)]
    recv_t: Vec<f64>,
    /// Why nothing was done.
    #[serde(skip_deserializing, skip_serializing_if = "Option::is_none")]
    error: Option<String>,
}

/// A session that was replayed.
#[derive(Debug, Serialize)]
struct Replayed {
    id: Value,
    settings: Vec<String>,
    switches: Vec<Value>,
    boot: Vec<String>,
    transcript: Vec<Step>,
    #[serde(rename = "final", skip_serializing_if = "Option::is_none")]
    end: Option<End>,
    /// Why not all of it could be replayed.
    #[serde(skip_serializing_if = "Option::is_none")]
    error: Option<String>,
}

/// Where the machine ended.
#[derive(Debug, Serialize)]
struct End {
    /// Grbl's number of the state.
    state: u8,
    mpos_steps: Vec<i32>,
    /// Whether it stood still.
    idle: bool,
}

/// Replays every session of a file and writes them with what was received. Returns whether all
/// could be replayed.
pub(crate) fn replay_file(input: &Path, output: &Path) -> Result<bool> {
    let name = input.display();
    let text = fs::read(input).with_context(|| format!("cannot read the sessions {name}"))?;
    let sessions: Vec<Session> = serde_json::from_slice(&text).with_context(|| {
        format!("{name} is no array of {{\"id\", \"settings\", \"transcript\": [step, …]}}")
    })?;
    let bar = ui::progress(sessions.len() as u64, "sessions");
    let mut replayed = Vec::new();
    for session in sessions {
        replayed.push(replay(session));
        bar.inc(1);
    }
    bar.finish_and_clear();
    let mut all = true;
    for session in &replayed {
        for error in errors(session) {
            ui::warning(&format!("session {}: {error}", session.id));
            all = false;
        }
    }
    crate::figures::write_json(output, &replayed)?;
    Ok(all)
}

/// What could not be replayed.
fn errors(session: &Replayed) -> impl Iterator<Item = String> {
    let steps = session.transcript.iter().enumerate();
    let steps = steps.filter_map(|(index, step)| {
        let error = step.error.as_ref()?;
        Some(format!("step {}: {error}", index + 1))
    });
    session.error.clone().into_iter().chain(steps)
}

fn replay(session: Session) -> Replayed {
    let mut replayed = Replayed {
        id: session.id,
        settings: session.settings,
        switches: session.switches,
        boot: Vec::new(),
        transcript: session.transcript,
        end: None,
        error: None,
    };
    if let Err(error) = run(&mut replayed) {
        replayed.error = Some(format!("{error:#}"));
    }
    replayed
}

/// Runs the steps that can be run; the others say why not.
fn run(session: &mut Replayed) -> Result<()> {
    let mut values = Settings::default();
    for assignment in &session.settings {
        settings::apply(&mut values, assignment)?;
    }
    if !session.switches.is_empty() {
        session.error = Some("switches are not simulated yet: these stay open".into());
    }
    let mut player = Player::new(&values);
    session.boot = player
        .take_lines()
        .into_iter()
        .map(|(_, text)| text)
        .collect();
    for step in &mut session.transcript {
        if step.boot.is_some() {
            step.recv.clone_from(&session.boot);
            continue;
        }
        match check(step) {
            Ok(()) => player.play(step),
            Err(error) => step.error = Some(format!("{error:#}")),
        }
        for (time, text) in player.take_lines() {
            step.recv_t.push((time * 1e4).round() / 1e4);
            step.recv.push(text);
        }
    }
    player.wait_for_standstill(END_S);
    let machine = &player.machine;
    session.end = Some(End {
        state: machine.state_number(),
        mpos_steps: machine.steps().to_vec(),
        idle: machine.stands_still(),
    });
    Ok(())
}

/// Refuses what cannot be replayed.
fn check(step: &Step) -> Result<()> {
    let kinds = [
        step.line.is_some(),
        step.raw.is_some(),
        step.rt.is_some(),
        step.wait.is_some(),
        step.idle.is_some(),
        step.pin.is_some(),
        step.boot.is_some(),
    ];
    match kinds.iter().filter(|there| **there).count() {
        1 => {}
        0 => bail!("it has none of line, raw, rt, wait, idle"),
        _ => bail!("it has more than one of line, raw, rt, wait, idle, pin"),
    }
    ensure!(step.pin.is_none(), "pins are not simulated yet");
    for seconds in [step.wait, step.idle, step.after, step.t]
        .into_iter()
        .flatten()
    {
        ensure!(
            (0.0..=1e6).contains(&seconds),
            "{seconds} is no time in seconds"
        );
    }
    if let Some(hexadecimal) = &step.raw {
        bytes(hexadecimal)?;
    }
    if let Some(hexadecimal) = &step.rt {
        ensure!(
            bytes(hexadecimal)?.len() == 1,
            "{hexadecimal:?} is not one byte"
        );
    }
    Ok(())
}

/// Reads hexadecimal bytes.
fn bytes(hexadecimal: &str) -> Result<Vec<u8>> {
    let digit = |byte: u8| {
        let value = char::from(byte).to_digit(16);
        value.with_context(|| format!("{hexadecimal:?} is not hexadecimal"))
    };
    let digits = hexadecimal.as_bytes();
    ensure!(
        digits.len().is_multiple_of(2),
        "{hexadecimal:?} has half a byte"
    );
    let pairs = digits.chunks_exact(2);
    pairs
        .map(|pair| Ok((digit(pair[0])? * 16 + digit(pair[1])?) as u8))
        .collect()
}

/// A machine and the lines it has sent.
struct Player {
    machine: Machine,
    /// When the first step began.
    start_s: f64,
    /// Complete lines that have not been taken, with their times from the first step.
    lines: Vec<(f64, String)>,
    /// The beginning of the next.
    line: Vec<u8>,
    /// Number of answers so far.
    answers: usize,
}

impl Player {
    /// Switches a machine on and lets it say so.
    fn new(settings: &Settings) -> Self {
        let mut player = Self {
            machine: Machine::new(settings),
            start_s: 0.0,
            lines: Vec::new(),
            line: Vec::new(),
            answers: 0,
        };
        player.run_for(POWER_UP_S);
        player.start_s = player.machine.now_s();
        player
    }

    /// Runs, and collects what arrives.
    fn run_for(&mut self, seconds: f64) {
        self.machine.run_for(seconds);
        for (time, byte) in self.machine.take_bytes() {
            match byte {
                b'\n' => {
                    let text = String::from_utf8_lossy(&self.line).into_owned();
                    self.answers += usize::from(Response::parse(&text).is_some());
                    self.lines.push((time - self.start_s, text));
                    self.line.clear();
                }
                b'\r' => {}
                byte => self.line.push(byte),
            }
        }
    }

    /// The lines since the last call.
    fn take_lines(&mut self) -> Vec<(f64, String)> {
        std::mem::take(&mut self.lines)
    }

    fn play(&mut self, step: &Step) {
        let ahead = self.start_s + step.t.unwrap_or(0.0) - self.machine.now_s();
        if ahead > 0.0 {
            self.run_for(ahead);
        }
        let nowait = step.nowait.as_ref().is_some_and(|value| !is_false(value));
        let mut after = 0.0;
        if let Some(line) = &step.line {
            self.machine.send(line.as_bytes());
            self.machine.send(b"\n");
            if !nowait {
                self.wait_for_answer();
                after = AFTER_ANSWER_S;
            }
        } else if let Some(hexadecimal) = step.raw.as_ref().or(step.rt.as_ref()) {
            self.machine.send(&bytes(hexadecimal).unwrap_or_default());
            after = AFTER_BYTES_S;
        } else if let Some(seconds) = step.wait {
            self.run_for(seconds);
        } else if let Some(seconds) = step.idle {
            self.wait_for_standstill(seconds);
        }
        self.run_for(step.after.unwrap_or(after));
    }

    /// Runs until an answer comes.
    fn wait_for_answer(&mut self) {
        let before = self.answers;
        let start = self.machine.now_s();
        while self.answers == before {
            let waited = self.machine.now_s() - start;
            if waited > LONGEST_S || (waited > PATIENCE_S && self.machine.stands_still()) {
                return;
            }
            self.run_for(0.000_1);
        }
    }

    fn wait_for_standstill(&mut self, most_s: f64) {
        let end = self.machine.now_s() + most_s;
        self.run_for(LOOK_S.min(most_s) * 3.0);
        while !self.machine.stands_still() && self.machine.now_s() < end {
            self.run_for(LOOK_S);
        }
    }
}

/// `nowait` may be written as a number or as a truth value.
fn is_false(value: &Value) -> bool {
    matches!(value, Value::Null | Value::Bool(false)) || value.as_f64() == Some(0.0)
}

#[cfg(test)]
mod tests {
    use super::*;

    fn step(json: &str) -> Result<()> {
        check(&serde_json::from_str::<Step>(json)?)
    }

    #[test]
    fn every_recorded_kind_of_step_is_read() {
        for json in [
            r#"{"line": "G0X1", "t": 0.5, "after": 0.1, "nowait": 1, "recv": ["ok"]}"#,
            r#"{"rt": "3f"}"#,
            r#"{"raw": "4730203f58310a", "recv_t": [0.1]}"#,
            r#"{"wait": 0.6}"#,
            r#"{"idle": 2}"#,
            r#"{"boot": true, "recv": ["", "Grbl"]}"#,
        ] {
            step(json).unwrap();
        }
    }

    #[test]
    fn a_step_that_cannot_be_replayed_says_why() {
        for (json, part) in [
            (r#"{"t": 1}"#, "none of"),
            (r#"{"line": "", "wait": 1}"#, "more than one"),
            (r#"{"pin": ["XLIM", 0]}"#, "pins"),
            (r#"{"rt": "3f21"}"#, "one byte"),
            (r#"{"raw": "3"}"#, "half"),
            (r#"{"raw": "zz"}"#, "hexadecimal"),
            (r#"{"wait": -1}"#, "no time"),
        ] {
            let error = step(json).unwrap_err().to_string();
            assert!(error.contains(part), "{json}: {error}");
        }
        assert_eq!(bytes("0aFf").unwrap(), [10, 255]);
    }
}
