//! What does not wait for the lines before it: emergencies and realtime bytes.

use leadscrew::model::State;

use crate::host::{Host, STEPS_PER_MM, numbered};

const KILLED: &str = "Error:Printer halted. kill() called!";

#[test]
fn m112_stops_the_machine_in_front_of_the_lines_that_wait() {
    for kill in [
        "M112".to_owned(),
        "  m112 ".to_owned(),
        numbered(77, "M112"),
    ] {
        let mut host = Host::new();
        host.ask("G0 X1 F6000");
        for x in 0..40 {
            host.receive(format!("G1 X{} F600\n", x % 2 * 50).as_bytes());
        }
        host.run_ms(50);
        host.lines();
        host.receive(format!("{kill}\n").as_bytes());
        host.run_ms(1000);
        assert_eq!(host.lines(), [KILLED], "{kill}");
        assert_eq!(host.state(), State::Alarm);
        let stopped = host.xy();
        assert!(stopped[0] < 6 * STEPS_PER_MM, "{stopped:?}");
        // Every line is answered, and none is executed.
        assert_eq!(host.ask("G1 X3"), [KILLED, "ok"]);
        assert_eq!(
            host.ask("$X"),
            ["echo:error 9: locked by an alarm or a jog", "ok"]
        );
        assert_eq!(host.ask("M105"), ["ok T:0.0 /0.0"]);
        assert_eq!(host.xy(), stopped);
        let answer = host.ask("M999");
        assert_eq!(answer[..2], ["ok", "start"], "{answer:?}");
        host.run_ms(50);
        assert_eq!(host.state(), State::Idle);
        assert_eq!(host.ask("G1 X3 F6000"), ["ok"]);
        // The position is the true one: it braked within the limits.
        assert_eq!(host.xy()[0], 3 * STEPS_PER_MM);
    }
}

#[test]
fn a_damaged_m112_is_none() {
    let good = numbered(1, "M110 N0");
    let mut host = Host::new();
    host.ask(&good);
    for line in ["N1 M112*33", "N1 M112", "M1120", "M112*4"] {
        let answer = host.ask(line);
        assert_eq!(answer.last().map(String::as_str), Some("ok"), "{line}");
        assert_eq!(host.state(), State::Idle, "{line}");
    }
}

#[test]
fn m410_stops_and_keeps_the_position_and_the_lines_behind_it() {
    let mut host = Host::new();
    host.receive(b"M3 S100\nG91\nG90\nG1 X50 F600\nG1 Y50\n");
    host.run_ms(300);
    host.receive(b"M410\nG1 X1 Y1\n");
    host.rest();
    host.run_ms(100);
    let answers = host.lines();
    assert_eq!(answers, ["ok"; 7], "{answers:?}");
    assert_eq!(host.state(), State::Idle);
    assert_eq!(host.xy(), [STEPS_PER_MM; 2]);
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
        let mut host = Host::new();
        host.receive(format!("{line}\n").as_bytes());
        host.rest();
        host.run_ms(100);
        let answers = host.lines();
        let oks = answers.iter().filter(|answer| answer.starts_with("ok"));
        assert_eq!(oks.count(), 1, "{line:?}: {answers:?}");
        host.receive(b"G1 X1 F6000\n");
        host.rest();
        assert_eq!(host.lines(), ["ok"], "{line:?}");
        assert_eq!(host.xy()[0], STEPS_PER_MM, "{line:?}");
    }
}

#[test]
fn an_emergency_whose_line_comes_in_two_pieces_is_answered_once() {
    let line = "M410 ; stop\n";
    // The receiver releases the session at each 256th byte, wherever that is in a line.
    for behind in 1..line.len() {
        let mut host = Host::new();
        let comment = format!(";{}\n", "-".repeat(254 - behind));
        host.receive(format!("{comment}{line}G1 X1 F6000\n").as_bytes());
        host.rest();
        host.run_ms(100);
        assert_eq!(host.lines(), ["ok", "ok"], "{behind}");
        assert_eq!(host.xy()[0], STEPS_PER_MM, "{behind}");
    }
}

#[test]
fn m108_and_m24_go_on_after_a_pause() {
    for (pause, start) in [("M0", "M108"), ("M25", "M24"), ("M226", "m24 ; go on")] {
        let mut host = Host::new();
        host.receive(format!("G1 X1 F6000\n{pause}\nG1 X2\n").as_bytes());
        host.run_ms(2500);
        assert_eq!(host.xy()[0], STEPS_PER_MM);
        let answers = host.lines();
        assert_eq!(answers, ["ok", "echo:busy: paused for user"]);
        host.receive(format!("{start}\n").as_bytes());
        host.run_ms(500);
        assert_eq!(host.lines(), ["ok"; 3], "{start}");
        assert_eq!(host.xy()[0], 2 * STEPS_PER_MM);
    }
}

