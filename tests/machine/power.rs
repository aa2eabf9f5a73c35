//! The whole machine, switched off and on: what is stored is there again.

use leadscrew::{
    axis::Axes,
    model::{Levels, Outputs, ResetCause, SelfTestFault},
    settings::{Settings, StepRate},
    sim::Simulator,
    units::StepsPerMm,
};

use crate::support::Machine;

#[test]
fn everything_that_is_stored_outlives_the_power() {
    let mut machine = Machine::of(Simulator::first_boot(StepRate::Unproven));
    machine.exchange("");
    for line in [
        "$100=80.125\n",
        "$22=1\n",
        "$20=1\n",
        "$22=0\n",
        "G10 L2 P2 X1.5 Y-2.25\n",
        "G55\n",
        "G28.1\n",
        "$N0=G21\n",
        "$I=red mill\n",
    ] {
        assert_eq!(machine.exchange(line), "ok\r\n", "{line}");
    }
    let (settings, offsets, lines) = (
        machine.exchange("$$\n"),
        machine.exchange("$#\n"),
        "$N\n$I\n",
    );
    let lines_before = machine.exchange(lines);
    let mut machine = machine.cycle_power();
    let welcome = machine.exchange("");
    assert!(!welcome.contains("error"), "{welcome}");
    assert!(settings.contains("$100=80.125\r\n$101=250.000"));
    assert!(settings.contains("$20=0"));
    assert_eq!(machine.exchange("$$\n"), settings);
    assert_eq!(machine.exchange("$#\n"), offsets);
    assert_eq!(machine.exchange(lines), lines_before);
    assert!(lines_before.contains("REDMILL"));
}

#[test]
fn the_first_start_says_so_and_the_second_does_not() {
    let mut machine = Machine::of(Simulator::first_boot(StepRate::Unproven));
    assert!(machine.exchange("").contains("error:7"));
    let mut machine = machine.cycle_power();
    assert!(!machine.exchange("").contains("error:7"));
}

#[test]
fn settings_given_to_the_simulator_are_stored_in_it() {
    let settings = Settings {
        step_pulse_us: 7,
        ..Settings::default()
    };
    let mut machine = Machine::of(Simulator::new(&settings));
    assert!(!machine.exchange("").contains("error:7"));
    let mut machine = machine.cycle_power();
    machine.exchange("");
    assert!(machine.exchange("$$\n").starts_with("$0=7\r\n"));
}

#[test]
fn an_offset_in_a_program_is_stored_when_the_machine_stands_still() {
    let mut machine = Machine::new(&[]);
    // The simulator asserts that nothing moves; enough of them that sectors are erased.
    for index in 0..200 {
        let line = format!("G1 F500 X{}\nG10 L2 P1 Z{index}\nG1 X0\n", index % 2);
        assert_eq!(machine.exchange(&line), "ok\r\nok\r\nok\r\n", "{index}");
    }
    assert!(machine.flash().erases()[0] > 0);
    let mut machine = machine.cycle_power();
    machine.exchange("");
    assert!(
        machine
            .exchange("$#\n")
            .contains("[G54:0.000,0.000,199.000")
    );
}

#[test]
fn a_power_cut_while_storing_leaves_the_old_or_the_new() {
    for after in 0..70 {
        let mut machine = Machine::new(&[]);
        machine.flash().cut_after(after, after);
        machine.exchange("$110=700\n");
        let is_off = machine.flash().is_off();
        let mut machine = machine.cycle_power();
        machine.exchange("");
        let settings = machine.exchange("$$\n");
        let is_new = settings.contains("$110=700.000\r\n$111=500.000");
        let is_old = settings.contains("$110=500.000\r\n$111=500.000");
        assert!(is_new || (is_old && is_off), "after {after}: {settings}");
    }
}

#[test]
fn what_cannot_be_stored_is_refused_and_changes_nothing() {
    let mut machine = Machine::new(&[]);
    let before = machine.exchange("$$\n$#\n");
    machine.flash().cut_after(0, 1);
    for line in ["$110=700\n", "G10 L2 P1 X5\n", "$N0=G20\n"] {
        let answer = machine.exchange(line);
        assert!(answer.starts_with("error:"), "{line}: {answer}");
    }
    assert_eq!(machine.exchange("$$\n$#\n"), before);
}

