//! A job that is sent: what is sent when, what the machine's lines mean, and what the operator's keys do.
//!
//! Pure: bytes and keys go in, bytes and notes come out, and the caller owns line, clock and screen.

use std::mem;

use host::sender::{Answered, Received, Response, Sender};
use leadscrew::model::Alarm;

use crate::{
    machine::{HOLD, REPORT, RESET, meaning},
    status::Status,
};

/// Waits until everything is done: a dwell is answered at its end.
const LAST: &[u8] = b"G4 P0.01";

/// What the operator wants.
#[derive(Debug, Clone, Copy, PartialEq, Eq)]
pub(crate) enum Key {
    /// Feed hold.
    Hold,
    /// Cycle start.
    Resume,
    /// The end of the job.
    Stop,
    /// One of the other realtime bytes.
    Realtime(u8),
}

/// The keys, in the order in which they are shown, and what they ask for.
pub(crate) const KEYS: [(u8, Key); 12] = [
    (b'h', Key::Hold),
    (b'r', Key::Resume),
    (b'q', Key::Stop),
    // Feed: 10 % more, 10 % less, as programmed.
    (b'+', Key::Realtime(0x91)),
    (b'-', Key::Realtime(0x92)),
    (b'0', Key::Realtime(0x90)),
    // Rapids: full, a half, a quarter.
    (b'f', Key::Realtime(0x95)),
    (b'm', Key::Realtime(0x96)),
    (b'l', Key::Realtime(0x97)),
    // Spindle: 10 % more, 10 % less.
    (b'S', Key::Realtime(0x9a)),
    (b's', Key::Realtime(0x9b)),
    // Flood coolant on and off.
    (b'c', Key::Realtime(0xa0)),
];

