//! Programs on the virtual machine, and what is kept of them: answers, messages and steps.

use std::{cell::RefCell, collections::VecDeque, path::Path};

use anstream::println;
use anyhow::{Error, Result, bail};
use common::BAUD;
use indicatif::ProgressBar;
use leadscrew::{
    protocol::Dialect,
    settings::Settings,
    sim::{Edge, PlayedSegment, Simulator, StepStatistics, Stream, StreamEnd, Switch, Watcher},
    units::TICKS_PER_SECOND,
};
use owo_colors::OwoColorize;

use crate::{
    Refusals,
    figures::{Figures, Final, Responses},
    job_times::JobTimes,
    program::Program,
    refusal,
    sender::Response,
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
    /// Whether segments are to have the numbers of their lines, see [`Stream::with_numbers`].
    fn wants_line_numbers(&self) -> bool {
        false
    }
}

impl Recorder for () {}

/// Runs a program and says nothing.
pub fn play(path: &Path, settings: &Settings) -> Result<Figures> {
    let program = Program::open(path)?;
    let mut simulator = Box::new(Simulator::new(settings));
    stream(program, &mut simulator, Run::silent(&mut ()))
}

/// What a recorded program did, and what the machine says of itself at the end.
pub struct Played {
    /// What it did.
    pub figures: Figures,
    /// What `$G`, `$#` and `?` say.
    pub said: Vec<String>,
}

/// Runs a recorded program amid switches and says nothing.
pub fn play_recorded(path: &Path, settings: &Settings, switches: &[Switch]) -> Result<Played> {
    let program = Program::recorded(path)?;
    let mut simulator = Box::new(Simulator::new(settings));
    for switch in switches {
        // Fewer than fit.
        let _ = simulator.mount(*switch);
    }
    let figures = stream(program, &mut simulator, Run::silent(&mut ()))?;
    let said = ["$G\n", "$#\n", "?"]
        .into_iter()
        .flat_map(|text| ask(&mut simulator, text.as_bytes()))
        .collect();
    Ok(Played { figures, said })
}

/// Sends something to a machine that has come to rest, and returns what it says beside `ok`.
pub fn ask(simulator: &mut Simulator, bytes: &[u8]) -> Vec<String> {
    // What has begun at power-up comes first.
    simulator.settle();
    for byte in bytes {
        simulator.receive(*byte);
        simulator.settle();
    }
    let mut said = Vec::new();
    while let Some(byte) = simulator.send() {
        said.push(byte);
        simulator.settle();
    }
    let said = String::from_utf8_lossy(&said);
    let lines = said
        .lines()
        .filter(|line| !line.is_empty() && *line != "ok");
    lines.map(str::to_owned).collect()
}

/// How a program is run.
pub struct Run<'a, R> {
    /// Shows how far it is.
    pub bar: ProgressBar,
    /// Whether refused lines and alarms are printed.
    pub prints: bool,
    /// What else is made of it.
    pub recorder: &'a mut R,
}

impl<'a, R> Run<'a, R> {
    /// One that says nothing.
    pub fn silent(recorder: &'a mut R) -> Self {
        Self {
            bar: ProgressBar::hidden(),
            prints: false,
            recorder,
        }
    }
}

/// Streams a program through a fresh machine.
pub fn stream<R: Recorder>(
    program: Program,
    simulator: &mut Simulator,
    run: Run<R>,
) -> Result<Figures> {
    let observer = RefCell::new(Observer::new(run));
    let numbers = numbers_lines(simulator.session().settings()).then_some(-1);
    let source = Source {
        program,
        bytes: Vec::new().into_iter(),
        next_number: numbers,
        observer: &observer,
    };
    let mut stream = Stream::new(&mut *simulator, source, BAUD).with_statements_at_rest();
    if observer.borrow().run.recorder.wants_line_numbers() {
        stream = stream.with_numbers();
    }
    let end = stream.run(&mut Watched(&observer));
    let lines = stream.lines;
    drop(stream);
    let observer = observer.into_inner();
    observer.run.bar.finish_and_clear();
    if let Some(error) = observer.failure {
        return Err(error);
    }
    let answered = observer.responses.iter().count();
    if end == StreamEnd::Stuck {
        if observer.run.prints {
            observer.refusals.print();
        }
        let state = simulator.snapshot().state.name();
        bail!("the machine stands still in {state} after {answered} answers: only a reset helps");
    }
    Ok(Figures {
        lines,
        responses: observer.responses,
        messages: observer.messages,
        refusals: observer.refusals,
        times: observer.times.finish(simulator.now()),
        ..figures(simulator, &observer.statistics)
    })
}

/// What a machine says to whoever is connected with it, without the reports of its state.
#[derive(Debug, Default)]
pub struct Conversation {
    line: Vec<u8>,
    lines: u64,
    responses: Responses,
    messages: Vec<(u64, String)>,
}

impl Conversation {
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
        ..Figures::default()
    }
}

/// The line with which a sender of the RepRap dialect begins.
const RESET_NUMBERS: &[u8] = b"M110 N-1";

/// Returns whether lines get numbers and checksums: in the RepRap dialect.
fn numbers_lines(settings: &Settings) -> bool {
    Dialect::of(settings) == Dialect::RepRap
}

