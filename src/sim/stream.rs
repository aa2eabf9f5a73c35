//! A sender that streams a program to the simulated machine, and the serial line between them.
//!
//! The sender counts characters, as common senders do: it sends a line when Grbl's receive buffer has
//! room for it besides the lines that are not answered. Each byte takes its time on the line. As by
//! senders, realtime commands and carriage returns are left out of the program.

use heapless::{Deque, Vec};

use super::{Edge, Simulator};
use crate::{model::State, units::TICKS_PER_SECOND};

/// Largest number of unanswered bytes: Grbl's receive buffer of 128 holds one less.
pub const WINDOW: usize = 127;
/// Longest line that is counted, bytes; a longer line is sent alone.
const LINE: usize = WINDOW;
/// Longest answer that is kept, bytes.
const ANSWER: usize = 192;

/// An observer of a stream.
pub trait Watcher {
    /// Called for each change of the pins.
    fn edge(&mut self, edge: &Edge);
    /// Called after each change, of which time is one.
    fn change(&mut self, simulator: &Simulator) {
        let _ = simulator;
    }
    /// Called for the answer to a line; `line` counts from 1.
    fn answer(&mut self, line: u64, answer: &[u8]);
    /// Called for a received line that is no answer, after a number of answers.
    fn message(&mut self, answers: u64, message: &[u8]);
}

/// The end of a stream.
#[derive(Debug, Clone, Copy, PartialEq, Eq)]
pub enum StreamEnd {
    /// Every line was answered and the machine is at rest.
    Complete,
    /// The machine stands still and does not answer.
    Stuck,
}

/// What a line is to the sender.
#[derive(Debug, Clone, Copy, PartialEq, Eq)]
enum SentLine {
    Gcode,
    Jog,
    Statement,
}

impl SentLine {
    fn of(line: &[u8]) -> Self {
        let mut text = line.iter().filter(|byte| **byte > b' ');
        match (text.next(), text.next()) {
            (Some(b'$'), Some(b'J' | b'j')) => Self::Jog,
            (Some(b'$'), _) => Self::Statement,
            _ => Self::Gcode,
        }
    }
}

/// A program that is being sent to the machine.
#[derive(Debug)]
pub struct Stream<'a, P> {
    /// The machine.
    pub simulator: &'a mut Simulator,
    program: P,
    byte_ticks: u64,
    /// The line being sent, with its line feed if it is whole.
    line: Vec<u8, LINE>,
    /// Bytes of the line that have been sent.
    line_sent: usize,
    /// Whether the line is a further part of one longer than the window.
    is_long: bool,
    is_at_end: bool,
    /// Which line has been sent last, where some wait for the machine to be at rest.
    sent: Option<SentLine>,
    /// Lengths of the unanswered lines; the window bounds their number.
    unanswered: Deque<u8, 128>,
    in_flight: usize,
    /// Lines sent so far.
    pub lines: u64,
    answers: u64,
    answer: Vec<u8, ANSWER>,
    next_in: u64,
    next_out: u64,
}

impl<'a, P: Iterator<Item = u8>> Stream<'a, P> {
    /// Returns a stream of a program at a baud rate.
    pub fn new(simulator: &'a mut Simulator, program: P, baud: u32) -> Self {
        Self {
            simulator,
            program,
            byte_ticks: u64::from(TICKS_PER_SECOND) * 10 / u64::from(baud),
            line: Vec::new(),
            line_sent: 0,
            is_long: false,
            is_at_end: false,
            sent: None,
            unanswered: Deque::new(),
            in_flight: 0,
            lines: 0,
            answers: 0,
            answer: Vec::new(),
            next_in: 0,
            next_out: 0,
        }
    }

    /// Lets the sender send each `$` statement alone, to a machine at rest: such a line may write to the
    /// flash, and most are refused while anything moves. Jogs follow each other, and G-code waits for
    /// their end.
    #[must_use]
    pub const fn with_statements_at_rest(mut self) -> Self {
        self.sent = Some(SentLine::Gcode);
        self
    }

