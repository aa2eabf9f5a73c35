//! Programs on the virtual machine, and what is kept of them: answers, messages and steps.

use std::{borrow, cell::RefCell, collections::VecDeque, error, fmt, rc::Rc};

use anyhow::{Error, Result, bail};
use common::BAUD;
use leadscrew::{
    axis::LETTERS,
    gcode::LineError,
    model::{Alarm, State},
    path::OutsideTravel,
    protocol::{Dialect, Session},
    settings::Settings,
    sim::{Edge, PlayedSegment, Simulator, StepStatistics, Stream, StreamEnd, Watcher},
    units::{Nm, TICKS_PER_SECOND},
};

use crate::{
    Refusals,
    figures::{Figures, Final, Responses},
    job_times::JobTimes,
    meaning::{self, LineOfAlarm},
    program::Program,
    sender::{Response, shown},
};

/// What is made of a run besides its figures.
pub trait Recorder {
    /// A line is sent: before the steps come that it makes.
    fn line(&mut self, line: &[u8]) {
        let _ = line;
    }
    /// The pins change; the statistics have it in them.
    fn edge(&mut self, edge: &Edge, statistics: &StepStatistics) -> Result<()> {
        let _ = (edge, statistics);
        Ok(())
    }
    /// Something changes, if only the time.
    fn change(&mut self, simulator: &Simulator) -> Result<()> {
        let _ = simulator;
        Ok(())
    }
    /// A segment begins.
    fn segment(&mut self, segment: &PlayedSegment) {
        let _ = segment;
    }
    /// The oldest line that has no answer gets it.
    fn answer(&mut self, is_refused: bool) {
        let _ = is_refused;
    }
    /// One of the first lines that are refused gets its answer.
    fn refused(&mut self, number: u64, line: &[u8], response: Response) {
        let _ = (number, line, response);
    }
    /// An alarm rises.
    fn alarm(&mut self, alarm: &RaisedAlarm) {
        let _ = alarm;
    }
    /// Whether the user has seen the alarms, and is not told of them at the end.
    fn shows_alarms(&self) -> bool {
        false
    }
    /// The machine stands still, and the program does not go on.
    fn stuck(&mut self, refusals: &Refusals) {
        let _ = refusals;
    }
    /// So many bytes of the program have been read.
    fn read(&mut self, bytes: u64) {
        let _ = bytes;
    }
    /// Whether segments are to have the numbers of their lines, see [`Stream::with_numbers`].
    fn wants_line_numbers(&self) -> bool {
        false
    }
}

impl Recorder for () {}

/// An alarm, and the line that raised it: as far as is known, or the last one that was answered.
#[derive(Debug, Clone, Default, PartialEq, Eq)]
pub struct RaisedAlarm {
    /// The number of the line, from 1; 0 where it is not known.
    pub line: u64,
    /// The line, where it raised the alarm.
    pub text: String,
    /// `ALARM:2`.
    pub name: String,
    /// What it means, and what to do.
    pub why: String,
}

impl RaisedAlarm {
    /// An alarm of a machine that has said no more than its number, at a line.
    pub fn at(number: &str, (line, text): (u64, &[u8])) -> Self {
        let why = meaning::alarm_with_remedy(number, None);
        Self {
            line,
            text: shown(text),
            name: format!("ALARM:{number}"),
            why: why.unwrap_or_else(|| "an unknown alarm".into()),
        }
    }
}

impl fmt::Display for RaisedAlarm {
    fn fmt(&self, f: &mut fmt::Formatter<'_>) -> fmt::Result {
        let Self {
            line, name, why, ..
        } = self;
        if *line > 0 {
            write!(f, "line {line}")?;
            if !self.text.is_empty() {
                write!(f, " ({})", self.text)?;
            }
            write!(f, ": ")?;
        }
        write!(f, "{name}, {why}")
    }
}

impl error::Error for RaisedAlarm {}

