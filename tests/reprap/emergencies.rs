//! What does not wait for the lines before it: emergencies and realtime bytes.

use grbl_client::Report;
use leadscrew::model::State;

use crate::{
    machine::{STEPS_PER_MM, numbered, reprap, reprap_with, xy},
    support::Machine,
};

const KILLED: &str = "Error:Printer halted. kill() called!";

#[test]
fn m112_stops_the_machine_in_front_of_the_lines_that_wait() {
    for kill in [
        "M112".to_owned(),
        "  m112 ".to_owned(),
        numbered(77, "M112"),
    ] {
        let mut machine = reprap();
        machine.ask("G0 X1 F6000");
        for x in 0..40 {
            machine.send(format!("G1 X{} F600\n", x % 2 * 50));
        }
        machine.run(50);
        machine.lines();
        machine.send_for(format!("{kill}\n"), 1000);
        assert_eq!(machine.lines(), [KILLED], "{kill}");
        assert_eq!(machine.state(), State::Alarm);
        let stopped = xy(&machine);
        assert!(stopped[0] < 6 * STEPS_PER_MM, "{stopped:?}");
        // Every line is answered, and none is executed.
        assert_eq!(machine.ask("G1 X3"), [KILLED, "ok"]);
        assert_eq!(
            machine.ask("$X"),
            ["echo:error 9: locked by an alarm or a jog", "ok"]
        );
        assert_eq!(machine.ask("M105"), ["ok T:0.0 /0.0"]);
        assert_eq!(xy(&machine), stopped);
        let answer = machine.ask("M999");
        assert_eq!(answer[..2], ["ok", "start"], "{answer:?}");
        machine.run(50);
        assert_eq!(machine.state(), State::Idle);
        assert_eq!(machine.ask("G1 X3 F6000"), ["ok"]);
        // The position is the true one: it braked within the limits.
        assert_eq!(xy(&machine)[0], 3 * STEPS_PER_MM);
    }
}

#[test]
fn a_damaged_m112_is_none() {
    let good = numbered(1, "M110 N0");
    let mut machine = reprap();
    machine.ask(&good);
    for line in ["N1 M112*33", "N1 M112", "M1120", "M112*4"] {
        let answer = machine.ask(line);
        assert_eq!(answer.last().map(String::as_str), Some("ok"), "{line}");
        assert_eq!(machine.state(), State::Idle, "{line}");
    }
}

#[test]
fn m410_stops_and_keeps_the_position_and_the_lines_behind_it() {
    let mut machine = reprap();
    machine.send_for(b"M3 S100\nG91\nG90\nG1 X50 F600\nG1 Y50\n", 300);
    machine.send(b"M410\nG1 X1 Y1\n");
    machine.run_to_standstill();
    machine.run(100);
    let answers = machine.lines();
    assert_eq!(answers, ["ok"; 7], "{answers:?}");
    assert_eq!(machine.state(), State::Idle);
    assert_eq!(xy(&machine), [STEPS_PER_MM; 2]);
}

#[test]
fn an_emergency_that_is_refused_for_its_words_is_answered_once() {
    for line in [
        "M410\x0b",
        "M410 =",
        "M410 X",
        "M410 G1 X1",
        "M108\x01",
        "M24 =",
    ] {
        let mut machine = reprap();
        machine.send(format!("{line}\n"));
        machine.run_to_standstill();
        machine.run(100);
        let answers = machine.lines();
        let oks = answers.iter().filter(|answer| answer.starts_with("ok"));
        assert_eq!(oks.count(), 1, "{line:?}: {answers:?}");
        assert_eq!(machine.answers_to(b"G1 X1 F6000\n"), ["ok"], "{line:?}");
        assert_eq!(xy(&machine)[0], STEPS_PER_MM, "{line:?}");
    }
}