impl Key {
    /// The key of a byte.
    pub(crate) fn of(byte: u8) -> Option<Self> {
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
pub(crate) enum Phase {
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

/// A job.
pub(crate) struct Job {
    /// What is to be sent, first the lines of the approach.
    lines: Vec<Vec<u8>>,
    approach: usize,
    /// The line of the program behind the approach, counted from 0.
    first: usize,
    next: usize,
    sender: Sender,
    pub(crate) phase: Phase,
    pub(crate) status: Status,
    /// The operator has asked for a hold.
    is_hold_asked: bool,
    /// That the machine waits has been told.
    is_wait_told: bool,
    /// Somebody can press a key.
    pub(crate) has_operator: bool,
    /// A refused line does not end the job.
    goes_on: bool,
    /// The dwell at the end has been sent.
    is_last_sent: bool,
    output: Vec<u8>,
    notes: Vec<String>,
    /// The machine's last message.
    message: String,
}

impl Job {
    /// A program from a line on, counted from 0, behind an approach.
    pub(crate) fn new(
        approach: &[String],
        program: &[Vec<u8>],
        first: usize,
        goes_on: bool,
    ) -> Self {
        let before = approach.iter().map(|line| line.as_bytes().to_vec());
        Self {
            lines: before.chain(program[first..].iter().cloned()).collect(),
            approach: approach.len(),
            first,
            next: 0,
            sender: Sender::default(),
            phase: Phase::Running,
            status: Status::default(),
            is_hold_asked: false,
            is_wait_told: false,
            has_operator: true,
            goes_on,
            is_last_sent: false,
            output: Vec::new(),
            notes: Vec::new(),
            message: String::new(),
        }
    }

    /// Lines of the program that have been answered, with those before the first.
    pub(crate) fn answered(&self) -> usize {
        let answered = (self.sender.answered() as usize).min(self.lines.len());
        self.first + answered.saturating_sub(self.approach)
    }

    /// Takes the bytes that are to be sent now.
    pub(crate) fn take_output(&mut self) -> Vec<u8> {
        if self.phase == Phase::Running {
            self.fill();
        }
        mem::take(&mut self.output)
    }

    /// Takes what the operator is to read.
    pub(crate) fn take_notes(&mut self) -> Vec<String> {
        mem::take(&mut self.notes)
    }

    /// Asks for a report.
    pub(crate) fn ask(&mut self) {
        self.output.push(REPORT);
    }

    /// Sends what the machine has room for.
    fn fill(&mut self) {
        while let Some(line) = self.lines.get(self.next) {
            if !self.sender.may_send(line) {
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
    pub(crate) fn receive(&mut self, line: &str) {
        if self.status.read(line) {
            self.look();
        } else if let Some(number) = line.strip_prefix("ALARM:") {
            self.alarm(number);
        } else if line.starts_with("Grbl") {
            self.welcome();
        } else {
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
    }

    fn answer(&mut self, answered: &Answered) {
        let Response::Error(number) = answered.response else {
            return;
        };
        let index = answered.number as usize - 1;
        let text = String::from_utf8_lossy(&answered.line);
        let place = if index < self.approach {
            "the approach".into()
        } else {
            format!("line {}", index - self.approach + self.first + 1)
        };
        let refusal = format!(
            "{place} is refused: {text}: error:{number}{}",
            meaning(number)
        );
        if self.goes_on && index >= self.approach {
            self.notes.push(refusal);
        } else {
            self.stop(refusal);
        }
    }

    /// Looks at a report.
    fn look(&mut self) {
        match &self.phase {
            Phase::Stopping(reason) if self.status.is_at_rest() => {
                self.output.push(RESET);
                self.phase = Phase::Resetting(reason.clone());
            }
            Phase::Running if self.status.state == "Alarm" => {
                self.phase = Phase::Failed("the machine is locked".into());
            }
            Phase::Running if self.status.is_held() => self.wait(),
            Phase::Running => {
                self.is_wait_told = false;
                let is_done = self.is_last_sent && self.sender.is_done();
                if is_done && matches!(self.status.state.as_str(), "Idle" | "Check") {
                    self.phase = Phase::Done;
                }
            }
            Phase::Stopping(_) | Phase::Resetting(_) | Phase::Done | Phase::Failed(_) => {}
        }
    }

    /// The machine waits: for the operator, who may have asked for that.
    fn wait(&mut self) {
        if !self.has_operator {
            let why = match self.message.as_str() {
                "" => self.status.state.clone(),
                message => message.into(),
            };
            self.stop(format!(
                "the machine waits for its operator ({why}), and nobody is there"
            ));
        } else if !self.is_wait_told {
            self.is_wait_told = true;
            let why = if self.is_hold_asked {
                "is held"
            } else {
                "waits"
            };
            self.notes
                .push(format!("the machine {why}: r resumes, q stops"));
        }
    }

    fn alarm(&mut self, number: &str) {
        let mut alarms = Alarm::ALL.into_iter();
        let alarm = alarms.find(|alarm| alarm.number().to_string() == number);
        let text = alarm.map_or(String::new(), |alarm| format!(", {}", alarm.text()));
        self.phase = Phase::Failed(format!("ALARM:{number}{text}"));
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
    pub(crate) fn stop(&mut self, reason: String) {
        if self.phase == Phase::Running {
            self.output.push(HOLD);
            self.output.push(REPORT);
            self.phase = Phase::Stopping(reason);
        }
    }

    /// Takes a key.
    pub(crate) fn press(&mut self, key: Key) {
        if self.phase != Phase::Running {
            return;
        }
        match key {
            Key::Hold => {
                self.is_hold_asked = true;
                self.output.push(HOLD);
            }
            Key::Resume => {
                self.is_hold_asked = false;
                self.is_wait_told = false;
                self.output.push(b'~');
            }
            Key::Stop => self.stop("the operator has stopped the job".into()),
            Key::Realtime(byte) => self.output.push(byte),
        }
    }

    /// Ctrl-C: first a hold, where somebody can resume; then the end of the job.
    pub(crate) fn interrupt(&mut self) {
        if self.has_operator && !self.is_hold_asked {
            self.press(Key::Hold);
            self.notes.push("held: r resumes, q or Ctrl-C stops".into());
        } else {
            self.stop("the job was interrupted".into());
        }
    }
}

#[cfg(test)]
mod tests {
    use super::*;

    fn job(program: &[&str]) -> Job {
        let lines: Vec<_> = program
            .iter()
            .map(|line| line.as_bytes().to_vec())
            .collect();
        Job::new(&[], &lines, 0, false)
    }

    fn sent(job: &mut Job) -> String {
        String::from_utf8_lossy(&job.take_output()).into_owned()
    }

    fn receive(job: &mut Job, lines: &[&str]) {
        for line in lines {
            job.receive(line);
        }
    }

    const RUN: &str = "<Run|MPos:0.000,0.000,0.000|FS:0,0>";
    const HELD: &str = "<Hold:0|MPos:0.000,0.000,0.000|FS:0,0>";
    const BRAKING: &str = "<Hold:1|MPos:0.000,0.000,0.000|FS:0,0>";
    const IDLE: &str = "<Idle|MPos:0.000,0.000,0.000|FS:0,0>";

    #[test]
    fn a_job_is_done_when_the_machine_is_at_rest_behind_its_last_line() {
        let mut job = job(&["G0 X1", "G0 X2"]);
        assert_eq!(sent(&mut job), "G0 X1\nG0 X2\n");
        receive(&mut job, &["ok", IDLE, "ok", IDLE]);
        assert_eq!(job.phase, Phase::Running);
        assert_eq!(sent(&mut job), "G4 P0.01\n");
        receive(&mut job, &[IDLE, "ok", RUN]);
        assert_eq!(job.phase, Phase::Running);
        receive(&mut job, &[IDLE]);
        assert_eq!((&job.phase, job.answered()), (&Phase::Done, 2));
    }

    #[test]
    fn no_more_bytes_are_in_flight_than_the_machine_keeps() {
        let line = "X".repeat(60);
        let mut job = job(&[line.as_str(); 5]);
        assert_eq!(sent(&mut job).len(), 122);
        assert_eq!(sent(&mut job), "");
        receive(&mut job, &["ok"]);
        assert_eq!(sent(&mut job).len(), 61);
    }

    #[test]
    fn a_refused_line_ends_the_job_with_a_reset_at_rest() {
        let mut job = job(&["G0 X1", "G999", "G0 X2"]);
        sent(&mut job);
        receive(&mut job, &["ok", "error:20", "ok"]);
        assert_eq!(sent(&mut job), "!?");
        receive(&mut job, &[RUN, BRAKING]);
        assert_eq!(sent(&mut job), "");
        receive(&mut job, &[HELD]);
        assert_eq!(sent(&mut job), "\u{18}");
        receive(&mut job, &["", "Grbl 1.1h ['$' for help]"]);
        let Phase::Failed(reason) = &job.phase else {
            panic!("{:?}", job.phase);
        };
        assert!(
            reason.starts_with("line 2 is refused: G999: error:20, "),
            "{reason}"
        );
    }

    #[test]
    fn a_refused_line_is_only_told_where_that_is_asked_for_but_never_one_of_the_approach() {
        let lines = [b"G0 X1".to_vec(), b"G999".to_vec(), b"G0 X2".to_vec()];
        let mut job = Job::new(&["G53 G0 Z0".into()], &lines, 1, true);
        sent(&mut job);
        receive(&mut job, &["ok", "error:20"]);
        assert_eq!((&job.phase, job.answered()), (&Phase::Running, 2));
        assert!(job.take_notes()[0].starts_with("line 2 is refused"));
        let mut job = Job::new(&["G53 G0 Z0".into()], &lines, 1, true);
        sent(&mut job);
        receive(&mut job, &["error:9"]);
        assert!(
            matches!(&job.phase, Phase::Stopping(reason) if reason.starts_with("the approach"))
        );
        assert_eq!(job.answered(), 1);
    }

    #[test]
    fn answers_behind_a_reset_are_of_lines_that_were_not_carried_out() {
        let mut job = job(&["G0 X1", "M5", "G0 X2"]);
        sent(&mut job);
        receive(&mut job, &["ok"]);
        job.stop("stop".into());
        receive(&mut job, &[HELD, "ok", "Grbl 1.1h ['$' for help]"]);
        assert_eq!(
            (job.phase.clone(), job.answered()),
            (Phase::Failed("stop".into()), 1)
        );
    }

    #[test]
    fn a_pause_waits_for_the_operator_and_ends_the_job_where_there_is_none() {
        let mut job = job(&["T1 M6"]);
        sent(&mut job);
        receive(&mut job, &["[MSG:Tool change: T1]", HELD, HELD]);
        let notes = job.take_notes();
        assert_eq!(
            notes,
            [
                "[MSG:Tool change: T1]",
                "the machine waits: r resumes, q stops"
            ]
        );
        job.press(Key::Resume);
        assert_eq!(sent(&mut job), "~");
        receive(&mut job, &[RUN]);
        job.has_operator = false;
        receive(&mut job, &[HELD]);
        let Phase::Stopping(reason) = &job.phase else {
            panic!("{:?}", job.phase);
        };
        assert!(reason.contains("Tool change: T1"), "{reason}");
    }

    #[test]
    fn ctrl_c_holds_first_and_then_stops() {
        let mut job = job(&["G0 X1"]);
        sent(&mut job);
        job.interrupt();
        assert_eq!(
            (sent(&mut job).as_str(), &job.phase),
            ("!", &Phase::Running)
        );
        job.interrupt();
        assert!(matches!(job.phase, Phase::Stopping(_)));
        let mut alone = self::job(&["G0 X1"]);
        alone.has_operator = false;
        alone.interrupt();
        assert!(matches!(alone.phase, Phase::Stopping(_)));
    }

    #[test]
    fn an_alarm_and_a_reset_from_elsewhere_end_the_job() {
        let mut limit = job(&["G0 X1"]);
        receive(&mut limit, &["ALARM:1"]);
        assert!(matches!(&limit.phase, Phase::Failed(reason) if reason.len() > "ALARM:1, ".len()));
        let mut reset = job(&["G0 X1"]);
        receive(&mut reset, &["Grbl 1.1h ['$' for help]"]);
        assert_eq!(
            reset.phase,
            Phase::Failed("the machine has been reset".into())
        );
    }

    #[test]
    fn keys_are_the_realtime_bytes_of_the_protocol() {
        let mut job = job(&[]);
        sent(&mut job);
        for (key, byte) in [
            (b'!', b'!'),
            (b'~', b'~'),
            (b'+', 0x91),
            (b'-', 0x92),
            (b'0', 0x90),
            (b'l', 0x97),
        ] {
            job.press(Key::of(key).unwrap());
            assert_eq!(job.take_output(), [byte], "{key}");
        }
        assert_eq!(Key::of(b'x'), None);
    }
}
