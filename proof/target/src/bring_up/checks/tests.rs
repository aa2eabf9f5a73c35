//! Facts that are altered, so that each part of each check fails.

use super::*;

fn expected() -> Expected {
    Expected {
        chip: Some(0x413),
        flash_kib: 1024,
        wait_states: 5,
        core_hz: 168_000_000,
        vectors: 0x0800_0000,
        guard: 0x2000_a000,
        priorities: vec![
            ("SysTick".into(), 5),
            ("USART1".into(), 4),
            ("TIM4".into(), 1),
        ],
    }
}

/// The facts of a faultless board.
const FACTS: [(&str, i64); 61] = [
    ("emulated", 0),
    ("port", 1),
    ("crystal", 1),
    ("processor", 0x410f_c241),
    ("chip", 0x1007_6413),
    ("flash_kib", 1024),
    ("uid.0", 0x0031_0025),
    ("uid.1", 0x3236_510f),
    ("uid.2", 0x3137_3638),
    ("flash.access", 0x605),
    ("flash.options", 0x0fff_aaed),
    ("vectors", 0x0800_0000),
    ("guard.start", 0x2000_a000),
    ("guard.size", 0x1000_0017),
    ("guard.control", 5),
    ("fpu.access", 0xf << 20),
    ("fpu.control", 0xc000_0000),
    ("control", 0x200),
    ("priority.SysTick", 0xb0),
    ("priority.USART1", 0xc0),
    ("priority.TIM4", 0xf0),
    ("step.halts.pushed", 80_000),
    ("step.halts.played", 80_000),
    ("step.halts.halted", 9830),
    ("step.halts.after_halt", 0),
    ("step.appends.pushed", 4812),
    ("step.appends.played", 4812),
    ("step.appends.in_time", 800),
    ("step.appends.too_late", 804),
    ("step.appends.late", 0),
    ("step.appends.least", -2),
    ("step.appends.most", 1),
    ("step.reloads.new", 300),
    ("step.reloads.old", 348),
    ("step.reloads.wrong", 0),
    ("step.reloads.off", 2),
    ("serial.expected", 1 << 20),
    ("serial.received", 1 << 20),
    ("serial.wrong", 0),
    ("serial.lost", 0),
    ("serial.returned", 1 << 20),
    ("serial.returned_wrong", 0),
    ("serial.clock_hz", 84_000_000),
    ("serial.divider", 729),
    ("stream.expected", 1 << 16),
    ("stream.received", 1 << 16),
    ("stream.wrong", 0),
    ("stream.cycles", STREAM_CYCLES + 2000),
    ("stream.baud", 115_110),
    ("supply", 1),
    ("fault.undefined.cause", 6),
    ("fault.stack.cause", 6),
    ("fault.panic.cause", 5),
    ("fault.clock.cause", 8),
    ("fault.interrupt.cause", 7),
    ("fault.watchdog.cause", 4),
    ("told.processor", 2),
    ("told.panic", 1),
    ("told.interrupt", 1),
    ("reset_flags", 0x1400_0000),
    ("unknown", 1),
];

/// Cycles of the bytes without a pause: two of the processor for one of the USART.
const STREAM_CYCLES: i64 = (10 << 16) * 729 * 2;

/// Operations of the flash, with their parts' names and the longest time, cycles.
const FLASH: [(&str, &str, i64); 3] = [
    ("flash.erase", "erase", 336_000_000),
    ("flash.program", "words", 18_480),
    ("flash.erase_again", "erase of these words", 336_000_000),
];

fn good() -> Facts {
    let mut facts = Facts::default();
    for (name, number) in FACTS {
        facts.put(name, number);
    }
    for (waiting, _, scripts) in WAITS {
        for script in scripts {
            for (what, number) in [
                ("pushed", 32),
                ("played", 32),
                ("late", 0),
                ("served", 32),
                ("least", -1),
                ("most", 2),
                ("total", 1),
            ] {
                facts.put(&format!("step.{script}.{waiting}.{what}"), number);
            }
        }
    }
    for (operation, _, most_cycles) in FLASH {
        for (what, number) in [
            ("done", 1),
            ("cycles", most_cycles),
            ("words", 3000),
            ("wrong_words", 0),
            ("during", 800),
            ("received", 800),
            ("wrong", 0),
            ("lost", 0),
            ("busy_at_once", 0),
            ("busy", 1),
        ] {
            facts.put(&format!("{operation}.{what}"), number);
        }
    }
    for (fault, ..) in FAULTS {
        for (what, number) in [
            ("cycles_to_off", 40),
            ("on_before", 5),
            ("on_after", 0),
            ("by_watchdog", 0),
        ] {
            facts.put(&format!("fault.{fault}.{what}"), number);
        }
    }
    facts
}

