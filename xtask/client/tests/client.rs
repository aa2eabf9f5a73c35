//! A client and the virtual machine: what an operator does at a page.

mod operated;

use grbl_client::{
    client::{Command, Event, JOG_TIMEOUT_MS, JobState},
    realtime,
};
use operated::{OperatedMachine, TICK_MS};

fn x_mm(operated: &OperatedMachine) -> f64 {
    operated.place_mm()[0]
}

fn job(operated: &OperatedMachine) -> JobState {
    operated.client.state().job.clone().unwrap_or_default()
}

/// Starts the program at a line, counted from 0.
fn start(line: usize) -> Command {
    Command::Start {
        line,
        approach: Vec::new(),
    }
}

/// The press of tests with one.
const PRESS: u32 = 5;

/// Holds the key of X.
fn hold_x(operated: &mut OperatedMachine, press: u32, feed: f64, ms: u64) {
    let end = operated.now_ms + ms;
    while operated.now_ms < end {
        operated.command(Command::Move {
            press,
            along: vec![1, 0, 0],
            feed,
        });
        operated.run(TICK_MS * 4);
    }
}

#[test]
fn lines_have_their_own_answers_and_modes_follow() {
    let mut operated = OperatedMachine::new(&[]);
    let (lines, response) = operated.ask("$I");
    assert_eq!(response, "ok");
    assert!(lines[0].starts_with("[VER:1.1h"), "{lines:?}");
    assert_eq!(operated.ask("G999").1, "error:20");
    operated.ask("G20 F7");
    operated.run(300);
    assert!(operated.client.state().modes.contains(&"G20".to_owned()));
    // More lines in one are none.
    operated.command(Command::Line {
        number: 9,
        text: "G1X1F100\nG1X2".into(),
    });
    operated.run(500);
    assert_eq!(operated.client.state().state, "Idle");
    assert!(x_mm(&operated).abs() < 1e-9);
}

#[test]
fn a_key_that_is_held_jogs_and_one_that_nobody_holds_stops() {
    let mut operated = OperatedMachine::new(&["$110=3000", "$120=500"]);
    hold_x(&mut operated, 1, 3000.0, 1000);
    let held_mm = x_mm(&operated);
    // 50 mm/s, less what acceleration and the line take.
    assert!(held_mm > 35.0, "{held_mm}");
    operated.command(Command::Halt);
    operated.run(TICK_MS);
    let at_release_mm = x_mm(&operated);
    operated.await_state("Idle");
    let more_mm = x_mm(&operated) - at_release_mm;
    assert!(more_mm < 4.0, "{more_mm}");

    // The page is gone, and nothing says so.
    hold_x(&mut operated, 2, 3000.0, 600);
    operated.run(JOG_TIMEOUT_MS + 300);
    let at_mm = x_mm(&operated);
    operated.run(1000);
    assert!((x_mm(&operated) - at_mm).abs() < 1e-9);
    assert_eq!(operated.client.state().state, "Idle");
}

#[test]
fn a_press_that_has_ended_begins_no_jog_again() {
    let mut operated = OperatedMachine::new(&["$110=3000", "$120=500"]);
    hold_x(&mut operated, 1, 3000.0, 400);
    // A page that was silent for a while asks on.
    operated.run(1000);
    let at_mm = x_mm(&operated);
    hold_x(&mut operated, 1, 3000.0, 400);
    assert!((x_mm(&operated) - at_mm).abs() < 1e-9);
    hold_x(&mut operated, 2, 3000.0, 400);
    assert!(x_mm(&operated) > at_mm + 5.0);
}