/// What an alarm means on a machine that has just raised it, and what to do: of a line that leaves the travel with the
/// coordinate.
pub fn reason_of_alarm(number: &str, session: &Session) -> String {
    let is_of_travel = number.parse() == Ok(Alarm::SoftLimit.number());
    let outside = is_of_travel.then(|| session.outside_travel()).flatten();
    let details = outside.map(|(outside, is_compensated)| {
        let of = if is_compensated {
            ", in a move that cutter compensation has held back"
        } else {
            ""
        };
        outside_travel(outside, session.settings()) + of
    });
    let reason = meaning::alarm_with_remedy(number, details.as_deref());
    reason.unwrap_or_else(|| "an unknown alarm".into())
}

/// A coordinate outside the travel, and the travel.
pub fn outside_travel(outside: OutsideTravel, settings: &Settings) -> String {
    let axis = char::from(LETTERS[outside.axis]);
    let mm = |position: Nm| format!("{:.3}", position.to_mm_f64());
    let travel = settings.travel(outside.axis).unwrap_or_default();
    let [lowest, highest] = travel.map(mm);
    let position = mm(outside.position);
    format!("{axis} {position} in machine coordinates is not within {lowest} to {highest}")
}

/// A program on its way through a machine, which it owns or borrows.
pub struct Playing<S, R> {
    stream: Stream<S, Source<R>>,
    observer: Rc<RefCell<Observer<R>>>,
    end: Option<StreamEnd>,
}

impl<S: borrow::BorrowMut<Simulator>, R: Recorder> Playing<S, R> {
    /// Begins a program at a fresh machine.
    pub fn new(program: Program, simulator: S, recorder: R) -> Self {
        let has_numbers = recorder.wants_line_numbers();
        let observer = Rc::new(RefCell::new(Observer::new(recorder)));
        let settings = simulator.borrow().session().settings();
        let source = Source {
            program,
            bytes: Vec::new().into_iter(),
            numbering: if Dialect::of(settings).is_reprap() {
                Numbering::ToBegin
            } else {
                Numbering::None
            },
            observer: Rc::clone(&observer),
        };
        let mut stream = Stream::new(simulator, source, BAUD).with_statements_at_rest();
        if has_numbers {
            stream = stream.with_numbers();
        }
        Self {
            stream,
            observer,
            end: None,
        }
    }

    /// Goes on for at most so many changes of the machine. Returns whether the program has come to its
    /// end.
    pub fn pump(&mut self, changes: u32) -> bool {
        if self.end.is_none() {
            let mut watched = Watched(Rc::clone(&self.observer));
            self.end = self.stream.pump(&mut watched, changes);
        }
        self.end.is_some()
    }

    /// Bytes of the program that have been read.
    pub fn read(&self) -> u64 {
        self.observer.borrow().read
    }

    /// The machine.
    pub fn simulator(&self) -> &Simulator {
        self.stream.simulator.borrow()
    }

    /// Plays the remaining program, and returns the figures with the output of the recorder.
    ///
    /// # Errors
    /// The program cannot be read, or the machine stands still before its end.
    pub fn finish(mut self) -> Result<(Figures, R)> {
        while !self.pump(u32::MAX) {}
        let (simulator, lines) = {
            let stream = self.stream;
            (stream.simulator, stream.lines)
        };
        let simulator = simulator.borrow();
        let observer = Rc::into_inner(self.observer).expect("the program has gone with its stream");
        let mut observer = observer.into_inner();
        if let Some(error) = observer.failure {
            return Err(error);
        }
        if self.end == Some(StreamEnd::Stuck) {
            observer.recorder.stuck(&observer.refusals);
            let answered = observer.responses.iter().count();
            let state = simulator.snapshot().state.name();
            if let Some(alarm) = observer.refusals.alarm()
                && !observer.recorder.shows_alarms()
            {
                return Err(alarm.clone().into());
            }
            bail!(
                "the machine stands still in {state} after {answered} answers: only a reset helps"
            );
        }
        let skipped = observer.skipped;
        observer.pass(skipped);
        let lines = observer
            .sent_lines
            .as_ref()
            .map_or(lines, |_| observer.read_lines);
        let figures = Figures {
            lines,
            responses: observer.responses,
            messages: observer.messages,
            refusals: observer.refusals,
            foreign_line: observer.foreign_line,
            times: observer.times.finish(simulator.now()),
            ..figures(simulator, &observer.statistics)
        };
        Ok((figures, observer.recorder))
    }
}

