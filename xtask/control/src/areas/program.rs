//! The program: opened, dropped or written, saved, and run.

use std::{collections::BTreeSet, rc::Rc};

use gloo_events::EventListener;
use wasm_bindgen::JsCast as _;
use wasm_bindgen_futures::{JsFuture, spawn_local};
use web_sys::{DragEvent, File, HtmlInputElement, HtmlSelectElement};
use yew::prelude::*;

use crate::{
    areas::{editor::Editor, job::Job},
    context::{PageContext, use_page_context},
    model::{Action, Model, Program},
    storage,
};

/// The name of what is written here.
const WRITTEN: &str = "program.nc";
/// What a newcomer begins with: a name, and a program.
const EXAMPLES: [(&str, &str); 3] = [
    ("plate.nc", include_str!("../../../../examples/plate.nc")),
    (
        "drilling.nc",
        include_str!("../../../../examples/drilling.nc"),
    ),
    ("pocket.nc", include_str!("../../../../examples/pocket.nc")),
];

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

/// The program with another text; what had no name has one then.
fn edited(model: &Model, text: String) -> Program {
    let name = model.program.as_ref().map(|program| program.name.clone());
    Program {
        name: name.unwrap_or_else(|| WRITTEN.into()),
        text,
    }
}

/// How long a program is, in words.
fn length_words(program: &Program) -> String {
    match program.text.lines().count() {
        1 => format!("{}, 1 line", program.name),
        lines => format!("{}, {lines} lines", program.name),
    }
}

/// The program and its job.
#[component]
pub fn ProgramArea() -> Html {
    let context = use_page_context();
    use_drop(context.clone());
    let program = context.model.program.clone();
    let words = use_memo(program.clone(), |program| {
        program.as_deref().map(length_words)
    });
    let none = use_memo((), |()| Program::default());
    let refused = use_memo(context.model.checked().cloned(), |checked| {
        let lines = checked.iter().flat_map(|checked| &checked.refused);
        lines.map(|refused| refused.line).collect::<BTreeSet<_>>()
    });
    let on_change = {
        let latest = use_mut_ref(|| context.clone());
        *latest.borrow_mut() = context.clone();
        use_callback((), move |text: String, ()| {
            let context = latest.borrow();
            let program = Rc::new(edited(&context.model, text));
            context.model.dispatch(Action::Edit(program));
        })
    };
    let is_locked = context.model.is_job_running() || context.model.is_watching();
    html! {
        <section class="program" aria-label="Program">
            <h2>{ "Program" }</h2>
            <fieldset disabled={is_locked}><Files /></fieldset>
            if let Some(words) = &*words { <p id="program">{ words.clone() }</p> }
            <Editor program={program.unwrap_or(none)} {refused} executed={context.model.executed_line()}
                go_to={context.model.go_to} {is_locked} {on_change} />
            <Job />
        </section>
    }
}

/// Where programs come from, and where they go.
#[component]
fn Files() -> Html {
    let context = use_page_context();
    let choose = {
        let context = context.clone();
        Callback::from(move |event: Event| {
            let input = event.target_unchecked_into::<HtmlInputElement>();
            if let Some(file) = input.files().and_then(|files| files.get(0)) {
                take_file(&context, file);
            }
            // The same file can be opened again, as it is then.
            input.set_value("");
        })
    };
    let example = {
        let context = context.clone();
        Callback::from(move |event: Event| {
            let select = event.target_unchecked_into::<HtmlSelectElement>();
            let value = select.value();
            if let Some((name, text)) = EXAMPLES.iter().find(|(name, _)| *name == value) {
                open(&context, (*name).into(), (*text).into());
            }
            select.set_selected_index(0);
        })
    };
    let empty = {
        let context = context.clone();
        Callback::from(move |_: MouseEvent| open(&context, WRITTEN.into(), String::new()))
    };
    let program = context.model.program.clone();
    let has_none = program.is_none();
    let save = Callback::from(move |_: MouseEvent| {
        if let Some(program) = &program {
            storage::save_file(&program.name, &program.text);
        }
    });
    let replaced = context.model.replaced.clone().map(|replaced| {
        let name = format!("Back to {}", replaced.name);
        let model = context.model.dispatcher();
        let back =
            Callback::from(move |_: MouseEvent| model.dispatch(Action::Open(replaced.clone())));
        html! { <button id="back" type="button" onclick={back}>{ name }</button> }
    });
    let options = EXAMPLES.map(|(name, _)| html! { <option>{ name }</option> });
    html! {
        <>
            <label>{ "File " }<input id="file" type="file" onchange={choose} /></label>
            <label>{ "Example " }<select id="example" onchange={example}><option value="" selected=true>{ "choose" }</option>
                { for options }</select></label>
            <button id="new" type="button" onclick={empty}>{ "New" }</button>
            <button id="save" type="button" disabled={has_none} onclick={save}>{ "Save as file" }</button>
            { for replaced }
        </>
    }
}

#[cfg(test)]
mod tests {
    use grbl_client::client::JobState;

    use super::*;

    #[test]
    fn what_is_edited_keeps_its_name() {
        let mut model = Model::default();
        let written = edited(&model, "G0X1".into());
        assert_eq!(length_words(&written), "program.nc, 1 line");
        model.program = Some(Rc::new(Program {
            name: "plate.nc".into(),
            text: String::new(),
        }));
        let changed = edited(&model, "G0X1\n\nM30\n".into());
        assert_eq!(length_words(&changed), "plate.nc, 3 lines");
    }

    #[test]
    fn the_line_in_execution_is_known_while_the_job_runs() {
        let job = |executed, is_running| JobState {
            lines: 6,
            executed,
            is_running,
            ..JobState::default()
        };
        for (job, line) in [
            (None, None),
            (Some(job(0, true)), None),
            (Some(job(3, true)), Some(4)),
            (Some(job(6, true)), Some(6)),
            (Some(job(3, false)), None),
        ] {
            let mut model = Model::default();
            model.machine.job = job;
            assert_eq!(model.executed_line(), line);
        }
    }

    #[test]
    fn examples_are_programs_that_end() {
        for (name, text) in EXAMPLES {
            assert!(text.contains("M30") || text.contains("M2"), "{name}");
        }
    }
}
