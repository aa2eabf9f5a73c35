//! `?` is answered within 5 ms, whatever the machine does.

use grbl_client::Report;
use leadscrew::{
    axis::{AXES, X},
    model::{Levels, State},
};

use crate::support::{Machine, fields_after_speeds};

/// A machine behind a serial line of 115 200 baud.
fn on_line(assignments: &[&str]) -> Machine {
    let mut machine = Machine::new(assignments);
    machine.set_baud(115_200);
    machine
}

/// A report, and how long its first byte took, ms: everything sent before it has left the machine.
fn report(machine: &mut Machine) -> (Report, f64) {
    while machine.has_to_send() {
        machine.run(1);
    }
    machine.run(1);
    machine.timed_report()
}

/// Sends bytes, and returns what the report after them shows behind the speeds.
fn extra_after(machine: &mut Machine, bytes: &[u8]) -> String {
    machine.send_for(bytes, 150);
    fields_after_speeds(&report(machine).0)
}

/// Takes several reports, at odd times, while the machine is in a state.
fn assert_reports(machine: &mut Machine, state: &str) {
    for pause_ms in [0, 1, 3, 7, 2] {
        let (report, latency_ms) = report(machine);
        assert_eq!(report.state, state);
        assert!(latency_ms <= 5.0, "{state}: {latency_ms} ms");
        machine.run(pause_ms);
    }
}

#[test]
fn a_report_comes_within_5_ms_in_every_state_of_a_program() {
    let mut machine = on_line(&["110=6000", "120=100", "797=0"]);
    assert_reports(&mut machine, "Idle");
    // More moves than the look-ahead and the queues hold, and bytes behind them.
    let lines = (1..=160).map(|k| format!("G1X{k}F600\n"));
    let lines = lines.collect::<Vec<_>>().concat();
    let many = lines.len();
    for (sent, byte) in lines.bytes().enumerate() {
        if machine.received_free() < 2 {
            assert!(sent < many, "the look-ahead is never full");
            break;
        }
        machine.send([byte]);
    }
    assert_eq!(machine.snapshot().blocks_free, 0);
    assert_reports(&mut machine, "Run");
    for (bytes, ms, state) in [
        (&b"!"[..], 1500, "Hold:0"),
        (b"\x84", 500, "Door:0"),
        (b"\x18", 200, "Idle"),
        (b"G4P2\n", 100, "Idle"),
    ] {
        machine.send_for(bytes, ms);
        assert_reports(&mut machine, state);
    }
    machine.run(2000);
    machine.send_for(b"M0\n", 100);
    assert_reports(&mut machine, "Hold:0");
    machine.send_for(b"~", 100);
    machine.send_for(b"$J=G91X-50F300\n", 300);
    assert_reports(&mut machine, "Jog");
    machine.send_for(b"\x18", 500);
    assert_reports(&mut machine, "Alarm");
}

#[test]
fn a_report_comes_within_5_ms_while_homing_checking_and_asleep() {
    let mut machine = on_line(&["22=1"]);
    machine.mount_limits([2000; 3]);
    assert_reports(&mut machine, "Alarm");
    machine.send_for(b"$H\n", 50);
    while machine.state() == State::Home {
        let (report, latency_ms) = report(&mut machine);
        if machine.state() == State::Home {
            assert_eq!(report.state, "Home");
        }
        assert!(latency_ms <= 5.0, "{latency_ms} ms");
        machine.run(97);
    }
    assert_reports(&mut machine, "Idle");
    machine.send_for(b"$C\n", 50);
    assert_reports(&mut machine, "Check");
    machine.send_for(b"$C\n", 200);
    machine.send_for(b"$SLP\n", 50);
    assert_reports(&mut machine, "Sleep");
}

#[test]
fn a_report_comes_within_5_ms_after_an_alarm_that_only_a_reset_ends() {
    let mut machine = on_line(&["21=1", "22=1", "20=1"]);
    machine.send_for(b"$X\nG0X10\n", 500);
    assert_reports(&mut machine, "Alarm");
    assert!(machine.snapshot().is_critical);
    machine.send_for(b"\x18", 200);
    machine.send_for(b"$X\nG0X-10\n", 100);
    machine.set_pin(Levels::limits(1 << X), true);
    machine.run(100);
    assert_reports(&mut machine, "Alarm");
    assert!(machine.snapshot().is_critical);
}

