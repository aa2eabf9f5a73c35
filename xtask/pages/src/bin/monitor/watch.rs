//! Moves bytes between sender, machine and picture, until there is an end.

use std::{
    os::{
        fd::{AsFd as _, BorrowedFd},
        unix::net::UnixStream,
    },
    sync::Arc,
    time::{Duration, Instant},
};

use anyhow::{Context, Result, bail, ensure};
use common::ui;
use grbl_client::{
    Line, Link, Response, Transmission,
    link::{self, PollFlags},
    meaning::{self, LineOfAlarm},
    realtime,
    transmission::Phase,
};
use rustix::io::Errno;
use simulation::{playing::RaisedAlarm, pty::Pty};

use crate::{
    path_follower::PathFollower,
    picture::{ExecutedPath, Shared},
    tap::Tap,
    track::{AXES, Report, Sighting, Track},
};

const Z: usize = 2;
/// Longest wait for bytes: as long until it is looked whether to ask.
const WAIT: Duration = Duration::from_millis(10);
/// Bytes that wait for the machine at most; then the sender waits.
const MAX_QUEUED_BYTES: usize = 4096;
/// Bytes that wait for the sender at most: nobody reads them.
const MAX_UNREAD_BYTES: usize = 65_536;

/// A machine that is watched.
pub(crate) struct Watch {
    link: Link,
    is_simulated: bool,
    shared: Arc<Shared>,
    start: Instant,
    track: Track,
    tap: Tap,
    /// The path of the job, where it is known in advance.
    path_follower: Option<PathFollower>,
    /// The alarm in which the job ends on the virtual machine.
    expected: Option<RaisedAlarm>,
    /// The last report.
    report: Option<Report>,
    /// Steps in a unit of the path, once a line of the stream has been seen: from then on reports add no
    /// positions to the path.
    stream_scale: Option<[f64; AXES]>,
    to_machine: Vec<u8>,
    to_sender: Vec<u8>,
    /// What has been seen and not yet been looked at.
    seen: Vec<Sighting>,
}

impl Watch {
    /// Watches a machine of which a status and settings are known.
    pub(crate) fn new(
        (link, track): (Link, Track),
        is_simulated: bool,
        shared: Arc<Shared>,
    ) -> Self {
        Self {
            link,
            is_simulated,
            shared,
            start: Instant::now(),
            track,
            path_follower: None,
            expected: None,
            report: None,
            tap: Tap::new(is_simulated),
            stream_scale: None,
            to_machine: Vec::new(),
            to_sender: Vec::new(),
            seen: Vec::new(),
        }
    }

    /// The line to the machine.
    pub(crate) const fn link(&self) -> &Link {
        &self.link
    }

    /// Shows where the machine is now, with what it is going to do, where that is known.
    pub(crate) fn begin(
        &mut self,
        path_follower: Option<PathFollower>,
        expected: Option<RaisedAlarm>,
    ) -> Result<()> {
        self.path_follower = path_follower;
        self.expected = expected;
        let report = self.track.report().map(Sighting::Report);
        report.map_or(Ok(()), |report| self.update(&report, None))
    }

    /// Watches until the program has ended, or Ctrl-C.
    pub(crate) fn run(
        &mut self,
        sender: Option<&Pty>,
        mut job: Option<&mut Transmission>,
        stop: &UnixStream,
    ) -> Result<()> {
        self.start = Instant::now();
        loop {
            if self.tap.asks(self.start.elapsed()) {
                self.to_machine.push(realtime::REPORT);
            }
            if let Some(job) = &mut job {
                let output = job.take_output();
                self.track.modes.are_old |= !output.is_empty();
                self.to_machine.extend(output);
            }
            if self.exchange(sender, stop)? {
                ensure!(
                    job.is_none(),
                    "the job was interrupted, and the machine is held: ~ goes on, a reset ends it"
                );
                return Ok(());
            }
            for sighting in std::mem::take(&mut self.seen) {
                self.update(&sighting, job.as_deref_mut())?;
            }
            match job.as_ref().map(|job| &job.phase) {
                Some(Phase::Done) => return Ok(()),
                Some(Phase::Failed(reason)) => bail!("{reason}"),
                _ => {}
            }
        }
    }

