//! What an observer of a stream is shown of the segments, beside what the pins do.

use crate::support::{Machine, Recording, cases, fast, statistics};
use leadscrew::{
    axis::{AXES, Axes, Z},
    model::Levels,
    settings::{Settings, assign},
    sim::{Closes, SegmentKind, Simulator, Stream, StreamEnd},
    units::TICKS_PER_MS,
};
use proptest::prelude::*;

/// How a program is streamed.
#[derive(Debug, Clone, Copy, PartialEq, Eq)]
enum Lines {
    AsTheyAre,
    Numbered,
}

/// Streams a program to a machine, at most so many changes at a time.
fn watch(machine: Simulator, program: &str, lines: Lines, changes: u32) -> Recording {
    let mut recording = Recording::default();
    let mut stream =
        Stream::new(Box::new(machine), program.bytes(), 115_200).with_statements_at_rest();
    if lines == Lines::Numbered {
        stream = stream.with_numbers();
    }
    let end = loop {
        if let Some(end) = stream.pump(&mut recording, changes) {
            break end;
        }
    };
    assert_eq!(end, StreamEnd::Complete);
    recording
}

fn play(program: &str) -> Recording {
    watch(Simulator::new(&fast()), program, Lines::Numbered, u32::MAX)
}

/// The kinds and lines of what moves, each once in a row.
fn moves(recording: &Recording) -> Vec<(SegmentKind, u32)> {
    let segments = recording.segments.iter();
    let moving = segments.filter(|(_, segment)| segment.kind != SegmentKind::Standstill);
    let mut moves: Vec<_> = moving
        .map(|(_, segment)| (segment.kind, segment.line))
        .collect();
    moves.dedup();
    moves
}

#[test]
fn segments_tell_the_kind_the_line_and_the_programmed_speed() {
    let recording =
        play("G0X5\n(rest)\nN7G1X10F600\n/ Y5 F1200\nG4P0.1\n$J=G91X-2F300\nG3X0Y5I-4\n");
    assert_eq!(
        moves(&recording),
        [
            (SegmentKind::Rapid, 1),
            (SegmentKind::Feed, 3),
            (SegmentKind::Feed, 4),
            (SegmentKind::Jog, 0),
            (SegmentKind::Feed, 7),
        ]
    );
    let programmed = |line: u32| {
        let mut segments = recording.segments.iter().map(|(_, segment)| segment);
        let found = segments.find(|segment| segment.line == line);
        found.map(|segment| segment.programmed_mm_min)
    };
    assert_eq!(programmed(3), Some(600.0));
    assert_eq!(programmed(4), Some(1200.0));
    let dwell = recording
        .segments
        .iter()
        .filter(|(_, segment)| segment.kind == SegmentKind::Standstill);
    assert!(dwell.count() > 50, "a dwell is played in segments");
}

#[test]
fn homing_and_probing_are_distinguished() {
    let mut settings = fast();
    for statement in ["22=1", "27=1", "130=40", "131=40", "132=40"] {
        assign(&mut settings, statement.as_bytes()).unwrap();
    }
    let mut machine = Machine::of(Simulator::new(&settings));
    for axis in 0..AXES {
        let steps = (settings.steps_per_mm[axis].millionths() / 1_000_000) as i32;
        machine.mount(axis, Closes::From(10 * steps), Levels::limits(1 << axis));
        if axis == Z {
            machine.mount(axis, Closes::DownFrom(-5 * steps), Levels::PROBE);
        }
    }
    let machine = machine.into_simulator();
    let recording = watch(
        machine,
        "$H\nG91G38.2Z-30F100\nG0Z1\n",
        Lines::Numbered,
        u32::MAX,
    );
    let kinds: Vec<_> = moves(&recording)
        .into_iter()
        .map(|(kind, _)| kind)
        .collect();
    assert_eq!(
        kinds,
        [SegmentKind::Homing, SegmentKind::Probe, SegmentKind::Rapid]
    );
}

