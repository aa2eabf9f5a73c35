//! One position: whatever ends or cancels a motion, everything that knows a position goes on from the same position.

use leadscrew::{
    axis::X,
    model::{Levels, State},
};
use proptest::prelude::*;

use crate::support::{Machine, assigned, cases, on_every_axis};

/// Steps/mm: of hardly any move is the end a whole step.
const STEPS_PER_MM: i32 = 80;

fn machine(own: &[&str]) -> Machine {
    let mut all = on_every_axis(&[(100, STEPS_PER_MM), (110, 6000), (120, 500)]);
    all.extend(own.iter().map(ToString::to_string));
    Machine::with(&assigned(all))
}

/// The path begins where the motion has ended, to the last binary place, and the programmed position is there as well,
/// but for what is no whole step.
fn assert_one_position(machine: &Machine, what: &str) {
    let session = machine.session();
    assert_eq!(session.path_end(), machine.exact_position(), "{what}");
    let interpreter = session.interpreter();
    if interpreter.is_compensating() || interpreter.is_off_path() {
        return;
    }
    let (programmed, counted) = (interpreter.position(), machine.snapshot().steps);
    for (axis, (nm, steps)) in programmed.iter().zip(&counted).enumerate() {
        let exact = nm.0 as f64 * 1.0e-6 * f64::from(STEPS_PER_MM);
        let is_there = (exact - f64::from(*steps)).abs() <= 0.501;
        assert!(
            is_there,
            "{what}: axis {axis} is programmed to {exact} and at {steps}"
        );
    }
}

/// Sends a line after which the machine may stand in an alarm, and unlocks it.
fn unlock_after(machine: &mut Machine, line: &str) {
    machine.send(format!("{line}\n"));
    machine.run_to_standstill();
    machine.lines();
    machine.ask("$X");
    assert_eq!(machine.state(), State::Idle, "{line}");
}

#[test]
fn half_steps_do_not_add_up_over_alarms_and_unlocking() {
    let probe_is_there = "G38.4Z-1";
    let probe_misses = "G38.2Z-.0187F500";
    for ended_by in [
        probe_is_there,
        probe_misses,
        "G41.1D1",
        "$RST=#",
        "$11=0.02",
    ] {
        let mut machine = machine(&[]);
        machine.ask("G91F500");
        for _ in 0..40 {
            machine.ask("G91G1X.0187F500");
            unlock_after(&mut machine, ended_by);
            assert_one_position(&machine, ended_by);
        }
        let x = machine.session().interpreter().position()[X].0;
        let steps = machine.physical_steps()[X];
        // 40 x 0.0187 mm: each is a step and a half, made by turns as one or two.
        let is_near = |nm: i64, expected: i64| (nm - expected).abs() <= 10_000;
        let expected = if ended_by.starts_with("$RST") {
            500_000
        } else {
            748_000
        };
        assert!(
            is_near(x, expected) && is_near(i64::from(steps) * 12_500, expected),
            "{ended_by}: {x} nm, {steps} steps"
        );
    }
}

#[test]
fn an_alarm_of_a_probing_move_after_g40_leaves_the_programmed_position_at_the_cutter() {
    let mut machine = machine(&[]);
    for line in [
        "G90F1200", "G41.1D3", "G1X5Y5", "X20", "G40", "G38.4Z-1", "$X",
    ] {
        let answers = machine.ask(line);
        let is_refused = answers.iter().any(|line| line.starts_with("error:"));
        assert!(!is_refused, "{line}: {answers:?}");
    }
    assert_one_position(&machine, "ALARM:4");
}

#[test]
fn check_mode_and_sleep_in_compensation_leave_the_path_at_the_end_of_the_motion() {
    for ends in ["$C", "$SLP"] {
        let mut machine = machine(&[]);
        for line in [
            "G90F1200",
            "G41.1D1.2345",
            "G1X5.0187Y5",
            "X20",
            "Y20",
            ends,
        ] {
            machine.send(format!("{line}\n"));
            machine.run_to_standstill();
        }
        assert_one_position(&machine, ends);
    }
}