#[test]
fn realtime_bytes_count_only_behind_a_line_end_or_silence() {
    let mut host = Host::new();
    // Part of a line: a hold, a reset, a report and coolant, if they counted.
    assert_eq!(host.ask("M117 Done! ~?\u{18}"), ["ok"]);
    host.receive(b"M117 \xa0\xa1\x84\x85\n");
    host.rest();
    assert_eq!(host.lines(), ["ok"]);
    assert_eq!(host.state(), State::Idle);
    // Directly behind a line end.
    host.receive(b"?");
    host.run_ms(20);
    assert!(host.lines()[0].starts_with("<Idle|"));
    host.receive(b"G1 X10 F600\n!");
    host.run_ms(200);
    assert_eq!(host.state(), State::HoldComplete);
    host.receive(b"??~");
    host.run_ms(20);
    assert_eq!(host.state(), State::Run);
    host.rest();
    host.lines();
    // In a line that is not finished, after silence: the line is as it was.
    host.receive(b"G1 X");
    host.run_ms(90);
    host.receive(b"!");
    host.run_ms(30);
    assert_eq!(host.state(), State::Idle);
    host.receive(b"\n");
    host.rest();
    assert_eq!(
        host.lines()[0],
        "Error:a word must begin with a letter (error:1)"
    );
    host.receive(b"G1 X");
    host.run_ms(150);
    host.receive(b"?");
    host.run_ms(20);
    assert!(host.lines()[0].starts_with("<Idle|"));
    host.receive(b"12 F6000\n");
    host.rest();
    assert_eq!(host.lines(), ["ok"]);
    assert_eq!(host.xy()[0], 12 * STEPS_PER_MM);
}

#[test]
fn a_soft_limit_is_answered_and_m999_goes_on() {
    let mut host = Host::with(&["22=1", "20=1", "788=7", "130=100", "131=100", "132=100"]);
    host.ask("$H");
    let answer = host.ask("G1 X200 F6000");
    let alarm = "Error:Printer stopped due to errors. the target is outside the machine's travel \
                 (ALARM:2); M999 to go on";
    assert_eq!(answer, [alarm, alarm, "ok"]);
    assert_eq!(host.ask("G1 X-1"), [alarm, "ok"]);
    let answer = host.ask("M999");
    assert_eq!(answer[..2], ["ok", "start"], "{answer:?}");
    host.run_ms(50);
    assert_eq!(host.ask("G1 X-5 F6000"), ["ok"]);
}

#[test]
fn a_machine_asleep_answers_each_line_and_m999_wakes_it() {
    let asleep = "Error:Printer stopped due to errors. It sleeps; M999 to go on";
    for waking in ["M999".to_owned(), numbered(3, "M999"), "\x18".to_owned()] {
        let mut host = Host::new();
        assert_eq!(host.ask("$SLP"), ["ok", "[MSG:Sleeping]"]);
        host.receive(b"G1 X1\nM105\n");
        host.receive(format!("{}\n$$\n", numbered(1, "G28")).as_bytes());
        host.rest();
        assert_eq!(host.lines(), [asleep, "ok"].repeat(4));
        // Numbers count as ever.
        assert_eq!(host.ask(&numbered(1, "M400"))[1], "Resend: 2");
        assert_eq!(host.ask(&numbered(2, "M400")), [asleep, "ok"]);
        assert_eq!(host.state(), State::Sleep);
        host.receive(format!("{waking}\n").as_bytes());
        host.run_ms(50);
        assert!(host.lines().contains(&"start".to_owned()), "{waking:?}");
        assert_eq!(host.ask("M999").first().map(String::as_str), Some("ok"));
        host.run_ms(50);
        host.lines();
        assert_eq!(host.ask("G1 X1 F3000"), ["ok"]);
        assert_eq!(host.xy(), [STEPS_PER_MM, 0]);
    }
}

/// A machine in motion whose host has sent so many bytes ahead, and then these.
fn sent_ahead(bytes: usize, then: &str) -> Host {
    let mut host = Host::new();
    host.receive(b"G1 X50 F60\nM400\n");
    host.run_ms(200);
    assert_eq!(host.lines(), ["ok"]);
    host.receive(&b" ".repeat(bytes % 6));
    host.receive(&b"G1 Y1\n".repeat(bytes / 6));
    host.receive(then.as_bytes());
    host
}

