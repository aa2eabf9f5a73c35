//! A client and the virtual machine: what an operator does at a page.

use grbl_client::{
    Client,
    client::{Command, Event, HELD_MS, JobState},
    realtime,
};
use leadscrew::{
    settings::{Settings, StepRate},
    sim::Simulator,
};
use simulation::{SwitchPositions, machine::Machine};

/// How often the client goes on, ms.
const TICK_MS: u64 = 20;

/// A machine, a client, and what the client has told.
struct Desk {
    machine: Machine,
    client: Client,
    now_ms: u64,
    events: Vec<Event>,
}

impl Desk {
    /// A machine amid switches that has been unlocked, with a client that knows it.
    fn new(settings: &[&str]) -> Self {
        let defaults = Settings {
            step_rate: StepRate::Proven(200_000),
            ..Settings::default()
        };
        let mut simulator = Simulator::new(&defaults);
        SwitchPositions::of(&defaults).mount_on(&mut simulator);
        let mut desk = Self {
            machine: Machine::amid(simulator, Vec::new()),
            client: Client::default(),
            now_ms: 0,
            events: Vec::new(),
        };
        desk.run(500);
        for line in ["$X"].iter().chain(settings) {
            assert_eq!(desk.ask(line).1, "ok", "{line}");
        }
        desk
    }

    /// Runs for a time, with the client.
    fn run(&mut self, ms: u64) {
        let end = self.now_ms + ms;
        while self.now_ms < end {
            self.client.tick(self.now_ms);
            self.exchange();
        }
    }

    /// The line for one tick.
    fn exchange(&mut self) {
        self.machine.send(&self.client.take_output());
        self.now_ms += TICK_MS;
        self.machine
            .run_until_s(self.now_ms as f64 / 1000.0, &mut |_| {});
        let bytes: Vec<_> = { self.machine.take_bytes().into_iter() }
            .map(|(_, byte)| byte)
            .collect();
        self.client.receive(&bytes, self.now_ms);
        self.events.extend(self.client.take_events());
    }

    fn command(&mut self, command: Command) {
        self.client.command(command, self.now_ms);
    }

    /// Sends a line, and returns what is answered.
    fn ask(&mut self, text: &str) -> (Vec<String>, String) {
        self.events.clear();
        self.command(Command::Line {
            number: 7,
            text: text.into(),
        });
        for _ in 0..200 {
            self.run(TICK_MS);
            let mut events = self.events.iter();
            let answer = events.find_map(|event| match event {
                Event::Answer {
                    number: 7,
                    lines,
                    response,
                } => Some((lines.clone(), response.clone())),
                _ => None,
            });
            if let Some(answer) = answer {
                return answer;
            }
        }
        panic!("{text} is not answered")
    }

    /// Runs until the machine has reported a state, at most a minute.
    fn await_state(&mut self, state: &str) {
        for _ in 0..3000 {
            self.run(TICK_MS);
            if self.client.state().state == state {
                return;
            }
        }
        panic!("{:?} is not {state}", self.client.state());
    }

    fn x_mm(&self) -> f64 {
        f64::from(self.machine.simulator().physical_position()[0]) / 250.0
    }

    fn hold_x(&mut self, feed: f64, ms: u64) {
        let end = self.now_ms + ms;
        while self.now_ms < end {
            self.command(Command::Move {
                along: vec![1, 0, 0],
                feed,
            });
            self.run(TICK_MS * 4);
        }
    }

    fn job(&self) -> JobState {
        self.client.state().job.clone().unwrap_or_default()
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
    assert!(desk.x_mm().abs() < 1e-9);
}

#[test]
fn a_key_that_is_held_jogs_and_one_that_nobody_holds_stops() {
    let mut desk = Desk::new(&["$110=3000", "$120=500"]);
    desk.hold_x(3000.0, 1000);
    let held_mm = desk.x_mm();
    // 50 mm/s, less what acceleration and the line take.
    assert!(held_mm > 35.0, "{held_mm}");
    desk.command(Command::Halt);
    desk.run(TICK_MS);
    let at_release_mm = desk.x_mm();
    desk.await_state("Idle");
    let more_mm = desk.x_mm() - at_release_mm;
    assert!(more_mm < 4.0, "{more_mm}");

    // The page is gone, and nothing says so.
    desk.hold_x(3000.0, 600);
    desk.run(HELD_MS + 300);
    let at_mm = desk.x_mm();
    desk.run(1000);
    assert!((desk.x_mm() - at_mm).abs() < 1e-9);
    assert_eq!(desk.client.state().state, "Idle");
}

#[test]
fn a_client_that_dies_leaves_a_quarter_of_a_second_of_motion() {
    let mut desk = Desk::new(&["$110=3000", "$120=500"]);
    desk.hold_x(3000.0, 800);
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
    assert!(!desk.job().is_running && desk.job().lines == 4);
    desk.command(Command::Start);
    desk.await_state("Run");
    // Lines beside a job's would be taken for its own.
    desk.command(Command::Line {
        number: 1,
        text: "G1X5".into(),
    });
    desk.command(Command::Move {
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
    assert_eq!(desk.job().outcome, "done");
    assert_eq!(desk.job().answered, 4);
    assert!(desk.x_mm().abs() < 1e-9 || (desk.x_mm() - 5.0).abs() < 1e-9);

    desk.command(Command::Start);
    desk.await_state("Run");
    desk.command(Command::Stop);
    desk.run(3000);
    assert!(
        desk.job()
            .outcome
            .contains("the operator has stopped the job")
    );
    assert!(!desk.job().is_running);
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
    assert_eq!(desk.job().outcome, "the line to the machine was lost");
    assert!(desk.client.take_output().is_empty());
    desk.client.tick(desk.now_ms);
    assert!(!desk.client.state().is_there);
}

#[test]
fn what_passes_between_page_and_client_is_json() {
    let command = Command::Move {
        along: vec![0, -1],
        feed: 600.0,
    };
    let text = serde_json::to_string(&command).unwrap();
    assert_eq!(text, r#"{"do":"move","along":[0,-1],"feed":600.0}"#);
    assert_eq!(serde_json::from_str::<Command>(&text).unwrap(), command);
    let note = Event::Note { text: "<b>".into() };
    let text = serde_json::to_string(&note).unwrap();
    assert_eq!(text, r#"{"is":"note","text":"<b>"}"#);
}