/// Sends something to a machine that has come to rest, and returns what it says beside `ok`.
pub fn ask(simulator: &mut Simulator, bytes: &[u8]) -> Vec<String> {
    // What has begun at power-up comes first.
    simulator.settle();
    for byte in bytes {
        simulator.receive(*byte);
        simulator.settle();
    }
    let mut answer = Vec::new();
    while let Some(byte) = simulator.send() {
        answer.push(byte);
        simulator.settle();
    }
    let answer = String::from_utf8_lossy(&answer);
    let lines = answer
        .lines()
        .filter(|line| !line.is_empty() && *line != "ok");
    lines.map(str::to_owned).collect()
}

/// Unlocks a machine that was switched on locked, as homing would: without moving it.
pub fn unlock(simulator: &mut Simulator) {
    simulator.settle();
    if simulator.snapshot().state == State::Alarm {
        ask(simulator, b"$X\n");
    }
}

/// What a machine says to whoever is connected with it, without the reports of its state.
#[derive(Debug, Default)]
pub struct Replies {
    line: Vec<u8>,
    lines: u64,
    responses: Responses,
    messages: Vec<(u64, String)>,
}

impl Replies {
    /// Takes the next byte.
    pub fn push(&mut self, byte: u8) {
        if byte != b'\n' {
            self.line.push(byte);
            return;
        }
        let line = std::mem::take(&mut self.line);
        let text = String::from_utf8_lossy(&line);
        let text = text.trim_end_matches('\r');
        if let Some(response) = Response::parse(text) {
            self.lines += 1;
            self.responses.push(response);
        } else if !text.is_empty() && !text.starts_with('<') {
            self.messages.push((self.lines, text.into()));
        }
    }

    /// What the machine has done and said so far.
    pub fn finish(self, simulator: &Simulator, statistics: &StepStatistics) -> Figures {
        Figures {
            lines: self.lines,
            responses: self.responses,
            messages: self.messages,
            ..figures(simulator, statistics)
        }
    }
}

/// Where a machine is, and what its axes did.
fn figures(simulator: &Simulator, statistics: &StepStatistics) -> Figures {
    let snapshot = simulator.snapshot();
    let state = snapshot.state.name().into();
    // In the settings of the end: the program may have changed them.
    let settings = simulator.session().settings();
    Figures {
        end: Final::new(state, &snapshot.steps.0, settings),
        steps_axis: statistics.pulses.0.to_vec(),
        motion_time_s: statistics.motion_ticks() as f64 / f64::from(TICKS_PER_SECOND),
        events: statistics.events,
        late: simulator.late().into(),
        event_hash: format!("{:016x}", statistics.hash),
        // Of these the caller knows.
        lines: 0,
        responses: Responses::default(),
        messages: Vec::new(),
        times: JobTimes::default(),
        refusals: Refusals::default(),
        foreign_line: None,
    }
}

/// The line with which a sender of the RepRap dialect begins.
const RESET_NUMBERS: &[u8] = b"M110 N-1";

/// Returns the reason of a refusal in the RepRap dialect.
fn host_refusal(text: &str) -> Option<Response> {
    if text.starts_with("Error:Line Number") {
        return Some(Response::Error(LineError::LineNumber.number().into()));
    }
    if text.starts_with("Resend: ") {
        return Some(Response::Error(LineError::Checksum.number().into()));
    }
    if text.starts_with("echo:Unknown command") {
        return Some(Response::Error(20));
    }
    let (_, number) = text.strip_prefix("Error:")?.split_once("(error:")?;
    let number = number.trim_end_matches(')').parse().ok()?;
    Some(Response::Error(number))
}

