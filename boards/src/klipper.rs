//! `cargo xtask board import`: a board's file, made of a printer's configuration in Klipper's syntax.
//!
//! The syntax is that of Klipper's documents (`Config_Reference.md`). Sections and values are read by code of
//! our own: the crates `rust-ini` and `configparser` forget the lines that values were in, which every error
//! names, and know no `[include]` whose place in the file counts.

mod configuration;
mod pins;
mod printer;
mod skeleton;

use std::path::Path;

use crate::Fault;

/// Returns a board's file with what a printer's configuration tells of the board, and comments on what it does
/// not tell.
pub fn board_file(path: &Path) -> Result<String, Fault> {
    let configuration = configuration::Configuration::read(path)?;
    let printer = printer::Printer::of(&configuration)?;
    Ok(skeleton::text(&printer, path))
}
