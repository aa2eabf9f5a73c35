//! A job at a virtual machine amid which tools are changed: what the operator does then, and what the job does not.

mod operated;

use grbl_client::{
    client::{Command, Event, JobState, Probing, Target},
    realtime,
};
use operated::{OperatedMachine, TICK_MS};

/// Two tools, with a contour for each.
const JOB: &str =
    "G21G90G54G94\nT1M6\nM3S1000\nG1Z-1F600\nX10\nG0Z5\nT2M6\nM3S1000\nG1X5Y5F600\nZ-2\nG0Z5\nM5\n";
/// The top of the workpiece, seen from where the tool is at power-up, mm.
const TOP: f64 = -5.3;

fn job(operated: &OperatedMachine) -> JobState {
    operated.client.state().job.clone().unwrap_or_default()
}

fn press(operated: &mut OperatedMachine, byte: u8) {
    operated.command(Command::Realtime { byte });
}

fn step(operated: &mut OperatedMachine, by: [f64; 3]) {
    operated.command(Command::Step {
        by: by.into(),
        feed: 1000.0,
    });
}

/// Holds the key of X for a time.
fn hold_x(operated: &mut OperatedMachine, press: u32, ms: u64) {
    let end = operated.now_ms + ms;
    while operated.now_ms < end {
        operated.command(Command::Move {
            press,
            along: vec![-1, 0, 0],
            feed: 1200.0,
        });
        operated.run(TICK_MS * 4);
    }
}

/// Whether a note with these words has come.
fn is_noted(operated: &OperatedMachine, words: &str) -> bool {
    let mut events = operated.events.iter();
    events.any(|event| matches!(event, Event::Note { text } if text.contains(words)))
}

fn top() -> Probing {
    Probing {
        target: Target::Top,
        diameter: 3.0,
        plate: 0.0,
        search: 15.0,
        retract: 1.0,
        beside: 0.0,
        depth: 0.0,
        feed: 200.0,
    }
}

/// A machine that has begun the job.
fn begun() -> OperatedMachine {
    let mut operated = OperatedMachine::new(&[
        "$110=2000",
        "$111=2000",
        "$112=2000",
        "$120=500",
        "$121=500",
        "$122=500",
    ]);
    operated.command(Command::Program {
        name: "two.nc".into(),
        text: JOB.into(),
    });
    operated.command(Command::Start {
        line: 0,
        approach: Vec::new(),
    });
    operated
}

/// Waits until the machine asks for a tool.
fn await_tool(operated: &mut OperatedMachine, tool: &str) {
    operated.await_state("Hold:0");
    operated.run(200);
    let job = job(operated);
    let expected = format!("Tool change: {tool}");
    assert_eq!(job.waits.as_deref(), Some(expected.as_str()), "{job:?}");
    assert!(job.is_held && !job.takes_lines);
}

/// Has the machine take lines.
fn take_lines(operated: &mut OperatedMachine) {
    operated.command(Command::TakeLines);
    operated.await_state("Tool");
    assert!(job(operated).takes_lines);
}

/// A machine in the second change, with lines taken.
fn changing() -> OperatedMachine {
    let mut operated = begun();
    await_tool(&mut operated, "T1");
    press(&mut operated, realtime::RESUME);
    operated.await_state("Run");
    await_tool(&mut operated, "T2");
    take_lines(&mut operated);
    operated.touches = Some(|[_, _, z]| z <= TOP);
    operated.events.clear();
    operated
}

/// Goes on with the job, to its end.
fn finish(operated: &mut OperatedMachine) {
    operated.touches = None;
    operated
        .machine
        .press(simulation::machine::Pin::Probe, false);
    operated.run(300);
    press(operated, realtime::RESUME);
    operated.await_state("Run");
    operated.await_state("Idle");
    operated.run(1000);
    let job = job(operated);
    assert_eq!((&*job.outcome, job.answered), ("done", 12), "{job:?}");
}

#[test]
fn a_job_with_two_tools_is_held_overridden_probed_amid_it_and_ends_at_its_exact_steps() {
    let mut operated = begun();
    await_tool(&mut operated, "T1");
    press(&mut operated, realtime::RESUME);
    operated.await_state("Run");
    operated.run(300);
    press(&mut operated, realtime::HOLD);
    operated.await_state("Hold:0");
    operated.run(100);
    assert!(job(&operated).is_held && job(&operated).waits.is_none());
    let at_mm = operated.place_mm();
    press(&mut operated, realtime::FEED_PLUS_10);
    operated.run(500);
    assert_eq!(operated.place_mm(), at_mm);
    assert_eq!(operated.client.state().overrides[0], 110);
    press(&mut operated, realtime::RESUME);
    operated.await_state("Run");
    await_tool(&mut operated, "T2");
    take_lines(&mut operated);
    operated.touches = Some(|[_, _, z]| z <= TOP);
    let modes = |operated: &mut OperatedMachine| operated.ask("$G").0;
    let before = modes(&mut operated);
    step(&mut operated, [-3.0, 1.0, 0.0]);
    operated.run(2000);
    assert_eq!(operated.place_mm()[..2], [7.0, 1.0]);
    hold_x(&mut operated, 1, 600);
    assert_eq!(operated.client.state().state, "Jog");
    // Nobody says that the key is held.
    operated.run(1000);
    assert_eq!(operated.client.state().state, "Tool");
    operated.command(Command::Probe { probing: top() });
    operated.run(100);
    while operated.client.state().is_probing {
        operated.run(100);
    }
    operated.run(500);
    assert!(is_noted(&operated, "zero at machine Z-5.3"));
    assert_eq!(modes(&mut operated), before);
    finish(&mut operated);
    assert_eq!(operated.client.state().work, [5.0, 5.0, 5.0]);
    let [x, y, z] = operated.place_mm();
    assert_eq!([x, y], [5.0, 5.0]);
    assert!((z - (TOP + 5.0)).abs() < 0.0051, "{z}");
    // Neither what the machine answers to lines amid the job nor keys of a terminal are notes of a page.
    assert!(!is_noted(&operated, "ok") && !is_noted(&operated, "r resumes"));
}

