//! The job in advance: on a virtual machine that stands as the machine does.

use std::{fs, path::Path};

use anyhow::{Context, Result};
use common::ui;
use simulation::{Job, Recording};
use simulation::{
    machine_answers::{self, MachineAnswers, homes, without_contact},
    output, play,
    play::Run,
    program::{Program, encoding_warning},
};

use crate::path_follower::PathFollower;

/// A job that is known in advance.
pub(crate) struct Rehearsal {
    pub(crate) job: Job,
    pub(crate) path_follower: PathFollower,
}

impl Rehearsal {
    /// Runs a program as the machine would that is known by its answers.
    ///
    /// # Errors
    /// It cannot be read, or the virtual machine cannot be as the machine is.
    pub(crate) fn of(path: &Path, answers: &MachineAnswers) -> Result<Self> {
        let text = fs::read(path).with_context(|| format!("cannot read {}", path.display()))?;
        let lines = || text.split(|byte| *byte == b'\n');
        let is_homed = lines().any(homes);
        let text = lines()
            .map(without_contact)
            .collect::<Vec<_>>()
            .join(&b'\n');
        ui::status("Trying", "the job on the virtual machine");
        let mut simulator = machine_answers::simulator(answers, is_homed)?;
        let mut recording = Recording::new(simulator.session());
        let program = Program::from_bytes(path.display().to_string(), text);
        let run = Run {
            bar: output::progress(program.length(), "bytes"),
            prints: false,
            recorder: &mut recording,
        };
        let figures = play::stream(program, &mut simulator, run)?;
        if let Some(line) = figures.foreign_line {
            ui::warning(&encoding_warning(line));
        }
        let refused = figures.responses.refused();
        if refused > 0 {
            ui::warning(&format!("{refused} lines of the job are refused"));
        }
        let name = path.file_name().unwrap_or_default().to_string_lossy();
        let job = recording.finish(&figures, &name, &machine_answers::settings(answers));
        let path_follower = PathFollower::new(&job.waypoints());
        Ok(Self { job, path_follower })
    }
}

#[cfg(test)]
mod tests {
    use std::io::Write as _;

    use leadscrew::axis::AXES;

    use super::*;

    #[test]
    fn a_job_is_known_from_where_the_machine_stands() {
        let mut file = tempfile::NamedTempFile::new().unwrap();
        write!(file, "G1 X20 F600\nG0 Z-300.5\nG1 Y10 F300\n").unwrap();
        let answers = MachineAnswers {
            settings: vec!["$110=3000".into(), "$120=1000".into()],
            parameters: vec!["[G54:5.000,7.000,0.000]".into()],
            modes: "[GC:G0 G54 G17 G21 G90 G94 M5 M9 T0 F0 S0]".into(),
            position: [5.0, 7.0, 0.0, 0.0, 0.0, 0.0][..AXES].to_vec(),
            ..MachineAnswers::default()
        };
        let Rehearsal { job, path_follower } = Rehearsal::of(file.path(), &answers).unwrap();
        let points = job.waypoints();
        let (first, last) = (points[0], points[points.len() - 1]);
        assert_eq!(
            (first.place, last.place),
            ([5.0, 7.0, 0.0], [25.0, 17.0, -300.5])
        );
        let lines: Vec<_> = points.iter().map(|point| point.line).collect();
        assert!(lines.is_sorted() && lines.contains(&2), "{lines:?}");
        // 20 mm at 10 mm/s, 10 mm at 5 mm/s.
        assert!(last.time_s > 4.0 && points.is_sorted_by_key(|point| point.time_s));
        let mut path_follower = path_follower;
        let followed = path_follower.follow([15.0, 7.0, 0.0], 1.0, "Run");
        assert!(
            followed.is_on_path && followed.line == 1 && (followed.time_s - 1.0).abs() < 0.2,
            "{followed:?}"
        );
    }

    #[test]
    fn a_probe_makes_no_contact_in_advance_and_that_is_no_alarm() {
        let mut file = tempfile::NamedTempFile::new().unwrap();
        write!(file, "G38.2 Z-30 F600\nG1 X2 F600\n").unwrap();
        let answers = MachineAnswers {
            settings: vec!["$120=1000".into(), "$122=1000".into()],
            position: vec![0.0; AXES],
            ..MachineAnswers::default()
        };
        let points = Rehearsal::of(file.path(), &answers)
            .unwrap()
            .job
            .waypoints();
        assert_eq!(points[points.len() - 1].place, [2.0, 0.0, -30.0]);
    }

    #[test]
    fn a_position_of_another_machine_is_reported() {
        let file = tempfile::NamedTempFile::new().unwrap();
        let answers = MachineAnswers {
            position: vec![0.0; AXES + 1],
            ..MachineAnswers::default()
        };
        let error = Rehearsal::of(file.path(), &answers)
            .map(|_| ())
            .unwrap_err();
        assert!(error.to_string().contains("see --axes"), "{error}");
    }
}
