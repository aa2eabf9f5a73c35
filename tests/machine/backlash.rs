//! `$160`…: a table with play behind the motors, and what the machine says of where it is.

use leadscrew::{
    axis::{AXES, X, Y, Z},
    model::{Levels, State},
    settings::Settings,
    sim::{Closes, Edge},
};
use proptest::prelude::*;

use crate::support::{Machine, Trace, assigned, cases, check_limits};

/// Steps of a millimetre.
const STEPS: i32 = 250;
/// 0.2 mm of X, 0.1 mm of Y, 0.4 mm of Z. Y pulls off in the positive direction.
const PLAY: [i32; 3] = [50, 25, 100];
const LOOSE: [&str; 10] = [
    "160=0.2", "161=0.1", "162=0.4", "23=2", "110=6000", "111=6000", "112=6000", "120=500",
    "121=500", "122=500",
];

/// The table behind motors with play.
struct Table {
    axes: [i32; 3],
    motors: [i32; 3],
    edges: usize,
    /// How often each axis of the table has moved, and in which direction.
    steps: [Vec<i32>; 3],
}

impl Table {
    fn new() -> Self {
        Self {
            axes: [0; 3],
            motors: [0, PLAY[Y], 0],
            edges: 0,
            steps: Default::default(),
        }
    }

    /// Follows the motors. Returns whether the table stands although one of them has moved.
    fn follow(&mut self, edges: &[Edge]) -> bool {
        let mut is_slack = false;
        for edge in &edges[self.edges..] {
            for axis in (0..3).filter(|axis| edge.raise >> axis & 1 != 0) {
                let is_negative = edge.directions >> axis & 1 != 0;
                let motor = &mut self.motors[axis];
                *motor += if is_negative { -1 } else { 1 };
                let follows = self.axes[axis].clamp(*motor - PLAY[axis], *motor);
                is_slack = follows == self.axes[axis];
                if !is_slack {
                    self.steps[axis].push(follows - self.axes[axis]);
                }
                self.axes[axis] = follows;
            }
        }
        self.edges = edges.len();
        is_slack
    }
}

/// A machine with play.
struct Loose {
    settings: Settings,
    machine: Machine,
    table: Table,
}

impl Loose {
    fn new(assignments: &[&str]) -> Self {
        let mut table = Table::new();
        if assignments.contains(&"23=0") {
            table.motors = [0; 3];
        }
        let settings = assigned([&LOOSE, assignments].concat());
        Self {
            machine: Machine::with(&settings),
            settings,
            table,
        }
    }

    /// Where the table is, mm.
    fn table_mm(&mut self) -> [f64; 3] {
        self.table.follow(&self.machine.edges);
        self.table
            .axes
            .map(|steps| f64::from(steps) / f64::from(STEPS))
    }

    fn reported(&self) -> [i32; 3] {
        let steps = self.machine.snapshot().steps;
        [steps[X], steps[Y], steps[Z]]
    }

    /// Executes lines, and expects the table and the reports at a place, mm.
    fn goes(&mut self, lines: &str, mm: [f64; 3]) {
        let answers = self.machine.exchange(lines);
        assert!(
            !answers.contains("error") && !answers.contains("ALARM"),
            "{lines}: {answers}"
        );
        assert_eq!(self.table_mm(), mm, "{lines}");
        assert_eq!(self.reported(), self.table.axes, "{lines}");
    }

    /// No motor, of an axis that moves alone, is faster than it can be.
    fn check_limits(&self) {
        let trace = Trace::of(&self.settings, &self.machine.edges);
        trace.check_pulses();
        check_limits(&self.settings, &trace);
    }

    /// Runs into a slack move.
    fn run_into_slack(&mut self) {
        let mut steps = 0;
        while steps < 5 {
            assert!(self.machine.advance(), "no slack");
            steps += i32::from(self.table.follow(&self.machine.edges));
        }
    }

    /// Runs to rest; meanwhile reports differ from the table by what it moves in a segment at most.
    fn watch(&mut self, most: i32) {
        while self.machine.advance() {
            self.table.follow(&self.machine.edges);
            for (reported, axis) in self.reported().into_iter().zip(self.table.axes) {
                assert!((reported - axis).abs() <= most, "{reported} for {axis}");
            }
        }
        assert_eq!(self.reported(), self.table.axes);
    }
}

