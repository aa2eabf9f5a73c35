//! The time that a spindle takes to come up to speed: `$394`, and `$392` behind its stop in a hold and the door; and
//! its speed while the machine moves.

use leadscrew::{
    model::{Spindle, State},
    units::TICKS_PER_MS,
};

use crate::support::Machine;

const MS: u64 = TICKS_PER_MS as u64;
const FAST: [&str; 5] = ["110=5000", "112=5000", "120=500", "122=500", "1=255"];
const STOP: &[u8] = b"\x9e";
const DOOR: &[u8] = b"\x84";
const WAITS: &str = "[MSG:Waiting for spindle]";

fn machine(assignments: &[&str]) -> Machine {
    let all: Vec<&str> = FAST.iter().chain(assignments).copied().collect();
    let mut machine = Machine::new(&all);
    machine.send_for("G91F1000\n", 20);
    machine.take_received();
    machine
}

/// Returns the time up to the next step, in whole milliseconds.
fn wait_ms(machine: &mut Machine) -> u64 {
    let (start, xyz) = (machine.now(), machine.xyz());
    machine.run_until(|machine| machine.xyz() != xyz);
    (machine.now() - start) / MS
}

fn assert_waits(machine: &mut Machine, ms: u64, what: &str) {
    let waited = wait_ms(machine);
    assert!((ms..ms + 40).contains(&waited), "{what}: {waited} ms");
}

fn waits(machine: &Machine) -> usize {
    machine.received.matches(WAITS).count()
}

#[test]
fn a_resume_behind_a_spindle_stop_waits_for_the_spindle() {
    let mut machine = machine(&[]);
    machine.send_for("M3S800\nG1X20\n", 300);
    machine.send_for(b"!", 300);
    machine.send_for(STOP, 300);
    assert_eq!(machine.outputs().spindle, Spindle::Off);
    machine.send(b"~");
    assert_waits(&mut machine, 4000, "resume");
    assert_eq!(machine.outputs().spindle, Spindle::Clockwise);
    machine.run_to_standstill();
    assert_eq!(machine.xyz(), [5000, 0, 0]);
    assert_eq!(
        machine.received.matches("[MSG:Restoring spindle]").count(),
        1
    );
    assert_eq!(waits(&machine), 0);
}

#[test]
fn nothing_moves_before_a_spindle_that_was_switched_on_has_had_its_time() {
    for moves in [
        "G1X5",
        "G0X5",
        "G2X5I2.5",
        "$J=X5F500",
        "G38.3X5",
        "G4P.02\nG1X5",
    ] {
        let mut machine = machine(&["394=2"]);
        machine.send(format!("M3S500\n{moves}\n"));
        assert_waits(&mut machine, 2000, moves);
        assert_eq!(waits(&machine), 1, "{moves}");
        machine.run_to_standstill();
        assert!(!machine.received.contains("error"), "{}", machine.received);
    }
}

#[test]
fn a_spindle_that_turns_does_not_wait_again_and_one_that_is_reversed_does() {
    let mut machine = machine(&["394=2"]);
    machine.send_for("M3S500\nG1X1\n", 4000);
    for (line, ms) in [
        ("S700", 0),
        ("M3", 0),
        ("M4", 2000),
        ("M4S200", 0),
        ("M5\nM4", 2000),
        ("S0\nS200", 2000),
        // Nothing turns.
        ("M5", 0),
        ("M3S0", 0),
        ("S100", 2000),
    ] {
        machine.send(format!("{line}\nG1X1\n"));
        assert_waits(&mut machine, ms, line);
        machine.run_to_standstill();
    }
    assert_eq!(waits(&machine), 5);
}

#[test]
fn a_tap_leaves_its_hole_with_the_spindle_that_turns_back_and_the_next_hole_waits() {
    let mut machine = machine(&["394=2"]);
    machine.send_for("M3S500\nG1X1\n", 4000);
    machine.send("G84Z-2R0X1L2\n");
    machine.run_until(|machine| machine.outputs().spindle == Spindle::CounterClockwise);
    assert_waits(&mut machine, 0, "out of the hole");
    machine.run_until(|machine| machine.outputs().spindle == Spindle::Clockwise);
    assert_waits(&mut machine, 2000, "next hole");
}

