//! The same job here and under node: whether both come to the same, and what each takes of the processor.

use std::{
    fs,
    path::Path,
    process::{Command, ExitCode, Stdio},
};

use crate::page;
use anyhow::{Context, Result, bail};
use common::text::row;
use leadscrew::sim::Simulator;
use rustix::time::{ClockId, clock_gettime};
use serde_json::Value;
use simulation::Recording;
use simulation::{
    play::{self, Run},
    program::Program,
    settings,
};

/// What runs the page's worker, without a browser.
const SCRIPT: &str = include_str!("page/node.js");

/// Time of the processor so far, s.
fn processor_time_s() -> f64 {
    let time = clock_gettime(ClockId::ProcessCPUTime);
    time.tv_sec as f64 + time.tv_nsec as f64 * 1e-9
}

/// Plays a program here and with the code of a page, and tells how they compare.
pub fn compare(index: &Path, program: &Path, file: Option<&Path>) -> Result<ExitCode> {
    let begun_s = processor_time_s();
    let (hash, page) = native(program, file)?;
    let here_s = processor_time_s() - begun_s;
    let (summary, other_page) = under_node(index, program, file)?;
    let there_s = summary["seconds"].as_f64().context("node says no time")?;
    let is_same = summary["hash"] == hash.as_str() && other_page == page.as_bytes();
    row("native", &format!("{here_s:.2} s, hash {hash}"));
    row(
        "WebAssembly",
        &format!(
            "{there_s:.2} s, hash {}, {:.2} times as long",
            summary["hash"].as_str().unwrap_or_default(),
            there_s / here_s
        ),
    );
    row(
        "pages",
        if is_same {
            "the same to the last byte"
        } else {
            "differ"
        },
    );
    Ok(ExitCode::from(u8::from(!is_same)))
}

/// The hash and the page by the code of this computer.
pub fn native(program: &Path, file: Option<&Path>) -> Result<(String, String)> {
    let loaded = settings::load(file, &[])?;
    let mut simulator = Box::new(Simulator::new(&loaded.settings));
    play::unlock(&mut simulator);
    let mut recording = Recording::new(simulator.session());
    let name = name(program);
    let program = Program::open(program)?;
    let figures = play::stream(program, &mut simulator, Run::silent(&mut recording))?;
    let job = recording.finish(&figures, &name, &loaded.settings);
    Ok((figures.event_hash, page::write(&job)))
}

fn name(path: &Path) -> String {
    let name = path.file_name().unwrap_or_default();
    name.to_string_lossy().into_owned()
}

/// The summary and the page by the WebAssembly of a page.
///
/// # Errors
/// What the machine says, as [`native`] does.
pub fn under_node(index: &Path, program: &Path, file: Option<&Path>) -> Result<(Value, Vec<u8>)> {
    let out = index.with_file_name("measured.html");
    let mut node = Command::new("node");
    node.args(["--eval", SCRIPT, "--"])
        .arg(index)
        .arg(&out)
        .arg(program)
        .args(file);
    let output = node.stdin(Stdio::null()).stderr(Stdio::inherit()).output();
    let output = output.context("cannot start node, which this needs")?;
    let measured: Value = serde_json::from_slice(&output.stdout)
        .with_context(|| format!("node says nothing ({})", output.status))?;
    if let Some(failure) = measured["failure"].as_str() {
        bail!("{failure}");
    }
    let page = fs::read(&out).context("node has left no page")?;
    fs::remove_file(&out)?;
    Ok((measured, page))
}
