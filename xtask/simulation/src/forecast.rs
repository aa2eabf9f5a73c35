//! A job on the virtual machine in advance: when each line is answered, and what is refused.

mod recorder;

use crate::{
    line_times::LineTimes,
    machine_answers::{self, MachineAnswers, homes, probes},
    replay::TwoContacts,
};
use anyhow::Result;
use recorder::Recorder;

/// How far the machine is.
#[derive(Debug, Clone, Copy, Default)]
struct Entries {
    /// After how many finished entries all lines until now have been carried out.
    needed: u32,
    /// How many have been finished.
    finished: u32,
    /// Path control or compensation may have changed the path of moves that wait.
    may_wait: bool,
}

/// A line that is refused.
#[derive(Debug, Clone, Copy, PartialEq, Eq)]
pub struct RefusedLine {
    /// Its number, counted from 1.
    pub line: usize,
    /// Why: the number of the error.
    pub error: u16,
}

/// What a job does on the virtual machine.
#[derive(Debug, Default)]
pub struct Forecast {
    /// When its lines are answered and carried out.
    pub times: LineTimes,
    /// How far the machine was when each line was answered.
    entries: Vec<Entries>,
    /// The lines in which the machine is where the real one was stopped.
    passing: Vec<usize>,
    /// Lines that are refused.
    pub refused: Vec<RefusedLine>,
}

impl Forecast {
    /// Runs a job, and tells now and then how many lines have been answered. An error then ends the run.
    ///
    /// # Errors
    /// The job ends in an alarm, or the run was ended.
    pub fn of(
        answers: &MachineAnswers,
        lines: &[Vec<u8>],
        baud: u32,
        watch: impl FnMut(usize) -> Result<()>,
    ) -> Result<Self> {
        Self::passing(None, answers, lines, baud, watch)
    }

    /// The same for a job that has been stopped at a machine position, for [`Self::stopped_in`].
    pub fn passing(
        place: Option<&[f64]>,
        answers: &MachineAnswers,
        lines: &[Vec<u8>],
        baud: u32,
        watch: impl FnMut(usize) -> Result<()>,
    ) -> Result<Self> {
        let is_homed = lines.iter().any(|line| homes(line));
        let settings = machine_answers::settings(answers);
        let known = machine_answers::simulator(answers, false)?;
        let contacts = TwoContacts::new(known.session().interpreter(), settings);
        let mut answers = answers.clone();
        // Where an axis ends depends on contacts: the other moves are compared with the travel afterwards.
        let is_probed = lines.iter().any(|line| probes(line));
        let without = [(is_homed || is_probed, "$20=0"), (is_homed, "$21=0")];
        let without = without.iter().filter(|(is_off, _)| *is_off);
        (answers.settings).extend(without.map(|(_, setting)| (*setting).to_owned()));
        let mut simulator = machine_answers::simulator(&answers, is_homed)?;
        let mut recorder = Recorder::new(lines, place, &simulator);
        let end = recorder.play(&mut simulator, baud, watch)?;
        recorder.judge(end, &simulator, contacts)
    }

    /// Notes, for each number of answers, which line may not be carried out yet.
    fn note_undone(&mut self) {
        let mut undone = 0;
        self.times.undone = vec![0];
        for (answered, last) in (1..).zip(&self.entries) {
            let is_done = |entries: &Entries| entries.needed <= last.finished;
            while undone < answered && is_done(&self.entries[undone]) {
                undone += 1;
            }
            self.times.undone.push(undone as u32);
        }
    }

    /// The line, counted from 0, in which a machine was stopped when it had answered so many: the first one that passes
    /// the place at which it stopped. Where that place is unknown, or the path is not certain, [`LineTimes::first_undone`].
    pub fn stopped_in(&self, answered: usize) -> usize {
        let undone = self.times.first_undone(answered);
        let last = answered.min(self.entries.len().saturating_sub(1));
        let mut waiting = self.entries[undone.min(last)..=last].iter();
        let is_probed = self.times.probing.is_some_and(|line| line <= last);
        if is_probed || waiting.any(|entries| entries.may_wait) {
            return undone;
        }
        let line = self.passing.iter().find(|line| **line >= undone);
        line.map_or(undone, |line| *line.min(&last))
    }
}

