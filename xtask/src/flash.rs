//! `cargo xtask flash`: the firmware onto a board, through a debug probe.

use std::{path::Path, process::ExitCode};

use anyhow::{Context, Result, bail};

use crate::{
    boards::{self, Board},
    build, cargo, ui,
};

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
    if !cfg!(feature = "flash") {
        let mut verb = vec!["flash", "--board", &board.name];
        if let Some(probe) = &options.probe {
            verb.extend(["--probe", probe]);
        }
        if options.unproven {
            verb.push("--unproven");
        }
        return again(&verb);
    }
    let elf = if options.unproven {
        build::compile(&board)?
    } else {
        build::proven(&board)?
    };
    start(&board, options.probe.as_deref(), &elf)?;
    let what = format!("{}: connect a sender at 115200 baud", board.name);
    ui::status("Started", &what);
    Ok(ExitCode::SUCCESS)
}

/// Runs a verb again in an xtask that has probe-rs.
pub(crate) fn again(verb: &[&str]) -> Result<ExitCode> {
    ui::status(
        "Preparing",
        "to use a debug probe: the first time, compiling probe-rs takes some minutes",
    );
    let mut command = cargo::cargo(&["run", "--quiet", "--profile", "tools"]);
    command.args(["--package", "xtask", "--features"]);
    command.arg(cargo::with_axes("flash")).arg("--").args(verb);
    let status = command.status().context("cannot start cargo")?;
    Ok(ExitCode::from(u8::from(!status.success())))
}

/// Without probe-rs nothing is written.
#[cfg(not(feature = "flash"))]
fn start(board: &Board, _probe: Option<&str>, _elf: &Path) -> Result<()> {
    bail!("this xtask has no probe-rs for a {}", board.chip)
}

#[cfg(feature = "flash")]
pub(crate) use with_probe::start;

#[cfg(feature = "flash")]
mod with_probe {
    use probe_rs::{
        Permissions, Session,
        flashing::{DownloadOptions, FlashProgress, ProgressEvent},
        probe::{DebugProbeInfo, DebugProbeSelector, list::Lister},
    };

    use super::{Board, Context, Path, Result, bail};
    use crate::ui;

    const NO_PROBE: &str = "no debug probe is attached\n\
        Connect the board by USB (a Nucleo board's own ST-Link, or a probe on its SWD pins).\n\
        On Linux, probes need udev rules: https://probe.rs/docs/getting-started/probe-setup\n\
        If another program (OpenOCD, a debugger) has the probe, stop it.";

    /// Writes a firmware to a board and starts it.
    pub(crate) fn start(board: &Board, probe: Option<&str>, elf: &Path) -> Result<Session> {
        let lister = Lister::new();
        let found = choose(&lister.list_all(), probe)?;
        ui::status("Connecting", &format!("to {} with {found}", board.chip));
        let probe = found
            .open()
            .with_context(|| format!("cannot open the probe {found}"))?;
        let mut session = probe
            .attach(&*board.chip, Permissions::default())
            .with_context(|| format!("the probe finds no {}: is the board powered?", board.chip))?;
        ui::status("Writing", &elf.display().to_string());
        let bar = ui::progress(0, "bytes");
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
            bail!(NO_PROBE);
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
