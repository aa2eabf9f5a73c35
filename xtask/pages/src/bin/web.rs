//! `cargo xtask web`: the simulator and the view of jobs as a page that runs them in the browser.

use std::{fs, io::Write as _, path::Path, process::ExitCode};

use anyhow::{Context, Result};
use common::options::{self, Verb, Web as Options};
use common::{
    cargo,
    text::{row, separated},
    tools,
};
use leadscrew::settings::StepRate;
use pages::web::{measure, page};
use simulation::{output::Output, proven};

fn main() -> ExitCode {
    common::main(|| match options::read() {
        Verb::Web(options) => run(&options),
        other => other.refuse(),
    })
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
