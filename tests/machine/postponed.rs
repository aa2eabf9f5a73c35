//! Changes while the spindle runs: no flash is erased, they wait, and the sender is told.

use crate::support::Machine;

const LATER: &str = "[MSG:Stored when idle with the spindle off]\r\nok\r\n";
const WAITS: &str = ", not stored yet: ";

/// A machine whose spindle runs, and the index of the first offset in it that waits: the flash is full.
fn machine_with_full_flash() -> (Machine, u32) {
    machine_with("M3 S1000\n")
}

/// The same by a line that switches the spindle on.
fn machine_with(spindle: &str) -> (Machine, u32) {
    let mut machine = Machine::new(&[]);
    assert_eq!(machine.exchange(spindle), "ok\r\n");
    for index in 1..400 {
        match machine.exchange(format!("G10 L2 P1 X{index}\n")).as_str() {
            "ok\r\n" => assert!(!has_waiting(&mut machine)),
            answer => {
                assert_eq!(answer, LATER);
                return (machine, index);
            }
        }
    }
    panic!("the flash is never full");
}

/// Whether the build information tells of changes that wait.
fn has_waiting(machine: &mut Machine) -> bool {
    machine.exchange("$I+\n").contains(WAITS)
}

fn assert_offset(machine: &mut Machine, x: u32) {
    let offsets = machine.exchange("$#\n");
    assert!(offsets.contains(&format!("[G54:{x}.000,")), "{offsets}");
}

/// The three changes that have been made are in effect.
fn assert_in_effect(machine: &mut Machine, x: u32) {
    assert_offset(machine, x);
    assert!(machine.exchange("$#\n").contains("[G55:5.000,"));
    assert!(machine.exchange("$$\n").contains("$110=700.000\r\n"));
}

fn stored_offset(machine: Machine) -> String {
    let mut machine = machine.cycle_power();
    machine.exchange("");
    machine.exchange("$#\n")
}

#[test]
fn an_offset_waits_while_the_spindle_runs_and_is_stored_when_it_is_off() {
    let (mut machine, index) = machine_with_full_flash();
    let erases = machine.flash().erases();
    let waiting = "[MSG:Late events: 0, lost bytes: 0, not stored yet: 1]\r\n";
    assert!(machine.exchange("$I+\n").contains(waiting));
    // The next change waits, too, and nothing is said twice.
    assert_eq!(machine.exchange("G10 L2 P2 X5\n"), "ok\r\n");
    assert_eq!(machine.exchange("$110=700\n"), "ok\r\n");
    let waiting = "[MSG:Late events: 0, lost bytes: 0, not stored yet: 2]\r\n";
    assert!(machine.exchange("$I\n").contains(waiting));
    assert_in_effect(&mut machine, index);
    assert_eq!(machine.flash().erases(), erases);
    assert_eq!(machine.exchange("M5\n"), "ok\r\n");
    assert!(!has_waiting(&mut machine));
    assert_ne!(machine.flash().erases(), erases);
    let mut machine = machine.cycle_power();
    machine.exchange("");
    assert_in_effect(&mut machine, index);
}

#[test]
fn an_offset_waits_while_a_spindle_without_a_speed_is_on() {
    let (mut machine, _) = machine_with("M4\n");
    let erases = machine.flash().erases();
    assert!(has_waiting(&mut machine));
    assert_eq!(machine.flash().erases(), erases);
    machine.exchange("M5\n");
    assert!(!has_waiting(&mut machine));
}

#[test]
fn a_loss_of_power_while_an_offset_waits_leaves_the_one_before() {
    let (machine, index) = machine_with_full_flash();
    let before = format!("[G54:{}.000,", index - 1);
    assert!(stored_offset(machine).contains(&before));
}

#[test]
fn a_reset_keeps_what_waits_and_stores_it() {
    let (mut machine, index) = machine_with_full_flash();
    machine.exchange("\x18");
    assert!(!has_waiting(&mut machine));
    assert!(stored_offset(machine).contains(&format!("[G54:{index}.000,")));
}

#[test]
fn defaults_are_restored_while_an_offset_waits() {
    let (mut machine, _) = machine_with_full_flash();
    let answer = machine.exchange("$RST=#\n");
    assert!(answer.starts_with("[MSG:Restoring defaults]"));
    // Ends the spindle, too.
    assert!(!has_waiting(&mut machine));
    assert!(stored_offset(machine).contains("[G54:0.000,"));
}

#[test]
fn what_has_waited_and_cannot_be_stored_is_reported() {
    let (mut machine, index) = machine_with_full_flash();
    machine.flash().cut_after(0, 1);
    let answer = machine.exchange("M5\nG4 P0.1\n");
    let lost = "[MSG:Not stored: lost when power is off]\r\n";
    assert_eq!(answer.matches(lost).count(), 1, "{answer}");
    assert!(!has_waiting(&mut machine));
    assert_offset(&mut machine, index);
}

#[test]
fn a_laser_that_shines_keeps_the_flash_from_being_erased() {
    for (spindle_on, waits) in [("M3 S500\n", true), ("M4 S500\n", false)] {
        let (mut machine, _) = machine_with_full_flash();
        for line in ["M5\n", "$32=1\n", "G1 X1 F600\n", spindle_on] {
            assert_eq!(machine.exchange(line), "ok\r\n", "{line}");
        }
        // M4 switches the beam off where nothing moves.
        assert_eq!(machine.outputs().duty > 0, waits, "{spindle_on}");
        let erases = machine.flash().erases();
        for index in 0..100 {
            machine.exchange(format!("G10 L2 P1 X{index}\n"));
        }
        assert_eq!(machine.flash().erases() == erases, waits, "{spindle_on}");
        assert_eq!(has_waiting(&mut machine), waits, "{spindle_on}");
    }
}
