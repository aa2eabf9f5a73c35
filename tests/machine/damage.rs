//! A machine that is switched on with something damaged in its flash.

use leadscrew::model::State;

use crate::support::{MS, Machine};

/// Bytes of a sector, and of its records.
const SECTOR: usize = 16384;
const PAGE: usize = SECTOR - 512;
const WARNING: &str = "[MSG:Damaged in storage: ";

/// Switched off, one bit of the record stored last damaged, and on again. Returns the welcome, too.
fn restart_damaged(mut machine: Machine) -> (Machine, String) {
    let page = &mut machine.flash().contents_mut()[..PAGE];
    let end = page.iter().rposition(|byte| *byte != 0xff).unwrap();
    page[end - 3] ^= 1;
    restart(machine)
}

fn restart(machine: Machine) -> (Machine, String) {
    let mut machine = machine.cycle_power();
    let welcome = machine.exchange("");
    (machine, welcome)
}

/// A machine with a startup line, whose settings are stored last.
fn set_up(assignments: &[&str]) -> Machine {
    let mut machine = Machine::new(assignments);
    let answer = machine.exchange("$X\n$N0=G91\n$110=600\n");
    assert!(answer.ends_with("ok\r\nok\r\nok\r\n"), "{answer}");
    machine
}

#[test]
fn damaged_settings_are_reported_and_lock_the_machine_until_it_is_unlocked() {
    let (mut machine, welcome) = restart_damaged(set_up(&[]));
    let locked = "[MSG:Damaged in storage: settings]\r\n[MSG:'$H'|'$X' to unlock]\r\n";
    assert!(welcome.ends_with(locked), "{welcome}");
    assert_eq!(machine.snapshot().state, State::Alarm);
    assert_eq!(machine.exchange("G0X1\n"), "error:9\r\n");
    // A reset does not unlock it.
    let welcome = machine.exchange("\x18");
    assert!(welcome.ends_with(locked), "{welcome}");
    assert_eq!(machine.exchange("G0X1\n"), "error:9\r\n");
    assert_eq!(
        machine.exchange("$X\n"),
        "[MSG:Caution: Unlocked]\r\nok\r\n"
    );
    assert_eq!(machine.snapshot().state, State::Idle);
    assert_eq!(machine.exchange("G0X1\n"), "ok\r\n");
}

#[test]
fn homing_unlocks_a_machine_with_damaged_settings() {
    // Its axes home where they stand.
    let (mut machine, welcome) = restart_damaged(set_up(&["22=1", "788=7"]));
    assert!(welcome.contains(WARNING), "{welcome}");
    assert_eq!(machine.exchange("G0X-1\n"), "error:9\r\n");
    let answer = machine.exchange("$H\n");
    assert_eq!(answer, ">G91:ok\r\nok\r\n");
    assert_eq!(machine.snapshot().state, State::Idle);
}

#[test]
fn a_damaged_record_is_shown_by_build_info_until_it_is_stored_anew() {
    let machine = set_up(&[]);
    let (mut machine, _) = restart_damaged(machine);
    machine.exchange("$X\n");
    let shown = machine.exchange("$I\n");
    assert!(
        shown.ends_with("[MSG:Damaged in storage: settings]\r\nok\r\n"),
        "{shown}"
    );
    // The value that stands in is stored when it is confirmed.
    assert!(machine.exchange("$$\n").contains("$110=500.000\r\n"));
    assert_eq!(machine.exchange("$N1=G90\n"), "ok\r\n");
    let (mut machine, welcome) = restart(machine);
    assert!(welcome.contains(WARNING), "{welcome}");
    assert_eq!(machine.exchange("$110=500\n"), "ok\r\n");
    assert!(!machine.exchange("$I\n").contains("Damaged"));
    let (mut machine, welcome) = restart(machine);
    assert!(
        !welcome.contains("Damaged") && !welcome.contains("unlock"),
        "{welcome}"
    );
    assert!(welcome.contains(">G91:ok"), "{welcome}");
    assert!(!machine.exchange("$I\n").contains("Damaged"));
}

#[test]
fn a_damaged_startup_line_is_empty_and_no_older_one_stands_in() {
    let mut machine = Machine::new(&[]);
    machine.exchange("$N0=G0X1\n$N0=G0X2\n");
    let (mut machine, welcome) = restart_damaged(machine);
    assert!(
        welcome.contains("[MSG:Damaged in storage: $N0]"),
        "{welcome}"
    );
    assert_eq!(machine.exchange("$N\n"), "$N0=\r\n$N1=\r\nok\r\n");
    assert_eq!(
        machine.exchange("$X\n$N0=\n"),
        "[MSG:Caution: Unlocked]\r\nok\r\nok\r\n"
    );
    let (machine, welcome) = restart(machine);
    assert!(!welcome.contains("Damaged"), "{welcome}");
    assert_eq!(machine.xyz(), [0; 3]);
}

#[test]
fn damaged_offsets_and_tools_are_reported_by_name_and_mended_by_storing_them_anew() {
    for (line, name) in [
        ("G10L2P2X7\n", "offsets"),
        ("G10L1P3Z5\n", "T3"),
        ("G10L1P9Z5\n", "a tool"),
        ("$I=MILL\n", "build info"),
    ] {
        let mut machine = Machine::new(&[]);
        machine.exchange("G10L1P3Z4\n");
        assert_eq!(machine.exchange(line), "ok\r\n");
        let (mut machine, welcome) = restart_damaged(machine);
        assert!(
            welcome.contains(&format!("{WARNING}{name}]")),
            "{line}: {welcome}"
        );
        machine.exchange("$X\n");
        assert_eq!(machine.exchange(line), "ok\r\n");
        let (_, welcome) = restart(machine);
        assert!(!welcome.contains("Damaged"), "{line}: {welcome}");
    }
}

#[test]
fn restoring_defaults_mends_what_is_damaged() {
    for line in ["$RST=$\n", "$RST=*\n"] {
        let (mut machine, welcome) = restart_damaged(set_up(&[]));
        assert!(welcome.contains(WARNING), "{welcome}");
        machine.exchange(line);
        assert!(!machine.exchange("$I\n").contains("Damaged"));
        let (_, welcome) = restart(machine);
        assert!(!welcome.contains("Damaged"), "{welcome}");
    }
}

#[test]
fn damage_is_reported_to_a_host_in_its_own_words_and_locks_the_machine() {
    let (mut machine, welcome) = restart_damaged(set_up(&["780=1"]));
    assert!(
        welcome.contains("echo:Damaged in storage: settings\r\n"),
        "{welcome}"
    );
    assert_eq!(machine.snapshot().state, State::Alarm);
    let answer = machine.exchange("G0 X1\n");
    machine.run(MS);
    assert_eq!(machine.xyz(), [0; 3], "{answer}");
    machine.exchange("M999\n");
    assert_eq!(machine.snapshot().state, State::Idle);
}