#[test]
fn a_full_queue_holds_up_no_emergency_and_no_realtime_byte() {
    let kills = ["M112", " m112", &numbered(77, "M112")];
    for (bytes, kill) in (700..1100).step_by(7).zip(kills.into_iter().cycle()) {
        let mut host = sent_ahead(bytes, &format!("{kill}\r\n"));
        host.run_ms(1000);
        assert_eq!(host.lines(), [KILLED], "{bytes}");
        assert_eq!(host.state(), State::Alarm, "{bytes}");
        assert_eq!(host.xy()[1], 0, "{bytes}");
    }
    let mut host = sent_ahead(5000, "G1 X1\n!");
    host.run_ms(200);
    assert_eq!(host.state(), State::HoldComplete);
    host.receive(b"?");
    host.run_ms(20);
    assert!(host.lines().iter().any(|line| line.starts_with("<Hold:0|")));
    host.receive(b"~");
    host.run_ms(20);
    assert_eq!(host.state(), State::Run);
    host.receive(b"\x91");
    host.run_ms(20);
    assert_eq!(host.simulator.snapshot().overrides.feed, 110);
    host.receive(b"\x18");
    host.run_ms(1000);
    let told = host.lines();
    assert!(told.contains(&"start".to_owned()), "{told:?}");
    let mut host = sent_ahead(5000, "M410\n");
    host.run_ms(1000);
    assert!(host.xy()[0] < 2 * STEPS_PER_MM, "{:?}", host.xy());
}

#[test]
fn a_pause_goes_on_by_m108_behind_a_full_queue() {
    let mut host = Host::new();
    host.receive(b"M0\n");
    host.run_ms(100);
    host.receive(&b"G1 Y1\n".repeat(200));
    assert_eq!(host.state(), State::HoldComplete);
    host.receive(b"M108\n");
    host.run_ms(500);
    assert_eq!(host.xy()[1], STEPS_PER_MM);
}

#[test]
fn in_a_lost_line_realtime_bytes_and_parts_of_codes_are_text() {
    for rest in [
        "G1 X1!~?\n",
        "M117 M112\n",
        "M1120\n",
        "M11\n2\n",
        "(M112)\n",
        "N1 M112*33\n",
        "X\u{18}\n",
        "M118 !",
    ] {
        let mut host = sent_ahead(5000, rest);
        host.run_ms(80);
        assert_eq!(host.state(), State::Run, "{rest}");
        assert!(host.lines().is_empty(), "{rest}");
        // After silence a realtime byte counts anywhere.
        host.run_ms(100);
        host.receive(b"!");
        host.run_ms(200);
        assert_eq!(host.state(), State::HoldComplete, "{rest}");
    }
}

#[test]
fn realtime_bytes_take_no_room_from_lines() {
    let mut host = Host::new();
    host.receive(
        b"G4 S60
",
    );
    for _ in 0..2000 {
        host.receive(b"?");
        host.run_ms(20);
    }
    let reports = host.lines();
    let told = reports.iter().filter(|line| line.starts_with("<Idle|"));
    assert_eq!(told.count(), 2000);
    for y in 1..70 {
        host.receive(
            format!(
                "G1 Y{y}
"
            )
            .as_bytes(),
        );
    }
    assert_eq!(host.simulator.lost(), 0);
    host.rest();
    assert_eq!(host.xy(), [0, 69 * STEPS_PER_MM]);
    let told = host.lines();
    assert_eq!(told.iter().filter(|line| *line == "ok").count(), 70);
}

#[test]
fn a_host_that_sends_too_much_loses_whole_lines_alone() {
    let mut host = Host::new();
    host.receive(b"G4 S1\n");
    for y in 1..500 {
        host.receive(format!("G1 Y{y} F6000\n").as_bytes());
    }
    host.rest();
    let told = host.lines();
    assert!(told.iter().all(|line| line == "ok"));
    // Every line that was not lost has been executed as it was.
    let executed = i32::try_from(told.len()).unwrap() - 1;
    assert!(executed > 50, "{executed}");
    assert_eq!(host.xy(), [0, executed * STEPS_PER_MM]);
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
            let mut host = Host::with(&["782=0"]);
            host.receive(b"M0\n");
            host.run_ms(20);
            // As fast as at 115 200 baud.
            for bytes in line.as_bytes().chunks(11) {
                host.receive(bytes);
                host.run_ms(1);
            }
            host.receive(end.as_bytes());
            if end.is_empty() {
                // In silence it counts in the line that has no end.
                host.run_ms(150);
                host.receive(b"?~\n");
            }
            host.receive(start.as_bytes());
            host.run_ms(200);
            let mut told = host.lines();
            told.retain(|line| !line.starts_with('<'));
            // The line of `M108` itself began where lines are lost.
            assert_eq!(told, [&["ok"], answer].concat(), "{start}");
            assert_eq!(host.simulator.lost(), 0);
            assert_eq!(host.xy(), [0, 0]);
            assert_eq!(host.ask("G1 X1 F6000"), ["ok"]);
        }
    }
}
