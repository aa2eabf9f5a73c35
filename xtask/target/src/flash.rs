//! `cargo xtask flash`: the firmware onto a board, through a debug probe.

use std::{env, path::Path, process::ExitCode};

use anyhow::Result;
use boards::{Board, compile};
use common::{tools, ui};

/// Build the firmware and write it to the board with a debug probe
///
/// An ST-Link, a J-Link or a CMSIS-DAP probe will do: a Nucleo board has one built in. The first
/// time, xtask compiles itself anew with probe-rs in it.
#[derive(clap::Args)]
pub(crate) struct Options {
    /// The board
    #[arg(long, value_name = "NAME")]
    board: String,
    /// The probe, as `VID:PID` or `VID:PID:SERIAL`, where there is more than one
    #[arg(long, value_name = "PROBE")]
    probe: Option<String>,
    /// Write it although nothing is proven: it then keeps to 30 000 steps per second
    #[arg(long)]
    unproven: bool,
}

pub(crate) fn run(options: &Options) -> Result<ExitCode> {
    let board = boards::named(&options.board)?;
    if !cfg!(feature = "probe") {
        return again();
    }
    let elf = if options.unproven {
        compile::firmware(&board)?
    } else {
        firmware::proven(&board)?
    };
    start(&board, options.probe.as_deref(), &elf)?;
    let what = format!("{}: connect a sender at 115200 baud", board.name);
    ui::status("Started", &what);
    Ok(ExitCode::SUCCESS)
}

/// Runs this command again in a program that has probe-rs.
pub(crate) fn again() -> Result<ExitCode> {
    tools::become_tool(tools::PROBE, env::args_os().skip(1))
}

/// Without probe-rs nothing is written.
#[cfg(not(feature = "probe"))]
fn start(board: &Board, _probe: Option<&str>, _elf: &Path) -> Result<()> {
    anyhow::bail!("this program has no probe-rs for a {}", board.part.probe_rs)
}

#[cfg(feature = "probe")]
pub(crate) use with_probe::start;

#[cfg(feature = "probe")]
mod with_probe {
    use anyhow::{Context, Result, bail};
    use probe_rs::{
        Permissions, Session,
        flashing::{DownloadOptions, FlashProgress, ProgressEvent},
        probe::{DebugProbeInfo, DebugProbeSelector, list::Lister},
    };

    use super::{Board, Path, ui};

    /// Writes a firmware to a board and starts it.
    pub(crate) fn start(board: &Board, probe: Option<&str>, elf: &Path) -> Result<Session> {
        let lister = Lister::new();
        let found = choose(&lister.list_all(), probe)?;
        ui::status(
            "Connecting",
            &format!("to {} with {found}", board.part.probe_rs),
        );
        let probe = found
            .open()
            .with_context(|| format!("cannot open the probe {found}"))?;
        let mut session = probe
            .attach(&*board.part.probe_rs, Permissions::default())
            .with_context(|| {
                format!(
                    "the probe finds no {}: is the board powered?",
                    board.part.probe_rs
                )
            })?;
        ui::status("Writing", &elf.display().to_string());
        let bar = host::output::progress(0, "bytes");
        let mut download = DownloadOptions::default();
        download.verify = true;
        let progress = bar.clone();
        download.progress = FlashProgress::new(move |event| match event {
            ProgressEvent::AddProgressBar { total, .. } => {
                progress.inc_length(total.unwrap_or_default());
            }
            ProgressEvent::Progress { size, .. } => progress.inc(size),
            _ => {}
        });
        probe_rs::flashing::download_file_with_options(
            &mut session,
            elf,
            probe_rs::flashing::Format::Elf(probe_rs::flashing::ElfOptions::default()),
            download,
        )
        .context("writing to flash failed")?;
        bar.finish_and_clear();
        session
            .core(0)?
            .reset()
            .context("cannot start the firmware")?;
        Ok(session)
    }

    /// The only probe, or the one asked for.
    fn choose(probes: &[DebugProbeInfo], wanted: Option<&str>) -> Result<DebugProbeInfo> {
        if probes.is_empty() {
            bail!(common::probe::NONE);
        }
        if let Some(wanted) = wanted {
            let selector: DebugProbeSelector = wanted
                .parse()
                .with_context(|| format!("{wanted:?} is no VID:PID or VID:PID:SERIAL"))?;
            let found = probes.iter().find(|probe| selector.matches_probe(probe));
            return found
                .cloned()
                .with_context(|| format!("no probe {wanted}; there is\n{}", list(probes)));
        }
        match probes {
            [only] => Ok(only.clone()),
            _ => bail!(
                "there are several probes: choose one with --probe\n{}",
                list(probes)
            ),
        }
    }

    fn list(probes: &[DebugProbeInfo]) -> String {
        let lines: Vec<_> = probes.iter().map(|probe| format!("  {probe}")).collect();
        lines.join("\n")
    }
}
