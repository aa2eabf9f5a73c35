//! The emulated board with the firmware running, and its serial line.

use std::{
    env,
    fmt::Debug,
    io::{BufRead, BufReader, Write},
    path::Path,
    process::{Child, Command, Stdio},
    sync::mpsc::{Receiver, channel},
    thread,
    time::{Duration, Instant},
};

use grbl_client::Report;

use crate::memory::Memory;

/// Longest wait for anything before the machine counts as dead.
pub(crate) const TIMEOUT: Duration = Duration::from_mins(1);
/// Longest wait for its next line.
const SILENCE: Duration = Duration::from_secs(20);
pub(crate) const RESET: &[u8] = b"\x18";
/// What the firmware says as soon as it can take lines.
pub(crate) const WELCOME: &str = "Grbl 1.1h ['$' for help]";

/// Polls until the awaited result is there.
pub(crate) fn wait_for<T, E: Debug>(mut poll: impl FnMut() -> Result<T, E>) -> T {
    let start = Instant::now();
    loop {
        match poll() {
            Ok(found) => return found,
            Err(other) => assert!(
                start.elapsed() < TIMEOUT,
                "still {other:?} after {TIMEOUT:?}"
            ),
        }
    }
}

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
            let line = self.lines.recv_timeout(SILENCE);
            let Ok(line) = line else {
                panic!(
                    "the firmware is silent for {SILENCE:?} after {:?}",
                    self.received
                );
            };
            if !line.is_empty() {
                self.received.push(line.clone());
                return line;
            }
        }
    }

    /// The next lines, up to one that is waited for.
    pub(crate) fn receive_until(&mut self, is_last: impl Fn(&str) -> bool) -> Vec<String> {
        let mut lines = Vec::new();
        wait_for(|| {
            lines.push(self.receive());
            let last = lines.last().filter(|line| !is_last(line));
            last.map_or(Ok(()), |other| Err(other.clone()))
        });
        lines
    }

    pub(crate) fn wait_for_welcome(&mut self) {
        self.receive_until(|line| line == WELCOME);
    }

    /// Sends one line; what comes back up to its answer.
    pub(crate) fn ask(&mut self, line: &str) -> Vec<String> {
        self.send(format!("{line}\n").as_bytes());
        self.receive_until(is_answer)
    }

    /// A status report; answers in between are lost.
    pub(crate) fn status(&mut self) -> Report {
        self.send(b"?");
        wait_for(|| {
            let line = self.receive();
            Report::read(&line).ok_or(line)
        })
    }

    /// Waits until the machine is idle; its last report.
    pub(crate) fn wait_for_idle(&mut self) -> Report {
        self.wait_until(|status| {
            assert_ne!(status.state, "Alarm");
            status.state == "Idle"
        })
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

    fn wait_until(&mut self, is_expected: impl Fn(&Report) -> bool) -> Report {
        wait_for(|| {
            let status = self.status();
            if is_expected(&status) {
                return Ok(status);
            }
            // Each report takes the emulator some time, in which nothing moves.
            thread::sleep(Duration::from_millis(20));
            Err(status)
        })
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
