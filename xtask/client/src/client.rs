//! A machine and its operator: what is asked for and what the machine says go in; bytes for the machine, answers and
//! the state of the machine come out.
//!
//! Pure: the caller owns line, clock and screen. It calls [`tick`](Client::tick) some 50 times a second.

mod answers;
mod cycle;
mod job;
mod jog;
mod probing;
mod protocol;

use std::{
    collections::{BTreeMap, VecDeque},
    mem,
};

pub use probing::{Probing, Target};
pub use protocol::{Command, Event, JobState, State};

use leadscrew::axis::LETTERS;

use crate::{
    Line, Lines, Response, Sender, Status, Transmission, realtime, sender::sendable,
    transmission::Key,
};
use answers::AnswerSync;
use cycle::ProbingCycle;
use jog::Jog;

/// How long a [`Command::Move`] counts, ms.
pub const JOG_TIMEOUT_MS: u64 = 200;
/// How often the machine is asked for a report, ms, and how often while it jogs.
const REPORT_MS: u64 = 100;
const JOG_REPORT_MS: u64 = 50;
/// After how long without a word the machine counts as gone, ms.
const SILENCE_LIMIT_MS: u64 = 2000;
/// Lines of the operator beyond these are not taken: nobody types so many.
const MOST_WAITING: usize = 1000;
/// Events beyond these are left out: nobody reads so many lines.
const MOST_EVENTS: usize = 400;
/// The settings of the fastest rate of X, mm/min, and of its acceleration, mm/s²; those of the other axes follow.
const MAX_RATE: u16 = 110;
const ACCELERATION: u16 = 120;
/// Jogs by a step that may wait, and jogs of a held key that are not answered; the longest of these.
const MOST_STEPS: usize = 3;
const MOST_JOGS: usize = 8;
const LONGEST_JOG: &str = "$J=G91G21X-1000.000Y-1000.000Z-1000.000F10000";
/// Reports after a line or an answer, of which the second one is of a machine that has come to rest.
const REST_REPORTS: u32 = 2;
/// Lines that change nothing.
const QUESTIONS: [&str; 8] = ["$$", "$+", "$#", "$G", "$I", "$TT", "$EG", "$ES"];
/// `error:15`, a jog beyond the travel.
const BEYOND_TRAVEL: Response = Response::Error(15);

/// Whose a line is.
#[derive(Debug, Clone, Copy, PartialEq, Eq)]
enum Origin {
    /// The page's, with the number of its command if it has one.
    Page(Option<u32>),
    /// A question of the client's own.
    Own,
    /// Of the jog with a number.
    Jog(u32),
    /// Of the probing cycle.
    Cycle,
}

/// A line of the operator.
#[derive(Debug)]
struct QueuedLine {
    of: Origin,
    text: String,
    /// What has come before its answer.
    lines: Vec<String>,
}

impl QueuedLine {
    fn new(of: Origin, text: String) -> Self {
        let lines = Vec::new();
        Self { of, text, lines }
    }

    fn is_jog(&self) -> bool {
        self.text.trim_start().starts_with("$J=")
    }

    /// Whether it is of the client's own, or asks for what the machine knows.
    fn is_harmless(&self) -> bool {
        self.of == Origin::Own || QUESTIONS.contains(&self.text.as_str())
    }
}

/// The program of a page.
#[derive(Debug, Default)]
struct Program {
    name: String,
    lines: Vec<Vec<u8>>,
}

/// From where a job begins: a line, counted from 0, and what is sent before.
#[derive(Debug)]
struct Start {
    line: usize,
    approach: Vec<String>,
}

