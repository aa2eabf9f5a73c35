//! The page beside the step trace of the same run.

use std::io::Cursor;

use leadscrew::{
    axis::AXES,
    settings::{Settings, StepRate, assign},
    sim::{Edge, PlayedSegment, SegmentKind, Simulator, StepStatistics},
    units::TICKS_PER_US,
};
use proptest::prelude::*;
use serde_json::Value;

use crate::{
    Job, Recording, cases,
    merge::Piece,
    playing::{self, Playing, RaisedAlarm, Recorder},
    program::Program,
    recording::scales,
    switch_positions::SwitchPositions,
    vertex::{Span, Vertex},
};

/// Longest segment, µs.
const SEGMENT_US: u64 = 1500;
/// How far the path may be off beyond a step, mm.
const NEAR_MM: f64 = 0.01;
/// Events of a trace that are looked at, spread over all of it.
const LOOKED_AT: usize = 3000;

/// The recording of the page, and the step trace.
struct Both {
    recording: Recording,
    /// Time, µs, and steps after each event.
    trace: Vec<(u64, [i32; AXES])>,
    segments: Vec<PlayedSegment>,
}

impl Recorder for Both {
    fn line(&mut self, line: &[u8]) {
        self.recording.line(line);
    }

    fn edge(&mut self, edge: &Edge, statistics: &StepStatistics) -> anyhow::Result<()> {
        if edge.raise != 0 {
            let steps = statistics.steps.0.map(|steps| steps as i32);
            self.trace
                .push((edge.ticks / u64::from(TICKS_PER_US), steps));
        }
        Ok(())
    }

