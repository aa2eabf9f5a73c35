//! The whole machine, switched off and on: what is stored is there again.

use leadscrew::{
    axis::Axes,
    model::{Levels, Outputs, ResetCause, SelfTestFault},
    settings::{Settings, StepRate},
    sim::{Flash, Simulator},
    units::{StepsPerMm, TICKS_PER_SECOND},
};

pub(crate) struct Machine(pub(crate) Box<Simulator>);

impl Machine {
    fn power_up(flash: Flash) -> Self {
        Self(Box::new(Simulator::power_up(flash, StepRate::Unproven)))
    }

    /// Sends text and waits until nothing is going on; gives what has come.
    pub(crate) fn ask(&mut self, text: &str) -> String {
        let mut received = Vec::new();
        for byte in text.bytes() {
            self.0.receive(byte);
            self.run(&mut received, 0);
        }
        self.run(&mut received, u64::from(TICKS_PER_SECOND) * 60);
        String::from_utf8(received).unwrap()
    }

    /// Runs to the end of all motion, but no longer than `ticks`.
    fn run(&mut self, received: &mut Vec<u8>, ticks: u64) {
        let end = self.0.now() + ticks;
        self.0.settle();
        loop {
            while let Some(byte) = self.0.send() {
                received.push(byte);
                self.0.settle();
            }
            match self.0.due() {
                Some(due) if due <= end => drop(self.0.advance(due)),
                _ => return,
            }
        }
    }

    pub(crate) fn cycle(self) -> Self {
        Self::power_up(self.0.into_flash())
    }
}

#[test]
fn everything_that_is_stored_outlives_the_power() {
    let mut machine = Machine::power_up(Flash::new());
    machine.ask("");
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
        assert_eq!(machine.ask(line), "ok\r\n", "{line}");
    }
    let (settings, offsets, lines) = (machine.ask("$$\n"), machine.ask("$#\n"), "$N\n$I\n");
    let lines_before = machine.ask(lines);
    let mut machine = machine.cycle();
    let welcome = machine.ask("");
    assert!(!welcome.contains("error"), "{welcome}");
    assert!(settings.contains("$100=80.125\r\n$101=250.000"));
    assert!(settings.contains("$20=0"));
    assert_eq!(machine.ask("$$\n"), settings);
    assert_eq!(machine.ask("$#\n"), offsets);
    assert_eq!(machine.ask(lines), lines_before);
    assert!(lines_before.contains("REDMILL"));
}

#[test]
fn the_first_start_says_so_and_the_second_does_not() {
    let mut machine = Machine::power_up(Flash::new());
    assert!(machine.ask("").contains("error:7"));
    let mut machine = machine.cycle();
    assert!(!machine.ask("").contains("error:7"));
}

#[test]
fn settings_given_to_the_simulator_are_stored_in_it() {
    let settings = Settings {
        step_pulse_us: 7,
        ..Settings::default()
    };
    let mut machine = Machine(Box::new(Simulator::new(&settings)));
    assert!(!machine.ask("").contains("error:7"));
    let mut machine = machine.cycle();
    machine.ask("");
    assert!(machine.ask("$$\n").starts_with("$0=7\r\n"));
}

#[test]
fn an_offset_in_a_program_is_stored_when_the_machine_stands_still() {
    let mut machine = Machine(Box::new(Simulator::new(&Settings::default())));
    machine.ask("");
    // The simulator asserts that nothing moves; enough of them that sectors are erased.
    for index in 0..200 {
        let line = format!("G1 F500 X{}\nG10 L2 P1 Z{index}\nG1 X0\n", index % 2);
        assert_eq!(machine.ask(&line), "ok\r\nok\r\nok\r\n", "{index}");
    }
    assert!(machine.0.flash().erases()[0] > 0);
    let mut machine = machine.cycle();
    machine.ask("");
    assert!(machine.ask("$#\n").contains("[G54:0.000,0.000,199.000"));
}

#[test]
fn a_power_cut_while_storing_leaves_the_old_or_the_new() {
    for after in 0..70 {
        let mut machine = Machine(Box::new(Simulator::new(&Settings::default())));
        machine.ask("");
        machine.0.flash().cut_after(after, after);
        machine.ask("$110=700\n");
        let is_cut = machine.0.flash().is_off();
        let mut machine = machine.cycle();
        machine.ask("");
        let settings = machine.ask("$$\n");
        let is_new = settings.contains("$110=700.000\r\n$111=500.000");
        let is_old = settings.contains("$110=500.000\r\n$111=500.000");
        assert!(is_new || (is_old && is_cut), "after {after}: {settings}");
    }
}

