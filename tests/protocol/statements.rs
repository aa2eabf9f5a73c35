//! `$` statements that store, switch or move something.

use leadscrew::{
    model::{Alarm, Bootloader, Bootloaders, Levels, State},
    path::{MoveKind, Work},
    settings::{Change, Settings, StepRate, Stored, StoredLine},
};

use super::bench::{Bench, UNLOCK, WELCOME};

fn homing() -> Bench {
    let mut bench = Bench::booting(Settings {
        homing: 1,
        ..Settings::default()
    });
    assert_eq!(bench.serve(), [WELCOME[0], WELCOME[1], UNLOCK]);
    bench
}

#[test]
fn settings_are_stored_before_they_take_effect() {
    let mut bench = Bench::new();
    assert_eq!(bench.ask("$110=600"), ["ok"]);
    assert_eq!(bench.ask("$110=600"), ["ok"]);
    assert_eq!(
        bench.changes,
        [Change::Settings],
        "the same again is not stored"
    );
    bench.flash_fails = true;
    let before = bench.session.stored().clone();
    for line in [
        "$110=700",
        "G10L2P1X1",
        "G28.1",
        "$I=A",
        "$N0=G20",
        "$RST=*",
    ] {
        assert_eq!(bench.ask("G0X1"), ["ok"]);
        let offsets = *bench.session.interpreter().offsets();
        assert_eq!(bench.ask(line), ["error:204"], "{line}");
        assert_eq!(*bench.session.stored(), before, "{line}");
        assert_eq!(bench.session.interpreter().offsets(), &offsets, "{line}");
    }
}

#[test]
fn what_was_stored_when_a_reset_came_is_in_effect() {
    let mut bench = Bench::new();
    bench.resets_in_store = true;
    assert_eq!(bench.ask("$100=500"), ["ok", WELCOME[0], WELCOME[1]]);
    let is_known = |work: &Work| matches!(work, Work::Configure(settings) if settings == bench.session.settings());
    assert!(bench.done.iter().any(is_known));
    assert_eq!(bench.ask("G0X2"), ["ok"]);
    assert_eq!(bench.machine.steps[0], 1000);
    bench.resets_in_store = true;
    assert_eq!(bench.ask("G10L2P1X5"), ["ok", WELCOME[0], WELCOME[1]]);
    assert!(bench.ask("$#").contains(&"[G54:5.000,0.000,0.000]".into()));
    bench.resets_in_store = true;
    assert_eq!(bench.ask("$RST=*"), ["ok", WELCOME[0], WELCOME[1]]);
    assert!(bench.ask("$#").contains(&"[G54:0.000,0.000,0.000]".into()));
    assert_eq!(bench.ask("G0X2.004"), ["ok"]);
    assert_eq!(bench.machine.steps[0], 501);
}

#[test]
fn offsets_are_stored_where_they_are_set() {
    let mut bench = Bench::new();
    assert_eq!(bench.ask("G10L2P2X5"), ["ok"]);
    assert_eq!(bench.ask("G28.1"), ["ok"]);
    assert_eq!(bench.ask("G0X1"), ["ok"]);
    assert_eq!(bench.ask("G30.1"), ["ok"]);
    assert_eq!(
        bench.changes,
        [Change::Origins; 2],
        "G28.1 changes nothing at 0"
    );
    let stored = bench.session.stored().clone();
    assert_eq!(stored.origins.coordinates.0[1].0[0].0, 5_000_000);
    let mut other = Bench::booting_with(&stored, false);
    assert_eq!(other.serve(), WELCOME);
    assert!(other.ask("$#").contains(&"[G30:1.000,0.000,0.000]".into()));
}

#[test]
fn startup_lines_are_executed_before_they_are_stored() {
    let mut bench = Bench::new();
    assert_eq!(bench.ask("$N0=G20 (inch) G91"), ["ok"]);
    assert!(bench.ask("$G")[0].contains("G20 G91"));
    assert_eq!(bench.ask("$N1=G1X1"), ["error:22"]);
    assert_eq!(bench.ask("$N1=G0X1"), ["ok"]);
    assert_eq!(bench.works().len(), 1);
    assert_eq!(bench.ask("$N"), ["$N0=G20G91", "$N1=G0X1", "ok"]);
    let long = format!("$N1=G4P0.{}", "0".repeat(200));
    assert_eq!(bench.ask(&long), ["error:14"]);
    assert_eq!(bench.ask("$N2=G21"), ["error:3"]);
    let messages = [WELCOME[0], WELCOME[1], ">G20G91:ok", ">G0X1:ok"];
    assert_eq!(bench.answer("\x18"), messages);
    assert_eq!(bench.works().len(), 1);
    assert_eq!(bench.ask("$N0="), ["ok"]);
    assert_eq!(bench.answer("\x18")[2..], [">G0X1:ok"]);
}

