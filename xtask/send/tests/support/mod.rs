//! The simulator, the sender, and a cable between them that can be unplugged.

pub(crate) mod machined;

use std::{
    fs::{File, OpenOptions},
    io::{BufRead as _, BufReader, Read as _, Write as _},
    os::{fd::AsFd as _, unix::net::UnixStream},
    path::Path,
    process::{Child, Command, Stdio},
    sync::{
        Mutex, PoisonError,
        mpsc::{Receiver, channel},
    },
    thread::{self, JoinHandle},
    time::Duration,
};

use common::tools;
use rustix::{
    event::{PollFd, PollFlags, poll},
    process::{Pid, Signal},
};
use simulation::pty::Pty;
use tempfile::TempDir;

/// How long a command may be silent before it counts as stuck.
const TIMEOUT: Duration = Duration::from_mins(3);

/// Held where a process begins: up to then it has all files of this one open.
static SPAWNING: Mutex<()> = Mutex::new(());

fn spawn(command: &mut Command) -> Child {
    let _alone = SPAWNING.lock().unwrap_or_else(PoisonError::into_inner);
    command.spawn().unwrap()
}

pub(crate) fn path(folder: &TempDir, name: &str) -> String {
    folder.path().join(name).to_str().unwrap().into()
}

/// The simulator in real time.
pub(crate) struct Simulator {
    process: Child,
    /// `tcp://127.0.0.1:2323`, or the device.
    place: String,
}

impl Simulator {
    pub(crate) fn start(arguments: &[&str], settings: &[&str]) -> Self {
        let mut process = spawn(
            tools::command(tools::SIM)
                .unwrap()
                .args(arguments)
                .args(settings.iter().flat_map(|setting| ["--set", setting]))
                .stdin(Stdio::null())
                .stdout(Stdio::null())
                .stderr(Stdio::piped()),
        );
        let mut messages = BufReader::new(process.stderr.take().unwrap());
        let mut line = String::new();
        while !line.contains("Serving") {
            line.clear();
            let length = messages.read_line(&mut line).unwrap();
            assert!(length > 0, "the simulator has ended");
        }
        // It goes on writing, and nobody may be missing then.
        thread::spawn(move || messages.read_to_end(&mut Vec::new()));
        let place = line.split_whitespace().nth(1).unwrap().into();
        Self { process, place }
    }

    /// At a free TCP port; also gives its address.
    pub(crate) fn tcp(arguments: &[&str], settings: &[&str]) -> (Self, String) {
        let simulator = Self::start(&[&["--tcp", "127.0.0.1:0"], arguments].concat(), settings);
        let address = simulator.place.strip_prefix("tcp://").unwrap().into();
        (simulator, address)
    }
}

impl Drop for Simulator {
    fn drop(&mut self) {
        // As Ctrl-C would: it writes its files.
        if let Some(id) = Pid::from_raw(self.process.id().cast_signed()) {
            let _ = rustix::process::kill_process(id, Signal::TERM);
        }
        let _ = self.process.wait();
    }
}

/// A command that runs.
pub(crate) struct Sending {
    process: Child,
    printed: Receiver<String>,
    messages: Option<JoinHandle<String>>,
    /// All that has been printed.
    log: String,
}

impl Sending {
    pub(crate) fn start(arguments: &[&str]) -> Self {
        let mut process = spawn(
            Command::new(env!("CARGO_BIN_EXE_send"))
                .arg("send")
                .args(arguments)
                .args(["--timeout", "60"])
                .stdin(Stdio::piped())
                .stdout(Stdio::piped())
                .stderr(Stdio::piped()),
        );
        let lines = BufReader::new(process.stdout.take().unwrap()).lines();
        let mut errors = process.stderr.take().unwrap();
        let (sender, printed) = channel();
        thread::spawn(move || {
            lines
                .map_while(Result::ok)
                .try_for_each(|line| sender.send(line))
        });
        let messages = thread::spawn(move || {
            let mut text = String::new();
            let _ = errors.read_to_string(&mut text);
            text
        });
        Self {
            process,
            printed,
            messages: Some(messages),
            log: String::new(),
        }
    }

