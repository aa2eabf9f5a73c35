//! How far a job is: the line that is carried out, and the time that is left.

use grbl_client::transmission::Transmission;

use crate::line_times::LineTimes;

/// How far a job is, as the operator sees it.
#[derive(Debug, Clone, Default, PartialEq)]
pub struct Progress {
    /// The line that is carried out, counted from 0.
    pub line: usize,
    /// The time that is left, s.
    pub left_s: f64,
    /// The time is an estimate.
    pub is_estimated: bool,
}

/// What a machine has reported of a job.
#[derive(Debug, Clone, Copy)]
pub struct JobReport {
    /// The lines that have been answered, with those before the first one that was sent.
    pub answered: usize,
    /// The first line, counted from 0, that may not be carried out yet.
    pub undone: usize,
    /// The machine is held, at rest.
    pub is_held: bool,
    /// The override of the feed, %.
    pub feed_percent: u16,
}

impl From<&Transmission> for JobReport {
    fn from(job: &Transmission) -> Self {
        Self {
            answered: job.answered(),
            undone: job.undone,
            is_held: job.status.report.is_held(),
            feed_percent: job.status.overrides[0],
        }
    }
}

/// The clock of a job, which stands in a hold.
#[derive(Debug, Clone, Default, PartialEq)]
pub struct JobClock {
    /// When the first line that is sent begins, s.
    start_s: f64,
    /// The lines that have been answered.
    answered: usize,
    /// The motion since then, s.
    since_s: f64,
    /// How far the job is.
    pub progress: Progress,
}

impl JobClock {
    /// The clock of a job that is sent from a line on, counted from 0.
    pub fn beginning_at(times: &LineTimes, line: usize) -> Self {
        Self {
            start_s: times.begin_s(line),
            ..Self::default()
        }
    }

    /// Takes the time that has passed, s.
    pub fn tick(&mut self, times: &LineTimes, job: JobReport, passed_s: f64) {
        if self.answered != job.answered {
            self.answered = job.answered;
            self.since_s = 0.0;
        } else if !job.is_held {
            self.since_s += passed_s * f64::from(job.feed_percent) / 100.0;
        }
        let now_s = times.time_s(self.answered, self.since_s).max(self.start_s);
        let line = times.line_at(now_s);
        let last = self.answered.max(job.undone);
        let progress = &mut self.progress;
        progress.line = line.clamp(job.undone, last).max(progress.line);
        progress.left_s = (times.total_s - now_s).max(0.0);
        progress.is_estimated = times.probing.is_some();
    }
}

#[cfg(test)]
mod tests {
    use super::*;
    use crate::{
        forecast::Forecast,
        machine_answers::{MachineAnswers, UNLIMITED_BAUD},
        playing::ask,
    };
    use leadscrew::{axis::AXES, settings::Settings, sim::Simulator};

    /// Reports of a machine that tells no line number.
    const RUN: &str = "<Run|MPos:0.000,0.000,0.000|FS:0,0|Ov:100,100,100>";
    const SLOWER: &str = "<Run|MPos:0.000,0.000,0.000|FS:0,0|Ov:50,100,100>";
    const BRAKING: &str = "<Hold:1|MPos:0.000,0.000,0.000|FS:0,0>";
    const HELD: &str = "<Hold:0|MPos:0.000,0.000,0.000|FS:0,0>";

    fn begin(text: &str) -> (LineTimes, Transmission) {
        let mut simulator = Simulator::new(&Settings::default());
        let answers = MachineAnswers {
            settings: ask(&mut simulator, b"$+\n"),
            position: vec![0.0; AXES],
            ..MachineAnswers::default()
        };
        let lines: Vec<_> = text.lines().map(|line| line.as_bytes().to_vec()).collect();
        let forecast = Forecast::of(&answers, &lines, UNLIMITED_BAUD, |_| Ok(())).unwrap();
        let mut job = Transmission::new(&[], &lines, 0, false);
        job.take_output();
        (forecast.times, job)
    }

    /// Lets the machine answer and time pass, and returns the line from 1 and the time that is left.
    fn pass(
        clock: &mut JobClock,
        to: (&LineTimes, &mut Transmission),
        received: &[&str],
        s: f64,
    ) -> (usize, f64) {
        let (times, job) = to;
        let before_s = clock.progress.left_s;
        for line in received {
            job.receive(line);
        }
        job.undone = times.first_undone(job.answered());
        clock.tick(times, JobReport::from(&*job), s);
        let Progress { line, left_s, .. } = clock.progress;
        assert!(
            before_s == 0.0 || left_s <= before_s,
            "{left_s} after {before_s}"
        );
        (line + 1, left_s)
    }

    #[test]
    fn the_line_in_execution_is_shown_and_the_time_stands_in_a_hold() {
        // All are answered within the first.
        let (times, mut job) = begin("G1 X10 F600\nX20\nX30\nX40\nG4 P1");
        let mut clock = JobClock::default();
        let mut pass = |received: &[&str], s| pass(&mut clock, (&times, &mut job), received, s);
        assert_eq!(pass(&[RUN, "ok", "ok", "ok", "ok"], 0.0).0, 1);
        let (line, left_s) = pass(&[RUN], 2.0);
        assert!(line == 2 && (4.0..5.0).contains(&left_s), "{line} {left_s}");
        let (_, braking_s) = pass(&[BRAKING], 0.1);
        assert_eq!(pass(&[HELD], 3600.0), (2, braking_s));
        assert_eq!(pass(&[RUN], 0.0), (2, braking_s));
        let (line, left_s) = pass(&[RUN], 1.0);
        assert!(line == 3 && (braking_s - left_s - 1.0).abs() < 1e-6);
        // At half the feed.
        let (line, slower_s) = pass(&[SLOWER], 2.0);
        assert!(
            line == 4 && (left_s - slower_s - 1.0).abs() < 1e-6,
            "{line} {slower_s}"
        );
        assert!(pass(&[SLOWER], 3600.0).1 < 0.1);
    }

    #[test]
    fn an_early_contact_takes_the_rest_of_the_probing_move_off_the_time() {
        let (times, mut job) = begin("G0 Z-1\nG38.2 Z-21 F60\nG0 Z5\nG1 X10 F600");
        let mut clock = JobClock::default();
        let mut pass = |received: &[&str], s| pass(&mut clock, (&times, &mut job), received, s);
        pass(&[RUN, "ok"], 0.0);
        let (line, probing_s) = pass(&[RUN], 5.0);
        assert!(
            line == 2 && (20.0..23.0).contains(&probing_s),
            "{line} {probing_s}"
        );
        assert_eq!(pass(&[HELD], 60.0), (2, probing_s));
        pass(&[RUN, "ok", "ok"], 0.1);
        let (line, left_s) = pass(&[RUN], 0.1);
        assert!(line == 3 && left_s < 7.0, "{line} {left_s}");
        assert!(clock.progress.is_estimated);
    }
}
