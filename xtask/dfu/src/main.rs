//! `cargo xtask flash --dfu`: the board is found first, then the firmware is built, proven and written.

use std::process::ExitCode;

use anyhow::{Context as _, Result};
use common::{
    options::{self, Flash, Verb},
    ui,
};
use dfu::{RomBootloader, Step, usb};
use firmware::{
    flash::{self, FirmwareSource, Image},
    release,
};
use indicatif::{ProgressBar, ProgressStyle};

fn main() -> ExitCode {
    common::main(|| match options::read() {
        Verb::Flash(options) => run(&options),
        other => other.refuse(),
    })
}

fn run(options: &Flash) -> Result<ExitCode> {
    let chosen = FirmwareSource::by(options)?;
    let board = &chosen.board;
    let method = flash::by(board, release::BY_DFU)?;
    chosen.check(&method)?;
    // Nothing is compiled or proven in vain.
    let how = format!("{} (docs/boards/{}.md)", release::to_dfu(board), board.name);
    let loader = RomBootloader::new(usb::wait(&how)?, board)?;
    let file = chosen.file(&method)?;
    let image = Image::read_dfu(board, &file)?;
    // What fails from here on leaves the board without a whole firmware.
    loader.make_ready()?;
    ui::status("Writing", &file.display().to_string());
    let bar = progress(image.bytes());
    let mut message = "";
    let written = loader.write(&image, |step, bytes| {
        let now = match step {
            Step::Written => "written",
            Step::Compared => "compared",
        };
        if now != message {
            message = now;
            bar.set_position(0);
            bar.set_message(now);
        }
        bar.inc(bytes as u64);
    });
    bar.finish_and_clear();
    written.with_context(|| {
        format!(
            "the board has no whole firmware now: {}",
            flash::again(board)
        )
    })?;
    loader.start(image.start())?;
    let what = format!("{}: connect a sender", board.name);
    ui::status("Started", &what);
    Ok(ExitCode::SUCCESS)
}

fn progress(bytes: usize) -> ProgressBar {
    let template = "{bar:40.green/dim} {percent:>3} %  {bytes} of {total_bytes} {msg}";
    let style = ProgressStyle::with_template(template)
        .expect("the template is fixed")
        .progress_chars("━╸─");
    ProgressBar::new(bytes as u64).with_style(style)
}
