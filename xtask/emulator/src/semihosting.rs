//! Programs that end by themselves, and reach this computer's files and output by semihosting.

use std::{
    path::Path,
    process::{Child, Command, Stdio},
};

use anyhow::{Context, Result, ensure};
use common::cargo;

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
    cargo::need_qemu()?;
    let (_, machine) = boards::emulated()?;
    let mut semihosting = String::from("enable=on,target=native");
    for argument in std::iter::once(elf.to_string_lossy().into_owned()).chain(arguments.to_vec()) {
        // QEMU's own escape for a comma.
        semihosting.push_str(",arg=");
        semihosting.push_str(&argument.replace(',', ",,"));
    }
    Command::new("qemu-system-arm")
        .args(["-M", &machine, "-nographic", "-monitor", "none"])
        .args(["-serial", "null", "-semihosting-config", &semihosting])
        .arg("-kernel")
        .arg(elf)
        .current_dir(folder)
        .stdin(Stdio::null())
        .stdout(Stdio::piped())
        .spawn()
        .context("cannot start qemu-system-arm")
}
