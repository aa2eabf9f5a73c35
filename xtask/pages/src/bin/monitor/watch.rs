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
use grbl_client::{
    link::{self, PollFlags},
    realtime,
};
use rustix::io::Errno;
use simulation::{machine_answers::MachineAnswers, pty::Pty};

use crate::{
    path_follower::PathFollower,
    picture::Shared,
    sending::Sending,
    source::Source,
    tap::Tap,
    track::{AXES, Report, Sighting, Track},
};

const Z: usize = 2;
/// Longest wait for bytes: as long until it is looked whether to ask.
const WAIT: Duration = Duration::from_millis(10);
/// How long a machine may take to answer: a board may start first.
const ANSWER_TIMEOUT: Duration = Duration::from_secs(5);
/// How often it is asked until then.
const ASK_EVERY: Duration = Duration::from_millis(500);
/// Bytes that wait for the machine at most; then the sender waits.
const BACKLOG: usize = 4096;
/// Bytes that wait for the sender at most: nobody reads them.
const UNREAD: usize = 65_536;

/// A machine that is watched.
pub(crate) struct Watch {
    source: Source,
    is_simulated: bool,
    shared: Arc<Shared>,
    start: Instant,
    track: Track,
    tap: Tap,
    /// The path of the job, where it is known in advance.
    path_follower: Option<PathFollower>,
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
    pub(crate) fn new(source: Source, is_simulated: bool, shared: Arc<Shared>) -> Self {
        Self {
            source,
            is_simulated,
            shared,
            start: Instant::now(),
            track: Track::default(),
            path_follower: None,
            report: None,
            tap: Tap::new(is_simulated),
            stream_scale: None,
            to_machine: Vec::new(),
            to_sender: Vec::new(),
            seen: Vec::new(),
        }
    }

    /// The port or the address.
    pub(crate) fn name(&self) -> &str {
        &self.source.link.name
    }

    /// Waits until the machine answers, and asks for its resolution.
    pub(crate) fn greet(&mut self, stop: &UnixStream) -> Result<()> {
        let state = self.ask(b"?", ANSWER_TIMEOUT, stop, |sighting| match sighting {
            Sighting::Report(report) => Some(report.state.clone()),
            _ => None,
        })?;
        let (name, hint) = (&self.source.link.name, &self.source.link.hint);
        let seconds = ANSWER_TIMEOUT.as_secs();
        let state = state.with_context(|| {
            format!("{name} has not answered as Grbl does for {seconds} s: {hint}")
        })?;
        // A machine that moves refuses it.
        if state == "Idle" {
            let is_answer =
                |sighting: &Sighting| matches!(sighting, Sighting::Answer(_)).then_some(());
            self.ask(b"$$\n", ANSWER_TIMEOUT, stop, is_answer)?;
        }
        self.to_sender.clear();
        Ok(())
    }

    /// Tells what the machine is going to do.
    pub(crate) fn expect(&mut self, path_follower: PathFollower) {
        self.path_follower = Some(path_follower);
    }

    /// Asks for everything that a job depends on. A machine that moves is asked for nothing: its job is taken
    /// for one that has begun at the work zero of now.
    pub(crate) fn answers(&mut self, stop: &UnixStream) -> Result<MachineAnswers> {
        let report = self.ask(b"?", ANSWER_TIMEOUT, stop, |sighting| match sighting {
            Sighting::Report(report) => Some(report.clone()),
            _ => None,
        })?;
        let report = report.context("the machine does not tell its position")?;
        let [machine, work] = [report.machine_mm, report.work_mm];
        if report.state != "Idle" {
            let offset = [0, 1, 2].map(|axis| machine[axis] - work[axis]);
            let text = offset.map(|offset| format!("{offset:.4}")).join(",");
            let rotary = vec![0.0; report.rotary.len()];
            return Ok(MachineAnswers {
                parameters: vec![format!("[G54:{text}]")],
                position: offset.into_iter().chain(rotary).collect(),
                ..MachineAnswers::default()
            });
        }
        let mut settings = self.lines("$+", stop)?;
        if settings.is_empty() {
            settings = self.lines("$$", stop)?;
        }
        let answers = MachineAnswers {
            version: self.lines("$I", stop)?,
            settings,
            parameters: self.lines("$#", stop)?,
            tools: self.lines("$TT", stop)?,
            modes: self.lines("$G", stop)?.pop().unwrap_or_default(),
            position: Vec::new(),
        };
        let is_in_inches = answers.settings().report_inches;
        let scale = if is_in_inches { 1.0 / 25.4 } else { 1.0 };
        let position = machine.iter().map(|mm| mm * scale);
        let position = position.chain(report.rotary).collect();
        Ok(MachineAnswers {
            position,
            ..answers
        })
    }