/// Returns a line without comment and blanks at its ends, as Printrun sends it.
fn words(line: &[u8]) -> &[u8] {
    let end = line.iter().position(|byte| *byte == b';');
    end.map_or(line, |end| &line[..end]).trim_ascii()
}

/// Returns a line with its number and its checksum. Bytes that a sender leaves out are no part of it.
fn numbered(number: i64, words: &[u8]) -> Vec<u8> {
    let mut line = format!("N{number} ").into_bytes();
    let is_sent = |byte: &&u8| !matches!(**byte, b'?' | b'!' | b'~' | 0x18 | b'\r');
    line.extend(words.iter().filter(is_sent));
    let sum = line.iter().fold(0, |sum, byte| sum ^ byte);
    line.extend(format!("*{sum}\n").bytes());
    line
}

/// Returns whether the words of a line have a number before them and a checksum behind them.
fn is_numbered(words: &[u8]) -> bool {
    let [b'N' | b'n', digits @ ..] = words else {
        return false;
    };
    let digits = digits.strip_prefix(b"-").unwrap_or(digits);
    let asterisk = words.iter().rposition(|byte| *byte == b'*');
    let checksum = asterisk.map_or(&[][..], |at| words[at + 1..].trim_ascii());
    let is_checksum = !checksum.is_empty() && checksum.iter().all(u8::is_ascii_digit);
    digits.first().is_some_and(u8::is_ascii_digit) && is_checksum
}

/// Returns whether words are nothing but a comment in parentheses.
fn is_comment(words: &[u8]) -> bool {
    let end = words.iter().position(|byte| *byte == b')');
    words.first() == Some(&b'(') && end.is_none_or(|end| end + 1 == words.len())
}

/// How lines get numbers and checksums.
#[derive(Debug, Clone, Copy)]
enum Numbering {
    /// The sender speaks Grbl.
    None,
    /// With the first line.
    ToBegin,
    /// This is the number of the next line.
    From(i64),
    /// The program has its own, from some line on.
    Own,
}

/// A program as a stream of bytes.
struct Source<R> {
    program: Program,
    bytes: std::vec::IntoIter<u8>,
    numbering: Numbering,
    observer: Rc<RefCell<Observer<R>>>,
}

impl<R: Recorder> Iterator for Source<R> {
    type Item = u8;

    fn next(&mut self) -> Option<u8> {
        loop {
            if let Some(byte) = self.bytes.next() {
                return Some(byte);
            }
            let mut observer = self.observer.borrow_mut();
            match self.program.next_line() {
                Ok(Some(line)) => {
                    observer.recorder.line(&line);
                    observer.read_lines += 1;
                    observer.foreign_line = self.program.foreign_line();
                    let words = words(&line);
                    let is_host = !matches!(self.numbering, Numbering::None);
                    if is_host && words.is_empty() {
                        // Nobody answers it.
                        observer.skipped += 1;
                        continue;
                    }
                    let mut bytes = Vec::new();
                    if is_host && is_numbered(words) {
                        observer.sent_lines.get_or_insert_default();
                        self.numbering = Numbering::Own;
                    }
                    match self.numbering {
                        Numbering::ToBegin => {
                            observer.sent_lines = Some(vec![0]);
                            observer.lines.push_back(None);
                            bytes = numbered(-1, RESET_NUMBERS);
                            self.numbering = Numbering::From(0);
                        }
                        Numbering::Own if is_comment(words) => {
                            observer.skipped += 1;
                            continue;
                        }
                        _ => {}
                    }
                    if let Numbering::From(number) = &mut self.numbering {
                        bytes.extend(numbered(*number, words));
                        *number += 1;
                        observer.push_sent(words);
                    } else {
                        observer.push_sent(&line);
                        bytes.extend(line);
                        bytes.push(b'\n');
                    }
                    self.bytes = bytes.into_iter();
                }
                Ok(None) => return None,
                Err(error) => {
                    observer.failure = Some(error);
                    return None;
                }
            }
            observer.read = self.program.read();
            let read = observer.read;
            observer.recorder.read(read);
        }
    }
}

