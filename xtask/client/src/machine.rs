//! The conversation with a machine: it is asked, and what it answers is waited for.

use std::{
    os::unix::net::UnixStream,
    time::{Duration, Instant},
};

use anyhow::{Context, Error, Result, anyhow, bail};

use crate::{Line, Link, MachineAnswers, Response, Status, meaning, realtime};

/// How often the state is asked for until there is an answer: a board may start first.
const REPORT_INTERVAL: Duration = Duration::from_millis(200);
/// Silence after which nothing of an earlier conversation is on the line.
const SILENCE: Duration = Duration::from_millis(100);
/// How long such a silence is waited for: a machine may tell something all the time.
const MAX_SILENCE_WAIT: Duration = Duration::from_secs(1);
/// Reports after which each field has been in one.
const REPORTS: usize = 40;

/// Errors whose reason is the state: it is not idle, it is locked.
const ERROR_NOT_IDLE: u16 = 8;
const ERROR_LOCKED: u16 = 9;

/// A machine at the other end of a line.
pub struct Machine {
    /// The line.
    pub link: Link,
    /// What it has reported last.
    pub status: Status,
    /// How long it may be silent.
    pub timeout: Duration,
    /// What becomes readable with Ctrl-C, which ends every wait.
    stop: Option<UnixStream>,
}

/// What a machine says to a statement.
#[derive(Debug)]
pub struct Answer {
    /// What comes before the response.
    pub lines: Vec<String>,
    /// The response.
    pub response: Response,
}

impl Answer {
    /// The lines; none of a statement that was refused.
    #[must_use]
    pub fn accepted(self) -> Option<Vec<String>> {
        (self.response == Response::Ok).then_some(self.lines)
    }
}

impl Machine {
    /// Waits until the machine answers. What can be read from `stop` ends this wait and every later one.
    ///
    /// # Errors
    /// It does not answer, or [the line](Link::wait_for_line) breaks.
    pub fn connect(link: Link, timeout: Duration, stop: Option<&UnixStream>) -> Result<Self> {
        let stop = stop.map(UnixStream::try_clone).transpose();
        let mut machine = Self {
            link,
            status: Status::default(),
            timeout,
            stop: stop.context("cannot wait for Ctrl-C")?,
        };
        machine.report()?;
        machine.fall_silent()?;
        Ok(machine)
    }

    /// Asks for a report until there is one.
    ///
    /// # Errors
    /// None comes in time, or [the line](Link::wait_for_line) breaks.
    pub fn report(&mut self) -> Result<()> {
        let start = Instant::now();
        while start.elapsed() < self.timeout {
            if self.is_reported()? {
                return Ok(());
            }
        }
        let seconds = self.timeout.as_secs_f64();
        let Link { name, hint, .. } = &self.link;
        bail!("the machine at {name} has not answered for {seconds} s: {hint}")
    }

    /// Sends a statement, and returns what is answered; `most` is how long the machine may say nothing of it.
    ///
    /// # Errors
    /// It is silent, in an alarm or reset, or [the line](Link::wait_for_line) breaks.
    pub fn ask(&mut self, text: &str, most: Duration) -> Result<Answer> {
        self.link.send(format!("{text}\n").as_bytes())?;
        let mut lines = Vec::new();
        let mut end = Instant::now() + most;
        while let Some(line) = self.line_until(end)? {
            match Line::read(&line) {
                Line::Response(response) => return Ok(Answer { lines, response }),
                Line::Report(report) => self.status.take(report),
                Line::Alarm(number) => {
                    let why = meaning::alarm_with_remedy(number, None);
                    let why = meaning::after_comma(why.as_deref());
                    bail!("{line} while {text} was executed{why}")
                }
                Line::Welcome => bail!("the machine has been reset while {text} was sent"),
                // What a machine may tell all the time is no sign that it still answers.
                Line::Other => lines.push(line),
                _ => {
                    lines.push(line);
                    end = Instant::now() + most;
                }
            }
        }
        Err(self.silent(text, most))
    }

    /// The same for a statement that may not be refused.
    ///
    /// # Errors
    /// It is refused, or as [`ask`](Self::ask).
    pub fn ask_for(&mut self, text: &str, most: Duration) -> Result<Vec<String>> {
        let Answer { lines, response } = self.ask(text, most)?;
        match response {
            Response::Ok => Ok(lines),
            Response::Error(number) => Err(self.refused(text, number)),
        }
    }