    /// Waits for a line with a text, and returns it.
    pub(crate) fn until(&mut self, text: &str) -> String {
        loop {
            let Ok(line) = self.printed.recv_timeout(TIMEOUT) else {
                let _ = self.process.kill();
                let messages = self
                    .messages
                    .take()
                    .map(|messages| messages.join().unwrap());
                panic!("no {text} in {}{}", self.log, messages.unwrap_or_default());
            };
            self.log += &line;
            self.log.push('\n');
            if line.contains(text) {
                return line;
            }
        }
    }

    pub(crate) fn press(&mut self, keys: &str) {
        self.process
            .stdin
            .as_mut()
            .unwrap()
            .write_all(keys.as_bytes())
            .unwrap();
    }

    /// Nobody presses a key any more.
    pub(crate) fn leave(&mut self) {
        self.process.stdin = None;
    }

    pub(crate) fn interrupt(&self) {
        self.signal(Signal::INT);
    }

    pub(crate) fn signal(&self, signal: Signal) {
        let id = Pid::from_raw(self.process.id().cast_signed()).unwrap();
        rustix::process::kill_process(id, signal).unwrap();
    }

    /// Whether it succeeds, and all that it has printed and said.
    fn end(mut self) -> (bool, String) {
        self.log.extend(self.printed.iter().map(|line| line + "\n"));
        let messages = self.messages.take().unwrap().join().unwrap();
        let status = self.process.wait().unwrap();
        (status.success(), self.log + &messages)
    }

    pub(crate) fn succeeds(self) -> String {
        let (is_success, messages) = self.end();
        assert!(is_success, "{messages}");
        messages
    }

    pub(crate) fn fails(self) -> String {
        let (is_success, messages) = self.end();
        assert!(!is_success, "{messages}");
        messages
    }
}

/// A cable from a device of its own to that of a machine.
pub(crate) struct Cable {
    pulled: UnixStream,
    carrier: JoinHandle<()>,
}

impl Cable {
    pub(crate) fn plug_in(machine: &str, device: &str) -> Self {
        let (near, link) = Pty::at(Path::new(device)).unwrap();
        let far = OpenOptions::new()
            .read(true)
            .write(true)
            .open(machine)
            .unwrap();
        let (pulled, end) = UnixStream::pair().unwrap();
        let carrier = thread::spawn(move || {
            carry(&near, &far, &end);
            drop(link);
        });
        Self { pulled, carrier }
    }

    /// Takes it out: both ends are closed.
    pub(crate) fn unplug(self) {
        drop(self.pulled);
        self.carrier.join().unwrap();
        // A process that is just beginning has the ends open, too.
        drop(SPAWNING.lock().unwrap_or_else(PoisonError::into_inner));
    }
}

/// Carries bytes in both directions until something is to be read from `end`.
fn carry(near: &Pty, far: &File, end: &UnixStream) {
    let mut bytes = [0; 512];
    loop {
        let mut files = [
            PollFd::from_borrowed_fd(near.controller(), PollFlags::IN),
            PollFd::from_borrowed_fd(far.as_fd(), PollFlags::IN),
            PollFd::new(end, PollFlags::IN),
        ];
        poll(&mut files, None).unwrap();
        let ready = files.map(|file| !file.revents().is_empty());
        if ready[2] {
            return;
        }
        if ready[0] {
            let length = rustix::io::read(near.controller(), &mut bytes).unwrap_or_default();
            (&mut &*far).write_all(&bytes[..length]).unwrap();
        }
        if ready[1] {
            let length = (&mut &*far).read(&mut bytes).unwrap();
            let mut remainder = &bytes[..length];
            while !remainder.is_empty() {
                let written = rustix::io::write(near.controller(), remainder).unwrap_or_default();
                remainder = &remainder[written..];
            }
        }
    }
}
