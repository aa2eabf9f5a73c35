//! What the user sees: progress, headings and errors, coloured where the terminal shows colour.

use std::{
    env,
    ffi::OsStr,
    process::{Command, Stdio},
};

use anstream::{eprint, eprintln};
use clap::builder::styling::{AnsiColor, Styles};
use owo_colors::OwoColorize;

/// Colours of the help, as Cargo's own.
pub const STYLES: Styles = Styles::styled()
    .header(AnsiColor::Green.on_default().bold())
    .usage(AnsiColor::Green.on_default().bold())
    .literal(AnsiColor::Cyan.on_default().bold())
    .placeholder(AnsiColor::Cyan.on_default())
    .error(AnsiColor::Red.on_default().bold())
    .valid(AnsiColor::Green.on_default())
    .invalid(AnsiColor::Yellow.on_default());

/// Says what happens now: a verb and what it acts on, as Cargo does.
pub fn status(verb: &str, what: &str) {
    eprintln!("{:>12} {what}", verb.green().bold());
}

/// Says that something went wrong which does not stop the work.
pub fn warning(text: &str) {
    eprintln!("{} {text}", "warning:".yellow().bold());
}

/// Prints an error and its causes, one line each.
pub fn error(error: &anyhow::Error) {
    eprintln!("{} {error}", "error:".red().bold());
    for cause in error.chain().skip(1) {
        for (index, line) in cause.to_string().lines().enumerate() {
            let lead = if index == 0 { "because" } else { "" };
            eprint!("{:>9} ", lead.dimmed());
            eprintln!("{line}");
        }
    }
}

/// Opens a file or an address in the browser, as the desktop does.
pub fn open(target: &OsStr) {
    let program = match env::var_os("BROWSER") {
        Some(browser) => browser,
        None if cfg!(target_os = "macos") => "open".into(),
        None => "xdg-open".into(),
    };
    let started = Command::new(&program)
        .arg(target)
        .stdin(Stdio::null())
        .stdout(Stdio::null())
        .stderr(Stdio::null())
        .spawn();
    if started.is_err() {
        let program = program.display();
        warning(&format!(
            "{program} cannot be started: open the page yourself"
        ));
    }
}

/// What the help of every command ends with.
pub const AXES: &str = "`--axes N`, 3 to 6, before the command or behind it: with as many axes";