#[test]
fn an_emergency_whose_line_comes_in_two_pieces_is_answered_once() {
    let line = "M410 ; stop\n";
    // The receiver releases the session at each 256th byte, wherever that is in a line.
    for missing in 1..line.len() {
        let mut machine = reprap();
        let comment = format!(";{}\n", "-".repeat(254 - missing));
        machine.send(format!("{comment}{line}G1 X1 F6000\n"));
        machine.run_to_standstill();
        machine.run(100);
        assert_eq!(machine.lines(), ["ok", "ok"], "{missing}");
        assert_eq!(xy(&machine)[0], STEPS_PER_MM, "{missing}");
    }
}

#[test]
fn m108_and_m24_go_on_after_a_pause() {
    for (pause, start) in [("M0", "M108"), ("M25", "M24"), ("M226", "m24 ; go on")] {
        let mut machine = reprap();
        machine.send_for(format!("G1 X1 F6000\n{pause}\nG1 X2\n"), 2500);
        assert_eq!(xy(&machine)[0], STEPS_PER_MM);
        let answers = machine.lines();
        assert_eq!(answers, ["ok", "echo:busy: paused for user"]);
        machine.send_for(format!("{start}\n"), 500);
        assert_eq!(machine.lines(), ["ok"; 3], "{start}");
        assert_eq!(xy(&machine)[0], 2 * STEPS_PER_MM);
    }
}

#[test]
fn realtime_bytes_count_only_after_a_line_end_or_silence() {
    let mut machine = reprap();
    // Part of a line: a hold, a reset, a report and coolant, if they counted.
    assert_eq!(machine.ask("M117 Done! ~?\u{18}"), ["ok"]);
    assert_eq!(machine.answers_to(b"M117 \xa0\xa1\x84\x85\n"), ["ok"]);
    assert_eq!(machine.state(), State::Idle);
    // Directly behind a line end.
    assert_eq!(machine.report().state, "Idle");
    machine.send_for(b"G1 X10 F600\n!", 200);
    assert_eq!(machine.state(), State::HoldComplete);
    machine.send_for(b"??~", 20);
    assert_eq!(machine.state(), State::Run);
    machine.run_to_standstill();
    machine.lines();
    // In a line that is not finished, after silence: the line is as it was.
    machine.send_for(b"G1 X", 90);
    machine.send_for(b"!", 30);
    assert_eq!(machine.state(), State::Idle);
    machine.send(b"\n");
    machine.run_to_standstill();
    assert_eq!(
        machine.lines()[0],
        "Error:a word must begin with a letter (error:1)"
    );
    machine.send_for(b"G1 X", 150);
    assert_eq!(machine.report().state, "Idle");
    assert_eq!(machine.answers_to(b"12 F6000\n"), ["ok"]);
    assert_eq!(xy(&machine)[0], 12 * STEPS_PER_MM);
}

#[test]
fn a_character_at_the_beginning_of_a_line_is_text_and_a_realtime_byte_in_utf_8_none() {
    let mut machine = reprap();
    for text in ["やり直し", "Äb", "— a"] {
        machine.send_for(text.as_bytes(), 50);
        assert_eq!(machine.state(), State::Idle, "{text}");
        machine.send_for(b"\n", 50);
        let answers = machine.answers();
        assert!(answers[0].starts_with("Error:"), "{text}: {answers:?}");
        assert_eq!(
            machine.answers_to(format!("M117 {text}\n")),
            ["ok"],
            "{text}"
        );
        assert_eq!(
            machine.answers_to(format!("G0 X1 ; {text}\n")),
            ["ok"],
            "{text}"
        );
    }
    machine.send_for("\u{84}".as_bytes(), 50);
    assert_eq!(machine.state(), State::DoorClosed);
}

