//! Recorded exchanges, replayed in virtual time.
//!
//! The form of the files is fixed: other tools write and read it. A step is sent, and what arrives
//! until the next step belongs to it.

mod file;
pub mod player;
pub mod state;
pub mod step;
pub mod track;

use anyhow::{Result, ensure};
use leadscrew::{
    axis::AXES,
    settings::Settings,
    sim::{Closes, Switch},
};
use serde::{Deserialize, Serialize};
use serde_json::{Map, Value};

pub use self::file::replay_file;
use self::{
    player::{Patience, Player, rounded},
    state::End,
    step::{Act, Step},
};
use crate::{
    machine::{Event, Pin},
    proven, settings,
};

/// How long a line is waited for in a session with times, as its recorder did, s.
const RECORDER: Patience = Patience::of(6.0);
/// How long a line is waited for in a session without times, s.
const UNTIMED: Patience = Patience {
    at_rest_s: 6.0,
    longest_s: 60.0,
};
/// How long the end of a session without times waits for standstill, s.
const END_S: f64 = 3.0;

/// One exchange, as its file has it.
#[derive(Debug, Clone, Serialize, Deserialize)]
pub struct Session {
    /// What it is called.
    pub id: Value,
    /// Settings stored before power-up, beside those of the set.
    #[serde(default)]
    pub settings: Vec<String>,
    /// More of them.
    #[serde(default)]
    pub extra_settings: Vec<String>,
    /// A named set of settings.
    #[serde(default, skip_serializing_if = "Option::is_none")]
    pub settings_set: Option<String>,
    /// Whether nothing has ever been stored.
    #[serde(default)]
    pub virgin_eeprom: bool,
    /// Switches that close at a position: axis, direction, step, input.
    #[serde(default)]
    pub switches: Vec<(usize, f64, f64, String)>,
    /// The steps.
    #[serde(default, skip_serializing_if = "Vec::is_empty")]
    pub transcript: Vec<Step>,
    /// Recordings of single lines: what makes them ready.
    #[serde(default, skip_serializing_if = "Vec::is_empty")]
    pub setup_result: Vec<Step>,
    /// Recordings of single lines: the lines.
    #[serde(default, skip_serializing_if = "Vec::is_empty")]
    pub result: Vec<Step>,
    /// What else the file says.
    #[serde(skip)]
    pub other: Map<String, Value>,
}

/// A session that was replayed.
#[derive(Debug)]
struct Replayed {
    session: Session,
    results: Results,
}

/// What a replay adds to a session.
#[derive(Debug, Default, Serialize)]
struct Results {
    /// Lines that arrived at power-up.
    boot: Vec<String>,
    /// Where the machine ended.
    #[serde(rename = "final", skip_serializing_if = "Option::is_none")]
    end: Option<End>,
    /// Changes of outputs and switches.
    aux_events: Vec<Event>,
    /// Why not all of it could be replayed.
    #[serde(skip_serializing_if = "Option::is_none")]
    error: Option<String>,
}

impl Replayed {
    /// The session in its own shape, with what was received.
    fn to_json(&self) -> Result<Value> {
        let mut json = self.session.other.clone();
        for part in [
            serde_json::to_value(&self.session)?,
            serde_json::to_value(&self.results)?,
        ] {
            if let Value::Object(part) = part {
                json.extend(part);
            }
        }
        Ok(Value::Object(json))
    }
}

impl Session {
    /// Reads a session and keeps what it does not know.
    ///
    /// # Errors
    /// It has not the form of one.
    pub fn read(value: &Value) -> Result<Self> {
        // No `flatten`: it cannot read numbers that keep all their digits.
        let mut session = Self::deserialize(value)?;
        session.other = value.as_object().cloned().unwrap_or_default();
        Ok(session)
    }

    /// What is stored at power-up.
    pub fn settings(&self) -> Result<Settings> {
        let mut values = match &self.settings_set {
            Some(name) => settings::named_set(name)?,
            None => Settings::new(proven::committed()),
        };
        for assignment in self.settings.iter().chain(&self.extra_settings) {
            settings::apply(&mut values, assignment)?;
        }
        Ok(values)
    }

    /// The switches around the machine.
    pub fn switches(&self) -> Result<Vec<Switch>> {
        let switches = self.switches.iter();
        switches
            .map(|(axis, direction, threshold, pin)| {
                ensure!(
                    *axis < AXES,
                    "there is no axis {axis} for the switch {pin} (0 is X)"
                );
                let step = threshold.round() as i32;
                Ok(Switch {
                    axis: *axis,
                    closes: if *direction > 0.0 {
                        Closes::From(step)
                    } else {
                        Closes::DownFrom(step)
                    },
                    input: pin.parse::<Pin>()?.level(),
                })
            })
            .collect()
    }

