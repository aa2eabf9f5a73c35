//! `cargo xtask run`: a program on the emulated board, with its log.

use std::{env, fs, io::Read, path::Path, process::ExitCode};

use anstream::println;
use anyhow::{Context, Result, bail, ensure};
use common::cargo;
use common::options::Run as Options;
use defmt_decoder::{DecodeError, Locations, StreamDecoder, Table};
use owo_colors::OwoColorize;
use target::emulator::semihosting;

pub(crate) fn run(options: &Options) -> Result<ExitCode> {
    let here = env::current_dir().context("the current folder is gone")?;
    program(&options.elf, &options.arguments, &here)?;
    Ok(ExitCode::SUCCESS)
}

/// Runs `elf` to its end, prints its log, and fails if it does.
fn program(elf: &Path, arguments: &[String], folder: &Path) -> Result<()> {
    let elf = &fs::canonicalize(elf).with_context(|| format!("cannot find {}", elf.display()))?;
    let bytes = fs::read(elf).with_context(|| format!("cannot read {}", elf.display()))?;
    let mut qemu = semihosting::start(elf, arguments, folder)?;
    let mut log = qemu.stdout.take().context("QEMU has no output")?;
    let printed = match Table::parse(&bytes) {
        Ok(Some(table)) => {
            let locations = table.get_locations(&bytes).unwrap_or_default();
            print_log(&mut log, &mut *table.new_stream_decoder(), &locations)
        }
        Ok(None) => std::io::copy(&mut log, &mut std::io::stdout())
            .map(drop)
            .context("cannot read the program's output"),
        Err(error) => Err(error.context(format!("cannot read the log table of {}", elf.display()))),
    };
    if printed.is_err() {
        // It may be running on.
        let _ = qemu.kill();
    }
    let status = qemu.wait().context("cannot wait for QEMU")?;
    printed?;
    ensure!(
        status.success(),
        "{} failed on the target ({status})",
        elf.display()
    );
    Ok(())
}

/// Decodes and prints frames as they arrive.
fn print_log(
    log: &mut impl Read,
    decoder: &mut dyn StreamDecoder,
    locations: &Locations,
) -> Result<()> {
    let mut chunk = [0; 4096];
    loop {
        let length = log.read(&mut chunk).context("cannot read the log")?;
        if length == 0 {
            return Ok(());
        }
        decoder.received(&chunk[..length]);
        loop {
            let frame = match decoder.decode() {
                Ok(frame) => frame,
                Err(DecodeError::UnexpectedEof) => break,
                Err(DecodeError::Malformed) => bail!("the program's log is not defmt"),
            };
            let place = locations
                .get(&frame.index())
                .map_or_else(String::new, |at| {
                    let file = at.file.strip_prefix(cargo::root()).unwrap_or(&at.file);
                    format!(" ({}:{})", file.display(), at.line)
                });
            println!("{}{}", frame.display(false), place.dimmed());
        }
    }
}
