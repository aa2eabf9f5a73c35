//! `cargo xtask flash`: the firmware onto a board, through a debug probe.

use std::{env, path::Path, process::ExitCode};

use anyhow::{Context as _, Result};
use common::options::Flash as Options;
use common::{tools, ui};
use firmware::{
    boards::{Board, compile, layout},
    flash::FirmwareSource,
};

pub(crate) fn run(options: &Options) -> Result<ExitCode> {
    let chosen = FirmwareSource::by(options)?;
    let board = &chosen.board;
    if !cfg!(feature = "probe") {
        return again();
    }
    // Nothing is compiled or proven in vain.
    need_probe(options.probe.as_deref())?;
    let elf = chosen.elf()?;
    start(board, options.probe.as_deref(), &elf)?;
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
fn need_probe(_probe: Option<&str>) -> Result<()> {
    anyhow::bail!("this program has no probe-rs")
}
#[cfg(not(feature = "probe"))]
fn start(board: &Board, _probe: Option<&str>, elf: &Path) -> Result<()> {
    check(board, elf)?;
    anyhow::bail!("this program has no probe-rs for a {}", board.part.probe_rs)
}

#[cfg(feature = "probe")]
pub(crate) use with_probe::{need_probe, start};

/// Makes sure that the parts of a file lie in the right places on the chip, as the last check
/// before writing.
fn check(board: &Board, elf: &Path) -> Result<()> {
    let refused = || format!("{} would not start on the {}", elf.display(), board.title);
    let image = compile::read(elf)?;
    layout::check(board, &image).with_context(refused)?;
    layout::check_board(board, &image).with_context(refused)
}

#[cfg(feature = "probe")]
mod with_probe {
    use anyhow::{Context, Result, bail};
    use probe_rs::{
        Permissions, Session,
        flashing::{DownloadOptions, FlashProgress, ProgressEvent},
        probe::{DebugProbeInfo, DebugProbeSelector, list::Lister},
    };

    use super::{Board, Path, check, ui};

    /// Makes sure that the requested probe is connected.
    pub(crate) fn need_probe(probe: Option<&str>) -> Result<()> {
        choose(&Lister::new().list_all(), probe).map(|_| ())
    }

    /// Writes a firmware to a board and starts it.
    pub(crate) fn start(board: &Board, probe: Option<&str>, elf: &Path) -> Result<Session> {
        check(board, elf)?;
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
        let bar = simulation::output::progress(0, "bytes");
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

#[cfg(test)]
mod tests {
    use super::*;

    #[test]
    fn a_file_that_lies_in_the_bootloader_is_not_written() {
        let folder = tempfile::tempdir().unwrap();
        let elf = folder.path().join("false.elf");
        let header: [u32; 9] = [0x0028_0002, 1, 0, 52, 0, 0, 0x0020_0034, 0x0028_0001, 0];
        let segment = [1, 84, 0x0800_7ff8, 0x0800_7ff8, 8, 8, 7, 4];
        let words = header
            .iter()
            .chain(&segment)
            .chain(&[0x2002_0000, 0x0800_7ff9]);
        let words = words.flat_map(|word| word.to_le_bytes());
        let file: Vec<u8> = b"\x7fELF\x01\x01\x01\0\0\0\0\0\0\0\0\0"
            .iter()
            .copied()
            .chain(words)
            .collect();
        std::fs::write(&elf, file).unwrap();
        let board = firmware::boards::named("btt-skr-2").unwrap();
        let error = start(&board, None, &elf).err().unwrap();
        let message = format!("{error:#}");
        assert!(
            message.contains(
                "8 bytes of the program, 0x08007ff8 to 0x08007fff, lie in the bootloader"
            ),
            "{message}"
        );
    }
}
