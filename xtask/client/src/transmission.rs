//! The transmission of a job: the lines to send, the answers of the machine and the keys of the operator.
//!
//! Pure: bytes and keys go in, bytes and notes come out, and the caller owns line, clock and screen.

use std::mem;

use leadscrew::{axis::LETTERS, model::Alarm};

use crate::{
    Line, ManualLines, Report, Response, Sender, Status,
    meaning::{self, LineOfAlarm},
    realtime,
    sender::{Answered, Received, sendable, shown},
};

/// Waits until everything is done: a dwell is answered at its end.
const LAST: &[u8] = b"G4 P0.01";

/// What the operator wants.
#[derive(Debug, Clone, Copy, PartialEq, Eq)]
pub enum Key {
    /// Feed hold.
    Hold,
    /// Cycle start.
    Resume,
    /// The end of the job.
    Stop,
    /// Lines by hand, during a change of the tool.
    ManualLines,
    /// One of the other realtime bytes.
    Realtime(u8),
}

/// The keys, in the order in which they are shown, and what they ask for.
pub const KEYS: [(u8, Key); 13] = [
    (b'h', Key::Hold),
    (b'r', Key::Resume),
    (b'q', Key::Stop),
    (b't', Key::ManualLines),
    (b'+', Key::Realtime(realtime::FEED_PLUS_10)),
    (b'-', Key::Realtime(realtime::FEED_MINUS_10)),
    (b'0', Key::Realtime(realtime::FEED_RESET)),
    (b'f', Key::Realtime(realtime::RAPIDS_FULL)),
    (b'm', Key::Realtime(realtime::RAPIDS_HALF)),
    (b'l', Key::Realtime(realtime::RAPIDS_QUARTER)),
    (b'S', Key::Realtime(realtime::SPINDLE_PLUS_10)),
    (b's', Key::Realtime(realtime::SPINDLE_MINUS_10)),
    (b'c', Key::Realtime(realtime::FLOOD_TOGGLE)),
];

impl Key {
    /// The key of a byte.
    #[must_use]
    pub fn of(byte: u8) -> Option<Self> {
        let byte = match byte {
            b'!' | b' ' | b'H' => b'h',
            b'~' | b'R' | b'\n' | b'\r' => b'r',
            b'Q' => b'q',
            byte => byte,
        };
        KEYS.iter()
            .find(|(key, _)| *key == byte)
            .map(|(_, key)| *key)
    }
}

/// Where a job is.
#[derive(Debug, Clone, PartialEq, Eq)]
pub enum Phase {
    /// Lines are sent.
    Running,
    /// It is being stopped for a reason: when the machine is at rest, it is reset.
    Stopping(String),
    /// The reset is not answered yet.
    Resetting(String),
    /// Everything has been carried out.
    Done,
    /// It has ended for a reason.
    Failed(String),
}

/// The transmission of a job.
#[derive(Debug)]
pub struct Transmission {
    /// What is to be sent, first the lines of the approach.
    lines: Vec<Vec<u8>>,
    approach: usize,
    /// The first line of the program after the approach, counted from 0.
    pub first: usize,
    next: usize,
    /// It fills at most a receive buffer of Grbl's size: lines of the operator need room after the lines of the job.
    sender: Sender,
    /// How far it is.
    pub phase: Phase,
    /// The last report.
    pub status: Status,
    /// The operator has asked for a hold.
    is_hold_asked: bool,
    /// A note has reported that the machine waits.
    is_wait_reported: bool,
    /// The machine waits, and not because the operator holds it.
    is_waiting: bool,
    /// What the operator types during a change of the tool.
    pub manual_lines: ManualLines,
    /// Lines that were answered before a change of the tool in which the operator has set an offset.
    pub measured: Option<usize>,
    /// Somebody can press a key.
    pub has_operator: bool,
    /// Notes name the keys of [`KEYS`].
    pub has_keyboard: bool,
    /// A refused line does not end the job.
    ignores_refusals: bool,
    /// Lines that were refused.
    pub refused: u64,
    /// The first line of the program that the machine may not have carried out, from 0.
    pub undone: usize,
    /// Where the machine came to rest in a hold before it was reset: its position is that of the job.
    pub stopped_at: Option<Vec<f64>>,
    /// The travel of each axis that has one.
    pub travel_mm: Vec<Option<[f64; 2]>>,
    /// The dwell at the end has been sent.
    is_last_sent: bool,
    output: Vec<u8>,
    notes: Vec<String>,
    /// The machine's last message.
    message: String,
}

