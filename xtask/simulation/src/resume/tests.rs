//! Where jobs are continued, and how the machine gets there.

use leadscrew::{
    axis::{LETTERS, LINEAR},
    settings::TOOL_CHANGE_IGNORED,
    sim::{Edge, Simulator, Stream, StreamEnd, Watcher},
};

use super::*;
use crate::machine_answers::UNLIMITED_BAUD;

pub(super) const DESCENT: Plunge = Plunge {
    feed_mm_min: 150.0,
    spin_up_s: 2.0,
    reports_tool: false,
};

pub(super) fn lines(text: &str) -> Vec<Vec<u8>> {
    text.lines().map(|line| line.as_bytes().to_vec()).collect()
}

fn entry_with(text: &str, line: usize, is_placed: bool, settings: &Settings) -> Result<Entry> {
    let beginning = Beginning {
        interpreter: Interpreter::new(),
        is_placed,
    };
    let now = Interpreter::new();
    entry(&lines(text), line - 1, &beginning, &now, settings, DESCENT)
}

fn entry_of(text: &str, line: usize) -> Result<Entry> {
    entry_with(text, line, true, &Settings::default())
}

/// Words with those of rotary axes, which stay at 0.
fn with_rotary(words: &str) -> String {
    let rotary = (LINEAR..AXES).map(|axis| format!(" {}0", char::from(LETTERS[axis])));
    [words.to_owned()].into_iter().chain(rotary).collect()
}

/// The line, counted from 1, at which a job is continued.
fn first(text: &str, line: usize) -> usize {
    entry_of(text, line).unwrap().line + 1
}

#[test]
fn a_job_is_never_continued_within_a_contour_or_a_cycle_but_at_the_line_that_enters_it() {
    let contour = "G0 X0 Y0\nG41.1 D4\nG1 X10 F100\nY10\nX20\nG40 G0 X30\nG0 X40\nG0 X50";
    assert_eq!(
        [1, 2, 3, 4, 5, 6, 7, 8].map(|line| first(contour, line)),
        [1, 2, 2, 2, 2, 2, 7, 8]
    );
    let holes = "G0 Z10 F100\nG81 X5 Z-3 R2\nX10\nX20\nG80\nG0 X0\nG0 X1";
    assert_eq!(
        [2, 3, 4, 5, 6, 7].map(|line| first(holes, line)),
        [2, 2, 2, 2, 6, 7]
    );
}

#[test]
fn z_is_up_before_the_other_axes_move_and_down_at_feed_after_the_spindle() {
    let job = "G0 Z8\nM3 S900 M8\nG0 X3 Y4\nG1 Z-2 F500\nG1 X9\nG1 Y9";
    let entry = entry_of(job, 6).unwrap();
    let travel = with_rotary("G0 X9 Y4");
    let expected = [
        "G21 G90 G94 G17 G40 G49 G80 G54",
        "G53 G0 Z8",
        &travel,
        "M3 S900",
        "M8",
        "G4 P2",
        "G1 Z-2 F150",
        "F500 T0 G61",
        "G21 G90 G94 G17 G98 G91.1",
    ];
    assert_eq!(entry.approach, expected);
    assert_eq!(entry.position.join(" "), with_rotary("X9 Y4 Z-2"));
    assert!(
        entry.modes.starts_with("[GC:G1 G54") && entry.modes.contains("M3 M8"),
        "{}",
        entry.modes
    );
}

#[test]
fn z_goes_to_the_top_of_a_machine_that_homes_and_a_beam_stays_off_until_the_end() {
    let mut settings = Settings {
        homing: 1,
        homing_pull_off_mm: 2.0,
        ..Settings::default()
    };
    let mut below = Interpreter::new();
    below.set_position(Axes::all(Nm(-5_000_000)));
    let beginning = Beginning {
        interpreter: below.clone(),
        is_placed: true,
    };
    let job = lines("M4 S900\nG0 X3 Z-9\nG1 X9 F500\nG1 Y9");
    let approach = |settings: &Settings| {
        let entry = entry(&job, 3, &beginning, &below, settings, DESCENT);
        entry.unwrap().approach
    };
    assert_eq!(approach(&settings)[1], "G53 G0 Z-2");
    settings.homing_direction = 1 << Z;
    assert_eq!(approach(&settings)[1], "G53 G0 Z-5");
    settings.laser = true;
    let lines = approach(&settings);
    let index = |begin: &str| lines.iter().position(|line| line.starts_with(begin));
    assert!(
        index("G1 Z-9").unwrap() < index("M4 S900").unwrap(),
        "{lines:?}"
    );
    assert_eq!(index("G4"), None);
}

#[test]
fn a_place_that_depends_on_where_the_job_began_is_refused_until_it_no_longer_does() {
    let job = "G91\nG1 X5 F100\nG1 Y5\nG90\nG0 X1 Y1\nG0 Z1\nG0 X2";
    for line in 1..=6 {
        assert!(
            entry_with(job, line, false, &Settings::default()).is_err(),
            "{line}"
        );
    }
    let entry = entry_with(job, 7, false, &Settings::default()).unwrap();
    assert_eq!(entry.line, 6);
    assert_eq!(first(job, 3), 3);
}

