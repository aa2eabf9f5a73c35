//! Programs that end by themselves, and reach this computer's files and output by semihosting.

use std::{
    io::Read,
    os::unix::net::UnixStream,
    path::Path,
    process::{Child, Command, Stdio},
    time::Duration,
};

use anyhow::{Context, Result, ensure};
use common::cargo;

use super::{
    patience::Patient,
    process::{accept, listen},
};

/// Runs `elf` to its end in a folder, where its files are, and returns what it prints.
pub fn output(elf: &Path, folder: &Path) -> Result<String> {
    let qemu = start(elf, &[], folder)?;
    let output = qemu.wait_with_output().context("cannot wait for QEMU")?;
    let text = String::from_utf8_lossy(&output.stdout).into_owned();
    let status = output.status;
    ensure!(
        status.success(),
        "{} failed ({status})\n{text}",
        elf.display()
    );
    Ok(text)
}

/// Starts QEMU with semihosting and nothing else: the program ends it.
pub fn start(elf: &Path, arguments: &[String], folder: &Path) -> Result<Child> {
    start_with(elf, arguments, folder, &["-serial", "null"])
}

/// A program that also has a serial line.
pub struct Serial {
    /// QEMU, with the program's output.
    pub qemu: Child,
    /// What the program sends, which is waited for with patience.
    pub from: Box<dyn Read>,
    /// Where it receives.
    pub to: UnixStream,
}

/// Starts QEMU with semihosting, a serial line that is read with a limit to each silence, and more options.
pub fn start_with_serial(
    elf: &Path,
    folder: &Path,
    options: &[&str],
    limit: Duration,
) -> Result<Serial> {
    let path = folder.join("serial");
    let listener = listen(&path)?;
    let socket = format!("unix:{},server=off", path.display());
    let options = [&["-serial", &socket], options].concat();
    let mut qemu = start_with(elf, &[], folder, &options)?;
    let connected = accept(&listener, &mut qemu)
        .and_then(|to| Ok((Patient::new(to.try_clone()?, qemu.id(), limit)?, to)));
    let (from, to) = connected.inspect_err(|_| {
        let _ = qemu.kill();
        let _ = qemu.wait();
    })?;
    Ok(Serial {
        qemu,
        from: Box::new(from),
        to,
    })
}

fn start_with(elf: &Path, arguments: &[String], folder: &Path, options: &[&str]) -> Result<Child> {
    cargo::need_qemu()?;
    let (_, machine) = firmware::boards::emulated()?;
    let mut semihosting = String::from("enable=on,target=native");
    for argument in std::iter::once(elf.to_string_lossy().into_owned()).chain(arguments.to_vec()) {
        // QEMU's own escape for a comma.
        semihosting.push_str(",arg=");
        semihosting.push_str(&argument.replace(',', ",,"));
    }
    Command::new("qemu-system-arm")
        .args(["-M", &machine, "-nographic", "-monitor", "none"])
        .args(["-semihosting-config", &semihosting])
        .args(options)
        .arg("-kernel")
        .arg(elf)
        .current_dir(folder)
        .stdin(Stdio::null())
        .stdout(Stdio::piped())
        .spawn()
        .context("cannot start qemu-system-arm")
}
