//! The client of a machine in a worker: a browser that slows a hidden page down leaves it alone.

use std::cell::RefCell;

use gloo_timers::callback::Interval;
use grbl_client::{
    Client,
    client::{Command, Event},
};
use serde::{Deserialize, Serialize};
use wasm_bindgen::{JsCast as _, JsValue, prelude::Closure};
use web_sys::{DedicatedWorkerGlobalScope, MessageEvent, WorkerGlobalScope};

mod clock;

use crate::wire::{self, Transport, Wire};
use clock::ClientClock;
pub use clock::TimeFactor;

/// How often the client goes on, ms.
const TICK_MS: u32 = 20;

/// What the page asks the worker for.
#[derive(Debug, Clone, PartialEq, Serialize, Deserialize)]
pub enum Request {
    /// Opens a line, in place of any other.
    Connect(Transport),
    /// Has the virtual machine go faster, until another line is opened.
    TimeFactor(TimeFactor),
    /// Closes it. A jog ends before.
    Disconnect,
    /// For the client.
    Command(Command),
}

/// What the worker answers.
#[derive(Debug, Clone, PartialEq, Serialize, Deserialize)]
pub enum Reply {
    /// There is a line; whether a machine is at its end, its state says.
    Connected,
    /// There is none any more: why, as a sentence, or nothing where the page closed it.
    Disconnected(String),
    /// What the page is to show.
    Events(Vec<Event>),
    /// Who controls the machine, where the local program has it.
    Control(Control),
}

/// Who controls the machine of the local program: one page, and the others watch.
#[derive(Debug, Clone, PartialEq, Eq, Serialize, Deserialize)]
pub struct Control {
    /// This page.
    pub is_mine: bool,
    /// Any page.
    pub is_taken: bool,
    /// The machine's port or address.
    pub machine: String,
    /// There is a line to it.
    pub is_connected: bool,
}

/// The client and its line.
#[derive(Default)]
pub struct Controller {
    client: Client,
    wire: Option<Box<dyn Wire>>,
    clock: ClientClock,
    is_virtual: bool,
}

impl Controller {
    /// Takes what the page asks for, at a time in ms.
    pub fn request(&mut self, request: Request, now_ms: u64) -> Vec<Reply> {
        match request {
            Request::Connect(transport) => {
                self.close();
                self.client = Client::default();
                self.clock = ClientClock::at(now_ms);
                self.is_virtual = transport == Transport::Virtual;
                match wire::open(&transport, now_ms) {
                    Ok(wire) => {
                        self.wire = Some(wire);
                        vec![Reply::Connected]
                    }
                    Err(reason) => vec![Reply::Disconnected(reason)],
                }
            }
            Request::TimeFactor(time_factor) => {
                // No other machine waits for a clock.
                if self.is_virtual {
                    self.clock.time_factor = time_factor;
                }
                Vec::new()
            }
            Request::Disconnect => {
                self.close();
                vec![Reply::Disconnected(String::new())]
            }
            Request::Command(command) => {
                if self.wire.is_some() {
                    self.client.command(command, self.clock.now_ms());
                }
                self.exchange(now_ms)
            }
        }
    }

    /// Goes on, and shows what has happened since.
    pub fn tick(&mut self, now_ms: u64) -> Vec<Reply> {
        if self.wire.is_none() {
            return Vec::new();
        }
        let lost = self.exchange(now_ms);
        if lost.is_empty() {
            self.take_events()
        } else {
            lost
        }
    }

    /// Moves bytes both ways, as soon as there are any: what has come makes room for lines, and a short line is answered
    /// long before the next tick. Returns what is to be shown of a line that is lost.
    pub fn exchange(&mut self, now_ms: u64) -> Vec<Reply> {
        let mut times = self.clock.advance(now_ms);
        let lost =
            times.find_map(|now_ms| Some(self.exchange_at(now_ms)).filter(|it| !it.is_empty()));
        lost.unwrap_or_default()
    }

    fn exchange_at(&mut self, now_ms: u64) -> Vec<Reply> {
        let Some(wire) = &mut self.wire else {
            return Vec::new();
        };
        let client = &mut self.client;
        let received = wire.exchange(&[], now_ms).and_then(|bytes| {
            client.receive(&bytes, now_ms);
            client.tick(now_ms);
            wire.exchange(&client.take_output(), now_ms)
        });
        match received {
            Ok(bytes) => {
                client.receive(&bytes, now_ms);
                Vec::new()
            }
            Err(reason) => {
                client.lose_line();
                self.wire = None;
                let mut replies = self.take_events();
                replies.push(Reply::Disconnected(reason));
                replies
            }
        }
    }

    fn take_events(&mut self) -> Vec<Reply> {
        let events = self.client.take_events();
        let replies = (!events.is_empty()).then_some(Reply::Events(events));
        replies.into_iter().collect()
    }

    /// Ends a jog, and closes the line.
    fn close(&mut self) {
        if let Some(mut wire) = self.wire.take() {
            self.client.leave();
            // Where the line is broken, there is nobody to stop.
            let _ = wire.exchange(&self.client.take_output(), self.clock.now_ms());
            self.client.lose_line();
        }
    }
}