/// Returns the reason of a refusal in the RepRap dialect.
fn host_refusal(text: &str) -> Option<Response> {
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
    let is_sent = |byte: &&u8| !matches!(**byte, b'?' | b'!' | b'~' | 0x18 | b'\r' | 0x80..);
    line.extend(words.iter().filter(is_sent));
    let sum = line.iter().fold(0, |sum, byte| sum ^ byte);
    line.extend(format!("*{sum}\n").bytes());
    line
}

/// A program as a stream of bytes.
struct Source<'o, 'r, R> {
    program: Program,
    bytes: std::vec::IntoIter<u8>,
    /// The number of the next line, where lines have numbers and checksums.
    next_number: Option<i64>,
    observer: &'o RefCell<Observer<'r, R>>,
}

impl<R: Recorder> Iterator for Source<'_, '_, R> {
    type Item = u8;

    fn next(&mut self) -> Option<u8> {
        loop {
            if let Some(byte) = self.bytes.next() {
                return Some(byte);
            }
            let mut observer = self.observer.borrow_mut();
            match self.program.next_line() {
                Ok(Some(line)) => {
                    observer.run.recorder.line(&line);
                    if let Some(number) = &mut self.next_number {
                        let words = words(&line);
                        if words.is_empty() {
                            continue;
                        }
                        if *number < 0 {
                            observer.lines.push_back(RESET_NUMBERS.into());
                            self.bytes = numbered(*number, RESET_NUMBERS).into_iter();
                            *number = 0;
                        }
                        let line = numbered(*number, words);
                        *number += 1;
                        observer.lines.push_back(words.to_vec());
                        let bytes = self.bytes.by_ref().chain(line);
                        self.bytes = bytes.collect::<Vec<_>>().into_iter();
                    } else {
                        observer.lines.push_back(line.clone());
                        let bytes = line.into_iter().chain([b'\n']);
                        self.bytes = bytes.collect::<Vec<_>>().into_iter();
                    }
                }
                Ok(None) => return None,
                Err(error) => {
                    observer.failure = Some(error);
                    return None;
                }
            }
            observer.run.bar.set_position(self.program.read());
        }
    }
}

/// What is kept of a run.
struct Observer<'r, R> {
    run: Run<'r, R>,
    statistics: StepStatistics,
    responses: Responses,
    messages: Vec<(u64, String)>,
    refusals: Refusals,
    times: JobTimes,
    /// The reason that comes before the `ok` of a line that is refused in the RepRap dialect.
    refused: Option<Response>,
    /// Lines that have been read and not yet answered.
    lines: VecDeque<Vec<u8>>,
    failure: Option<Error>,
}

impl<'r, R> Observer<'r, R> {
    fn new(run: Run<'r, R>) -> Self {
        Self {
            run,
            statistics: StepStatistics::new(),
            responses: Responses::default(),
            messages: Vec::new(),
            refusals: Refusals::default(),
            times: JobTimes::default(),
            refused: None,
            lines: VecDeque::new(),
            failure: None,
        }
    }
}

/// Who watches the stream.
struct Watched<'o, 'r, R>(&'o RefCell<Observer<'r, R>>);

impl<R: Recorder> Watcher for Watched<'_, '_, R> {
    fn edge(&mut self, edge: &Edge) {
        let observer = &mut *self.0.borrow_mut();
        observer.statistics.add(edge);
        let recorded = observer.run.recorder.edge(edge, &observer.statistics);
        if let Err(error) = recorded {
            observer.failure.get_or_insert(error);
        }
    }

    fn segment(&mut self, segment: &PlayedSegment) {
        let observer = &mut *self.0.borrow_mut();
        observer.times.add(segment);
        observer.run.recorder.segment(segment);
    }

    fn change(&mut self, simulator: &Simulator) {
        let observer = &mut *self.0.borrow_mut();
        if let Err(error) = observer.run.recorder.change(simulator) {
            observer.failure.get_or_insert(error);
        }
    }

    fn answer(&mut self, number: u64, answer: &[u8]) {
        let observer = &mut *self.0.borrow_mut();
        let line = observer.lines.pop_front().unwrap_or_default();
        let text = String::from_utf8_lossy(answer);
        let word = text.split(' ').next().unwrap_or_default();
        let response = Response::parse(word).unwrap_or(Response::Error(0));
        let response = observer.refused.take().unwrap_or(response);
        observer.responses.push(response);
        let is_refused = response != Response::Ok;
        observer.run.recorder.answer(is_refused);
        if is_refused && observer.refusals.add(number, &line, response) && observer.run.prints {
            let bar = &observer.run.bar;
            bar.suspend(|| println!("{}", refusal(number, &line, response)));
        }
    }

    fn message(&mut self, answers: u64, message: &[u8]) {
        let observer = &mut *self.0.borrow_mut();
        let text = String::from_utf8_lossy(message).into_owned();
        observer.refused = host_refusal(&text).or(observer.refused);
        if text.starts_with("Grbl ") {
            // The welcome belongs to power-up, not to the program.
            return;
        }
        if text.starts_with("ALARM:") {
            observer.refusals.alarm(answers, &text);
            if observer.run.prints {
                let bar = &observer.run.bar;
                bar.suspend(|| println!("{:>8}  {}", format!("{answers}:"), text.red().bold()));
            }
        }
        observer.messages.push((answers, text));
    }
}

#[cfg(test)]
mod tests {
    use super::*;

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
