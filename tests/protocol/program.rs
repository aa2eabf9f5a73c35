//! Lines of G-code: probing, laser, soft limits, alarms.

use grbl_client::Status;
use leadscrew::{
    axis::AXES,
    model::{Alarm, Laser, Notice, Outputs, Spindle, State},
    path::Work,
};

use super::{
    bench::{Bench, UNLOCK, WELCOME},
    machine::{execute, limited},
};
use crate::support::Machine;

#[test]
fn a_probing_move_is_answered_with_its_contact() {
    let mut bench = Bench::new();
    bench.probe_ends = Ok([0, 0, -1250]);
    let messages = ["[PRB:0.000,0.000,-5.000:1]", "ok"];
    assert_eq!(bench.ask("G38.2Z-10F600"), messages);
    assert_eq!(bench.session.interpreter().position()[2].0, -5_000_000);
    assert!(bench.ask("$#").contains(&messages[0].into()));
    // A miss that is an alarm reports the contact before it.
    bench.probe_ends = Err(None);
    let missed = ["ALARM:5", "[PRB:0.000,0.000,-5.000:0]", "ok"];
    assert_eq!(bench.ask("G38.4Z-8"), missed);
    assert_eq!(bench.session.interpreter().position()[2].0, -8_000_000);
    assert_eq!(bench.ask("G0Z0"), ["error:9"]);
    assert_eq!(bench.ask("$X")[1], "ok");
    let missed = ["[PRB:0.000,0.000,-9.000:0]", "ok"];
    assert_eq!(bench.ask("G38.3Z-9"), missed);
    assert_eq!(bench.answer("\x18"), WELCOME);
    assert!(
        bench
            .ask("$#")
            .contains(&"[PRB:0.000,0.000,0.000:0]".into())
    );
}

#[test]
fn a_probing_move_without_a_step_misses() {
    let mut bench = Bench::new();
    let missed = ["[PRB:0.000,0.000,0.000:0]", "ok"];
    assert_eq!(bench.ask("G38.3Z-0.0003F600"), missed);
    assert_eq!(bench.session.interpreter().position()[2].0, -300);
    let messages = bench.ask("G38.2Z-0.0005F600");
    assert_eq!(messages[0], "ALARM:5");
    assert_eq!(messages[messages.len() - 2..], missed);
}

#[test]
fn a_probe_in_the_wrong_state_is_an_alarm_before_the_move() {
    let mut bench = Bench::new();
    bench.probe_ends = Err(Some(Alarm::ProbeState));
    assert_eq!(bench.ask("G38.2Z-1F100"), ["ALARM:4", "ok"]);
    assert_eq!(bench.session.interpreter().position()[2].0, 0);
    assert_eq!(bench.ask("G0Z1"), ["error:9"]);
}

#[test]
fn a_path_out_of_the_travel_is_answered_by_a_reset() {
    let mut bench = Bench::set(&["22=1", "20=1"]);
    assert_eq!(bench.ask("G0X-10Y-10"), ["ok"]);
    bench.works();
    assert_eq!(bench.ask("$J=X1F100"), ["error:15"]);
    assert_eq!(bench.ask("$J=G91X-500F100"), ["error:15"]);
    for line in [
        "G0X0.001",
        "G1X-201F100",
        "G3X-12Y-10I-1J100F100",
        "G28X5",
        "G38.2Z1F10",
    ] {
        let messages = ["ALARM:2", "[MSG:Reset to continue]"];
        assert_eq!(bench.ask(line), messages, "{line}");
        assert!(bench.ask("$X").is_empty());
        assert_eq!(bench.report().state, "Alarm");
        assert_eq!(bench.answer("\x18"), ["ok", WELCOME[0], WELCOME[1], UNLOCK]);
        assert_eq!(bench.ask("$X")[1], "ok");
        assert!(matches!(
            bench.works()[..],
            [Work::Fault(Alarm::SoftLimit), Work::Unlock]
        ));
    }
    assert_eq!(bench.ask("$C")[1], "ok");
    assert_eq!(bench.ask("G0X1")[0], "ALARM:2");
}