#[test]
fn a_startup_line_that_has_become_wrong_says_so() {
    let mut stored = Stored::default();
    stored.startup[0] = StoredLine::from_slice(b"G33").unwrap();
    let mut bench = Bench::booting_with(&stored, false);
    assert_eq!(bench.serve(), [WELCOME[0], WELCOME[1], ">G33:error:20"]);
    assert_eq!(bench.ask("G0X1"), ["ok"]);
}

#[test]
fn with_nothing_stored_the_first_boot_lists_the_defaults() {
    let mut bench = Bench::booting_with(&Stored::default(), true);
    let lines = bench.serve();
    assert_eq!(lines[..2], ["error:7", "$0=10"]);
    assert_eq!(lines[lines.len() - 2..], WELCOME);
    assert_eq!(bench.answer("\x18"), WELCOME);
}

#[test]
fn build_info_is_stored_and_shown() {
    let mut bench = Bench::new();
    assert_eq!(bench.ask("$I=unit test 42"), ["ok"]);
    assert_eq!(bench.ask("$I")[0], "[VER:1.1h.20190830:UNITTEST42]");
    assert_eq!(bench.ask(&format!("$I={}", "A".repeat(128))), ["error:14"]);
    let longest = "A".repeat(127);
    assert_eq!(bench.ask(&format!("$I={longest}")), ["ok"]);
    assert_eq!(bench.ask("$I")[0], format!("[VER:1.1h.20190830:{longest}]"));
    assert_eq!(bench.ask("$I="), ["ok"]);
    assert_eq!(bench.ask("$I")[0], "[VER:1.1h.20190830:]");
}

#[test]
fn a_restoration_ends_with_a_reset() {
    for (what, change) in [
        ('$', Change::RestoreSettings),
        ('#', Change::RestoreOrigins),
        ('*', Change::RestoreAll),
    ] {
        let mut bench = Bench::new();
        for line in ["$110=999", "$N0=G20", "$I=A", "G10L2P1X9", "G92X1"] {
            assert_eq!(bench.ask(line), ["ok"]);
        }
        let lines = bench.ask(&format!("$RST={what}"));
        assert_eq!(lines[..2], ["[MSG:Restoring defaults]", "ok"]);
        assert_eq!(lines[2..4], WELCOME);
        assert_eq!(lines.len(), if what == '*' { 4 } else { 5 });
        assert_eq!(bench.changes.last(), Some(&change));
        let stored = bench.session.stored();
        let new = Stored::default();
        assert_eq!(stored.settings == new.settings, what != '#', "{what}");
        assert_eq!(stored.origins == new.origins, what != '$', "{what}");
        assert_eq!(stored.startup == new.startup, what == '*', "{what}");
        let shown = bench.session.interpreter().offsets().origins;
        assert_eq!(shown, bench.session.stored().origins);
    }
}

#[test]
fn check_mode_is_entered_idle_and_left_by_a_reset() {
    let mut bench = Bench::new();
    assert_eq!(bench.ask("$C"), ["[MSG:Enabled]", "ok"]);
    for (line, answer) in [
        ("G0X10", "ok"),
        ("G1X20", "error:22"),
        ("G1X20F100", "ok"),
        ("G38.2Z-1F10", "ok"),
        ("G4P5", "ok"),
        ("M3S100", "ok"),
        ("M0", "ok"),
        ("G10L2P3X1", "ok"),
        ("$#", "error:8"),
        ("$J=X1F100", "error:8"),
        ("$H", "error:8"),
    ] {
        assert_eq!(bench.ask(line), [answer], "{line}");
    }
    assert_eq!(bench.session.interpreter().position()[0].0, 20_000_000);
    assert_eq!(bench.session.interpreter().position()[2].0, -1_000_000);
    assert_eq!(bench.ask("M2"), ["[MSG:Pgm End]", "ok"]);
    let done = bench.works();
    assert!(
        matches!(done[..], [Work::Check, Work::EndOverrides]),
        "{done:?}"
    );
    let lines = bench.ask("$C");
    assert_eq!(lines, ["[MSG:Disabled]", "ok", WELCOME[0], WELCOME[1]]);
    assert_eq!(bench.session.interpreter().position()[0].0, 0);
    assert!(bench.ask("$#").contains(&"[G56:1.000,0.000,0.000]".into()));
}