#[test]
fn a_wait_for_the_spindle_can_be_held_and_reported_and_ends_with_the_spindle() {
    let mut machine = machine(&["394=2"]);
    machine.send_for("M3S500\nG1X1\n", 500);
    assert_eq!(machine.state(), State::Run);
    let report = machine.report();
    assert_eq!(
        machine.take_received().matches(WAITS).count(),
        1,
        "{report:?}"
    );
    machine.send_for(b"!", 3000);
    assert_eq!(machine.state(), State::HoldComplete);
    assert_eq!(machine.xyz()[0], 0);
    machine.send(b"~");
    // The time has gone by in the hold.
    assert_waits(&mut machine, 0, "resume");
    machine.run_to_standstill();
    machine.send("M5\nM3\nM5\nG1X1\n");
    assert_waits(&mut machine, 0, "off");
    machine.run_to_standstill();
    // A reset ends the wait, and what waits.
    machine.send_for("M3\nG1X1\n", 500);
    machine.send_for(b"\x18", 100);
    machine.send("$X\nG91F1000G1X1\n");
    assert_waits(&mut machine, 0, "reset");
}

#[test]
fn a_spindle_switched_on_again_in_a_hold_has_its_time_from_then_on() {
    let mut machine = machine(&["392=3"]);
    machine.send_for("M3S500\nG1X20\n", 300);
    machine.send_for(b"!", 300);
    machine.send_for(STOP, 300);
    machine.send_for(STOP, 1000);
    machine.send(b"~");
    assert_waits(&mut machine, 2000, "resume");
}

#[test]
fn the_longer_delay_counts_behind_the_door_and_a_stop() {
    for (settings, ms) in [
        (["392=1", "394=3"], 3000),
        (["392=3", "394=1"], 3000),
        (["392=0", "394=0"], 0),
    ] {
        let mut stopped = machine(&settings);
        stopped.send_for("M3S500\nG1X100\n", 3500);
        stopped.send_for(b"!", 300);
        stopped.send_for(STOP, 100);
        stopped.send(b"~");
        assert_waits(&mut stopped, ms, "stop");
        let mut door = machine(&settings);
        door.send_for("M3S500\nG1X100\n", 3500);
        door.send_for(DOOR, 300);
        assert_eq!(door.state(), State::DoorClosed);
        door.send(b"~");
        assert_waits(&mut door, ms, "door");
    }
}

#[test]
fn a_door_in_the_wait_for_the_spindle_begins_anew() {
    let mut machine = machine(&["394=2", "392=3", "393=0.5"]);
    machine.send_for("M8\nM3S500\nG1X1\n", 1500);
    machine.send_for(DOOR, 300);
    assert_eq!((machine.state(), machine.xyz()[0]), (State::DoorClosed, 0));
    assert_eq!(machine.outputs().spindle, Spindle::Off);
    machine.send(b"~");
    assert_waits(&mut machine, 3500, "door");
}

#[test]
fn z_is_parked_while_the_spindle_comes_up_to_speed() {
    let mut machine = machine(&["394=20", "41=1", "22=1", "788=7"]);
    machine.send_for("$H\n", 500);
    machine.send_for("G91G0Z-20\n", 2000);
    machine.send_for("M3S500\nG1X1\n", 500);
    machine.send_for(DOOR, 8000);
    assert_eq!(machine.outputs().spindle, Spindle::Off);
    assert_eq!(machine.xyz(), [0, 0, -5 * 250]);
}

#[test]
fn a_laser_and_a_program_that_is_checked_wait_for_nothing() {
    let mut laser = machine(&["394=5", "32=1"]);
    laser.send("M3S500\nG1X1\n");
    assert_waits(&mut laser, 0, "laser");
    let mut check = machine(&["394=5"]);
    check.send_for("$C\nM3S500\nG91F100\nG1X1\n", 100);
    assert_eq!(
        check.answers().iter().filter(|line| *line == "ok").count(),
        4
    );
    assert_eq!(waits(&check), 0);
}

#[test]
fn drivers_have_their_time_after_the_spindle_has_had_its_own() {
    let mut machine = machine(&["394=1", "786=500", "1=25", "22=1", "788=7"]);
    machine.send_for("$X\nG91F1000\n", 100);
    machine.send("M3S500\nG1X1\n");
    assert_waits(&mut machine, 1500, "move");
}

/// Returns how often a machine says that the speed is 0, over some lines; all of them are right.
fn reports_of_no_speed(assignments: &[&str], lines: &str) -> usize {
    let mut machine = machine(assignments);
    let count = lines.lines().count();
    machine.send_for(format!("{lines}\n"), 3000);
    let answers = machine.answers();
    assert_eq!(
        answers.iter().filter(|line| *line == "ok").count(),
        count,
        "{answers:?}"
    );
    let text = "[MSG:Spindle speed is 0]";
    answers.iter().filter(|line| *line == text).count()
}