#[test]
fn stored_settings_beyond_what_a_new_firmware_is_proven_for_make_it_slower_and_nothing_else() {
    let settings = Settings {
        step_pulse_us: 3,
        steps_per_mm: Axes::all(StepsPerMm::from_millionths(100_000_000).unwrap()),
        max_rate_mm_min: Axes::all(60_000.0),
        acceleration_mm_s2: Axes::all(100_000.0),
        ..Settings::new(StepRate::Proven(100_000))
    };
    let machine = Simulator::new(&settings);
    let flash = machine.into_flash();
    let mut machine = Machine::of(Simulator::power_up(flash, StepRate::Proven(40_000)));
    machine.exchange("");
    assert!(machine.exchange("$$\n").contains("$110=60000.000\r\n"));
    let start = machine.seconds();
    assert_eq!(machine.exchange("G0X100Y100\n"), "ok\r\n");
    let seconds = machine.seconds() - start;
    // 20 000 steps, what the acceleration takes, and the delay until the drivers are released.
    assert!((0.5..0.53).contains(&seconds), "{seconds} s");
    assert_eq!(machine.exchange("$100=99\n"), "error:12\r\n");
    assert_eq!(machine.exchange("$110=24000\n$100=99\n"), "ok\r\nok\r\n");
}

#[test]
fn hard_limits_count_from_the_first_moment() {
    let settings = Settings {
        hard_limits: true,
        ..Settings::default()
    };
    let mut machine = Machine::with(&settings);
    machine.set_pin(Levels::limits(1), true);
    let received = machine.exchange("?");
    assert!(received.contains("ALARM:1"), "{received}");
    assert!(received.contains("[MSG:Reset to continue]"), "{received}");
}

#[test]
fn a_door_that_opens_before_anything_was_sent_is_seen() {
    let mut machine = Machine::of(Simulator::new(&Settings::default()));
    machine.set_pin(Levels::DOOR, true);
    let received = machine.exchange("");
    assert!(received.ends_with("[MSG:Check Door]\r\n"), "{received}");
    assert_eq!(machine.report().state, "Door:1");
    let lines = machine.exchange("G0X1\n");
    assert_eq!(lines, "");
}

#[test]
fn without_its_crystal_a_machine_says_so_and_does_not_move() {
    let settings = Settings {
        homing: 1,
        ..Settings::default()
    };
    let fault = SelfTestFault::NoCrystal;
    let mut machine = Machine::of(Simulator::failing(&settings, fault));
    let expected = "ALARM:16\r\n[MSG:Crystal does not run: nothing moves]\r\n\r\n\
                Grbl 1.1h ['$' for help]\r\n[MSG:'$H'|'$X' to unlock]\r\n";
    assert_eq!(machine.exchange(""), expected);
    for refused in ["$X\n", "$H\n", "$J=G91X1F100\n", "G0 X1\n", "M3 S100\n"] {
        let answer = machine.exchange(refused);
        assert!(
            answer == "error:9\r\n" || answer == "error:8\r\n",
            "{refused}{answer}"
        );
    }
    assert!(machine.exchange("$G\n").ends_with("ok\r\n"));
    assert_eq!(machine.exchange("\x18"), expected);
    assert_eq!(machine.exchange("$X\n"), "error:9\r\n");
    assert_eq!(machine.physical_steps(), Axes::all(0));
}

#[test]
fn what_the_self_test_has_found_is_reported_with_the_frequency_of_a_wrong_crystal() {
    let other = SelfTestFault::OtherCrystal {
        khz: 11_987,
        expected_khz: 8_000,
    };
    for (fault, words) in [
        (other, "Crystal of 11.987 MHz, not 8.000"),
        (SelfTestFault::LowSupply, "Supply too low"),
    ] {
        let simulator = Simulator::failing(&Settings::default(), fault);
        let received = Machine::of(simulator).exchange("");
        let begins = format!("ALARM:16\r\n[MSG:{words}: nothing moves]\r\n");
        assert!(received.starts_with(&begins), "{received}");
    }
}

#[test]
fn after_the_watchdog_or_a_fault_the_position_is_lost_and_the_cause_reported() {
    for cause in ResetCause::ALL {
        for homing in [false, true] {
            let settings = Settings {
                homing: u8::from(homing),
                ..Settings::default()
            };
            let mut machine = Machine::of(Simulator::after(&settings, cause));
            let received = machine.exchange("");
            let information = machine.exchange("$I\n");
            let restarted = format!("ALARM:200\r\n[MSG:Restarted: {}]\r\n", cause.text());
            let last = format!("[MSG:Last reset: {}]", cause.text());
            assert!(machine.exchange("$I+\n").contains(&last));
            let is_fault = cause.alarm().is_some();
            assert_eq!(received.contains(&restarted), is_fault, "{received}");
            assert_eq!(information.contains(&last), is_fault, "{information}");
            assert_eq!(received.contains("'$H'|'$X' to unlock"), is_fault || homing);
            if is_fault {
                assert_eq!(machine.exchange("M3 S1000\n"), "error:9\r\n");
                assert_eq!(machine.exchange("G0 X1\n"), "error:9\r\n");
                assert_eq!(machine.outputs(), &Outputs::default());
            }
            if is_fault || homing {
                assert!(machine.exchange("$X\n").ends_with("ok\r\n"));
            }
            assert_eq!(machine.exchange("G0 X1\n"), "ok\r\n");
        }
    }
}
