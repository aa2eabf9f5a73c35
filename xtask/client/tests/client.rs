//! A client and the virtual machine: what an operator does at a page.

mod desk;

use desk::{Desk, TICK_MS};
use grbl_client::{
    client::{Command, Event, HELD_MS, JobState},
    realtime,
};

fn x_mm(desk: &Desk) -> f64 {
    desk.place_mm()[0]
}

fn job(desk: &Desk) -> JobState {
    desk.client.state().job.clone().unwrap_or_default()
}

/// The press of tests with one.
const PRESS: u32 = 5;

/// Holds the key of X.
fn hold_x(desk: &mut Desk, press: u32, feed: f64, ms: u64) {
    let end = desk.now_ms + ms;
    while desk.now_ms < end {
        desk.command(Command::Move {
            press,
            along: vec![1, 0, 0],
            feed,
        });
        desk.run(TICK_MS * 4);
    }
}

#[test]
fn lines_have_their_own_answers_and_modes_follow() {
    let mut desk = Desk::new(&[]);
    let (lines, response) = desk.ask("$I");
    assert_eq!(response, "ok");
    assert!(lines[0].starts_with("[VER:1.1h"), "{lines:?}");
    assert_eq!(desk.ask("G999").1, "error:20");
    desk.ask("G20 F7");
    desk.run(300);
    assert!(desk.client.state().modes.contains(&"G20".to_owned()));
    // More lines in one are none.
    desk.command(Command::Line {
        number: 9,
        text: "G1X1F100\nG1X2".into(),
    });
    desk.run(500);
    assert_eq!(desk.client.state().state, "Idle");
    assert!(x_mm(&desk).abs() < 1e-9);
}

#[test]
fn a_key_that_is_held_jogs_and_one_that_nobody_holds_stops() {
    let mut desk = Desk::new(&["$110=3000", "$120=500"]);
    hold_x(&mut desk, 1, 3000.0, 1000);
    let held_mm = x_mm(&desk);
    // 50 mm/s, less what acceleration and the line take.
    assert!(held_mm > 35.0, "{held_mm}");
    desk.command(Command::Halt);
    desk.run(TICK_MS);
    let at_release_mm = x_mm(&desk);
    desk.await_state("Idle");
    let more_mm = x_mm(&desk) - at_release_mm;
    assert!(more_mm < 4.0, "{more_mm}");

    // The page is gone, and nothing says so.
    hold_x(&mut desk, 2, 3000.0, 600);
    desk.run(HELD_MS + 300);
    let at_mm = x_mm(&desk);
    desk.run(1000);
    assert!((x_mm(&desk) - at_mm).abs() < 1e-9);
    assert_eq!(desk.client.state().state, "Idle");
}

#[test]
fn a_press_that_has_ended_begins_no_jog_again() {
    let mut desk = Desk::new(&["$110=3000", "$120=500"]);
    hold_x(&mut desk, 1, 3000.0, 400);
    // A page that was silent for a while asks on.
    desk.run(1000);
    let at_mm = x_mm(&desk);
    hold_x(&mut desk, 1, 3000.0, 400);
    assert!((x_mm(&desk) - at_mm).abs() < 1e-9);
    hold_x(&mut desk, 2, 3000.0, 400);
    assert!(x_mm(&desk) > at_mm + 5.0);
}

#[test]
fn steps_end_with_the_page_and_with_a_hold_and_do_not_pile_up() {
    for end in [None, Some(realtime::HOLD)] {
        let mut desk = Desk::new(&["$110=3000", "$120=500"]);
        for _ in 0..20 {
            desk.command(Command::Step {
                by: vec![40.0],
                feed: 3000.0,
            });
        }
        desk.await_state("Jog");
        match end {
            Some(byte) => desk.command(Command::Realtime { byte }),
            None => desk.client.leave(),
        }
        desk.run(500);
        let at_mm = x_mm(&desk);
        desk.run(2000);
        assert!(
            (x_mm(&desk) - at_mm).abs() < 1e-9 && at_mm < 20.0,
            "{at_mm}"
        );
        assert!(matches!(desk.client.state().state.as_str(), "Idle"));
    }
    let mut desk = Desk::new(&["$110=3000", "$120=500"]);
    for _ in 0..20 {
        desk.command(Command::Step {
            by: vec![1.0],
            feed: 3000.0,
        });
    }
    desk.run(3000);
    assert!((x_mm(&desk) - 3.0).abs() < 1e-9, "{}", x_mm(&desk));
}

#[test]
fn a_held_jog_is_as_fast_where_reports_are_in_inches() {
    let mut desk = Desk::new(&["$110=3000", "$120=500", "$13=1"]);
    hold_x(&mut desk, 1, 3000.0, 1000);
    assert!(x_mm(&desk) > 35.0, "{}", x_mm(&desk));
    assert!(desk.client.state().reports_inches);
}

#[test]
fn nothing_is_sent_while_a_job_begins_or_runs() {
    let mut desk = Desk::new(&["$110=3000"]);
    desk.command(Command::Program {
        name: "part.nc".into(),
        text: "G21G91\nG1X10F600\n".into(),
    });
    desk.run(500);
    desk.command(Command::Start);
    desk.command(Command::Step {
        by: vec![5.0],
        feed: 600.0,
    });
    desk.command(Command::Program {
        name: "other.nc".into(),
        text: "G1X90F600\n".into(),
    });
    hold_x(&mut desk, 1, 600.0, 200);
    desk.await_state("Idle");
    desk.run(1000);
    assert_eq!(job(&desk).outcome, "done");
    assert!((x_mm(&desk) - 10.0).abs() < 1e-9, "{}", x_mm(&desk));
}

