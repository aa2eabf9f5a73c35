//! The conversation with a machine at rest, before a job: what it is asked, and how it is brought to rest.

use std::{
    os::unix::net::UnixStream,
    time::{Duration, Instant},
};

use anstream::println;
use anyhow::{Context, Result, bail, ensure};
use leadscrew::gcode::LineError;

use simulation::machine_answers::MachineAnswers;

use crate::{
    link::{Link, Stopped},
    status::Status,
};

/// How often the state is asked for.
const ASK_EVERY: Duration = Duration::from_millis(200);
/// Silence after which nothing of an earlier conversation is on the line.
const SILENCE: Duration = Duration::from_millis(100);
/// Reports after which each field has been in one.
const REPORTS: usize = 40;
/// How long a machine may take to brake.
const BRAKE: Duration = Duration::from_secs(30);
/// How long it may search its switches.
const HOMING: Duration = Duration::from_mins(10);

/// The realtime bytes.
pub(crate) const REPORT: u8 = b'?';
pub(crate) const HOLD: u8 = b'!';
pub(crate) const RESET: u8 = 0x18;

/// A machine at the other end of a line.
pub(crate) struct Machine {
    pub(crate) link: Link,
    /// What it has reported last.
    pub(crate) status: Status,
    timeout: Duration,
    /// What becomes readable with Ctrl-C, which ends every wait.
    stop: UnixStream,
}

impl Machine {
    /// Waits until the machine answers.
    pub(crate) fn connect(link: Link, timeout: Duration, stop: &UnixStream) -> Result<Self> {
        let mut machine = Self {
            link,
            status: Status::default(),
            timeout,
            stop: stop.try_clone().context("cannot wait for Ctrl-C")?,
        };
        machine.report()?;
        while machine.line(SILENCE)?.is_some() {}
        Ok(machine)
    }

    /// Waits for the next line, or for Ctrl-C.
    fn line(&mut self, most: Duration) -> Result<Option<String>> {
        self.link.wait_for_line(most, &self.stop)
    }

    /// Asks for a report until there is one.
    fn report(&mut self) -> Result<()> {
        let start = Instant::now();
        while start.elapsed() < self.timeout {
            self.link.send(&[REPORT])?;
            let end = Instant::now() + ASK_EVERY;
            while let Some(line) = self.line(end.saturating_duration_since(Instant::now()))? {
                if self.status.read(&line) {
                    return Ok(());
                }
            }
        }
        let seconds = self.timeout.as_secs_f64();
        bail!(
            "the machine at {} has not answered for {seconds} s: {}",
            self.link.name,
            self.link.hint
        )
    }

    /// Sends a line, and returns what is answered before its `ok`, or the number of its error.
    fn try_ask(&mut self, text: &str, most: Duration) -> Result<Result<Vec<String>, u16>> {
        self.link.send(format!("{text}\n").as_bytes())?;
        let mut lines = Vec::new();
        let end = Instant::now() + most;
        while let Some(line) = self.line(end.saturating_duration_since(Instant::now()))? {
            if line == "ok" {
                return Ok(Ok(lines));
            }
            if let Some(number) = line.strip_prefix("error:") {
                return Ok(Err(number.parse().unwrap_or_default()));
            }
            ensure!(
                !line.starts_with("ALARM"),
                "{line} while {text} was executed"
            );
            lines.push(line);
        }
        bail!(
            "the machine has not answered {text} for {} s",
            most.as_secs_f64()
        )
    }

    /// The same for a line that may not be refused.
    fn ask(&mut self, text: &str, most: Duration) -> Result<Vec<String>> {
        match self.try_ask(text, most)? {
            Ok(lines) => Ok(lines),
            Err(number) => bail!(
                "the machine refuses {text}: error:{number}{}",
                meaning(number)
            ),
        }
    }

    /// Makes the machine ready for a job: homed or unlocked where that is asked for, at rest.
    ///
    /// # Errors
    /// It is in motion, in alarm, or in a hold.
    pub(crate) fn make_ready(&mut self, homes: bool) -> Result<()> {
        if homes {
            println!("The machine is homed: Ctrl-C stops it.");
            let homed = self.ask("$H", HOMING);
            if homed.as_ref().is_err_and(anyhow::Error::is::<Stopped>) {
                // A machine that homes takes no hold.
                self.link.send(&[RESET])?;
            }
            homed?;
            self.report()?;
        }
        match self.status.state.as_str() {
            "Idle" | "Check" => Ok(()),
            "Alarm" => bail!(
                "the machine is locked: --home homes it, or unlock it with $X if you know where it is"
            ),
            state => bail!("the machine is in the state {state}: a job begins at rest"),
        }
    }

    /// Brings a machine to rest that is still busy with an interrupted job, and resets it there, so that
    /// nothing of that job is left in it.
    pub(crate) fn come_to_rest(&mut self) -> Result<()> {
        // The last report may be from before its last lines, or between two of them.
        self.link.send(&[HOLD])?;
        let start = Instant::now();
        self.report()?;
        while !self.status.is_at_rest() {
            ensure!(
                start.elapsed() < BRAKE,
                "the machine does not come to rest: it is in the state {}",
                self.status.state
            );
            self.report()?;
        }
        self.link.send(&[RESET])?;
        let end = Instant::now() + self.timeout;
        while let Some(line) = self.line(end.saturating_duration_since(Instant::now()))? {
            if line.starts_with("Grbl") {
                while self.line(SILENCE)?.is_some() {}
                return self.report();
            }
        }
        bail!("the machine does not answer a reset")
    }

    /// Asks for everything that a job depends on.
    pub(crate) fn answers(&mut self) -> Result<MachineAnswers> {
        let timeout = self.timeout;
        let version = self.ask("$I", timeout)?;
        let settings = match self.try_ask("$+", timeout)? {
            Ok(lines) => lines,
            Err(_) => self.ask("$$", timeout)?,
        };
        let parameters = self.ask("$#", timeout)?;
        let tools = self.try_ask("$TT", timeout)?.unwrap_or_default();
        let modes = self.ask("$G", timeout)?;
        let mut reports = 0;
        // The offset between both is not in every report.
        while self.status.machine_position().is_none() || self.status.work_position().is_none() {
            reports += 1;
            ensure!(reports < REPORTS, "the machine does not tell its position");
            self.report()?;
        }
        let starting = |lines: Vec<String>, start: char| -> Vec<String> {
            lines
                .into_iter()
                .filter(|line| line.starts_with(start))
                .collect()
        };
        Ok(MachineAnswers {
            version: starting(version, '['),
            settings: starting(settings, '$'),
            parameters: starting(parameters, '['),
            tools: starting(tools, 'T'),
            modes: modes
                .into_iter()
                .find(|line| line.starts_with("[GC:"))
                .unwrap_or_default(),
            position: self.status.machine_position().unwrap_or_default(),
        })
    }
}

/// What an error number means, behind a comma.
pub(crate) fn meaning(number: u16) -> String {
    let mut errors = LineError::ALL.into_iter();
    let error = errors.find(|error| u16::from(error.number()) == number);
    error.map_or_else(String::new, |error| format!(", {}", error.text()))
}