#[cfg(test)]
mod tests {
    //! Jobs in advance.

    use super::*;
    use crate::{machine_answers::UNLIMITED_BAUD, playing::ask};
    use anyhow::ensure;
    use leadscrew::{
        axis::AXES,
        settings::Settings,
        sim::{Edge, Simulator, Stream, Watcher},
    };

    fn answers() -> MachineAnswers {
        let mut simulator = Simulator::new(&Settings::default());
        let settings = ask(&mut simulator, b"$+\n");
        MachineAnswers {
            settings,
            position: vec![0.0; AXES],
            ..MachineAnswers::default()
        }
    }

    fn lines(text: &str) -> Vec<Vec<u8>> {
        text.lines().map(|line| line.as_bytes().to_vec()).collect()
    }

    #[expect(clippy::unnecessary_wraps, reason = "as what may end the run")]
    fn never(_: usize) -> Result<()> {
        Ok(())
    }

    /// The time that is left when so many lines have been answered, and so long ago, s.
    fn left_s(forecast: &Forecast, answered: usize, since_s: f64) -> f64 {
        forecast.times.total_s - forecast.times.time_s(answered, since_s)
    }

    #[test]
    fn a_long_job_is_stopped_while_it_is_tried() {
        let job = lines("G1 X1000 F6000\nX0\nX1000\nX0");
        let mut asked = 0;
        let error = Forecast::of(&answers(), &job, UNLIMITED_BAUD, |_| {
            asked += 1;
            ensure!(asked < 2, "stopped");
            Ok(())
        });
        assert_eq!(error.unwrap_err().to_string(), "stopped");
        assert_eq!(asked, 2);
    }

    #[test]
    fn the_time_that_is_left_goes_down_to_nothing() {
        let job = lines("G1 X10 F600\nX0\nG4 P2\nG4 P1");
        let forecast = Forecast::of(&answers(), &job, UNLIMITED_BAUD, never).unwrap();
        assert!(
            (6.0..8.0).contains(&forecast.times.total_s),
            "{}",
            forecast.times.total_s
        );
        let left = [0, 1, 2, 3, 4].map(|answered| left_s(&forecast, answered, 0.0));
        assert!(left.is_sorted_by(|a, b| a >= b), "{left:?}");
        assert!((left[3] - 1.0).abs() < 0.1 && left[4] == 0.0, "{left:?}");
        // A line that takes longer than planned does not shorten the lines after it.
        assert!((left_s(&forecast, 2, 3600.0) - 1.0).abs() < 0.1);
    }

    #[test]
    fn what_is_refused_and_what_rises_an_alarm_is_known_before() {
        let forecast =
            Forecast::of(&answers(), &lines("G0 X1\nG999"), UNLIMITED_BAUD, never).unwrap();
        assert_eq!(forecast.refused, [RefusedLine { line: 2, error: 20 }]);
        let mut guarded = answers();
        guarded.settings.extend(["$22=1".into(), "$20=1".into()]);
        let error =
            Forecast::of(&guarded, &lines("G0 X-1\nG0 X-900"), UNLIMITED_BAUD, never).unwrap_err();
        let expected = "line 2 (G0 X-900) would end in ALARM:2, the target is outside the machine's travel (X -900.000 ";
        assert!(error.to_string().starts_with(expected), "{error}");
    }

    #[test]
    fn lines_that_wait_in_the_machine_are_not_done() {
        let moves: Vec<_> = (1..400).map(|x| format!("G1 X{x} F600")).collect();
        let job = lines(&format!("{}\nG4 P0.1\nG1 X0\n", moves.join("\n")));
        let forecast = Forecast::of(&answers(), &job, UNLIMITED_BAUD, never).unwrap();
        assert_eq!(forecast.times.first_undone(0), 0);
        // All of these are answered before the first millimetre is done.
        assert_eq!(forecast.times.first_undone(5), 0);
        let late = forecast.times.first_undone(350);
        assert!((1..345).contains(&late), "{late}");
        // The dwell is answered when everything before it has been done; the line after it may have come
        // before its answer.
        assert_eq!(forecast.times.first_undone(400), 399);
    }