    /// What the machine says to a statement; nothing where it does not know it.
    fn lines(&mut self, statement: &str, stop: &UnixStream) -> Result<Vec<String>> {
        let mut lines = Vec::new();
        let question = format!("{statement}\n");
        let answer = self.ask(question.as_bytes(), ANSWER_TIMEOUT, stop, |sighting| {
            if let Sighting::Other(text) = sighting {
                lines.push(text.clone());
            }
            match sighting {
                Sighting::Answer(text) => Some(text == "ok"),
                _ => None,
            }
        })?;
        self.to_sender.clear();
        Ok(if answer == Some(true) {
            lines
        } else {
            Vec::new()
        })
    }

    /// Asks for something until it is seen, or the time is over.
    fn ask<T>(
        &mut self,
        question: &[u8],
        most: Duration,
        stop: &UnixStream,
        mut find: impl FnMut(&Sighting) -> Option<T>,
    ) -> Result<Option<T>> {
        let begin = Instant::now();
        let mut next = begin;
        while begin.elapsed() < most {
            // A list is asked for once, as each question is answered.
            if Instant::now() >= next && (question == b"?" || next == begin) {
                self.to_machine.extend(question);
                next = Instant::now() + ASK_EVERY;
            }
            ensure!(!self.exchange(None, stop)?, "it was stopped");
            for sighting in std::mem::take(&mut self.seen) {
                if let Sighting::Other(text) = &sighting {
                    self.source.link.ensure_is_free(text)?;
                }
                if let Some(found) = find(&sighting) {
                    return Ok(Some(found));
                }
            }
        }
        Ok(None)
    }

    /// Watches until the program has ended, or Ctrl-C.
    pub(crate) fn run(
        &mut self,
        sender: Option<&Pty>,
        mut job: Option<&mut Sending>,
        stop: &UnixStream,
    ) -> Result<()> {
        self.start = Instant::now();
        loop {
            if self.tap.asks(self.start.elapsed()) {
                self.to_machine.push(realtime::REPORT);
            }
            if let Some(job) = &mut job {
                job.feed(&mut self.to_machine)?;
            }
            if self.exchange(sender, stop)? {
                return if job.is_some() { self.hold() } else { Ok(()) };
            }
            for sighting in std::mem::take(&mut self.seen) {
                self.look(&sighting, job.as_deref_mut())?;
            }
            if job.as_ref().is_some_and(|job| job.is_done()) {
                return Ok(());
            }
        }
    }

    /// Holds a machine that is left in the midst of a job: it would carry out the lines that it has, and stand
    /// still with its spindle on.
    fn hold(&self) -> Result<()> {
        self.source.link.write(&mut vec![realtime::HOLD])?;
        bail!("the job was interrupted, and the machine is held: ~ goes on, a reset ends it")
    }

