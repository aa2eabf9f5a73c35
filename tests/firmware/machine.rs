//! The emulated board with the firmware running, and its serial line.

use std::{
    env,
    io::{BufRead, BufReader, Write},
    path::Path,
    process::{Child, Command, Stdio},
    sync::mpsc::{Receiver, channel},
    thread,
    time::{Duration, Instant},
};

use grbl_client::Report;

use crate::memory::Memory;

/// Longest time for an answer before the machine counts as dead.
pub(crate) const TIMEOUT: Duration = Duration::from_mins(1);
pub(crate) const RESET: &[u8] = b"\x18";

/// The emulated board with the firmware running.
pub(crate) struct Machine {
    qemu: Child,
    pub(crate) lines: Receiver<String>,
    pub(crate) memory: Memory,
    /// Lines that have come.
    received: Vec<String>,
}

impl Machine {
    /// Boots; the welcome has been read.
    pub(crate) fn boot() -> Option<Self> {
        Self::boot_image("FIRMWARE_ELF")
    }

    /// The same as [`Machine::boot`], with the image that an environment variable names.
    pub(crate) fn boot_image(variable: &str) -> Option<Self> {
        let mut machine = Self::start(variable, &[])?;
        machine.wait_for_welcome();
        Some(machine)
    }

    /// Starts a machine with the image that an environment variable names, and more options for QEMU.
    pub(crate) fn start(variable: &str, options: &[String]) -> Option<Self> {
        let Some(elf) = env::var_os(variable) else {
            eprintln!("skipped: {variable} is not set, `cargo xtask test` sets it");
            return None;
        };
        let memory = Memory::of(Path::new(&elf));
        let mut qemu = Command::new("qemu-system-arm")
            .args(["-M", "netduinoplus2", "-nographic", "-monitor", "none"])
            .args(["-serial", "stdio", "-gdb", &memory.listen()])
            .args(options)
            .arg("-kernel")
            .arg(&elf)
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
        Some(Self {
            qemu,
            lines,
            memory,
            received: Vec::new(),
        })
    }

    /// Boots a machine with fast axes and 30 mm of travel.
    pub(crate) fn boot_small() -> Option<Self> {
        let mut machine = Self::boot()?;
        machine.make_fast();
        machine.set(&["$130=30", "$131=30", "$132=30", "$10=1"]);
        Some(machine)
    }

    pub(crate) fn send(&mut self, bytes: &[u8]) {
        let input = self.qemu.stdin.as_mut().unwrap();
        input.write_all(bytes).unwrap();
        input.flush().unwrap();
    }

    /// The next line that is not empty.
    pub(crate) fn receive(&mut self) -> String {
        loop {
            let line = self.lines.recv_timeout(TIMEOUT);
            let Ok(line) = line else {
                panic!("the firmware is silent after {:?}", self.received);
            };
            if !line.is_empty() {
                self.received.push(line.clone());
                return line;
            }
        }
    }

    pub(crate) fn wait_for_welcome(&mut self) {
        while self.receive() != "Grbl 1.1h ['$' for help]" {}
    }

    /// Sends one line; what comes back up to its answer.
    pub(crate) fn ask(&mut self, line: &str) -> Vec<String> {
        self.send(format!("{line}\n").as_bytes());
        let mut received = vec![self.receive()];
        while !is_answer(received.last().unwrap()) {
            received.push(self.receive());
        }
        received
    }

    /// A status report; answers in between are lost.
    pub(crate) fn status(&mut self) -> Report {
        self.send(b"?");
        loop {
            if let Some(report) = Report::read(&self.receive()) {
                return report;
            }
        }
    }

    /// Waits until the machine is idle; its last report.
    pub(crate) fn wait_for_idle(&mut self) -> Report {
        loop {
            let status = self.status();
            assert_ne!(status.state, "Alarm");
            if status.state == "Idle" {
                return status;
            }
            thread::sleep(Duration::from_millis(20));
        }
    }

    /// Asks for reports until one has this state.
    pub(crate) fn wait_for(&mut self, state: &str) {
        self.wait_until(|status| status.state == state);
    }

    /// Asks for reports until one has a field whose value begins so.
    pub(crate) fn wait_for_field(&mut self, name: &str, beginning: &str) {
        self.wait_until(|status| {
            let value = status.field(name);
            value.is_some_and(|value| value.starts_with(beginning))
        });
    }

    fn wait_until(&mut self, is_expected: impl Fn(&Report) -> bool) {
        let start = Instant::now();
        loop {
            let status = self.status();
            if is_expected(&status) {
                return;
            }
            assert!(start.elapsed() < TIMEOUT, "{status:?}");
            thread::sleep(Duration::from_millis(5));
        }
    }

    /// Sends lines that are accepted.
    pub(crate) fn set(&mut self, lines: &[&str]) {
        for line in lines {
            assert_eq!(self.ask(line), ["ok"], "{line}");
        }
    }

    /// Ends an alarm.
    pub(crate) fn unlock(&mut self) {
        assert_eq!(self.ask("$X"), ["[MSG:Caution: Unlocked]", "ok"]);
    }

    /// Fast axes, so that motion takes little of the emulator's time.
    pub(crate) fn make_fast(&mut self) {
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

pub(crate) fn is_answer(line: &str) -> bool {
    line == "ok" || line.starts_with("error:")
}