/// The parts with a verdict, each with its check.
fn with(verdict: Verdict, facts: &Facts) -> Vec<(&'static str, String)> {
    let checks = judge(facts, &expected()).into_iter();
    let parts = checks.flat_map(|check| {
        let items = check.items.into_iter();
        items.map(move |item| (check.title, item))
    });
    let found = parts.filter(|(_, item)| item.verdict == verdict);
    found.map(|(check, item)| (check, item.name)).collect()
}

/// Alters or removes one fact; exactly one part of this check must fail.
fn assert_fails(check: &str, part: &str, fact: &str, number: Option<i64>) {
    let mut facts = good();
    assert!(facts.get(fact).is_some(), "there is no fact {fact}");
    match number {
        Some(number) => facts.put(fact, number),
        None => facts.remove(fact),
    }
    let failed = with(Verdict::Failed, &facts);
    let failed: Vec<_> = failed
        .iter()
        .map(|(check, part)| (*check, &**part))
        .collect();
    assert_eq!(failed, [(check, part)], "{fact} {number:?}");
    let verdicts = judge(&facts, &expected()).into_iter();
    let verdicts = verdicts.filter(|check| check.verdict() == Verdict::Failed);
    assert_eq!(verdicts.count(), 1, "{fact}");
}

#[test]
fn a_board_on_which_everything_is_well_passes_every_part() {
    assert_eq!(with(Verdict::Failed, &good()), []);
    assert_eq!(with(Verdict::Open, &good()), []);
    assert_eq!(with(Verdict::Passed, &good()).len(), 108);
}

#[test]
fn another_chip_or_another_start_up_fails_the_check_of_the_chip() {
    for (part, fact, number) in [
        ("processor", "processor", 0x410f_c230),
        ("chip", "chip", 0x1007_6421),
        ("flash, KiB", "flash_kib", 512),
        ("crystal runs", "crystal", 0),
        ("supply above 2.9 V", "supply", 0),
        ("access to the flash", "flash.access", 0x705),
        ("watchdog started by software", "flash.options", 0x0fff_aacd),
        ("vectors", "vectors", 0),
        ("guard of the stack", "guard.start", 0x2000_9000),
        ("size of the guard", "guard.size", 0x1300_0017),
        ("control of the guard", "guard.control", 0),
        ("floating point", "fpu.access", 0),
        ("its registers saved late", "fpu.control", 0),
        // A division by zero is a fault; so is an access that is not aligned.
        ("alignment and traps", "control", 0x210),
        ("alignment and traps", "control", 0x208),
        ("priority of SysTick", "priority.SysTick", 0xff),
        ("priority of USART1", "priority.USART1", 0xb0),
        // Two bits are all that the chip has.
        ("priority of TIM4", "priority.TIM4", 0xc0),
    ] {
        assert_fails("Chip", part, fact, Some(number));
        assert_fails("Chip", part, fact, None);
    }
    let mut erased = good();
    for name in ["uid.0", "uid.1", "uid.2"] {
        erased.put(name, 0xffff_ffff);
    }
    let failed = with(Verdict::Failed, &erased);
    assert_eq!(failed, [("Chip", "unique number".to_owned())]);
    assert_fails("Chip", "unique number", "uid.1", None);
}

