//! `cargo xtask settings`: a machine's settings, saved, compared and loaded.

mod compare;
mod load;

use std::{
    fs::{self, File},
    io::Write as _,
    path::{Path, PathBuf},
    process::ExitCode,
};

use anstream::println;
use anyhow::{Context, Result, ensure};
use common::options::{self, Settings as Options, Verb};
use common::ui;
use grbl_client::{Link, Machine};
use simulation::settings;

fn main() -> ExitCode {
    common::main(|| match options::read() {
        Verb::Settings(options) => run(&options),
        other => other.refuse(),
    })
}

fn run(options: &Options) -> Result<ExitCode> {
    // A file that cannot be read is told before anything is connected.
    let file = options.load.as_deref().or(options.diff.as_deref());
    let dump = file.map(settings::read).transpose()?.unwrap_or_default();
    if let (Some(file), Some(names)) = (file, dump.left_out()) {
        ui::warning(&format!("{}: left out {names}", file.display()));
    }
    let to = &options.connection;
    let link = Link::open(to.port.as_deref(), to.baud, to.tcp.as_deref(), to.timeout)?;
    let mut machine = Machine::connect(link, to.timeout, None)?;
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
    let mut temporary = path.as_os_str().to_owned();
    temporary.push(".new");
    let temporary = PathBuf::from(temporary);
    let text = lines.join("\n") + "\n";
    let write = || {
        let mut file = File::create(&temporary)?;
        file.write_all(text.as_bytes())?;
        file.sync_all()?;
        fs::rename(&temporary, path)
    };
    write().with_context(|| {
        let _ = fs::remove_file(&temporary);
        format!("cannot write {}", path.display())
    })
}
