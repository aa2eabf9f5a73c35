//! What is kept of a program that runs: its answers, its messages and its steps.

use std::{cell::RefCell, collections::VecDeque, rc::Rc};

use anstream::println;
use indicatif::ProgressBar;
use leadscrew::sim::{Edge, StepStatistics, Watcher};
use owo_colors::OwoColorize;

use crate::{
    figures::Responses,
    program::Program,
    quality::Meter,
    refusal::refusal,
    sender::Response,
    trace::{Row, Samples, Table, nanoseconds},
};

/// A meter that is told of lines by the source and of steps by the observer.
pub(super) type SharedMeter = Rc<RefCell<Meter>>;

/// Lines that have been read and not yet answered.
pub(super) type Lines = Rc<RefCell<VecDeque<Vec<u8>>>>;

/// A program as a stream of bytes.
pub(super) struct Source {
    program: Program,
    bar: ProgressBar,
    bytes: std::vec::IntoIter<u8>,
    pub(super) lines: Lines,
    /// What measures the motion: it is told each line before the line's steps come.
    meter: Option<SharedMeter>,
    pub(super) failure: Rc<RefCell<Option<anyhow::Error>>>,
}

impl Source {
    pub(super) fn new(program: Program, observer: &Observer) -> Self {
        Self {
            program,
            bar: observer.bar.clone(),
            bytes: Vec::new().into_iter(),
            lines: Lines::default(),
            meter: observer.meter.clone(),
            failure: Rc::default(),
        }
    }
}

impl Iterator for Source {
    type Item = u8;

    fn next(&mut self) -> Option<u8> {
        loop {
            if let Some(byte) = self.bytes.next() {
                return Some(byte);
            }
            match self.program.next_line() {
                Ok(Some(mut line)) => {
                    if let Some(meter) = &self.meter {
                        meter.borrow_mut().line(&line);
                    }
                    self.lines.borrow_mut().push_back(line.clone());
                    line.push(b'\n');
                    self.bytes = line.into_iter();
                }
                Ok(None) => return None,
                Err(error) => {
                    *self.failure.borrow_mut() = Some(error);
                    return None;
                }
            }
            self.bar.set_position(self.program.read());
        }
    }
}

/// What is kept of a run.
pub(super) struct Observer {
    pub(super) bar: ProgressBar,
    pub(super) tally: StepStatistics,
    pub(super) responses: Responses,
    pub(super) messages: Vec<(u64, String)>,
    pub(super) table: Option<Table<std::io::BufWriter<std::fs::File>>>,
    pub(super) samples: Option<Samples>,
    pub(super) meter: Option<SharedMeter>,
    /// Whether refused lines and alarms are printed.
    pub(super) prints: bool,
    pub(super) failure: Option<anyhow::Error>,
}

impl Observer {
    pub(super) fn new(bar: ProgressBar) -> Self {
        Self {
            bar,
            tally: StepStatistics::new(),
            responses: Responses::default(),
            messages: Vec::new(),
            table: None,
            samples: None,
            meter: None,
            prints: false,
            failure: None,
        }
    }
}

/// An observer and the lines that answers belong to.
pub(super) struct Watched {
    pub(super) observer: Observer,
    pub(super) lines: Lines,
}

impl Watcher for Watched {
    fn edge(&mut self, edge: &Edge) {
        let observer = &mut self.observer;
        observer.tally.add(edge);
        if let Some(meter) = &observer.meter {
            meter.borrow_mut().edge(edge);
        }
        let is_traced = observer.table.is_some() || observer.samples.is_some();
        if edge.raise == 0 || !is_traced {
            return;
        }
        let first = observer.tally.first_ticks.unwrap_or(edge.ticks);
        let row = Row {
            time_ns: nanoseconds(edge.ticks - first),
            steps: observer.tally.steps.0.map(|steps| steps as i32),
        };
        if let Some(table) = &mut observer.table
            && observer.failure.is_none()
        {
            observer.failure = table.push(&row).err();
        }
        if let Some(samples) = &mut observer.samples {
            samples.push(&row);
        }
    }

    fn answer(&mut self, number: u64, answer: &[u8]) {
        let line = self.lines.borrow_mut().pop_front().unwrap_or_default();
        let text = String::from_utf8_lossy(answer);
        let response = Response::parse(&text).unwrap_or(Response::Error(0));
        self.observer.responses.push(response);
        if let Some(meter) = &self.observer.meter {
            meter.borrow_mut().answer(response != Response::Ok);
        }
        if response != Response::Ok && self.observer.prints {
            let bar = &self.observer.bar;
            bar.suspend(|| println!("{}", refusal(number, &line, response)));
        }
    }

    fn message(&mut self, answers: u64, message: &[u8]) {
        let text = String::from_utf8_lossy(message).into_owned();
        if text.starts_with("Grbl ") {
            // The welcome belongs to power-up, not to the program.
            return;
        }
        if text.starts_with("ALARM:") && self.observer.prints {
            let bar = &self.observer.bar;
            bar.suspend(|| println!("{:>8}  {}", format!("{answers}:"), text.red().bold()));
        }
        self.observer.messages.push((answers, text));
    }
}