/// What is kept of a run.
struct Observer<R> {
    recorder: R,
    statistics: StepStatistics,
    responses: Responses,
    messages: Vec<(u64, String)>,
    refusals: Refusals,
    times: JobTimes,
    /// The reason that comes before the `ok` of a line that is refused in the RepRap dialect.
    refused: Option<Response>,
    /// Bytes of the program that have been read.
    read: u64,
    /// Lines that have been read and not yet answered; nothing for one that is none of the program.
    lines: VecDeque<Option<Sent>>,
    /// Lines of the program that have been read, and that are not sent before the next one is.
    read_lines: u64,
    foreign_line: Option<u64>,
    skipped: u32,
    /// The line of the program that each line is which was sent, where not all are.
    sent_lines: Option<Vec<u32>>,
    /// Whether segments have the numbers of their lines.
    has_numbers: bool,
    /// The line of the segment that has begun last; 0 where that is not known.
    moving_line: u32,
    failure: Option<Error>,
}

impl<R: Recorder> Observer<R> {
    fn new(recorder: R) -> Self {
        Self {
            has_numbers: recorder.wants_line_numbers(),
            recorder,
            statistics: StepStatistics::new(),
            responses: Responses::default(),
            messages: Vec::new(),
            refusals: Refusals::default(),
            times: JobTimes::default(),
            refused: None,
            lines: VecDeque::new(),
            read: 0,
            read_lines: 0,
            foreign_line: None,
            skipped: 0,
            sent_lines: None,
            moving_line: 0,
            failure: None,
        }
    }
}

impl<R: Recorder> Observer<R> {
    /// Keeps the line that was read last until it is answered.
    fn push_sent(&mut self, text: &[u8]) {
        let sent = Sent {
            text: text.to_vec(),
            skipped: std::mem::take(&mut self.skipped),
        };
        self.lines.push_back(Some(sent));
        if let Some(lines) = &mut self.sent_lines {
            lines.push(self.read_lines as u32);
        }
    }

    /// A line that is not sent has done nothing, and nothing is wrong with it.
    fn pass(&mut self, lines: u32) {
        for _ in 0..lines {
            self.responses.push(Response::Ok);
            self.recorder.answer(false);
        }
    }

    /// An alarm that rises after so many answers.
    fn raised(&self, number: &str, answers: u32, session: &Session) -> RaisedAlarm {
        let (line, text) = match meaning::line_of_alarm(number) {
            Some(LineOfAlarm::Unanswered) => {
                let sent = self.lines.iter().flatten().next();
                (self.line_of(answers + 1), sent.map(|sent| &sent.text[..]))
            }
            Some(LineOfAlarm::InExecution) if self.moving_line > 0 => (self.moving_line, None),
            Some(LineOfAlarm::InExecution) | None => (self.line_of(answers), None),
        };
        RaisedAlarm {
            why: reason_of_alarm(number, session),
            ..RaisedAlarm::at(number, (line.into(), text.unwrap_or_default()))
        }
    }

    /// The line of the program that a line is which was sent, both counted from 1.
    fn line_of(&self, sent: u32) -> u32 {
        let lines = self.sent_lines.as_ref();
        lines.map_or(sent, |lines| {
            let line = sent
                .checked_sub(1)
                .and_then(|sent| lines.get(sent as usize));
            line.copied().unwrap_or(0)
        })
    }
}

/// A line that was sent.
struct Sent {
    text: Vec<u8>,
    /// Lines of the program before it that are not sent.
    skipped: u32,
}

/// Who watches the stream.
struct Watched<R>(Rc<RefCell<Observer<R>>>);

impl<R: Recorder> Watcher for Watched<R> {
    fn edge(&mut self, edge: &Edge) {
        let observer = &mut *self.0.borrow_mut();
        observer.statistics.add(edge);
        let recorded = observer.recorder.edge(edge, &observer.statistics);
        if let Err(error) = recorded {
            observer.failure.get_or_insert(error);
        }
    }

