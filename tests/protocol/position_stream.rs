//! The position stream: every line a position of the axes, in order, and never in the way of an answer.

use std::fmt::Write as _;

use leadscrew::{
    model::Rotation,
    settings::{Settings, assign},
    sim::Simulator,
    stepper::{IntegerArc, StepRule},
    units::TICKS_PER_SECOND,
};
use proptest::prelude::*;

use crate::support::{MS, Machine, assigned, cases, stream};

/// Four arcs of 270° about the ends of a cross: 2 400 steps each.
const PROGRAM: &str = include_str!("../../examples/pico.nc");
/// One step is 1 mm, 250 steps a second, no ramp, and every position streamed.
const MACHINE: &str = include_str!("../../examples/pico.settings");

/// Centre and end of each arc, and which way round.
const ARCS: [([i32; 2], [i32; 2], Rotation); 4] = [
    ([0, 400], [-400, 400], Rotation::CounterClockwise),
    ([-400, 0], [0, 0], Rotation::CounterClockwise),
    ([400, 0], [400, -400], Rotation::Clockwise),
    ([0, -400], [0, 0], Rotation::Clockwise),
];

/// What the machine did and sent.
struct Recorder {
    /// Every position that X, Y and Z have had, and when, ticks since power-up.
    trace: Vec<[i32; 3]>,
    ticks: Vec<u64>,
    /// The lines of the stream, each with the number of positions had before it, and answers.
    positions: Vec<(String, usize, u64)>,
    answers: Vec<String>,
    others: Vec<String>,
}

impl Recorder {
    /// The streamed positions.
    fn places(&self) -> Vec<Vec<i32>> {
        let place = |(line, ..): &(String, usize, u64)| {
            line.split(',')
                .zip(["X:", "Y:", "Z:"])
                .map(|(word, letter)| word.strip_prefix(letter).unwrap().parse().unwrap())
                .collect()
        };
        self.positions.iter().map(place).collect()
    }

    /// Time from the first step to the last.
    fn seconds(&self) -> f64 {
        let ticks = self.ticks[self.ticks.len() - 1] - self.ticks[0];
        ticks as f64 / f64::from(TICKS_PER_SECOND)
    }

    /// Every line is a position that the axes have had before the line, after the position of the previous line.
    fn assert_on_the_trace(&self) {
        let mut first = 0;
        for (place, (line, known, _)) in self.places().iter().zip(&self.positions) {
            let had = &self.trace[..*known];
            let found = had[first..].iter().position(|at| at.starts_with(place));
            first += found.unwrap_or_else(|| panic!("{line} is not on the trace from {first} on"));
        }
    }
}

fn settings(assignments: &[&str]) -> Settings {
    let machine = MACHINE.lines().filter_map(|line| line.strip_prefix('$'));
    assigned(machine.chain(assignments.iter().copied()))
}

fn run_at(settings: &Settings, program: &str, baud: u32) -> Recorder {
    let recording = stream(Simulator::new(settings), program, baud);
    let (ticks, steps): (_, Vec<_>) = recording.positions.into_iter().unzip();
    let messages = recording.messages.into_iter();
    let (positions, others): (_, Vec<_>) = messages.partition(|(line, ..)| line.starts_with("X:"));
    Recorder {
        trace: steps
            .iter()
            .map(|steps| [0, 1, 2].map(|axis| steps[axis]))
            .collect(),
        ticks,
        positions,
        answers: recording.answers,
        others: others.into_iter().map(|(line, ..)| line).collect(),
    }
}

fn run(assignments: &[&str], program: &str) -> Recorder {
    run_at(&settings(assignments), program, 115_200)
}

