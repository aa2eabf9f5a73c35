//! The job: what stands before its start, the start, how far it is, and its end.

use grbl_client::{
    client::{Command, JobState},
    realtime,
};
use yew::prelude::*;

use crate::{
    areas::{
        check::{BeforeRun, is_barred},
        progress::JobProgress,
    },
    context::use_page_context,
    model::{Action, Model},
};

/// What stands between the operator and the start of the job: nothing, or what to do first.
fn obstacle(model: &Model) -> Option<&'static str> {
    if !model.is_there() {
        Some("connect to a machine first")
    } else if model.is_watching() {
        Some("another page controls the machine: take control first")
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

/// For what the machine stands still amid a job, in words.
fn standstill(job: &JobState) -> Option<String> {
    if job.takes_lines {
        return Some("Jogs, probing and lines are taken now. Resume goes on with the job.".into());
    }
    let Some(waits) = job.waits.as_deref() else {
        let held = "Held. Resume goes on, Stop ends the job.";
        return job.is_held.then(|| held.into());
    };
    Some(match waits {
        "Hold" => "The program pauses. Resume goes on.".into(),
        "Door" => "The safety door is or was open. Close it, then resume.".into(),
        "Spindle is off" => "The spindle is off. Resume goes on all the same.".into(),
        _ if is_tool_change(waits) => format!("{waits}. Put the tool in, then resume."),
        _ => format!("{waits}. Resume goes on."),
    })
}

/// Whether a machine waits for a tool.
fn is_tool_change(waits: &str) -> bool {
    waits == "Tool" || waits.to_ascii_lowercase().contains("tool change")
}

/// Whether the machine can be asked for lines amid a job.
fn may_take_lines(model: &Model) -> bool {
    let job = model.machine.job.as_ref();
    let waits = job
        .filter(|job| !job.takes_lines)
        .and_then(|job| job.waits.as_deref());
    waits.is_some_and(is_tool_change) && !model.is_watching()
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
                context.model.dispatch(Action::Begin(0));
                context.send(Command::Program { name, text });
                context.send(Command::Start {
                    line: 0,
                    approach: Vec::new(),
                });
            }
        })
    };
    let command = |command: Command| {
        let context = context.clone();
        Callback::from(move |_: MouseEvent| context.send(command.clone()))
    };
    html! {
        <>
            if let Some(job) = job { { shown(job) } }
            <button id="run" type="button" class="main" disabled={obstacle.is_some() || is_running || is_barred(model)}
                onclick={start}>{ start_words(model) }</button>
            if may_take_lines(model) {
                <button id="take-lines" type="button" onclick={command(Command::TakeLines)}>{ "Jog and probe" }</button>
            }
            <button id="stop" type="button" disabled={!is_running || model.is_watching()}
                onclick={command(Command::Stop)}>{ "Stop" }</button>
            if !is_running {
                <BeforeRun />
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
            if let Some(words) = standstill(job) {
                <p id="waits" role="status">{ words }</p>
            }
            <JobProgress />
        </div>
    }
}

/// Hold and resume, which are never out of sight.
#[component]
pub fn HoldBar() -> Html {
    let context = use_page_context();
    // Any page may hold the machine; the one that controls it has it go on.
    let (is_there, may_operate) = (context.model.is_there(), context.model.may_operate());
    let byte = |byte| {
        let context = context.clone();
        Callback::from(move |_: MouseEvent| context.byte(byte))
    };
    html! {
        <div class="hold-bar" role="group" aria-label="Hold and resume">
            <button id="hold" type="button" disabled={!is_there} onclick={byte(realtime::HOLD)}>{ "Hold" }</button>
            <button id="resume" type="button" disabled={!may_operate} onclick={byte(realtime::RESUME)}>{ "Resume" }</button>
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
            is_held: false,
            waits: None,
            takes_lines: false,
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
    fn a_job_that_stands_still_says_for_what_and_offers_lines_in_a_change_of_the_tool_alone() {
        let mut model = Model::default();
        let mut shown = |waits: Option<&str>, takes_lines| {
            let job = JobState {
                is_held: true,
                waits: waits.map(str::to_owned),
                takes_lines,
                ..job(0, true, "")
            };
            model.machine.job = Some(job.clone());
            (standstill(&job).unwrap(), may_take_lines(&model))
        };
        for (waits, takes_lines, words, is_offered) in [
            (
                Some("Tool change: T2"),
                false,
                "Tool change: T2. Put the tool in",
                true,
            ),
            (
                Some("Tool change: T2"),
                true,
                "Jogs, probing and lines are taken",
                false,
            ),
            (Some("Tool"), false, "Tool. Put the tool in", true),
            (Some("Hold"), false, "The program pauses", false),
            (Some("Turn it over"), false, "Turn it over. Resume", false),
            (None, false, "Held.", false),
        ] {
            let (text, offered) = shown(waits, takes_lines);
            assert!(text.starts_with(words), "{text}");
            assert_eq!(offered, is_offered, "{text}");
        }
        assert_eq!(standstill(&job(2, true, "")), None);
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
