//! What a run is recorded with: the trace, its samples, and the measurement of its quality.

use std::{
    fs,
    io::Read as _,
    os::unix::net::UnixStream,
    path::{Path, PathBuf},
    process, thread,
};

use anyhow::{Context, Result};
use host::{output::Output, play::Recorder};
use leadscrew::{
    settings::Settings,
    sim::{Edge, StepStatistics},
};

use crate::{
    quality::Meter,
    samples::Samples,
    trace::{Move, Row, Table, nanoseconds},
};

/// The exit status of a program that Ctrl-C has ended, as shells have it.
const INTERRUPTED: i32 = 130;

/// The files that were asked for, which are created before anything runs.
#[derive(Default)]
pub(crate) struct Outputs {
    pub(crate) trace: Option<Table<Output>>,
    pub(crate) plot: Option<Output>,
    pub(crate) json: Option<Output>,
}

impl Outputs {
    /// Creates those that have a path.
    pub(crate) fn create(
        trace: Option<&Path>,
        plot: Option<&Path>,
        json: Option<&Path>,
    ) -> Result<Self> {
        Ok(Self {
            trace: trace.map(Table::create).transpose()?,
            plot: plot.map(Output::create).transpose()?,
            json: json.map(Output::create).transpose()?,
        })
    }

    /// Lets the program end with Ctrl-C, and leave nothing of them.
    pub(crate) fn remove_when(&self, mut interrupted: UnixStream) {
        let trace = self.trace.as_ref().and_then(Table::partial);
        let others = [&self.plot, &self.json];
        let others = others.into_iter().flatten().filter_map(Output::partial);
        let partial: Vec<_> = trace.into_iter().chain(others).collect();
        thread::spawn(move || {
            if interrupted.read_exact(&mut [0]).is_ok() {
                remove(&partial);
                process::exit(INTERRUPTED);
            }
        });
    }
}

fn remove(files: &[PathBuf]) {
    for path in files {
        let _ = fs::remove_file(path);
    }
}

/// What becomes readable with Ctrl-C.
pub(crate) fn interruptions() -> Result<UnixStream> {
    let catch = || {
        let (read, write) = UnixStream::pair()?;
        for signal in [signal_hook::consts::SIGINT, signal_hook::consts::SIGTERM] {
            signal_hook::low_level::pipe::register(signal, write.try_clone()?)?;
        }
        std::io::Result::Ok(read)
    };
    catch().context("cannot catch Ctrl-C")
}

/// What a run is recorded with, as far as it is asked for.
#[derive(Default)]
pub(crate) struct Instruments {
    pub(crate) table: Option<Table<Output>>,
    pub(crate) samples: Option<Samples>,
    pub(crate) meter: Option<Meter>,
}

impl Instruments {
    /// Those for a trace that has been created, a picture, and the quality of a machine's motion.
    pub(crate) fn new(
        table: Option<Table<Output>>,
        is_drawn: bool,
        is_measured: bool,
        settings: &Settings,
    ) -> Self {
        Self {
            table,
            samples: is_drawn.then(|| Samples::new(settings)),
            meter: is_measured.then(|| Meter::new(settings)),
        }
    }
}

impl Recorder for Instruments {
    fn line(&mut self, line: &[u8]) {
        if let Some(meter) = &mut self.meter {
            meter.line(line);
        }
    }

    fn edge(&mut self, edge: &Edge, statistics: &StepStatistics) -> Result<()> {
        if let Some(meter) = &mut self.meter {
            meter.edge(edge);
        }
        let is_traced = self.table.is_some() || self.samples.is_some();
        if edge.raise == 0 || !is_traced {
            return Ok(());
        }
        let first = statistics.first_ticks.unwrap_or(edge.ticks);
        let row = Row {
            time_ns: nanoseconds(edge.ticks - first),
            steps: statistics.steps.0.map(|steps| steps as i32),
            of: Move {
                is_rapid: edge.is_rapid,
                duty: edge.duty,
            },
        };
        if let Some(samples) = &mut self.samples {
            samples.push(&row);
        }
        self.table.as_mut().map_or(Ok(()), |table| table.push(&row))
    }

    fn answer(&mut self, is_refused: bool) {
        if let Some(meter) = &mut self.meter {
            meter.answer(is_refused);
        }
    }
}
