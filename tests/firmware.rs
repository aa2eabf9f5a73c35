//! The firmware itself, over its serial line, on the emulated board.
//!
//! `cargo xtask test` builds it and names it in `FIRMWARE_ELF`; without that there is nothing to run.
#![cfg(not(target_os = "none"))]

use std::{
    collections::VecDeque,
    env,
    io::{BufRead, BufReader, Write},
    process::{Child, Command, Stdio},
    sync::mpsc::{Receiver, RecvTimeoutError, channel},
    thread,
    time::{Duration, Instant},
};

/// Longest time for an answer before the machine counts as dead.
const PATIENCE: Duration = Duration::from_secs(20);
/// Bytes on their way unanswered, as senders keep them.
const WINDOW: usize = 127;
const RESET: &[u8] = b"\x18";

/// The emulated board with the firmware running.
struct Machine {
    qemu: Child,
    lines: Receiver<String>,
}

impl Machine {
    /// Boots; the welcome has been read.
    fn boot() -> Option<Self> {
        let Some(elf) = env::var_os("FIRMWARE_ELF") else {
            eprintln!("skipped: FIRMWARE_ELF is not set, `cargo xtask test` sets it");
            return None;
        };
        let mut qemu = Command::new("qemu-system-arm")
            .args(["-M", "netduinoplus2", "-nographic", "-monitor", "none"])
            .args(["-serial", "stdio", "-kernel"])
            .arg(elf)
            .stdin(Stdio::piped())
            .stdout(Stdio::piped())
            .spawn()
            .expect("qemu-system-arm can be started");
        let mut output = BufReader::new(qemu.stdout.take().unwrap());
        let (to_test, lines) = channel();
        thread::spawn(move || {
            let mut line = Vec::new();
            while output.read_until(b'\n', &mut line).is_ok_and(|n| n > 0) {
                let text = String::from_utf8_lossy(&line).trim_end().to_owned();
                line.clear();
                if to_test.send(text).is_err() {
                    return;
                }
            }
        });
        let mut machine = Self { qemu, lines };
        machine.wait_for_welcome();
        Some(machine)
    }

    fn send(&mut self, bytes: &[u8]) {
        let input = self.qemu.stdin.as_mut().unwrap();
        input.write_all(bytes).unwrap();
        input.flush().unwrap();
    }

    /// The next line that is not empty.
    fn receive(&mut self) -> String {
        loop {
            let line = self.lines.recv_timeout(PATIENCE);
            let line = line.expect("the firmware answers in time");
            if !line.is_empty() {
                return line;
            }
        }
    }

    fn wait_for_welcome(&mut self) {
        while self.receive() != "Grbl 1.1h ['$' for help]" {}
    }

    /// Sends one line; what comes back up to its answer.
    fn ask(&mut self, line: &str) -> Vec<String> {
        self.send(format!("{line}\n").as_bytes());
        let mut received = vec![self.receive()];
        while !is_answer(received.last().unwrap()) {
            received.push(self.receive());
        }
        received
    }

    /// A status report; answers in between are lost.
    fn status(&mut self) -> String {
        self.send(b"?");
        loop {
            let line = self.receive();
            if line.starts_with('<') {
                return line;
            }
        }
    }

    /// Waits until the machine is idle; its last report.
    fn wait_for_idle(&mut self) -> String {
        loop {
            let status = self.status();
            assert!(!status.starts_with("<Alarm"), "{status}");
            if status.starts_with("<Idle") {
                return status;
            }
            thread::sleep(Duration::from_millis(20));
        }
    }

    /// Fast axes, so that motion takes little of the emulator's time.
    fn make_fast(&mut self) {
        for axis in 0..3 {
            for (setting, value) in [(100, 80), (110, 6000), (120, 500)] {
                let answer = self.ask(&format!("${}={value}", setting + axis));
                assert_eq!(answer, ["ok"]);
            }
        }
    }
}

impl Drop for Machine {
    fn drop(&mut self) {
        let _ = self.qemu.kill();
        let _ = self.qemu.wait();
    }
}

fn is_answer(line: &str) -> bool {
    line == "ok" || line.starts_with("error:")
}

/// Streams lines and checks that each gets its own answer, in order.
struct Sender<'a> {
    machine: &'a mut Machine,
    /// Length and expected answer of each line that has not been answered.
    unanswered: VecDeque<(usize, &'static str)>,
    answered: usize,
    reports: usize,
    state: String,
    asked: Instant,
}

impl<'a> Sender<'a> {
    fn new(machine: &'a mut Machine) -> Self {
        Self {
            machine,
            unanswered: VecDeque::new(),
            answered: 0,
            reports: 0,
            state: String::new(),
            asked: Instant::now(),
        }
    }

    fn in_flight(&self) -> usize {
        self.unanswered.iter().map(|(length, _)| length).sum()
    }

    /// Sends a line as soon as there is room for it.
    fn send(&mut self, line: &[u8], answer: &'static str) {
        while !self.unanswered.is_empty() && self.in_flight() + line.len() > WINDOW {
            self.listen();
        }
        self.machine.send(line);
        self.unanswered.push_back((line.len(), answer));
    }

    /// Takes one line from the machine; asks for the state ten times a second and resumes when held.
    fn listen(&mut self) {
        if self.asked.elapsed() > Duration::from_millis(100) {
            self.asked = Instant::now();
            self.machine.send(b"?");
        }
        match self.machine.lines.recv_timeout(Duration::from_millis(100)) {
            Ok(line) => self.take(&line),
            Err(RecvTimeoutError::Timeout) => {}
            Err(RecvTimeoutError::Disconnected) => panic!("the emulator has ended"),
        }
        if self.state == "Hold:0" {
            self.state.clear();
            self.machine.send(b"~");
        }
    }

