//! Which machine, and whether there is a line to it.

use std::{cell::RefCell, rc::Rc};

use gloo_timers::callback::Timeout;
use wasm_bindgen_futures::spawn_local;
use web_sys::{HtmlInputElement, HtmlSelectElement};
use yew::prelude::*;

use crate::{
    desk::{Desk, use_desk},
    model::{Connection, Model},
    wire::{Transport, choose_port, has_serial},
};

/// The baud rates that machines have; the usual one first.
const BAUDS: [u32; 5] = [115_200, 230_400, 460_800, 921_600, 1_000_000];
/// Where a controller with a WebSocket is by default.
const ADDRESS: &str = "ws://fluidnc.local:81/";

/// After how long a line that was lost is opened again, ms.
const AGAIN_MS: u32 = 1000;

/// What is chosen in the form.
#[derive(Debug, Clone, PartialEq, Eq)]
struct Choice {
    kind: String,
    baud: u32,
    address: String,
}

impl Default for Choice {
    fn default() -> Self {
        Self {
            kind: "virtual".into(),
            baud: BAUDS[0],
            address: ADDRESS.into(),
        }
    }
}

/// The connection in words.
fn words(model: &Model) -> String {
    match &model.connection {
        Connection::Closed(reason) if reason.is_empty() => "not connected".into(),
        Connection::Closed(reason) => reason.clone(),
        Connection::Opening => "connecting".into(),
        Connection::Open if !model.control.iter().all(|control| control.is_connected) => {
            "there is no line to the machine: it is looked for".into()
        }
        Connection::Open if model.is_watching() => {
            "another page controls the machine: this one watches".into()
        }
        Connection::Open if model.machine.is_there => match &model.control {
            Some(control) => format!("connected: {}", control.machine),
            None => "connected".into(),
        },
        Connection::Open => "connected, but no machine answers".into(),
    }
}

/// What the operator wants to be connected to, and whether there was a machine: then a line that is lost is opened again.
#[derive(Debug, Default)]
struct Wish {
    transport: Option<Transport>,
    was_there: bool,
}

impl Wish {
    /// What is opened again.
    fn again(&self, connection: &Connection) -> Option<Transport> {
        let is_lost = matches!(connection, Connection::Closed(reason) if !reason.is_empty());
        self.transport.clone().filter(|_| is_lost && self.was_there)
    }
}

/// Opens the line that is chosen. A browser asks which port it is to be.
fn connect(desk: Desk, choice: Choice, wish: Rc<RefCell<Wish>>) {
    let open = move |transport: Transport| {
        *wish.borrow_mut() = Wish {
            transport: Some(transport.clone()),
            was_there: false,
        };
        desk.connect(transport);
    };
    match choice.kind.as_str() {
        "serial" => spawn_local(async move {
            if let Some((index, ports)) = choose_port().await {
                let baud = choice.baud;
                open(Transport::Serial { index, ports, baud });
            }
        }),
        "socket" => open(Transport::Socket {
            address: choice.address,
        }),
        _ => open(Transport::Virtual),
    }
}

/// Opens a line again that was lost.
#[hook]
fn use_again(desk: &Desk, wish: Rc<RefCell<Wish>>) {
    wish.borrow_mut().was_there |= desk.model.is_there();
    let connecting = desk.clone();
    use_effect_with(desk.model.connection.clone(), move |connection| {
        let again = wish
            .borrow()
            .again(connection)
            .map(|transport| Timeout::new(AGAIN_MS, move || connecting.connect(transport)));
        move || drop(again)
    });
}