#[test]
fn asleep_nothing_is_answered_before_a_reset() {
    let mut bench = Bench::new();
    assert_eq!(bench.answer("$SLP\nG0X1\n"), ["ok", "[MSG:Sleeping]"]);
    assert!(bench.ask("$X").is_empty());
    assert_eq!(bench.report().state, "Sleep");
    assert_eq!(bench.answer("\x18"), [WELCOME[0], WELCOME[1], UNLOCK]);
    assert_eq!(bench.ask("$X"), ["[MSG:Caution: Unlocked]", "ok"]);
    assert_eq!(bench.ask("G0X1"), ["ok"]);
}

#[test]
fn a_bootloader_that_the_board_has_is_wanted_once_the_machine_is_asleep() {
    let mut bench = Bench::new();
    for statement in ["$DFU", "$UF2"] {
        assert_eq!(bench.ask(statement), ["error:3"]);
    }
    bench.session.set_bootloaders(Bootloaders {
        dfu: true,
        uf2: false,
    });
    assert_eq!(bench.ask("$UF2"), ["error:3"]);
    bench.machine.state = State::Run;
    assert_eq!(bench.ask("$DFU"), ["error:8"]);
    bench.machine.state = State::Idle;
    assert_eq!(bench.session.wanted_bootloader(&bench.machine), None);
    assert_eq!(bench.answer("$DFU\nG0X1\n"), ["ok", "[MSG:Sleeping]"]);
    let wanted = bench.session.wanted_bootloader(&bench.machine);
    assert_eq!(wanted, Some(Bootloader::Dfu));
    bench.machine.state = State::Idle;
    assert_eq!(bench.session.wanted_bootloader(&bench.machine), None);
    bench.machine.state = State::Sleep;
    assert_eq!(bench.answer("\x18"), [WELCOME[0], WELCOME[1], UNLOCK]);
    assert_eq!(bench.session.wanted_bootloader(&bench.machine), None);
}

#[test]
fn homing_ends_with_the_startup_lines() {
    let mut bench = homing();
    assert_eq!(bench.ask("$X"), ["[MSG:Caution: Unlocked]", "ok"]);
    assert_eq!(bench.ask("$N1=G91"), ["ok"]);
    assert_eq!(bench.ask("$H"), [">G91:ok", "ok"]);
    assert_eq!(bench.session.interpreter().position()[0].0, -1_000_000);
    assert!(matches!(bench.works()[..], [Work::Unlock, Work::Home(0)]));
    assert_eq!(bench.ask("$HY"), ["ok"]);
    assert!(matches!(bench.works()[..], [Work::Home(2)]));
    assert_eq!(bench.ask("$HQ"), ["error:3"]);
}

#[test]
fn homing_that_fails_is_reported_answered_and_reset() {
    let mut bench = homing();
    bench.homing_fails = Some(Alarm::HomingNotFound);
    let messages = ["ALARM:9", "ok", WELCOME[0], WELCOME[1], UNLOCK];
    assert_eq!(bench.ask("$H"), messages);
    assert_eq!(bench.ask("G0X1"), ["error:9"]);
}

#[test]
fn homing_is_refused_while_a_switch_of_its_axes_is_closed() {
    let mut bench = homing();
    bench.close(Levels(1));
    let refused = ["[MSG:Check Limits]", "error:203"];
    assert_eq!(bench.ask("$H"), refused);
    assert_eq!(bench.ask("$HX"), refused);
    assert_eq!(bench.ask("$HY"), ["ok"]);
    bench.close(Levels::DOOR);
    bench.machine.state = State::Alarm;
    assert_eq!(bench.ask("$H"), ["error:13"]);
    assert_eq!(bench.ask("$X"), ["error:13"]);
}

