//! The program: opened, dropped or pasted, and run.

use gloo_events::EventListener;
use grbl_client::{
    client::{Command, JobState},
    realtime,
};
use wasm_bindgen::JsCast as _;
use wasm_bindgen_futures::{JsFuture, spawn_local};
use web_sys::{DragEvent, File, HtmlInputElement, HtmlTextAreaElement};
use yew::prelude::*;

use crate::{
    context::{PageContext, use_page_context},
    model::Model,
};

/// The name of what is pasted.
const PASTED: &str = "pasted.nc";

/// What stands between the operator and the start of the job: nothing, or what to do first.
fn obstacle(model: &Model) -> Option<&'static str> {
    let job = model.machine.job.as_ref();
    if !model.is_there() {
        Some("connect to a machine first")
    } else if job.is_none_or(|job| job.lines == 0) {
        Some("open a program first")
    } else {
        match model.state_name() {
            "Idle" => None,
            "Alarm" => Some("the machine is locked: home or unlock it first"),
            _ => Some("the machine has to be idle first"),
        }
    }
}

/// What the button starts.
fn start_words(job: Option<&JobState>) -> String {
    match job.filter(|job| job.lines > 0) {
        Some(job) => format!("Run {} from line 1", job.name),
        None => "Run".into(),
    }
}

/// The spindle before the start, in words.
fn spindle_words(model: &Model) -> String {
    if model.machine.accessories.contains(['S', 'C']) {
        format!("The spindle turns at {:.0} rpm.", model.machine.spindle)
    } else {
        "The spindle is off: the program starts it.".into()
    }
}

/// How far a job is: its part, and in words. Which line is carried out is not known of every machine; which ones it has
/// taken is.
fn progress(job: &JobState) -> (f64, String) {
    let JobState {
        lines,
        answered,
        executed,
        ..
    } = *job;
    let words = match job.outcome.as_str() {
        "" if !job.is_running => format!("{lines} lines"),
        "" if executed > 0 => format!("line {} of {lines}", (executed + 1).min(lines)),
        "" => format!("{answered} of {lines} lines taken"),
        "done" => format!("done: {lines} lines"),
        reason if job.is_running => reason.to_owned(),
        outcome => format!("{outcome}, {answered} of {lines} lines taken"),
    };
    let done = if executed > 0 { executed } else { answered };
    let part = match job.outcome.as_str() {
        "done" => 1.0,
        _ if lines == 0 => 0.0,
        _ => done.min(lines) as f64 / lines as f64,
    };
    (part, words)
}

/// Reads a file as a program.
fn take_file(context: &PageContext, file: File) {
    let context = context.clone();
    spawn_local(async move {
        let text = JsFuture::from(file.text()).await.ok();
        if let Some(text) = text.and_then(|text| text.as_string()) {
            let name = file.name();
            context.send(Command::Program { name, text });
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
    let model = &*context.model;
    let job = model.machine.job.as_ref();
    let is_running = model.is_job_running();
    let obstacle = obstacle(model);
    let open = {
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
    let command = |command: Command| {
        let context = context.clone();
        Callback::from(move |_: MouseEvent| context.send(command.clone()))
    };
    html! {
        <section class="program" aria-label="Program">
            <h2>{ "Program" }</h2>
            <fieldset disabled={!model.is_there() || is_running}>
                <label>{ "File " }<input id="file" type="file" onchange={open} /></label>
                <Paste />
            </fieldset>
            if let Some(job) = job { { shown(job) } }
            <button id="run" type="button" class="main" disabled={obstacle.is_some() || is_running}
                onclick={command(Command::Start)}>{ start_words(job) }</button>
            <button id="stop" type="button" disabled={!is_running} onclick={command(Command::Stop)}>{ "Stop" }</button>
            if !is_running {
                <p class="hint">{ obstacle.map_or_else(|| spindle_words(model), Into::into) }</p>
            }
        </section>
    }
}

/// A job and its progress.
fn shown(job: &JobState) -> Html {
    let (part, words) = progress(job);
    html! {
        <div class="job">
            <strong>{ &job.name }</strong>
            <progress max="1" value={part.to_string()} aria-label="Progress"></progress>
            <p id="job" role="status">{ words }</p>
        </div>
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
                context.send(Command::Program {
                    name: PASTED.into(),
                    text: area.value(),
                });
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

/// Hold and resume, which are never out of sight.
#[component]
pub fn HoldBar() -> Html {
    let context = use_page_context();
    let is_there = context.model.is_there();
    let byte = |byte| {
        let context = context.clone();
        Callback::from(move |_: MouseEvent| context.byte(byte))
    };
    html! {
        <div class="hold-bar" role="group" aria-label="Hold and resume">
            <button id="hold" type="button" disabled={!is_there} onclick={byte(realtime::HOLD)}>{ "Hold" }</button>
            <button id="resume" type="button" disabled={!is_there} onclick={byte(realtime::RESUME)}>{ "Resume" }</button>
        </div>
    }
}

#[cfg(test)]
mod tests {
    use super::*;
    use crate::model::Connection;

    fn job(executed: usize, is_running: bool, outcome: &str) -> JobState {
        JobState {
            name: "plate.nc".into(),
            lines: 8,
            answered: executed,
            executed,
            is_running,
            outcome: outcome.into(),
        }
    }

    #[test]
    fn a_job_starts_at_an_idle_machine_with_a_program() {
        let mut model = Model::default();
        assert_eq!(obstacle(&model), Some("connect to a machine first"));
        model.connection = Connection::Open;
        model.machine.is_there = true;
        model.machine.state = "Alarm".into();
        assert_eq!(obstacle(&model), Some("open a program first"));
        model.machine.job = Some(job(0, false, ""));
        assert!(obstacle(&model).is_some_and(|text| text.contains("unlock")));
        model.machine.state = "Idle".into();
        assert_eq!(obstacle(&model), None);
    }

    #[test]
    fn progress_is_in_lines() {
        for (job, part, words) in [
            (job(0, false, ""), 0.0, "8 lines"),
            (job(2, true, ""), 0.25, "line 3 of 8"),
            (job(8, false, "done"), 1.0, "done: 8 lines"),
            (job(4, true, "stopped"), 0.5, "stopped"),
            (job(4, false, "stopped"), 0.5, "stopped, 4 of 8 lines taken"),
            (
                JobState {
                    answered: 6,
                    ..job(0, true, "")
                },
                0.75,
                "6 of 8 lines taken",
            ),
        ] {
            assert_eq!(progress(&job), (part, words.into()));
        }
    }
}