#[test]
fn a_client_that_dies_leaves_a_quarter_of_a_second_of_motion() {
    let mut desk = Desk::new(&["$110=3000", "$120=500"]);
    hold_x(&mut desk, 1, 3000.0, 800);
    assert_eq!(desk.client.state().state, "Jog");
    // Nothing cancels what waits in the machine.
    let dead_s = desk.now_ms as f64 / 1000.0;
    let (mut more, mut late) = (0, 0);
    desk.machine.run_until_s(dead_s + 0.25, &mut |_| more += 1);
    desk.machine.run_until_s(dead_s + 3.0, &mut |_| late += 1);
    assert!(more > 100, "{more}");
    assert_eq!(late, 0, "after {more} edges");
}

#[test]
fn a_jog_goes_to_the_end_of_the_travel_and_no_further() {
    let mut desk = Desk::new(&["$22=1", "$20=1", "$110=3000", "$120=500"]);
    desk.command(Command::Line {
        number: 1,
        text: "$H".into(),
    });
    desk.await_state("Home");
    desk.await_state("Idle");
    let x = |desk: &Desk| desk.client.state().machine[0];
    for _ in 0..130 {
        desk.command(Command::Move {
            press: PRESS,
            along: vec![-1, 0, 0],
            feed: 1500.0,
        });
        desk.run(TICK_MS * 4);
    }
    desk.command(Command::Halt);
    desk.await_state("Idle");
    assert!(desk.client.state().alarm.is_none());
    assert!((-200.0..-199.9).contains(&x(&desk)), "{}", x(&desk));
    desk.command(Command::Step {
        by: vec![5.0],
        feed: 1500.0,
    });
    desk.run(1000);
    assert!((-195.01..-194.9).contains(&x(&desk)), "{}", x(&desk));
}

#[test]
fn a_job_is_sent_held_and_ended() {
    let mut desk = Desk::new(&[]);
    let text = "G21G91\nG1X10F600\nX10\nX-20\n".to_owned();
    desk.command(Command::Program {
        name: "part.nc".into(),
        text,
    });
    desk.run(TICK_MS);
    assert!(!job(&desk).is_running && job(&desk).lines == 4);
    desk.command(Command::Start);
    desk.await_state("Run");
    // Lines beside a job's would be taken for its own.
    desk.command(Command::Line {
        number: 1,
        text: "G1X5".into(),
    });
    desk.command(Command::Move {
        press: PRESS,
        along: vec![1],
        feed: 600.0,
    });
    desk.command(Command::Realtime {
        byte: realtime::HOLD,
    });
    desk.await_state("Hold:0");
    desk.command(Command::Realtime {
        byte: realtime::RESUME,
    });
    desk.await_state("Run");
    desk.await_state("Idle");
    desk.run(1000);
    assert_eq!(job(&desk).outcome, "done");
    assert_eq!(job(&desk).answered, 4);
    assert!(x_mm(&desk).abs() < 1e-9);

    desk.command(Command::Start);
    desk.await_state("Run");
    desk.command(Command::Stop);
    desk.run(3000);
    assert!(
        job(&desk)
            .outcome
            .contains("the operator has stopped the job")
    );
    assert!(!job(&desk).is_running);
}

#[test]
fn no_text_and_no_number_of_a_page_is_a_realtime_command() {
    let mut desk = Desk::new(&[]);
    desk.command(Command::Program {
        name: "job.nc".into(),
        text: "\u{feff}G91 (\u{84}, !)\rG1 X1 F600 ; done?\n".into(),
    });
    desk.command(Command::Start);
    desk.await_state("Run");
    desk.await_state("Idle");
    desk.run(500);
    assert_eq!((job(&desk).lines, &*job(&desk).outcome), (2, "done"));
    assert_eq!(desk.ask("X1!").1, "error:1");
    for byte in [b'$', b'\n'] {
        desk.command(Command::Realtime { byte });
    }
    desk.command(Command::Move {
        press: PRESS,
        along: vec![127, 0, 0],
        feed: 600.0,
    });
    desk.run(500);
    assert_eq!(desk.ask("$I").1, "ok");
    assert!((x_mm(&desk) - 1.0).abs() < 0.01, "{}", x_mm(&desk));
}

#[test]
fn a_lost_line_ends_the_job_and_answers_nothing() {
    let mut desk = Desk::new(&[]);
    desk.command(Command::Program {
        name: "part.nc".into(),
        text: "G1X50F600\n".repeat(50),
    });
    desk.command(Command::Start);
    desk.await_state("Run");
    desk.client.lose_line();
    assert_eq!(job(&desk).outcome, "the line to the machine was lost");
    assert!(desk.client.take_output().is_empty());
    desk.client.take_events();
    desk.client.tick(desk.now_ms);
    assert!(!desk.client.state().is_there);
    let told = desk.client.take_events();
    let is_told =
        |event: &Event| matches!(event, Event::State(state) if **state == *desk.client.state());
    assert!(told.iter().any(is_told), "{told:?}");
}

#[test]
fn what_passes_between_page_and_client_is_json() {
    let command = Command::Move {
        press: PRESS,
        along: vec![0, -1],
        feed: 600.0,
    };
    let text = serde_json::to_string(&command).unwrap();
    assert_eq!(
        text,
        r#"{"do":"move","press":5,"along":[0,-1],"feed":600.0}"#
    );
    assert_eq!(serde_json::from_str::<Command>(&text).unwrap(), command);
    let note = Event::Note { text: "<b>".into() };
    let text = serde_json::to_string(&note).unwrap();
    assert_eq!(text, r#"{"is":"note","text":"<b>"}"#);
}
