//! A controller with a WebSocket of its own, as `FluidNC` and grblHAL have them.

use std::{cell::RefCell, mem, rc::Rc};

use gloo_events::EventListener;
use wasm_bindgen::JsCast as _;
use web_sys::{BinaryType, MessageEvent, WebSocket};

use super::Wire;
use crate::worker;

/// What `FluidNC` says to the page that it serves itself, in messages of their own.
const TO_ITS_PAGE: [&str; 3] = ["CURRENT_ID:", "ACTIVE_ID:", "PING:"];

/// The bytes of the machine in a message of text.
fn of_machine(text: String) -> Vec<u8> {
    let is_to_its_page = TO_ITS_PAGE
        .iter()
        .any(|beginning| text.starts_with(beginning));
    if is_to_its_page {
        Vec::new()
    } else {
        text.into_bytes()
    }
}

/// What has come, and why no more does.
#[derive(Default)]
pub(super) struct Inbox {
    pub(super) bytes: Vec<u8>,
    pub(super) failure: Option<String>,
    pub(super) is_open: bool,
}

impl Inbox {
    /// Takes what has come.
    pub(super) fn take(&mut self) -> Result<Vec<u8>, String> {
        match &self.failure {
            Some(failure) if self.bytes.is_empty() => Err(failure.clone()),
            _ => Ok(mem::take(&mut self.bytes)),
        }
    }
}

/// A WebSocket.
pub(super) struct Socket {
    socket: WebSocket,
    inbox: Rc<RefCell<Inbox>>,
    /// What is sent when it is open.
    unsent: Vec<u8>,
    _listeners: [EventListener; 3],
}

impl Socket {
    pub(super) fn open(address: &str) -> Result<Self, String> {
        let socket = WebSocket::new(address)
            .map_err(|_| format!("{address} is no address of a WebSocket: ws://HOST:PORT/"))?;
        socket.set_binary_type(BinaryType::Arraybuffer);
        let inbox = Rc::new(RefCell::new(Inbox::default()));
        let opened = inbox.clone();
        let received = inbox.clone();
        let closed = inbox.clone();
        let text = format!("there is no connection to {address}");
        let listeners = [
            EventListener::new(&socket, "open", move |_| opened.borrow_mut().is_open = true),
            EventListener::new(&socket, "message", move |event| {
                let data = event.unchecked_ref::<MessageEvent>().data();
                let bytes = match data.as_string() {
                    Some(text) => of_machine(text),
                    None => js_sys::Uint8Array::new(&data).to_vec(),
                };
                received.borrow_mut().bytes.extend(bytes);
                worker::receive();
            }),
            EventListener::new(&socket, "close", move |_| {
                closed.borrow_mut().failure = Some(text.clone());
            }),
        ];
        Ok(Self {
            socket,
            inbox,
            unsent: Vec::new(),
            _listeners: listeners,
        })
    }
}

impl Wire for Socket {
    fn exchange(&mut self, output: &[u8], _: u64) -> Result<Vec<u8>, String> {
        self.unsent.extend(output);
        let mut inbox = self.inbox.borrow_mut();
        if inbox.is_open && !self.unsent.is_empty() {
            // One that is closing says so by its event.
            let _ = self.socket.send_with_u8_array(&self.unsent);
            self.unsent.clear();
        }
        inbox.take()
    }
}

impl Drop for Socket {
    fn drop(&mut self) {
        let _ = self.socket.close();
    }
}

#[cfg(test)]
mod tests {
    use super::*;

    #[test]
    fn what_a_controller_says_to_its_own_page_is_not_the_machine() {
        assert_eq!(of_machine("<Idle|MPos:0,0,0>\r\n".into()).len(), 19);
        for text in ["CURRENT_ID:0", "ACTIVE_ID:0", "PING:0"] {
            assert_eq!(of_machine(text.into()), b"");
        }
    }
}