#[test]
fn a_closed_switch_is_reported_with_the_welcome() {
    let mut bench = Bench::set(&["21=1"]);
    bench.close(Levels(2));
    bench.machine.state = State::Alarm;
    let messages = [WELCOME[0], WELCOME[1], "[MSG:Check Limits]", UNLOCK];
    assert_eq!(bench.answer("\x18"), messages);
}

#[test]
fn a_jog_changes_nothing_but_the_position() {
    let mut bench = Bench::new();
    assert_eq!(bench.answer("G20\nG91\nG1F10\n"), ["ok"; 3]);
    let modes = bench.ask("$G");
    assert_eq!(bench.ask("$J=G21G90X5F500"), ["ok"]);
    assert_eq!(bench.ask("$G"), modes);
    let jogs = bench.works();
    let [Work::Move(block)] = jogs[..] else {
        panic!("{jogs:?}")
    };
    assert_eq!(block.kind, MoveKind::Jog);
    assert_eq!(block.programmed_mm_s, 500.0 / 60.0);
    // In the units before it.
    assert_eq!(bench.ask("$J=X0.1F10"), ["ok"]);
    assert_eq!(bench.session.interpreter().position()[0].0, 7_540_000);
    assert_eq!(bench.works().len(), 1);
    for (line, number) in [
        ("$J=", 22),
        ("$J=F100", 26),
        ("$J=X1F0", 22),
        ("$J=G1X1F100", 16),
        ("$J=G54X1F100", 16),
        ("$J=M3X1F100", 16),
        ("$J=G92X1F100", 16),
        ("$J=G4P1F100", 16),
        ("$J=G38.2X1F100", 16),
        ("$J=S100X1F100", 36),
        ("$J=T1X1F100", 36),
        ("$J=X1I1F100", 36),
        ("$J=G90G91X1F100", 21),
        ("$J=Q1F100", 20),
        ("$JX1F100", 3),
    ] {
        assert_eq!(bench.ask(line), [format!("error:{number}")], "{line}");
    }
    assert!(bench.works().is_empty());
}

#[test]
fn while_jogging_there_are_only_jogs() {
    let mut bench = Bench::new();
    bench.withholds = true;
    bench.machine.is_at_rest = false;
    assert_eq!(bench.ask("$J=X10F100"), ["ok"]);
    for state in [State::Idle, State::Jog] {
        bench.machine.state = state;
        assert_eq!(bench.ask("G0X0"), ["error:9"]);
        assert_eq!(bench.ask("$X"), ["ok"]);
        assert_eq!(bench.ask("$#"), ["error:8"]);
        assert_eq!(bench.ask("$$").len(), 23 + 4 * leadscrew::axis::AXES);
        assert_eq!(bench.ask("$J=X1F100"), ["ok"]);
    }
    bench.withholds = false;
    bench.serve();
    bench.machine.state = State::Idle;
    bench.machine.is_at_rest = true;
    assert_eq!(bench.ask("G0X0"), ["ok"]);
}

#[test]
fn a_cancelled_jog_ends_where_the_machine_stands() {
    let mut bench = Bench::new();
    bench.withholds = true;
    assert_eq!(bench.ask("$J=X10F100"), ["ok"]);
    bench.machine.state = State::Jog;
    bench.machine.is_at_rest = false;
    bench.machine.cancelled_motions += 1;
    // While the machine slows down no line is begun.
    assert!(bench.ask("G91X1").is_empty());
    bench.entries.dequeue();
    bench.machine.finished = bench.session.entered();
    bench.machine.steps.0[0] = 1000;
    bench.machine.state = State::Idle;
    bench.machine.is_at_rest = true;
    bench.withholds = false;
    assert_eq!(bench.serve(), ["ok"]);
    assert_eq!(bench.session.interpreter().position()[0].0, 5_000_000);
}

