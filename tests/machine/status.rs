//! `?` is answered within 5 ms, whatever the machine does.

use leadscrew::{
    axis::{AXES, X},
    model::{Levels, State},
    settings::{Settings, assign},
    sim::{Closes, Simulator, Switch},
    units::{TICKS_PER_MS, TICKS_PER_SECOND},
};

/// Time of a byte on the line at 115 200 baud, ticks.
const BYTE_TICKS: u64 = TICKS_PER_SECOND as u64 * 10 / 115_200;

/// A machine behind a serial line on which bytes take their time.
struct Machine {
    simulator: Box<Simulator>,
    /// Time at which the line to the sender is free again.
    free: u64,
    received: Vec<(u64, u8)>,
}

impl Machine {
    fn new(assignments: &[&str]) -> Self {
        let mut settings = Settings::default();
        for assignment in assignments {
            assign(&mut settings, assignment.as_bytes()).expect(assignment);
        }
        let mut machine = Self {
            simulator: Box::new(Simulator::new(&settings)),
            free: 0,
            received: Vec::new(),
        };
        machine.run(100);
        machine
    }

    /// Runs for so many milliseconds.
    fn run(&mut self, milliseconds: u32) {
        let end = self.simulator.now() + u64::from(milliseconds) * u64::from(TICKS_PER_MS);
        self.run_until(end);
    }

    fn run_until(&mut self, end: u64) {
        self.simulator.settle();
        loop {
            let now = self.simulator.now();
            if now >= self.free
                && let Some(byte) = self.simulator.send()
            {
                self.received.push((now, byte));
                self.free = now + BYTE_TICKS;
                self.simulator.settle();
            }
            if now >= end {
                return;
            }
            let mut next = self.simulator.due().unwrap_or(end).min(end);
            if self.simulator.has_to_send() {
                next = next.min(self.free);
            }
            let _ = self.simulator.advance(next.max(now));
        }
    }

    /// Sends bytes as fast as the line takes them.
    fn send(&mut self, text: &[u8]) {
        for &byte in text {
            self.run_until(self.simulator.now() + BYTE_TICKS);
            self.simulator.receive(byte);
        }
    }

    /// Asks for a report, and gives its state and how long its first byte took, ms.
    fn ask(&mut self) -> (String, f64) {
        // Everything sent before has left the machine: the time is that of the report alone.
        while self.simulator.has_to_send() {
            self.run(1);
        }
        self.run(1);
        self.received.clear();
        let asked = self.simulator.now();
        self.simulator.receive(b'?');
        self.run(20);
        let begin = self.received.iter().position(|(_, byte)| *byte == b'<');
        let begin = begin.expect("no report within 20 ms");
        let text = self.received.iter().skip(begin + 1).map(|(_, byte)| *byte);
        let state: Vec<u8> = text.take_while(|byte| *byte != b'|').collect();
        let took = self.received[begin].0 - asked;
        (
            String::from_utf8(state).expect("ASCII"),
            took as f64 / f64::from(TICKS_PER_MS),
        )
    }

    /// Sends bytes, and what the report after them shows behind the speeds.
    fn extra_after(&mut self, bytes: &[u8]) -> String {
        self.send(bytes);
        self.run(150);
        let _ = self.ask();
        let text: Vec<u8> = self.received.iter().map(|(_, byte)| *byte).collect();
        let text = String::from_utf8(text).expect("ASCII");
        let fields = text
            .trim_end()
            .trim_start_matches('<')
            .trim_end_matches('>');
        fields.split('|').skip(3).collect::<Vec<_>>().join("|")
    }

    /// Asks again and again, at odd times, while the machine is in a state.
    fn asks(&mut self, state: &str) {
        for pause in [0, 1, 3, 7, 2] {
            let (found, took_ms) = self.ask();
            assert_eq!(found, state);
            assert!(took_ms <= 5.0, "{state}: {took_ms} ms");
            self.run(pause);
        }
    }
}

#[test]
fn a_report_comes_within_5_ms_in_every_state_of_a_program() {
    let mut machine = Machine::new(&["110=6000", "120=100"]);
    machine.asks("Idle");
    // More moves than the look-ahead and the queues hold, and bytes behind them.
    let lines = (1..=160).map(|k| format!("G1X{k}F600\n"));
    let lines = lines.collect::<Vec<_>>().concat();
    let many = lines.len();
    for (sent, byte) in lines.bytes().enumerate() {
        if machine.simulator.received_free() < 2 {
            assert!(sent < many, "the look-ahead is never full");
            break;
        }
        machine.send(&[byte]);
    }
    assert_eq!(machine.simulator.snapshot().blocks_free, 0);
    machine.asks("Run");
    machine.send(b"!");
    machine.run(1500);
    machine.asks("Hold:0");
    machine.send(b"\x84");
    machine.run(500);
    machine.asks("Door:0");
    machine.send(b"\x18");
    machine.run(200);
    machine.asks("Idle");
    machine.send(b"G4P2\n");
    machine.run(100);
    machine.asks("Idle");
    machine.run(2000);
    machine.send(b"M0\n");
    machine.run(100);
    machine.asks("Hold:0");
    machine.send(b"~");
    machine.run(100);
    machine.send(b"$J=G91X-50F300\n");
    machine.run(300);
    machine.asks("Jog");
    machine.send(b"\x18");
    machine.run(500);
    machine.asks("Alarm");
}

