//! A job on the virtual machine in advance: when each line is answered, and what is refused.

use std::collections::VecDeque;

use anyhow::{Result, bail, ensure};
use grbl_client::meaning::{self, LineOfAlarm};
use leadscrew::{
    model::PathControl,
    sim::{Edge, Simulator, Stream, StreamEnd, Watcher},
    units::TICKS_PER_SECOND,
};
use simulation::{
    machine_answers::{self, MachineAnswers, searches},
    output,
    playing::reason_of_alarm,
    refusal,
    sender::{Response, shown},
};

use crate::link::Stopped;

/// Entries that path control and cutter compensation may still make of the moves that wait for the next one
/// when a line is answered.
const DIVIDED: u32 = 4;

/// Steps of entries that count as finished may still be queued: at most 5 ms of them, twice of which is
/// waited here, s.
const QUEUED_S: f64 = 0.01;

/// Changes of the virtual machine after which it is shown how far it is, and Ctrl-C is looked for.
const SHOWN: u32 = 100_000;

/// How far the machine is.
#[derive(Debug, Clone, Copy, Default)]
struct Entries {
    /// After how many finished entries all lines until now have been carried out.
    needed: u32,
    /// How many have been finished.
    finished: u32,
}

/// What a job does on the virtual machine.
#[derive(Debug, Default)]
pub(crate) struct Forecast {
    /// When each line is answered, s from the first.
    answered_s: Vec<f64>,
    /// How far the machine was when each line was answered.
    entries: Vec<Entries>,
    /// How long the job takes, s, without pauses of the operator.
    pub(crate) total_s: f64,
    /// Lines that are refused, to read.
    pub(crate) refused: Vec<String>,
}

impl Forecast {
    /// Runs a job, and asks now and then whether it is to be stopped.
    ///
    /// # Errors
    /// It ends in an alarm, or was [`Stopped`].
    pub(crate) fn of(
        answers: &MachineAnswers,
        lines: &[Vec<u8>],
        baud: u32,
        mut is_stopped: impl FnMut() -> Result<bool>,
    ) -> Result<Self> {
        let mut simulator =
            machine_answers::simulator(answers, lines.iter().any(|line| searches(line)))?;
        let start = simulator.now();
        let mut recorder = Recorder {
            lines,
            start,
            base: simulator.session().entered(),
            finished_base: simulator.snapshot().finished,
            now_s: 0.0,
            finished: VecDeque::from([(0.0, 0)]),
            pending: Vec::new(),
            forecast: Self::default(),
            alarm: None,
        };
        let bytes = lines
            .iter()
            .flat_map(|line| line.iter().copied().chain([b'\n']));
        let mut stream = Stream::new(&mut *simulator, bytes, baud).with_statements_at_rest();
        let bar = output::progress(lines.len() as u64, "lines");
        let end = loop {
            match stream.pump(&mut recorder, SHOWN) {
                Some(end) => break end,
                None => bar.set_position(recorder.forecast.answered_s.len() as u64),
            }
            ensure!(!is_stopped()?, Stopped);
        };
        bar.finish_and_clear();
        drop(stream);
        recorder.change(&simulator);
        if let Some((answered, number, reason)) = &recorder.alarm {
            let undone = recorder.forecast.first_undone(*answered as usize) as u64;
            let line = answered + 1;
            let place = match meaning::line_of_alarm(number) {
                Some(LineOfAlarm::InExecution) if undone < *answered => {
                    format!("one of the lines {} to {line}", undone + 1)
                }
                _ => format!("line {line} ({})", shown(recorder.sent(line))),
            };
            bail!("{place} would end in ALARM:{number}, {reason}");
        }
        if end == StreamEnd::Stuck {
            bail!(
                "the job would end in the state {}",
                simulator.snapshot().state.name()
            );
        }
        let mut forecast = recorder.forecast;
        forecast.total_s = recorder.now_s;
        Ok(forecast)
    }

    /// The time that is left when so many lines have been answered, and so long ago, s.
    pub(crate) fn remaining_s(&self, answered: usize, since_s: f64) -> f64 {
        let at = |lines: usize| match lines.checked_sub(1) {
            None => 0.0,
            Some(index) => self.answered_s.get(index).copied().unwrap_or(self.total_s),
        };
        // The next answer is late where an override or a hold makes it so.
        let now = (at(answered) + since_s).min(at(answered + 1));
        (self.total_s - now).max(0.0)
    }

    /// The first line, counted from 0, that a machine may not have carried out when it had answered so many.
    pub(crate) fn first_undone(&self, answered: usize) -> usize {
        let Some(last) = answered
            .checked_sub(1)
            .and_then(|last| self.entries.get(last))
        else {
            return 0;
        };
        let is_undone = |entries: &Entries| entries.needed > last.finished;
        self.entries
            .iter()
            .take(answered)
            .position(is_undone)
            .unwrap_or(answered)
    }
}

/// What watches the virtual machine.
struct Recorder<'a> {
    lines: &'a [Vec<u8>],
    start: u64,
    base: u32,
    finished_base: u32,
    /// The time, s from the first line.
    now_s: f64,
    /// Numbers of finished entries, and since when they are that: the first one is from before what is queued.
    finished: VecDeque<(f64, u32)>,
    /// The finished entries at answers since the last change.
    pending: Vec<u32>,
    forecast: Forecast,
    /// Answers before the first alarm, its number and what it means.
    alarm: Option<(u64, String, String)>,
}

