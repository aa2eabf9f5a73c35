//! A sender that streams a program to the simulated machine, and the serial line between them.
//!
//! The sender counts characters, as common senders do: it sends a line when Grbl's receive buffer has room for the line
//! besides the unanswered lines. Each byte takes its time on the line. As by senders, realtime commands and carriage
//! returns are left out of the program.
//!
//! A stream is pumped in bounded steps, and an observer is shown what happens: answers, pins, and each
//! segment as it begins.

use core::borrow::BorrowMut;

use heapless::{Deque, Vec};

use super::{
    Edge, PlayedSegment, Simulator,
    numbers::{DIGITS, NumberPlace},
};
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
    /// Called for each segment that begins, in their order.
    fn segment(&mut self, segment: &PlayedSegment) {
        let _ = segment;
    }
    /// Called for the answer to a line; `line` counts from 1.
    fn answer(&mut self, line: u64, answer: &[u8]);
    /// Called for a received line that is no answer, after a number of answers.
    fn message(&mut self, simulator: &Simulator, answers: u64, message: &[u8]);
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

/// A program that is being sent to a machine, which the stream owns or borrows.
#[derive(Debug)]
pub struct Stream<S, P> {
    /// The machine.
    pub simulator: S,
    program: P,
    byte_ticks: u64,
    /// The line being sent, with its line feed if it is whole.
    line: Vec<u8, LINE>,
    /// Bytes of the line that have been sent.
    line_sent: usize,
    /// Whether the line is a further part of one longer than the window.
    is_long: bool,
    is_at_end: bool,
    is_begun: bool,
    /// Whether lines get their numbers.
    has_numbers: bool,
    /// Where the line being sent gets its number.
    number_place: Option<NumberPlace>,
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

impl<S: BorrowMut<Simulator>, P: Iterator<Item = u8>> Stream<S, P> {
    /// Returns a stream of a program at a baud rate.
    pub fn new(simulator: S, program: P, baud: u32) -> Self {
        Self {
            simulator,
            program,
            byte_ticks: u64::from(TICKS_PER_SECOND) * 10 / u64::from(baud),
            line: Vec::new(),
            line_sent: 0,
            is_long: false,
            is_at_end: false,
            is_begun: false,
            has_numbers: false,
            number_place: None,
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

    /// Gives each line of G-code its number, from 1, in place of its own `N` word: [`PlayedSegment::line`]
    /// then tells the line. The number takes no time and no place in the window, so that the motion stays
    /// the same. A line longer than the window gets no number, nor does a line with another `N` word.
    #[must_use]
    pub const fn with_numbers(mut self) -> Self {
        self.has_numbers = true;
        self
    }

    /// Streams until everything is executed.
    pub fn run(&mut self, watcher: &mut impl Watcher) -> StreamEnd {
        loop {
            if let Some(end) = self.pump(watcher, u32::MAX) {
                return end;
            }
        }
    }

    /// Streams for at most so many changes of the machine, of which time is one. Returns the end, if it
    /// has come to it.
    pub fn pump(&mut self, watcher: &mut impl Watcher, changes: u32) -> Option<StreamEnd> {
        if !self.is_begun {
            self.is_begun = true;
            self.machine().settle();
        }
        for _ in 0..changes {
            let now = self.simulator.borrow().now();
            if now >= self.next_out && self.receive_byte(watcher) {
                self.next_out = now + self.byte_ticks;
            }
            if now >= self.next_in && self.send_byte() {
                self.next_in = now + self.byte_ticks;
            }
            let end = match self.next() {
                Some(next) => {
                    self.pass_time(next.max(now), watcher);
                    None
                }
                None => self.end(),
            };
            if end.is_some() {
                return end;
            }
        }
        None
    }

    fn machine(&mut self) -> &mut Simulator {
        self.simulator.borrow_mut()
    }

    /// Returns the time of the next change, ticks.
    fn next(&mut self) -> Option<u64> {
        let simulator = self.simulator.borrow();
        let due = simulator.due();
        let out = simulator.has_to_send().then_some(self.next_out);
        let into = self.has_byte().then_some(self.next_in);
        [due, out, into].into_iter().flatten().min()
    }

    fn pass_time(&mut self, time: u64, watcher: &mut impl Watcher) {
        let simulator = self.simulator.borrow_mut();
        if let Some(edge) = simulator.advance(time) {
            watcher.edge(&edge);
        }
        while let Some(segment) = simulator.take_segment() {
            watcher.segment(&segment);
        }
        watcher.change(simulator);
    }

    /// Returns the end where nothing happens any more; presses cycle start in a program pause, as the
    /// operator does.
    fn end(&mut self) -> Option<StreamEnd> {
        let is_answered = self.unanswered.is_empty();
        let simulator = self.machine();
        let snapshot = simulator.snapshot();
        if is_answered && snapshot.is_at_rest {
            return Some(StreamEnd::Complete);
        }
        if snapshot.state != State::HoldComplete {
            return Some(StreamEnd::Stuck);
        }
        simulator.receive(b'~');
        simulator.settle();
        None
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
            return self.unanswered.is_empty() && self.simulator.borrow().snapshot().is_at_rest;
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
                Some(b'?' | b'!' | b'~' | 0x18 | b'\r') => {}
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
        let is_replaced = self.send_number();
        self.line_sent += 1;
        if byte == b'\n' {
            let length = self.line.len();
            self.lines += 1;
            self.in_flight += length;
            let _ = self.unanswered.push_back(length as u8);
        }
        let simulator = self.machine();
        if !is_replaced {
            simulator.receive(byte);
        }
        simulator.settle();
        true
    }

    /// Sends the number of the line before the byte that it stands before. Returns whether the next byte
    /// is one of the word that the number replaces.
    fn send_number(&mut self) -> bool {
        if self.line_sent == 0 {
            let is_whole = !self.is_long && self.line.last() == Some(&b'\n');
            let numbered = self.has_numbers && is_whole;
            self.number_place = numbered.then(|| NumberPlace::of(&self.line)).flatten();
        }
        let Some(place) = self.number_place.clone() else {
            return false;
        };
        if self.line_sent == place.at {
            self.send_word();
            if place.is_checked {
                // The same once more as a comment, whose other bytes cancel out, too: the checksum stays.
                self.machine().receive(b'(');
                self.send_word();
                for byte in *b"01)" {
                    self.machine().receive(byte);
                }
            }
        }
        place.own.contains(&self.line_sent)
    }

    /// Sends the number of the line, in no time.
    fn send_word(&mut self) {
        let number = self.lines + 1;
        let simulator = self.machine();
        simulator.receive(b'N');
        for place in (0..DIGITS).rev() {
            let digit = number / 10_u64.pow(place) % 10;
            simulator.receive(b'0' + digit as u8);
        }
    }

    fn receive_byte(&mut self, watcher: &mut impl Watcher) -> bool {
        let Some(byte) = self.machine().send() else {
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
        self.machine().settle();
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
            watcher.message(self.simulator.borrow(), self.answers, &self.answer);
        }
    }
}
