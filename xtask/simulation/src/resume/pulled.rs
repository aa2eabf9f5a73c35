//! Jobs whose cable is pulled out at many moments, and what has been cut when they are continued.

use std::fmt::Write as _;

use super::{
    tests::{DESCENT, lines},
    *,
};
use crate::{
    forecast::Forecast,
    machine_answers::{MachineAnswers, UNLIMITED_BAUD},
    playing,
};
use leadscrew::{
    settings::assign,
    sim::{Edge, Simulator, Stream, StreamEnd, Watcher},
};

#[path = "../../../send/tests/support/machined.rs"]
mod machined;

use machined::MachinedPath;

/// Two tools, the second of which goes deeper within the contour of the first one, drills, and is compensated.
/// Behind a dwell it is known that everything before has been done.
const JOB: &str = "\
G21 G90 G54
G10 L2 P1 X1.2 Y2.4 Z-0.3
T1 M6
M3 S1000
G0 Z2
G0 X1 Y1
G1 Z-1 F600
G4 P0.01
G1 X7 F900
G4 P0.01
Y4
G2 X4 Y7 I-3 J0
G4 P0.01
G1 X1
Y1
G0 Z2
T2 M6
M3 S1000
G0 X2 Y2
G1 Z-2 F600
G4 P0.01
X4 F900
G4 P0.01
Y3
G4 P0.01
X2
Y2
G0 Z2
G81 X3 Y4 Z-1.5 R1
G4 P0.01
X3.5 Y4.5
G80
G4 P0.01
G0 X1.5 Y5
G1 Z-1 F600
G41.1 D0.4 X2 F900
X4
G4 P0.01
Y6
X2
G40 X1.5 Y5
G4 P0.01
G0 Z2
M5
G0 X0 Y0
M2
";
/// The origin of its Z, in steps.
const SURFACE: i32 = -24;
/// Moments at which the cable is pulled out.
const MOMENTS: u32 = 60;
/// Changes of the machine, of which some are steps, that it goes on without its cable before it is held.
const HOLD_DELAYS: [u32; 3] = [0, 700, 4000];

fn settings() -> Settings {
    let mut settings = Settings::default();
    for axis in 0..3 {
        for (number, value) in [(100, 80), (110, 5000), (120, 500)] {
            assign(
                &mut settings,
                format!("{}={value}", number + axis).as_bytes(),
            )
            .unwrap();
        }
    }
    settings
}

/// Where the steps lead, and what is answered.
struct ToolPath {
    places: Vec<[i32; 3]>,
    answered: usize,
    changes: u32,
}

impl ToolPath {
    fn new() -> Self {
        Self {
            places: vec![[0; 3]],
            answered: 0,
            changes: 0,
        }
    }

    /// Lets the machine go on alone for so many changes, or until it is at rest.
    fn go_on(&mut self, simulator: &mut Simulator, changes: u32) {
        for _ in 0..changes {
            let Some(due) = simulator.due() else {
                return;
            };
            simulator.advance(due);
            self.change(simulator);
        }
    }
}

impl Watcher for ToolPath {
    fn edge(&mut self, _: &Edge) {}

    fn change(&mut self, simulator: &Simulator) {
        self.changes += 1;
        let steps = simulator.physical_steps();
        let place = [steps[0], steps[1], steps[2]];
        if self.places.last() != Some(&place) {
            self.places.push(place);
        }
    }

    fn answer(&mut self, line: u64, answer: &[u8]) {
        assert_eq!(answer, b"ok", "line {line}");
        self.answered += 1;
    }

    fn message(&mut self, _: &Simulator, _: u64, message: &[u8]) {
        assert!(!message.starts_with(b"ALARM"));
    }
}

/// Streams a program for at most so many changes of the machine.
fn stream(
    simulator: &mut Simulator,
    text: &str,
    tool_path: &mut ToolPath,
    changes: u32,
) -> Option<StreamEnd> {
    let mut stream = Stream::new(simulator, text.bytes(), UNLIMITED_BAUD).with_statements_at_rest();
    stream.pump(tool_path, changes)
}

#[test]
fn whenever_the_cable_is_pulled_out_a_continued_job_removes_the_same_material() {
    let settings = settings();
    let mut simulator = Box::new(Simulator::new(&settings));
    let answers = MachineAnswers {
        settings: playing::ask(&mut simulator, b"$+\n"),
        position: vec![0.0; AXES],
        ..MachineAnswers::default()
    };
    let job = lines(JOB);
    let Forecast { times, .. } = Forecast::of(&answers, &job, UNLIMITED_BAUD, |_| Ok(())).unwrap();
    let beginning = Beginning {
        interpreter: simulator.session().interpreter().clone(),
        is_placed: true,
    };
    let mut tool_path = ToolPath::new();
    let end = stream(&mut simulator, JOB, &mut tool_path, u32::MAX);
    assert_eq!(end, Some(StreamEnd::Complete));
    let undisturbed = MachinedPath::of(&tool_path.places, SURFACE);
    let last = tool_path.places.last().copied();
    assert!(undisturbed.len() > 1000, "{}", undisturbed.len());

    let (mut begun, mut held_below) = (std::collections::BTreeSet::new(), 0);
    for (moment, coast) in (0..MOMENTS).zip(HOLD_DELAYS.into_iter().cycle()) {
        let mut simulator = Box::new(Simulator::new(&settings));
        let mut done = ToolPath::new();
        let pulled = u64::from(tool_path.changes) * u64::from(moment) / u64::from(MOMENTS);
        stream(&mut simulator, JOB, &mut done, pulled as u32);
        done.go_on(&mut simulator, coast);
        playing::ask(&mut simulator, b"!");
        done.go_on(&mut simulator, u32::MAX);
        playing::ask(&mut simulator, b"\x18");
        let held = done.places.last().copied().unwrap();
        held_below += u32::from(held[2] < SURFACE);

        // Some answers were on the line.
        let undone = times.first_undone(done.answered.saturating_sub(moment as usize % 2));
        let wanted = undone.min(job.len() - 1);
        let now = simulator.session().interpreter().clone();
        let mut beginning = Beginning {
            interpreter: beginning.interpreter.clone(),
            is_placed: beginning.is_placed,
        };
        beginning.interpreter.set_origins(&now.offsets().origins);
        let entry = entry(&job, wanted, &beginning, &now, &settings, DESCENT);
        let entry = entry.unwrap_or_else(|error| panic!("held at {held:?}: {error}"));
        begun.insert(entry.line);
        let mut text = entry.approach.join("\n") + "\n";
        for line in JOB.lines().skip(entry.line) {
            writeln!(text, "{line}").unwrap();
        }
        let end = stream(&mut simulator, &text, &mut done, u32::MAX);
        assert_eq!(end, Some(StreamEnd::Complete), "held at {held:?}");

        let machined = MachinedPath::of(&done.places, SURFACE);
        let (missing, beyond) = (undisturbed.beyond(&machined), machined.beyond(&undisturbed));
        assert!(
            missing.is_empty() && beyond.is_empty() && done.places.last().copied() == last,
            "held at {held:?}, continued at line {} with {:?}: {missing:?} were not cut, {beyond:?} should not be",
            entry.line + 1,
            entry.approach
        );
    }
    assert!(begun.len() > 10, "{begun:?}");
    assert!(held_below > MOMENTS / 3, "{held_below}");
}
