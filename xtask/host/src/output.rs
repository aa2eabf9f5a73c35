//! What tools show and leave: progress bars and files of JSON.

use std::{
    fs::File,
    io::{BufWriter, Write as _},
    path::Path,
    time::Duration,
};

use anyhow::{Context, Result};
use indicatif::{ProgressBar, ProgressStyle};
use serde::Serialize;

/// Writes a value as JSON, streaming.
pub fn write_json(path: &Path, value: &impl Serialize) -> Result<()> {
    let name = path.display();
    let file = File::create(path).with_context(|| format!("cannot create {name}"))?;
    let mut writer = BufWriter::new(file);
    serde_json::to_writer(&mut writer, value).with_context(|| format!("cannot write {name}"))?;
    writeln!(writer)
        .and_then(|()| writer.flush())
        .with_context(|| format!("cannot write {name}"))
}

/// A progress bar over `length` of something; invisible when standard error is no terminal.
pub fn progress(length: u64, unit: &str) -> ProgressBar {
    let template = format!(
        "{{bar:40.green/dim}} {{percent:>3}} %  {{human_pos}} of {{human_len}} {unit}, {{eta}} left {{msg}}"
    );
    let style = ProgressStyle::with_template(&template)
        .expect("the template is fixed")
        .progress_chars("━╸─");
    let bar = ProgressBar::new(length).with_style(style);
    bar.enable_steady_tick(Duration::from_millis(200));
    bar
}