    /// Adds to the picture what has been seen.
    fn update(&mut self, sighting: &Sighting, job: Option<&mut Transmission>) -> Result<()> {
        match sighting {
            Sighting::Steps(xy, z) => self.take_steps(*xy, *z),
            Sighting::Report(report) => self.take_report(report, job),
            Sighting::Answer(text) => {
                if let Some(Response::Error(number)) = Response::parse(text) {
                    let meaning = meaning::error_with_remedy(number);
                    self.say(format!(
                        "{text}{}",
                        meaning::after_comma(meaning.as_deref())
                    ));
                }
                if let Some(job) = job {
                    job.receive(text);
                    let refusal = job.take_notes().pop();
                    if let Some(text) = &refusal {
                        ui::warning(text);
                    }
                    let lines = job.answered() as u64;
                    self.shared
                        .change(|picture| picture.count_lines(lines, refusal));
                }
            }
            Sighting::Alarm(text) => self.show_alarm(text.trim(), job.as_deref())?,
            Sighting::Welcome => self.say("the machine has started anew".into()),
            Sighting::Other(text) => {
                if let Line::Message(message) | Line::Answer("echo", message) = Line::read(text) {
                    self.say(message.into());
                }
                self.link.ensure_is_free(text)?;
            }
        }
        Ok(())
    }

    /// Adds a line of the position stream to the path.
    fn take_steps(&mut self, xy: [i32; 2], z: Option<i32>) {
        let steps_per_mm = self.track.steps_per_mm();
        let unit = if steps_per_mm.is_some() { "mm" } else { "step" };
        let is_first = self.stream_scale.is_none();
        let scale = *self
            .stream_scale
            .get_or_insert(steps_per_mm.unwrap_or([1.0; AXES]));
        let steps = [xy[0], xy[1], z.unwrap_or(0)].map(f64::from);
        let mut place: [f64; AXES] = std::array::from_fn(|axis| steps[axis] / scale[axis]);
        // A stream without Z leaves it to the reports.
        if let (None, Some(report), true) = (z, &self.report, steps_per_mm.is_some()) {
            place[Z] = report.machine_mm[Z];
        }
        let followed = if unit == "mm" {
            self.follow(place)
        } else {
            None
        };
        self.shared.change(|picture| {
            if is_first {
                picture.measure_in(unit);
            }
            picture.follow(followed);
            picture.move_to(place);
        });
    }

    /// Shows what a report has.
    fn take_report(&mut self, report: &Report, job: Option<&mut Transmission>) {
        let time = self.start.elapsed();
        let is_path = self.stream_scale.is_none();
        self.report = Some(report.clone());
        // The stream tells where a machine is that moves, but not that it has come to rest.
        let followed = if is_path || report.state != "Run" {
            self.follow(report.machine_mm)
        } else {
            None
        };
        self.shared.change(|picture| {
            picture.report(report, time);
            if is_path {
                picture.measure_in("mm");
            }
            picture.follow(followed);
            if is_path {
                picture.move_to(report.machine_mm);
            }
        });
        if let Some(job) = job {
            let state = report.state.clone();
            // A program may begin with the line that unlocks the machine, and alarms are shown as they come.
            if state != "Alarm" {
                let fields = Vec::new();
                job.take_report(grbl_client::Report { state, fields });
            }
            // The operator of the virtual machine presses cycle start.
            if self.is_simulated && report.state == "Hold:0" {
                self.to_machine.push(realtime::RESUME);
            }
        }
    }

    /// Shows what the machine says.
    fn say(&self, text: String) {
        self.shared.change(|picture| picture.message(text));
    }

    /// Shows an alarm, which ends a job.
    fn show_alarm(&self, name: &str, job: Option<&Transmission>) -> Result<()> {
        let alarm = self.alarm(name, job).to_string();
        self.shared.change(|picture| picture.alarm(&alarm));
        self.say(alarm.clone());
        ensure!(job.is_none(), "{} is locked: {alarm}", self.link.name);
        Ok(())
    }