impl Transmission {
    /// A program from a line on, counted from 0, behind an approach.
    #[must_use]
    pub fn new(
        approach: &[String],
        program: &[Vec<u8>],
        first: usize,
        ignores_refusals: bool,
    ) -> Self {
        let before = approach.iter().map(|line| sendable(line.as_bytes()));
        Self {
            lines: before.chain(program[first..].iter().cloned()).collect(),
            approach: approach.len(),
            first,
            next: 0,
            sender: Sender::default(),
            phase: Phase::Running,
            status: Status::default(),
            is_hold_asked: false,
            is_wait_reported: false,
            is_waiting: false,
            manual_lines: ManualLines::default(),
            measured: None,
            has_operator: true,
            has_keyboard: true,
            ignores_refusals,
            refused: 0,
            undone: first,
            stopped_at: None,
            travel_mm: Vec::new(),
            is_last_sent: false,
            output: Vec::new(),
            notes: Vec::new(),
            message: String::new(),
        }
    }

    /// Lines of the program that have been answered, with those before the first.
    #[must_use]
    pub fn answered(&self) -> usize {
        let answered = (self.sender.answered() as usize).min(self.lines.len());
        self.first + answered.saturating_sub(self.approach)
    }

    /// Number, from 1, and text of the oldest line that is not answered: the approach counts.
    #[must_use]
    pub fn oldest(&self) -> Option<(u64, &[u8])> {
        let is_of_job = |(number, _): &(u64, _)| *number <= self.lines.len() as u64;
        self.sender.oldest().filter(is_of_job)
    }

    /// Takes the bytes that are to be sent now.
    pub fn take_output(&mut self) -> Vec<u8> {
        if self.phase == Phase::Running {
            self.fill();
        }
        mem::take(&mut self.output)
    }

    /// Takes what the operator is to read.
    pub fn take_notes(&mut self) -> Vec<String> {
        mem::take(&mut self.notes)
    }

    /// Asks for a report.
    pub fn ask(&mut self) {
        self.output.push(realtime::REPORT);
    }

    /// Sends what the machine has room for.
    fn fill(&mut self) {
        if self.manual_lines.is_on() {
            return;
        }
        while let Some(line) = self.lines.get(self.next) {
            // Nothing is carried out behind a refused line of the approach.
            let is_alone = self.next <= self.approach && self.approach > 0;
            if !self.sender.may_send(line) || is_alone && !self.sender.is_done() {
                return;
            }
            self.output.extend(line);
            self.output.push(b'\n');
            self.sender.send(line.clone());
            self.next += 1;
        }
        if !self.is_last_sent && self.sender.is_done() {
            self.is_last_sent = true;
            self.output.extend(LAST);
            self.output.push(b'\n');
            self.sender.send(LAST.to_vec());
        }
    }

    /// Takes a line of the machine.
    pub fn receive(&mut self, line: &str) {
        match Line::read(line) {
            Line::Report(report) => self.take_report(report),
            Line::Alarm(number) => self.alarm(number),
            Line::Welcome => self.welcome(),
            _ => self.receive_other(line),
        }
    }

    /// Takes a report of the machine.
    pub fn take_report(&mut self, report: Report) {
        self.status.take(report);
        let note = self.manual_lines.report(&self.status.report.state);
        let is_of_keys = self.manual_lines.takes_lines();
        let note = note.filter(|_| self.has_keyboard || !is_of_keys);
        self.notes.extend(note.map(str::to_owned));
        self.update_phase();
    }

    /// Takes an answer or a message.
    fn receive_other(&mut self, line: &str) {
        if let Some(note) = self.manual_lines.answer(line) {
            self.notes.extend(self.has_keyboard.then_some(note));
            return;
        }
        // Lines that a reset has interrupted are answered, too, but have not been carried out.
        if matches!(self.phase, Phase::Resetting(_)) {
            return;
        }
        match self.sender.receive(line) {
            Received::Answer(answered) => self.answer(&answered),
            Received::Surplus(_) => {}
            Received::Message if line.is_empty() => {}
            Received::Message => {
                self.message = line.into();
                self.notes.push(line.into());
            }
        }
    }