/// The choice of a machine.
#[component]
pub fn ConnectionArea() -> Html {
    let desk = use_desk();
    let choice = use_state(Choice::default);
    let wish = use_mut_ref(Wish::default);
    use_again(&desk, wish.clone());
    let is_closed = matches!(desk.model.connection, Connection::Closed(_))
        && wish.borrow().again(&desk.model.connection).is_none();
    let words = words(&desk.model);
    let status = html! { <p role="status" id="connection">{ words }</p> };
    if !desk.link.has_choice() {
        let take = {
            let desk = desk.clone();
            Callback::from(move |_: MouseEvent| desk.link.take_control())
        };
        return html! {
            <section class="connection" aria-label="Connection">
                { status }
                if desk.model.is_watching() {
                    <button id="take-control" type="button" class="main" onclick={take}>{ "Take control" }</button>
                }
            </section>
        };
    }
    let submit = {
        let (desk, choice) = (desk.clone(), choice.clone());
        Callback::from(move |event: SubmitEvent| {
            event.prevent_default();
            if is_closed {
                connect(desk.clone(), (*choice).clone(), wish.clone());
            } else {
                wish.take();
                desk.link.disconnect();
            }
        })
    };
    let label = if is_closed { "Connect" } else { "Disconnect" };
    html! {
        <section class="connection" aria-label="Connection">
            <form onsubmit={submit}>
                <fieldset disabled={!is_closed}>{ fields(&choice) }</fieldset>
                <button id="connect" class="main">{ label }</button>
            </form>
            { status }
        </section>
    }
}

/// The machine, and what else has to be known of it.
fn fields(choice: &UseStateHandle<Choice>) -> Html {
    let change = |change: fn(&mut Choice, String)| {
        let choice = choice.clone();
        move |text: String| {
            let mut changed = (*choice).clone();
            change(&mut changed, text);
            choice.set(changed);
        }
    };
    let selected = |set: Box<dyn Fn(String)>| {
        Callback::from(move |event: Event| {
            set(event.target_unchecked_into::<HtmlSelectElement>().value());
        })
    };
    let kind = selected(Box::new(change(|choice, text| choice.kind = text)));
    let baud = selected(Box::new(change(|choice, text| {
        choice.baud = text.parse().unwrap_or(BAUDS[0]);
    })));
    let address = change(|choice, text| choice.address = text);
    let address = Callback::from(move |event: InputEvent| {
        address(event.target_unchecked_into::<HtmlInputElement>().value());
    });
    let option = |value: &'static str, text: &'static str| {
        html! { <option {value} selected={choice.kind == value}>{ text }</option> }
    };
    let bauds = BAUDS.map(|baud| {
        html! { <option value={baud.to_string()} selected={choice.baud == baud}>{ baud }</option> }
    });
    html! {
        <>
            <label>{ "Machine " }<select id="machine" onchange={kind}>
                { option("virtual", "virtual machine") }
                if has_serial() { { option("serial", "serial port") } }
                { option("socket", "WebSocket of a controller") }
            </select></label>
            if choice.kind == "serial" {
                <label>{ "Baud " }<select onchange={baud}>{ for bauds }</select></label>
            }
            if choice.kind == "socket" {
                <label>{ "Address " }<input type="url" value={choice.address.clone()} oninput={address} /></label>
            }
        </>
    }
}

#[cfg(test)]
mod tests {
    use super::*;

    #[test]
    fn a_line_is_opened_again_where_there_was_a_machine() {
        let lost = Connection::Closed("the cable is out".into());
        let mut wish = Wish {
            transport: Some(Transport::Virtual),
            was_there: false,
        };
        // A wrong address is not tried for ever.
        assert_eq!(wish.again(&lost), None);
        wish.was_there = true;
        assert_eq!(wish.again(&lost), Some(Transport::Virtual));
        for connection in [Connection::default(), Connection::Opening, Connection::Open] {
            assert_eq!(wish.again(&connection), None);
        }
    }

    #[test]
    fn the_connection_is_in_words() {
        let mut model = Model::default();
        assert_eq!(words(&model), "not connected");
        model.connection = Connection::Open;
        assert_eq!(words(&model), "connected, but no machine answers");
        model.machine.is_there = true;
        assert_eq!(words(&model), "connected");
        model.connection = Connection::Closed("the cable is out".into());
        assert_eq!(words(&model), "the cable is out");
    }
}