    /// Streams until everything is executed.
    pub fn run(&mut self, watcher: &mut impl Watcher) -> StreamEnd {
        self.simulator.settle();
        loop {
            let now = self.simulator.now();
            if now >= self.next_out && self.receive_byte(watcher) {
                self.next_out = now + self.byte_ticks;
            }
            if now >= self.next_in && self.send_byte() {
                self.next_in = now + self.byte_ticks;
            }
            let mut next = self.simulator.due();
            if self.simulator.has_to_send() {
                next = Some(next.map_or(self.next_out, |next| next.min(self.next_out)));
            }
            if self.has_byte() {
                next = Some(next.map_or(self.next_in, |next| next.min(self.next_in)));
            }
            match next {
                Some(next) => {
                    if let Some(edge) = self.simulator.advance(next.max(now)) {
                        watcher.edge(&edge);
                    }
                    watcher.change(self.simulator);
                }
                None if self.unanswered.is_empty() && self.simulator.snapshot().is_at_rest => {
                    return StreamEnd::Complete;
                }
                None if self.simulator.snapshot().state == State::HoldComplete => {
                    // A program pause: the operator presses cycle start.
                    self.simulator.receive(b'~');
                    self.simulator.settle();
                }
                None => return StreamEnd::Stuck,
            }
        }
    }

    /// Returns whether a byte may be sent when the line is free.
    fn has_byte(&mut self) -> bool {
        if self.line_sent == self.line.len() {
            self.fill();
        }
        if self.line_sent < self.line.len() {
            let is_begun = self.line_sent > 0 || self.is_long;
            return is_begun || self.may_begin();
        }
        false
    }

    /// Returns whether the machine takes the line now.
    fn may_begin(&self) -> bool {
        let kind = SentLine::of(&self.line);
        if self
            .sent
            .is_some_and(|sent| kind == SentLine::Statement || kind != sent)
        {
            return self.unanswered.is_empty() && self.simulator.snapshot().is_at_rest;
        }
        self.in_flight + self.line.len() <= WINDOW || self.unanswered.is_empty()
    }

    /// Reads the next line, or the next part of a long one.
    fn fill(&mut self) {
        let continues = self.line_sent > 0 && self.line.last() != Some(&b'\n');
        self.line.clear();
        self.line_sent = 0;
        self.is_long = continues;
        if self.is_at_end {
            return;
        }
        while !self.line.is_full() {
            match self.program.next() {
                Some(b'?' | b'!' | b'~' | 0x18 | b'\r' | 0x80..) => {}
                Some(byte) => {
                    let _ = self.line.push(byte);
                    if byte == b'\n' {
                        return;
                    }
                }
                None => {
                    self.is_at_end = true;
                    if self.is_long || !self.line.is_empty() {
                        let _ = self.line.push(b'\n');
                    }
                    return;
                }
            }
        }
    }

    fn send_byte(&mut self) -> bool {
        if !self.has_byte() {
            return false;
        }
        let Some(byte) = self.line.get(self.line_sent).copied() else {
            return false;
        };
        if self.line_sent == 0 && !self.is_long && self.sent.is_some() {
            self.sent = Some(SentLine::of(&self.line));
        }
        self.line_sent += 1;
        if byte == b'\n' {
            let length = self.line.len();
            self.lines += 1;
            self.in_flight += length;
            let _ = self.unanswered.push_back(length as u8);
        }
        self.simulator.receive(byte);
        self.simulator.settle();
        true
    }

    fn receive_byte(&mut self, watcher: &mut impl Watcher) -> bool {
        let Some(byte) = self.simulator.send() else {
            return false;
        };
        match byte {
            b'\n' => {
                self.receive_line(watcher);
                self.answer.clear();
            }
            b'\r' => {}
            byte => {
                let _ = self.answer.push(byte);
            }
        }
        self.simulator.settle();
        true
    }

    fn receive_line(&mut self, watcher: &mut impl Watcher) {
        let is_ok = self.answer == b"ok" || self.answer.starts_with(b"ok ");
        if is_ok || self.answer.starts_with(b"error:") {
            self.answers += 1;
            let length = self.unanswered.pop_front().unwrap_or(0);
            self.in_flight -= usize::from(length);
            watcher.answer(self.answers, &self.answer);
        } else if !self.answer.is_empty() {
            watcher.message(self.answers, &self.answer);
        }
    }
}
