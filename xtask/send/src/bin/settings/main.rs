//! `cargo xtask settings`: a machine's settings, saved, compared and loaded.

mod compare;
mod load;

use std::{
    fs::{self, File},
    io::Write as _,
    path::{Path, PathBuf},
    process::ExitCode,
    time::Duration,
};

use anstream::println;
use anyhow::{Context, Result, ensure};
use clap::Parser;
use common::{BAUD, ui};
use grbl_client::{Link, Machine};
use simulation::settings;

/// Save the settings of a machine, compare them with a file, or load them
///
/// The machine is a board at a serial port, or the simulator. A file is any list of settings as a machine
/// has printed it. --load sends only what differs, one setting at a time, and reads all of it back. The
/// exit status is 1 when something differs (--diff) or is refused.
#[derive(Parser)]
#[command(bin_name = "cargo xtask settings", styles = ui::STYLES, max_term_width = 100, version)]
#[command(after_help = ui::AXES)]
#[command(group = clap::ArgGroup::new("where").required(true).args(["port", "tcp"]))]
#[command(group = clap::ArgGroup::new("what").required(true).args(["load", "save", "diff"]))]
struct Options {
    /// The serial port of the machine, such as /dev/ttyACM0
    #[arg(long, value_name = "DEVICE")]
    port: Option<PathBuf>,
    /// The TCP address of the machine, such as 127.0.0.1:2323
    #[arg(long, value_name = "ADDR:PORT")]
    tcp: Option<String>,
    /// The baud rate of the serial port
    #[arg(long, value_name = "BAUD", default_value_t = BAUD, requires = "port")]
    baud: u32,
    /// How long to wait for an answer, s
    #[arg(long, value_name = "SECONDS", default_value_t = 5.0, value_parser = seconds)]
    timeout: f64,
    /// Change the machine's settings to those in a file
    #[arg(long, value_name = "FILE")]
    load: Option<PathBuf>,
    /// Write the machine's settings to a file
    #[arg(long, value_name = "FILE")]
    save: Option<PathBuf>,
    /// List where a file and the machine differ
    #[arg(long, value_name = "FILE")]
    diff: Option<PathBuf>,
}

fn main() -> ExitCode {
    let options = Options::parse();
    common::main(|| run(&options))
}

/// Reads a time that can be waited for.
fn seconds(text: &str) -> Result<f64, String> {
    match text.parse() {
        Ok(seconds) if (0.1..=600.0).contains(&seconds) => Ok(seconds),
        _ => Err("0.1 to 600 seconds are possible".into()),
    }
}

fn run(options: &Options) -> Result<ExitCode> {
    // A file that cannot be read is told before anything is connected.
    let file = options.load.as_deref().or(options.diff.as_deref());
    let dump = file.map(settings::read).transpose()?.unwrap_or_default();
    if let (Some(file), Some(names)) = (file, dump.left_out()) {
        ui::warning(&format!("{}: left out {names}", file.display()));
    }
    let timeout = Duration::from_secs_f64(options.timeout);
    let address = options.tcp.as_deref();
    let link = Link::open(options.port.as_deref(), options.baud, address, timeout)?;
    let mut machine = Machine::connect(link, timeout, None)?;
    if let Some(file) = &options.save {
        let lines = machine.settings()?;
        save(file, &lines)?;
        let what = format!("{} settings to {}", lines.len(), file.display());
        ui::status("Saved", &what);
        return Ok(ExitCode::SUCCESS);
    }
    let file = file.context("no file is given")?;
    if options.load.is_some() {
        load::load(&mut machine, file, &dump)?;
        return Ok(ExitCode::SUCCESS);
    }
    let wanted = load::wanted(file, &dump)?;
    let comparison = compare::compare(&wanted, &load::settings(&mut machine)?);
    if let Some(names) = comparison.only_on_the_machine() {
        ui::warning(&format!("{} does not have {names}", file.display()));
    }
    if comparison.differences.is_empty() {
        ui::status("Equal", &format!("{} settings", wanted.len()));
        return Ok(ExitCode::SUCCESS);
    }
    println!(
        "{}",
        compare::table("file", "machine", &comparison.differences)
    );
    Ok(ExitCode::FAILURE)
}

/// Writes lines to a file, all of them or nothing.
fn save(path: &Path, lines: &[String]) -> Result<()> {
    ensure!(!lines.is_empty(), "the machine has listed no settings");
    let mut beside = path.as_os_str().to_owned();
    beside.push(".new");
    let beside = PathBuf::from(beside);
    let text = lines.join("\n") + "\n";
    let write = || {
        let mut file = File::create(&beside)?;
        file.write_all(text.as_bytes())?;
        file.sync_all()?;
        fs::rename(&beside, path)
    };
    write().with_context(|| {
        let _ = fs::remove_file(&beside);
        format!("cannot write {}", path.display())
    })
}