#[test]
fn steps_end_with_the_page_and_with_a_hold_and_do_not_pile_up() {
    for end in [None, Some(realtime::HOLD)] {
        let mut operated = OperatedMachine::new(&["$110=3000", "$120=500"]);
        for _ in 0..20 {
            operated.command(Command::Step {
                by: vec![40.0],
                feed: 3000.0,
            });
        }
        operated.await_state("Jog");
        match end {
            Some(byte) => operated.command(Command::Realtime { byte }),
            None => operated.client.leave(),
        }
        operated.run(500);
        let at_mm = x_mm(&operated);
        operated.run(2000);
        assert!(
            (x_mm(&operated) - at_mm).abs() < 1e-9 && at_mm < 20.0,
            "{at_mm}"
        );
        assert!(matches!(operated.client.state().state.as_str(), "Idle"));
    }
    let mut operated = OperatedMachine::new(&["$110=3000", "$120=500"]);
    for _ in 0..20 {
        operated.command(Command::Step {
            by: vec![1.0],
            feed: 3000.0,
        });
    }
    operated.run(3000);
    assert!((x_mm(&operated) - 3.0).abs() < 1e-9, "{}", x_mm(&operated));
}

#[test]
fn a_held_jog_is_as_fast_where_reports_are_in_inches() {
    let mut operated = OperatedMachine::new(&["$110=3000", "$120=500", "$13=1"]);
    hold_x(&mut operated, 1, 3000.0, 1000);
    assert!(x_mm(&operated) > 35.0, "{}", x_mm(&operated));
    assert!(operated.client.state().reports_inches);
}

#[test]
fn a_refused_line_takes_the_lines_after_it_along() {
    let mut operated = OperatedMachine::new(&["$110=3000"]);
    for (number, text) in [(1, "G21G91"), (2, "G0 Q5"), (3, "G0X50")] {
        operated.command(Command::Line {
            number,
            text: text.into(),
        });
    }
    operated.run(2000);
    assert!(x_mm(&operated).abs() < 1e-9, "{}", x_mm(&operated));
    let answer = |wanted: u32| {
        let mut events = operated.events.iter();
        events.find_map(|event| match event {
            Event::Answer {
                number, response, ..
            } if *number == wanted => Some(response.as_str()),
            _ => None,
        })
    };
    assert_eq!(answer(1), Some("ok"));
    assert!(answer(2).is_some_and(|it| it.starts_with("error:")));
    assert_eq!(answer(3), Some(""));
}

#[test]
fn nothing_is_sent_while_a_job_begins_or_runs() {
    let mut operated = OperatedMachine::new(&["$110=3000"]);
    operated.command(Command::Program {
        name: "part.nc".into(),
        text: "G21G91\nG1X10F600\n".into(),
    });
    operated.run(500);
    operated.command(start(0));
    operated.command(Command::Step {
        by: vec![5.0],
        feed: 600.0,
    });
    operated.command(Command::Program {
        name: "other.nc".into(),
        text: "G1X90F600\n".into(),
    });
    hold_x(&mut operated, 1, 600.0, 200);
    operated.await_state("Idle");
    operated.run(1000);
    assert_eq!(job(&operated).outcome, "done");
    assert!((x_mm(&operated) - 10.0).abs() < 1e-9, "{}", x_mm(&operated));
}

#[test]
fn a_client_that_dies_leaves_a_quarter_of_a_second_of_motion() {
    let mut operated = OperatedMachine::new(&["$110=3000", "$120=500"]);
    hold_x(&mut operated, 1, 3000.0, 800);
    assert_eq!(operated.client.state().state, "Jog");
    // Nothing cancels what waits in the machine.
    let dead_s = operated.now_ms as f64 / 1000.0;
    let (mut more, mut late) = (0, 0);
    operated
        .machine
        .run_until_s(dead_s + 0.25, &mut |_| more += 1);
    operated
        .machine
        .run_until_s(dead_s + 3.0, &mut |_| late += 1);
    assert!(more > 100, "{more}");
    assert_eq!(late, 0, "after {more} edges");
}

