//! What watches the virtual machine while a job is tried.

use std::collections::VecDeque;

use super::{Entries, Forecast, RefusedLine};
use crate::{
    line_times::LineTimes,
    machine_answers::{probes, without_contact},
    playing::{outside_travel, reason_of_alarm},
    replay::TwoContacts,
    sender::{Response, shown},
};
use anyhow::{Result, bail};
use grbl_client::meaning::{self, LineOfAlarm};
use leadscrew::{
    axis::{AXES, Axes},
    gcode::LineError,
    machine::Snapshot,
    model::{Alarm, PathControl},
    settings::Settings,
    sim::{Edge, PlayedSegment, SegmentKind, Simulator, Stream, StreamEnd, Watcher},
    units::{Nm, TICKS_PER_SECOND},
};

/// Entries that path control and cutter compensation may still make of the moves that wait for the next one
/// when a line is answered.
const DIVIDED: u32 = 4;

/// Steps of entries that count as finished may still be queued: at most 5 ms of them, twice of which is
/// waited here, s.
const QUEUED_S: f64 = 0.01;

/// How far a position may be off as it is shown, with four decimals of an inch, mm.
const SHOWN_MM: f64 = 0.0013;

/// Changes of the virtual machine after which it is told how far it is.
const SHOWN: u32 = 100_000;

/// What watches the virtual machine.
pub(super) struct Recorder<'a> {
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
    /// Where the machine has been stopped, and how near that is: mm or degrees.
    place: Option<(&'a [f64], f64)>,
    /// Where the segment begins that is being played, mm or degrees, and the line of it.
    segment: (Axes<f64>, Option<usize>),
    forecast: Forecast,
    /// Refused lines, counted from 0, with the number of the error.
    refused: Vec<(usize, u16)>,
    /// Answers before the first alarm, its number and what it means.
    alarm: Option<(usize, String, String)>,
}

impl<'a> Recorder<'a> {
    pub(super) fn new(
        lines: &'a [Vec<u8>],
        place: Option<&'a [f64]>,
        simulator: &Simulator,
    ) -> Self {
        Self {
            lines,
            start: simulator.now(),
            base: simulator.session().entered(),
            finished_base: simulator.snapshot().finished,
            now_s: 0.0,
            finished: VecDeque::from([(0.0, 0)]),
            pending: Vec::new(),
            place: place.map(|place| {
                let is_in_inches = simulator.session().settings().report_inches;
                (place, if is_in_inches { 25.4 } else { 1.0 })
            }),
            segment: (Axes::all(0.0), None),
            forecast: Forecast {
                times: LineTimes {
                    probing: lines.iter().position(|line| probes(line)),
                    ..LineTimes::default()
                },
                ..Forecast::default()
            },
            refused: Vec::new(),
            alarm: None,
        }
    }

    /// Lets the virtual machine carry out the job.
    pub(super) fn play(
        &mut self,
        simulator: &mut Simulator,
        baud: u32,
        mut watch: impl FnMut(usize) -> Result<()>,
    ) -> Result<StreamEnd> {
        let lines = self.lines.iter();
        let bytes = lines.flat_map(|line| without_contact(line).into_iter().chain([b'\n']));
        let mut stream = Stream::new(&mut *simulator, bytes, baud)
            .with_statements_at_rest()
            .with_numbers();
        let end = loop {
            if let Some(end) = stream.pump(self, SHOWN) {
                break end;
            }
            watch(self.forecast.times.answered_s.len())?;
        };
        drop(stream);
        self.change(simulator);
        Ok(end)
    }

