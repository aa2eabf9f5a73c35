//! The start at a line: where the program really begins, what is sent before, and what the operator has to see to.

use grbl_client::client::Command;
use web_sys::HtmlInputElement;
use yew::prelude::*;

use crate::{
    areas::field::Field,
    context::use_page_context,
    model::{Action, FoundEntry, Model},
};

/// What the operator confirms before a start amid a program.
fn confirmation(model: &Model, tool: u8) -> String {
    let tool = match tool {
        0 => "the right tool".into(),
        tool => format!("T{tool}"),
    };
    let place = if model.machine.homed.is_some() {
        ""
    } else {
        "The machine was not homed, but it is where it says; "
    };
    format!("{place}{tool} is in the spindle, and nothing is in between.")
}

/// Where the program begins, in words.
fn entry_words(found: &FoundEntry) -> Vec<String> {
    let FoundEntry { wanted, entry, .. } = found;
    let line = entry.line + 1;
    let mut words = Vec::new();
    if line < *wanted {
        words.push(format!(
            "Line {wanted} cannot begin a job: it begins at line {line}."
        ));
    }
    words.push(match entry.tool {
        0 => "No tool is named before it.".into(),
        tool => format!("T{tool} has to be in the spindle."),
    });
    let position = entry.position.join(" ");
    words.push(format!("It begins at {position} in work coordinates."));
    words
}

/// What the start at a line is given.
#[derive(Clone, PartialEq, Properties)]
pub struct StartAtLineProperties {
    /// The place of a line is to be found.
    pub on_find: Callback<usize>,
}

/// The start at a line.
#[component]
pub fn StartAtLine(properties: &StartAtLineProperties) -> Html {
    let context = use_page_context();
    let model = &*context.model;
    let typed = use_state(|| None::<usize>);
    let stopped_in = model.plan.stopped_in;
    {
        // The line in which a job was stopped comes in place of what was typed before.
        let typed = typed.clone();
        use_effect_with(stopped_in, move |_| typed.set(None));
    }
    let line = typed.or(stopped_in).unwrap_or(1);
    let type_line = Callback::from(move |text: String| typed.set(text.parse().ok()));
    let find = {
        let on_find = properties.on_find.clone();
        Callback::from(move |_: MouseEvent| on_find.emit(line))
    };
    let may_find = model.program.is_some() && model.may_ask() && !model.is_checking();
    html! {
        <details id="start-at-line" open={stopped_in.is_some()}>
            <summary>{ "Start at a line" }</summary>
            if let Some(line) = stopped_in { <p>{ format!("The job was stopped in line {line}.") }</p> }
            <label>{ "Line " }<Field id="entry-line" kind="number" min="1" step="1" value={line.to_string()}
                on_change={type_line} /></label>
            <button id="find-entry" type="button" disabled={!may_find} onclick={find}>{ "Find the start" }</button>
            {
                match model.entry() {
                    Some(Ok(found)) => html! { <Start found={found.clone()} /> },
                    Some(Err(reason)) => html! { <p role="alert">{ reason }</p> },
                    None => html! {},
                }
            }
        </details>
    }
}

/// A place in the program.
#[derive(Clone, PartialEq, Properties)]
struct StartProperties {
    found: std::rc::Rc<FoundEntry>,
}

/// What will be sent, and the button that starts it.
#[component]
fn Start(properties: &StartProperties) -> Html {
    let context = use_page_context();
    let model = &*context.model;
    let is_confirmed = use_state(|| false);
    let found = &properties.found;
    let may_start = *is_confirmed && model.may_ask() && model.plan.asked.is_none();
    let confirm = {
        let is_confirmed = is_confirmed.clone();
        Callback::from(move |event: Event| {
            let input = event.target_unchecked_into::<HtmlInputElement>();
            is_confirmed.set(input.checked());
        })
    };
    let start = {
        let (context, found, is_confirmed) = (context.clone(), found.clone(), is_confirmed.clone());
        Callback::from(move |_: MouseEvent| {
            is_confirmed.set(false);
            let (name, text) = (found.program.name.clone(), found.program.text.clone());
            let line = found.entry.line;
            let approach = found.entry.approach.clone();
            context.model.dispatch(Action::Begin(line));
            context.send(Command::Program { name, text });
            context.send(Command::Start { line, approach });
        })
    };
    let name = &found.program.name;
    html! {
        <div id="entry">
            { for entry_words(found).into_iter().map(|words| html! { <p>{ words }</p> }) }
            <p>{ "Before it the machine gets these lines: Z goes to the top, then the other axes to their place, the \
                spindle starts, and Z goes down." }</p>
            <pre>{ found.entry.approach.join("\n") }</pre>
            <details><summary>{ "Modes" }</summary><code>{ &found.entry.modes }</code></details>
            <label><input id="confirm-entry" type="checkbox" checked={*is_confirmed} onchange={confirm} />
                { format!(" {}", confirmation(model, found.entry.tool)) }</label>
            <button id="run-entry" type="button" class="main" disabled={!may_start} onclick={start}>
                { format!("Run {name} from line {}", found.entry.line + 1) }</button>
        </div>
    }
}
