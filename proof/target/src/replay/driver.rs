//! A sender that keeps the line full and takes whatever comes back: errors, alarms, resets.

use std::{path::Path, thread, time::Duration};

use anyhow::{Context, Result, ensure};
use grbl_client::{InFlight, Line, Response, realtime};
use simulation::machine::SwitchPositions;
use target::emulator::{Emulator, Patience};

/// How long the firmware may be silent, without the time that QEMU waits for a processor.
const TIMEOUT: Duration = Duration::from_mins(1);
/// Time between two questions for the state.
const PAUSE: Duration = Duration::from_millis(2);
/// After this silence it is asked for its state.
const QUIET: Duration = Duration::from_millis(100);

/// See the module.
pub(super) struct Driver {
    emulator: Emulator,
    /// Length of each line that has no answer.
    in_flight: InFlight,
    answered: u64,
    refused: u64,
    alarms: u64,
    reports: u64,
    /// The state and the position in the last report.
    state: String,
    position: Option<Vec<f64>>,
    /// When the last line was answered or sent, or the machine was found somewhere else.
    progress: Patience,
    /// A message of the machine that only a reset answers.
    is_locked: bool,
}

impl Driver {
    /// Boots the firmware, whose sender is on a USART, in a QEMU with these arguments.
    pub(super) fn boot(elf: &Path, machine: &str, usart: u8, arguments: &[&str]) -> Result<Self> {
        let mut emulator = Emulator::start_with(elf, machine, usart, arguments)?;
        emulator.wait_for_welcome(TIMEOUT)?;
        Ok(Self {
            progress: emulator.patience(TIMEOUT),
            emulator,
            in_flight: InFlight::default(),
            answered: 0,
            refused: 0,
            alarms: 0,
            reports: 0,
            state: String::new(),
            position: None,
            is_locked: false,
        })
    }

    /// What has come back.
    pub(super) fn counts(&self) -> String {
        let Self {
            answered,
            refused,
            alarms,
            reports,
            ..
        } = self;
        format!("{answered} lines answered, {refused} refused; {alarms} alarms; {reports} reports")
    }

    /// Ends QEMU.
    pub(super) fn quit(self) -> Result<()> {
        self.emulator.quit(TIMEOUT)
    }

    /// Sends realtime commands.
    pub(super) fn realtime(&mut self, bytes: &[u8]) -> Result<()> {
        self.emulator.send(bytes)
    }

    /// Sends lines, each as soon as there is room for it, until an alarm voids the rest; `between`
    /// gives the realtime commands to be sent behind each of them.
    pub(super) fn stream<'a>(
        &mut self,
        lines: impl IntoIterator<Item = &'a str>,
        between: impl Fn(usize) -> &'static [u8],
    ) -> Result<()> {
        for (number, line) in lines.into_iter().enumerate() {
            self.send(line)?;
            let bytes = between(number);
            if !bytes.is_empty() {
                self.realtime(bytes)?;
            }
            if self.is_locked {
                return Ok(());
            }
        }
        Ok(())
    }

    /// Sends lines and waits until they have been answered.
    pub(super) fn run<'a>(&mut self, lines: impl IntoIterator<Item = &'a str>) -> Result<()> {
        self.stream(lines, |_| b"")?;
        self.finish()
    }

    /// Sends settings, none of which may be refused.
    pub(super) fn set(&mut self, lines: &[String]) -> Result<()> {
        for line in lines {
            let refused = self.refused;
            self.run([line.as_str()])?;
            ensure!(self.refused == refused, "the firmware refuses {line}");
        }
        Ok(())
    }

    /// Waits until every line has its answer, or an alarm voids them.
    pub(super) fn finish(&mut self) -> Result<()> {
        while !self.in_flight.is_empty() && !self.is_locked {
            self.listen()?;
            // A hold that a test of many at once has left.
            if self.state == "Hold:0" || self.state == "Door:0" {
                self.state.clear();
                self.realtime(&[realtime::RESUME])?;
            }
        }
        Ok(())
    }

    /// Waits until all motion is over.
    pub(super) fn come_to_rest(&mut self) -> Result<()> {
        self.run(["G4P0.001"])
    }

    /// Asks for reports until the state begins so, or an alarm or a rest with nothing left to do
    /// say that it is too late for it.
    pub(super) fn wait_for(&mut self, state: &str) -> Result<()> {
        let patience = self.emulator.patience(TIMEOUT);
        self.state.clear();
        let is_too_late = |driver: &Self| {
            driver.state.starts_with("Alarm")
                || driver.state == "Idle" && driver.in_flight.is_empty()
        };
        while !self.state.starts_with(state) && !is_too_late(self) {
            ensure!(
                !patience.is_over(),
                "the machine does not come to the state {state}: it is in {}",
                self.state
            );
            // The emulated machine moves while it is asked nothing.
            thread::sleep(PAUSE);
            self.ask()?;
        }
        Ok(())
    }

    /// Asks for the state, and waits for it.
    fn ask(&mut self) -> Result<()> {
        self.state.clear();
        self.realtime(&[realtime::REPORT])?;
        while self.state.is_empty() {
            self.listen()?;
        }
        Ok(())
    }

    /// Resets the machine and unlocks it.
    pub(super) fn reset(&mut self) -> Result<()> {
        self.realtime(&[realtime::RESET])?;
        self.emulator.wait_for_welcome(TIMEOUT)?;
        // After some alarms it has reset itself: then there is a second welcome. It stands already, so
        // that one comes before the answers to what it is asked behind the byte.
        self.in_flight = InFlight::default();
        for _ in 0..2 {
            self.ask()?;
        }
        while self.emulator.receive(QUIET)?.is_some() {}
        self.is_locked = false;
        self.run(["$X", "G21G90G94G17", "M5M9"])
    }

    /// Mounts switches and a plate.
    pub(super) fn mount(&self, switches: &SwitchPositions) -> Result<()> {
        self.emulator.mount(switches)
    }

    /// Closes contacts by hand.
    pub(super) fn close(&self, contacts: u16) -> Result<()> {
        self.emulator.close(contacts)
    }

    fn send(&mut self, line: &str) -> Result<()> {
        let length = line.len() + 1;
        while !self.in_flight.has_room(length) {
            self.listen()?;
            if self.is_locked {
                return Ok(());
            }
        }
        self.emulator.send(format!("{line}\n").as_bytes())?;
        self.in_flight.send(length);
        self.progress.restart();
        Ok(())
    }

    /// Takes a line of the machine.
    fn listen(&mut self) -> Result<()> {
        ensure!(
            self.in_flight.is_empty() || !self.progress.is_over(),
            "{} lines are not answered in the state {:?}",
            self.in_flight.len(),
            self.state
        );
        let mut line = self.emulator.receive(QUIET)?;
        if line.is_none() {
            self.realtime(&[realtime::REPORT])?;
            line = self.emulator.receive(TIMEOUT)?;
        }
        let line =
            line.with_context(|| format!("the firmware is silent in the state {:?}", self.state))?;
        match Line::read(&line) {
            Line::Response(response) => {
                self.in_flight.answer();
                self.progress.restart();
                self.answered += 1;
                self.refused += u64::from(response != Response::Ok);
            }
            Line::Report(report) => {
                self.reports += 1;
                let position = report.machine_position();
                self.state = report.state;
                if self.position != position {
                    self.position = position;
                    self.progress.restart();
                }
            }
            Line::Alarm(_) => {
                self.alarms += 1;
                self.is_locked = true;
            }
            _ => {}
        }
        Ok(())
    }
}