#[test]
fn what_cannot_be_stored_is_refused_and_changes_nothing() {
    let mut machine = Machine(Box::new(Simulator::new(&Settings::default())));
    machine.ask("");
    let before = machine.ask("$$\n$#\n");
    machine.0.flash().cut_after(0, 1);
    for line in ["$110=700\n", "G10 L2 P1 X5\n", "$N0=G20\n"] {
        let answer = machine.ask(line);
        assert!(answer.starts_with("error:"), "{line}: {answer}");
    }
    assert_eq!(machine.ask("$$\n$#\n"), before);
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
    let mut machine = Machine(Box::new(Simulator::power_up(
        flash,
        StepRate::Proven(40_000),
    )));
    machine.ask("");
    assert!(machine.ask("$$\n").contains("$110=60000.000\r\n"));
    let start = machine.0.now();
    assert_eq!(machine.ask("G0X100Y100\n"), "ok\r\n");
    let seconds = (machine.0.now() - start) as f64 / f64::from(TICKS_PER_SECOND);
    // 20 000 steps, what the acceleration takes, and the delay until the drivers are released.
    assert!((0.5..0.53).contains(&seconds), "{seconds} s");
    assert_eq!(machine.ask("$100=99\n"), "error:12\r\n");
    assert_eq!(machine.ask("$110=24000\n$100=99\n"), "ok\r\nok\r\n");
}

#[test]
fn hard_limits_count_from_the_first_moment() {
    let settings = Settings {
        hard_limits: true,
        ..Settings::default()
    };
    let mut machine = Machine(Box::new(Simulator::new(&settings)));
    machine.ask("");
    machine.0.set_pin(Levels::limits(1), true);
    let told = machine.ask("?");
    assert!(told.contains("ALARM:1"), "{told}");
    assert!(told.contains("[MSG:Reset to continue]"), "{told}");
}

#[test]
fn a_door_that_opens_before_anything_was_sent_is_seen() {
    let mut machine = Machine(Box::new(Simulator::new(&Settings::default())));
    machine.0.set_pin(Levels::DOOR, true);
    let told = machine.ask("");
    assert!(told.ends_with("[MSG:Check Door]\r\n"), "{told}");
    let told = machine.ask("?");
    assert!(told.contains("<Door:1|"), "{told}");
    let lines = machine.ask("G0X1\n");
    assert_eq!(lines, "");
}

#[test]
fn without_its_crystal_a_machine_says_so_and_does_not_move() {
    let settings = Settings {
        homing: true,
        ..Settings::default()
    };
    let fault = SelfTestFault::NoCrystal;
    let mut machine = Machine(Box::new(Simulator::failing(&settings, fault)));
    let told = "ALARM:16\r\n[MSG:Crystal does not run: nothing moves]\r\n\r\n\
                Grbl 1.1h ['$' for help]\r\n[MSG:'$H'|'$X' to unlock]\r\n";
    assert_eq!(machine.ask(""), told);
    for refused in ["$X\n", "$H\n", "$J=G91X1F100\n", "G0 X1\n", "M3 S100\n"] {
        let answer = machine.ask(refused);
        assert!(
            answer == "error:9\r\n" || answer == "error:8\r\n",
            "{refused}{answer}"
        );
    }
    assert!(machine.ask("$G\n").ends_with("ok\r\n"));
    assert_eq!(machine.ask("\x18"), told);
    assert_eq!(machine.ask("$X\n"), "error:9\r\n");
    assert_eq!(machine.0.physical_steps(), Axes::all(0));
}

#[test]
fn what_the_self_test_has_found_is_told_with_the_frequency_of_a_wrong_crystal() {
    let other = SelfTestFault::OtherCrystal {
        khz: 11_987,
        expected_khz: 8_000,
    };
    for (fault, words) in [
        (other, "Crystal of 11.987 MHz, not 8.000"),
        (SelfTestFault::LowSupply, "Supply too low"),
    ] {
        let simulator = Simulator::failing(&Settings::default(), fault);
        let told = Machine(Box::new(simulator)).ask("");
        let begins = format!("ALARM:16\r\n[MSG:{words}: nothing moves]\r\n");
        assert!(told.starts_with(&begins), "{told}");
    }
}

#[test]
fn after_the_watchdog_or_a_fault_the_position_is_lost_and_the_cause_told() {
    for cause in ResetCause::ALL {
        for homing in [false, true] {
            let settings = Settings {
                homing,
                ..Settings::default()
            };
            let mut machine = Machine(Box::new(Simulator::after(&settings, cause)));
            let told = machine.ask("");
            let information = machine.ask("$I\n");
            let restarted = format!("ALARM:200\r\n[MSG:Restarted: {}]\r\n", cause.text());
            let last = format!("[MSG:Last reset: {}]", cause.text());
            assert!(machine.ask("$I+\n").contains(&last));
            let is_fault = cause.alarm().is_some();
            assert_eq!(told.contains(&restarted), is_fault, "{told}");
            assert_eq!(information.contains(&last), is_fault, "{information}");
            assert_eq!(told.contains("'$H'|'$X' to unlock"), is_fault || homing);
            if is_fault {
                assert_eq!(machine.ask("M3 S1000\n"), "error:9\r\n");
                assert_eq!(machine.ask("G0 X1\n"), "error:9\r\n");
                assert_eq!(machine.0.outputs(), &Outputs::default());
            }
            if is_fault || homing {
                assert!(machine.ask("$X\n").ends_with("ok\r\n"));
            }
            assert_eq!(machine.ask("G0 X1\n"), "ok\r\n");
        }
    }
}
