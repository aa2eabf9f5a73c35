//! What a run is recorded with: the trace, its samples, and the measurement of its quality.

use std::{fs::File, io::BufWriter};

use anyhow::Result;
use host::play::Recorder;
use leadscrew::sim::{Edge, StepStatistics};

use crate::{
    quality::Meter,
    trace::{Row, Samples, Table, nanoseconds},
};

/// Those that are asked for.
pub(crate) struct Instruments {
    pub(crate) table: Option<Table<BufWriter<File>>>,
    pub(crate) samples: Option<Samples>,
    pub(crate) meter: Option<Meter>,
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
