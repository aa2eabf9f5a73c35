//! The control page: from a file to a finished part, in a browser.
//!
//! A page and a worker are the same WebAssembly. The page ([`app`]) shows a [`model`] and asks for what the operator
//! does. A [`link`] leads to the client of the machine: in the [`worker`], which no browser slows down while the page
//! is hidden, or in the program that serves the page. What a program will do is found by the [`checker`] in a worker of
//! its own.
#![allow(
    clippy::must_use_candidate,
    reason = "a library of one page: what its functions return is what they are called for"
)]

pub mod app;
pub mod areas;
pub mod checker;
mod context;
pub mod link;
pub mod model;
mod storage;
pub mod wire;
pub mod worker;

use wasm_bindgen::prelude::{JsValue, wasm_bindgen};

/// Begins the page: with the code of the worker, where a script is that loads it, and who serves the page
/// (`program`: the local program, which has the client; else nobody).
#[wasm_bindgen]
pub fn start_page(module: JsValue, worker_address: String, server: &str) {
    app::start(module, worker_address, server == "program");
}

/// Begins the worker that has the client of a machine.
#[wasm_bindgen]
pub fn start_worker() {
    worker::start();
}

/// Begins the worker that checks programs.
#[wasm_bindgen]
pub fn start_checker() {
    checker::start();
}