#[test]
fn reports_show_where_the_table_is_also_while_slack_is_taken_up() {
    let mut loose = Loose::new(&["110=600", "111=600", "112=600"]);
    loose
        .machine
        .send("G1 X1 Y-0.5 F60\nX0.5\nY0 Z-1\nZ0 X1\nX0\n");
    // A millimetre in a second is a step in 4 ms; the slack at 600 mm/min would be eight in a segment.
    loose.watch(1);
    assert_eq!(loose.table_mm(), [0.0, 0.0, 0.0]);
}

#[test]
fn a_feed_hold_in_a_slack_move_stays_where_the_table_is_and_goes_on() {
    let mut loose = Loose::new(&[]);
    loose.goes("G1 X5 F600\n", [5.0, 0.0, 0.0]);
    loose.machine.send("G1 X1 F600\n");
    loose.run_into_slack();
    loose.machine.send("!");
    loose.watch(3);
    assert_eq!(loose.machine.state(), State::HoldComplete);
    assert_eq!(loose.table_mm()[X], 5.0);
    assert!(!(0..=PLAY[X]).contains(&0) || loose.table.motors[X] > loose.table.axes[X]);
    loose.machine.send("~");
    loose.watch(15);
    assert_eq!(loose.table_mm()[X], 1.0);
    loose.check_limits();
}

#[test]
fn a_jog_cancelled_in_the_slack_leaves_the_table_and_the_next_moves_are_exact() {
    for next in [("$J=G90 X8 F3000\n", 8.0), ("$J=G90 X-8 F3000\n", -8.0)] {
        let mut loose = Loose::new(&["110=600"]);
        loose.goes("$J=X5 F3000\n", [5.0, 0.0, 0.0]);
        loose.machine.send("$J=X-5 F3000\n");
        loose.run_into_slack();
        assert_eq!(loose.machine.state(), State::Jog);
        loose.machine.send([0x85]);
        loose.goes("", [5.0, 0.0, 0.0]);
        let ahead = loose.table.motors[X] - loose.table.axes[X];
        assert!((1..PLAY[X]).contains(&ahead), "in the middle: {ahead}");
        loose.goes(next.0, [next.1, 0.0, 0.0]);
        loose.goes("G1 X3 Y1 F3000\nX4 Y0\n", [4.0, 0.0, 0.0]);
    }
}

#[test]
fn a_reset_in_the_slack_loses_no_step() {
    let mut loose = Loose::new(&["110=600"]);
    loose.goes("G1 X5 F600\n", [5.0, 0.0, 0.0]);
    loose.machine.send("G1 X1 F600\n");
    loose.run_into_slack();
    let received = loose.machine.exchange([0x18]);
    assert!(received.contains("ALARM:3"), "{received}");
    loose.goes("$X\n", [5.0, 0.0, 0.0]);
    loose.goes("G1 X2 F600\n", [2.0, 0.0, 0.0]);
    loose.goes("G1 X6 F600\n", [6.0, 0.0, 0.0]);
}

#[test]
fn homing_ends_a_pull_off_from_the_switch_and_knows_the_direction() {
    // Also a pull-off that is much shorter than the play.
    for (mask, pull_off) in (0..8_u8).flat_map(|mask| [(mask, STEPS), (mask, 3)]) {
        let settings = [
            format!("23={mask}"),
            format!("27={}", f64::from(pull_off) / f64::from(STEPS)),
        ];
        let mut loose = Loose::new(&["22=1", &settings[0], &settings[1], "25=2000", "24=100"]);
        let mut ends = [0; 3];
        let is_negative = |axis: usize| mask >> axis & 1 != 0;
        for axis in [X, Y, Z] {
            // The motor is ahead in the direction of the pull-off, where the table is reported to have come from.
            let lead = if is_negative(axis) { PLAY[axis] } else { 0 };
            loose.table.motors[axis] = lead;
            let (closes, contact) = if is_negative(axis) {
                (Closes::DownFrom(-1000), -1000 + lead)
            } else {
                (Closes::From(1000), 1000 - PLAY[axis])
            };
            loose.machine.mount(axis, closes, Levels::limits(1 << axis));
            ends[axis] = contact
                + if is_negative(axis) {
                    pull_off
                } else {
                    -pull_off
                };
        }
        assert_eq!(loose.machine.ask("$H"), ["ok"]);
        loose.table.follow(&loose.machine.edges);
        assert_eq!(loose.table.axes, ends, "{mask}");
        // From here on, coordinates are those of the homed machine.
        let home = loose.reported();
        let mut there = home;
        for steps in [-500, -250, 750, -125] {
            there = there.map(|axis| axis + steps);
            let [x, y, z] = there.map(|axis| f64::from(axis) / f64::from(STEPS));
            assert_eq!(loose.machine.ask(&format!("G53 G0 X{x} Y{y} Z{z}")), ["ok"]);
            loose.table.follow(&loose.machine.edges);
            for axis in [X, Y, Z] {
                let moved = loose.table.axes[axis] - ends[axis];
                assert_eq!(moved, there[axis] - home[axis], "{mask}, axis {axis}");
            }
            assert_eq!(loose.reported(), there);
        }
    }
}