#[test]
fn an_axis_that_the_job_never_moves_is_where_it_is() {
    let entry = |job: &str| entry_with(job, 3, false, &Settings::default());
    assert_eq!(entry("G0 X1 Y1\nG0 X2\nG0 X3").unwrap().line, 2);
    // Z has moved since, or comes back to where it is now.
    assert!(entry("G0 X1 Y1\nG0 X2\nG0 X3\nG0 Z5").is_err());
    assert!(entry("G0 X1 Y1\nG0 X2\nG0 X3\nG0 Z0").is_err());
}

#[test]
fn after_a_probing_move_a_job_is_continued_only_where_nothing_depends_on_it() {
    let job = "G0 X1\nG38.2 Z-5 F50\nG0 Z5\nG0 X2 Y2\nG0 X3";
    assert_eq!([2, 3, 4, 5].map(|line| first(job, line)), [2, 2, 4, 5]);
    // Axes without a word keep their position; the position of moved axes is lost.
    let unchanged_axes = "G0 X1\nG38.2 Y5 F50\nG0 Z5\nG0 Z6\nG0 X2\nG0 Y0\nG0 X3";
    assert_eq!(
        [3, 4, 5, 6, 7].map(|line| first(unchanged_axes, line)),
        [2, 2, 2, 2, 7]
    );
    let offset = "G0 X1\nG38.2 Z-5 F50\nG92 Z0\nG0 X0 Y0 Z5\nG0 X3";
    assert_eq!(first(offset, 5), 2);
}

#[test]
fn the_tool_and_the_offsets_of_the_line_are_put_into_effect() {
    let job = "T2 M6\nG43.1 Z-1.5\nG52 X4\nG0 X1 Y1 Z1\nG0 X2";
    let entry = entry_of(job, 5).unwrap();
    assert_eq!((entry.line, entry.tool), (4, 2));
    let offset = with_rotary("G52 X4 Y0 Z0");
    for line in ["M61 Q2", "G43.1 X0 Y0 Z-1.5", &offset] {
        assert!(
            entry.approach.iter().any(|sent| sent == line),
            "{:?}",
            entry.approach
        );
    }
}

#[test]
fn after_a_change_of_the_tool_the_spindle_is_off_unless_the_machine_ignores_it() {
    let job = "M3 S500\nG0 X1 Y1 Z1\nT2 M6\nG0 X2";
    assert!(entry_of(job, 4).unwrap().modes.contains(" M5 "));
    let settings = Settings {
        tool_change: TOOL_CHANGE_IGNORED,
        ..Settings::default()
    };
    let entry = entry_with(job, 4, true, &settings).unwrap();
    assert!(entry.modes.contains(" M3 "), "{}", entry.modes);
}

#[test]
fn an_origin_that_the_machine_does_not_have_is_reported() {
    let error = entry_of("G10 L2 P1 X5\nG0 X1\nG0 Y1", 3).map(|entry| entry.line);
    // Nothing but the line that sets it can begin.
    assert_eq!(error.unwrap(), 0);
}

/// The last word of a machine: where it stands, in steps.
fn ends_at(text: &str) -> Vec<i32> {
    struct Silent;
    impl Watcher for Silent {
        fn edge(&mut self, _: &Edge) {}
        fn answer(&mut self, line: u64, answer: &[u8]) {
            assert_eq!(answer, b"ok", "line {line}");
        }
        fn message(&mut self, _: &Simulator, _: u64, message: &[u8]) {
            assert!(!message.starts_with(b"ALARM"));
        }
    }
    let mut simulator = Box::new(Simulator::new(&Settings::default()));
    let mut stream =
        Stream::new(&mut *simulator, text.bytes(), UNLIMITED_BAUD).with_statements_at_rest();
    assert_eq!(stream.run(&mut Silent), StreamEnd::Complete);
    drop(stream);
    simulator.physical_steps().0.to_vec()
}

#[test]
fn wherever_a_job_is_continued_it_ends_at_the_same_steps() {
    let job = "G21 G90 G64 P0.05\nT1 M6\nM3 S500\nG0 Z3\nG1 X1.001 Y2.003 F300\nG20\nG1 X0.1 Y0.05 F20\n\
               G91\nX0.011\nY-0.007 Z-0.01\nG2 X0.02 Y0.02 I0.02 J0\nG21\nX0.3 Y0.3 I0 J0.3\nG90 G55\nG93\n\
               G1 X1 F30\nX2 F20\nG94 F250\nG52 X0.5 Y0.25\nX1 Y1 Z0\nG18 G3 X2 Z1 I0.5 K0.5\nG17 G99\n\
               G81 X3 Y1 Z-1 R1\nX4\nG80\nG0 Z4\nG61 M8\nG1 X0.337 Y0.771 Z0.1\nM9\nM5\nG0 Z2\n";
    let undisturbed = ends_at(job);
    let lines: Vec<_> = job.lines().collect();
    let mut begun = std::collections::BTreeSet::new();
    for line in 1..=lines.len() {
        let entry = entry_of(job, line).unwrap_or_else(|error| panic!("{line}: {error}"));
        assert!(entry.line < line);
        if begun.insert(entry.line) {
            // From a reset at another place.
            let text = [
                entry.approach.join("\n"),
                lines[entry.line..].join("\n"),
                String::new(),
            ]
            .join("\n");
            assert_eq!(
                ends_at(&text),
                undisturbed,
                "{} {:?}",
                entry.line + 1,
                entry.approach
            );
        }
    }
    assert!(begun.len() > 20, "{begun:?}");
}
