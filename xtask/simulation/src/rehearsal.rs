//! A program in advance, from where a machine stands: its whole path, and how far it leads.

use anyhow::Result;
use leadscrew::{
    axis::{AXES, Axes},
    settings::Settings,
    sim::{PlayedSegment, SegmentKind, Simulator},
};
use serde::{Deserialize, Serialize};

use crate::{
    Job, Recording,
    figures::Figures,
    machine_answers::{self, MachineAnswers, homes, probes, without_contact},
    playing::{Playing, RaisedAlarm, Recorder},
    program::Program,
};

/// The lowest and the highest machine position of an axis, mm or degrees.
pub type Range = [f64; 2];

/// How far a program leads, axis by axis.
#[derive(Debug, Clone, Default, PartialEq, Serialize, Deserialize)]
pub struct Extents {
    /// Of everything that moves; nothing where nothing does.
    pub motion: Vec<Range>,
    /// Of the moves at feed rate; nothing where there are none.
    pub cut: Vec<Range>,
    /// Of the lines up to the first one that probes: what follows depends on its contact.
    pub certain: Vec<Range>,
}

/// A program on its way through a virtual machine.
pub struct Rehearsal {
    playing: Playing<Box<Simulator>, ExtentsRecorder>,
    name: String,
    text: Vec<u8>,
    settings: Settings,
    work_offset_mm: Vec<f64>,
}

/// What a program does.
pub struct Rehearsed {
    /// Its path and more, for a view.
    pub job: Job,
    /// Answers and times.
    pub figures: Figures,
    /// How far it leads.
    pub extents: Extents,
    /// Machine position of the work zero before the program, mm or degrees.
    pub work_offset_mm: Vec<f64>,
}

impl Rehearsal {
    /// Begins a program at a machine that is known by its answers. Limits end nothing, so that the whole path is known,
    /// and no probe makes contact.
    ///
    /// # Errors
    /// The virtual machine cannot be as the machine is.
    pub fn begin(name: &str, lines: &[Vec<u8>], answers: &MachineAnswers) -> Result<Self> {
        let is_homed = lines.iter().any(|line| homes(line));
        let mut unlimited = answers.clone();
        let off = [(true, "$20=0"), (is_homed, "$21=0")];
        let off = off.iter().filter(|(is_off, _)| *is_off);
        (unlimited.settings).extend(off.map(|(_, setting)| (*setting).to_owned()));
        let simulator = machine_answers::simulator(&unlimited, is_homed)?;
        let settings = machine_answers::settings(answers);
        let interpreter = simulator.session().interpreter();
        let offset = interpreter.work_offset(&interpreter.position());
        let probing = lines.iter().position(|line| probes(line));
        let recorder = ExtentsRecorder {
            recording: Recording::new(simulator.session()),
            settings,
            probing: probing.map_or(u32::MAX, |line| line as u32 + 1),
            steps: simulator.snapshot().steps,
            is_moving: [false; 3],
            ranges: Default::default(),
        };
        let played: Vec<_> = lines.iter().map(|line| without_contact(line)).collect();
        let program = Program::from_bytes(name.into(), played.join(&b'\n'));
        Ok(Self {
            work_offset_mm: offset.iter().map(|offset| offset.to_mm_f64()).collect(),
            playing: Playing::new(program, simulator, recorder),
            name: name.into(),
            text: [lines.join(&b'\n'), vec![b'\n']].concat(),
            settings,
        })
    }

    /// Goes on for at most so many changes of the machine. Returns whether the program has come to its end.
    pub fn pump(&mut self, changes: u32) -> bool {
        self.playing.pump(changes)
    }

    /// The part of the program that has been read, 0 to 1.
    pub fn part(&self) -> f64 {
        self.playing.read() as f64 / self.text.len().max(1) as f64
    }

    /// Plays the rest.
    ///
    /// # Errors
    /// The machine comes to rest before the end of the program.
    pub fn finish(mut self) -> Result<Rehearsed> {
        while !self.pump(u32::MAX) {}
        let steps = self.playing.simulator().snapshot().steps;
        let (figures, mut recorder) = self.playing.finish()?;
        recorder.reach(steps);
        let [motion, cut, certain] = recorder.ranges.map(|range| match range {
            Some(range) => range.to_vec(),
            None => Vec::new(),
        });
        let mut job = (recorder.recording).finish(&figures, &self.name, &self.settings);
        job.text = self.text;
        Ok(Rehearsed {
            job,
            figures,
            extents: Extents {
                motion,
                cut,
                certain,
            },
            work_offset_mm: self.work_offset_mm,
        })
    }
}

