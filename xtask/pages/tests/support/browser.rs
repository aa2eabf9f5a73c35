//! A page's side of the control server.

use std::{
    io::{Read as _, Write as _},
    net::TcpStream,
    time::{Duration, Instant},
};

use serde_json::{Value, json};
use tungstenite::{Message, WebSocket, client::IntoClientRequest as _, handshake::client::Request};

/// How long something may take that takes no time.
const PATIENCE: Duration = Duration::from_secs(20);

/// Who is known to the server, and where it is.
pub(crate) struct Known {
    pub(crate) address: String,
    pub(crate) cookie: String,
}

impl Known {
    /// Exchanges the address that was printed for the cookie.
    pub(crate) fn by(url: &str) -> Self {
        let (address, query) = url.split_once('/').unwrap();
        let answer = send(
            address,
            &format!("GET /{query} HTTP/1.1\r\nHost: {address}\r\n\r\n"),
        );
        assert!(answer.starts_with("HTTP/1.1 303"), "{answer}");
        let (_, cookie) = answer.split_once("Set-Cookie: ").unwrap();
        let (cookie, rest) = cookie.split_once("; ").unwrap();
        assert!(
            rest.starts_with("HttpOnly; SameSite=Strict; Path=/\r\n"),
            "{rest}"
        );
        let [address, cookie] = [address, cookie].map(str::to_owned);
        Self { address, cookie }
    }

    /// A request for the WebSocket.
    pub(crate) fn request(&self) -> Request {
        let address = &self.address;
        let mut request = format!("ws://{address}/socket")
            .into_client_request()
            .unwrap();
        let fields = request.headers_mut();
        fields.insert("Origin", format!("http://{address}").parse().unwrap());
        fields.insert("Cookie", self.cookie.parse().unwrap());
        request
    }

    /// Opens a page.
    pub(crate) fn page(&self) -> Page {
        let stream = TcpStream::connect(&self.address).unwrap();
        stream.set_read_timeout(Some(PATIENCE)).unwrap();
        let (socket, _) = tungstenite::client(self.request(), stream).unwrap();
        Page {
            socket,
            seen: Vec::new(),
            state: Value::Null,
        }
    }
}

/// Sends a request, and returns what is answered.
pub(crate) fn send(address: &str, request: &str) -> String {
    let mut stream = TcpStream::connect(address).unwrap();
    stream.set_read_timeout(Some(PATIENCE)).unwrap();
    // It may be refused before it has gone.
    let _ = stream.write_all(request.as_bytes());
    let mut answer = Vec::new();
    let _ = stream.read_to_end(&mut answer);
    String::from_utf8_lossy(&answer).into_owned()
}

/// A page.
pub(crate) struct Page {
    pub(crate) socket: WebSocket<TcpStream>,
    /// Events that have come and not been looked at.
    seen: Vec<Value>,
    /// The last state that has been looked at.
    state: Value,
}

impl Page {
    pub(crate) fn ask(&mut self, command: &Value) {
        self.socket
            .send(Message::text(command.to_string()))
            .unwrap();
    }

    /// Opens a program as pages do: a long one in parts.
    pub(crate) fn open(&mut self, lines: &str) {
        let mut rest = lines;
        while rest.len() > 8192 {
            let (part, after) = rest.split_at(8192);
            self.ask(&json!({"do": "program-part", "text": part}));
            rest = after;
        }
        self.ask(&json!({"do": "program", "name": "job.nc", "text": rest}));
    }

    /// The next event.
    pub(crate) fn event(&mut self) -> Value {
        while self.seen.is_empty() {
            if let Message::Text(text) = self.socket.read().unwrap() {
                self.seen = serde_json::from_str(&text).unwrap();
            }
        }
        let event = self.seen.remove(0);
        if event["is"] == "state" {
            self.state = event.clone();
        }
        event
    }

    /// Waits for a state, if it is not this one already.
    pub(crate) fn until_state(&mut self, is_it: impl Fn(&Value) -> bool) {
        if !is_it(&self.state) {
            self.until("state", is_it);
        }
    }

    /// Starts the job, as soon as the client has got the answers to its own questions.
    pub(crate) fn start(&mut self) {
        let is_running = |event: &Value| event["job"]["is_running"] == true;
        let is_refused = |event: &Value| event["is"] == "note";
        loop {
            self.ask(&json!({"do": "start"}));
            let mut events = std::iter::repeat_with(|| self.event());
            if events
                .find(|it| is_running(it) || is_refused(it))
                .is_some_and(|it| is_running(&it))
            {
                return;
            }
        }
    }

    /// Waits for an event of a kind.
    pub(crate) fn until(&mut self, kind: &str, is_it: impl Fn(&Value) -> bool) -> Value {
        let since = Instant::now();
        let mut last = Value::Null;
        while since.elapsed() < PATIENCE {
            let event = self.event();
            if event["is"] == kind && is_it(&event) {
                return event;
            }
            if event["is"] != "line" {
                last = event;
            }
        }
        panic!("no {kind} comes, the last event is {last}")
    }

    /// Sends a line, and returns the response.
    pub(crate) fn line(&mut self, text: &str) -> String {
        self.ask(&json!({"do": "line", "number": 1, "text": text}));
        let answer = self.until("answer", |_| true);
        answer["response"].as_str().unwrap().into()
    }

    /// Waits until the machine is at rest at an X, mm.
    pub(crate) fn until_at(&mut self, x_mm: f64) {
        self.until_state(|it| it["state"] == "Idle" && it["machine"][0] == x_mm);
    }
}

/// A jog by a distance along X, mm.
pub(crate) fn step(x_mm: f64) -> Value {
    json!({"do": "step", "by": [x_mm, 0.0, 0.0], "feed": 3000.0})
}
