//! The worker that checks programs: a new one for each request, which ends the one before.

use std::cell::RefCell;

use gloo_events::EventListener;
use wasm_bindgen::{JsCast as _, JsValue};
use web_sys::{MessageEvent, Worker};
use yew::Callback;

use super::to_worker::start;
use crate::checker::{CheckReply, CheckRequest};

/// The way to it.
pub(crate) struct ToChecker {
    module: JsValue,
    address: String,
    replies: Callback<CheckReply>,
    running: RefCell<Option<Running>>,
}

struct Running {
    worker: Worker,
    _listeners: [EventListener; 2],
}

impl Drop for Running {
    fn drop(&mut self) {
        self.worker.terminate();
    }
}

impl ToChecker {
    /// The way to workers that run the code of the page.
    pub(crate) fn new(module: &JsValue, address: &str, replies: Callback<CheckReply>) -> Self {
        Self {
            module: module.clone(),
            address: address.into(),
            replies,
            running: RefCell::default(),
        }
    }

    /// Asks for something; of what was asked for before comes no reply any more.
    pub(crate) fn request(&self, request: &CheckRequest) {
        let Some(worker) = start(&self.module, &self.address, "start_checker") else {
            let reason = "the browser starts no worker".into();
            self.replies.emit(CheckReply::Failed(reason));
            return;
        };
        let text = serde_json::to_string(request).unwrap_or_default();
        // A text can always be copied.
        let _ = worker.post_message(&text.into());
        let (replies, faults) = (self.replies.clone(), self.replies.clone());
        let ended = worker.clone();
        let listeners = [
            EventListener::new(&worker, "message", move |event| {
                let data = event.unchecked_ref::<MessageEvent>().data();
                let text = data.as_string().unwrap_or_default();
                if let Ok(reply) = serde_json::from_str(&text) {
                    if !matches!(reply, CheckReply::Part(_)) {
                        // Its memory is wanted.
                        ended.terminate();
                    }
                    replies.emit(reply);
                }
            }),
            EventListener::new(&worker, "error", move |_| {
                let reason = "the check has a fault, please report it, with the program";
                faults.emit(CheckReply::Failed(reason.into()));
            }),
        ];
        self.running.replace(Some(Running {
            worker,
            _listeners: listeners,
        }));
    }
}
