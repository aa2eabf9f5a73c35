//! The report that the documents show: written once, and checked against a fresh one.
//!
//! It is the netduino's with three axes. The machine code is the same in every folder, but another
//! compiler makes other code: the documents name theirs, and another's report is not compared.

use std::{fmt::Write as _, fs, path::Path};

use anyhow::{Context, Result, bail, ensure};
use common::document::{read, with_part};
use common::{cargo, text::separated, ui};
use firmware::image::compiler;
use schedule::{Report, link};
use serde_json::Value;

use crate::{page, text};

const PAGE: &str = "docs/schedule.html";
const JSON: &str = "docs/schedule.json";
const TEXT: &str = "docs/scheduling.md";
const BEGIN: &str = "<!-- begin: cargo xtask schedule --write -->\n";
const END: &str = "<!-- end -->\n";
const BEGIN_PROMISE: &str = "<!-- begin: promise, cargo xtask schedule --write -->\n";
const END_PROMISE: &str = "<!-- end of promise -->\n";
/// Whose report it is.
const BOARD: &str = "netduino-plus-2";
const AXES: u8 = 3;

/// The source of the documents.
struct Made {
    page: String,
    json: String,
    promise: String,
    block: String,
    compiler: String,
}

impl Made {
    fn of(report: &Report, elf: &Path) -> Result<Self> {
        ensure!(
            report.board == BOARD && report.axes == AXES,
            "the documents show the report on {BOARD} with {AXES} axes"
        );
        let compiler = compiler(elf)?;
        Ok(Self {
            page: page::page(report, cargo::root())?,
            json: json(report, &compiler)?,
            promise: text::promises(report).join("\n* ") + "\n",
            block: block(report, &compiler),
            compiler,
        })
    }

    /// The document with what is promised and the tables in it.
    fn text(&self, old: &str) -> Result<String> {
        let text = with_part(old, BEGIN_PROMISE, END_PROMISE, &self.promise);
        let text = text.and_then(|text| with_part(&text, BEGIN, END, &self.block));
        text.with_context(|| format!("{TEXT} has no line {BEGIN_PROMISE} or {BEGIN}"))
    }
}

/// Writes the documents.
pub(super) fn write(report: &Report, elf: &Path) -> Result<()> {
    let made = Made::of(report, elf)?;
    let text = made.text(&read(TEXT)?)?;
    for (path, content) in [(PAGE, made.page), (JSON, made.json), (TEXT, text)] {
        fs::write(cargo::root().join(path), content)
            .with_context(|| format!("cannot write {path}"))?;
        ui::status("Written", path);
    }
    Ok(())
}

/// Fails when a document is not what `report` says; returns what was found.
pub(super) fn check(report: &Report, elf: &Path) -> Result<String> {
    let made = Made::of(report, elf)?;
    let committed: Value =
        serde_json::from_str(&read(JSON)?).with_context(|| format!("{JSON} is no JSON"))?;
    let compiler = committed["compiler"].as_str().unwrap_or_default();
    if compiler != made.compiler {
        return Ok(format!(
            "not compared: the documents show the code of {compiler}, this is {}",
            made.compiler
        ));
    }
    let text = read(TEXT)?;
    let is_same = [
        (PAGE, read(PAGE)? == made.page),
        (JSON, read(JSON)? == made.json),
        (TEXT, text == made.text(&text)?),
    ];
    for (path, is_same) in is_same {
        if !is_same {
            bail!("{path} is out of date: run `cargo xtask schedule --write`");
        }
    }
    Ok("the documents show this report".into())
}

/// The report for programs, without the file's hash: the file has names of folders in it.
fn json(report: &Report, compiler: &str) -> Result<String> {
    let mut value = serde_json::to_value(report)?;
    if let Some(object) = value.as_object_mut() {
        object.remove("elf_sha256");
        object.insert("compiler".into(), compiler.into());
    }
    Ok(serde_json::to_string_pretty(&value)? + "\n")
}

/// The table of the document.
fn block(report: &Report, compiler: &str) -> String {
    let mut block = format!(
        "`cargo xtask schedule` on {BOARD}, {AXES} axes, {} steps a second, {}, {}; {}:\n\n```text\n{}```\n\n",
        separated(report.step_rate_hz.into()),
        link("at", report.baud, separated),
        compiler.split(" (").next().unwrap_or(compiler),
        text::calibration(report),
        text::tasks(report)
    );
    block += "| | |\n|---|---|\n";
    for (name, value) in text::figures(report) {
        let _ = writeln!(block, "| {name} | {value} |");
    }
    block + &figures(report) + &believed(report)
}

/// The numbers that the proof counts on, with what is known of them.
fn figures(report: &Report) -> String {
    let mut table = String::from(
        "\nThe numbers of `schedule.toml` that the proof counts on, and how far each is known:\n\n\
         | numbers | what they claim | how far that is known |\n|---|---|---|\n",
    );
    for figures in &report.figures {
        let formulas = figures.formulas.iter();
        let formulas = formulas.map(|(name, formula)| format!("`{name}` = `{formula}`"));
        let formulas = formulas.collect::<Vec<_>>().join("<br>");
        let _ = writeln!(
            table,
            "| {formulas} | {} | {} |",
            figures.claim,
            text::known(figures)
        );
    }
    table
}

/// The bounds of loops that nothing counts.
fn believed(report: &Report) -> String {
    let mut table = String::from(
        "\nThe comments that bound loops which nothing counts, and are believed:\n\n\
         | comment | most runs | why |\n|---|---|---|\n",
    );
    for it in &report.believed {
        let _ = writeln!(table, "| {} | `{}` | {} |", it.place, it.count, it.reason);
    }
    table
}

#[cfg(test)]
mod tests {
    use super::*;
    use crate::sample;

    fn made() -> Made {
        let report = sample::report();
        Made {
            page: String::new(),
            json: json(&report, "rustc version 1.95.0").unwrap(),
            promise: "promise\n".into(),
            block: block(&report, "rustc version 1.95.0 (59807616e 2026-04-14)"),
            compiler: "rustc version 1.95.0".into(),
        }
    }

    #[test]
    fn the_block_stands_between_its_marks_and_nothing_else_changes() {
        let old = format!("before\n{BEGIN_PROMISE}old\n{END_PROMISE}{BEGIN}old\n{END}after\n");
        let text = made().text(&old).unwrap();
        assert!(text.starts_with(&format!(
            "before\n{BEGIN_PROMISE}promise\n{END_PROMISE}{BEGIN}`cargo xtask schedule` on netduino-plus-2"
        )));
        assert!(text.ends_with(&format!("{END}after\n")));
        assert!(!text.contains("old\n"));
        assert_eq!(made().text(&text).unwrap(), text, "made again it stays");
        assert!(made().text("no marks").is_err());
    }

    #[test]
    fn what_is_committed_names_the_compiler_and_no_hash() {
        let value: Value = serde_json::from_str(&made().json).unwrap();
        assert_eq!(value["compiler"], "rustc version 1.95.0");
        assert_eq!(value["elf_sha256"], Value::Null);
        assert_eq!(value["proven_step_rate_hz"]["115200"], 176_000);
        assert_eq!(value["tasks"][0]["name"], "step");
        assert!(made().block.contains("rustc version 1.95.0;"));
    }
}