/// What happens to a machine: a line, bytes in real time, a while, a contact of the probe.
#[derive(Debug, Clone)]
enum Event {
    Line(String),
    Byte(u8),
    Wait(u64),
    Probe(bool),
}

fn event() -> impl Strategy<Value = Event> {
    let move_of = |begin: &'static str| {
        (-3000_i32..3000, -3000_i32..3000)
            .prop_map(move |(x, y)| format!("{begin}X{}Y{}", mm(x), mm(y)))
    };
    let line = prop_oneof![
        4 => move_of("G91G1F1200"),
        2 => move_of("G90G0"),
        2 => move_of("$J=G91F2000"),
        1 => (200_i32..3000).prop_map(|r| format!("G91G2X{}I{}", mm(2 * r), mm(r))),
        1 => (-2000_i32..2000).prop_map(|z| format!("G91G38.3Z{}F800", mm(z))),
        1 => (-2000_i32..2000).prop_map(|z| format!("G91G38.2Z{}F800", mm(z))),
        1 => (-2000_i32..2000).prop_map(|z| format!("G91G38.4Z{}F800", mm(z))),
        6 => prop::sample::select(
            &[
                "$X", "G41.1D1.5", "G42.1D.7", "G40", "G64P.05", "G61", "G61.1", "$H", "$HX", "$11=0.02", "$11=0.01",
                "G10L2P1R15X.3333", "G10L2P1R0", "G92X.7777", "M2", "G4P.01", "$RST=#", "G28", "G28.1", "G81Z-1R.5",
                "G80", "$C", "$SLP",
            ][..]
        )
        .prop_map(str::to_owned),
    ];
    prop_oneof![
        10 => line.prop_map(Event::Line),
        4 => prop::sample::select(&[b'!', b'~', 0x18, 0x84, 0x85, b'~'][..]).prop_map(Event::Byte),
        4 => (1_u64..600).prop_map(Event::Wait),
        1 => any::<bool>().prop_map(Event::Probe),
    ]
}

/// Thousandths of a mm and a bit more, as text.
fn mm(thousandths: i32) -> String {
    format!("{:.5}", f64::from(thousandths) / 1000.0 + 0.00037)
}

fn happen(machine: &mut Machine, event: &Event) {
    match event {
        Event::Line(line) => {
            machine.send(format!("{line}\n"));
            machine.run(20);
        }
        Event::Byte(byte) => machine.send([*byte]),
        Event::Wait(ms) => machine.run(*ms),
        Event::Probe(is_closed) => machine.set_pin(Levels::PROBE, *is_closed),
    }
}

/// The operator has the machine reach standstill and take lines again.
fn reach_standstill(machine: &mut Machine) {
    for bytes in ["~", "~", "~", "$X\n", "\x18", "$X\n"] {
        machine.run(10_000);
        if machine.state() == State::Idle && machine.is_at_rest() {
            return;
        }
        machine.send(bytes);
    }
    machine.run(10_000);
}

proptest! {
    #![proptest_config(cases(1600))]

    #[test]
    fn all_go_on_from_one_position_whatever_has_ended_a_motion(
        homing in any::<bool>(),
        jerk in any::<bool>(),
        events in prop::collection::vec(event(), 1..60),
    ) {
        let own = match (homing, jerk) {
            (true, true) => &["22=1", "788=7", "800=9000", "801=9000"][..],
            (true, false) => &["22=1", "788=7"][..],
            (false, true) => &["800=9000", "801=9000"][..],
            (false, false) => &[][..],
        };
        let mut machine = machine(own);
        for events in events.chunks(6) {
            for event in events {
                happen(&mut machine, event);
            }
            reach_standstill(&mut machine);
            assert_one_position(&machine, &format!("{events:?}"));
        }
    }
}
