//! Which machine, and whether there is a line to it.

mod identity;

use std::{cell::RefCell, rc::Rc};

use gloo_events::{EventListener, EventListenerOptions};
use gloo_timers::callback::Timeout;
use wasm_bindgen_futures::spawn_local;
use web_sys::{HtmlInputElement, HtmlSelectElement};
use yew::prelude::*;

use crate::{
    context::{PageContext, use_page_context},
    model::{Connection, Model},
    wire::{Transport, choose_port, has_serial},
    worker::TimeFactor,
};
use identity::{about, use_identity};

/// The baud rates that machines have; the usual one first.
const BAUDS: [u32; 5] = [115_200, 230_400, 460_800, 921_600, 1_000_000];
/// How fast the virtual machine may go.
const TIME_FACTORS: [u32; 3] = [1, 5, 20];
/// Where a controller with a WebSocket is by default.
const ADDRESS: &str = "ws://fluidnc.local:81/";

/// After how long a line that was lost is opened again, ms.
const RECONNECT_MS: u32 = 1000;

/// What is chosen in the form.
#[derive(Debug, Clone, PartialEq, Eq)]
struct ConnectionForm {
    kind: String,
    baud: u32,
    address: String,
    time_factor: TimeFactor,
}

impl Default for ConnectionForm {
    fn default() -> Self {
        Self {
            kind: "virtual".into(),
            baud: BAUDS[0],
            address: ADDRESS.into(),
            time_factor: TimeFactor::default(),
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

/// A page whose worker sends the job says so before it is closed.
#[hook]
fn use_leave_warning(context: &PageContext) {
    let is_sending = context.link.has_choice() && context.model.is_job_running();
    use_effect_with(is_sending, |is_sending| {
        let window = web_sys::window().filter(|_| *is_sending);
        let options = EventListenerOptions::enable_prevent_default();
        let listener = window.map(|window| {
            EventListener::new_with_options(&window, "beforeunload", options, |event| {
                event.prevent_default();
            })
        });
        move || drop(listener)
    });
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
fn connect(context: PageContext, choice: ConnectionForm, wish: Rc<RefCell<Wish>>) {
    let open = move |transport: Transport| {
        *wish.borrow_mut() = Wish {
            transport: Some(transport.clone()),
            was_there: false,
        };
        let is_virtual = transport == Transport::Virtual;
        context.connect(transport);
        let time_factor = is_virtual.then_some(choice.time_factor);
        context.set_time_factor(time_factor.unwrap_or_default());
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
fn use_again(context: &PageContext, wish: Rc<RefCell<Wish>>) {
    wish.borrow_mut().was_there |= context.model.is_there();
    let connecting = context.clone();
    use_effect_with(context.model.connection.clone(), move |connection| {
        let again = wish
            .borrow()
            .again(connection)
            .map(|transport| Timeout::new(RECONNECT_MS, move || connecting.connect(transport)));
        move || drop(again)
    });
}

/// The choice of a machine.
#[component]
pub fn ConnectionArea() -> Html {
    let context = use_page_context();
    let choice = use_state(ConnectionForm::default);
    let wish = use_mut_ref(Wish::default);
    use_again(&context, wish.clone());
    use_identity(&context);
    use_leave_warning(&context);
    let is_closed = matches!(context.model.connection, Connection::Closed(_))
        && wish.borrow().again(&context.model.connection).is_none();
    let words = words(&context.model);
    let status = html! { <p role="status" id="connection">{ words }</p> };
    if !context.link.has_choice() {
        let take = {
            let context = context.clone();
            Callback::from(move |_: MouseEvent| context.link.take_control())
        };
        return html! {
            <section class="connection" aria-label="Connection">
                { status }
                { about(&context) }
                if context.model.is_watching() {
                    <button id="take-control" type="button" class="main" onclick={take}>{ "Take control" }</button>
                }
            </section>
        };
    }
    let submit = {
        let (context, choice) = (context.clone(), choice.clone());
        Callback::from(move |event: SubmitEvent| {
            event.prevent_default();
            if is_closed {
                connect(context.clone(), (*choice).clone(), wish.clone());
            } else {
                wish.take();
                context.link.disconnect();
            }
        })
    };
    let label = if is_closed { "Connect" } else { "Disconnect" };
    html! {
        <section class="connection" aria-label="Connection">
            <form onsubmit={submit}>
                <fieldset disabled={!is_closed}>{ fields(&choice) }</fieldset>
                if choice.kind == "virtual" { { time_factors(&context, &choice) } }
                <button id="connect" class="main">{ label }</button>
            </form>
            { status }
            { about(&context) }
            <a href="index.html#boards">{ "Install firmware" }</a>
        </section>
    }
}

/// How fast the virtual machine goes: also amid a job.
fn time_factors(context: &PageContext, choice: &UseStateHandle<ConnectionForm>) -> Html {
    let change = {
        let (context, choice) = (context.clone(), choice.clone());
        Callback::from(move |event: Event| {
            let chosen = event.target_unchecked_into::<HtmlSelectElement>().value();
            let time_factor = chosen.parse().map(TimeFactor).unwrap_or_default();
            context.set_time_factor(time_factor);
            choice.set(ConnectionForm {
                time_factor,
                ..(*choice).clone()
            });
        })
    };
    let options = TIME_FACTORS.map(|times| {
        let text = if times == 1 { "real time".into() } else { format!("{times} times as fast") };
        html! { <option value={times.to_string()} selected={choice.time_factor == TimeFactor(times)}>{ text }</option> }
    });
    html! { <label>{ "Speed " }<select id="speed" onchange={change}>{ for options }</select></label> }
}

/// The machine, and what else has to be known of it.
fn fields(choice: &UseStateHandle<ConnectionForm>) -> Html {
    let change = |change: fn(&mut ConnectionForm, String)| {
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