#[test]
fn an_event_that_is_missing_or_comes_at_another_time_fails_the_step_timer() {
    for (waiting, _, scripts) in WAITS {
        for script in scripts {
            for (part, fact, number) in [
                ("events", "played", 31),
                ("late", "late", 1),
                ("times", "least", -25),
                ("times", "most", 25),
                ("times", "total", 32),
            ] {
                let part = format!("{script}, {waiting}: {part}");
                let fact = format!("step.{script}.{waiting}.{fact}");
                assert_fails("Step timer", &part, &fact, Some(number));
                assert_fails("Step timer", &part, &fact, None);
            }
        }
    }
    for (part, fact, number) in [
        ("halts: events", "step.halts.played", 79_999),
        ("halts in the middle", "step.halts.halted", 0),
        ("events after a halt", "step.halts.after_halt", 1),
        ("late appends: events", "step.appends.played", 4811),
        ("late appends", "step.appends.in_time", 0),
        ("late appends", "step.appends.too_late", 0),
        ("late appends: late", "step.appends.late", 1),
        // The time of an event that nobody has written.
        ("late appends: times", "step.appends.least", -25),
        ("late appends: times", "step.appends.most", 1_048_000),
        ("reload values around the wrap", "step.reloads.new", 0),
        ("reload values around the wrap", "step.reloads.old", 0),
        ("reload values: wrong ones", "step.reloads.wrong", 1),
        ("reload values: counts", "step.reloads.off", 25),
    ] {
        assert_fails("Step timer", part, fact, Some(number));
        assert_fails("Step timer", part, fact, None);
    }
    for script in ["shortest", "random"] {
        let part = format!("{script}, flooded: serial interrupts");
        let fact = format!("step.{script}.flooded.served");
        for number in [Some(31), Some(0), None] {
            assert_fails("Step timer", &part, &fact, number);
        }
    }
    let mut nothing = good();
    nothing.put("step.halts.pushed", 0);
    nothing.put("step.halts.played", 0);
    let failed = with(Verdict::Failed, &nothing);
    assert_eq!(failed, [("Step timer", "halts: events".to_owned())]);
}

#[test]
fn a_byte_that_is_lost_or_damaged_fails_the_serial_line() {
    for (part, fact, number) in [
        ("bytes to the board", "serial.received", (1 << 20) - 1),
        ("wrong among those to it", "serial.wrong", 1),
        ("lost or damaged", "serial.lost", 1),
        ("bytes from the board", "serial.returned", (1 << 20) - 1),
        ("wrong among those from it", "serial.returned_wrong", 1),
        ("bytes without a pause", "stream.received", (1 << 16) - 1),
        ("wrong among those without a pause", "stream.wrong", 1),
    ] {
        assert_fails("Serial", part, fact, Some(number));
        assert_fails("Serial", part, fact, None);
    }
}

#[test]
fn a_baud_rate_more_than_one_per_cent_off_fails_the_serial_line() {
    let part = "baud rate by this computer's clock";
    // 4 % off, and a little more than 1 %.
    for baud in [119_808, 110_592, 116_353, 114_047] {
        assert_fails("Serial", part, "stream.baud", Some(baud));
    }
    assert_fails("Serial", part, "stream.baud", None);
    let mut facts = good();
    facts.put("stream.baud", 116_352);
    assert_eq!(with(Verdict::Failed, &facts), []);
    // Pauses, or a clock that is not the one of the divider.
    let part = "time of the bytes without a pause";
    for off in [-STREAM_CYCLES / 999, STREAM_CYCLES / 999] {
        let cycles = Some(STREAM_CYCLES + off);
        assert_fails("Serial", part, "stream.cycles", cycles);
    }
    assert_fails("Serial", part, "stream.cycles", None);
    // A divider for another rate, by which the bytes take their time.
    for divider in [700, 737] {
        let mut facts = good();
        facts.put("serial.divider", divider);
        facts.put("stream.cycles", STREAM_CYCLES / 729 * divider);
        let failed = with(Verdict::Failed, &facts);
        let part = "baud rate by the divider".to_owned();
        assert_eq!(failed, [("Chip", part)], "{divider}");
    }
    for (fact, number) in [("serial.divider", 0), ("serial.clock_hz", 16_000_000)] {
        let mut facts = good();
        facts.put(fact, number);
        assert_eq!(with(Verdict::Failed, &facts).len(), 2, "{fact}");
        facts.remove(fact);
        assert_eq!(with(Verdict::Failed, &facts).len(), 2, "{fact}");
    }
}

#[test]
fn a_byte_that_is_lost_while_the_flash_is_busy_fails_the_flash() {
    for (operation, name, most_cycles) in FLASH {
        for (part, fact, number) in [
            ("done", "done", 0),
            ("done", "wrong_words", 1),
            ("bytes", "received", 799),
            ("bytes", "wrong", 1),
            ("bytes", "lost", 1),
            // They came too late for the flash to be busy.
            ("bytes meanwhile", "during", 399),
            ("time", "cycles", most_cycles + 168),
            ("time", "cycles", 0),
        ] {
            let (part, fact) = (format!("{name}: {part}"), format!("{operation}.{fact}"));
            assert_fails("Flash", &part, &fact, Some(number));
            assert_fails("Flash", &part, &fact, None);
        }
    }
    assert_fails("Flash", "words: done", "flash.program.words", Some(0));
    for (operation, name, _) in &FLASH[..2] {
        let part = format!("{name}: busy at the firmware's first look");
        let fact = |what: &str| format!("{operation}.{what}");
        // The firmware would go on, and stand still with the bytes behind it.
        assert_fails("Flash", &part, &fact("busy"), Some(0));
        assert_fails("Flash", &part, &fact("busy"), None);
        assert_fails("Flash", &part, &fact("busy_at_once"), None);
    }
}

