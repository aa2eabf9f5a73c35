//! The program on a board: facts over RTT, bytes over the serial port.

use std::path::Path;

use anyhow::Result;
use firmware::boards::Board;

use super::facts::Facts;

/// Without probe-rs nothing is measured.
#[cfg(not(feature = "probe"))]
pub(super) fn run(
    board: &Board,
    _elf: &Path,
    _probe: Option<&str>,
    _port: Option<&Path>,
) -> Result<Facts> {
    anyhow::bail!("this program has no probe-rs for a {}", board.part.probe_rs)
}

#[cfg(feature = "probe")]
pub(super) use with_probe::run;

#[cfg(feature = "probe")]
mod with_probe {
    use std::{
        fs::File,
        io::{Error, ErrorKind, Read},
        thread,
        time::{Duration, Instant},
    };

    use anyhow::{Context, bail};
    use common::ui;
    use probe_rs::{Core, rtt::Rtt};
    use rustix::event::{PollFd, PollFlags, Timespec, poll};

    use super::{Board, Facts, Path, Result};
    use crate::{
        bring_up::{
            exchange::exchange_all,
            facts::{BEGIN, END, READY, take_until},
        },
        flash, latency,
    };

    /// The address of the channels.
    const RTT_SYMBOL: &str = "_SEGGER_RTT";
    /// Time for which the probe leaves the chip alone: until the program has set up its memory.
    const UNREAD_TIME: Duration = Duration::from_secs(1);
    /// How long the program may say nothing: longer than its scripts and resets take.
    const TIMEOUT: Duration = Duration::from_secs(30);
    /// Longest silence of the serial port: an erase takes 2 s, and what has come is compared for half a second.
    const SILENCE: Timespec = Timespec {
        tv_sec: 4,
        tv_nsec: 0,
    };

    /// Writes the program to a board, runs the program, and returns its output.
    pub(in crate::bring_up) fn run(
        board: &Board,
        elf: &Path,
        probe: Option<&str>,
        port: Option<&Path>,
    ) -> Result<Facts> {
        let place = target::emulator::symbol(elf, RTT_SYMBOL)?;
        // Before the program reports its faults.
        let port = port
            .map(|path| {
                let opened = latency::open_port(path);
                opened.with_context(|| format!("cannot open {}", path.display()))
            })
            .transpose()?;
        let started = flash::start(board, probe, elf);
        let mut session = started.context(common::probe::BRING_UP)?;
        let mut core = session.core(0).context("the chip does not answer")?;
        ui::status("Measuring", &board.name);
        thread::sleep(UNREAD_TIME);
        let mut output = Output {
            place,
            channels: None,
            text: String::new(),
        };
        let mut facts = Facts::default();
        output.take(&mut core, BEGIN)?;
        facts.read(&output.take(&mut core, READY)?)?;
        facts.put("port", port.is_some().into());
        let Some(port) = port else {
            return Ok(facts);
        };
        let mut to = port.try_clone().context("the port cannot be shared")?;
        let mut from = Port(port);
        exchange_all(&mut from, &mut to, &mut facts)?;
        facts.read(&output.take(&mut core, END)?)?;
        Ok(facts)
    }

    /// The output of the program.
    struct Output {
        place: u64,
        channels: Option<Rtt>,
        text: String,
    }

    impl Output {
        /// Returns what comes before a line.
        fn take(&mut self, core: &mut Core<'_>, last: &str) -> Result<String> {
            let start = Instant::now();
            let mut chunk = [0; 1024];
            loop {
                if let Some(part) = take_until(&mut self.text, last) {
                    return Ok(part);
                }
                if start.elapsed() > TIMEOUT {
                    bail!(
                        "the program does not come to its end; it has said\n{}",
                        self.text
                    );
                }
                if self.channels.is_none() {
                    self.channels = Rtt::attach_at(core, self.place).ok();
                }
                let channel = self.channels.as_mut().and_then(|rtt| rtt.up_channel(0));
                // In the middle of a reset there is none.
                let length = channel.and_then(|channel| channel.read(core, &mut chunk).ok());
                match length {
                    Some(length) => self.text += &String::from_utf8_lossy(&chunk[..length]),
                    None => self.channels = None,
                }
            }
        }
    }

    /// A serial port that is not waited for for ever.
    struct Port(File);

    impl Read for Port {
        fn read(&mut self, bytes: &mut [u8]) -> std::io::Result<usize> {
            let mut waiting = [PollFd::new(&self.0, PollFlags::IN)];
            if poll(&mut waiting, Some(&SILENCE))? == 0 {
                return Err(Error::from(ErrorKind::WouldBlock));
            }
            self.0.read(bytes)
        }
    }
}