    /// How far X is when each line is answered, steps.
    #[derive(Default)]
    struct Reached {
        now: i32,
        at_answers: Vec<i32>,
    }

    impl Watcher for Reached {
        fn edge(&mut self, _: &Edge) {}

        fn change(&mut self, simulator: &Simulator) {
            self.now = simulator.physical_steps()[0];
        }

        fn answer(&mut self, _: u64, _: &[u8]) {
            self.at_answers.push(self.now);
        }

        fn message(&mut self, _: &Simulator, _: u64, _: &[u8]) {}
    }

    #[test]
    fn no_line_counts_as_done_before_the_machine_has_made_its_move() {
        for modes in ["G61", "G64 P0.1", "G64 P0.1 Q0.1"] {
            // Moves of half a millimetre, between comments that keep the line busy for a while.
            let mut text = vec![modes.to_owned(), "F3000".into()];
            for number in 1..60 {
                text.push(format!("G1 X{}", f64::from(number) / 2.0));
                let comments = (number * 7) % 5;
                text.extend((0..comments).map(|_| format!("({})", "x".repeat(100))));
            }
            let job = lines(&text.join("\n"));
            for baud in [UNLIMITED_BAUD, 100_000] {
                let forecast = Forecast::of(&answers(), &job, baud, never).unwrap();
                let mut simulator = machine_answers::simulator(&answers(), false).unwrap();
                let bytes = job
                    .iter()
                    .flat_map(|line| line.iter().copied().chain([b'\n']));
                let mut reached = Reached::default();
                Stream::new(&mut *simulator, bytes, baud)
                    .with_statements_at_rest()
                    .run(&mut reached);
                for (answered, steps) in (1..).zip(reached.at_answers) {
                    let undone = forecast.times.first_undone(answered);
                    let ends = job[..undone].iter().filter(|line| line.starts_with(b"G1"));
                    // 250 steps in a millimetre.
                    let end: i32 = ends.map(|_| 125).sum();
                    assert!(
                        end <= steps,
                        "{modes}, {baud}: {undone} of {answered} at {steps}"
                    );
                }
            }
        }
    }
}

#[cfg(test)]
mod stopped {
    //! Jobs that are stopped at many moments, and the line in which that was.

    use super::*;
    use crate::{machine_answers::UNLIMITED_BAUD, playing::ask};
    use grbl_client::Report;
    use leadscrew::{
        axis::AXES,
        settings::{Settings, assign},
        sim::{Edge, PlayedSegment, SegmentKind, Simulator, Stream, Watcher},
    };

    /// A job of which the lines are answered long before they are carried out, and cross each other.
    const JOB: &str = "\
G21 G90 F900
G0 Z2
G0 X1 Y1
G1 Z-1
X7
Y7
X1
Y2
G2 X4 Y5 I3 J0
M8
G1 X6 Y1
X3.5 Y6.5
X12 F600
Y1 F900
X2 Y3
G0 Z2
X0 Y0
";

    fn settings() -> Settings {
        let mut settings = Settings::default();
        for axis in 0..3 {
            for (number, value) in [(100, 80), (110, 5000), (120, 500)] {
                let assignment = format!("{}={value}", number + axis);
                assign(&mut settings, assignment.as_bytes()).unwrap();
            }
        }
        settings
    }

    /// What a machine has done until it is stopped.
    #[derive(Default)]
    struct Done {
        answered: usize,
        changes: u32,
        /// The line of the last move, counted from 0.
        line: usize,
    }