    /// The error that tells of a refused statement: with the state, where that is the reason.
    pub fn refused(&mut self, text: &str, number: u16) -> Error {
        let is_by_state = matches!(number, ERROR_NOT_IDLE | ERROR_LOCKED);
        let state = if is_by_state && self.is_reported().unwrap_or_default() {
            format!(" in the state {}", self.status.report.state)
        } else {
            String::new()
        };
        let why = meaning::after_comma(meaning::error_with_remedy(number).as_deref());
        anyhow!("the machine refuses {text}{state}: error:{number}{why}")
    }

    /// Resets the machine, and waits until it answers again.
    ///
    /// # Errors
    /// It does not, or [the line](Link::wait_for_line) breaks.
    pub fn reset(&mut self) -> Result<()> {
        self.link.send(&[realtime::RESET])?;
        let end = Instant::now() + self.timeout;
        while let Some(line) = self.line_until(end)? {
            if Line::read(&line) == Line::Welcome {
                self.fall_silent()?;
                return self.report();
            }
        }
        bail!("the machine does not answer a reset")
    }

    /// The lines of the list of settings: all where the machine has a list of all.
    ///
    /// # Errors
    /// There is none, or as [`ask`](Self::ask).
    pub fn settings(&mut self) -> Result<Vec<String>> {
        let timeout = self.timeout;
        let mut lines = match self.ask("$+", timeout)?.accepted() {
            Some(lines) => lines,
            None => self.ask_for("$$", timeout)?,
        };
        lines.retain(|line| line.starts_with('$') && line.contains('='));
        Ok(lines)
    }

    /// Asks for everything that a job depends on.
    ///
    /// # Errors
    /// The machine refuses one of the questions that Grbl answers, or as [`ask`](Self::ask).
    pub fn answers(&mut self) -> Result<MachineAnswers> {
        let timeout = self.timeout;
        let starting = |mut lines: Vec<String>, start: char| {
            lines.retain(|line| line.starts_with(start));
            lines
        };
        let is_modes = |line: &String| matches!(Line::read(line), Line::Answer("GC", _));
        let version = starting(self.ask_for("$I", timeout)?, '[');
        let settings = self.settings()?;
        let parameters = starting(self.ask_for("$#", timeout)?, '[');
        let tools = self.ask("$TT", timeout)?.accepted();
        let modes = self.ask_for("$G", timeout)?.into_iter().find(is_modes);
        // The offset between both positions is not in every report.
        for _ in 0..REPORTS {
            let position = self.status.machine_position();
            if let (Some(position), Some(_)) = (position, self.status.work_position()) {
                return Ok(MachineAnswers {
                    version,
                    settings,
                    parameters,
                    tools: starting(tools.unwrap_or_default(), 'T'),
                    modes: modes.unwrap_or_default(),
                    position,
                });
            }
            self.report()?;
        }
        bail!("the machine does not tell its position")
    }

    /// Asks for a report once. Returns whether it has come.
    fn is_reported(&mut self) -> Result<bool> {
        self.link.send(&[realtime::REPORT])?;
        let end = Instant::now() + REPORT_INTERVAL.min(self.timeout);
        while let Some(line) = self.line_until(end)? {
            if self.status.read(&line) {
                return Ok(true);
            }
        }
        Ok(false)
    }

    /// Waits until nothing comes any more.
    fn fall_silent(&mut self) -> Result<()> {
        let start = Instant::now();
        while self.line_until(Instant::now() + SILENCE)?.is_some()
            && start.elapsed() < MAX_SILENCE_WAIT
        {}
        Ok(())
    }

    fn line_until(&mut self, end: Instant) -> Result<Option<String>> {
        let most = end.saturating_duration_since(Instant::now());
        self.link.wait_for_line(most, self.stop.as_ref())
    }

    /// The error that tells of a machine that has not answered a statement.
    fn silent(&mut self, text: &str, most: Duration) -> Error {
        let seconds = most.as_secs_f64();
        let silence = format!("the machine has not answered {text} for {seconds} s");
        let is_reported = self.is_reported().unwrap_or_default();
        let report = is_reported.then_some(&self.status.report);
        match report.map(|report| (report.state_name(), &report.state)) {
            Some(("Alarm", _)) => anyhow!(
                "the machine is in alarm and takes no lines before it is reset (Ctrl-X in a sender)"
            ),
            Some(("Idle", _)) | None => anyhow!("{silence}"),
            Some((_, state)) => anyhow!("{silence}: it is in the state {state}"),
        }
    }
}