    fn segment(&mut self, segment: &PlayedSegment) {
        let observer = &mut *self.0.borrow_mut();
        observer.times.add(segment);
        let line = observer.line_of(segment.line);
        if observer.has_numbers && segment.line > 0 {
            observer.moving_line = line;
        }
        observer
            .recorder
            .segment(&PlayedSegment { line, ..*segment });
    }

    fn change(&mut self, simulator: &Simulator) {
        let observer = &mut *self.0.borrow_mut();
        if let Err(error) = observer.recorder.change(simulator) {
            observer.failure.get_or_insert(error);
        }
    }

    fn answer(&mut self, number: u64, answer: &[u8]) {
        let observer = &mut *self.0.borrow_mut();
        let Some(sent) = observer.lines.pop_front().flatten() else {
            return;
        };
        observer.pass(sent.skipped);
        let text = String::from_utf8_lossy(answer);
        let word = text.split(' ').next().unwrap_or_default();
        let response = Response::parse(word).unwrap_or(Response::Error(0));
        let response = observer.refused.take().unwrap_or(response);
        observer.responses.push(response);
        let is_refused = response != Response::Ok;
        observer.recorder.answer(is_refused);
        let number = observer.line_of(number as u32).into();
        if is_refused && observer.refusals.add(number, &sent.text, response) {
            observer.recorder.refused(number, &sent.text, response);
        }
    }

    fn message(&mut self, simulator: &Simulator, answers: u64, message: &[u8]) {
        let observer = &mut *self.0.borrow_mut();
        let sent = answers as u32;
        let answers = observer.line_of(sent).into();
        let text = String::from_utf8_lossy(message).into_owned();
        observer.refused = observer.refused.or(host_refusal(&text));
        if text.starts_with("Grbl ") {
            // The welcome belongs to power-up, not to the program.
            return;
        }
        if let Some(number) = text.strip_prefix("ALARM:") {
            let alarm = observer.raised(number, sent, simulator.session());
            observer.recorder.alarm(&alarm);
            observer.refusals.raise(alarm);
        }
        observer.messages.push((answers, text));
    }
}

#[cfg(test)]
mod tests {
    use super::*;

    #[test]
    fn a_line_with_a_number_and_a_checksum_is_known() {
        for line in ["N3 T0*57", "n0*7", "N-1 M110 N-1*125", "N3 G1 X1 *57 "] {
            assert!(is_numbered(line.as_bytes()), "{line}");
        }
        let others = [
            "N3 T0", "T0*57", "G1 N3*57", "NaN*3", "", "M117 *N3", "N1 (2*3)",
        ];
        for line in others {
            assert!(!is_numbered(line.as_bytes()), "{line}");
        }
        assert!(is_comment(b"(a)") && is_comment(b"(a") && !is_comment(b"(a) G1"));
    }

    #[test]
    fn lines_get_numbers_and_checksums_as_printrun_gives_them() {
        assert_eq!(numbered(3, b"T0"), b"N3 T0*57\n");
        assert_eq!(numbered(-1, RESET_NUMBERS), b"N-1 M110 N-1*125\n");
        assert_eq!(numbered(1, b"M117 Done!"), numbered(1, b"M117 Done"));
        assert_eq!(words(b"  G1 X1 ; to X1\r"), b"G1 X1");
        assert_eq!(words(b"; nothing"), b"");
    }

    #[test]
    fn a_refusal_in_words_is_that_of_its_number() {
        for (text, number) in [
            ("Error:a word must begin with a letter (error:1)", Some(1)),
            ("echo:Unknown command: \"G150\"", Some(20)),
            ("echo:M104: not present", None),
            ("Error:checksum mismatch, Last Line: 1", None),
        ] {
            assert_eq!(host_refusal(text), number.map(Response::Error), "{text}");
        }
    }
}