impl Recorder<'_> {
    /// A line of the job, from 1; nothing after its end.
    fn sent(&self, line: u64) -> &[u8] {
        let index = (line as usize).wrapping_sub(1);
        self.lines.get(index).map_or(&[], Vec::as_slice)
    }
}

impl Watcher for Recorder<'_> {
    fn edge(&mut self, _: &Edge) {}

    fn change(&mut self, simulator: &Simulator) {
        let entered = simulator.session().entered().wrapping_sub(self.base);
        let entries = &mut self.forecast.entries;
        let interpreter = simulator.session().interpreter();
        let may_wait = interpreter.is_compensating()
            || matches!(interpreter.modal().path, PathControl::Continuous { .. });
        let needed = entered + if may_wait { DIVIDED } else { 0 };
        entries.extend(
            self.pending
                .drain(..)
                .map(|finished| Entries { needed, finished }),
        );
        let ticks = simulator.now() - self.start;
        let finished = simulator
            .snapshot()
            .finished
            .wrapping_sub(self.finished_base);
        let now_s = ticks as f64 / f64::from(TICKS_PER_SECOND);
        self.now_s = now_s;
        if self
            .finished
            .back()
            .is_none_or(|(_, known)| *known != finished)
        {
            self.finished.push_back((now_s, finished));
        }
        // The first one stays that from before what is queued.
        while self
            .finished
            .get(1)
            .is_some_and(|(since_s, _)| since_s + QUEUED_S <= now_s)
        {
            self.finished.pop_front();
        }
    }

    fn answer(&mut self, line: u64, answer: &[u8]) {
        self.forecast.answered_s.push(self.now_s);
        self.pending
            .push(self.finished.front().map_or(0, |(_, finished)| *finished));
        let text = String::from_utf8_lossy(answer);
        if let Some(response @ Response::Error(_)) = Response::parse(&text) {
            let refusal = refusal(line, self.sent(line), response);
            self.forecast.refused.push(refusal);
        }
    }

    fn message(&mut self, simulator: &Simulator, answers: u64, message: &[u8]) {
        if let Some(number) = message.strip_prefix(b"ALARM:") {
            let number = String::from_utf8_lossy(number);
            let reason = reason_of_alarm(&number, simulator.session());
            self.alarm
                .get_or_insert((answers, number.into_owned(), reason));
        }
    }
}

#[cfg(test)]
mod tests {
    use leadscrew::settings::Settings;

    use super::*;
    use simulation::machine_answers::UNLIMITED_BAUD;

    fn answers() -> MachineAnswers {
        let mut simulator = Simulator::new(&Settings::default());
        let settings = simulation::play::ask(&mut simulator, b"$+\n");
        MachineAnswers {
            settings,
            position: vec![0.0; leadscrew::axis::AXES],
            ..MachineAnswers::default()
        }
    }

    fn lines(text: &str) -> Vec<Vec<u8>> {
        text.lines().map(|line| line.as_bytes().to_vec()).collect()
    }

    #[expect(
        clippy::unnecessary_wraps,
        reason = "as what asks for Ctrl-C, which may fail"
    )]
    fn never() -> Result<bool> {
        Ok(false)
    }

    #[test]
    fn a_long_job_is_stopped_while_it_is_tried() {
        let job = lines("G1 X1000 F6000\nX0\nX1000\nX0");
        let mut asked = 0;
        let error = Forecast::of(&answers(), &job, UNLIMITED_BAUD, || {
            asked += 1;
            Ok(asked == 2)
        });
        assert!(error.unwrap_err().is::<Stopped>());
        assert_eq!(asked, 2);
    }

    #[test]
    fn the_time_that_is_left_goes_down_to_nothing() {
        let job = lines("G1 X10 F600\nX0\nG4 P2\nG4 P1");
        let forecast = Forecast::of(&answers(), &job, UNLIMITED_BAUD, never).unwrap();
        assert!(
            (6.0..8.0).contains(&forecast.total_s),
            "{}",
            forecast.total_s
        );
        let left = [0, 1, 2, 3, 4].map(|answered| forecast.remaining_s(answered, 0.0));
        assert!(left.is_sorted_by(|a, b| a >= b), "{left:?}");
        assert!((left[3] - 1.0).abs() < 0.1 && left[4] == 0.0, "{left:?}");
        // A line that takes longer than planned does not shorten the lines after it.
        assert!((forecast.remaining_s(2, 3600.0) - 1.0).abs() < 0.1);
    }

    #[test]
    fn what_is_refused_and_what_rises_an_alarm_is_known_before() {
        let forecast =
            Forecast::of(&answers(), &lines("G0 X1\nG999"), UNLIMITED_BAUD, never).unwrap();
        assert_eq!(forecast.refused.len(), 1);
        assert!(forecast.refused[0].contains("error:20"));
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
        assert_eq!(forecast.first_undone(0), 0);
        // All of these are answered before the first millimetre is done.
        assert_eq!(forecast.first_undone(5), 0);
        let late = forecast.first_undone(350);
        assert!((1..345).contains(&late), "{late}");
        // The dwell is answered when everything before it has been done; the line behind it may have come
        // before its answer.
        assert_eq!(forecast.first_undone(400), 399);
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
                    let undone = forecast.first_undone(answered);
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