#[cfg(test)]
mod tests {
    use std::{
        io::{Read as _, Write as _},
        thread,
    };

    use super::*;

    const SHORT: Duration = Duration::from_millis(300);

    /// A machine that answers each statement, and `?` and a reset as bytes.
    fn machine(answer: fn(&str) -> &'static str) -> Machine {
        let (own, mut other) = UnixStream::pair().unwrap();
        thread::spawn(move || {
            let mut line = String::new();
            let mut byte = [0];
            while let Ok(1) = other.read(&mut byte) {
                let answer = match byte[0] {
                    b'?' | realtime::RESET => answer(str::from_utf8(&byte).unwrap()),
                    b'\n' => answer(&std::mem::take(&mut line)),
                    byte => {
                        line.push(char::from(byte));
                        continue;
                    }
                };
                if other.write_all(answer.as_bytes()).is_err() {
                    break;
                }
            }
        });
        let link = Link::over(&own, "here".into(), "is it there?".into()).unwrap();
        Machine::connect(link, SHORT, None).unwrap()
    }

    /// Lines of Grbl 1.1, which has no `$+`.
    fn grbl(text: &str) -> &'static str {
        match text {
            "?" => "<Idle|MPos:1.000,0.000,0.000|FS:0,0|WCO:0.500,0.000,0.000>\r\n",
            "\x18" => "\r\nGrbl 1.1h ['$' for help]\r\n",
            "$$" => "$0=10\r\n$1=25\r\n<Run|MPos:2.000,0.000,0.000|FS:0,0>\r\nok\r\n",
            "$H" => "ALARM:9\r\n",
            "$X" => "[MSG:Caution: Unlocked]\r\nok\r\n",
            "$I" => "[VER:1.1h.20190830:]\r\n[OPT:V,15,128]\r\nok\r\n",
            "$#" => "[G54:0.500,0.000,0.000]\r\n[TLO:0.000]\r\nok\r\n",
            "$G" => "X:1,Y:2\r\n[GC:G0 G54 G17 G21 G90 G94 M5 M9 T0 F0 S0]\r\nok\r\n",
            "$RST=*" => "Grbl 1.1h ['$' for help]\r\n",
            "$1=9" => "error:8\r\n",
            "G4 P9" => "",
            _ => "error:20\r\n",
        }
    }

    #[test]
    fn answers_are_what_comes_before_the_response() {
        let mut machine = machine(grbl);
        assert_eq!(machine.status.work_position().unwrap()[0], 0.5);
        assert_eq!(machine.settings().unwrap(), ["$0=10", "$1=25"]);
        assert_eq!(machine.status.work_position().unwrap()[0], 1.5);
        let unlocked = machine.ask("$X", SHORT).unwrap();
        assert_eq!(unlocked.lines, ["[MSG:Caution: Unlocked]"]);
        let refused = machine.ask("$TT", SHORT).unwrap();
        assert_eq!(refused.response, Response::Error(20));
        assert_eq!(refused.accepted(), None);
        let answers = machine.answers().unwrap();
        assert_eq!(answers.version.len(), 2);
        assert_eq!(answers.parameters.len(), 2);
        assert_eq!(answers.tools, [""; 0]);
        assert!(answers.modes.starts_with("[GC:G0 "));
        assert_eq!(answers.position, [2.0, 0.0, 0.0]);
        machine.reset().unwrap();
        machine.report().unwrap();
    }

    #[test]
    fn what_comes_in_place_of_an_answer_is_reported() {
        let mut machine = machine(grbl);
        let mut error = |text| machine.ask_for(text, SHORT).unwrap_err().to_string();
        assert!(error("G999").starts_with("the machine refuses G999: error:20, "));
        assert!(error("$1=9").starts_with("the machine refuses $1=9 in the state Idle: error:8, "));
        let alarm =
            "ALARM:9 while $H was executed, homing failed: no limit switch was found: check";
        assert!(error("$H").starts_with(alarm));
        assert_eq!(
            error("$RST=*"),
            "the machine has been reset while $RST=* was sent"
        );
        assert_eq!(
            error("G4 P9"),
            "the machine has not answered G4 P9 for 0.3 s"
        );
    }
}