#[test]
fn a_limit_switch_is_guarded_before_the_first_motion() {
    let mut machine = on_line(&["21=1"]);
    machine.set_pin(Levels::limits(1 << X), true);
    machine.run(100);
    assert_reports(&mut machine, "Alarm");
    assert!(machine.snapshot().is_critical);
}

#[test]
fn spindle_coolant_and_overrides_are_shown_after_each_command_to_them() {
    const OVERRIDES: &str = "Ov:100,100,100";
    const OFFSET: &str = "WCO:0.000,0.000,0.000";
    let mut machine = on_line(&["32=1"]);
    for (bytes, shown) in [
        (&b""[..], OFFSET),
        (b"", OVERRIDES),
        (b"", ""),
        // Changed and back again, between two reports.
        (b"\x93\x94", OVERRIDES),
        (b"\x90", ""),
        (b"\x9a", "Ov:100,100,110"),
        (b"\x99", OVERRIDES),
        (b"\x95", ""),
        // The door switches off what is off.
        (b"\x84", OVERRIDES),
        (b"\x84", ""),
        (b"\x91\x92", OFFSET),
        (b"~", OVERRIDES),
        (b"$C\n", ""),
        (b"M2\n", ""),
        (b"$C\n", OFFSET),
        (b"", OVERRIDES),
        (b"M2\n", OFFSET),
        (b"", OVERRIDES),
        (b"$SLP\n", OVERRIDES),
        (b"", ""),
    ] {
        let found = extra_after(&mut machine, bytes);
        // Of the first three axes.
        let found = found.replace(&format!("{OFFSET}{}", ",0.000".repeat(AXES - 3)), OFFSET);
        let text = String::from_utf8_lossy(bytes);
        assert_eq!(found, shown, "after {text:?}");
    }
}

#[test]
fn what_a_line_switches_is_shown_once_it_is_switched() {
    let mut machine = on_line(&["110=6000", "120=100"]);
    for _ in 0..2 {
        let _ = extra_after(&mut machine, b"");
    }
    assert_eq!(extra_after(&mut machine, b"G1X5F600\n"), "");
    assert_eq!(extra_after(&mut machine, b"M3S500\n"), "");
    machine.run(1000);
    assert_eq!(extra_after(&mut machine, b""), "Ov:100,100,100|A:S");
    assert_eq!(extra_after(&mut machine, b""), "");
}

#[test]
fn coolant_is_shown_after_each_command_to_it_and_when_it_is_restored() {
    const OFF: &str = "Ov:100,100,100";
    const FLOOD: &str = "Ov:100,100,100|A:F";
    let mut machine = on_line(&[]);
    for _ in 0..2 {
        let _ = extra_after(&mut machine, b"");
    }
    assert_eq!(extra_after(&mut machine, b"M8\n"), FLOOD);
    assert_eq!(extra_after(&mut machine, b""), "");
    assert_eq!(extra_after(&mut machine, b"\x84"), OFF);
    assert_eq!(extra_after(&mut machine, b""), "");
    assert_eq!(extra_after(&mut machine, b"~"), FLOOD);
    machine.run(6000);
    assert_eq!(extra_after(&mut machine, b"M9\n"), OFF);
    assert_eq!(extra_after(&mut machine, b""), "");
    assert_eq!(extra_after(&mut machine, b"\x84"), OFF);
    // Nothing is restored.
    for bytes in [&b"~"[..], b""] {
        let found = extra_after(&mut machine, bytes);
        assert!(!found.contains("Ov"), "{found}");
    }
}

#[test]
fn coolant_that_a_key_has_switched_is_in_effect_for_the_next_line() {
    let mut machine = on_line(&[]);
    machine.send_for(b"\xa0$G\n", 20);
    let received = machine.take_received();
    assert!(received.contains(" M8 "), "{received}");
}
