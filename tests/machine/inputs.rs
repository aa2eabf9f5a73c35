//! Switches, buttons and probe of the virtual machine, through the firmware's own filter.

use leadscrew::{
    axis::{AXES, Axes, X, Z},
    model::{Levels, State},
    settings::Settings,
    sim::{Closes, Switch},
    units::TICKS_PER_US,
};

use crate::support::{MS, Machine, fast};

/// The lines that come within some milliseconds of a line.
fn answers(machine: &mut Machine, line: &str, ms: u64) -> Vec<String> {
    machine.received.clear();
    machine.send_for(format!("{line}\n"), ms).lines()
}

/// Coordinates as they are written, with those of the other axes.
fn coordinates(xyz: &str) -> String {
    xyz.to_owned() + &",0.000".repeat(AXES - 3)
}

fn run_us(machine: &mut Machine, us: u64) {
    machine.run_ticks(us * u64::from(TICKS_PER_US));
}

/// A machine as recorded, with its switches.
fn homing_machine() -> Machine {
    let mut machine = Machine::with(&Settings {
        homing: 1,
        homing_seek_mm_min: 2000.0,
        homing_feed_mm_min: 200.0,
        ..fast()
    });
    machine.mount_limits([1600, 1200, 800]);
    machine
}

#[test]
fn homing_is_answered_when_it_is_over() {
    let mut machine = homing_machine();
    assert_eq!(answers(&mut machine, "$H", 1000), [""; 0]);
    assert_eq!(machine.report().state, "Home");
    machine.run(3500);
    assert_eq!(machine.take_received(), "ok\r\n");
    let idle = machine.report();
    assert_eq!(idle.state, "Idle");
    let home = coordinates("-1.000,-1.000,-1.000");
    assert_eq!(idle.field("MPos"), Some(&*home));
    assert_eq!(answers(&mut machine, "G0X-10", 1000), ["ok"]);
    assert_eq!(machine.xyz()[X], 1600 - 800);
}

#[test]
fn homing_that_fails_locks_the_machine() {
    let mut machine = Machine::with(&Settings {
        homing: 1,
        homing_seek_mm_min: 5000.0,
        max_travel_mm: Axes::all(50.0),
        ..fast()
    });
    let lines = answers(&mut machine, "$H", 3000);
    let lock = "[MSG:'$H'|'$X' to unlock]";
    let expected = ["ALARM:9", "ok", "", "Grbl 1.1h ['$' for help]", lock];
    assert_eq!(lines, expected);
    let alarm = machine.report();
    assert_eq!(alarm.state, "Alarm");
    let stopped = coordinates("0.000,0.000,75.000");
    assert_eq!(alarm.field("MPos"), Some(&*stopped));
}

#[test]
fn the_door_ends_homing() {
    let mut machine = homing_machine();
    machine.send_for("$H\n", 200);
    machine.received.clear();
    machine.send_for([0x84], 1000);
    let lines = machine.take_received();
    assert!(lines.starts_with("ALARM:7\r\nok\r\n\r\nGrbl"), "{lines}");
    assert_eq!(machine.state(), State::Alarm);
}

#[test]
fn homing_does_not_start_on_a_switch() {
    let mut machine = homing_machine();
    machine.set_pin(Levels::limits(1), true);
    machine.run(1);
    let lines = answers(&mut machine, "$H", 100);
    assert_eq!(lines, ["[MSG:Check Limits]", "error:203"]);
    assert_eq!(machine.state(), State::Alarm);
    assert_eq!(machine.physical_steps(), Axes::all(0));
}

#[test]
fn probing_is_answered_as_by_grbl() {
    let mut machine = Machine::with(&fast());
    machine.mount(Z, Closes::DownFrom(-400), Levels::PROBE);
    let lines = answers(&mut machine, "G38.2 Z-10 F600", 2000);
    assert_eq!(
        lines,
        [
            &format!("[PRB:{}:1]", coordinates("0.000,0.000,-5.000")),
            "ok"
        ]
    );
    // From where it rests, not from where it was to go.
    let stopped = machine.xyz()[Z];
    assert_eq!(answers(&mut machine, "G91G0Z1", 2000), ["ok"]);
    assert_eq!(machine.xyz()[Z], stopped + 80);
    let lines = answers(&mut machine, "G38.3 Z-1", 2000);
    assert_eq!(
        lines,
        [
            &format!("[PRB:{}:1]", coordinates("0.000,0.000,-5.000")),
            "ok"
        ]
    );
    let lines = answers(&mut machine, "G38.2 Z-1", 2000);
    assert_eq!(lines, ["ALARM:4", "ok"]);
}