#[test]
fn a_probing_move_reports_the_contact_without_slack() {
    let mut loose = Loose::new(&[]);
    loose.goes("G0 Z2\n", [0.0, 0.0, 2.0]);
    // The motor is where the table is on the way down.
    loose
        .machine
        .mount(Z, Closes::DownFrom(-1000), Levels::PROBE);
    let received = loose.machine.exchange("G38.2 Z-10 F300\n");
    assert!(
        received.contains("[PRB:0.000,0.000,-4.000") && received.contains(":1]"),
        "{received}"
    );
    assert_eq!(loose.reported(), {
        loose.table_mm();
        loose.table.axes
    });
    loose.goes("G0 Z1\nG0 X1\n", [1.0, 0.0, 1.0]);
    // A probing move that has slack before it and misses.
    loose.machine.set_pin(Levels::PROBE, false);
    loose.goes("G38.3 Z0.5 F300\n", [1.0, 0.0, 0.5]);
}

#[test]
fn z_comes_back_from_parking_to_where_it_was() {
    const PARKS: [&str; 7] = ["23=0", "22=1", "788=7", "41=1", "56=2", "57=600", "59=1200"];
    for (before, z) in [("G0 Z-20\n", -20.0), ("G0 Z-30\nG0 Z-20\n", -20.0)] {
        for into_slack in [false, true] {
            let mut loose = Loose::new(&PARKS);
            assert_eq!(loose.machine.ask("$H"), ["ok"]);
            loose.goes(before, [0.0, 0.0, z]);
            loose.machine.send("G1 Z-22 F300\nG1 Z-18 F300\n");
            if into_slack {
                loose.run_into_slack();
                // Of the second line, where the first one has none.
                if before.len() < 10 {
                    loose.table.follow(&loose.machine.edges);
                }
            } else {
                loose.machine.run(200);
            }
            let at_door = loose.machine.snapshot().steps[Z];
            loose.machine.set_pin(Levels::DOOR, true);
            // 1200 mm/min are eight steps in a segment.
            loose.watch(9);
            assert_eq!(loose.table_mm()[Z], -5.0, "parked");
            loose.machine.set_pin(Levels::DOOR, false);
            loose.machine.run(50);
            loose.machine.send("~");
            while loose.machine.state() != State::Run {
                assert!(loose.machine.advance());
            }
            loose.table.follow(&loose.machine.edges);
            assert!(
                (loose.table.axes[Z] - at_door).abs() <= 20,
                "back in the work"
            );
            loose.watch(9);
            assert_eq!(loose.table_mm()[Z], -18.0);
            loose.check_limits();
        }
    }
}

#[test]
fn a_door_that_opens_while_z_comes_back_parks_again() {
    let mut loose = Loose::new(&[
        "23=0", "22=1", "788=7", "41=1", "56=2", "57=600", "59=1200", "392=0", "393=0",
    ]);
    assert_eq!(loose.machine.ask("$H"), ["ok"]);
    loose.goes("G0 Z-30\nG0 Z-20\n", [0.0, 0.0, -20.0]);
    loose.machine.send("G1 X20 F300\n");
    loose.machine.run(300);
    for wait_ms in [10, 300, 700, 900, 950, 1000, 1050] {
        loose.machine.set_pin(Levels::DOOR, true);
        loose.watch(9);
        assert_eq!(loose.table_mm()[Z], -5.0);
        loose.machine.set_pin(Levels::DOOR, false);
        loose.machine.run(50);
        loose.machine.send_for("~", wait_ms);
    }
    loose.watch(9);
    assert_eq!(loose.table_mm(), [20.0, 0.0, -20.0]);
    loose.check_limits();
}