#[test]
fn a_resume_amid_a_jog_or_a_cycle_does_not_start_the_job() {
    let mut operated = changing();
    for amid_ms in [40, 300] {
        step(&mut operated, [-5.0, 0.0, 0.0]);
        operated.run(amid_ms);
        operated.events.clear();
        press(&mut operated, realtime::RESUME);
        assert!(
            is_noted(&operated, "from rest alone") || !operated.client.take_events().is_empty()
        );
        operated.run(2000);
        assert_eq!(operated.client.state().state, "Tool");
    }
    assert_eq!(operated.place_mm()[..2], [0.0, 0.0]);
    operated.command(Command::Probe { probing: top() });
    operated.run(100);
    while operated.client.state().is_probing {
        // Also between two of its lines.
        press(&mut operated, realtime::RESUME);
        operated.run(TICK_MS);
    }
    operated.run(500);
    assert!(is_noted(&operated, "zero at machine Z-5.3"));
    assert_eq!(
        (
            operated.client.state().state.as_str(),
            job(&operated).answered
        ),
        ("Tool", 6)
    );
    finish(&mut operated);
    assert_eq!(operated.client.state().work, [5.0, 5.0, 5.0]);
}

#[test]
fn a_hold_amid_a_cycle_leads_back_to_the_change() {
    let mut operated = changing();
    operated.command(Command::Probe { probing: top() });
    operated.await_state("Run");
    press(&mut operated, realtime::HOLD);
    operated.await_state("Hold:0");
    let held_mm = operated.place_mm();
    operated.run(500);
    assert_eq!(operated.place_mm(), held_mm);
    // Resume is of the cycle, not of the job.
    press(&mut operated, realtime::RESUME);
    operated.await_state("Run");
    // Stop ends the cycle, and the job not yet.
    operated.command(Command::Stop);
    operated.await_state("Hold:0");
    assert!(!operated.client.state().is_probing && job(&operated).is_running);
    press(&mut operated, realtime::RESUME);
    operated.await_state("Tool");
    operated.run(500);
    assert!((operated.place_mm()[2] - TOP).abs() < 0.1);
    step(&mut operated, [0.0, 0.0, 5.0]);
    operated.run(2000);
    finish(&mut operated);
    assert_eq!(operated.client.state().work, [5.0, 5.0, 5.0]);
}

#[test]
fn a_motion_back_that_is_held_ends_its_cycle() {
    let mut operated = changing();
    operated.command(Command::Probe { probing: top() });
    operated.await_state("Jog");
    press(&mut operated, realtime::HOLD);
    operated.run(1000);
    assert!(is_noted(&operated, "stopped amid its motion"));
    assert!(!operated.client.state().is_probing);
    assert_eq!(operated.client.state().state, "Tool");
    let at_mm = operated.place_mm();
    operated.run(2000);
    assert_eq!(operated.place_mm(), at_mm);
}

#[test]
fn lines_amid_a_job_wait_for_a_change_of_the_tool() {
    let mut operated = begun();
    await_tool(&mut operated, "T1");
    let at_mm = operated.place_mm();
    step(&mut operated, [1.0, 0.0, 0.0]);
    operated.command(Command::Probe { probing: top() });
    operated.run(1000);
    assert!(is_noted(&operated, "in a change of the tool alone"));
    assert_eq!(operated.place_mm(), at_mm);
    take_lines(&mut operated);
    step(&mut operated, [1.0, 0.0, 0.0]);
    operated.run(1000);
    assert_eq!(operated.place_mm()[0], at_mm[0] + 1.0);
    assert_eq!(operated.ask("G0X5").1, "error:40");
    operated.run(500);
    operated.events.clear();
    press(&mut operated, realtime::RESUME);
    // Behind it no line is of the operator.
    step(&mut operated, [1.0, 0.0, 0.0]);
    operated.run(TICK_MS);
    assert!(is_noted(&operated, "in a change of the tool alone"));
    operated.await_state("Run");
    await_tool(&mut operated, "T2");
    assert_eq!(operated.client.state().work, [10.0, 0.0, 5.0]);
}