    /// Adds to the picture what has been seen.
    fn look(&mut self, sighting: &Sighting, job: Option<&mut Sending>) -> Result<()> {
        match sighting {
            Sighting::Steps([x, y], z) => {
                let told = self.track.steps_per_mm();
                let unit = if told.is_some() { "mm" } else { "step" };
                let is_first = self.stream_scale.is_none();
                let scale = *self.stream_scale.get_or_insert(told.unwrap_or([1.0; AXES]));
                let steps = [*x, *y, z.unwrap_or(0)].map(f64::from);
                let mut place: [f64; AXES] = std::array::from_fn(|axis| steps[axis] / scale[axis]);
                // A stream without Z leaves it to the reports.
                if let (None, Some(report), true) = (z, &self.report, told.is_some()) {
                    place[Z] = report.machine_mm[Z];
                }
                self.shared.change(|picture| {
                    if is_first {
                        picture.measure_in(unit);
                    }
                    picture.move_to(place);
                });
                if unit == "mm" {
                    self.follow(place);
                }
            }
            Sighting::Report(report) => {
                let time = self.start.elapsed();
                let is_path = self.stream_scale.is_none();
                self.report = Some(report.clone());
                self.shared.change(|picture| {
                    picture.report(report, time);
                    if is_path {
                        picture.measure_in("mm");
                        picture.move_to(report.machine_mm);
                    }
                });
                // The stream tells where a machine is that moves, but not that it has come to rest.
                if is_path || report.state != "Run" {
                    self.follow(report.machine_mm);
                }
                if let Some(job) = job {
                    job.report(&report.state);
                    // The operator of the virtual machine presses cycle start.
                    if self.is_simulated && report.state == "Hold:0" {
                        self.to_machine.push(realtime::RESUME);
                    }
                }
            }
            Sighting::Answer(text) => {
                if let Some(job) = job {
                    let lines = job.answer(text);
                    self.shared.change(|picture| picture.count_lines(lines));
                }
            }
            Sighting::Alarm(text) if job.is_some() => {
                bail!("{} is locked: {text}", self.source.link.name);
            }
            Sighting::Alarm(_) | Sighting::Welcome => {}
            Sighting::Other(text) => self.source.link.ensure_is_free(text)?,
        }
        Ok(())
    }

    /// Finds how far the job is when the machine is at a place.
    fn follow(&mut self, place: [f64; AXES]) {
        if let Some(path_follower) = &mut self.path_follower {
            let state = self.report.as_ref().map_or("", |report| &report.state);
            let progress = path_follower.follow(place, self.start.elapsed().as_secs_f64(), state);
            self.shared.change(|picture| picture.progress(progress));
        }
    }

    /// Moves what bytes there are, after a short wait. Returns whether it is to stop.
    fn exchange(&mut self, sender: Option<&Pty>, stop: &UnixStream) -> Result<bool> {
        if self.wait(sender.map(Pty::controller), stop)? {
            return Ok(true);
        }
        let mut chunk = [0; 4096];
        let now = self.start.elapsed();
        let length = self.source.link.read(&mut chunk)?;
        let bytes = &chunk[..length];
        let seen = &mut self.seen;
        self.track.push(bytes, |_, sighting| seen.push(sighting));
        self.tap
            .received(bytes, now, &mut self.to_sender, &mut self.to_machine);
        let Some(sender) = sender else {
            self.to_sender.clear();
            return self.source.link.write(&mut self.to_machine).map(|()| false);
        };
        if self.to_machine.len() < BACKLOG {
            let length = moved(rustix::io::read(sender.controller(), &mut chunk))?;
            self.tap.sent(&chunk[..length], now, &mut self.to_machine);
        }
        self.source.link.write(&mut self.to_machine)?;
        let length = moved(rustix::io::write(sender.controller(), &self.to_sender))?;
        self.to_sender.drain(..length);
        let excess = self.to_sender.len().saturating_sub(UNREAD);
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
        let mut ends = vec![
            (stop.as_fd(), PollFlags::IN),
            (self.source.link.as_fd(), machine),
        ];
        let reads = self.to_machine.len() < BACKLOG;
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
