//! The sender: streams a program to the emulated board by character counting.

use std::{
    io::{BufRead, BufReader, Read, Write},
    sync::mpsc::{self, Receiver},
    thread,
    time::Duration,
};

use anyhow::{Context, Result, bail, ensure};
use grbl_client::{InFlight, Line, Report, Response, realtime};

/// Longest silence, host time.
const TIMEOUT: Duration = Duration::from_mins(1);

/// One conversation.
pub(crate) struct Sender<W> {
    to: W,
    from: Receiver<String>,
    in_flight: InFlight,
}

impl<W: Write> Sender<W> {
    /// Waits for the welcome.
    pub(crate) fn connect(to: W, from: impl Read + Send + 'static) -> Result<Self> {
        let (put, lines) = mpsc::channel();
        thread::spawn(move || {
            for line in BufReader::new(from).lines().map_while(Result::ok) {
                if put.send(line).is_err() {
                    break;
                }
            }
        });
        let sender = Self {
            to,
            from: lines,
            in_flight: InFlight::default(),
        };
        while Line::read(&sender.receive()?) != Line::Welcome {}
        Ok(sender)
    }

    /// Sends lines, each as soon as there is room, and fails when one is rejected.
    pub(crate) fn stream<'a>(&mut self, lines: impl IntoIterator<Item = &'a str>) -> Result<()> {
        for line in lines {
            self.send(line)?;
        }
        self.wait()
    }

    /// Sends a line as soon as there is room.
    pub(crate) fn send(&mut self, line: &str) -> Result<()> {
        let length = line.len() + 1;
        while !self.in_flight.has_room(length) {
            self.answer().with_context(|| format!("before {line:?}"))?;
        }
        self.to.write_all(format!("{line}\n").as_bytes())?;
        self.to.flush()?;
        self.in_flight.send(length);
        Ok(())
    }

    /// Waits until every line has been answered.
    pub(crate) fn wait(&mut self) -> Result<()> {
        while !self.in_flight.is_empty() {
            self.answer()?;
        }
        Ok(())
    }

    /// The machine position, mm. To be asked when nothing is in flight.
    pub(crate) fn position(&mut self) -> Result<Vec<f64>> {
        self.to.write_all(&[realtime::REPORT])?;
        self.to.flush()?;
        let report = loop {
            if let Some(report) = Report::read(&self.receive()?) {
                break report;
            }
        };
        ensure!(report.state == "Idle", "not at rest: {}", report.state);
        report.machine_position().context("no MPos reported")
    }

    /// Takes the answer to the oldest line in flight.
    fn answer(&mut self) -> Result<()> {
        loop {
            let line = self.receive()?;
            match Line::read(&line) {
                Line::Response(Response::Ok) => {
                    self.in_flight.answer();
                    return Ok(());
                }
                Line::Response(_) | Line::Alarm(_) => bail!("the firmware answered {line}"),
                _ => {}
            }
        }
    }

    fn receive(&self) -> Result<String> {
        let line = self
            .from
            .recv_timeout(TIMEOUT)
            .context("the firmware does not answer")?;
        Ok(line.trim_end().to_owned())
    }
}
