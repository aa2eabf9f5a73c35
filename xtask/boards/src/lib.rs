//! The boards, as `[package.metadata.board.*]` in `Cargo.toml` lists them, and the firmware of each.
#![allow(
    clippy::missing_errors_doc,
    clippy::must_use_candidate,
    reason = "a library of the tools beside it: errors are sentences, which the user is shown"
)]

pub mod compile;

use std::{fmt::Write as _, process::Command};

use anyhow::{Context, Result, bail, ensure};
use common::cargo;
use serde::Deserialize;
use serde_json::Value;

/// A board the firmware can be built for.
#[derive(Debug, Clone, Deserialize)]
pub struct Board {
    /// The `board-` feature, without the prefix.
    #[serde(skip)]
    pub name: String,
    /// What probe-rs calls the chip.
    pub chip: String,
    /// The QEMU machine that emulates it.
    pub qemu: Option<String>,
}

/// Every board.
pub fn all() -> Result<Vec<Board>> {
    let output = Command::new(cargo::program())
        .args(["metadata", "--no-deps", "--format-version", "1"])
        .current_dir(cargo::root())
        .output()
        .context("cannot start cargo metadata")?;
    ensure!(
        output.status.success(),
        "cargo metadata failed: {}",
        String::from_utf8_lossy(&output.stderr)
    );
    let metadata: Value = serde_json::from_slice(&output.stdout)?;
    let packages = metadata["packages"].as_array().context("no packages")?;
    let boards = packages
        .iter()
        .find_map(|package| package["metadata"]["board"].as_object())
        .context("no [package.metadata.board.…] in Cargo.toml")?;
    boards
        .iter()
        .map(|(name, board)| {
            let board: Board = serde_json::from_value(board.clone())
                .with_context(|| format!("[package.metadata.board.{name}] in Cargo.toml"))?;
            Ok(Board {
                name: name.clone(),
                ..board
            })
        })
        .collect()
}

/// The board called `name`.
pub fn named(name: &str) -> Result<Board> {
    let boards = all()?;
    if let Some(board) = boards.iter().find(|board| board.name == name) {
        return Ok(board.clone());
    }
    let mut known = String::new();
    for board in &boards {
        write!(known, "\n  {}", board.name)?;
    }
    bail!("there is no board {name:?}; the boards are{known}")
}

/// The board called `name`, or every board.
pub fn chosen(name: Option<&str>) -> Result<Vec<Board>> {
    name.map_or_else(all, |name| Ok(vec![named(name)?]))
}

/// The board that QEMU emulates, and its machine.
pub fn emulated() -> Result<(Board, String)> {
    all()?
        .into_iter()
        .find_map(|board| board.qemu.clone().map(|machine| (board, machine)))
        .context("no board in Cargo.toml names a QEMU machine")
}
