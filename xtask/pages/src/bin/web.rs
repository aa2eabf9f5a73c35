//! `cargo xtask web`: the simulator and the view of jobs as a page that runs them in the browser.

use std::{fs, io::Write as _, path::Path, process::ExitCode};

use anyhow::{Context, Result};
use common::options::{self, Verb, Web as Options};
use common::{
    cargo,
    text::{row, separated},
    tools,
};
use firmware::released::Released;
use leadscrew::settings::StepRate;
use pages::{
    control,
    web::{install, measure, page},
};
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
    let release = options.release.as_deref();
    let release = release.map(|release| install::copy(release, &folder));
    let release = release.transpose()?;
    let release = release.as_ref().map(Released::index);
    let page = page::write(&wasm, rate_hz, release);
    write(&index, &page)?;
    let [size, code] = [page.len(), wasm.len()].map(|bytes| separated(bytes as u64));
    row(
        "page",
        &format!(
            "{size} bytes, of {code} of WebAssembly: {}",
            index.display()
        ),
    );
    let code = control::built()?;
    let page = control::write(&code);
    let file = folder.join(control::FILE);
    write(&file, &page)?;
    let [size, wasm] = [page.len(), code.wasm.len()].map(|bytes| separated(bytes as u64));
    row(
        "control",
        &format!("{size} bytes, of {wasm} of WebAssembly: {}", file.display()),
    );
    if let Some(release) = release {
        let file = folder.join(install::FILE);
        write(&file, &install::write(release))?;
        row(
            "release",
            &format!("{}: {}", release.version, file.display()),
        );
    }
    let Some(program) = &options.measure else {
        return Ok(ExitCode::SUCCESS);
    };
    let settings = options.settings.as_deref();
    measure::compare(&index, program, settings.map(Path::new))
}

/// Writes a page as a whole, or not at all.
fn write(file: &Path, page: &str) -> Result<()> {
    let mut output = Output::create(file)?;
    output
        .write_all(page.as_bytes())
        .context("cannot write the page")?;
    output.finish()
}