    impl Done {
        /// Lets the machine go on alone until it is at rest.
        fn go_on(&mut self, simulator: &mut Simulator) {
            while let Some(due) = simulator.due() {
                simulator.advance(due);
                while let Some(segment) = simulator.take_segment() {
                    self.segment(&segment);
                }
            }
        }
    }

    impl Watcher for Done {
        fn edge(&mut self, _: &Edge) {}

        fn change(&mut self, _: &Simulator) {
            self.changes += 1;
        }

        fn segment(&mut self, segment: &PlayedSegment) {
            if segment.kind != SegmentKind::Standstill {
                self.line = segment.line as usize - 1;
            }
        }

        fn answer(&mut self, line: u64, answer: &[u8]) {
            assert_eq!(answer, b"ok", "line {line}");
            self.answered += 1;
        }

        fn message(&mut self, _: &Simulator, _: u64, _: &[u8]) {}
    }

    /// Runs a job for so many changes.
    fn run(simulator: &mut Simulator, job: &str, changes: u32) -> Done {
        let mut done = Done::default();
        Stream::new(simulator, job.bytes(), UNLIMITED_BAUD)
            .with_statements_at_rest()
            .with_numbers()
            .pump(&mut done, changes);
        done
    }

    fn lines(text: &str) -> Vec<Vec<u8>> {
        text.lines().map(|line| line.as_bytes().to_vec()).collect()
    }

    /// The line in which a job is stopped after so many changes: as it was, as it is found, and by the answers alone.
    fn stop(answers: &MachineAnswers, job: &str, changes: u32) -> [usize; 3] {
        let mut simulator = Box::new(Simulator::new(&settings()));
        let mut done = run(&mut simulator, job, changes);
        ask(&mut simulator, b"!");
        done.go_on(&mut simulator);
        let report = ask(&mut simulator, b"?").pop().unwrap();
        let place = Report::read(&report)
            .and_then(|report| report.machine_position())
            .unwrap();
        let never = |_| Ok(());
        let forecast =
            Forecast::passing(Some(&place), answers, &lines(job), UNLIMITED_BAUD, never).unwrap();
        let answered = done.answered;
        [
            done.line,
            forecast.stopped_in(answered),
            forecast.times.first_undone(answered),
        ]
    }

    fn answers() -> MachineAnswers {
        MachineAnswers {
            settings: ask(&mut Simulator::new(&settings()), b"$+\n"),
            position: vec![0.0; AXES],
            ..MachineAnswers::default()
        }
    }

    #[test]
    fn a_job_is_continued_at_the_line_in_which_it_was_stopped() {
        let answers = answers();
        let changes = run(&mut Simulator::new(&settings()), JOB, u32::MAX).changes;
        let stops = (1..80).map(|moment| stop(&answers, JOB, changes * moment / 80));
        let stops: Vec<_> = stops.collect();
        for [line, found, undone] in &stops {
            // The place where a line begins is also the end of that before.
            assert!(
                undone <= found && (*found..=found + 1).contains(line),
                "{stops:?}"
            );
        }
        let exact = stops.iter().filter(|[line, found, _]| line == found);
        assert!(exact.count() > 65, "{stops:?}");
        assert!(stops.iter().any(|stop| stop[..2] == [12, 12]), "{stops:?}");
        // The answers alone would go back to another line.
        let earlier = stops.iter().filter(|[line, _, undone]| undone < line);
        assert!(earlier.count() > 65, "{stops:?}");
    }

    #[test]
    fn a_path_that_is_not_certain_is_continued_by_the_answers_alone() {
        let answers = answers();
        let blended = JOB.replace("F900\nG0 Z2", "F900\nG64 P0.1\nG0 Z2");
        let probing = JOB.replace("F900\nG0 Z2", "F900\nG38.3 Z-0.1\nG0 Z2");
        for job in [blended, probing] {
            let changes = run(&mut Simulator::new(&settings()), &job, u32::MAX).changes;
            for moment in 1..8 {
                let [line, found, undone] = stop(&answers, &job, changes * moment / 8);
                assert!(found == undone && found <= line, "{found} for {line}");
            }
        }
    }
}