#[test]
fn a_feed_move_with_a_spindle_that_does_not_turn_is_reported_once_in_a_program() {
    for lines in [
        "M3\nG1X1\nX1\nG0X1\nG1X1",
        "M4\nG0X1\nG2X1I.5\nX1I.5",
        "M3G1X1",
        "M3\nG81X1Z-1R0",
        "M3\nG64P.1\nG1X1\nY1",
        "M3\nG1X1\nM5\nM3\nG1X1",
        "$C\nM3\nG1F100X1\nX1",
    ] {
        assert_eq!(reports_of_no_speed(&[], lines), 1, "{lines}");
        assert_eq!(reports_of_no_speed(&["775=1"], lines), 0, "{lines}");
        assert_eq!(reports_of_no_speed(&["32=1"], lines), 0, "{lines}");
    }
    for lines in [
        "G1X1",
        "M3\nG0X1",
        "M3\n$J=X1F100",
        "M3S100\nG1X1",
        "M3S0\nG1X1",
        "M3\nS0\nG1X1",
        "M3\nG1X1S5\nG1X1",
        "M3\nG38.3X1",
        // The speed of the program before.
        "S100\nM2\nM3\nG91F100G1X1",
    ] {
        assert_eq!(reports_of_no_speed(&[], lines), 0, "{lines}");
    }
    let twice = "M3\nG1X1\nM2\nG91F100G1X1\nM3\nX1\nX1";
    assert_eq!(reports_of_no_speed(&[], twice), 2);
}

#[test]
fn a_spindle_on_a_relay_has_its_time_without_a_speed() {
    let mut machine = machine(&["394=2", "775=1"]);
    machine.send("M3\nG1X1\n");
    assert_waits(&mut machine, 2000, "on");
    machine.run_to_standstill();
    machine.send("S100\nG1X1\n");
    assert_waits(&mut machine, 0, "another speed");
}

/// Sends lines to a machine at 0 whose spindle is at full speed. Returns where along X the duty is another one, in steps,
/// and the duty in steps of Grbl's PWM; and the time, s.
fn run(assignments: &[&str], lines: &str) -> (Vec<(i32, u16)>, f64) {
    let mut machine = machine(assignments);
    machine.send_for("M3S1000\n", 20);
    let start = machine.seconds();
    machine.send(format!("{lines}\n"));
    machine.run_to_standstill();
    let seconds = machine.seconds() - start;
    assert!(!machine.received.contains("error"), "{}", machine.received);
    let (mut x, mut duty) = (0, 0);
    let mut duties = Vec::new();
    for edge in machine.edges.iter().filter(|edge| edge.raise & 1 != 0) {
        if edge.duty != duty {
            duty = edge.duty;
            duties.push((x, duty / 4));
        }
        x += 1 - 2 * i32::from(edge.directions & 1);
    }
    (duties, seconds)
}

#[test]
fn a_speed_in_each_line_stops_no_motion_and_changes_where_its_line_begins() {
    let plain = run(&[], "G1X1\nX1\nX1\nX1").1;
    let changes = [(0, 128), (250, 204), (500, 51), (750, 255)];
    for lines in [
        "G1X1S500\nX1S800\nX1S200\nX1S1000",
        // A line of its own.
        "S500\nG1X1\nS800\nX1\nS200\nX1\nS1000\nX1",
        // The last one counts, and G0 changes nothing.
        "S500\nG1X1\nS100\nS800\nX1\nX1M3S200\nS1000X1",
    ] {
        let (duties, seconds) = run(&[], lines);
        assert_eq!(duties, changes, "{lines}");
        assert!(
            (seconds - plain).abs() < 0.002,
            "{lines}: {seconds} s, {plain} s"
        );
    }
    let lines = "G1X1S500\nX1S800\nX1S200\nX1S1000";
    let (duties, seconds) = run(&["776=1"], lines);
    assert_eq!(duties, changes);
    assert!(seconds > plain + 0.09, "{seconds} s, {plain} s");
}

/// Returns the speed in the next status report, rpm.
fn shown_rpm(machine: &mut Machine) -> String {
    let report = machine.report();
    let speeds = report.field("FS").unwrap_or_default().to_owned();
    speeds.rsplit(',').next().unwrap_or_default().to_owned()
}

