//! A worker of the page, with texts in JSON.

use gloo_events::EventListener;
use wasm_bindgen::{JsCast as _, JsValue};
use web_sys::{MessageEvent, Worker};
use yew::Callback;

use crate::worker::{Reply, Request};

/// Starts a worker that begins with a function of the page's code.
pub(super) fn start(module: &JsValue, address: &str, function: &str) -> Option<Worker> {
    let worker = Worker::new(address).ok()?;
    let beginning = js_sys::Array::of2(module, &function.into());
    // Code can always be handed over.
    let _ = worker.post_message(&beginning);
    Some(worker)
}

/// A worker.
pub struct ToWorker {
    worker: Option<Worker>,
    _listeners: Vec<EventListener>,
}

impl ToWorker {
    /// Starts one that runs the code of the page.
    pub(super) fn new(module: &JsValue, address: &str, replies: Callback<Reply>) -> Self {
        let Some(worker) = start(module, address, "start_worker") else {
            replies.emit(Reply::Disconnected("the browser starts no worker".into()));
            return Self {
                worker: None,
                _listeners: Vec::new(),
            };
        };
        let on_error = replies.clone();
        let listeners = vec![
            EventListener::new(&worker, "message", move |event| {
                let data = event.unchecked_ref::<MessageEvent>().data();
                let text = data.as_string().unwrap_or_default();
                if let Ok(reply) = serde_json::from_str(&text) {
                    replies.emit(reply);
                }
            }),
            EventListener::new(&worker, "error", move |_| {
                let text = "the worker has a fault, please report it: load the page again";
                on_error.emit(Reply::Disconnected(text.into()));
            }),
        ];
        Self {
            worker: Some(worker),
            _listeners: listeners,
        }
    }

    pub(super) fn request(&self, request: &Request) {
        let text = serde_json::to_string(request).unwrap_or_default();
        if let Some(worker) = &self.worker {
            // A text can always be copied.
            let _ = worker.post_message(&text.into());
        }
    }
}
