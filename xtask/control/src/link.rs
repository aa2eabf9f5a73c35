//! From the page to the client of the machine: in a worker of the page, or in the local program that serves it.

mod program;
mod to_checker;
mod to_worker;

use grbl_client::client::Command;
use wasm_bindgen::JsValue;
use yew::Callback;

use crate::{
    wire::Transport,
    worker::{Reply, Request, TimeFactor},
};
use program::ToProgram;
pub(crate) use to_checker::ToChecker;
use to_worker::ToWorker;

/// Where the client is.
pub enum Link {
    /// In a worker, which has the line to the machine.
    Worker(ToWorker),
    /// In the local program, which is always at its machine.
    Program(ToProgram),
}

impl Link {
    /// A link to a worker that runs the code of the page, by a script at an address.
    pub(crate) fn worker(module: &JsValue, address: &str, replies: Callback<Reply>) -> Self {
        Self::Worker(ToWorker::new(module, address, replies))
    }

    /// A link to the program that serves the page.
    pub(crate) fn program(replies: Callback<Reply>) -> Self {
        Self::Program(ToProgram::new(replies))
    }

    /// Whether the page chooses the machine.
    pub fn has_choice(&self) -> bool {
        matches!(self, Self::Worker(_))
    }

    /// Opens a line to a machine; the local program has its own.
    pub fn connect(&self, transport: Transport) {
        if let Self::Worker(worker) = self {
            worker.request(&Request::Connect(transport));
        }
    }

    /// Has the virtual machine go faster.
    pub fn set_time_factor(&self, time_factor: TimeFactor) {
        if let Self::Worker(worker) = self {
            worker.request(&Request::TimeFactor(time_factor));
        }
    }

    /// Closes it.
    pub fn disconnect(&self) {
        if let Self::Worker(worker) = self {
            worker.request(&Request::Disconnect);
        }
    }

    /// Takes control of the local program's machine from another page.
    pub fn take_control(&self) {
        if let Self::Program(program) = self {
            program.take_control();
        }
    }

    /// Hands a command to the client.
    pub fn send(&self, command: Command) {
        match self {
            Self::Worker(worker) => worker.request(&Request::Command(command)),
            Self::Program(program) => program.send(&command),
        }
    }
}
