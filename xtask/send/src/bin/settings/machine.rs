//! A machine that answers lines: its state, its settings, and its refusals.

use std::time::{Duration, Instant};

use anyhow::{Error, Result, anyhow, ensure};
use leadscrew::{gcode::LineError, settings::StepRate};
use simulation::settings::{Dump, Entry};

use crate::link::Link;

/// How often the state is asked for until there is an answer: a board may start first.
const ASK_EVERY: Duration = Duration::from_millis(500);
/// Silence after which nothing of an earlier conversation is on the line.
const SILENCE: Duration = Duration::from_millis(100);

/// The end of an answer.
#[derive(Debug, Clone, Copy, PartialEq, Eq)]
pub(crate) enum Ending {
    /// `ok`.
    Accepted,
    /// `error:N`.
    Refused(u16),
}

/// A machine at the other end of a line.
pub(crate) struct Machine {
    link: Link,
}

impl Machine {
    /// Waits until the machine answers.
    pub(crate) fn connect(link: Link) -> Result<Self> {
        let mut machine = Self { link };
        let start = Instant::now();
        while machine.state()?.is_none() {
            let Link {
                timeout,
                name,
                hint,
                ..
            } = &machine.link;
            let seconds = timeout.as_secs_f64();
            ensure!(
                start.elapsed() < *timeout,
                "the machine at {name} has not answered for {seconds} s: {hint}"
            );
        }
        while machine.link.line(SILENCE)?.is_some() {}
        Ok(machine)
    }

    /// The state that a status report names; none when no report comes.
    fn state(&mut self) -> Result<Option<String>> {
        self.link.send(b"?")?;
        let end = Instant::now() + ASK_EVERY.min(self.link.timeout);
        while let Some(line) = self
            .link
            .line(end.saturating_duration_since(Instant::now()))?
        {
            if let Some(report) = line.strip_prefix('<') {
                let state = report.split(['|', ':', ',', '>']).next();
                return Ok(state.map(Into::into));
            }
        }
        Ok(None)
    }

    /// Sends a line, and returns what is answered before the end.
    pub(crate) fn ask(&mut self, text: &str) -> Result<(Vec<String>, Ending)> {
        self.link.send(format!("{text}\n").as_bytes())?;
        let mut lines = Vec::new();
        while let Some(line) = self.link.line(self.link.timeout)? {
            if line == "ok" {
                return Ok((lines, Ending::Accepted));
            }
            if let Some(number) = line.strip_prefix("error:") {
                let number = number.trim().parse().unwrap_or_default();
                return Ok((lines, Ending::Refused(number)));
            }
            // Messages and reports come at any time.
            ensure!(
                !line.starts_with("Grbl"),
                "the machine has been reset while {text} was sent: see --diff for its settings"
            );
            lines.push(line);
        }
        Err(self.silent(text))
    }

    /// The lines of the list of settings: all where the machine has a list of all.
    pub(crate) fn list(&mut self) -> Result<Vec<String>> {
        let (mut lines, mut ending) = self.ask("$+")?;
        if ending != Ending::Accepted {
            (lines, ending) = self.ask("$$")?;
        }
        if let Ending::Refused(number) = ending {
            return Err(self.refused("$$", number));
        }
        lines.retain(|line| line.starts_with('$') && line.contains('='));
        Ok(lines)
    }

    /// The settings that this tool knows.
    pub(crate) fn settings(&mut self) -> Result<Vec<Entry>> {
        Ok(Dump::read(&self.list()?.join("\n")).entries)
    }

    /// The step rate of the firmware; none of other firmware, which does not tell.
    pub(crate) fn step_rate(&mut self) -> Result<Option<StepRate>> {
        let (lines, _) = self.ask("$I")?;
        Ok(lines.iter().find_map(|line| step_rate(line)))
    }

    /// The error that tells of a refused line.
    pub(crate) fn refused(&mut self, text: &str, number: u16) -> Error {
        let state = self.state().ok().flatten().unwrap_or_default();
        match number {
            8 | 9 => anyhow!(
                "the machine takes no settings in the state {state} ({text}: error:{number})"
            ),
            number => anyhow!("{text}: error:{number}{}", meaning(number)),
        }
    }

    /// The error that tells of a machine that has not answered a line.
    fn silent(&mut self, text: &str) -> Error {
        let seconds = self.link.timeout.as_secs_f64();
        let silence = format!("the machine has not answered {text} for {seconds} s");
        match self.state().ok().flatten().as_deref() {
            Some("Alarm") => anyhow!(
                "the machine is in alarm and takes no lines before it is reset (Ctrl-X in a sender)"
            ),
            Some("Idle") | None => anyhow!("{silence}"),
            Some(state) => anyhow!("{silence}: it is in the state {state}"),
        }
    }
}

/// What an error number means, behind a comma.
pub(crate) fn meaning(number: u16) -> String {
    let mut errors = LineError::ALL.into_iter();
    let error = errors.find(|error| u16::from(error.number()) == number);
    error.map_or_else(String::new, |error| format!(", {}", error.text()))
}

/// The step rate in a line of `$I`.
fn step_rate(line: &str) -> Option<StepRate> {
    let rest = line.strip_prefix("[MSG:Step rate: ")?.strip_suffix(']')?;
    match rest.split_once(" Hz, ")? {
        (hz, "proven") => Some(StepRate::Proven(hz.parse().ok()?)),
        (_, "unproven") => Some(StepRate::Unproven),
        _ => None,
    }
}

#[cfg(test)]
mod tests {
    use super::*;

    #[test]
    fn the_step_rate_is_told_by_this_firmware_only() {
        for (line, rate) in [
            (
                "[MSG:Step rate: 200000 Hz, proven]",
                Some(StepRate::Proven(200_000)),
            ),
            (
                "[MSG:Step rate: 30000 Hz, unproven]",
                Some(StepRate::Unproven),
            ),
            ("[VER:1.1h.20190830:]", None),
            ("[MSG:Step rate: fast]", None),
        ] {
            assert_eq!(step_rate(line), rate, "{line}");
        }
    }

    #[test]
    fn a_known_error_is_told_with_its_meaning() {
        assert!(meaning(12).len() > 10);
        assert_eq!(meaning(999), "");
    }
}