/// The client of a machine.
#[derive(Debug, Default)]
pub struct Client {
    lines: Lines,
    status: Status,
    /// When the machine has said something, and when it has been asked, ms.
    received_ms: Option<u64>,
    asked_ms: Option<u64>,
    sender: Sender,
    waiting: VecDeque<QueuedLine>,
    in_flight: VecDeque<QueuedLine>,
    /// To which lines answers belong.
    answers: AnswerSync,
    /// Reports since a line was sent or answered, or an alarm.
    reports: u32,
    jog: Option<Jog>,
    /// The number of the newest jog.
    jogs: u32,
    cycle: Option<ProbingCycle>,
    /// The line that makes of the modes of a cycle that has ended those of before.
    restores: Option<String>,
    /// The modes of a cycle are in force, or those of a reset.
    are_modes_changed: bool,
    /// A cycle is being stopped: when the machine is held, it is reset. Reports since.
    stopping: Option<u32>,
    /// Jogs are being cancelled.
    is_cancelling: bool,
    /// The press of the jog, and the last one that has ended.
    press: u32,
    ended_press: Option<u32>,
    program: Program,
    job: Option<Transmission>,
    /// From where the job is to begin.
    start_asked: Option<Start>,
    state: State,
    /// Homing has ended, and its position is not reported yet.
    has_homed: bool,
    /// As it was told.
    shown: State,
    /// `$G` may have another answer.
    are_modes_old: bool,
    /// The machine has been asked for its settings, of which these are numbers.
    are_settings_known: bool,
    settings: BTreeMap<u16, f64>,
    output: Vec<u8>,
    events: Vec<Event>,
}

impl Client {
    /// Takes what the operator asks for, at a time in ms.
    pub fn command(&mut self, command: Command, now_ms: u64) {
        if let Some(text) = self.obstacle(&command) {
            self.note(Event::Note { text: text.into() });
            if let Command::Line { number, .. } = command {
                // Whoever waits for its answer waits no longer.
                self.note(Event::Answer {
                    number,
                    lines: Vec::new(),
                    response: String::new(),
                });
            }
            return;
        }
        match command {
            Command::Line { number, text } => {
                let text = String::from_utf8_lossy(&sendable(text.as_bytes())).into_owned();
                self.ask(Origin::Page(Some(number)), text);
            }
            Command::Realtime { byte } => self.realtime(byte),
            Command::Step { by, feed } => self.ask(Origin::Page(None), jog::line(&by, feed)),
            Command::Move { press, along, feed } => self.hold(press, (along, feed), now_ms),
            Command::Halt => self.halt(),
            Command::Program { name, text } => self.take_program(name, &text),
            Command::Start { line, approach } => self.start(Start { line, approach }),
            Command::Stop => self.stop(),
            Command::Probe { probing } => self.probe(probing),
            Command::TakeLines => self.key(Key::ManualLines),
        }
    }