    /// The forecast, without what the contact of a probe decides on.
    ///
    /// # Errors
    /// The job ends in an alarm.
    pub(super) fn judge(
        mut self,
        end: StreamEnd,
        simulator: &Simulator,
        mut contacts: TwoContacts,
    ) -> Result<Forecast> {
        self.forecast.note_undone();
        if let Some((answered, number, reason)) = &self.alarm {
            let undone = self.forecast.times.first_undone(*answered);
            let place = match meaning::line_of_alarm(number) {
                Some(LineOfAlarm::InExecution) if undone < *answered => {
                    format!("one of the lines {} to {}", undone + 1, answered + 1)
                }
                _ => self.place(*answered),
            };
            bail!("{place} would end in ALARM:{number}, {reason}");
        }
        if end == StreamEnd::Stuck {
            bail!(
                "the job would end in the state {}",
                simulator.snapshot().state.name()
            );
        }
        let mut refused = self.refused.iter().peekable();
        // Where the virtual machine has soft limits, it has kept to them.
        let is_limited =
            contacts.settings().soft_limits && !simulator.session().settings().soft_limits;
        for (index, line) in self.lines.iter().enumerate() {
            if refused.peek().is_none() && !is_limited {
                break;
            }
            let read = contacts.read(line);
            if let Some((_, number)) = refused.next_if(|(line, _)| *line == index)
                && !read.decides_refusal(*number)
            {
                self.forecast.refused.push(RefusedLine {
                    line: index + 1,
                    error: *number,
                });
            }
            if let Some(outside) = read.outside.filter(|_| is_limited) {
                let number = Alarm::SoftLimit.number().to_string();
                let details = outside_travel(outside, contacts.settings());
                let reason = meaning::alarm_with_remedy(&number, Some(&details));
                let reason = meaning::after_comma(reason.as_deref());
                bail!("{} would end in ALARM:{number}{reason}", self.place(index));
            }
        }
        self.forecast.times.total_s = self.now_s;
        Ok(self.forecast)
    }

    /// Names a line of the job, counted from 0.
    fn place(&self, line: usize) -> String {
        let text = self.lines.get(line).map_or(&[][..], Vec::as_slice);
        format!("line {} ({})", line + 1, shown(text))
    }

    /// Notes that the machine passes the place where the real one has been stopped: of a segment, its ends are known.
    fn pass(&mut self, snapshot: &Snapshot, settings: &Settings) {
        let Some((place, unit_mm)) = self.place else {
            return;
        };
        let end_mm = settings.position_of(snapshot.steps).map(Nm::to_mm_f64);
        let next = self.forecast.times.begun.last().map(|(_, line)| *line);
        let (start_mm, line) = core::mem::replace(&mut self.segment, (end_mm, next));
        let moved_mm = end_mm.zip(start_mm, |end, start| end - start);
        let product = |one: &Axes<f64>, other: &Axes<f64>| -> f64 {
            one.iter().zip(other).map(|(one, other)| one * other).sum()
        };
        let place_mm =
            Axes::from_fn(|axis| place.get(axis).map_or(end_mm[axis], |at| at * unit_mm));
        let from_start = place_mm.zip(start_mm, |place, start| place - start);
        let length_sqr = product(&moved_mm, &moved_mm).max(f64::MIN_POSITIVE);
        let share = (product(&from_start, &moved_mm) / length_sqr).clamp(0.0, 1.0);
        let is_near = |axis: usize| {
            let step_mm = 1e6 / settings.steps_per_mm[axis].millionths() as f64;
            (share * moved_mm[axis] - from_start[axis]).abs() <= step_mm + SHOWN_MM
        };
        if self.forecast.passing.last() != line.as_ref() && (0..AXES).all(is_near) {
            self.forecast.passing.extend(line);
        }
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
        entries.extend(self.pending.drain(..).map(|finished| Entries {
            needed,
            finished,
            may_wait,
        }));
        let ticks = simulator.now() - self.start;
        let snapshot = simulator.snapshot();
        let finished = snapshot.finished.wrapping_sub(self.finished_base);
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
        self.pass(&snapshot, simulator.session().settings());
    }

