//! Lines, programs and resets.

use crate::{cases::rounds, machine::Machine, sender::Sender};

/// The control register of SysTick, the step timer, and the bit for running to an event.
const SYST_CSR: u64 = 0xe000_e010;
const TICKINT: u32 = 1 << 1;

#[test]
fn lines_settings_and_queries_are_answered() {
    let Some(mut machine) = Machine::boot() else {
        return;
    };
    let status = machine.status();
    assert_eq!(status.state, "Idle");
    assert_eq!(status.xyz(), Some("0.000,0.000,0.000"));
    assert_eq!(machine.ask("G1X1"), ["error:22"]);
    assert_eq!(machine.ask("G0 X1 ; a comment"), ["ok"]);
    assert_eq!(machine.ask("Q"), ["error:2"]);
    assert_eq!(machine.ask(""), ["ok"]);
    assert_eq!(machine.wait_for_idle().xyz(), Some("1.000,0.000,0.000"));
    let [step_timer] = machine.memory.read(SYST_CSR);
    assert_eq!(
        step_timer & TICKINT,
        0,
        "no flash is written while the step timer runs"
    );
    assert!(machine.ask("$$").contains(&"$100=250.000".to_owned()));
    assert_eq!(machine.ask("$100=80"), ["ok"]);
    assert!(machine.ask("$$").contains(&"$100=80.000".to_owned()));
    assert_eq!(machine.ask("G4P0.1"), ["ok"]);
    assert_eq!(machine.ask("M30"), ["[MSG:Pgm End]", "ok"]);
}

#[test]
fn a_program_ends_where_it_should_with_inverted_outputs() {
    let Some(mut machine) = Machine::boot() else {
        return;
    };
    machine.make_fast();
    for setting in ["$2=5", "$3=2", "$4=1"] {
        assert_eq!(machine.ask(setting), ["ok"]);
    }
    let mut sender = Sender::new(&mut machine);
    for line in [
        "G21G90G94",
        "G1X20F3000",
        "Y10",
        "G3X0Y10I-10J0",
        "G2X0Y0J-5",
        "G18G2X10Z5R8",
        "G0X3Y4Z-1",
    ] {
        sender.send(format!("{line}\n").as_bytes(), "ok");
    }
    sender.finish();
    let status = machine.wait_for_idle();
    assert_eq!(status.xyz(), Some("3.000,4.000,-1.000"));
}

#[test]
fn thousands_of_lines_with_holds_resets_and_queries_get_one_answer_each() {
    let Some(mut machine) = Machine::boot() else {
        return;
    };
    machine.make_fast();
    let mut sender = Sender::new(&mut machine);
    let (mut dropped, mut resets) = (0, 0);
    let lines = rounds(8_000).min(20_000) as u32;
    for number in 0..lines {
        // Kinds of lines in a pattern that no shift maps onto itself, so a lost or a doubled answer
        // shows up soon.
        let (line, answer) = match number * number % 31 {
            0..=17 => (format!("G1X{}Y{}F3000", number % 7, number % 5), "ok"),
            18..=24 => (String::new(), "ok"),
            25..=27 => ("G1X1Y".to_owned(), "error:2"),
            28 => ("G0G1X1".to_owned(), "error:24"),
            29 => ("G33".to_owned(), "error:20"),
            _ => ("(nothing) G4 P0".to_owned(), "ok"),
        };
        sender.send(format!("{line}\n").as_bytes(), answer);
        if number % 400 == 399 {
            sender.machine.send(b"!");
        }
        if number % 1_000 == 999 {
            dropped += sender.reset();
            resets += 1;
        }
    }
    sender.finish();
    let (answered, reports) = (sender.answered, sender.reports);
    assert_eq!(answered + dropped, lines as usize + 2 * resets);
    assert!(reports > lines as usize / 400, "{reports} reports");
    // A report may still be on its way.
    assert_eq!(machine.ask("G90G0X1Y2").last().unwrap(), "ok");
    let status = machine.wait_for_idle();
    assert_eq!(status.xyz(), Some("1.000,2.000,0.000"));
}

#[test]
fn bad_input_gets_one_error_a_line_and_moves_nothing() {
    let Some(mut machine) = Machine::boot() else {
        return;
    };
    let mut random = 0x2545_f491_u32;
    let mut next = move || {
        random ^= random << 13;
        random ^= random >> 17;
        random ^= random << 5;
        random
    };
    let mut lines: Vec<Vec<u8>> = vec![
        vec![b'G'; 10_000],
        b"G1 X1 \0 Q F100".to_vec(),
        b"G1X1000000000000000000000000F100".to_vec(),
        b"G1X9999999999F100".to_vec(),
        "G1 Xé F100Ü".as_bytes().to_vec(),
        b"$=1".to_vec(),
        b"$999=1".to_vec(),
        b"$100=-1".to_vec(),
        b"$100=nan".to_vec(),
        b"G2X1Y1".to_vec(),
    ];
    for _ in 0..rounds(2_000) {
        let length = next() % 100;
        // `Q` makes the line an error whatever else it says; realtime bytes would not be part of the line.
        let bytes = (0..length).map(|_| next() as u8);
        let plain = bytes.filter(|byte| !b"?!~\x18\x84\r\n;()".contains(byte));
        lines.push([b"Q".to_vec(), plain.collect()].concat());
    }
    for line in lines {
        machine.send(&line);
        let answer = machine.ask("");
        let shown = String::from_utf8_lossy(&line[..line.len().min(80)]).into_owned();
        assert!(answer[0].starts_with("error:"), "{answer:?} for {shown:?}");
        assert_eq!(answer.len(), 1, "{answer:?} for {shown:?}");
    }
    let status = machine.wait_for_idle();
    assert_eq!(status.xyz(), Some("0.000,0.000,0.000"));
    assert_eq!(machine.ask(""), ["ok"]);
}

#[test]
fn flash_that_is_written_full_keeps_the_newest() {
    let Some(mut machine) = Machine::boot() else {
        return;
    };
    for number in 1..=300 {
        assert_eq!(machine.ask(&format!("$110={number}")), ["ok"]);
    }
    machine.memory.reset_chip();
    machine.wait_for_welcome();
    assert!(machine.ask("$$").contains(&"$110=300.000".to_owned()));
}
