//! QEMU with the plugin that counts.

use std::{
    env, fs, iter,
    path::{Path, PathBuf},
    process::{self, Child, ChildStdin, Command, Stdio},
    thread,
    time::{Duration, Instant},
};

use anyhow::{Context, Result, bail, ensure};
use common::{cargo, tools, ui};

use super::{
    monitor::Monitor,
    report::Report,
    sender::Sender,
    workload::{Part, Workload},
};

/// Longest time that a program may take, and then QEMU to end, host time.
const TIMEOUT: Duration = Duration::from_mins(10);
const GRACE: Duration = Duration::from_secs(20);
/// Runs of a workload before this machine is called too busy.
const TRIES: u32 = 5;

/// QEMU, the plugin, and a folder for what they leave.
pub(super) struct Emulator {
    machine: String,
    plugin: PathBuf,
    folder: PathBuf,
}

/// A running QEMU, killed when it is dropped.
struct Running(Child);

impl Emulator {
    /// Builds the plugin.
    pub(super) fn new() -> Result<Self> {
        cargo::need_qemu()?;
        let (_, machine) = firmware::boards::emulated()?;
        let plugin = tools::plugin()?;
        let folder = cargo::target_dir().join("bench");
        fs::create_dir_all(&folder)
            .with_context(|| format!("cannot create {}", folder.display()))?;
        Ok(Self {
            machine,
            plugin,
            folder,
        })
    }

    /// Runs a program that ends by semihosting.
    pub(super) fn run(&self, elf: &Path, arguments: &[String]) -> Result<Report> {
        let mut semihosting = String::from("enable=on,target=native");
        let name = elf.to_string_lossy();
        for argument in iter::once(&*name).chain(arguments.iter().map(String::as_str)) {
            semihosting.push_str(",arg=");
            semihosting.push_str(&escape(argument));
        }
        let report = self.fresh("program.json");
        ui::status("Counting", &name);
        let mut qemu = Running(
            self.command(elf, &report)
                .args(["-monitor", "none", "-serial", "null"])
                .args(["-semihosting-config", &semihosting])
                .stdin(Stdio::null())
                .spawn()
                .context("cannot start qemu-system-arm")?,
        );
        qemu.wait(TIMEOUT)?;
        Report::read(&report)
    }

    /// Streams a workload to the firmware; again where this machine was too busy to send in time.
    pub(super) fn stream(&self, elf: &Path, workload: &Workload, part: Part) -> Result<Report> {
        for _ in 0..TRIES {
            if let Some(report) = self.try_stream(elf, workload, part)? {
                return Ok(report);
            }
        }
        bail!(
            "{}: in {TRIES} runs this machine was too busy to send the lines in time, so the \
             firmware had to slow down",
            workload.name
        )
    }

    /// One run; nothing when the motion had to wait for lines.
    fn try_stream(&self, elf: &Path, workload: &Workload, part: Part) -> Result<Option<Report>> {
        let report = self.fresh("firmware.json");
        let (mut qemu, mut sender, monitor) = self.boot(elf, &report)?;
        sender.stream(workload.settings.iter().copied())?;
        if part == Part::Whole {
            sender.stream(workload.program.iter().map(String::as_str))?;
        }
        // Answered when all motion is over.
        sender.stream(["G4P0.01"])?;
        let position = sender.position()?;
        let expected = match part {
            Part::Settings => [0.0; 3],
            Part::Whole => workload.end_mm,
        };
        let is_there = |(is, should): (&f64, &f64)| (is - should).abs() < 0.003;
        ensure!(
            position.iter().zip(&expected).all(is_there),
            "{}: the machine is at {position:?} mm, not at {expected:?}",
            workload.name
        );
        let mut console = Monitor::connect(&monitor)?;
        let motion_s = console.motion_s(elf)?;
        let is_in_time = part == Part::Settings || motion_s < 1.1 * workload.motion_s;
        console.quit()?;
        qemu.wait(GRACE)?;
        let _ = fs::remove_file(&monitor);
        if !is_in_time {
            return Ok(None);
        }
        Report::read(&report).map(Some)
    }

    /// Starts the firmware and waits for its welcome; also where QEMU's monitor listens.
    fn boot(&self, elf: &Path, report: &Path) -> Result<(Running, Sender<ChildStdin>, PathBuf)> {
        let monitor = env::temp_dir().join(format!("leadscrew-bench-{}", process::id()));
        let _ = fs::remove_file(&monitor);
        let listen = format!(
            "unix:{},server=on,wait=off",
            escape(&monitor.to_string_lossy())
        );
        let mut child = self
            .command(elf, report)
            .args(["-monitor", &listen, "-serial", "stdio"])
            .stdin(Stdio::piped())
            .stdout(Stdio::piped())
            .spawn()
            .context("cannot start qemu-system-arm")?;
        let to = child.stdin.take().context("QEMU has no input")?;
        let from = child.stdout.take().context("QEMU has no output")?;
        let qemu = Running(child);
        Ok((qemu, Sender::connect(to, from)?, monitor))
    }

    /// The path of a report that is yet to be written.
    fn fresh(&self, name: &str) -> PathBuf {
        let report = self.folder.join(name);
        let _ = fs::remove_file(&report);
        report
    }

    /// The emulated board without peripherals.
    fn command(&self, elf: &Path, report: &Path) -> Command {
        let load = format!(
            "{},elf={},out={}",
            escape(&self.plugin.to_string_lossy()),
            escape(&elf.to_string_lossy()),
            escape(&report.to_string_lossy())
        );
        let mut command = Command::new("qemu-system-arm");
        command
            .args(["-M", &self.machine, "-nographic", "-plugin", &load])
            .arg("-kernel")
            .arg(elf);
        command
    }
}

impl Running {
    /// Waits for the end.
    fn wait(&mut self, patience: Duration) -> Result<()> {
        let start = Instant::now();
        while self.0.try_wait().context("cannot wait for QEMU")?.is_none() {
            if start.elapsed() > patience {
                bail!("QEMU did not end in {} s", patience.as_secs());
            }
            thread::sleep(Duration::from_millis(5));
        }
        Ok(())
    }
}

impl Drop for Running {
    fn drop(&mut self) {
        // It has ended, or it hangs and heeds nothing less.
        let _ = self.0.kill();
        let _ = self.0.wait();
    }
}

/// QEMU's own escape for a comma.
fn escape(text: &str) -> String {
    text.replace(',', ",,")
}