    fn segment(&mut self, segment: &PlayedSegment) {
        let Some(line) = (segment.line as usize).checked_sub(1) else {
            return;
        };
        // Another number is one of the program, after other words.
        let latest = self
            .forecast
            .times
            .begun
            .last()
            .map_or(0, |(_, latest)| *latest);
        let is_next = line > latest || self.forecast.times.begun.is_empty();
        if segment.kind != SegmentKind::Standstill
            && is_next
            && line <= self.forecast.times.answered_s.len()
        {
            self.forecast.times.begun.push((self.now_s, line));
        }
    }

    fn answer(&mut self, line: u64, answer: &[u8]) {
        self.forecast.times.answered_s.push(self.now_s);
        self.pending
            .push(self.finished.front().map_or(0, |(_, finished)| *finished));
        let text = String::from_utf8_lossy(answer);
        let engaged = u16::from(LineError::LimitsEngaged.number());
        if let Some(Response::Error(number)) = Response::parse(&text)
            && number != engaged
        {
            self.refused.push((line as usize - 1, number));
        }
    }

    fn message(&mut self, simulator: &Simulator, answers: u64, message: &[u8]) {
        if let Some(number) = message.strip_prefix(b"ALARM:") {
            let number = String::from_utf8_lossy(number);
            let reason = reason_of_alarm(&number, simulator.session());
            self.alarm
                .get_or_insert((answers as usize, number.into_owned(), reason));
        }
    }
}

#[cfg(test)]
mod tests {
    //! Programs that probe, and machines with plates at many depths.

    use super::*;
    use crate::{
        SwitchPositions,
        machine_answers::{UNLIMITED_BAUD, of_virtual_machine},
    };
    use grbl_client::MachineAnswers;
    use leadscrew::{
        axis::Z,
        model::Levels,
        settings::{Settings, assign},
        sim::{Closes, Edge, Simulator, Stream, StreamEnd, Switch, Watcher},
        units::Nm,
    };

    /// Travel of each axis, mm.
    const TRAVEL_MM: f64 = 40.0;
    /// Steps in a millimetre of each axis.
    const SCALE: f64 = 80.0;

    fn settings(assignments: &[String]) -> Settings {
        let mut settings = Settings::default();
        let axes = (0..3).flat_map(|axis| {
            [(100, SCALE), (110, 5000.0), (120, 500.0), (130, TRAVEL_MM)]
                .map(|(number, value)| format!("{}={value}", number + axis))
        });
        for assignment in axes.chain(["24=600".into(), "25=5000".into()]) {
            assign(&mut settings, assignment.as_bytes()).unwrap();
        }
        for assignment in assignments {
            assign(&mut settings, assignment.as_bytes()).unwrap();
        }
        settings
    }

    fn lines(text: &str) -> Vec<Vec<u8>> {
        text.lines().map(|line| line.as_bytes().to_vec()).collect()
    }

    fn forecast(answers: &MachineAnswers, text: &str) -> Result<Forecast> {
        Forecast::of(answers, &lines(text), UNLIMITED_BAUD, |_| Ok(()))
    }

    /// What the machine says of a program but `ok`.
    #[derive(Default)]
    struct Objections(Vec<String>);

    impl Watcher for Objections {
        fn edge(&mut self, _: &Edge) {}

        fn answer(&mut self, line: u64, answer: &[u8]) {
            if answer != b"ok" {
                let answer = String::from_utf8_lossy(answer);
                self.0.push(format!("line {line}: {answer}"));
            }
        }

        fn message(&mut self, _: &Simulator, answers: u64, message: &[u8]) {
            if message.starts_with(b"ALARM") {
                let message = String::from_utf8_lossy(message);
                self.0.push(format!("after {answers} answers: {message}"));
            }
        }
    }

    fn run(simulator: &mut Simulator, text: &str) -> (StreamEnd, Vec<String>) {
        let mut objections = Objections::default();
        let end = Stream::new(simulator, text.bytes(), UNLIMITED_BAUD)
            .with_statements_at_rest()
            .run(&mut objections);
        (end, objections.0)
    }