#[test]
fn a_soft_limit_is_answered_and_m999_goes_on() {
    let mut machine = reprap_with(&["22=1", "20=1", "788=7", "130=100", "131=100", "132=100"]);
    machine.ask("$H");
    let answer = machine.ask("G1 X200 F6000");
    let alarm = "Error:Printer stopped due to errors. the target is outside the machine's travel \
                 (ALARM:2); M999 to go on";
    assert_eq!(answer, [alarm, alarm, "ok"]);
    assert_eq!(machine.ask("G1 X-1"), [alarm, "ok"]);
    let answer = machine.ask("M999");
    assert_eq!(answer[..2], ["ok", "start"], "{answer:?}");
    machine.run(50);
    assert_eq!(machine.ask("G1 X-5 F6000"), ["ok"]);
}

#[test]
fn a_machine_asleep_answers_each_line_and_m999_wakes_it() {
    let asleep = "Error:Printer stopped due to errors. It sleeps; M999 to go on";
    for waking in ["M999".to_owned(), numbered(3, "M999"), "\x18".to_owned()] {
        let mut machine = reprap();
        assert_eq!(machine.ask("$SLP"), ["ok", "[MSG:Sleeping]"]);
        machine.send(b"G1 X1\nM105\n");
        assert_eq!(
            machine.answers_to(format!("{}\n$$\n", numbered(1, "G28"))),
            [asleep, "ok"].repeat(4)
        );
        // Numbers count as ever.
        assert_eq!(machine.ask(&numbered(1, "M400"))[1], "Resend: 2");
        assert_eq!(machine.ask(&numbered(2, "M400")), [asleep, "ok"]);
        assert_eq!(machine.state(), State::Sleep);
        machine.send_for(format!("{waking}\n"), 50);
        assert!(machine.lines().contains(&"start".to_owned()), "{waking:?}");
        assert_eq!(machine.ask("M999").first().map(String::as_str), Some("ok"));
        machine.run(50);
        machine.lines();
        assert_eq!(machine.ask("G1 X1 F3000"), ["ok"]);
        assert_eq!(xy(&machine), [STEPS_PER_MM, 0]);
    }
}

/// A machine in motion whose host has sent so many bytes ahead, and then these.
fn sent_ahead(bytes: usize, then: &str) -> Machine {
    let mut machine = reprap();
    machine.send_for(b"G1 X50 F60\nM400\n", 200);
    assert_eq!(machine.lines(), ["ok"]);
    machine.send(b" ".repeat(bytes % 6));
    machine.send(b"G1 Y1\n".repeat(bytes / 6));
    machine.send(then);
    machine
}

#[test]
fn a_full_queue_holds_up_no_emergency_and_no_realtime_byte() {
    let kills = ["M112", " m112", &numbered(77, "M112")];
    for (bytes, kill) in (700..1100).step_by(7).zip(kills.into_iter().cycle()) {
        let mut machine = sent_ahead(bytes, &format!("{kill}\r\n"));
        machine.run(1000);
        assert_eq!(machine.lines(), [KILLED], "{bytes}");
        assert_eq!(machine.state(), State::Alarm, "{bytes}");
        assert_eq!(xy(&machine)[1], 0, "{bytes}");
    }
    let mut machine = sent_ahead(5000, "G1 X1\n!");
    machine.run(200);
    assert_eq!(machine.state(), State::HoldComplete);
    assert_eq!(machine.report().state, "Hold:0");
    machine.send_for(b"~", 20);
    assert_eq!(machine.state(), State::Run);
    machine.send_for(b"\x91", 20);
    assert_eq!(machine.snapshot().overrides.feed, 110);
    machine.send_for(b"\x18", 1000);
    let lines = machine.lines();
    assert!(lines.contains(&"start".to_owned()), "{lines:?}");
    let mut machine = sent_ahead(5000, "M410\n");
    machine.run(1000);
    assert!(xy(&machine)[0] < 2 * STEPS_PER_MM, "{:?}", xy(&machine));
}