#[test]
fn a_program_that_is_checked_moves_no_motor() {
    let mut loose = Loose::new(&[]);
    loose.machine.ask("$C");
    loose.machine.ask("G1 X1 F100");
    loose.machine.ask("G2 X1 I2");
    loose.machine.ask("$C");
    assert_eq!(loose.machine.xyz(), [0; 3]);
    loose.goes("G0 X0.5\nX0\n", [0.0; 3]);
}

#[test]
fn a_laser_is_dark_while_slack_is_taken_up() {
    for spindle in ["M3", "M4"] {
        let mut loose = Loose::new(&["32=1"]);
        loose.machine.send(format!(
            "{spindle} S1000\nG1 X5 F1200\nX0\nX5\nG2 X5 I2\nG1 Y3\n"
        ));
        let (mut slack, mut lit) = (0, 0);
        while loose.machine.advance() {
            let edges = &loose.machine.edges;
            let Some(edge) = edges.get(loose.table.edges) else {
                continue;
            };
            let (duty, is_step) = (edge.duty, edge.raise != 0);
            if loose.table.follow(edges) {
                slack += 1;
                assert_eq!(duty, 0, "{spindle}");
            } else {
                lit += usize::from(is_step && duty > 0);
            }
        }
        assert!(slack > 4 * PLAY[X] - 10, "{slack}");
        assert!(lit > 3000, "{spindle}: {lit}");
    }
}

/// A program of most kinds of moves, after which the machine is where it was.
const PROGRAM: &str = "G0 X2 Y2 Z1
G1 Z-1 F1000
G41.1 D1
G1 X5 Y3 F2000
G1 X9
G3 X11 Y5 J2
G1 Y9
X5
Y5
G40
G1 X2 Y2
G2 X2 Y2 I3 J1 P3 Z-2
G93 G3 X4 Y4 I2 F20
G94 G18 G2 X6 Z-2 I1 F2000
G19 G3 Y5 Z-3 J1 F2000
G17
G99 G83 X3 Y3 Z-4 R0 Q1 F1500
X7 Y1
G73 X1 Y7 Z-4 R0 Q1
G80
G61.1 G1 X1 Y1 F3000
G3 X1 Y1 I-0.004 J0.002
G61
G3 X1 Y1 I0.01 J0.002
G91 G2 X0.02 Y-0.02 I0.02 Z0.001
X-0.02 Y0.02 R0.05
G90 G10 L2 P1 R30
G18 G2 X4 Z-2 R3
G17 G2 I1 J1
G10 L2 P1 R0
G28 X0 Y0
G0 X0 Y0 Z0
";

#[test]
fn the_table_of_a_long_program_makes_the_steps_of_a_machine_without_play() {
    let run = |assignments: &[&str], play: [i32; 3]| {
        let mut machine = Machine::with(&assigned(assignments));
        for line in PROGRAM.lines() {
            let answers = machine.ask(line);
            assert!(answers.contains(&"ok".to_owned()), "{line}: {answers:?}");
        }
        let waited = machine.edges.len();
        // And in one go, as fast as there is room.
        machine.send(PROGRAM);
        machine.run_to_standstill();
        assert!(!machine.received.contains("error"), "{}", machine.received);
        let mut table = Table::new();
        if play == [0; 3] {
            table.motors = [0; 3];
        }
        let edges = &machine.edges;
        if play == [0; 3] {
            let mut steps: [Vec<i32>; 3] = Default::default();
            for edge in edges {
                for axis in (0..3).filter(|axis| edge.raise >> axis & 1 != 0) {
                    steps[axis].push(if edge.directions >> axis & 1 != 0 {
                        -1
                    } else {
                        1
                    });
                }
            }
            return (steps, waited);
        }
        table.follow(edges);
        (table.steps, waited)
    };
    let (loose, _) = run(&LOOSE, PLAY);
    let (tight, _) = run(&LOOSE[3..], [0; 3]);
    for axis in [X, Y, Z] {
        assert_eq!(loose[axis].len(), tight[axis].len(), "axis {axis}");
        assert!(loose[axis] == tight[axis], "axis {axis}");
    }
}