#[test]
fn the_stream_shows_every_step_of_the_experiment() {
    let recorder = run(&[], PROGRAM);
    assert_eq!(recorder.answers, ["ok"; 8]);
    recorder.assert_on_the_trace();
    let places = recorder.places();
    assert!(places.len() >= 2 * 2400, "{} lines", places.len());
    let mut before = [0, 0];
    for place in &places {
        let moved = [0, 1].map(|axis| (place[axis] - before[axis]).abs());
        assert!(
            moved.iter().all(|count| *count <= 1),
            "{before:?} to {place:?}"
        );
        assert_ne!(moved, [0, 0], "twice {place:?}");
        before = [place[0], place[1]];
    }
    let mut ends = places.iter();
    for end in [[-400, 400], [0, 0], [400, -400], [0, 0]] {
        assert!(ends.any(|place| *place == end), "{end:?}");
    }
    assert_eq!(recorder.positions.last().unwrap().0, "X:0,Y:0");
}

#[test]
fn the_experiment_ends_where_it_began_after_30_156_seconds() {
    let recorder = run(&[], PROGRAM);
    // Each arc with the places that it visits, from the end of the previous arc.
    let mut begin = 0;
    let mut from = [0, 0];
    let mut counts = [0, 0];
    for (center, end, _) in ARCS {
        let mut steps = 0;
        let mut place = from;
        for [x, y, _] in &recorder.trace[begin..] {
            let moved = [x - place[0], y - place[1]].map(i32::unsigned_abs);
            assert!(moved.iter().all(|moved| *moved <= 1));
            steps += moved[0] + moved[1];
            for (count, axis) in counts.iter_mut().zip(moved) {
                *count += axis;
            }
            place = [*x, *y];
            begin += 1;
            let radius = f64::from(x - center[0]).hypot(f64::from(y - center[1]));
            assert!((radius - 400.0).abs() <= 0.7072, "{place:?}: {radius}");
            if steps == 2400 {
                break;
            }
        }
        assert_eq!(place, end);
        from = place;
    }
    assert_eq!(begin, recorder.trace.len());
    assert_eq!(counts, [4800, 4800]);
    let seconds = recorder.seconds();
    assert!((seconds - 30.156).abs() <= 0.001, "{seconds} s");
}

#[test]
fn by_its_own_rule_the_experiment_makes_its_own_steps() {
    let recorder = run(&["790=1"], PROGRAM);
    assert_eq!(recorder.answers, ["ok"; 8]);
    recorder.assert_on_the_trace();
    let mut expected = Vec::new();
    let mut from = [0, 0];
    for (centre, end, rotation) in ARCS {
        let [start, last] = [from, end].map(|place| [0, 1].map(|axis| place[axis] - centre[axis]));
        let arc = IntegerArc::new(start, last, rotation, 1, StepRule::Sign).unwrap();
        let mut place = start;
        let before = expected.len();
        for step in arc {
            place = [place[0] + step.signs[0], place[1] + step.signs[1]];
            let radius = f64::from(place[0]).hypot(f64::from(place[1]));
            assert!((radius - 400.0).abs() <= 1.0, "{place:?}: {radius}");
            expected.push([place[0] + centre[0], place[1] + centre[1], 0]);
        }
        assert_eq!(expected.len() - before, 2400);
        assert_eq!(expected.last().unwrap()[..2], end);
        from = end;
    }
    assert_eq!(recorder.trace, expected);
    let messages = { recorder.others.iter() }.filter(|message| message.contains("MSG"));
    assert_eq!(messages.collect::<Vec<_>>(), ["[MSG:Pgm End]"]);
    let seconds = recorder.seconds();
    assert!((seconds - 30.156).abs() <= 0.02, "{seconds} s");
}

#[test]
fn an_arc_that_is_not_on_steps_is_made_all_the_same_and_reported() {
    let program = "G1X10F600\nG2X20.5Y0I5.25J0\nG2X10Y0I-5.25J0\nG1X11\n";
    let recorder = run(&["790=1", "792=0"], program);
    assert_eq!(recorder.answers, ["ok"; 4]);
    assert_eq!(recorder.others[1..], ["[MSG:Arc not on steps]"; 2]);
    let native = run(&["790=0", "792=0"], program);
    assert_eq!(recorder.trace, native.trace);
    assert_eq!(native.others, recorder.others[..1]);
}

