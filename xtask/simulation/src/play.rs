//! Programs on the virtual machine, with what the user sees meanwhile.

use std::path::Path;

use crate::playing::Playing;
use crate::{
    Refusals, alarm_row, figures::Figures, program::Program, refusal, sender::Response, summary,
};
use anstream::println;
use anyhow::Result;
use indicatif::ProgressBar;
use leadscrew::{
    settings::Settings,
    sim::{Edge, PlayedSegment, Simulator, StepStatistics, Switch},
};

pub use crate::playing::{RaisedAlarm, Recorder, Replies, ask, unlock};

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
    pub answers: Vec<String>,
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
    let answers = ["$G\n", "$#\n", "?"]
        .into_iter()
        .flat_map(|text| ask(&mut simulator, text.as_bytes()))
        .collect();
    Ok(Played { figures, answers })
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

impl<R: Recorder> Recorder for Run<'_, R> {
    fn line(&mut self, line: &[u8]) {
        self.recorder.line(line);
    }

    fn edge(&mut self, edge: &Edge, statistics: &StepStatistics) -> Result<()> {
        self.recorder.edge(edge, statistics)
    }

    fn change(&mut self, simulator: &Simulator) -> Result<()> {
        self.recorder.change(simulator)
    }

    fn segment(&mut self, segment: &PlayedSegment) {
        self.recorder.segment(segment);
    }

    fn answer(&mut self, is_refused: bool) {
        self.recorder.answer(is_refused);
    }

    fn refused(&mut self, number: u64, line: &[u8], response: Response) {
        if self.prints {
            let bar = &self.bar;
            bar.suspend(|| println!("{}", refusal(number, line, response)));
        }
        self.recorder.refused(number, line, response);
    }

    fn alarm(&mut self, alarm: &RaisedAlarm) {
        if self.prints {
            self.bar.suspend(|| println!("{}", alarm_row(alarm)));
        }
        self.recorder.alarm(alarm);
    }

    fn shows_alarms(&self) -> bool {
        self.prints
    }

    fn stuck(&mut self, refusals: &Refusals) {
        if self.prints {
            self.bar.finish_and_clear();
            summary::print_refusals(refusals);
        }
        self.recorder.stuck(refusals);
    }

    fn read(&mut self, bytes: u64) {
        self.bar.set_position(bytes);
        self.recorder.read(bytes);
    }

    fn wants_line_numbers(&self) -> bool {
        self.prints || self.recorder.wants_line_numbers()
    }
}

/// Streams a program through a fresh machine.
pub fn stream<R: Recorder>(
    program: Program,
    simulator: &mut Simulator,
    run: Run<R>,
) -> Result<Figures> {
    let bar = run.bar.clone();
    let played = Playing::new(program, simulator, run).finish();
    bar.finish_and_clear();
    Ok(played?.0)
}