#[test]
fn what_there_is_is_described_for_programs() {
    let mut bench = Bench::new();
    let settings = bench.ask("$ES");
    assert_eq!(settings[0], "[SETTING:0|1|step pulse|us|5|##0|3|255]");
    assert!(settings.contains(&"[SETTING:20|4|soft limits||0|||]".into()));
    assert!(
        settings
            .iter()
            .any(|line| line.starts_with("[SETTING:111|6|Y-axis largest speed|mm/min|6|"))
    );
    for (number, unit) in [(120, "mm/s^2"), (800, "mm/s^3")] {
        let begin = format!("[SETTING:{number}|");
        let row = settings.iter().find(|line| line.starts_with(&begin));
        assert_eq!(row.and_then(|line| line.split('|').nth(3)), Some(unit));
    }
    assert_eq!(settings.len(), bench.ask("$+").len());
    assert_eq!(bench.ask("$EG")[0], "[SETTINGGROUP:1|0|General]");
    let errors = bench.ask("$EE");
    assert_eq!(errors[0], "[ERRORCODE:1||a word must begin with a letter]");
    let alarms = bench.ask("$EA");
    assert!(alarms[0].starts_with("[ALARMCODE:1||"));
    assert_eq!(alarms.len(), 15);
    for line in errors.iter().chain(&alarms).chain(&settings) {
        let text = line.as_str();
        assert!(
            text == "ok" || (!text.contains("ok") && !text.contains("error")),
            "{line}"
        );
        assert!(line.is_ascii() && !line.contains('?'), "{line}");
    }
}

/// A machine at rest whose firmware is proven to keep up with a step rate.
fn proven(hz: u32) -> Bench {
    let mut bench = Bench::booting(Settings::new(StepRate::Proven(hz)));
    assert_eq!(bench.serve()[..2], WELCOME);
    bench.machine.state = State::Idle;
    bench
}

#[test]
fn more_steps_than_are_proven_are_refused() {
    let mut bench = proven(60_000);
    assert_eq!(bench.ask("$0=3"), ["ok"]);
    assert_eq!(bench.ask("$100=40"), ["ok"]);
    // 40 steps/mm, 1500 mm/s.
    assert_eq!(bench.ask("$110=90000"), ["ok"]);
    assert_eq!(bench.ask("$110=90000.02"), ["error:12"]);
    assert_eq!(bench.ask("$100=40.001"), ["error:12"]);
    let settings = bench.ask("$$");
    assert!(settings.contains(&"$100=40.000".into()));
    assert!(settings.contains(&"$110=90000.000".into()));
    // A user can neither restore nor remove the proven rate.
    assert_eq!(bench.ask("$RST=*").last().unwrap(), WELCOME[1]);
    assert_eq!(bench.ask("$I")[2], "[MSG:Step rate: 60000 Hz, proven]");
}

#[test]
fn more_steps_than_the_pulse_leaves_room_for_are_refused() {
    let mut bench = proven(150_000);
    assert_eq!(bench.ask("$0=100"), ["ok"]);
    assert_eq!(bench.ask("$100=100"), ["ok"]);
    assert_eq!(bench.ask("$110=60000"), ["error:12"]);
    assert_eq!(bench.ask("$110=5000"), ["ok"]);
}

#[test]
fn a_firmware_of_which_nothing_is_proven_says_so_and_keeps_to_a_low_rate() {
    let mut bench = Bench::new();
    assert_eq!(bench.ask("$I")[2], "[MSG:Step rate: 30000 Hz, unproven]");
    assert_eq!(bench.ask("$100=100"), ["ok"]);
    assert_eq!(bench.ask("$110=18000"), ["ok"]);
    assert_eq!(bench.ask("$110=18000.01"), ["error:12"]);
}

#[test]
fn path_control_is_shown_where_it_is_not_that_of_power_up() {
    let mut bench = Bench::new();
    for (line, shown) in [
        ("G61", "[GC:G0 G54 G17 G21 G90 G94 M5 M9 T0 F0 S0]"),
        ("G61.1", "[GC:G0 G54 G17 G21 G90 G94 G61.1 M5 M9 T0 F0 S0]"),
        ("G64P.02", "[GC:G0 G54 G17 G21 G90 G94 G64 M5 M9 T0 F0 S0]"),
    ] {
        assert_eq!(bench.ask(line), ["ok"]);
        assert_eq!(bench.ask("$G"), [shown, "ok"]);
    }
}

#[test]
fn the_input_of_an_axis_without_a_switch_does_not_keep_from_homing() {
    let mut bench = Bench::set(&["22=1", "788=4"]);
    bench.close(Levels::limits(0b100));
    assert_eq!(bench.ask("$H"), ["ok"]);
    bench.close(Levels::limits(0b010));
    assert_eq!(bench.ask("$H"), ["[MSG:Check Limits]", "error:203"]);
}