#[test]
fn backlash_has_a_range_and_none_of_it_is_in_belts() {
    let mut machine = Machine::new(&[]);
    assert_eq!(machine.ask("$160=10"), ["ok"]);
    assert_eq!(machine.ask("$160=10.1"), ["error:52"]);
    assert_eq!(machine.ask("$160=-0.1"), ["error:4"]);
    assert_eq!(machine.ask(&format!("${}=1", 160 + AXES)), ["error:3"]);
    assert_eq!(machine.ask("$795=1"), ["error:52"], "with backlash of X");
    assert_eq!(machine.ask("$160=0"), ["ok"]);
    assert_eq!(machine.ask("$795=1"), ["ok"]);
    assert_eq!(machine.ask("$161=0.1"), ["error:52"]);
    assert_eq!(machine.ask("$162=0.1"), ["ok"], "Z has a screw of its own");
    assert_eq!(machine.ask("G0 X3 Z1"), ["ok"]);
    assert_eq!(machine.ask("G0 X5 Z0"), ["ok"]);
    let snapshot = machine.snapshot();
    assert_eq!((snapshot.steps[Z], machine.xyz()[Z]), (0, 0));
}

#[test]
fn a_change_of_the_backlash_moves_nothing_and_keeps_the_direction() {
    let mut loose = Loose::new(&[]);
    loose.goes("G0 X5\n", [5.0, 0.0, 0.0]);
    let edges = loose.machine.edges.len();
    loose.goes("$100=250\n$160=0.2\n$13=0\n", [5.0, 0.0, 0.0]);
    assert_eq!(loose.machine.edges.len(), edges);
    loose.goes("G0 X6\nG0 X4\n", [4.0, 0.0, 0.0]);
}

/// What happens to the machine.
fn acts() -> impl Strategy<Value = Vec<(String, u8, u64)>> {
    let act = (
        prop_oneof![
            (-2000_i32..2000, -2000_i32..2000, any::<bool>()).prop_map(|(x, z, is_jog)| {
                let head = if is_jog { "$J=G91 " } else { "G91 G1 " };
                format!(
                    "{head}X{} Z{} F3000\n",
                    f64::from(x) / 500.0,
                    f64::from(z) / 500.0
                )
            }),
            (1_i32..400, any::<bool>()).prop_map(|(r, is_clockwise)| {
                let g = if is_clockwise { 2 } else { 3 };
                format!("G91 G{g} I{} J0.3 Z-0.5 F3000\n", f64::from(r) / 100.0)
            }),
            Just(String::new()),
        ],
        prop::sample::select(b"   !~\x85\x18".to_vec()),
        0_u64..300,
    );
    prop::collection::vec(act, 1..25)
}

proptest! {
    #![proptest_config(cases(32))]

    #[test]
    fn whatever_stops_the_machine_it_knows_where_the_table_is(acts in acts()) {
        let mut loose = Loose::new(&["110=1200", "112=600"]);
        for (line, act, wait_ms) in acts {
            loose.machine.send(line);
            loose.machine.run(wait_ms);
            if act != b' ' {
                loose.machine.send([act]);
            }
            if act == 0x18 {
                loose.machine.run_to_standstill();
                loose.machine.ask("$X");
            }
            loose.machine.run(wait_ms / 2);
        }
        loose.machine.send("~");
        loose.machine.run_to_standstill();
        loose.table.follow(&loose.machine.edges);
        prop_assert_eq!(loose.reported(), loose.table.axes);
        // And goes on exactly.
        for line in ["G90 G53 G1 X3 Z-2 F3000", "G53 X-1 Z4", "G53 X0 Z-1"] {
            loose.machine.ask(line);
            loose.table.follow(&loose.machine.edges);
            prop_assert_eq!(loose.reported(), loose.table.axes);
        }
        prop_assert_eq!(loose.table_mm(), [0.0, loose.table_mm()[Y], -1.0]);
    }
}

#[test]
fn a_long_arc_is_answered_before_its_parts_are_done() {
    let mut loose = Loose::new(&[]);
    loose.machine.send_for("G2 I50 F200\n", 100);
    assert_eq!(loose.machine.lines(), ["ok"]);
}
