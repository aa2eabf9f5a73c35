//! The view of the job: its path, with what has been cut and where the machine is.
//!
//! The page of the view is a document of its own, in a sandbox: it gets at nothing of this one, and what this one
//! sends is all that it learns of the machine.

use std::rc::Rc;

use serde::Serialize;
use wasm_bindgen::JsValue;
use web_sys::HtmlIFrameElement;
use yew::prelude::*;

use crate::{context::use_page_context, model::Model};

/// Where the local program serves what becomes the page of a view: its own pages may have no script in them.
const SHELL: &str = "/view.html";
const MM_PER_INCH: f64 = 25.4;
/// X, Y and Z.
const LINEAR_AXES: usize = 3;

/// What is shown.
#[derive(Clone, PartialEq, Properties)]
pub struct ViewProperties {
    /// The page of the job, as `pages::page::write` makes it.
    pub page: Rc<str>,
    /// The line in execution, counted from 1, where it is known.
    pub executed: Option<usize>,
}

/// What the page of the view is sent of the machine, see `frame.js` there.
#[derive(Debug, Clone, PartialEq, Serialize)]
struct MachineReport {
    /// The machine position, mm and degrees.
    machine: Vec<f64>,
    line: Option<usize>,
    state: String,
}

impl MachineReport {
    /// What there is to send; nothing before the machine has reported a position.
    fn of(model: &Model, line: Option<usize>) -> Option<Self> {
        let state = &model.machine;
        let scale = |axis| {
            if state.reports_inches && axis < LINEAR_AXES {
                MM_PER_INCH
            } else {
                1.0
            }
        };
        let machine = state.machine.iter().enumerate();
        let machine: Vec<_> = machine.map(|(axis, at)| at * scale(axis)).collect();
        (model.is_there() && machine.len() >= LINEAR_AXES).then(|| Self {
            machine,
            line,
            state: state.state.clone(),
        })
    }
}

/// Sends a text to a frame. Its origin has no name, as nothing else can be in it than what it was filled with.
fn send(frame: &NodeRef, text: &str) {
    let frame = frame.cast::<HtmlIFrameElement>();
    if let Some(window) = frame.and_then(|frame| frame.content_window()) {
        // A frame that is being closed needs nothing any more.
        let _ = window.post_message(&JsValue::from_str(text), "*");
    }
}

/// The view of a job.
#[component]
pub fn ViewArea(properties: &ViewProperties) -> Html {
    html! {
        <section class="view" aria-label="View">
            <h2>{ "View" }</h2>
            // Another page is another document.
            <Frame key={Rc::as_ptr(&properties.page).addr()} ..properties.clone() />
        </section>
    }
}

/// The document of a view.
#[component]
fn Frame(properties: &ViewProperties) -> Html {
    let context = use_page_context();
    let is_served = !context.link.has_choice();
    let frame = use_node_ref();
    // The shell is still to be filled.
    let is_shell = use_mut_ref(|| is_served);
    let report = MachineReport::of(&context.model, properties.executed);
    let message = report.map(|report| serde_json::to_string(&report).unwrap_or_default());
    {
        let frame = frame.clone();
        let is_shell = is_shell.clone();
        use_effect_with(message.clone(), move |message| {
            if let Some(message) = message.as_ref().filter(|_| !*is_shell.borrow()) {
                send(&frame, message);
            }
        });
    }
    let page = properties.page.clone();
    let loaded = {
        let frame = frame.clone();
        Callback::from(move |_: Event| {
            if is_shell.replace(false) {
                send(&frame, &page);
            } else if let Some(message) = &message {
                send(&frame, message);
            }
        })
    };
    let (address, content) = if is_served {
        (Some(SHELL), None)
    } else {
        (None, Some(AttrValue::from(properties.page.clone())))
    };
    html! {
        <iframe ref={frame} title="The path of the job" sandbox="allow-scripts" onload={loaded}
            src={address} srcdoc={content}></iframe>
    }
}

#[cfg(test)]
mod tests {
    use grbl_client::client::State;

    use super::*;
    use crate::model::Connection;

    #[test]
    fn the_view_is_sent_millimetres_and_degrees_of_a_machine_that_is_there() {
        let mut model = Model::default();
        assert_eq!(MachineReport::of(&model, Some(1)), None);
        model.connection = Connection::Open;
        model.machine = State {
            is_there: true,
            state: "Run".into(),
            machine: vec![1.0, 0.5, -1.0, 90.0],
            reports_inches: true,
            ..State::default()
        };
        let report = MachineReport::of(&model, Some(7)).expect("the machine is there");
        assert_eq!(report.machine, [25.4, 12.7, -25.4, 90.0]);
        let text = serde_json::to_string(&report).unwrap();
        assert_eq!(
            text,
            r#"{"machine":[25.4,12.7,-25.4,90.0],"line":7,"state":"Run"}"#
        );
    }
}
