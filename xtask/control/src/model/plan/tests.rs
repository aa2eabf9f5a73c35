//! Checks, starts at a line and progress, as the page's state has them.

use grbl_client::client::{Event, JobState, State};

use super::*;
use crate::{
    checker::reply,
    model::{Action, Reply},
};

const PROGRAM: &str = "G21 G90\nG1 X10 F600\nX0\nX10\nX0\nG4 P1\n";

fn state(name: &str, x: f64, job: impl Into<Option<JobState>>) -> Action {
    let state = State {
        is_there: true,
        state: name.into(),
        machine: vec![x, 0.0, 0.0],
        work: vec![x, 0.0, 0.0],
        overrides: [100; 3],
        job: job.into(),
        ..State::default()
    };
    Action::Reply(Reply::Events(vec![Event::State(Box::new(state))]), 0)
}

fn job(answered: usize, is_running: bool, outcome: &str) -> JobState {
    JobState {
        name: "a.nc".into(),
        lines: 6,
        answered,
        is_running,
        is_held: is_running && !outcome.is_empty(),
        outcome: outcome.into(),
        ..JobState::default()
    }
}

/// An idle machine with a program.
fn model() -> Model {
    let mut model = Model::default();
    model.act(Action::Reply(Reply::Connected, 0));
    model.act(state("Idle", 0.0, None));
    let program = Program {
        name: "a.nc".into(),
        text: PROGRAM.into(),
    };
    model.act(Action::Open(Rc::new(program)));
    model
}

/// Asks the machine, answers as it would, and has the checker reply.
fn find(model: &mut Model, purpose: Purpose) {
    model.act(Action::Ask(purpose));
    assert!(
        model.pending_check().is_none(),
        "nothing is known of the machine"
    );
    let questions: Vec<_> = model.questions().collect();
    for (number, question) in (1..).zip(questions) {
        model.act(Action::Sent(number, question.into()));
        let (lines, response): (&[&str], _) = match question {
            "$+" => (&["$120=500.000", "$110=3000.000", "$130=200.000"], "ok"),
            "$#" => (&["[G54:0.000,0.000,0.000]"], "ok"),
            "$G" => (&["[GC:G0 G54 G17 G21 G90 G94 M5 M9 T0 F0 S0]"], "ok"),
            // As Grbl, which has no table of tools.
            "$TT" => (&[], "error:3"),
            _ => (&["[VER:1.1h.20190830:]"], "ok"),
        };
        let answer = Event::Answer {
            number,
            lines: lines.iter().map(ToString::to_string).collect(),
            response: response.into(),
        };
        model.act(Action::Reply(Reply::Events(vec![answer]), 0));
    }
    answer(model);
}

fn answer(model: &mut Model) {
    let (pending_check, request) = model.pending_check().expect("everything is known");
    model.act(Action::BeginCheck(Box::new(pending_check)));
    assert!(model.is_checking() && model.pending_check().is_none());
    model.act(Action::CheckReply(reply(&request, |_| ())));
    assert!(!model.is_checking());
}

#[test]
fn a_check_counts_as_long_as_program_and_machine_are_the_same() {
    let mut model = model();
    find(&mut model, Purpose::Check);
    assert_eq!(model.note, "");
    let checked = Rc::clone(model.valid_check().expect("it is checked"));
    assert_eq!(checked.extents_mm[0].travel, Some([-200.0, 0.0]));
    // Elsewhere the zero is the same.
    model.act(state("Idle", 3.0, None));
    assert!(model.valid_check().is_some());
    model.machine.work[0] = 0.0;
    assert!(model.valid_check().is_none() && model.checked().is_some());
    model.act(state("Idle", 3.0, None));
    model.settings.insert(110, "1000.000".into());
    assert!(model.valid_check().is_none());
    let edited = Program::clone(model.program.as_ref().unwrap());
    model.act(Action::Open(Rc::new(edited)));
    assert!(model.checked().is_none());
}

#[test]
fn a_machine_that_goes_while_it_is_asked_ends_the_check() {
    let mut model = model();
    model.act(Action::Ask(Purpose::Check));
    model.act(Action::Reply(
        Reply::Disconnected("the cable is out".into()),
        0,
    ));
    assert_eq!(model.check, Check::Failed("the machine is gone".into()));
    assert!(model.pending_check().is_none());
}

