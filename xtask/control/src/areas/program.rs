//! The program: opened, dropped or pasted, and run.

use std::rc::Rc;

use gloo_events::EventListener;
use wasm_bindgen::JsCast as _;
use wasm_bindgen_futures::{JsFuture, spawn_local};
use web_sys::{DragEvent, File, HtmlInputElement, HtmlTextAreaElement};
use yew::prelude::*;

use crate::{
    areas::job::Job,
    context::{PageContext, use_page_context},
    model::{Action, Program},
};

/// The name of what is pasted.
const PASTED: &str = "pasted.nc";

/// Opens a program.
fn open(context: &PageContext, name: String, text: String) {
    let program = Rc::new(Program { name, text });
    context.model.dispatch(Action::Open(program));
}

/// Reads a file as a program.
fn take_file(context: &PageContext, file: File) {
    let context = context.clone();
    spawn_local(async move {
        let text = JsFuture::from(file.text()).await.ok();
        if let Some(text) = text.and_then(|text| text.as_string()) {
            let name = file.name();
            open(&context, name, text);
        }
    });
}

/// Files may be dropped anywhere on the page.
#[hook]
fn use_drop(context: PageContext) {
    let latest = use_mut_ref(|| context.clone());
    *latest.borrow_mut() = context;
    use_effect_with((), move |()| {
        let document = web_sys::window().and_then(|window| window.document());
        let listeners = document.map(|document| {
            let options = gloo_events::EventListenerOptions::enable_prevent_default();
            let over = EventListener::new_with_options(&document, "dragover", options, |event| {
                event.prevent_default();
            });
            let drop = EventListener::new_with_options(&document, "drop", options, move |event| {
                event.prevent_default();
                let files = event.unchecked_ref::<DragEvent>().data_transfer();
                let file = files.and_then(|files| files.files()?.get(0));
                if let Some(file) = file {
                    take_file(&latest.borrow(), file);
                }
            });
            [over, drop]
        });
        move || drop(listeners)
    });
}

/// The program and its job.
#[component]
pub fn ProgramArea() -> Html {
    let context = use_page_context();
    use_drop(context.clone());
    let model = context.model.clone();
    let is_running = model.is_job_running();
    let open = Callback::from(move |event: Event| {
        let input = event.target_unchecked_into::<HtmlInputElement>();
        if let Some(file) = input.files().and_then(|files| files.get(0)) {
            take_file(&context, file);
        }
        // The same file can be opened again, as it is then.
        input.set_value("");
    });
    let program = model.program.as_deref();
    html! {
        <section class="program" aria-label="Program">
            <h2>{ "Program" }</h2>
            <fieldset disabled={is_running}>
                <label>{ "File " }<input id="file" type="file" onchange={open} /></label>
                <Paste />
            </fieldset>
            if let Some(program) = program {
                <p id="program">{ format!("{}, {} lines", program.name, program.text.lines().count()) }</p>
            }
            <Job />
        </section>
    }
}

/// A program that is typed or pasted.
#[component]
fn Paste() -> Html {
    let context = use_page_context();
    let area = use_node_ref();
    let take = {
        let area = area.clone();
        Callback::from(move |_: MouseEvent| {
            if let Some(area) = area.cast::<HtmlTextAreaElement>() {
                open(&context, PASTED.into(), area.value());
            }
        })
    };
    html! {
        <details>
            <summary>{ "or paste one" }</summary>
            <label>{ "Lines" }<textarea id="paste" ref={area} rows="6" spellcheck="false" /></label>
            <button id="take" type="button" onclick={take}>{ "Take these lines" }</button>
        </details>
    }
}