#[test]
fn a_report_comes_within_5_ms_while_homing_checking_and_asleep() {
    let mut machine = Machine::new(&["22=1"]);
    for axis in 0..AXES.min(3) {
        assert!(machine.simulator.mount(Switch {
            axis,
            closes: Closes::From(2000),
            input: Levels::limits(1 << axis),
        }));
    }
    machine.asks("Alarm");
    machine.send(b"$H\n");
    machine.run(50);
    while machine.simulator.snapshot().state == State::Home {
        let (state, took_ms) = machine.ask();
        if machine.simulator.snapshot().state == State::Home {
            assert_eq!(state, "Home");
        }
        assert!(took_ms <= 5.0, "{took_ms} ms");
        machine.run(97);
    }
    machine.asks("Idle");
    machine.send(b"$C\n");
    machine.run(50);
    machine.asks("Check");
    machine.send(b"$C\n");
    machine.run(200);
    machine.send(b"$SLP\n");
    machine.run(50);
    machine.asks("Sleep");
}

#[test]
fn a_report_comes_within_5_ms_after_an_alarm_that_only_a_reset_ends() {
    let mut machine = Machine::new(&["21=1", "22=1", "20=1"]);
    machine.send(b"$X\nG0X10\n");
    machine.run(500);
    machine.asks("Alarm");
    assert!(machine.simulator.snapshot().is_critical);
    machine.send(b"\x18");
    machine.run(200);
    machine.send(b"$X\nG0X-10\n");
    machine.run(100);
    machine.simulator.set_pin(Levels::limits(1 << X), true);
    machine.run(100);
    machine.asks("Alarm");
    assert!(machine.simulator.snapshot().is_critical);
}

#[test]
fn a_limit_switch_is_guarded_before_the_first_motion() {
    let mut machine = Machine::new(&["21=1"]);
    machine.simulator.set_pin(Levels::limits(1 << X), true);
    machine.run(100);
    machine.asks("Alarm");
    assert!(machine.simulator.snapshot().is_critical);
}

#[test]
fn spindle_coolant_and_overrides_are_shown_after_each_command_to_them() {
    const OVERRIDES: &str = "Ov:100,100,100";
    const OFFSET: &str = "WCO:0.000,0.000,0.000";
    let mut machine = Machine::new(&["32=1"]);
    for (bytes, shown) in [
        (&b""[..], OFFSET),
        (b"", OVERRIDES),
        (b"", ""),
        // Changed and back again, between two reports.
        (b"\x93\x94", OVERRIDES),
        (b"\x90", ""),
        (b"\x9a", "Ov:100,100,110"),
        (b"\x99", OVERRIDES),
        (b"\x95", ""),
        // The door switches off what is off.
        (b"\x84", OVERRIDES),
        (b"\x84", ""),
        (b"\x91\x92", OFFSET),
        (b"~", OVERRIDES),
        (b"$C\n", ""),
        (b"M2\n", ""),
        (b"$C\n", OFFSET),
        (b"", OVERRIDES),
        (b"M2\n", OFFSET),
        (b"", OVERRIDES),
        (b"$SLP\n", OVERRIDES),
        (b"", ""),
    ] {
        let found = machine.extra_after(bytes);
        // Of the first three axes.
        let found = found.replace(&format!("{OFFSET}{}", ",0.000".repeat(AXES - 3)), OFFSET);
        let text = String::from_utf8_lossy(bytes);
        assert_eq!(found, shown, "after {text:?}");
    }
}

#[test]
fn what_a_line_switches_is_shown_once_it_is_switched() {
    let mut machine = Machine::new(&["110=6000", "120=100"]);
    for _ in 0..2 {
        let _ = machine.extra_after(b"");
    }
    assert_eq!(machine.extra_after(b"G1X5F600\n"), "");
    assert_eq!(machine.extra_after(b"M3S500\n"), "");
    machine.run(1000);
    assert_eq!(machine.extra_after(b""), "Ov:100,100,100|A:S");
    assert_eq!(machine.extra_after(b""), "");
}