#[test]
fn without_the_stream_nothing_is_sent() {
    let recorder = run(&["792=0", "793=1"], PROGRAM);
    assert!(recorder.positions.is_empty());
    let streamed = run(&["793=1"], PROGRAM);
    assert_eq!(recorder.answers, streamed.answers);
    assert_eq!(recorder.others, streamed.others);
    assert_eq!(recorder.trace, streamed.trace);
}

#[test]
fn lines_have_z_if_it_is_asked_for() {
    let program = "G1 X3 Z0.1 F600\nZ0.2\n";
    let recorder = run(&[], program);
    assert_eq!(recorder.positions.last().unwrap().0, "X:3,Y:0");
    let recorder = run(&["793=1"], program);
    recorder.assert_on_the_trace();
    assert_eq!(recorder.positions.last().unwrap().0, "X:3,Y:0,Z:50");
}

#[test]
fn lines_keep_their_distance_and_the_last_one_comes_all_the_same() {
    for interval_ms in [20, 1000] {
        let setting = format!("792={interval_ms}");
        let mut machine = Machine::with(&settings(&[&setting]));
        machine.send("G1 X300 F15000\nX303\n");
        let mut sent = Vec::new();
        loop {
            let now = machine.now();
            sent.extend(machine.lines().into_iter().map(|line| (now, line)));
            if !machine.advance() {
                break;
            }
        }
        sent.retain(|(_, line)| line.starts_with("X:"));
        assert_eq!(sent.pop().unwrap().1, "X:303,Y:0");
        // A line comes up to a segment after the position that it has.
        let shortest = sent.windows(2).map(|two| two[1].0 - two[0].0).min();
        let least = (interval_ms - 2) * MS;
        assert!(shortest.unwrap_or(least) >= least, "{shortest:?}");
        let expected = 1212 / interval_ms as usize;
        assert!(
            (expected / 2..=expected + 1).contains(&sent.len()),
            "{}",
            sent.len()
        );
    }
}

#[test]
fn settings_of_the_stream_have_their_ranges() {
    for refused in ["790=2", "792=1001", "792=-1", "792=x"] {
        let mut settings = Settings::default();
        assert!(
            assign(&mut settings, refused.as_bytes()).is_err(),
            "{refused}"
        );
    }
    for accepted in ["790=1", "792=0", "792=1000", "793=0", "793=1"] {
        let mut settings = Settings::default();
        assert!(
            assign(&mut settings, accepted.as_bytes()).is_ok(),
            "{accepted}"
        );
    }
}

proptest! {
    #![proptest_config(cases(24))]

    /// Each line gets its answer in order, whatever the line rate, with the same messages between.
    #[test]
    fn answers_are_the_same_with_the_stream(
        moves in prop::collection::vec((-40_i32..40, -40_i32..40), 1..30),
        interval_ms in 1_u32..50,
        baud in prop::sample::select(&[9600_u32, 115_200, 1_000_000][..]),
    ) {
        let mut program = String::from("G1 F15000\n");
        for (x, y) in &moves {
            let _ = write!(program, "X{x} Y{y}\n$\nG99\n");
        }
        program += "$G\n";
        let plain = run_at(&settings(&["792=0"]), &program, baud);
        let setting = format!("792={interval_ms}");
        let streamed = run_at(&settings(&[&setting]), &program, baud);
        prop_assert_eq!(&plain.answers, &streamed.answers);
        prop_assert_eq!(&plain.others, &streamed.others);
        prop_assert_eq!(&plain.trace.last(), &streamed.trace.last());
        streamed.assert_on_the_trace();
        let end = streamed.trace.last().map(|[x, y, _]| format!("X:{x},Y:{y}"));
        prop_assert_eq!(streamed.positions.last().map(|(line, ..)| line.clone()), end);
    }
}
