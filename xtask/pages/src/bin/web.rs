//! `cargo xtask web`: the simulator and the view of jobs as a page that runs them in the browser.

use std::{
    fs,
    io::Write as _,
    path::{Path, PathBuf},
    process::ExitCode,
};

use anyhow::{Context, Result};
use clap::Parser;
use common::{
    cargo,
    text::{row, separated},
    tools, ui,
};
use leadscrew::settings::StepRate;
use pages::web::{measure, page};
use simulation::{output::Output, proven};

/// Make a page that runs G-code programs on the virtual machine in the browser
///
/// The page is the file index.html of a folder for any web server, and needs nothing else; it can also be opened
/// as a file. Whoever drops a program and a list of settings on it sees what `cargo xtask view` would show: the
/// code of the firmware runs as WebAssembly, and nothing leaves the browser.
#[derive(Parser)]
#[command(bin_name = "cargo xtask web", styles = ui::STYLES, max_term_width = 100, version)]
#[command(after_help = ui::AXES)]
struct Options {
    /// Where the folder is made; without it, among the results of builds
    #[arg(short, long, value_name = "FOLDER")]
    output: Option<PathBuf>,
    /// Play a program here and under node too, and compare times, hashes and pages
    #[arg(long, value_name = "FILE")]
    measure: Option<PathBuf>,
    /// Read the settings for that from a file of $n=value lines
    #[arg(long, value_name = "FILE", requires = "measure")]
    settings: Option<PathBuf>,
}

fn main() -> ExitCode {
    let options = Options::parse();
    common::main(|| run(&options))
}

fn run(options: &Options) -> Result<ExitCode> {
    let wasm = tools::wasm()?;
    let wasm = fs::read(&wasm).with_context(|| format!("cannot read {}", wasm.display()))?;
    let rate_hz = match proven::committed() {
        StepRate::Unproven => 0,
        StepRate::Proven(hz) => hz,
    };
    let folder = match &options.output {
        Some(folder) => folder.clone(),
        None => cargo::target_dir().join("page"),
    };
    fs::create_dir_all(&folder).with_context(|| format!("cannot make {}", folder.display()))?;
    let index = folder.join("index.html");
    let page = page::write(&wasm, rate_hz);
    let mut output = Output::create(&index)?;
    output
        .write_all(page.as_bytes())
        .context("cannot write the page")?;
    output.finish()?;
    let [size, code] = [page.len(), wasm.len()].map(|bytes| separated(bytes as u64));
    row(
        "page",
        &format!(
            "{size} bytes, of {code} of WebAssembly: {}",
            index.display()
        ),
    );
    let Some(program) = &options.measure else {
        return Ok(ExitCode::SUCCESS);
    };
    let settings = options.settings.as_deref();
    measure::compare(&index, program, settings.map(Path::new))
}
