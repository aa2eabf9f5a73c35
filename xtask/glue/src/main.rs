//! Writes WebAssembly as a browser loads it, and the script that loads it: `glue WASM FOLDER`.
//!
//! A program of its own: only those who make the control page compile what it needs.

use std::{env, path::PathBuf};

use anyhow::{Context, Result};
use wasm_bindgen_cli_support::Bindgen;

fn main() -> Result<()> {
    let mut arguments = env::args_os().skip(1).map(PathBuf::from);
    let (wasm, folder) = arguments
        .next()
        .zip(arguments.next())
        .context("usage: glue WASM FOLDER")?;
    Bindgen::new()
        .input_path(wasm)
        .no_modules(true)
        .context("wasm-bindgen knows this target no longer")?
        .typescript(false)
        .remove_name_section(true)
        .remove_producers_section(true)
        .generate(folder)
        .context("wasm-bindgen refuses the control page's code")
}
