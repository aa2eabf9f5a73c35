//! The job: what stands before its start, the start, how far it is, and its end.

use grbl_client::{
    client::{Command, JobState},
    realtime,
};
use yew::prelude::*;

use crate::{context::use_page_context, model::Model};

/// What stands between the operator and the start of the job: nothing, or what to do first.
fn obstacle(model: &Model) -> Option<&'static str> {
    if !model.is_there() {
        Some("connect to a machine first")
    } else if model.program.is_none() {
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
fn start_words(model: &Model) -> String {
    match &model.program {
        Some(program) => format!("Run {} from line 1", program.name),
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

/// The job of the program.
#[component]
pub fn Job() -> Html {
    let context = use_page_context();
    let model = &*context.model;
    let job = model.machine.job.as_ref();
    let is_running = model.is_job_running();
    let obstacle = obstacle(model);
    let start = {
        let context = context.clone();
        Callback::from(move |_: MouseEvent| {
            if let Some(program) = &context.model.program {
                let (name, text) = (program.name.clone(), program.text.clone());
                context.send(Command::Program { name, text });
                context.send(Command::Start {
                    line: 0,
                    approach: Vec::new(),
                });
            }
        })
    };
    let stop = {
        let context = context.clone();
        Callback::from(move |_: MouseEvent| context.send(Command::Stop))
    };
    html! {
        <>
            if let Some(job) = job { { shown(job) } }
            <button id="run" type="button" class="main" disabled={obstacle.is_some() || is_running}
                onclick={start}>{ start_words(model) }</button>
            <button id="stop" type="button" disabled={!is_running} onclick={stop}>{ "Stop" }</button>
            if !is_running {
                <p class="hint">{ obstacle.map_or_else(|| spindle_words(model), Into::into) }</p>
            }
        </>
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
    use std::rc::Rc;

    use super::*;
    use crate::model::{Connection, Program};

    fn job(executed: usize, is_running: bool, outcome: &str) -> JobState {
        JobState {
            name: "plate.nc".into(),
            lines: 8,
            first: 0,
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
        model.program = Some(Rc::new(Program::default()));
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
