//! What each area of the page has: what is known, and the way to the machine.

use std::{cell::Cell, rc::Rc};

use grbl_client::client::Command;
use yew::{UseReducerHandle, hook, use_context};

use crate::{
    app::Start,
    link::Link,
    model::{Action, Model},
    wire::Transport,
    worker::TimeFactor,
};

/// What each area has.
#[derive(Clone)]
pub(crate) struct PageContext {
    pub(crate) model: UseReducerHandle<Model>,
    pub(crate) link: Rc<Link>,
    /// The number of the last line.
    pub(crate) lines: Rc<Cell<u32>>,
    /// What workers begin with.
    pub(crate) start: Start,
}

impl PartialEq for PageContext {
    fn eq(&self, other: &Self) -> bool {
        self.model == other.model
    }
}

impl PageContext {
    /// Hands a command to the client.
    pub(crate) fn send(&self, command: Command) {
        self.link.send(command);
    }

    /// Sends a line.
    pub(crate) fn line(&self, text: &str) {
        let number = self.lines.get() + 1;
        self.lines.set(number);
        self.model.dispatch(Action::Sent(number, text.into()));
        self.send(Command::Line {
            number,
            text: text.into(),
        });
    }

    /// Sends a realtime byte.
    pub(crate) fn byte(&self, byte: u8) {
        self.send(Command::Realtime { byte });
    }

    /// Leads to a line of the program, counted from 1.
    pub(crate) fn go_to(&self, line: usize) {
        self.model.dispatch(Action::GoTo(line));
    }

    /// Opens a line to a machine.
    pub(crate) fn connect(&self, transport: Transport) {
        self.model.dispatch(Action::Opening);
        self.link.connect(transport);
    }

    /// Has the virtual machine go faster, or as fast as any other.
    pub(crate) fn set_time_factor(&self, time_factor: TimeFactor) {
        self.model.dispatch(Action::TimeFactor(time_factor));
        self.link.set_time_factor(time_factor);
    }
}

/// The context.
#[hook]
pub(crate) fn use_page_context() -> PageContext {
    use_context().expect("the page has a context")
}