#[test]
fn a_hard_limit_ends_everything_before_a_reset() {
    let mut bench = Bench::new();
    bench.withholds = true;
    assert_eq!(bench.ask("G1X5F600"), ["ok"]);
    bench.machine.state = State::Alarm;
    bench.machine.is_critical = true;
    bench.machine.notices.push(Notice::Alarm(Alarm::HardLimit));
    let messages = ["ALARM:1", "[MSG:Reset to continue]"];
    assert_eq!(bench.ask("G1X9"), messages);
    assert!(bench.ask("$X").is_empty());
    assert_eq!(bench.answer("\x18"), [WELCOME[0], WELCOME[1], UNLOCK]);
}

#[test]
fn a_line_that_a_reset_interrupts_is_answered_before_the_welcome() {
    for (line, messages) in [
        ("G4P10", &["ALARM:3", "ok"][..]),
        ("M30", &["ALARM:3", "[MSG:Pgm End]", "ok"]),
        ("G38.2Z-5F10", &["ALARM:3", "ok"]),
        ("G10L2P1X3", &["ALARM:3", "ok"]),
        ("", &["ALARM:3"]),
    ] {
        let mut bench = Bench::new();
        bench.withholds = true;
        assert_eq!(bench.ask("G1X5F600"), ["ok"]);
        bench.machine.state = State::Run;
        bench.machine.is_at_rest = false;
        let answer = bench.ask(line);
        assert_eq!(answer.len(), usize::from(line.is_empty()), "{line}");
        let lines = bench.answer("\x18");
        assert_eq!(lines[..messages.len()], *messages, "{line}");
        assert_eq!(lines[messages.len()..], [WELCOME[0], WELCOME[1], UNLOCK]);
    }
}

#[test]
fn a_program_end_ends_the_overrides() {
    let mut bench = Bench::new();
    bench.answer("\x18");
    let (mut line, _) = bench.received.split();
    leadscrew::protocol::realtime::receive(Ok(0x91), line.enqueued(), &bench.requests, &mut line);
    bench.answer("?");
    assert_eq!(bench.report().field("Ov"), Some("110,100,100"));
    assert_eq!(bench.ask("M30"), ["[MSG:Pgm End]", "ok"]);
    assert!(bench.report().field("WCO").is_some());
    assert_eq!(bench.report().field("Ov"), Some("100,100,100"));
    assert!(matches!(bench.works()[..], [.., Work::EndOverrides]));
}

/// Lines in laser mode: spindle commands, and the laser power of moves.
fn laser(lines: &[&str]) -> Vec<String> {
    let mut bench = Bench::set(&["32=1"]);
    let mut seen = Vec::new();
    for line in lines {
        assert_eq!(bench.ask(line), ["ok"], "{line}");
        for work in bench.works() {
            seen.push(match work {
                Work::Spindle(spindle, rpm) => format!("{spindle:?} {rpm}"),
                Work::Move(block) => match block.laser {
                    Laser::None => "move".to_owned(),
                    Laser::Constant(rpm) => format!("move {rpm}"),
                    Laser::Proportional(rpm) => format!("move ~{rpm}"),
                },
                other => format!("{other:?}"),
            });
        }
    }
    seen
}

#[test]
fn laser_power_goes_along_with_the_moves() {
    assert_eq!(
        laser(&["M3S500", "G1X1F100S800", "X2S300", "G0X3", "G1X4", "M5"]),
        [
            "Clockwise 0",
            "move 800",
            "move 300",
            "move 0",
            "move 300",
            "Off 0"
        ]
    );
    assert_eq!(
        laser(&["M4S500", "G1X1F100", "X2S300", "S200", "G0X3", "M3"]),
        [
            "CounterClockwise 0",
            "move ~500",
            "move ~300",
            "CounterClockwise 200",
            "move ~0",
            "Clockwise 0"
        ]
    );
}