    /// An alarm with its line, as far as that is known, and what it means.
    fn alarm(&self, name: &str, job: Option<&Transmission>) -> RaisedAlarm {
        let number = name.trim_start_matches("ALARM:");
        let place = match meaning::line_of_alarm(number) {
            Some(LineOfAlarm::Unanswered) => job.and_then(Transmission::oldest).unwrap_or_default(),
            Some(LineOfAlarm::InExecution) => {
                let job = self.shared.lock().now().job;
                (job.map_or(0, |job| job.line), &b""[..])
            }
            None => Default::default(),
        };
        let expected = self.expected.as_ref();
        let is_expected = |expected: &&RaisedAlarm| {
            expected.name == name && (place.0 == 0 || place.0 == expected.line)
        };
        let expected = expected.filter(is_expected).cloned();
        expected.unwrap_or_else(|| RaisedAlarm::at(number, place))
    }

    /// Finds how far the job is when the machine is at a place, where the job is known.
    fn follow(&mut self, place: [f64; AXES]) -> Option<ExecutedPath> {
        let path_follower = self.path_follower.as_mut()?;
        let state = self.report.as_ref().map_or("", |report| &report.state);
        let before = path_follower.at_s();
        let progress = path_follower.follow(place, self.start.elapsed().as_secs_f64(), state);
        let from_s = before.filter(|_| progress.is_on_path);
        let bends = from_s.map(|from_s| path_follower.bends(from_s, progress.time_s).collect());
        Some(ExecutedPath {
            progress,
            bends: bends.unwrap_or_default(),
        })
    }

    /// Moves what bytes there are, after a short wait. Returns whether it is to stop.
    fn exchange(&mut self, sender: Option<&Pty>, stop: &UnixStream) -> Result<bool> {
        if self.wait(sender.map(Pty::controller), stop)? {
            return Ok(true);
        }
        let mut chunk = [0; 4096];
        let now = self.start.elapsed();
        let length = self.link.read(&mut chunk)?;
        let bytes = &chunk[..length];
        let seen = &mut self.seen;
        self.track.push(bytes, |_, sighting| seen.push(sighting));
        self.tap
            .received(bytes, now, &mut self.to_sender, &mut self.to_machine);
        let Some(sender) = sender else {
            self.to_sender.clear();
            return self.link.write(&mut self.to_machine).map(|()| false);
        };
        if self.to_machine.len() < MAX_QUEUED_BYTES {
            let length = moved(rustix::io::read(sender.controller(), &mut chunk))?;
            self.tap.sent(&chunk[..length], now, &mut self.to_machine);
            self.track.modes.are_old |= chunk[..length].contains(&b'\n');
        }
        self.link.write(&mut self.to_machine)?;
        let length = moved(rustix::io::write(sender.controller(), &self.to_sender))?;
        self.to_sender.drain(..length);
        let excess = self.to_sender.len().saturating_sub(MAX_UNREAD_BYTES);
        self.to_sender.drain(..excess);
        Ok(false)
    }

    /// Waits for bytes, or room for them. Returns whether it is to stop.
    fn wait(&self, sender: Option<BorrowedFd<'_>>, stop: &UnixStream) -> Result<bool> {
        let flags = |reads: bool, waiting: &[u8]| {
            let mut flags = PollFlags::empty();
            flags.set(PollFlags::IN, reads);
            flags.set(PollFlags::OUT, !waiting.is_empty());
            flags
        };
        let machine = flags(true, &self.to_machine);
        let mut ends = vec![(stop.as_fd(), PollFlags::IN), (self.link.as_fd(), machine)];
        let reads = self.to_machine.len() < MAX_QUEUED_BYTES;
        ends.extend(sender.map(|sender| (sender, flags(reads, &self.to_sender))));
        Ok(link::wait(&ends, WAIT)?[0])
    }
}

/// How many bytes went; none when the other end is not ready.
fn moved(result: rustix::io::Result<usize>) -> Result<usize> {
    match result {
        Ok(length) => Ok(length),
        Err(Errno::AGAIN | Errno::INTR) => Ok(0),
        Err(error) => Err(error).context("the sender's line is broken"),
    }
}