#[test]
fn a_speed_that_no_move_brings_comes_at_rest_before_all_that_follows() {
    let mut machine = machine(&[]);
    machine.send_for("M3S1000\n", 20);
    machine.send_for("S500\n", 5);
    assert_eq!(
        (shown_rpm(&mut machine), machine.outputs().duty / 4),
        ("500".to_owned(), 128)
    );
    // Nothing follows; the line is answered in motion.
    machine.take_received();
    machine.send_for("G1X1\nS800\n", 40);
    assert_eq!(
        (machine.take_received().as_str(), machine.state()),
        ("ok\r\nok\r\n", State::Run)
    );
    assert_eq!(shown_rpm(&mut machine), "500");
    machine.run_to_standstill();
    assert_eq!(
        (shown_rpm(&mut machine), machine.outputs().duty / 4),
        ("800".to_owned(), 204)
    );
    for (number, next) in ["G4P1", "M0", "M8", "G1X.0001", "G4P1\nS1"]
        .into_iter()
        .enumerate()
    {
        let rpm = 100 * (number + 1);
        machine.send_for(format!("G1X1\nS{rpm}\n{next}\n"), 700);
        assert_eq!(shown_rpm(&mut machine), rpm.to_string(), "{next}");
        machine.send_for(b"~", 1500);
        machine.run_to_standstill();
    }
    assert_eq!(shown_rpm(&mut machine), "1");
}

#[test]
fn the_speed_of_the_move_in_execution_comes_back_after_a_hold_a_stop_and_the_door() {
    for bytes in [&b"!"[..], b"!\x9e", b"\x84"] {
        let mut machine = machine(&["392=0.5"]);
        machine.send_for("M3S1000\nG1X5S500\nS800\nX5\nS300\n", 150);
        for &byte in bytes {
            machine.send_for([byte], 300);
        }
        assert!(machine.xyz()[0] < 1250);
        let is_on = bytes == b"!";
        assert_eq!(shown_rpm(&mut machine), if is_on { "500" } else { "0" });
        machine.send_for(b"~", if is_on { 50 } else { 550 });
        assert_eq!(shown_rpm(&mut machine), "500", "{bytes:?}");
        // Half of the way.
        machine.run_until(|machine| machine.xyz()[0] > 1300);
        assert_eq!(shown_rpm(&mut machine), "800", "{bytes:?}");
        machine.send_for(b"\x9a", 20);
        assert_eq!(shown_rpm(&mut machine), "880", "{bytes:?}");
        machine.run_to_standstill();
        assert_eq!(machine.xyz()[0], 2500);
        assert_eq!(shown_rpm(&mut machine), "330", "{bytes:?}");
        assert_eq!(machine.outputs().duty / 4, 84);
    }
}

#[test]
fn speeds_keep_their_place_in_blended_and_compensated_paths() {
    let (duties, _) = run(&[], "G64P.1\nG1X1S500\nX1\nS800\nX1\nX1S500\nX1");
    assert_eq!(duties, [(0, 128), (500, 204), (750, 128)]);
    let (duties, _) = run(&[], "G41.1D0\nG1X1Y1S500\nX1\nS800\nX1\nG40");
    assert_eq!(duties, [(0, 128), (500, 204)]);
}

#[test]
fn another_speed_wants_no_time_and_a_reset_forgets_it() {
    let mut machine = machine(&["394=2"]);
    machine.send_for("M3S1000\nG1X1\n", 3000);
    machine.send("S500\nG1X1\n");
    assert_waits(&mut machine, 0, "speed");
    machine.run_to_standstill();
    machine.send_for("!S300\n", 100);
    machine.send_for(b"\x18", 100);
    machine.send_for("M3S700\n", 100);
    assert_eq!(shown_rpm(&mut machine), "700");
    machine.send_for("G91F1000G1X1\n", 3000);
    assert_eq!(shown_rpm(&mut machine), "700");
}

#[test]
fn delays_have_grblhals_range() {
    let mut machine = machine(&[]);
    for number in [392, 393, 394] {
        for (value, answer) in [
            ("0", "ok"),
            ("0.5", "ok"),
            ("20", "ok"),
            ("0.4", "error:"),
            ("21", "error:"),
        ] {
            let answers = machine.ask(&format!("${number}={value}"));
            assert!(
                answers[0].starts_with(answer),
                "{number} {value} {answers:?}"
            );
        }
    }
}