    /// Names the sent line of an index, from 0: by its number in the program.
    fn place(&self, index: usize) -> String {
        if index < self.approach {
            "the approach".into()
        } else {
            format!("line {}", index - self.approach + self.first + 1)
        }
    }

    fn answer(&mut self, answered: &Answered) {
        let Response::Error(number) = answered.response else {
            return;
        };
        let index = answered.number as usize - 1;
        let text = shown(&answered.line);
        let place = self.place(index);
        self.refused += 1;
        let refusal = format!(
            "{place} ({text}): error:{number}{}",
            meaning::after_comma(meaning::error_with_remedy(number).as_deref())
        );
        if self.ignores_refusals && index >= self.approach {
            self.notes.push(refusal);
        } else {
            self.stop(refusal);
        }
    }

    /// Updates the phase from the last report.
    fn update_phase(&mut self) {
        match &self.phase {
            Phase::Stopping(reason) if self.status.report.is_at_rest() => {
                // What an approach passes, or a parked tool, is not the path of the job.
                let is_in_job = self.approach == 0;
                if is_in_job && self.status.report.state_name() == "Hold" {
                    self.stopped_at = self.status.machine_position();
                }
                self.output.push(realtime::RESET);
                self.phase = Phase::Resetting(reason.clone());
            }
            // The operator unlocks it, where he has probed nothing.
            Phase::Running
                if self.status.report.state_name() == "Alarm"
                    && self.manual_lines.is_on()
                    && self.has_operator => {}
            Phase::Running if self.status.report.state_name() == "Alarm" => {
                self.phase = Phase::Failed("the machine is locked".into());
            }
            Phase::Running if self.status.report.is_held() => {
                self.is_waiting |= !self.is_hold_asked;
                self.wait();
            }
            Phase::Running => {
                self.is_wait_reported = false;
                if mem::take(&mut self.is_waiting) {
                    self.message.clear();
                }
                let is_done = self.is_last_sent && self.sender.is_done();
                if is_done && matches!(self.status.report.state_name(), "Idle" | "Check") {
                    self.phase = Phase::Done;
                }
            }
            Phase::Stopping(_) | Phase::Resetting(_) | Phase::Done | Phase::Failed(_) => {}
        }
    }

    /// Reports that the machine waits for the operator, or stops where nobody can press a key.
    fn wait(&mut self) {
        if !self.has_operator {
            let why = match self.message.as_str() {
                "" => self.status.report.state.clone(),
                message => message.into(),
            };
            self.stop(format!(
                "the machine waits for its operator ({why}), and nobody is there"
            ));
        } else if self.has_keyboard && !self.is_wait_reported {
            self.is_wait_reported = true;
            let why = if self.is_hold_asked {
                "is held"
            } else {
                "waits"
            };
            self.notes
                .push(format!("the machine {why}: r resumes, q stops"));
            if self.message.starts_with("[MSG:Tool change") && !self.manual_lines.is_on() {
                self.notes
                    .push("t: type lines, to jog and probe with the new tool".into());
            }
        }
    }

    /// For what the machine waits, unless the operator holds it: its last message, or its state.
    #[must_use]
    pub fn waits(&self) -> Option<&str> {
        let is_running = self.phase == Phase::Running;
        let message = match Line::read(&self.message) {
            Line::Message(text) => text,
            _ if self.message.is_empty() => self.status.report.state_name(),
            _ => &self.message,
        };
        (is_running && self.is_waiting).then_some(message)
    }

    fn alarm(&mut self, number: &str) {
        if self.manual_lines.is_on() {
            let text = meaning::alarm_with_remedy(number, None);
            let text = text.unwrap_or_else(|| "$X unlocks the machine".into());
            self.notes.push(format!("ALARM:{number}, {text}"));
            return;
        }
        let is_of_travel = number.parse() == Ok(Alarm::SoftLimit.number());
        let details = is_of_travel.then(|| self.travel());
        let text = meaning::alarm_with_remedy(number, details.as_deref());
        let text = meaning::after_comma(text.as_deref());
        let place = self.place_of_alarm(number);
        self.phase = Phase::Failed(format!("{place}ALARM:{number}{text}"));
    }