    fn take(&mut self, line: &str) {
        if is_answer(line) {
            let (_, expected) = self.unanswered.pop_front().expect("an answer for a line");
            assert_eq!(line, expected, "line {}", self.answered);
            self.answered += 1;
        } else if let Some(report) = line.strip_prefix('<') {
            self.reports += 1;
            self.state = report.split('|').next().unwrap().into();
        }
    }

    /// Waits until every line has been answered.
    fn finish(&mut self) {
        let start = Instant::now();
        while !self.unanswered.is_empty() {
            self.listen();
            assert!(start.elapsed() < 3 * PATIENCE, "{:?}", self.unanswered);
        }
    }

    /// Resets: answers that are on their way still come, then the welcome, then none of the old.
    /// Returns the number of lines that got no answer.
    fn reset(&mut self) -> usize {
        self.machine.send(RESET);
        loop {
            let line = self.machine.receive();
            if line.starts_with("Grbl") {
                break;
            }
            self.take(&line);
        }
        let dropped = self.unanswered.len();
        self.unanswered.clear();
        self.state.clear();
        // Harmless where nothing is locked; the position is known as soon as the machine stands.
        self.send(b"$X\n", "ok");
        self.send(b"G90\n", "ok");
        dropped
    }
}

#[test]
fn lines_settings_and_queries_are_answered() {
    let Some(mut machine) = Machine::boot() else {
        return;
    };
    assert!(
        machine
            .status()
            .starts_with("<Idle|MPos:0.000,0.000,0.000|")
    );
    assert_eq!(machine.ask("G1X1"), ["error:22"]);
    assert_eq!(machine.ask("G0 X1 ; a comment"), ["ok"]);
    assert_eq!(machine.ask("Q"), ["error:2"]);
    assert_eq!(machine.ask(""), ["ok"]);
    assert!(machine.wait_for_idle().contains("MPos:1.000,0.000,0.000"));
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
    assert!(status.contains("MPos:3.000,4.000,-1.000"), "{status}");
}

#[test]
fn a_reset_in_motion_stops_keeps_the_position_and_locks() {
    let Some(mut machine) = Machine::boot() else {
        return;
    };
    assert_eq!(machine.ask("G1X150F400"), ["ok"]);
    while !machine.status().starts_with("<Run") {}
    machine.send(RESET);
    let mut lines = vec![machine.receive()];
    while !lines.last().unwrap().starts_with("[MSG:") {
        lines.push(machine.receive());
    }
    let expected = [
        "ALARM:3",
        "Grbl 1.1h ['$' for help]",
        "[MSG:'$H'|'$X' to unlock]",
    ];
    assert_eq!(lines, expected);
    assert_eq!(machine.ask("G1X1"), ["error:9"]);
    assert_eq!(machine.ask("$X").last().unwrap(), "ok");
    // The lost part of the move is not made up: a move of nothing leaves the machine where it is.
    assert_eq!(machine.ask("G91G0X0"), ["ok"]);
    let before = machine.wait_for_idle();
    assert_eq!(machine.ask("G91G1X1F100"), ["ok"]);
    let after = machine.wait_for_idle();
    assert!(
        (x_mm(&after) - x_mm(&before) - 1.0).abs() < 0.0011,
        "{before} {after}"
    );
}

/// Machine position of X in a status report.
fn x_mm(status: &str) -> f64 {
    let position = status.split("MPos:").nth(1).unwrap();
    position.split(',').next().unwrap().parse().unwrap()
}

#[test]
fn twenty_thousand_lines_with_holds_resets_and_queries_get_one_answer_each() {
    let Some(mut machine) = Machine::boot() else {
        return;
    };
    machine.make_fast();
    let mut sender = Sender::new(&mut machine);
    let (mut dropped, mut resets) = (0, 0);
    for number in 0..20_000_u32 {
        // Kinds of lines in a pattern that no shift maps onto itself, so a lost or a doubled answer
        // shows up soon.
        let (line, answer) = match number * number % 31 {
            0..=17 => (format!("G1X{}Y{}F3000", number % 7, number % 5), "ok"),
            18..=24 => (String::new(), "ok"),
            25..=27 => ("G1X1Y".to_owned(), "error:2"),
            28 => ("G0G1X1".to_owned(), "error:24"),
            29 => ("G99".to_owned(), "error:20"),
            _ => ("(nothing) G4 P0".to_owned(), "ok"),
        };
        sender.send(format!("{line}\n").as_bytes(), answer);
        if number % 400 == 399 {
            sender.machine.send(b"!");
        }
        if number % 2_000 == 1_999 {
            dropped += sender.reset();
            resets += 1;
        }
    }
    sender.finish();
    let (answered, reports) = (sender.answered, sender.reports);
    assert_eq!(answered + dropped, 20_000 + 2 * resets);
    assert!(reports > 50, "{reports} reports");
    // A report may still be on its way.
    assert_eq!(machine.ask("G90G0X1Y2").last().unwrap(), "ok");
    let status = machine.wait_for_idle();
    assert!(status.contains("MPos:1.000,2.000,0.000"), "{status}");
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
    for _ in 0..2_000 {
        let length = next() % 100;
        // `Q` makes it an error whatever else it says; realtime bytes would not be part of it.
        let bytes = (0..length).map(|_| next() as u8);
        let plain = bytes.filter(|byte| !b"?!~\x18\r\n;()".contains(byte));
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
    assert!(status.contains("MPos:0.000,0.000,0.000"), "{status}");
    assert_eq!(machine.ask(""), ["ok"]);
}