#[test]
fn constant_laser_power_is_switched_at_standstill_where_no_move_carries_it() {
    assert_eq!(
        laser(&["M3S500", "G1F100", "G0", "G1", "S100", "G80", "G1"]),
        [
            "Clockwise 0",
            "Clockwise 500",
            "Clockwise 0",
            "Clockwise 500",
            "Clockwise 100",
            "Clockwise 0",
            "Clockwise 100"
        ]
    );
    // A move without a step carries no power.
    assert_eq!(
        laser(&["M3S500", "G1X0F100"]),
        ["Clockwise 0", "Clockwise 500"]
    );
}

#[test]
fn a_line_that_leaves_the_travel_tells_the_work_offset_that_it_has_changed() {
    let mut machine = limited();
    execute(&mut machine, "G10L2P2X6");
    let mut received = machine.answers_to("?");
    received.extend(machine.answers_to("G55G0X-5\n?"));
    received.extend(machine.answers_to("?"));
    assert!(received.contains(&"ALARM:2".to_owned()), "{received:?}");
    let mut status = Status::default();
    assert_eq!(received.iter().filter(|line| status.read(line)).count(), 3);
    let mut offset = [0.0; AXES];
    offset[0] = 6.0;
    assert_eq!(status.work_offset(), Some(&offset[..]), "{received:?}");
}

#[test]
fn another_laser_mode_switches_the_spindle_off() {
    let mut machine = limited();
    for (before, change, stays) in [
        ("M4S1000", "$32=0", true),
        ("M4S1000", "$32=1", false),
        ("M3S800", "$32=1", true),
        ("M3S800", "$32=0", false),
    ] {
        execute(&mut machine, before);
        execute(&mut machine, change);
        machine.run_to_standstill();
        let outputs = machine.outputs();
        let is_off = (outputs.spindle, outputs.duty) == (Spindle::Off, 0);
        // In laser mode `M3` is dark up to the first feed move.
        assert!(
            is_off != (stays && change == "$32=0"),
            "{before} {change}: {outputs:?}"
        );
        let modes = execute(&mut machine, "$G").join(" ");
        assert_eq!(!modes.contains(" M5 "), stays, "{before} {change}: {modes}");
    }
}

#[test]
fn restored_defaults_switch_everything_off_and_another_largest_speed_counts_at_once() {
    for laser in ["32=0", "32=1"] {
        for change in ["$RST=$", "$RST=*"] {
            for on in ["M3S800M8", "M4S800M8", "M3S800M8G1X.1F600"] {
                let mut machine = Machine::new(&[laser]);
                machine.ask(on);
                machine.send(format!("{change}\n"));
                machine.run_to_standstill();
                assert_eq!(
                    *machine.outputs(),
                    Outputs::default(),
                    "{laser} {on} {change}"
                );
                let modes = machine.ask("$G").join(" ");
                assert!(modes.contains(" M5 M9 "), "{laser} {on} {change}: {modes}");
            }
        }
    }
    // A laser in proportion to the speed stays dark at rest.
    for (laser, on, duties) in [
        ("32=0", "M4S800", [204, 102]),
        ("32=1", "M4S800G1X.1F600", [0, 0]),
        ("32=1", "M3S800G1X.1F600", [204, 102]),
    ] {
        let mut machine = Machine::new(&[laser]);
        machine.ask(on);
        machine.run_to_standstill();
        let before = machine.outputs().duty / 4;
        machine.ask("$30=2000");
        assert_eq!([before, machine.outputs().duty / 4], duties, "{laser} {on}");
    }
}

