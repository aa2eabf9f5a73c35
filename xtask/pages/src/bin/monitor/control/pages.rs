//! The pages that are open, of which one controls the machine and the others watch.

use std::sync::Arc;

use grbl_client::client::{Event, State};
use serde::Serialize;

use super::socket::Page;

/// What a page is told.
#[derive(Debug, Serialize)]
#[serde(untagged)]
enum Message<'a> {
    ServerMessage(ServerMessage<'a>),
    Event(Event),
}

/// Who controls what, beside the events of the client.
#[derive(Debug, Serialize)]
#[serde(tag = "is", rename_all = "kebab-case")]
enum ServerMessage<'a> {
    Control {
        /// By the page that is told.
        is_mine: bool,
        /// By any page.
        is_taken: bool,
        /// Pages that are open.
        pages: usize,
        /// The machine's port or address.
        machine: &'a str,
        /// There is a line to it.
        is_connected: bool,
    },
}

/// The pages that are open.
#[derive(Debug)]
pub(super) struct Pages {
    machine: String,
    is_connected: bool,
    pages: Vec<Page>,
    /// The number of the page that controls.
    in_control: Option<usize>,
}

impl Pages {
    /// No page of a machine at a port or an address.
    pub(super) fn new(machine: &str) -> Self {
        Self {
            machine: machine.into(),
            is_connected: true,
            pages: Vec::new(),
            in_control: None,
        }
    }

    /// Adds a page and tells it everything: it controls if none does.
    pub(super) fn open(&mut self, page: Page, state: &State) {
        let number = page.number;
        self.pages.push(page);
        self.in_control.get_or_insert(number);
        let state = Message::Event(Event::State(Box::new(state.clone())));
        let all = json(&[self.control(number), state]);
        self.send(&all, |page| page == number);
        self.show_control();
    }

    /// Takes a page away; returns whether it was the one in control.
    pub(super) fn close(&mut self, number: usize) -> bool {
        self.pages.retain(|page| page.number != number);
        let was_in_control = self.in_control.take_if(|it| *it == number).is_some();
        self.show_control();
        was_in_control
    }

    /// Lets a page control, and no other one.
    pub(super) fn take_control(&mut self, number: usize) {
        self.in_control = Some(number);
        self.show_control();
    }

    /// Whether a page controls.
    pub(super) fn is_in_control(&self, number: usize) -> bool {
        self.in_control == Some(number)
    }

    /// Shows whether there is a line to the machine.
    pub(super) fn set_connected(&mut self, is_connected: bool) {
        self.is_connected = is_connected;
        self.show_control();
    }

    /// Tells every page what has happened.
    pub(super) fn tell(&mut self, events: &[Event]) {
        if !events.is_empty() && !self.pages.is_empty() {
            self.send(&json(events), |_| true);
        }
    }

    /// Tells a page a sentence.
    pub(super) fn note(&mut self, number: usize, text: &str) {
        let note = Event::Note { text: text.into() };
        self.send(&json(&[note]), |page| page == number);
    }

    fn show_control(&mut self) {
        for page in &self.pages {
            page.set_control(self.is_in_control(page.number));
        }
        let numbers: Vec<_> = self.pages.iter().map(|page| page.number).collect();
        for number in numbers {
            let control = json(&[self.control(number)]);
            self.send(&control, |page| page == number);
        }
    }

    fn control(&self, number: usize) -> Message<'_> {
        Message::ServerMessage(ServerMessage::Control {
            is_mine: self.is_in_control(number),
            is_taken: self.in_control.is_some(),
            pages: self.pages.len(),
            machine: &self.machine,
            is_connected: self.is_connected,
        })
    }

    /// Sends a message to pages. One that has not read what waits for it is dropped: it is told of as closed then.
    fn send(&mut self, message: &Arc<str>, is_meant: impl Fn(usize) -> bool) {
        self.pages
            .retain(|page| !is_meant(page.number) || page.send(message));
    }
}

fn json<T: Serialize>(events: &[T]) -> Arc<str> {
    // Of texts, numbers and lists, which always become JSON.
    serde_json::to_string(events).unwrap_or_default().into()
}
