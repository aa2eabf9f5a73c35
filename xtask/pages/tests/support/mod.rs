//! The command as it is typed.

use std::{
    io::{BufRead as _, BufReader, Read as _},
    path::Path,
    process::{Child, ChildStderr, Command, Stdio},
    sync::OnceLock,
};

use common::tools;
use rustix::process::{Pid, Signal};

fn root() -> &'static Path {
    Path::new(concat!(env!("CARGO_MANIFEST_DIR"), "/../.."))
}

/// Compiles what the monitor needs, once: the monitors would wait for other builds of Cargo one after the other.
fn build(arguments: &[&str]) {
    static PAGE: OnceLock<()> = OnceLock::new();
    tools::command(tools::SIM).unwrap();
    if arguments.contains(&"--control") {
        PAGE.get_or_init(|| drop(tools::control().unwrap()));
    }
}

/// The monitor, and what it says.
pub(crate) struct Monitor {
    pub(crate) process: Child,
    messages: BufReader<ChildStderr>,
    printed: String,
}

impl Monitor {
    pub(crate) fn start(arguments: &[&str]) -> Self {
        Self::of(&mut Self::command(arguments))
    }

    pub(crate) fn command(arguments: &[&str]) -> Command {
        build(arguments);
        let mut command = Command::new(env!("CARGO_BIN_EXE_monitor"));
        command
            .env_remove("CARGO")
            .arg("monitor")
            .args(arguments)
            .current_dir(root());
        command
    }

    pub(crate) fn of(command: &mut Command) -> Self {
        let mut process = command
            .stdin(Stdio::null())
            .stdout(Stdio::null())
            .stderr(Stdio::piped())
            .spawn()
            .unwrap();
        let messages = BufReader::new(process.stderr.take().unwrap());
        Self {
            process,
            messages,
            printed: String::new(),
        }
    }

    /// Waits until the page is there, and returns its address, with the token if it has one.
    pub(crate) fn address(&mut self) -> String {
        loop {
            let mut line = String::new();
            let length = self.messages.read_line(&mut line).unwrap();
            assert!(length > 0, "{}", self.printed);
            self.printed += &line;
            if let Some((_, after)) = line.split_once("http://") {
                return after
                    .split(' ')
                    .next()
                    .unwrap()
                    .trim()
                    .trim_end_matches('/')
                    .into();
            }
        }
    }

    pub(crate) fn interrupt(&self) {
        self.signal(Signal::INT);
    }

    pub(crate) fn signal(&self, signal: Signal) {
        let id = Pid::from_raw(self.process.id().cast_signed()).unwrap();
        rustix::process::kill_process(id, signal).unwrap();
    }

    /// Waits for the end: the exit status, and everything said.
    pub(crate) fn end(mut self) -> (Option<i32>, String) {
        self.messages.read_to_string(&mut self.printed).unwrap();
        let status = self.process.wait().unwrap();
        (status.code(), std::mem::take(&mut self.printed))
    }
}

impl Drop for Monitor {
    fn drop(&mut self) {
        let _ = self.process.kill();
        let _ = self.process.wait();
    }
}
