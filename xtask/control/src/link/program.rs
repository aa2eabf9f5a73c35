//! The local program: a WebSocket, with a command in each text there, and an array of events in each from there.

use std::{cell::RefCell, rc::Rc};

use gloo_events::EventListener;
use gloo_timers::callback::Timeout;
use grbl_client::client::{Command, Event};
use serde::Deserialize;
use serde_json::{Value, json};
use wasm_bindgen::JsCast as _;
use web_sys::{MessageEvent, WebSocket};
use yew::Callback;

use crate::worker::{Control, Reply};

/// Where the program has it.
const PATH: &str = "/socket";
/// How much of a program is in a message, bytes: in JSON it is longer.
const PART: usize = 8 << 10;
/// After how long it is tried again, ms.
const RECONNECT_MS: u32 = 1000;

/// The local program.
pub struct ToProgram(Rc<RefCell<Connection>>);

struct Connection {
    socket: Option<WebSocket>,
    listeners: Vec<EventListener>,
    again: Option<Timeout>,
    replies: Callback<Reply>,
}

impl ToProgram {
    pub(super) fn new(replies: Callback<Reply>) -> Self {
        let connection = Rc::new(RefCell::new(Connection {
            socket: None,
            listeners: Vec::new(),
            again: None,
            replies,
        }));
        open(&connection);
        Self(connection)
    }

    /// Sends a command. One that is asked for without a connection is dropped: nothing moves when it is back.
    pub(super) fn send(&self, command: &Command) {
        for text in messages(command) {
            self.send_text(&text);
        }
    }

    /// Takes control from another page.
    pub(super) fn take_control(&self) {
        self.send_text(r#"{"do":"take-control"}"#);
    }

    fn send_text(&self, text: &str) {
        let connection = self.0.borrow();
        let socket = connection.socket.as_ref();
        if let Some(socket) = socket.filter(|socket| socket.ready_state() == WebSocket::OPEN) {
            // One that is closing says so by its event.
            let _ = socket.send_with_str(text);
        }
    }
}

/// The texts of a command: a long program comes in parts.
fn messages(command: &Command) -> Vec<String> {
    let mut messages = Vec::new();
    let mut command = command.clone();
    if let Command::Program { text, .. } = &mut command {
        let mut rest = text.as_str();
        while rest.len() > PART {
            let (part, after) = rest.split_at(rest.floor_char_boundary(PART));
            messages.push(json!({"do": "program-part", "text": part}).to_string());
            rest = after;
        }
        *text = rest.to_owned();
    }
    messages.push(serde_json::to_string(&command).unwrap_or_default());
    messages
}

/// What the program tells: events of the client, and who controls.
#[derive(Deserialize)]
#[serde(untagged)]
enum Message {
    Control(ServerMessage),
    Event(Event),
}

#[derive(Deserialize)]
#[serde(tag = "is", rename_all = "kebab-case")]
enum ServerMessage {
    Control(Control),
}

/// What a message of the program tells.
fn replies_of(text: &str) -> Vec<Reply> {
    let values: Vec<Value> = serde_json::from_str(text).unwrap_or_default();
    let mut events = Vec::new();
    let mut replies = Vec::new();
    for value in values {
        match serde_json::from_value(value) {
            Ok(Message::Control(ServerMessage::Control(control))) => {
                replies.push(Reply::Control(control));
            }
            Ok(Message::Event(event)) => events.push(event),
            // A newer program may report more.
            Err(_) => {}
        }
    }
    replies.push(Reply::Events(events));
    replies
}

/// Where the program listens.
fn address() -> Option<String> {
    let location = web_sys::window()?.location();
    let scheme = match location.protocol().ok()?.as_str() {
        "https:" => "wss",
        _ => "ws",
    };
    Some(format!("{scheme}://{}{PATH}", location.host().ok()?))
}

fn open(connection: &Rc<RefCell<Connection>>) {
    let socket = address().and_then(|address| WebSocket::new(&address).ok());
    let replies = connection.borrow().replies.clone();
    let Some(socket) = socket else {
        replies.emit(Reply::Disconnected(
            "this page was not served by the local program".into(),
        ));
        return;
    };
    let opened = replies.clone();
    let received = replies.clone();
    let closed = Rc::downgrade(connection);
    let listeners = vec![
        EventListener::new(&socket, "open", move |_| opened.emit(Reply::Connected)),
        EventListener::new(&socket, "message", move |event| {
            let data = event.unchecked_ref::<MessageEvent>().data();
            let text = data.as_string().unwrap_or_default();
            for reply in replies_of(&text) {
                received.emit(reply);
            }
        }),
        EventListener::new(&socket, "close", move |_| {
            replies.emit(Reply::Disconnected(
                "the local program is gone: it is tried again".into(),
            ));
            let Some(connection) = closed.upgrade() else {
                return;
            };
            let next = Rc::downgrade(&connection);
            let again = Timeout::new(RECONNECT_MS, move || {
                if let Some(connection) = next.upgrade() {
                    open(&connection);
                }
            });
            connection.borrow_mut().again = Some(again);
        }),
    ];
    let mut connection = connection.borrow_mut();
    connection.socket = Some(socket);
    connection.listeners = listeners;
}

#[cfg(test)]
mod tests {
    use super::*;

    #[test]
    fn a_long_program_comes_in_parts_that_are_short_however_they_are_written() {
        let text = "\u{1}ü".repeat(PART);
        let name = "job.nc".to_owned();
        let mut joined = String::new();
        let command = Command::Program { name, text };
        let messages = messages(&command);
        for message in &messages {
            assert!(message.len() < 64 << 10, "{}", message.len());
            let message: Value = serde_json::from_str(message).unwrap();
            joined += message["text"].as_str().unwrap();
        }
        let Command::Program { text, .. } = command else {
            panic!("{command:?}");
        };
        assert!(joined == text && messages.len() == 4);
        assert_eq!(super::messages(&Command::Halt), [r#"{"do":"halt"}"#]);
    }

    #[test]
    fn events_and_control_come_in_one_message() {
        let text = r#"[{"is":"control","is_mine":false,"is_taken":true,"pages":2,"machine":"tty","is_connected":true},
            {"is":"later"},{"is":"note","text":"hello"}]"#;
        let control = Control {
            is_mine: false,
            is_taken: true,
            machine: "tty".into(),
            is_connected: true,
        };
        let note = Event::Note {
            text: "hello".into(),
        };
        let expected = [Reply::Control(control), Reply::Events(vec![note])];
        assert_eq!(replies_of(text), expected);
        assert_eq!(replies_of("nonsense"), [Reply::Events(Vec::new())]);
    }
}