    /// A homed machine amid its switches.
    fn homed(settings: &Settings) -> Box<Simulator> {
        let mut simulator = Box::new(Simulator::new(settings));
        let positions = SwitchPositions::of(settings);
        for axis in 0..3 {
            for closes in [
                Closes::From(positions.high[axis]),
                Closes::DownFrom(positions.low[axis]),
            ] {
                let input = Levels::limits(1 << axis);
                assert!(simulator.mount(Switch {
                    axis,
                    closes,
                    input
                }));
            }
        }
        let homed = run(&mut simulator, "$H\n");
        assert_eq!(homed, (StreamEnd::Complete, Vec::new()));
        simulator
    }

    /// Puts a plate so deep below a machine coordinate of Z, mm.
    fn mount_plate(simulator: &mut Simulator, z_mm: f64) {
        let position = simulator.snapshot().steps[Z];
        let steps = (z_mm * SCALE).round() as i32 - position + simulator.physical_steps()[Z];
        assert!(simulator.mount(Switch {
            axis: Z,
            closes: Closes::DownFrom(steps),
            input: Levels::PROBE,
        }));
    }

    /// A program that probes in the middle of the travel, mm, from 8 mm above it, twice; and 20 mm at most.
    fn program(middle: [f64; 3]) -> String {
        let [x, y, z] = middle;
        let above = z + 8.0;
        format!(
            "G21 G90\nG28\nG53 G0 X{x} Y{y}\nG53 G0 Z{above}\nG91 G38.2 Z-20 F600 P1.5\nG90 G0 Z5\nG1 X1 Y1 F900\n\
             G53 G0 Z{above}\nG91 G38.2 Z-20 F300\nG38.4 Z4 F60\nG90 G10 L20 P2 Z3\nG55 G0 Z6\nG2 X3 Y1 I1 J0\n\
             G53 G0 Z{above}\nG28\nM2\n"
        )
    }

    #[test]
    fn a_program_that_probes_is_sent_wherever_the_plate_is_and_the_machine_is_homed() {
        for corner in 0..8 {
            for (homing, hard_limits) in [(1, 0), (1, 1), (9, 0), (9, 1)] {
                let assignments = [
                    format!("22={homing}"),
                    format!("23={corner}"),
                    format!("21={hard_limits}"),
                    "20=1".into(),
                ];
                let settings = settings(&assignments);
                let mut middle = [0, 1, 2].map(|axis| {
                    let [low, high] = settings.travel(axis).unwrap().map(Nm::to_mm_f64);
                    f64::midpoint(low, high)
                });
                // Where the work zero is, the program's X1 Y1 are in the travel.
                let mut simulator = homed(&settings);
                let [x, y, _] = middle;
                let origins = format!(
                    "G10 L2 P1 X{x} Y{y} Z{}\nG10 L2 P2 X{x} Y{y}\n",
                    middle[2] + 12.0
                );
                assert_eq!(run(&mut simulator, &origins).1, [""; 0]);
                middle[0] += 1.0;
                let program = program(middle);
                let forecast = forecast(&of_virtual_machine(&mut simulator), &program);
                let forecast = forecast.unwrap_or_else(|error| panic!("{assignments:?}: {error}"));
                assert_eq!(forecast.refused, [], "{assignments:?}");
                assert_eq!(forecast.times.probing, Some(4));
                for depth_mm in [1.0, 5.0, 9.5, 14.0, 19.0] {
                    let mut simulator = homed(&settings);
                    run(&mut simulator, &origins);
                    mount_plate(&mut simulator, middle[2] + 8.0 - depth_mm);
                    let ended = run(&mut simulator, &program);
                    let expected = (StreamEnd::Complete, Vec::new());
                    assert_eq!(ended, expected, "{assignments:?}, {depth_mm} mm");
                }
            }
        }
    }