thread_local! {
    static CONTROLLER: RefCell<Controller> = RefCell::default();
}

/// Begins.
pub(crate) fn start() {
    let scope: DedicatedWorkerGlobalScope = js_sys::global().unchecked_into();
    let poster = scope.clone();
    let on_message = Closure::<dyn FnMut(MessageEvent)>::new(move |event: MessageEvent| {
        let text = event.data().as_string().unwrap_or_default();
        if let Ok(request) = serde_json::from_str(&text) {
            post(
                &poster,
                CONTROLLER.with_borrow_mut(|it| it.request(request, now_ms())),
            );
        }
    });
    scope.set_onmessage(Some(on_message.as_ref().unchecked_ref()));
    on_message.forget();
    let tick = move || post(&scope, CONTROLLER.with_borrow_mut(|it| it.tick(now_ms())));
    Interval::new(TICK_MS, tick).forget();
}

/// Goes on at once: bytes of the machine have come.
pub(crate) fn receive() {
    let scope: DedicatedWorkerGlobalScope = js_sys::global().unchecked_into();
    post(
        &scope,
        CONTROLLER.with_borrow_mut(|it| it.exchange(now_ms())),
    );
}

fn now_ms() -> u64 {
    // A clock that nobody sets.
    let scope: WorkerGlobalScope = js_sys::global().unchecked_into();
    scope.performance().map_or(0.0, |clock| clock.now()) as u64
}

fn post(scope: &DedicatedWorkerGlobalScope, replies: Vec<Reply>) {
    for reply in replies {
        let text = serde_json::to_string(&reply).unwrap_or_default();
        // A text can always be copied.
        let _ = scope.post_message(&JsValue::from(text));
    }
}

#[cfg(test)]
mod tests {
    use super::*;

    fn run(controller: &mut Controller, from_ms: u64, ms: u64) -> Vec<Reply> {
        let times = (from_ms..from_ms + ms).step_by(TICK_MS as usize);
        times.flat_map(|now_ms| controller.tick(now_ms)).collect()
    }

    fn x_mm(controller: &Controller) -> f64 {
        controller.client.state().machine[0]
    }

    #[test]
    fn a_jog_at_the_virtual_machine_ends_with_the_line() {
        let mut controller = Controller::default();
        let command = |command| Request::Command(command);
        let connected = controller.request(Request::Connect(Transport::Virtual), 0);
        assert_eq!(connected, [Reply::Connected]);
        let replies = run(&mut controller, 0, 500);
        assert!(matches!(replies[0], Reply::Events(_)));
        let line = Command::Line {
            number: 1,
            text: "$X".into(),
        };
        controller.request(command(line), 500);
        run(&mut controller, 500, 500);
        assert_eq!(controller.client.state().state, "Idle");
        let step = Command::Step {
            by: vec![1.5, 0.0, 0.0],
            feed: 3000.0,
        };
        controller.request(command(step), 1000);
        run(&mut controller, 1000, 3000);
        assert_eq!(x_mm(&controller), 1.5);
        let replies = controller.request(Request::Disconnect, 4000);
        assert_eq!(replies, [Reply::Disconnected(String::new())]);
        assert_eq!(run(&mut controller, 4000, 200), []);
    }

    #[test]
    fn the_virtual_machine_alone_goes_faster_and_its_client_with_it() {
        let mut controller = Controller::default();
        controller.request(Request::Connect(Transport::Virtual), 0);
        controller.request(Request::TimeFactor(TimeFactor(20)), 0);
        run(&mut controller, 0, 100);
        for (number, text) in ["$X", "G21G91G1X30F600"].into_iter().enumerate() {
            let text = text.into();
            let number = number as u32;
            controller.request(Request::Command(Command::Line { number, text }), 100);
        }
        // Three seconds of motion.
        run(&mut controller, 100, 260);
        assert_eq!(
            (controller.client.state().state.as_str(), x_mm(&controller)),
            ("Idle", 30.0)
        );
        controller.wire = None;
        controller.is_virtual = false;
        controller.request(Request::TimeFactor(TimeFactor(1)), 400);
        assert_eq!(controller.clock.time_factor, TimeFactor(20));
    }

    #[test]
    fn requests_and_replies_are_json() {
        let request = Request::Connect(Transport::Serial {
            index: 0,
            ports: 1,
            baud: 115_200,
        });
        let text = serde_json::to_string(&request).unwrap();
        assert_eq!(
            text,
            r#"{"Connect":{"Serial":{"index":0,"ports":1,"baud":115200}}}"#
        );
        assert_eq!(serde_json::from_str::<Request>(&text).unwrap(), request);
        let reply = Reply::Events(vec![Event::Note { text: "<b>".into() }]);
        let text = serde_json::to_string(&reply).unwrap();
        assert_eq!(serde_json::from_str::<Reply>(&text).unwrap(), reply);
    }
}
