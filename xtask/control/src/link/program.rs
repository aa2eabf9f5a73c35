//! The local program: a WebSocket, with a command in each text there, and an array of events in each from there.

use std::{cell::RefCell, rc::Rc};

use gloo_events::EventListener;
use gloo_timers::callback::Timeout;
use grbl_client::client::{Command, Event};
use serde_json::Value;
use wasm_bindgen::JsCast as _;
use web_sys::{MessageEvent, WebSocket};
use yew::Callback;

use crate::worker::Reply;

/// Where the program has it.
const PATH: &str = "/socket";
/// After how long it is tried again, ms.
const AGAIN_MS: u32 = 1000;

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
        let text = serde_json::to_string(command).unwrap_or_default();
        let connection = self.0.borrow();
        let socket = connection.socket.as_ref();
        if let Some(socket) = socket.filter(|socket| socket.ready_state() == WebSocket::OPEN) {
            // One that is closing says so by its event.
            let _ = socket.send_with_str(&text);
        }
    }
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

/// The events of a message. What the program says of itself is none.
fn events(message: &str) -> Vec<Event> {
    let all: Vec<Value> = serde_json::from_str(message).unwrap_or_default();
    let events = all.into_iter().map(serde_json::from_value);
    events.filter_map(Result::ok).collect()
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
            received.emit(Reply::Events(events(&text)));
        }),
        EventListener::new(&socket, "close", move |_| {
            replies.emit(Reply::Disconnected(
                "the local program is gone: it is tried again".into(),
            ));
            let Some(connection) = closed.upgrade() else {
                return;
            };
            let next = Rc::downgrade(&connection);
            let again = Timeout::new(AGAIN_MS, move || {
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
    fn what_the_program_reports_of_itself_hides_no_event() {
        let text = r#"[{"is":"control","is_mine":true},{"is":"note","text":"idle"}]"#;
        let note = Event::Note {
            text: "idle".into(),
        };
        assert_eq!(events(text), [note]);
        assert_eq!(events("<b>"), []);
    }
}