    /// A machine that has been homed at the upper ends, and does not leave its travel.
    fn guarded(assignments: &[&str]) -> MachineAnswers {
        let assignments = ["22=1", "20=1"].iter().chain(assignments);
        let assignments: Vec<_> = assignments.map(ToString::to_string).collect();
        of_virtual_machine(&mut homed(&settings(&assignments)))
    }

    /// Z probes down to -30, and the plate gives it its zero: without contact, `G0 Z5` would be above the travel.
    const TOUCH: &str = "G21 G90\nG53 G0 Z-10\nG38.2 Z-30 F600 P1.5\nG0 Z5\n";

    #[test]
    fn what_depends_on_the_contact_is_no_reason_to_refuse_a_program() {
        let machine = guarded(&[]);
        for text in [
            TOUCH,
            "G21 G90\nG53 G0 Z-10\nG38.2 Z-30 F600\nG10 L20 P1 Z0\nG0 Z-15\nG0 Z5",
            "G21 G90\nG53 G0 Z-10\nG38.2 Z-30 F600\nG92 Z0\nG1 Z-12\nG0 Z20",
            "G21 G90\nG53 G0 Z-10\nG91\nG38.3 Z-25 F600\nG38.5 Z5\nG0 Z-9",
            // The arc begins where the contact is.
            "G21 G90\nG0 X-9 Y-9\nG38.2 X-15 F600\nG2 X-5 Y-9 I2 J0",
        ] {
            let forecast =
                forecast(&machine, text).unwrap_or_else(|error| panic!("{text}: {error}"));
            assert_eq!(forecast.refused, [], "{text}");
        }
    }

    #[test]
    fn what_is_wrong_with_any_contact_is_known_before() {
        let machine = guarded(&[]);
        for (after, axis) in [
            ("G0 X-60", "X"),
            ("G53 G0 Z3", "Z"),
            ("G53 G0 Z-5\nG1 Y-50 F900", "Y"),
        ] {
            let error = forecast(&machine, &[TOUCH, after].concat()).unwrap_err();
            let expected = format!("({}) would end in ALARM:2", after.lines().last().unwrap());
            let error = error.to_string();
            assert!(
                error.contains(&expected) && error.contains(&format!("({axis} ")),
                "{error}"
            );
        }
        let before = forecast(&machine, "G21 G90\nG0 Z-99\nG38.2 Z-30 F600").unwrap_err();
        assert!(
            before.to_string().starts_with("line 2 (G0 Z-99)"),
            "{before}"
        );
        let cuts = (0..35).map(|cut| format!("G1 X-{cut} F5000\n"));
        let cuts = cuts.collect::<Vec<_>>().concat();
        let forecast = forecast(
            &machine,
            &[TOUCH, &cuts, "G999\nG0 X-1\nG0 X-1 Y-1\nG2 X-3 Y-1 I-9 J0"].concat(),
        );
        let refused = forecast.unwrap().refused;
        let lines: Vec<_> = refused.iter().map(|refused| refused.line).collect();
        assert_eq!(lines, [40, 43]);
    }

    #[test]
    fn contacts_that_are_closed_at_rest_and_homing_within_a_program_stop_nothing() {
        let mut machine = guarded(&["21=1"]);
        machine.settings.extend(["$5=1".into(), "$6=1".into()]);
        let text = [TOUCH, "G0 X-20\n$H\nG53 G0 X-5\nG38.4 Z-8 F600\n$HX\n"].concat();
        let forecast = forecast(&machine, &text).unwrap();
        assert_eq!(forecast.refused, []);
    }

    #[test]
    fn the_times_of_a_program_that_probes_are_those_without_contact() {
        let machine = guarded(&[]);
        let travelled = |text: &str| forecast(&machine, text).unwrap().times.total_s;
        let moves =
            |code: &str| travelled(&format!("G21 G90\nG0 Z-9\n{code} Z-39 F60\nG53 G0 Z-1"));
        for code in ["G38.2", "G38.3", "G38.4", "G38.5"] {
            assert!((moves(code) - moves("G1")).abs() < 0.5, "{code}");
        }
    }
}