#[test]
fn a_key_that_is_held_while_the_line_is_lost_jogs_no_more_when_it_is_back() {
    let mut operated = OperatedMachine::new(&["$110=3000", "$120=500"]);
    hold_x(&mut operated, 1, 3000.0, 800);
    operated.client.lose_line();
    // What waits in the machine, and the page asks on.
    hold_x(&mut operated, 1, 3000.0, 240);
    let at_mm = x_mm(&operated);
    operated.events.clear();
    hold_x(&mut operated, 1, 3000.0, 2000);
    assert!((x_mm(&operated) - at_mm).abs() < 1e-9);
    assert_eq!(operated.client.state().state, "Idle");
    let is_jog = |event: &Event| matches!(event, Event::Line { text, .. } if text.contains("$J"));
    assert!(!operated.events.iter().any(is_jog));
    hold_x(&mut operated, 2, 3000.0, 800);
    assert!(x_mm(&operated) > at_mm + 5.0);
}

#[test]
fn a_jog_goes_to_the_end_of_the_travel_and_no_further() {
    let mut operated = OperatedMachine::new(&["$22=1", "$20=1", "$110=3000", "$120=500"]);
    operated.command(Command::Line {
        number: 1,
        text: "$H".into(),
    });
    operated.await_state("Home");
    operated.await_state("Idle");
    let x = |operated: &OperatedMachine| operated.client.state().machine[0];
    for _ in 0..130 {
        operated.command(Command::Move {
            press: PRESS,
            along: vec![-1, 0, 0],
            feed: 1500.0,
        });
        operated.run(TICK_MS * 4);
    }
    operated.command(Command::Halt);
    operated.await_state("Idle");
    assert!(operated.client.state().alarm.is_none());
    assert!((-200.0..-199.9).contains(&x(&operated)), "{}", x(&operated));
    operated.command(Command::Step {
        by: vec![5.0],
        feed: 1500.0,
    });
    operated.run(1000);
    assert!(
        (-195.01..-194.9).contains(&x(&operated)),
        "{}",
        x(&operated)
    );
}

#[test]
fn a_job_is_sent_held_and_ended() {
    let mut operated = OperatedMachine::new(&[]);
    let text = "G21G91\nG1X10F600\nX10\nX-20\n".to_owned();
    operated.command(Command::Program {
        name: "part.nc".into(),
        text,
    });
    operated.run(TICK_MS);
    assert!(!job(&operated).is_running && job(&operated).lines == 4);
    operated.command(start(0));
    operated.await_state("Run");
    // Lines beside a job's would be taken for its own.
    operated.command(Command::Line {
        number: 1,
        text: "G1X5".into(),
    });
    operated.command(Command::Move {
        press: PRESS,
        along: vec![1],
        feed: 600.0,
    });
    operated.command(Command::Realtime {
        byte: realtime::HOLD,
    });
    operated.await_state("Hold:0");
    operated.command(Command::Realtime {
        byte: realtime::RESUME,
    });
    operated.await_state("Run");
    operated.await_state("Idle");
    operated.run(1000);
    assert_eq!(job(&operated).outcome, "done");
    assert_eq!(job(&operated).answered, 4);
    assert!(x_mm(&operated).abs() < 1e-9);

    operated.command(start(0));
    operated.await_state("Run");
    operated.command(Command::Stop);
    operated.run(3000);
    assert!(
        job(&operated)
            .outcome
            .contains("the operator has stopped the job")
    );
    assert!(!job(&operated).is_running);
}