/// Records a run and how far it leads.
struct ExtentsRecorder {
    recording: Recording,
    settings: Settings,
    /// The first line that probes, from 1.
    probing: u32,
    /// Where the segment begins that is played.
    steps: Axes<i32>,
    /// Whether it belongs to each of the ranges.
    is_moving: [bool; 3],
    /// As those of [`Extents`].
    ranges: [Option<[Range; AXES]>; 3],
}

impl ExtentsRecorder {
    /// The segment that is played ends at a place.
    fn reach(&mut self, steps: Axes<i32>) {
        let from = std::mem::replace(&mut self.steps, steps);
        for steps in [from, steps] {
            if self.is_moving == [false; 3] {
                return;
            }
            let position = self.settings.position_of(steps);
            for (range, _) in (self.ranges.iter_mut().zip(self.is_moving)).filter(|(_, is)| *is) {
                let ends = range.get_or_insert([[f64::INFINITY, f64::NEG_INFINITY]; AXES]);
                for (end, position) in ends.iter_mut().zip(position.iter()) {
                    let position = position.to_mm_f64();
                    *end = [end[0].min(position), end[1].max(position)];
                }
            }
        }
    }
}

impl Recorder for ExtentsRecorder {
    fn line(&mut self, line: &[u8]) {
        self.recording.line(line);
    }

    fn segment(&mut self, segment: &PlayedSegment) {
        self.reach(segment.steps);
        let is_moving = !matches!(segment.kind, SegmentKind::Standstill | SegmentKind::Homing);
        let is_cut = segment.kind == SegmentKind::Feed;
        self.is_moving = [is_moving, is_cut, is_moving && segment.line <= self.probing];
        self.recording.segment(segment);
    }

    fn answer(&mut self, is_refused: bool) {
        self.recording.answer(is_refused);
    }

    fn alarm(&mut self, alarm: &RaisedAlarm) {
        self.recording.alarm(alarm);
    }

    fn wants_line_numbers(&self) -> bool {
        self.recording.wants_line_numbers()
    }
}

#[cfg(test)]
mod tests {
    use super::*;

    fn answers() -> MachineAnswers {
        let settings = ["$120=500", "$121=500", "$122=500", "$20=1", "$22=1"];
        MachineAnswers {
            settings: settings.map(str::to_owned).to_vec(),
            parameters: vec!["[G54:-50.000,-60.000,-20.000]".into()],
            modes: "[GC:G0 G54 G17 G21 G90 G94 M5 M9 T0 F0 S0]".into(),
            position: [-50.0, -60.0, -10.0, 0.0, 0.0, 0.0][..AXES].to_vec(),
            ..MachineAnswers::default()
        }
    }

    fn rehearsed(text: &str) -> Rehearsed {
        let lines: Vec<_> = text.lines().map(|line| line.as_bytes().to_vec()).collect();
        let mut rehearsal = Rehearsal::begin("a.nc", &lines, &answers()).unwrap();
        while !rehearsal.pump(1000) {
            assert!((0.0..=1.0).contains(&rehearsal.part()));
        }
        rehearsal.finish().unwrap()
    }

    #[test]
    fn the_extents_are_those_of_the_whole_path_in_machine_coordinates() {
        let text = "T2 M6\nG0 Z5\nG0 X10 Y10\nG1 Z-1 F600\nG2 X20 Y10 I5 J0\nG0 Z5\nG0 X60\nT3 M6\nG1 Y5 F600";
        let Rehearsed {
            job,
            extents,
            work_offset_mm,
            ..
        } = rehearsed(text);
        assert_eq!(work_offset_mm[..3], [-50.0, -60.0, -20.0]);
        assert_eq!(job.tools(), [(2, 1), (3, 8)]);
        // Beyond the travel, which ends nothing here.
        let expected = [[-50.0, 10.0], [-60.0, -45.0], [-21.0, -10.0]];
        let is_near = |range: &[Range], expected: &[Range; 3]| {
            let pairs = range.iter().flatten().zip(expected.iter().flatten());
            assert!(
                pairs.clone().all(|(one, other)| (one - other).abs() < 0.02),
                "{range:?}"
            );
        };
        is_near(&extents.motion, &expected);
        is_near(
            &extents.cut,
            &[[-40.0, 10.0], [-55.0, -45.0], [-21.0, -15.0]],
        );
        assert_eq!(extents.certain, extents.motion);
    }

    #[test]
    fn nothing_is_certain_after_a_probe() {
        let Rehearsed { job, extents, .. } = rehearsed("G0 X5\nG38.2 Z-30 F600\nG0 X20");
        assert_eq!(extents.certain[0], [-50.0, -45.0]);
        assert_eq!(extents.motion[0], [-50.0, -30.0]);
        assert!(job.text.starts_with(b"G0 X5\nG38.2 Z-30"));
    }
}
