//! What a run is recorded with: the trace, its samples, and the measurement of its quality.

use std::{io::Write as _, os::unix::net::UnixStream};

use anyhow::Result;
use common::text::{duration, separated};
use leadscrew::{
    protocol::Session,
    settings::Settings,
    sim::{Edge, Simulator, StepStatistics},
};
use serde::Serialize;
use simulation::{
    figures::Figures, interrupt, output::Output, play::Recorder, program_reader::ProgramReader,
};

use crate::{
    Options,
    axes_with_backlash::AxesWithBacklash,
    coils::CoilTable,
    gantry::Sides,
    marks::MarkFinder,
    plot,
    quality::{self, Meter, Quality},
    samples::{Motion, Samples},
    trace::{Move, Row, Table, nanoseconds},
};

/// What a run is recorded with, as far as it is asked for: its files are created before anything runs.
pub(crate) struct Recording {
    table: Option<Table<Output>>,
    coils: Option<CoilTable<Output>>,
    picture: Option<Drawing>,
    json: Option<Output>,
    meter: Option<Meter>,
    /// Axes that do not take each step of their motors.
    axes_with_backlash: Option<AxesWithBacklash>,
}

/// A picture that is to be drawn.
struct Drawing {
    output: Output,
    samples: Samples,
    marks: MarkFinder,
}

/// How far the tool went, in degrees where only rotary axes move.
#[derive(Serialize)]
struct Distances {
    /// In feed moves.
    cutting: f64,
    /// In rapids.
    rapids: f64,
}

/// What a run shows, and how good its motion is, where that was asked for.
#[derive(Serialize)]
struct Measured {
    #[serde(flatten)]
    figures: Figures,
    /// How far the tool went.
    distances_mm: Distances,
    /// The gantries, with `--second`.
    #[serde(skip_serializing_if = "Vec::is_empty")]
    second_motors: Vec<Sides>,
    /// How good the motion is, with `--quality`.
    #[serde(skip_serializing_if = "Option::is_none")]
    quality: Option<Quality>,
}

impl Recording {
    /// Creates the files that were asked for.
    pub(crate) fn create(options: &Options, session: &Session) -> Result<Self> {
        let picture = options.plot.as_deref().map(Output::create).transpose()?;
        let reader = || ProgramReader::of(session);
        Ok(Self {
            table: options.trace.as_deref().map(Table::create).transpose()?,
            coils: options
                .coils
                .as_deref()
                .map(CoilTable::create)
                .transpose()?,
            picture: picture.map(|output| Drawing {
                output,
                samples: Samples::new(session.settings()),
                marks: MarkFinder::new(reader()),
            }),
            json: options.json.as_deref().map(Output::create).transpose()?,
            meter: options.quality.then(|| Meter::new(reader())),
            axes_with_backlash: AxesWithBacklash::of(session.settings()),
        })
    }

    /// Lets the program end with Ctrl-C, and leave nothing of the files.
    pub(crate) fn remove_when(&self, interrupted: UnixStream) {
        let trace = self.table.as_ref().and_then(Table::partial);
        let coils = self.coils.as_ref().and_then(CoilTable::partial);
        let picture = self.picture.as_ref().map(|drawing| &drawing.output);
        let others = [picture, self.json.as_ref()].into_iter().flatten();
        let partial: Vec<_> = trace
            .into_iter()
            .chain(coils)
            .chain(others.filter_map(Output::partial))
            .collect();
        interrupt::remove_when(interrupted, partial);
    }

    /// Writes the files, and returns how good the motion was, if that was measured.
    pub(crate) fn finish(
        self,
        figures: Figures,
        second_motors: Vec<Sides>,
        settings: &Settings,
        title: &str,
    ) -> Result<Option<Quality>> {
        if let Some(table) = self.table {
            table.finish()?.finish()?;
        }
        if let Some(coils) = self.coils {
            coils.finish()?.finish()?;
        }
        let (quality, traces) = self.meter.map(Meter::finish).unzip();
        if let Some(mut drawing) = self.picture {
            let motion = drawing.samples.finish();
            let picture = plot::draw(&plot::Picture {
                title,
                subtitle: &subtitle(&figures, &motion),
                motion: &motion,
                marks: &drawing.marks.finish(),
                is_laser: settings.laser,
                limits_mm_s2: settings.acceleration_mm_s2.0.map(f64::from),
                limits_mm_s3: quality::jerk_limits(settings),
                traces: traces.as_ref(),
            })?;
            drawing.output.write_all(picture.as_bytes())?;
            drawing.output.finish()?;
        }
        let distances_mm = Distances {
            cutting: figures.times.cutting_mm,
            rapids: figures.times.rapid_mm,
        };
        let measured = Measured {
            figures,
            distances_mm,
            second_motors,
            quality,
        };
        if let Some(json) = self.json {
            json.finish_json(&measured)?;
        }
        Ok(measured.quality)
    }
}

fn subtitle(figures: &Figures, motion: &Motion) -> String {
    let (lines, events) = (separated(figures.lines), separated(figures.events));
    let time = duration(figures.motion_time_s);
    let [cutting, rapid] = motion.seconds.map(duration);
    format!("{lines} lines, {time}: cutting {cutting}, rapids {rapid}; {events} step events")
}

impl Recorder for Recording {
    fn line(&mut self, line: &[u8]) {
        if let Some(meter) = &mut self.meter {
            meter.line(line);
        }
        if let Some(drawing) = &mut self.picture {
            drawing.marks.line(line);
        }
    }

    fn edge(&mut self, edge: &Edge, statistics: &StepStatistics) -> Result<()> {
        let mut edge = *edge;
        let mut steps = statistics.steps.0.map(|steps| steps as i32);
        if let Some(axes) = &mut self.axes_with_backlash {
            edge = axes.follow(&edge);
            steps = axes.steps();
        }
        if let Some(meter) = &mut self.meter {
            meter.edge(&edge);
        }
        let is_traced = self.table.is_some() || self.picture.is_some();
        if edge.raise == 0 || !is_traced {
            return Ok(());
        }
        let first = statistics.first_ticks.unwrap_or(edge.ticks);
        let row = Row {
            time_ns: nanoseconds(edge.ticks - first),
            steps,
            of: Move {
                is_rapid: edge.is_rapid,
                duty: edge.duty,
            },
        };
        if let Some(drawing) = &mut self.picture {
            drawing.samples.push(&row);
        }
        self.table.as_mut().map_or(Ok(()), |table| table.push(&row))
    }

    fn change(&mut self, simulator: &Simulator) -> Result<()> {
        let coils = self.coils.as_mut();
        coils.map_or(Ok(()), |table| {
            table.push(simulator.now(), simulator.coils())
        })
    }

    fn answer(&mut self, is_refused: bool) {
        if let Some(meter) = &mut self.meter {
            meter.answer(is_refused);
        }
        if let Some(drawing) = &mut self.picture {
            drawing.marks.answer(is_refused);
        }
    }
}