#[test]
fn a_job_that_starts_at_a_line_sends_the_approach_and_then_the_lines_from_there() {
    let mut operated = OperatedMachine::new(&[]);
    operated.command(Command::Program {
        name: "part.nc".into(),
        text: "G21G91\nG1X10F600\nX1\nX2\n".into(),
    });
    operated.run(500);
    for line in [4, usize::MAX] {
        operated.events.clear();
        operated.command(start(line));
        operated.run(500);
        let is_refused = |event: &Event| matches!(event, Event::Note { text } if text.contains("the program has 4"));
        assert!(operated.events.iter().any(is_refused));
        assert!(!job(&operated).is_running);
    }
    operated.events.clear();
    operated.command(Command::Start {
        line: 2,
        approach: ["G21G91", "G1X0.5!F600"].map(str::to_owned).into(),
    });
    operated.run(3000);
    // What would be a realtime command in the approach ends it.
    assert!(job(&operated).outcome.starts_with("the approach (G1X0.5"));
    assert_eq!(job(&operated).answered, 2);
    operated.ask("$X");
    operated.events.clear();
    operated.command(Command::Start {
        line: 2,
        approach: ["G21G91", "G1X0.5F600"].map(str::to_owned).into(),
    });
    operated.await_state("Run");
    operated.await_state("Idle");
    operated.run(1000);
    let sent = operated.events.iter().filter_map(|event| match event {
        Event::Line {
            is_sent: true,
            text,
        } => Some(text.as_str()),
        _ => None,
    });
    let sent: Vec<_> = sent.filter(|text| !text.starts_with('$')).collect();
    assert_eq!(sent, ["G21G91", "G1X0.5F600", "X1", "X2", "G4 P0.01"]);
    let end = job(&operated);
    assert_eq!((end.first, end.answered, &*end.outcome), (2, 4, "done"));
    assert!((x_mm(&operated) - 3.5).abs() < 1e-9, "{}", x_mm(&operated));
}

#[test]
fn no_text_and_no_number_of_a_page_is_a_realtime_command() {
    let mut operated = OperatedMachine::new(&[]);
    operated.command(Command::Program {
        name: "job.nc".into(),
        text: "\u{feff}G91 (\u{84}, !)\rG1 X1 F600 ; done?\n".into(),
    });
    operated.command(start(0));
    operated.await_state("Run");
    operated.await_state("Idle");
    operated.run(500);
    assert_eq!(
        (job(&operated).lines, &*job(&operated).outcome),
        (2, "done")
    );
    assert_eq!(operated.ask("X1!").1, "error:1");
    for byte in [b'$', b'\n'] {
        operated.command(Command::Realtime { byte });
    }
    operated.command(Command::Move {
        press: PRESS,
        along: vec![127, 0, 0],
        feed: 600.0,
    });
    operated.run(500);
    assert_eq!(operated.ask("$I").1, "ok");
    assert!((x_mm(&operated) - 1.0).abs() < 0.01, "{}", x_mm(&operated));
}

#[test]
fn a_lost_line_ends_the_job_and_answers_nothing() {
    let mut operated = OperatedMachine::new(&[]);
    operated.command(Command::Program {
        name: "part.nc".into(),
        text: "G1X50F600\n".repeat(50),
    });
    operated.command(start(0));
    operated.await_state("Run");
    operated.client.lose_line();
    assert_eq!(job(&operated).outcome, "the line to the machine was lost");
    assert!(operated.client.take_output().is_empty());
    operated.client.take_events();
    operated.client.tick(operated.now_ms);
    assert!(!operated.client.state().is_there);
    let told = operated.client.take_events();
    let is_told =
        |event: &Event| matches!(event, Event::State(state) if **state == *operated.client.state());
    assert!(told.iter().any(is_told), "{told:?}");
}

#[test]
fn the_slowest_feed_of_a_held_key_jogs_all_the_same() {
    for feed in [1.0, 5.0, 10.0] {
        let mut operated = OperatedMachine::new(&["$110=3000", "$120=500"]);
        hold_x(&mut operated, 1, feed, 3000);
        let at_mm = x_mm(&operated);
        // As far as the feed leads in this time, and a step more.
        assert!(
            (0.004..feed / 60.0 * 3.1 + 0.015).contains(&at_mm),
            "{feed}: {at_mm}"
        );
    }
}