    /// Why a command is not carried out now.
    fn obstacle(&self, command: &Command) -> Option<&'static str> {
        let is_of_cycle = command.may_move()
            || matches!(command, Command::Program { .. } | Command::Start { .. });
        if let Some(text) = self.obstacle_of_job(command) {
            Some(text)
        } else if self.cycle.is_some() && is_of_cycle {
            Some("a probing cycle is under way: nothing else is sent")
        } else if command.may_move() && self.answers != AnswerSync::Known && !self.is_quiet() {
            Some("the machine may still do what was asked for before: it has to come to rest first")
        } else if matches!(command, Command::Step { .. }) && self.jog_lines() >= MOST_STEPS {
            Some("the machine has to come to the end of its jogs first")
        } else {
            None
        }
    }

    /// Jogs that are not answered, or not sent yet.
    fn jog_lines(&self) -> usize {
        let lines = self.waiting.iter().chain(&self.in_flight);
        lines.filter(|asked| asked.is_jog()).count()
    }

    /// Takes bytes of the machine, at a time in ms.
    pub fn receive(&mut self, bytes: &[u8], now_ms: u64) {
        self.lines.push(bytes);
        while let Some(line) = self.lines.next_line() {
            self.received_ms = Some(now_ms);
            self.receive_line(&line);
        }
    }

    /// Goes on: asks for reports, jogs while a key is held, sends what there is room for.
    pub fn tick(&mut self, now_ms: u64) {
        let is_held = self
            .jog
            .as_ref()
            .is_some_and(|jog| jog.silence_ms(now_ms) <= JOG_TIMEOUT_MS);
        if self.jog.is_some() && !is_held {
            self.halt();
        }
        let period_ms = if self.jog.is_some() {
            JOG_REPORT_MS
        } else {
            REPORT_MS
        };
        if self
            .asked_ms
            .is_none_or(|asked_ms| now_ms >= asked_ms + period_ms)
        {
            self.asked_ms = Some(now_ms);
            self.output.push(realtime::REPORT);
        }
        self.state.is_there = self
            .received_ms
            .is_some_and(|received_ms| now_ms < received_ms + SILENCE_LIMIT_MS);
        self.begin_job();
        self.probe_on();
        self.settle_answers();
        self.send();
        self.show();
    }

    /// Takes the bytes that are to be sent now.
    pub fn take_output(&mut self) -> Vec<u8> {
        mem::take(&mut self.output)
    }

    /// Takes what is to be shown.
    pub fn take_events(&mut self) -> Vec<Event> {
        mem::take(&mut self.events)
    }

    /// Nobody is at the page any more: jogs end, lines that wait are not sent, and a job goes on.
    pub fn leave(&mut self) {
        self.halt();
        self.drop_waiting("the page has gone: lines that wait are not sent");
    }

    /// Answers the lines that wait, which are not sent: nothing that follows a failure is carried out.
    fn drop_waiting(&mut self, reason: &str) {
        let waiting = mem::take(&mut self.waiting);
        if waiting.iter().any(|asked| asked.of != Origin::Own) {
            let text = reason.into();
            self.note(Event::Note { text });
        }
        for asked in waiting {
            self.answer(asked, "");
        }
    }

    /// The line to the machine is broken: nothing that was sent will be answered.
    pub fn lose_line(&mut self) {
        let job = self.job.take();
        if job.is_some() {
            self.state.job = Some(JobState {
                is_running: false,
                outcome: "the line to the machine was lost".into(),
                ..self.state.job.take().unwrap_or_default()
            });
        }
        self.forget();
        self.lines = Lines::default();
        self.received_ms = None;
        self.are_settings_known = false;
        self.are_modes_old = true;
        self.state.reference_mm = None;
        self.forget_homing();
        self.answers = AnswerSync::Unknown;
        self.lose_answers();
        self.output.clear();
    }

    /// The machine and the job, as they are shown.
    #[must_use]
    pub fn state(&self) -> &State {
        &self.state
    }

    /// Drops what will not be answered.
    fn forget(&mut self) {
        self.start_asked = None;
        self.stopping = None;
        self.is_cancelling = false;
        self.end_press();
        self.end_cycle("the machine was reset, and the probing cycle has ended");
        self.are_modes_changed |= self.restores.take().is_some();
        self.sender = Sender::default();
        for asked in mem::take(&mut self.in_flight)
            .into_iter()
            .chain(mem::take(&mut self.waiting))
        {
            self.answer(asked, "");
        }
    }

    fn note(&mut self, event: Event) {
        if self.events.len() < MOST_EVENTS {
            self.events.push(event);
        }
    }

    fn ask(&mut self, of: Origin, text: String) {
        let is_one_line = !text.is_empty() && !text.contains(['\n', '\r']);
        if is_one_line && self.waiting.len() < MOST_WAITING {
            self.waiting.push_back(QueuedLine::new(of, text));
        }
    }

    /// Whether the machine is at rest and moves by lines of the operator.
    fn is_ready(&self) -> bool {
        let name = self.status.report.state_name();
        let is_in_change = name == "Tool" && (self.job.is_none() || self.takes_lines_amid_job());
        self.state.is_there && (is_in_change || name == "Idle" && self.job.is_none())
    }

    /// Whether nothing is under way but questions of the client's own.
    fn is_free(&self) -> bool {
        let is_asked = self.restores.is_some() || self.lines().any(|line| line.of != Origin::Own);
        self.is_free_but_for_questions() && !is_asked
    }

    /// Whether nothing is under way but questions and what the client sends by itself.
    fn is_free_but_for_questions(&self) -> bool {
        let is_busy = self.jog.is_some() || self.cycle.is_some();
        let is_job = self.job.is_some() && !self.takes_lines_amid_job();
        let is_asked = self.start_asked.is_some() || self.lines().any(|line| !line.is_harmless());
        !is_busy && !is_job && !is_asked
    }

    /// Lines that are not answered.
    fn lines(&self) -> impl Iterator<Item = &QueuedLine> {
        self.waiting.iter().chain(&self.in_flight)
    }

    /// Whether nothing was sent that is not answered, and nothing is under way.
    fn is_silent(&self) -> bool {
        let is_busy = self.jog.is_some() || self.cycle.is_some();
        self.is_answered() && !is_busy
    }

    /// Whether every line is sent and answered.
    fn is_answered(&self) -> bool {
        let is_due = self.answers != AnswerSync::Known && self.job.is_none();
        !is_due && self.in_flight.is_empty() && self.waiting.is_empty() && self.restores.is_none()
    }

    /// A key is held.
    fn hold(&mut self, press: u32, (along, feed): (Vec<i8>, f64), now_ms: u64) {
        if self.ended_press == Some(press) {
            return;
        }
        if self.jog.is_some() && self.press == press {
            self.jog.iter_mut().for_each(|jog| jog.hold(now_ms));
            return;
        }
        self.halt();
        let may_jog = matches!(self.status.report.state_name(), "Idle" | "Jog" | "Tool")
            && along.iter().all(|along| (-1..=1).contains(along));
        let start = self.position_mm();
        if let Some(start) = start.filter(|_| may_jog && feed > 0.0) {
            self.jogs += 1;
            self.press = press;
            let rates = self.settings_of_axes(MAX_RATE);
            self.jog = Some(Jog::new((along, feed), &rates, start, now_ms));
        }
    }

    /// Ends jogs: those that wait are not sent, and the machine cancels the others.
    fn halt(&mut self) {
        self.end_press();
        let lines = self.waiting.iter().chain(&self.in_flight);
        let mut of_cycle = lines.filter(|asked| asked.of == Origin::Cycle);
        if self.status.report.state_name() == "Jog" || of_cycle.any(QueuedLine::is_jog) {
            self.end_cycle("the probing cycle was stopped amid its motion");
        }
        let waiting = mem::take(&mut self.waiting);
        let (jogs, others): (VecDeque<_>, _) = waiting.into_iter().partition(QueuedLine::is_jog);
        self.waiting = others;
        for jog in jogs {
            self.answer(jog, "");
        }
        if self.has_jogs() {
            self.is_cancelling = true;
            self.output.push(realtime::JOG_CANCEL);
        }
    }

    /// The key that was held begins nothing again.
    fn end_press(&mut self) {
        if self.jog.take().is_some() {
            self.ended_press = Some(self.press);
        }
    }

    /// Whether the machine jogs, or has jogs that it has not answered.
    fn has_jogs(&self) -> bool {
        self.status.report.state_name() == "Jog" || self.in_flight.iter().any(QueuedLine::is_jog)
    }

    /// Sends what there is room for.
    fn send(&mut self) {
        if let Some(job) = &mut self.job {
            let output = job.take_output();
            self.output.extend(&output);
            let lines = output.split(|byte| *byte == b'\n');
            for line in lines.filter(|line| !line.is_empty()) {
                let text = String::from_utf8_lossy(line).into_owned();
                self.note(Event::Line {
                    is_sent: true,
                    text,
                });
            }
        }
        self.restore_modes();
        while self.may_send_next()
            && let Some(asked) = self.waiting.pop_front()
        {
            self.send_line(asked);
        }
        self.send_jogs();
        let may_ask = self.job.is_none() || self.takes_lines_amid_job();
        if !self.is_quiet() || !may_ask || !self.is_silent() {
            return;
        }
        if !mem::replace(&mut self.are_settings_known, true) {
            self.ask(Origin::Own, "$$".into());
        } else if mem::take(&mut self.are_modes_old) {
            self.ask(Origin::Own, "$G".into());
        }
    }

    /// Sends the modes from before a probing cycle, before any other line that depends on them.
    fn restore_modes(&mut self) {
        let is_idle = self.is_ready() || self.status.report.state_name() == "Check";
        if is_idle
            && self.reports >= REST_REPORTS
            && self.in_flight.is_empty()
            && let Some(text) = self.restores.take()
        {
            self.waiting
                .push_front(QueuedLine::new(Origin::Page(None), text));
        }
    }

    /// Whether the machine has room for a line: amid a job it has in a change of the tool alone.
    fn may_send(&self, text: &str) -> bool {
        match &self.job {
            Some(_) => self.takes_lines_amid_job(),
            None => self.answers == AnswerSync::Known && self.sender.may_send(text.as_bytes()),
        }
    }

    /// Whether the line that waits first may be sent: one after the other, for one may be refused.
    fn may_send_next(&self) -> bool {
        let next = self.waiting.front();
        next.is_some_and(|asked| {
            let is_of_modes = self.restores.is_none() || asked.text.starts_with('$');
            is_of_modes && self.in_flight.is_empty() && self.may_send(&asked.text)
        })
    }

    fn send_line(&mut self, asked: QueuedLine) {
        let text = asked.text.clone();
        if let Some(job) = &mut self.job {
            job.manual_lines.send(&text, &mut self.output);
        } else {
            self.output.extend(text.as_bytes());
            self.output.push(b'\n');
            self.sender.send(text.clone().into_bytes());
        }
        self.note(Event::Line {
            is_sent: true,
            text,
        });
        self.reports = 0;
        self.in_flight.push_back(asked);
    }

    /// A setting of each axis, as far as it is known.
    fn settings_of_axes(&self, first: u16) -> Vec<Option<f64>> {
        let numbers = (first..).take(LETTERS.len());
        numbers
            .map(|number| self.settings.get(&number).copied())
            .collect()
    }

    /// Takes a setting that the machine has, of a line of either side.
    fn take_setting(&mut self, line: &str) {
        if let Line::Setting(number, value) = Line::read(line) {
            let value = value.parse().ok();
            self.settings.extend(value.map(|value| (number, value)));
        }
    }

    fn send_jogs(&mut self) {
        let Some(position) = self.position_mm() else {
            return;
        };
        let accelerations = self.settings_of_axes(ACCELERATION);
        let of = Origin::Jog(self.jogs);
        while self.in_flight.len() < MOST_JOGS
            && self.may_send(LONGEST_JOG)
            && let Some(jog) = &mut self.jog
            && let Some(text) = jog.next(&position, &accelerations)
        {
            self.send_line(QueuedLine::new(of, text));
        }
    }

    /// Tells what has changed.
    fn show(&mut self) {
        self.show_job();
        let (report, status) = (&self.status.report, &self.status);
        self.state.state.clone_from(&report.state);
        self.state.machine = status.machine_position().unwrap_or_default();
        self.state.work = status.work_position().unwrap_or_default();
        self.state.feed = report.feed().unwrap_or_default();
        self.state.spindle = report.spindle_speed().unwrap_or_default();
        self.state.overrides = status.overrides;
        self.state.pins = report.pins().into();
        self.state.is_probing = self.cycle.is_some();
        self.state.reports_inches = self.reports_inches();
        self.state.room = report.room().map(|room| (room.blocks, room.bytes));
        if let Some(accessories) = report.accessories() {
            self.state.accessories = accessories.into();
        }
        if self.state != self.shown {
            self.shown.clone_from(&self.state);
            let state = Box::new(self.state.clone());
            self.events.push(Event::State(state));
        }
    }
}