    /// Every step, in order.
    pub fn steps_mut(&mut self) -> impl Iterator<Item = &mut Step> {
        let setup = self.setup_result.iter_mut();
        setup.chain(&mut self.result).chain(&mut self.transcript)
    }

    /// Every step, in order.
    pub fn steps(&self) -> impl Iterator<Item = &Step> {
        self.setup_result
            .iter()
            .chain(&self.result)
            .chain(&self.transcript)
    }
}

/// Replays one session: what makes a recording of it.
pub fn recorded(json: &str) -> Result<Value> {
    let value = serde_json::from_str(json)?;
    replay(Session::read(&value)?).to_json()
}

fn replay(session: Session) -> Replayed {
    let mut replayed = Replayed {
        session,
        results: Results::default(),
    };
    for name in ["final", "error"] {
        replayed.session.other.remove(name);
    }
    if let Err(error) = run(&mut replayed) {
        replayed.results.error = Some(format!("{error:#}"));
    }
    replayed
}

/// Runs the steps that can be run; the others say why not.
fn run(replayed: &mut Replayed) -> Result<()> {
    let Replayed { session, results } = replayed;
    let is_timed = session.steps().any(|step| step.t.is_some());
    let patience = if is_timed { RECORDER } else { UNTIMED };
    let mut player = Player::new(session)?;
    let boot = player.take_lines();
    results.boot = boot.into_iter().map(|(_, text)| text).collect();
    for step in session.steps_mut() {
        step.recv.clear();
        step.recv_t.clear();
        let act = match step.act() {
            Ok(act) => act,
            Err(error) => {
                step.error = Some(format!("{error:#}"));
                continue;
            }
        };
        if act == Act::Boot {
            step.recv.clone_from(&results.boot);
            continue;
        }
        player.wait_for(step);
        player.play(step, &act, patience);
        for (time, text) in player.take_lines() {
            step.recv_t.push(rounded(time));
            step.recv.push(text);
        }
    }
    if !is_timed {
        player.wait_for_standstill(END_S);
    }
    results.end = Some(End::of(&player.machine));
    results.aux_events = player.signals();
    Ok(())
}

#[cfg(test)]
mod tests {
    use super::*;

    fn replayed(json: &str) -> Replayed {
        replay(Session::read(&serde_json::from_str(json).unwrap()).unwrap())
    }

    #[test]
    fn a_session_is_replayed_in_its_own_shape() {
        let replayed = replayed(
            r#"{"id": "a", "note": "mine", "settings_set": "fast", "extra_settings": ["$13=0"],
                "transcript": [{"boot": true}, {"line": "G91 X1", "t": 0.0, "recv": ["no"]},
                {"idle": 2, "t": 0.1}, {"line": "G33", "t": 1}]}"#,
        );
        let json = replayed.to_json().unwrap();
        assert_eq!(json["note"], "mine");
        assert_eq!(json["transcript"][0]["recv"][1], "Grbl 1.1h ['$' for help]");
        assert_eq!(json["transcript"][1]["recv"][0], "ok");
        assert_eq!(json["transcript"][3]["recv"][0], "error:20");
        assert_eq!(json["final"]["mpos_steps"][0], 80);
        assert_eq!(json["final"]["parser_pos_mm"][0], 1.0);
        assert_eq!(json["final"]["modal"][3], 1);
        assert_eq!(json["final"]["idle"], true);
    }

    #[test]
    fn a_wait_ends_that_is_finer_than_the_clock() {
        for seconds in ["0.123456789", "0.000000004", "1e-10", "0"] {
            let waits = format!(
                r#"{{"id": "w", "transcript": [{{"line": "G91 X1"}}, {{"wait": {seconds}}}]}}"#
            );
            let json = replayed(&waits).to_json().unwrap();
            assert_eq!(json["final"]["mpos_steps"][0], 250);
        }
    }

    #[test]
    fn single_lines_are_replayed_too_and_a_bad_step_stops_nothing() {
        let replayed = replayed(
            r#"{"id": 1, "setup_result": [{"line": "G91"}],
                "result": [{"pin": ["KNOCK", 0]}, {"line": "G0X1"}, {"line": "X1"}]}"#,
        );
        assert_eq!(file::errors(&replayed).count(), 1);
        let json = replayed.to_json().unwrap();
        assert_eq!(json["result"][2]["recv"][0], "ok");
        assert_eq!(json["final"]["mpos_steps"][0], 500);
    }
}