#[test]
fn a_missed_probe_is_answered_as_by_grbl() {
    let mut machine = Machine::with(&fast());
    let lines = answers(&mut machine, "G38.3 Z-1 F600", 2000);
    assert_eq!(
        lines,
        [
            &format!("[PRB:{}:0]", coordinates("0.000,0.000,-1.000")),
            "ok"
        ]
    );
    let lines = answers(&mut machine, "G38.2 Z-3 F600", 2000);
    assert_eq!(
        lines,
        [
            "ALARM:5",
            &format!("[PRB:{}:0]", coordinates("0.000,0.000,-1.000")),
            "ok"
        ]
    );
    assert_eq!(answers(&mut machine, "G0Z0", 50), ["error:9"]);
}

#[test]
fn a_hard_limit_is_reported_and_waits_for_a_reset() {
    let mut machine = Machine::with(&Settings {
        hard_limits: true,
        ..fast()
    });
    assert_eq!(answers(&mut machine, "G1X50F1000", 200), ["ok"]);
    machine.set_pin(Levels::limits(1), true);
    machine.run(100);
    assert_eq!(machine.lines(), ["ALARM:1", "[MSG:Reset to continue]"]);
    let steps = machine.physical_steps();
    assert_eq!(machine.snapshot().steps, steps);
    assert_eq!(answers(&mut machine, "$X", 100), [""; 0]);
    machine.set_pin(Levels::limits(1), false);
    machine.run(1);
    machine.send_for([0x18], 100);
    machine.received.clear();
    assert_eq!(
        answers(&mut machine, "$X", 100),
        ["[MSG:Caution: Unlocked]", "ok"]
    );
    assert_eq!(answers(&mut machine, "G1X0F1000", 5000), ["ok"]);
    assert_eq!(machine.physical_steps(), Axes::all(0));
}

#[test]
fn a_contact_counts_after_the_filter() {
    let mut machine = Machine::with(&fast());
    machine.set_pin(Levels::PROBE | Levels::limits(1), true);
    run_us(&mut machine, 999);
    assert_eq!(machine.snapshot().inputs, Levels::NONE);
    run_us(&mut machine, 2);
    let both = Levels::PROBE | Levels::limits(1);
    assert_eq!(machine.snapshot().inputs, both);
    machine.set_pin(Levels::PROBE, false);
    run_us(&mut machine, 700);
    machine.set_pin(Levels::PROBE, true);
    machine.run(2);
    assert_eq!(machine.snapshot().inputs, both);
    machine.set_pin(both, false);
    run_us(&mut machine, 1001);
    assert_eq!(machine.snapshot().inputs, Levels::NONE);
    assert_eq!(machine.due(), None);
}

#[test]
fn inverted_inputs_are_active_while_open() {
    let mut machine = Machine::with(&Settings {
        limit_invert: true,
        ..fast()
    });
    machine.set_pin(Levels::limits(2), true);
    run_us(&mut machine, 1500);
    let others = Levels::limits((1 << AXES) - 1 - 2);
    assert_eq!(machine.snapshot().inputs, others);
}

#[test]
fn buttons_act_when_they_close() {
    let mut machine = Machine::with(&fast());
    machine.send_for("G1X10F1000\n", 100);
    machine.set_pin(Levels::HOLD, true);
    machine.run(200);
    assert_eq!(machine.state(), State::HoldComplete);
    machine.set_pin(Levels::START, true);
    machine.run(5);
    assert_eq!(machine.state(), State::Run);
    machine.set_pin(Levels::HOLD | Levels::START, false);
    machine.run(5);
    assert_eq!(machine.state(), State::Run);
    machine.received.clear();
    machine.set_pin(Levels::RESET, true);
    machine.run(100);
    let received = machine.take_received();
    assert!(
        received.starts_with("ALARM:3") && received.contains("Grbl 1.1h"),
        "{received}"
    );
    machine.set_pin(Levels::RESET, false);
    machine.run(100);
    assert_eq!(machine.take_received(), "");
}

#[test]
fn a_switch_closes_at_its_position() {
    for (closes, target) in [(Closes::From(40), "1"), (Closes::DownFrom(-40), "-1")] {
        let mut machine = Machine::with(&fast());
        let switch = Switch {
            axis: X,
            closes,
            input: Levels::limits(1),
        };
        machine.mount(switch.axis, switch.closes, switch.input);
        machine.send(format!("G1X{target}F600\n"));
        run_us(&mut machine, 1);
        while !machine.snapshot().inputs.has(Levels::limits(1)) {
            assert!(machine.now() < 200 * MS);
            assert!(machine.advance());
        }
        let steps = machine.xyz()[X];
        assert!(switch.is_closed_at(steps), "{steps}");
        assert!((40..45).contains(&steps.abs()), "{steps}");
        machine.send_for("G0X0\n", 500);
        assert_eq!(machine.snapshot().inputs, Levels::NONE);
        assert_eq!(machine.xyz()[X], 0);
    }
}