#[test]
fn a_fault_that_leaves_an_output_on_or_no_record_fails_the_faults() {
    for (fault, name, cause, _) in FAULTS {
        let fact = |what: &str| format!("fault.{fault}.{what}");
        let name = |what: &str| format!("{name}: {what}");
        let other = if cause == ResetCause::Watchdog {
            ResetCause::Pin
        } else {
            ResetCause::Watchdog
        };
        for number in [Some(0), Some(other as i64), None] {
            let part = name("cause after the reset");
            assert_fails("Faults", &part, &fact("cause"), number);
        }
        if cause == ResetCause::Watchdog {
            continue;
        }
        for (part, what, number) in [
            ("time to outputs off", "cycles_to_off", 50_001),
            ("outputs left on", "on_after", 1),
            ("outputs left on", "on_before", 0),
            ("resets by the watchdog", "by_watchdog", 1),
        ] {
            assert_fails("Faults", &name(part), &fact(what), Some(number));
            assert_fails("Faults", &name(part), &fact(what), None);
        }
    }
    for (part, fact, right) in [
        ("processor faults told to the sender", "told.processor", 2),
        ("panics told to the sender", "told.panic", 1),
        ("interrupts told to the sender", "told.interrupt", 1),
    ] {
        assert_fails("Faults", part, fact, Some(right - 1));
        assert_fails("Faults", part, fact, None);
    }
}

#[test]
fn a_stack_without_its_guard_fails_for_that_reason() {
    let mut facts = good();
    for what in ["cause", "cycles_to_off", "on_before", "on_after"] {
        facts.remove(&format!("fault.stack.{what}"));
    }
    facts.put("fault.stack.unguarded", 1);
    let checks = judge(&facts, &expected());
    let mut items = checks.iter().flat_map(|check| &check.items);
    let failed = items.find(|item| item.verdict == Verdict::Failed).unwrap();
    assert_eq!(failed.name, "stack too deep: made");
    assert!(failed.measured.contains("guard"), "{}", failed.measured);
    assert!(items.all(|item| item.verdict == Verdict::Passed));
}

#[test]
fn what_has_no_hardware_is_open_and_does_not_pass() {
    let mut facts = good();
    facts.put("port", 0);
    for part in ["serial.received", "told.panic"] {
        facts.remove(part);
    }
    assert_eq!(with(Verdict::Failed, &facts), []);
    assert_eq!(with(Verdict::Open, &facts).len(), 26);
    let serial = judge(&facts, &expected()).remove(2);
    assert_eq!((serial.title, serial.verdict()), ("Serial", Verdict::Open));
    let mut in_emulator = good();
    in_emulator.put("emulated", 1);
    let serial = judge(&in_emulator, &expected()).remove(2);
    let open = serial
        .items
        .iter()
        .filter(|item| item.verdict == Verdict::Open);
    let reasons: Vec<_> = open.map(|item| &*item.measured).collect();
    assert_eq!(reasons, ["the emulator's serial line has no rate"; 2]);
    facts.put("emulated", 1);
    facts.put("chip", 0);
    facts.remove("fault.watchdog.cause");
    let open = with(Verdict::Open, &facts);
    assert!(open.contains(&("Chip", "chip".to_owned())), "{open:?}");
    assert!(open.contains(&("Faults", "hang: cause after the reset".to_owned())));
    assert_eq!(with(Verdict::Failed, &facts), []);
}

#[test]
fn the_emulator_s_timer_is_trusted_to_two_cycles() {
    let mut facts = good();
    facts.put("emulated", 1);
    assert_eq!(with(Verdict::Failed, &facts), []);
    for (fact, number) in [("total", 11), ("total", -32), ("least", -3), ("most", 3)] {
        let mut facts = facts.clone();
        facts.put(&format!("step.random.running.{fact}"), number);
        let failed = with(Verdict::Failed, &facts);
        let part = "random, running: times".to_owned();
        assert_eq!(failed, [("Step timer", part)], "{fact} {number}");
    }
}

#[test]
fn every_chip_of_a_board_has_its_number() {
    for board in firmware::boards::all().unwrap() {
        assert!(chip_number(&board.chip.hal).is_some(), "{}", board.name);
    }
    assert_eq!(chip_number("f401"), None);
}
