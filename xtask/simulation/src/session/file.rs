//! Files of sessions.

use std::{fs, path::Path};

use anyhow::{Context, Result};
use common::ui;
use serde_json::Value;

use super::{Replayed, Session, replay};
use crate::output;

/// Replays every session of a file and writes them with what was received. Returns whether all
/// could be replayed.
pub fn replay_file(input: &Path, output: &Path) -> Result<bool> {
    let name = input.display();
    let text = fs::read(input).with_context(|| format!("cannot read the sessions {name}"))?;
    let form =
        || format!("{name} is no array of {{\"id\", \"settings\", \"transcript\": [step, …]}}");
    let sessions: Vec<Value> = serde_json::from_slice(&text).with_context(form)?;
    let sessions: Result<Vec<Session>> = sessions.iter().map(Session::read).collect();
    let sessions = sessions.with_context(form)?;
    let bar = output::progress(sessions.len() as u64, "sessions");
    let mut replayed = Vec::new();
    for session in sessions {
        replayed.push(replay(session));
        bar.inc(1);
    }
    bar.finish_and_clear();
    let mut all = true;
    for session in &replayed {
        for error in errors(session) {
            ui::warning(&format!("session {}: {error}", session.session.id));
            all = false;
        }
    }
    let replayed: Result<Vec<Value>> = replayed.iter().map(Replayed::to_json).collect();
    output::write_json(output, &replayed?)?;
    Ok(all)
}

/// What could not be replayed.
pub(super) fn errors(replayed: &Replayed) -> impl Iterator<Item = String> {
    let steps = replayed.session.steps().enumerate();
    let steps = steps.filter_map(|(index, step)| {
        let error = step.error.as_ref()?;
        Some(format!("step {}: {error}", index + 1))
    });
    replayed.results.error.clone().into_iter().chain(steps)
}