#[test]
fn an_alarm_of_a_probing_move_leaves_on_what_is_on_unless_777_is_set() {
    for (setting, stays, modes) in [("$777=0", true, " M3 M8 "), ("$777=1", false, " M5 M9 ")] {
        // The probe is in the wrong state, also of a move without a step; it makes no contact, nor in such a move.
        for line in [
            "G38.4Z-1F500",
            "G38.4Z-.0003F500",
            "G38.2Z-1F500",
            "G38.2Z-.0003F500",
        ] {
            let mut machine = Machine::new(&[]);
            machine.ask(setting);
            machine.ask("M3S800M8");
            let alarm = machine.ask(line).remove(0);
            assert!(matches!(&*alarm, "ALARM:4" | "ALARM:5"), "{line}: {alarm}");
            let are_on = |machine: &Machine| {
                let outputs = machine.outputs();
                let is_on = outputs.spindle == Spindle::Clockwise;
                assert_eq!((outputs.duty != 0, outputs.coolant.flood), (is_on, is_on));
                is_on
            };
            assert_eq!(are_on(&machine), stays, "{setting} {line}");
            machine.ask("$X");
            assert_eq!(are_on(&machine), stays, "{setting} {line}");
            let reported = machine.ask("$G").join(" ");
            assert!(reported.contains(modes), "{setting} {line}: {reported}");
            machine.ask("M3S800M8");
            assert!(are_on(&machine), "{setting} {line}");
        }
    }
}

#[test]
fn a_spindle_speed_is_switched_at_standstill_where_the_setting_wants_it() {
    let mut bench = Bench::set(&["776=1"]);
    assert_eq!(bench.answer("M3S500\nG1X1F100S800\n"), ["ok"; 2]);
    let done = bench.works();
    assert!(
        matches!(
            done[..],
            [
                Work::Spindle(Spindle::Clockwise, 500.0),
                Work::Spindle(Spindle::Clockwise, 800.0),
                Work::Move(_)
            ]
        ),
        "{done:?}"
    );
}

#[test]
fn a_spindle_speed_goes_along_with_the_moves() {
    let mut bench = Bench::new();
    let lines = "M3S500\nG1X1F100S800\nS600\nG0X2\nM4\nG0X3\n";
    assert_eq!(bench.answer(lines), ["ok"; 6]);
    let done = bench.works().into_iter().map(|work| match work {
        Work::Move(block) => format!("{:?}", block.laser),
        other => format!("{other:?}"),
    });
    let expected = [
        "Spindle(Clockwise, 500.0)",
        "Speed(800.0)",
        "Constant(800.0)",
        "Speed(600.0)",
        "Constant(600.0)",
        "Spindle(CounterClockwise, 600.0)",
        "None",
    ];
    assert_eq!(done.collect::<Vec<_>>(), expected);
}

#[test]
fn a_door_open_at_a_reset_is_reported_after_the_welcome_and_holds_the_startup_lines() {
    let mut bench = Bench::new();
    assert_eq!(bench.ask("$N0=G20"), ["ok"]);
    bench.receive(b"\x18");
    bench.machine.reset_count = bench.requests.reset_count();
    bench.machine.state = State::DoorAjar;
    bench.machine.notices.push(Notice::CheckDoor);
    let messages = [WELCOME[0], WELCOME[1], "[MSG:Check Door]"];
    assert_eq!(bench.serve(), messages);
    bench.machine.state = State::Idle;
    assert_eq!(bench.serve(), [">G20:ok"]);
}

#[test]
fn the_optional_stop_pauses_at_m1_while_it_is_on() {
    let mut bench = Bench::new();
    assert_eq!(bench.ask("M1"), ["ok"]);
    assert!(bench.done.is_empty());
    bench.receive(&[0x88]);
    assert_eq!(bench.ask("M1"), [""; 0]);
    assert_eq!(bench.machine.state, State::HoldComplete);
    assert_eq!(bench.answer("~"), ["ok"]);
    bench.receive(&[0x88]);
    assert_eq!(bench.ask("M1"), ["ok"]);
}