#[test]
fn a_number_changes_neither_answers_nor_motion() {
    let program = "N5 G1 X3 F500\n\n(N6)\n%\nG1 N8 X4\nG2 X8 Y4 I4\nn0009999X1 ; N3\nT1 N1.5\nG99999\n  /X2 (a) Y1\n$J=X1F100\n\
        O100\nX[1]\n$110=3000\nG4 P0.01\nN1 N2 X1\nG81 X1 Z-1 R1\nM30\n";
    let [plain, numbered] = [Lines::AsTheyAre, Lines::Numbered]
        .map(|lines| watch(Simulator::new(&fast()), program, lines, u32::MAX));
    assert_eq!(plain.answers, numbered.answers);
    assert!(
        plain
            .answers
            .iter()
            .any(|answer| answer.starts_with("error"))
    );
    assert_eq!(statistics(&plain.edges), statistics(&numbered.edges));
}

/// A move, an arc or a dwell.
fn line() -> impl Strategy<Value = String> {
    let ranges = [-3000..3000_i32, -3000..3000, -500..500];
    let feeds = 50..4000_i32;
    (0..6_u32, ranges, feeds).prop_map(|(what, [x, y, z], feed)| {
        let [x, y, z] = [x, y, z].map(|hundredths| f64::from(hundredths) / 100.0);
        match what {
            0 => format!("G0X{x}Y{y}Z{z}"),
            1 => format!("G3X{x}Y{y}R{}F{feed}", 0.6 * x.hypot(y) + 0.1),
            2 => format!("G1X{}F{feed}", x / 50.0),
            3 => "G4P0.02".into(),
            _ => format!("G1X{x}Y{y}Z{z}F{feed}"),
        }
    })
}

fn program() -> impl Strategy<Value = String> {
    prop::collection::vec(line(), 1..12).prop_map(|lines| format!("G91\n{}\n", lines.join("\n")))
}

fn settings() -> impl Strategy<Value = Settings> {
    prop_oneof![Just("150=0"), Just("150=2000")].prop_map(|jerk| {
        let mut settings = fast();
        let _ = assign(&mut settings, jerk.as_bytes());
        settings
    })
}

proptest! {
    #![proptest_config(cases(24))]

    #[test]
    fn a_stream_makes_the_same_steps_however_it_is_pumped(program in program(), changes in 1..500_u32) {
        let machine = || Simulator::new(&fast());
        let whole = watch(machine(), &program, Lines::AsTheyAre, u32::MAX);
        let pumped = watch(machine(), &program, Lines::Numbered, changes);
        prop_assert_eq!(statistics(&whole.edges), statistics(&pumped.edges));
    }

    #[test]
    fn segments_are_where_and_when_the_pins_are(program in program(), settings in settings()) {
        let recording = watch(Simulator::new(&settings), &program, Lines::Numbered, u32::MAX);
        let mut before = 0;
        for (pulses, segment) in &recording.segments {
            prop_assert!(segment.start_ticks >= before, "segments come in order");
            before = segment.start_ticks;
            let steps = pulses.checked_sub(1).map_or(Axes([0; AXES]), |last| recording.positions[last].1);
            for axis in 0..AXES {
                // A step on the boundary belongs to either segment.
                let off = steps[axis] - segment.steps[axis];
                prop_assert!(off.abs() <= 1, "{off} steps off at {}", segment.start_ticks);
            }
            let near = u64::from(TICKS_PER_MS) * 3 / 2;
            if let Some((ticks, _)) = recording.positions.get(*pulses) {
                prop_assert!(segment.start_ticks <= ticks + near, "a segment begins after its steps");
            }
        }
        let last = recording.segments.last().map(|(_, segment)| *segment);
        prop_assert!(last.is_none_or(|segment| segment.kind == SegmentKind::Standstill));
    }

    #[test]
    fn the_speeds_of_the_axes_are_together_that_along_the_path(program in program(), settings in settings()) {
        let recording = watch(Simulator::new(&settings), &program, Lines::Numbered, u32::MAX);
        for (_, segment) in &recording.segments {
            let speeds = segment.end_steps_s.iter().zip(settings.steps_per_mm.iter()).take(3);
            let speeds = speeds.map(|(speed, scale)| 60.0 * speed / (scale.millionths() as f32 * 1e-6));
            let speed = speeds.map(|speed| speed * speed).sum::<f32>().sqrt();
            let off = (speed - segment.end_mm_min).abs();
            // On an arc the acceleration turns within a segment.
            prop_assert!(off <= 3.0 + 0.02 * segment.end_mm_min, "{speed}, {} mm/min", segment.end_mm_min);
        }
    }
}