#[test]
fn a_pause_goes_on_by_m108_behind_a_full_queue() {
    let mut machine = reprap();
    machine.send_for(b"M0\n", 100);
    machine.send(b"G1 Y1\n".repeat(200));
    assert_eq!(machine.state(), State::HoldComplete);
    machine.send_for(b"M108\n", 500);
    assert_eq!(xy(&machine)[1], STEPS_PER_MM);
}

#[test]
fn in_a_lost_line_realtime_bytes_and_parts_of_codes_are_text() {
    for remainder in [
        "G1 X1!~?\n",
        "M117 M112\n",
        "M1120\n",
        "M11\n2\n",
        "(M112)\n",
        "N1 M112*33\n",
        "X\u{18}\n",
        "M118 !",
    ] {
        let mut machine = sent_ahead(5000, remainder);
        machine.run(80);
        assert_eq!(machine.state(), State::Run, "{remainder}");
        assert!(machine.lines().is_empty(), "{remainder}");
        // After silence a realtime byte counts anywhere.
        machine.run(100);
        machine.send_for(b"!", 200);
        assert_eq!(machine.state(), State::HoldComplete, "{remainder}");
    }
}

#[test]
fn realtime_bytes_take_no_room_from_lines() {
    let mut machine = reprap();
    machine.send(b"G4 S60\n");
    for _ in 0..2000 {
        machine.send_for(b"?", 20);
    }
    let reports = machine.lines();
    let reports = reports.iter().filter_map(|line| Report::read(line));
    assert_eq!(
        reports.filter(|report| report.state == "Idle").count(),
        2000
    );
    for y in 1..70 {
        machine.send(format!("G1 Y{y}\n"));
    }
    assert_eq!(machine.lost(), 0);
    machine.run_to_standstill();
    assert_eq!(xy(&machine), [0, 69 * STEPS_PER_MM]);
    let lines = machine.lines();
    assert_eq!(lines.iter().filter(|line| *line == "ok").count(), 70);
}

#[test]
fn a_host_that_sends_too_much_loses_whole_lines_alone() {
    let mut machine = reprap();
    machine.send(b"G4 S1\n");
    for y in 1..500 {
        machine.send(format!("G1 Y{y} F6000\n"));
    }
    let lines = machine.answers();
    assert!(lines.iter().all(|line| line == "ok"));
    // Every line that was not lost has been executed as it was.
    let executed = i32::try_from(lines.len()).unwrap() - 1;
    assert!(executed > 50, "{executed}");
    assert_eq!(xy(&machine), [0, executed * STEPS_PER_MM]);
}

#[test]
fn a_line_without_an_end_leaves_room_for_emergencies() {
    let too_long = "Error:the line is too long (error:11)";
    let long = format!("G1 X5 (note) {}Y5", "Z0 ".repeat(700));
    for (line, answer) in [
        (long.clone(), &[too_long, "ok"][..]),
        (
            numbered(1, &long),
            &[
                "Error:No Checksum with line number, Last Line: 0",
                "Resend: 1",
                "ok",
            ],
        ),
    ] {
        for (end, start) in [("\n", "M108\n"), ("\n", "~"), ("", "")] {
            let mut machine = reprap_with(&["782=0"]);
            machine.send_for(b"M0\n", 20);
            // As fast as at 115 200 baud.
            for bytes in line.as_bytes().chunks(11) {
                machine.send_for(bytes, 1);
            }
            machine.send(end);
            if end.is_empty() {
                // In silence it counts in the line that has no end.
                machine.run(150);
                machine.send(b"?~\n");
            }
            machine.send_for(start, 200);
            let mut lines = machine.lines();
            lines.retain(|line| !line.starts_with('<'));
            // The line of `M108` itself began where lines are lost.
            assert_eq!(lines, [&["ok"], answer].concat(), "{start}");
            assert_eq!(machine.lost(), 0);
            assert_eq!(xy(&machine), [0, 0]);
            assert_eq!(machine.ask("G1 X1 F6000"), ["ok"]);
        }
    }
}
