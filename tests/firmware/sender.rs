//! A sender that keeps the line full and counts its answers.

use std::{
    collections::VecDeque,
    sync::mpsc::RecvTimeoutError,
    time::{Duration, Instant},
};

use grbl_client::Report;
use leadscrew::sim::WINDOW;

use crate::machine::{Machine, RESET, WELCOME, is_answer, wait_for};

/// Streams lines and checks that each gets its own answer, in order.
pub(crate) struct Sender<'a> {
    pub(crate) machine: &'a mut Machine,
    /// Length and expected answer of each line that has not been answered.
    unanswered: VecDeque<(usize, &'static str)>,
    pub(crate) answered: usize,
    pub(crate) reports: usize,
    state: String,
    asked: Instant,
}

impl<'a> Sender<'a> {
    pub(crate) fn new(machine: &'a mut Machine) -> Self {
        Self {
            machine,
            unanswered: VecDeque::new(),
            answered: 0,
            reports: 0,
            state: String::new(),
            asked: Instant::now(),
        }
    }

    pub(crate) fn in_flight(&self) -> usize {
        self.unanswered.iter().map(|(length, _)| length).sum()
    }

    /// Sends a line as soon as there is room for it.
    pub(crate) fn send(&mut self, line: &[u8], answer: &'static str) {
        self.listen_until(|sender| {
            sender.unanswered.is_empty() || sender.in_flight() + line.len() <= WINDOW
        });
        self.machine.send(line);
        self.unanswered.push_back((line.len(), answer));
    }

    /// Takes one line from the machine; asks for the state ten times a second and resumes when held.
    pub(crate) fn listen(&mut self) {
        if self.asked.elapsed() > Duration::from_millis(100) {
            self.asked = Instant::now();
            self.machine.send(b"?");
        }
        match self.machine.lines.recv_timeout(Duration::from_millis(100)) {
            Ok(line) => self.take(&line),
            Err(RecvTimeoutError::Timeout) => {}
            Err(RecvTimeoutError::Disconnected) => panic!("the emulator has ended"),
        }
        if self.state == "Hold:0" {
            self.state.clear();
            self.machine.send(b"~");
        }
    }

    pub(crate) fn take(&mut self, line: &str) {
        if is_answer(line) {
            let (_, expected) = self.unanswered.pop_front().expect("an answer for a line");
            assert_eq!(line, expected, "line {}", self.answered);
            self.answered += 1;
        } else if let Some(report) = Report::read(line) {
            self.reports += 1;
            self.state = report.state;
        }
    }

    /// Waits until every line has been answered.
    pub(crate) fn finish(&mut self) {
        self.listen_until(|sender| sender.unanswered.is_empty());
    }

    fn listen_until(&mut self, is_done: impl Fn(&Self) -> bool) {
        wait_for(|| {
            if is_done(self) {
                return Ok(());
            }
            self.listen();
            Err(self.state.clone())
        });
    }

    /// Resets: answers that are on their way still come, then the welcome, then none of the old.
    /// Returns the number of lines that got no answer.
    pub(crate) fn reset(&mut self) -> usize {
        self.machine.send(RESET);
        for line in self.machine.receive_until(|line| line == WELCOME) {
            self.take(&line);
        }
        let dropped = self.unanswered.len();
        self.unanswered.clear();
        self.state.clear();
        // Harmless where nothing is locked; the position is known as soon as the machine stands.
        self.send(b"$X\n", "ok");
        self.send(b"G90\n", "ok");
        dropped
    }
}