#[test]
fn the_position_of_homing_is_known_until_an_alarm_a_reset_or_a_new_line() {
    let mut operated = OperatedMachine::new(&["$22=1", "$20=1", "$110=3000", "$120=500"]);
    for end in 0..3 {
        assert_eq!(operated.client.state().homed, None);
        operated.command(Command::Line {
            number: 1,
            text: "$h".into(),
        });
        operated.await_state("Home");
        operated.await_state("Idle");
        operated.run(200);
        let homed = operated.client.state().machine.clone();
        assert_eq!(operated.client.state().homed, Some(homed.clone()));
        operated.command(Command::Step {
            by: vec![-5.0],
            feed: 1500.0,
        });
        operated.run(1000);
        assert_eq!(operated.client.state().homed, Some(homed));
        match end {
            0 => {
                operated.command(Command::Line {
                    number: 2,
                    text: "G90G53G0X100".into(),
                });
                operated.await_state("Alarm");
                operated.run(200);
                assert_eq!(operated.client.state().homed, None);
                // It asks for that.
                operated.command(Command::Realtime {
                    byte: realtime::RESET,
                });
            }
            1 => operated.command(Command::Realtime {
                byte: realtime::RESET,
            }),
            _ => operated.client.lose_line(),
        }
        operated.run(1000);
    }
}

#[test]
fn no_answer_of_before_is_given_to_a_line_that_was_not_carried_out() {
    let mut operated = OperatedMachine::new(&["$110=3000", "$120=500"]);
    operated.command(Command::Program {
        name: "part.nc".into(),
        text: "G1X3F600\nX0\n".repeat(20),
    });
    operated.command(start(0));
    operated.await_state("Run");
    // The cable is out and in again: the machine goes on with what it has.
    operated.client.lose_line();
    operated.run(200);
    operated.events.clear();
    operated.command(Command::Line {
        number: 4,
        text: "M8".into(),
    });
    operated.run(200);
    let is_refused =
        |event: &Event| matches!(event, Event::Note { text } if text.contains("come to rest"));
    assert!(operated.events.iter().any(is_refused));
    operated.await_state("Idle");
    assert_eq!(operated.ask("G999").1, "error:20");
    assert_eq!(operated.ask("M8").1, "ok");
    assert!(!operated.client.state().accessories.contains('F'));
    operated.run(1000);
    assert!(operated.client.state().accessories.contains('F'));
}

#[test]
fn answers_after_an_alarm_are_of_no_line_that_comes_later() {
    let mut operated = OperatedMachine::new(&["$110=3000", "$120=500"]);
    operated.command(Command::Program {
        name: "part.nc".into(),
        text: "G91G21\nG38.2X5F600\nX1\nX1\nX1\n".into(),
    });
    operated.command(start(0));
    operated.await_state("Run");
    operated.await_state("Alarm");
    assert!(job(&operated).outcome.contains("ALARM:5"));
    // Those of the job are errors.
    assert_eq!(operated.ask("$X").1, "ok");
    operated.run(500);
    assert_eq!(operated.client.state().state, "Idle");
    assert_eq!(operated.ask("G999").1, "error:20");
}

#[test]
fn a_machine_that_waits_for_a_reset_is_asked_nothing_before() {
    let mut operated = OperatedMachine::new(&["$110=3000", "$120=500"]);
    operated.touches = Some(|[x, ..]| (1.0..2.0).contains(&x) || x > 4.0);
    assert_eq!(operated.ask("G91G21G38.2X5F600").1, "ok");
    operated.touches = Some(|[x, ..]| x > 4.0);
    // The move that leaves a contact may make another one.
    for line in ["G1X1", "X5"] {
        assert_eq!(operated.ask(line).1, "ok");
    }
    operated.await_state("Alarm");
    operated.events.clear();
    operated.run(20_000);
    let is_sent = |event: &Event| matches!(event, Event::Line { is_sent: true, .. });
    assert!(
        !operated.events.iter().any(is_sent),
        "{:?}",
        operated.events
    );
    operated.touches = Some(|_| false);
    operated.command(Command::Realtime {
        byte: realtime::RESET,
    });
    operated.run(500);
    assert_eq!(operated.ask("$X").1, "ok");
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
    let whole = serde_json::from_str::<Command>(r#"{"do":"start"}"#).unwrap();
    assert_eq!(whole, start(0));
    let note = Event::Note { text: "<b>".into() };
    let text = serde_json::to_string(&note).unwrap();
    assert_eq!(text, r#"{"is":"note","text":"<b>"}"#);
}