    fn segment(&mut self, segment: &PlayedSegment) {
        self.segments.push(*segment);
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

fn mill() -> Settings {
    let mut settings = Settings::new(StepRate::Proven(190_000));
    for statement in [
        "100=320", "101=320", "102=400", "110=5000", "111=5000", "112=3000", "120=500", "121=500",
    ] {
        assign(&mut settings, statement.as_bytes()).expect("the mill's settings are accepted");
    }
    settings
}

/// Runs a program; returns also the job as the page gets it.
fn run(settings: &Settings, program: &str) -> (Both, Job) {
    let mut simulator = Box::new(Simulator::new(settings));
    let recorded = |simulator: &Simulator| Both {
        recording: Recording::new(simulator.session()),
        trace: Vec::new(),
        segments: Vec::new(),
    };
    let both = recorded(&simulator);
    let program = Program::from_reader(
        "a test".into(),
        Cursor::new(program.to_owned().into_bytes()),
    );
    let playing = Playing::new(program, &mut *simulator, both);
    let (figures, mut both) = playing.finish().expect("it comes to an end");
    let empty = recorded(&simulator).recording;
    let recording = std::mem::replace(&mut both.recording, empty);
    let job = recording.finish(&figures, "test.nc", settings);
    (both, job)
}

/// Reads a column of differences.
fn column(bytes: &mut impl Iterator<Item = u8>, count: usize) -> Vec<i64> {
    let mut sum = 0;
    let differences = std::iter::repeat_with(|| {
        let [mut value, mut place] = [0_u64, 0];
        loop {
            let byte = bytes.next().expect("the column goes on");
            value |= u64::from(byte & 0x7f) << place;
            place += 7;
            if byte < 0x80 {
                break (value >> 1).cast_signed() ^ -((value & 1).cast_signed());
            }
        }
    });
    let sums = differences.take(count).map(|difference| {
        sum += difference;
        sum
    });
    sums.collect()
}

/// Decodes the path as the page does: from the first motion on.
fn decoded(job: &Job) -> Vec<Vertex> {
    let mut bytes = job.columns.iter().copied();
    let count = job.path.vertices;
    let times = column(&mut bytes, count);
    let steps: [Vec<i64>; AXES] = std::array::from_fn(|_| column(&mut bytes, count));
    let [speeds, lines] = [(); 2].map(|()| column(&mut bytes, count));
    let kinds: Vec<u8> = bytes.by_ref().take(count).collect();
    let [programmed, before, after] = [(); 3].map(|()| column(&mut bytes, count));
    assert_eq!(bytes.next(), None, "nothing is left");
    let kind = |number: u8| match number {
        0 => SegmentKind::Standstill,
        1 => SegmentKind::Rapid,
        _ => SegmentKind::Feed,
    };
    let vertices = (0..count).map(|row| Vertex {
        us: times[row] as u64,
        steps: std::array::from_fn(|axis| steps[axis][row] as i32),
        speed: speeds[row] as u32,
        power: [before[row] as u32, after[row] as u32],
        span: Span {
            line: lines[row] as u32,
            kind: kind(kinds[row]),
            programmed: programmed[row] as u32,
        },
    });
    vertices.collect()
}

/// How far a place is from the path around a time, beyond a step, mm: near, or as far as at that time.
fn off(path: &[Vertex], scales: &[f64; AXES], us: u64, steps: &[i32; AXES]) -> f64 {
    let at = |time: u64| {
        let next = path
            .partition_point(|vertex| vertex.us <= time)
            .clamp(1, path.len() - 1);
        let piece = Piece {
            from: &path[next - 1],
            to: &path[next],
        };
        let share = piece.share_at(piece.time_of(time).min(1.0));
        let axes = (0..AXES).map(|axis| {
            let off = (piece.steps_at(share, axis) - f64::from(steps[axis])).abs();
            (off - 1.0).max(0.0) / scales[axis]
        });
        axes.fold(0.0, f64::max)
    };
    let around = (0..=30).map(|part| us.saturating_sub(SEGMENT_US) + part * 100);
    std::iter::once(us)
        .chain(around)
        .map(at)
        .find(|off| *off <= NEAR_MM)
        .unwrap_or_else(|| at(us))
}

fn line() -> impl Strategy<Value = String> {
    let displacements = [-3000..3000_i32, -3000..3000, -300..300];
    (0..8_u32, displacements, 50..4000_i32).prop_map(|(what, [x, y, z], feed)| {
        let [x, y, z] = [x, y, z].map(|share| f64::from(share) / 100.0);
        match what {
            0 => format!("G0X{x}Y{y}Z{z}"),
            1 => format!("G3X{x}Y{y}R{}F{feed}", 0.6 * x.hypot(y) + 0.1),
            2 => format!("G2X{}I{}F{feed}", x / 10.0, x / 20.0),
            3 => "G4P0.02".into(),
            4 => format!("M3S{feed}G1X{}F{feed}", x / 100.0),
            _ => format!("G1X{x}Y{y}Z{z}F{feed}"),
        }
    })
}

proptest! {
    #![proptest_config(cases(24))]

    #[test]
    fn the_path_of_the_page_is_that_of_the_steps(
        lines in prop::collection::vec(line(), 1..16),
        jerk in prop::sample::select(vec!["0", "5000"]),
        path in prop::sample::select(vec!["G61", "G64P0.1"]),
    ) {
        let mut settings = mill();
        for number in 800..803 {
            let _ = assign(&mut settings, format!("{number}={jerk}").as_bytes());
        }
        let (both, job) = run(&settings, &format!("{path}G91\n{}\n", lines.join("\n")));
        let path = decoded(&job);
        let moving = both.segments.iter().find(|segment| segment.kind != SegmentKind::Standstill);
        let Some(first) = moving else {
            prop_assert!(path.is_empty());
            return Ok(());
        };
        let begun = first.start_ticks / u64::from(TICKS_PER_US);
        let every = both.trace.len().div_ceil(LOOKED_AT).max(1);
        for (us, steps) in both.trace.iter().step_by(every) {
            let off = off(&path, &scales(&settings), us - begun, steps);
            prop_assert!(off <= NEAR_MM, "{off} mm off at {us} µs");
        }
        // All that is played is there: each boundary of segments belongs to the line and kind that it had.
        for pair in both.segments.windows(2) {
            let [segment, next] = pair else { continue };
            if segment.kind == SegmentKind::Standstill || next.start_ticks <= segment.start_ticks + 4 * u64::from(TICKS_PER_US) {
                continue;
            }
            let middle = u64::midpoint(segment.start_ticks, next.start_ticks) / u64::from(TICKS_PER_US) - begun;
            let found = path.partition_point(|vertex| vertex.us <= middle) - 1;
            prop_assert_eq!(path[found].span.line, segment.line);
            prop_assert_eq!(path[found].span.kind, segment.kind);
        }
        let last = both.segments.last().map(|segment| segment.start_ticks / u64::from(TICKS_PER_US) - begun);
        prop_assert_eq!(path.last().map(|vertex| vertex.us), last);
    }
}

#[test]
fn the_page_gets_what_is_marked_and_refused() {
    let program =
        "G10L2P1X2\nT4M6\nG0X1Y1Z9\nG81X5Y6Z-1R2F300\nX7\nG999\nG80\nM3S500\nG1Z3F200\nM30\n";
    let (_, job) = run(&mill(), program);
    let holes: Vec<_> = job
        .holes
        .iter()
        .map(|hole| (hole.line, hole.name.as_str(), hole.bottom))
        .collect();
    assert_eq!(
        holes,
        [(4, "G81", [7.0, 6.0, -1.0]), (5, "G81", [9.0, 6.0, -1.0])]
    );
    let changes: Vec<_> = job
        .tool_changes
        .iter()
        .map(|mark| (mark.line, mark.name.as_str()))
        .collect();
    assert_eq!(changes, [(2, "T4")]);
    let zeros: Vec<_> = job
        .work_zeros
        .iter()
        .map(|mark| (mark.name.as_str(), mark.at))
        .collect();
    assert_eq!(zeros, [("G54", [2.0, 0.0, 0.0])]);
    let refused: Vec<_> = job
        .refused
        .iter()
        .map(|one| (one.line, one.name.as_str()))
        .collect();
    assert_eq!(refused, [(6, "error:20")]);
    let changed: Vec<_> = job
        .settings
        .iter()
        .filter(|row| row.is_changed)
        .map(|row| row.text.as_str())
        .collect();
    assert!(
        changed.contains(&"$100=320.000") && changed.len() == 8,
        "{changed:?}"
    );
    let resolution = job.settings.iter().find(|row| row.text == "$101=320.000");
    assert_eq!(
        resolution.map(|row| row.name.as_str()),
        Some("resolution of Y")
    );
    assert_eq!(job.text, program.as_bytes());
    let path = decoded(&job);
    let powers: Vec<_> = path
        .iter()
        .filter(|vertex| vertex.span.line == 9)
        .map(|vertex| vertex.power[1])
        .collect();
    assert!(
        !powers.is_empty() && powers.iter().all(|power| (495..=505).contains(power)),
        "{powers:?}"
    );
    let facts: Value = serde_json::to_value(&job).expect("facts are JSON");
    assert_eq!(facts["axes"].as_array().map(Vec::len), Some(AXES));
    assert_eq!(facts["path"]["vertices"], path.len());
}

#[test]
fn a_job_of_the_reprap_dialect_is_drawn_line_by_line() {
    let mut settings = mill();
    assign(&mut settings, b"780=1").expect("it is the dialect");
    let lines = [
        "; a printer's file",
        "G21",
        "M83",
        "G0 X10 Y5 F3000",
        "",
        "G1 X20 E1 F1200 ; it cuts",
        "M117 N5 says nothing",
        "G150",
        "G1 Y20 E2",
        "; the end",
    ];
    let (both, job) = run(&settings, &lines.join("\n"));
    let points = job.waypoints();
    let numbers = |kind| {
        let of_kind = points.iter().filter(|point| point.kind == kind);
        let mut numbers: Vec<_> = of_kind.map(|point| point.line).collect();
        numbers.dedup();
        numbers
    };
    assert_eq!(numbers(2), [4, 6, 9]);
    // The last point begins nothing.
    let place = points[points.len() - 1].place;
    assert_eq!(place[..3], [20.0, 20.0, 0.0]);
    let facts = serde_json::to_value(&job).expect("it becomes JSON");
    assert_eq!(
        (&facts["lines"], &facts["refused"][0]["line"]),
        (&10.into(), &8.into())
    );
    assert_eq!(facts["refused_count"], 1);
    // The numbers take no time: the steps are those without them.
    let mut simulator = Box::new(Simulator::new(&settings));
    let program = Program::from_reader("a test".into(), Cursor::new(lines.join("\n")));
    let (figures, ()) = Playing::new(program, &mut *simulator, ())
        .finish()
        .expect("it comes to an end");
    assert_eq!(facts["hash"], figures.event_hash.as_str());
    assert!(both.trace.len() > 1000);
}

#[test]
fn an_alarm_has_the_line_that_raised_it() {
    let program = "G1 X1 F600\nG38.2 Z-1\nG1 X3\nX4\nX5\n";
    let (_, job) = run(&mill(), program);
    let [alarm] = &job.alarms[..] else {
        panic!("{:?}", job.alarms);
    };
    assert_eq!((alarm.line, alarm.name.as_str()), (2, "ALARM:5"));
    assert!(alarm.why.contains("probe farther"), "{}", alarm.why);
}

/// Keeps the alarms.
#[derive(Default)]
struct Alarms(Vec<RaisedAlarm>);

impl Recorder for &mut Alarms {
    fn alarm(&mut self, alarm: &RaisedAlarm) {
        self.0.push(alarm.clone());
    }

    fn wants_line_numbers(&self) -> bool {
        true
    }
}

/// The alarm of a program at a mill with soft limits, or with hard limits and switches.
fn alarm_of(switches: bool, program: &str) -> RaisedAlarm {
    let mut settings = mill();
    let limits = if switches { "21=1" } else { "20=1" };
    for statement in ["22=1", limits, "24=1000", "25=5000"] {
        assign(&mut settings, statement.as_bytes()).expect("limits are accepted");
    }
    let mut simulator = Box::new(Simulator::new(&settings));
    if switches {
        SwitchPositions::of(&settings).mount_on(&mut simulator);
    }
    playing::unlock(&mut simulator);
    let mut alarms = Alarms::default();
    let lines = Program::from_reader("a test".into(), Cursor::new(program.to_owned()));
    let ended = Playing::new(lines, &mut *simulator, &mut alarms)
        .finish()
        .err();
    let [alarm] = &alarms.0[..] else {
        panic!("{program}: {:?}", alarms.0);
    };
    // Where lines have no answer, the alarm is why.
    if let Some(error) = ended {
        assert_eq!(error.downcast_ref(), Some(alarm));
    }
    alarm.clone()
}

#[test]
fn a_line_that_leaves_the_travel_is_named_with_axis_and_coordinate() {
    for (program, line, text, what) in [
        ("G0 X-10\nX250\nX-20\nX-30\n", 2, "X250", "X 250.000"),
        (
            "G0 X-10\nG91 X-30\nY-201 (far) Z-1\n",
            3,
            "Y-201 (far) Z-1",
            "Y -201.000",
        ),
        ("G10 L2 P1 Z-150\nG0 Z-60\n", 2, "G0 Z-60", "Z -210.000"),
        (
            "G20\nG0 X-1\nG38.2 Z-9 F10\n",
            3,
            "G38.2 Z-9 F10",
            "Z -228.600",
        ),
        // Half of a circle of which only the middle is outside, and one in a rotated system.
        (
            "G0 X-5 Y-20\nG2 X-5 Y-40 J-10 F600\nX-6\n",
            2,
            "G2 X-5 Y-40 J-10 F600",
            "X 5.000",
        ),
        (
            "G0 Z-5\nX-5 Y-40\nG68 X0 Y0 R30\nG18 G2 Z-5 K5 F600\n",
            4,
            "G18 G2 Z-5 K5 F600",
            "Z 5.",
        ),
        (
            "G0 Z-5\nX-9 Y-9\nG91 G81 X-50 Z-2 R1 L5 F99\nX0\n",
            3,
            "G91 G81 X-50 Z-2 R1 L5 F99",
            "X -",
        ),
    ] {
        let alarm = alarm_of(false, program);
        let found = (alarm.line, alarm.text.as_str(), alarm.name.as_str());
        assert_eq!(found, (line, text, "ALARM:2"), "{program}");
        let details = format!("({what}");
        assert!(alarm.why.contains(&details), "{program}: {alarm}");
        let range = " in machine coordinates is not within -200.000 to 0.000)";
        assert!(alarm.why.contains(range), "{alarm}");
    }
}

#[test]
fn a_compensated_move_that_leaves_the_travel_is_named_as_one_of_a_line_before() {
    let program = "G0 X-20 Y-20\nG41.1 D8 G1 X-10 F600\nX-1\nY-50\nX-10\nG40 X-20\n";
    let alarm = alarm_of(false, program);
    assert!(
        alarm.why.contains("X ") && alarm.why.contains("that cutter compensation has held back"),
        "{alarm}"
    );
}

#[test]
fn a_limit_switch_that_closes_is_named_with_the_line_in_execution() {
    let alarm = alarm_of(true, "$H\nG1 X-9 F3000\nX-20\nX250\nX-9\nX-8\n");
    assert_eq!((alarm.line, alarm.name.as_str()), (4, "ALARM:1"), "{alarm}");
    let alarm = alarm_of(true, "G1 X-9 F3000\nX-1000\nX-9\nX-8\n");
    assert_eq!((alarm.line, alarm.name.as_str()), (2, "ALARM:1"), "{alarm}");
}