    /// The line at which an alarm has risen, before a colon: the lines of which it is one, or nothing.
    fn place_of_alarm(&self, number: &str) -> String {
        let index = self.sender.answered() as usize;
        let undone = self.undone.saturating_sub(self.first) + self.approach;
        let Some(last) = self.lines.len().checked_sub(1) else {
            return String::new();
        };
        match meaning::line_of_alarm(number) {
            Some(LineOfAlarm::InExecution) if undone < index.min(last) => {
                let (first, last) = (self.place(undone), self.place(index.min(last)));
                format!("{first} to {last}: ")
            }
            Some(_) if index <= last => {
                format!("{} ({}): ", self.place(index), shown(&self.lines[index]))
            }
            Some(LineOfAlarm::InExecution) => format!("{}: ", self.place(last)),
            Some(LineOfAlarm::Unanswered) | None => String::new(),
        }
    }

    /// The travel of the machine and its work zero, as far as they are known.
    fn travel(&self) -> String {
        let axes = LETTERS.iter().map(|letter| char::from(*letter));
        let ranges = axes.clone().zip(&self.travel_mm);
        let ranges = ranges.filter_map(|(axis, travel)| {
            travel.map(|[lowest, highest]| format!("{axis} {lowest:.3} to {highest:.3}"))
        });
        let zeros = axes.zip(self.status.work_offset().unwrap_or_default());
        let zeros: Vec<_> = zeros.map(|(axis, mm)| format!("{axis} {mm:.3}")).collect();
        let ranges = ranges.collect::<Vec<_>>().join(", ");
        if zeros.is_empty() {
            return format!("it is {ranges}");
        }
        format!("it is {ranges}; the work zero is at {}", zeros.join(" "))
    }

    fn welcome(&mut self) {
        self.phase = match &self.phase {
            Phase::Resetting(reason) => Phase::Failed(reason.clone()),
            Phase::Running | Phase::Stopping(_) => {
                Phase::Failed("the machine has been reset".into())
            }
            Phase::Done | Phase::Failed(_) => return,
        };
    }

    /// Ends the job: the machine is held, and reset when it is at rest, so that it keeps its position.
    pub fn stop(&mut self, reason: String) {
        if self.phase == Phase::Running {
            self.output.push(realtime::HOLD);
            self.output.push(realtime::REPORT);
            self.phase = Phase::Stopping(reason);
        }
    }

    /// Takes a key.
    pub fn press(&mut self, key: Key) {
        if self.phase != Phase::Running {
            return;
        }
        match key {
            Key::Hold => {
                self.is_hold_asked = true;
                self.output.push(realtime::HOLD);
            }
            Key::ManualLines if self.status.report.is_held() => {
                self.manual_lines.begin(&mut self.output);
            }
            Key::ManualLines => {}
            Key::Resume => {
                self.manual_lines.resume();
                self.is_hold_asked = false;
                self.is_wait_reported = false;
                self.output.push(realtime::RESUME);
            }
            Key::Stop => self.stop("the operator has stopped the job".into()),
            Key::Realtime(byte) => self.output.push(byte),
        }
    }

    /// Takes a byte of the keyboard: of a line that is being typed, or a key.
    pub fn key(&mut self, byte: u8) {
        if self.manual_lines.is_asked() {
            return;
        }
        if self.manual_lines.text.is_none() {
            if let Some(key) = Key::of(byte) {
                self.press(key);
            }
        } else if self.phase == Phase::Running {
            if self.manual_lines.press(byte, &mut self.output) {
                // A hold before this line was of another move.
                self.is_hold_asked = false;
            }
            if self.manual_lines.has_set {
                self.measured = Some(self.answered());
            }
        }
    }

    /// Ctrl-C: first a hold, where somebody can resume; then the end of the job.
    pub fn interrupt(&mut self) {
        if self.has_operator && !self.is_hold_asked {
            self.press(Key::Hold);
            self.notes.push("held: r resumes, q or Ctrl-C stops".into());
        } else {
            self.stop("the job was interrupted".into());
        }
    }
}

#[cfg(test)]
mod tests;