#[test]
fn the_time_that_is_left_stands_in_a_hold_and_the_line_is_known() {
    let mut model = model();
    find(&mut model, Purpose::Check);
    model.act(Action::Begin(0));
    model.act(state("Run", 0.0, job(5, true, "")));
    model.act(Action::Tick(0.25));
    let whole_s = model.progress().unwrap().left_s;
    assert!((4.0..6.0).contains(&whole_s), "{whole_s}");
    for _ in 0..6 {
        model.act(Action::Tick(0.25));
    }
    let progress = model.progress().unwrap().clone();
    assert!(
        (whole_s - progress.left_s - 1.5).abs() < 0.01,
        "{progress:?}"
    );
    assert_eq!((progress.line, model.executed_line()), (2, Some(3)));
    let held = JobState {
        is_held: true,
        ..job(5, true, "")
    };
    model.act(state("Hold:0", 4.0, held));
    for _ in 0..100 {
        model.act(Action::Tick(0.25));
    }
    assert_eq!(model.progress(), Some(&progress));
    model.act(state("Idle", 0.0, job(6, false, "done")));
    model.act(Action::Tick(0.25));
    assert_eq!((model.progress(), model.plan.stopped_in), (None, None));
}

#[test]
fn after_a_stop_the_job_goes_on_at_its_line() {
    let mut model = model();
    find(&mut model, Purpose::Check);
    model.act(Action::Begin(0));
    model.act(state("Run", 0.0, job(5, true, "")));
    model.act(state("Hold:0", 4.0, job(5, true, "stopped")));
    model.act(state("Idle", 4.0, job(5, false, "stopped")));
    // The answers alone lead back to a line that is surely not done.
    assert_eq!(model.plan.stopped_in, Some(2));
    answer(&mut model);
    assert_eq!(model.plan.stopped_in, Some(2));
    find(&mut model, Purpose::Enter(2));
    let Some(Ok(found)) = model.entry() else {
        panic!("{:?}", model.plan.entry);
    };
    assert_eq!((found.wanted, found.entry.line), (2, 1));
    // With another zero it is another place.
    model.machine.work[0] += 1.0;
    assert_eq!(model.entry(), None);
    model.machine.work[0] -= 1.0;
    assert!(model.entry().is_some() && model.may_ask());
    model.act(Action::Begin(1));
    assert_eq!((model.plan.stopped_in, model.entry()), (None, None));
    // Until the job has begun, nothing else is sent.
    assert!(!model.may_ask());
    model.act(state("Run", 4.0, job(1, true, "")));
    model.act(state("Idle", 4.0, job(6, false, "done")));
    assert!(model.may_ask());
}

#[test]
fn a_tool_that_was_measured_amid_the_job_is_changed_again() {
    let mut model = model();
    find(&mut model, Purpose::Check);
    model.act(Action::Begin(0));
    let changing = JobState {
        takes_lines: true,
        ..job(1, true, "")
    };
    model.act(state("Tool", 0.0, changing));
    model.act(state("Run", 0.0, job(6, true, "")));
    model.act(state("Idle", 0.0, job(6, false, "stopped")));
    assert_eq!(model.plan.stopped_in, Some(2));
    answer(&mut model);
    assert_eq!(model.plan.stopped_in, Some(2));
    model.act(Action::Ask(Purpose::Enter(2)));
    model.answers.insert("$#".into(), Rc::default());
    model.answers.insert("$TT".into(), Rc::default());
    model.answers.insert("$G".into(), Rc::default());
    let request = model.pending_check().unwrap().1;
    assert!(matches!(
        request,
        CheckRequest::Enter {
            reports_tool: true,
            ..
        }
    ));
}

#[test]
fn a_machine_that_is_not_idle_ends_the_check() {
    let mut model = model();
    model.act(Action::Ask(Purpose::Check));
    model.act(Action::Sent(1, "$+".into()));
    let answer = Event::Answer {
        number: 1,
        lines: Vec::new(),
        response: "error:8".into(),
    };
    model.act(Action::Reply(Reply::Events(vec![answer]), 0));
    assert!(matches!(model.check, Check::Failed(_)) && !model.answers.contains_key("$+"));
}

#[test]
fn a_program_that_was_not_checked_has_no_times() {
    let mut model = model();
    model.act(Action::Begin(0));
    model.act(state("Run", 0.0, job(2, true, "")));
    model.act(Action::Tick(1.0));
    assert_eq!(model.progress(), None);
    model.act(state("Idle", 0.0, job(2, false, "stopped")));
    assert_eq!(model.plan.stopped_in, None);
}
