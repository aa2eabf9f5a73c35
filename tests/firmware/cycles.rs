//! Limit switches and the probe.

use leadscrew::model::Levels;

use crate::machine::{Machine, RESET};

/// Steps per mm of the machine.
const SCALE: i32 = 80;

/// The same, that homes X towards its negative and the others towards their positive ends.
fn boot_with_switches() -> Option<Machine> {
    let mut machine = Machine::boot_small()?;
    machine.memory.mount_low(0, -10 * SCALE);
    machine.memory.mount_high(1, 9 * SCALE);
    machine.memory.mount_high(2, 3 * SCALE);
    machine.set(&["$22=1", "$23=1", "$24=50", "$25=600", "$26=2", "$27=2"]);
    Some(machine)
}

#[test]
fn homing_ends_at_the_pull_off_from_every_switch() {
    let Some(mut machine) = boot_with_switches() else {
        return;
    };
    assert_eq!(machine.ask("$H"), ["ok"]);
    // Travel and pull-off.
    let status = machine.wait_for_idle();
    assert_eq!(status.xyz(), Some("-28.000,-2.000,-2.000"));
    // From each switch's edge, and what an axis goes on while the filter waits.
    let ends = [-8 * SCALE, 7 * SCALE, SCALE];
    for (is, should) in machine.memory.steps().iter().zip(ends) {
        assert!((is - should).abs() <= 2, "{is} {should}");
    }
    // The machine's coordinates are those of the pins from now on.
    let before = machine.memory.steps();
    assert_eq!(machine.ask("G53G0X-20"), ["ok"]);
    machine.wait_for_idle();
    assert_eq!(machine.memory.steps()[0] - before[0], 8 * SCALE);
}

#[test]
fn homing_fails_without_a_switch_and_when_the_door_opens() {
    let Some(mut machine) = Machine::boot_small() else {
        return;
    };
    machine.set(&["$22=1", "$24=50", "$25=2000", "$27=1"]);
    machine.send(b"$H\n");
    assert_eq!(machine.receive(), "ALARM:9");
    machine.wait_for_welcome();
    assert_eq!(machine.receive(), "[MSG:'$H'|'$X' to unlock]");
    machine.unlock();
    // Its search is then long enough to be met in its middle.
    machine.set(&["$25=200"]);
    machine.send(b"$H\n");
    let is_far = |steps| steps % (60 * SCALE) >= 100;
    machine.memory.wait_for_steps(2, is_far);
    machine.memory.close(Levels::DOOR);
    assert_eq!(machine.receive(), "ALARM:7");
}

#[test]
fn a_hard_limit_stops_dead_and_locks() {
    let Some(mut machine) = Machine::boot_small() else {
        return;
    };
    machine.set(&["$21=1"]);
    machine.memory.mount_high(0, 10 * SCALE);
    assert_eq!(machine.ask("G1X25F600"), ["ok"]);
    assert_eq!(machine.receive(), "ALARM:1");
    assert_eq!(machine.receive(), "[MSG:Reset to continue]");
    // 10 mm/s for the 1 ms of the filter.
    let stopped = machine.memory.steps();
    assert!(
        (10 * SCALE..10 * SCALE + 3).contains(&stopped[0]),
        "{stopped:?}"
    );
    assert_eq!(machine.status().state, "Alarm");
    machine.send(b"G1X0F600\n");
    machine.memory.mount_high(0, i32::MAX);
    machine.send(RESET);
    machine.wait_for_welcome();
    assert_eq!(machine.memory.steps(), stopped);
}

#[test]
fn a_probe_tells_the_very_step_of_its_contact() {
    let Some(mut machine) = Machine::boot_small() else {
        return;
    };
    machine.memory.put_plate(-5 * SCALE - 7);
    let touched = format!("[PRB:0.000,0.000,{:.3}:1]", -5.0 - 7.0 / f64::from(SCALE));
    assert_eq!(machine.ask("G38.2Z-10F300"), [touched.as_str(), "ok"]);
    let ended = machine.memory.steps()[2];
    assert!(ended <= -5 * SCALE - 7, "{ended}");
    // Away from it, and a second time from above.
    let answer = machine.ask("G38.4Z0F100");
    assert!(answer[0].ends_with(":1]"), "{answer:?}");
    assert_eq!(
        machine.ask("G38.3Z-1F300"),
        ["[PRB:0.000,0.000,-1.000:0]", "ok"]
    );
    assert_eq!(machine.ask("G38.2Z-2F300")[0], "ALARM:5");
}
