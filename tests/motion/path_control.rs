//! Path control as the step pins show it: `G61`, `G61.1`, `G64`.

use crate::support::{Trace, cases, check_limits, fast};
use leadscrew::{
    axis::Axes,
    settings::Settings,
    sim::{Edge, Simulator, Stream, StreamEnd, Watcher},
    units::TICKS_PER_MS,
};
use proptest::prelude::*;

/// A program's result: its pins, and what the machine sends.
struct Player {
    trace: Trace,
    refused: Vec<String>,
    messages: Vec<String>,
}

impl Watcher for Player {
    fn edge(&mut self, edge: &Edge) {
        self.trace.push(*edge, 0);
    }

    fn answer(&mut self, line: u64, answer: &[u8]) {
        if answer != b"ok" {
            let answer = String::from_utf8_lossy(answer);
            self.refused.push(format!("line {line}: {answer}"));
        }
    }

    fn message(&mut self, _answers: u64, message: &[u8]) {
        let message = String::from_utf8_lossy(message);
        self.messages.push(message.into_owned());
    }
}

/// Streams a program to the end.
fn play(settings: &Settings, program: &str) -> Player {
    let mut simulator = Simulator::new(settings);
    let mut player = Player {
        trace: Trace::new(settings),
        refused: Vec::new(),
        messages: Vec::new(),
    };
    let bytes = program.bytes();
    let end = Stream::new(&mut simulator, bytes, 1_000_000).run(&mut player);
    assert_eq!(end, StreamEnd::Complete);
    assert_eq!(player.refused, [""; 0]);
    player.trace.check_pulses();
    player
}

/// The steps, their directions, and their times from the first edge on.
fn steps(player: &Player) -> Vec<(u64, u32, u8)> {
    let edges = &player.trace.edges;
    let first = edges.first().map_or(0, |edge| edge.ticks);
    edges
        .iter()
        .map(|edge| (edge.ticks - first, edge.raise, edge.directions))
        .collect()
}

/// A slight bend, a straight join and a right angle.
const CORNERS: &str = "G1X10F1200\nX20Y1\nX30Y2\nY12\nG2X40Y22I10\nG1Y30\n";

#[test]
fn exact_path_is_the_mode_at_power_up() {
    let plain = play(&fast(), CORNERS);
    let said = play(&fast(), &format!("G61\n{CORNERS}"));
    assert_eq!(steps(&plain), steps(&said));
}

#[test]
fn exact_stop_comes_to_rest_at_the_end_of_every_move() {
    let settings = fast();
    let corners = [
        "G1X10F1200",
        "X20Y1",
        "X30Y2",
        "Y12",
        "G2X40Y22I10",
        "G1Y30",
    ];
    let stops = play(&settings, &format!("G61.1\n{CORNERS}")).trace;
    let alone = corners.join("\nG4P0\n") + "\nG4P0\n";
    let alone = play(&settings, &alone).trace;
    check_limits(&settings, &stops);
    assert_eq!(stops.net_steps(), alone.net_steps());
    // The same as single moves, except for the time of a pause between them.
    let moving = |trace: &Trace| {
        let raises: Vec<_> = trace.edges.iter().filter(|edge| edge.raise != 0).collect();
        raises
            .iter()
            .map(|edge| (edge.raise, edge.directions))
            .collect::<Vec<_>>()
    };
    assert_eq!(moving(&stops), moving(&alone));
    assert!(stops.motion_seconds() <= alone.motion_seconds());
    let exact = play(&settings, CORNERS).trace;
    // Each of the five corners takes the time of braking and speeding up again.
    let ramps_s = 5.0 * 20.0 / 500.0;
    assert!(stops.motion_seconds() > exact.motion_seconds() + 0.6 * ramps_s);
}

#[test]
fn jogs_do_not_stop_between_each_other() {
    let settings = fast();
    let jogs = "$J=X10F1200\n$J=X20F1200\n";
    let one = play(&settings, jogs);
    let stops = play(&settings, &format!("G61.1\n{jogs}"));
    assert_eq!(steps(&one), steps(&stops));
}

/// A machine and a sender that waits where it likes.
struct Talk {
    simulator: Simulator,
    trace: Trace,
    said: String,
}

impl Talk {
    fn new(settings: &Settings) -> Self {
        let mut talk = Self {
            simulator: Simulator::new(settings),
            trace: Trace::new(settings),
            said: String::new(),
        };
        talk.simulator.settle();
        talk.listen();
        talk.said.clear();
        talk
    }

    fn listen(&mut self) {
        while let Some(byte) = self.simulator.send() {
            self.said.push(char::from(byte));
            self.simulator.settle();
        }
    }

    /// Sends text, and lets time pass.
    fn send(&mut self, text: &str, milliseconds: u64) -> &mut Self {
        self.send_bytes(text.as_bytes(), milliseconds)
    }

    fn send_bytes(&mut self, bytes: &[u8], milliseconds: u64) -> &mut Self {
        for byte in bytes {
            self.simulator.receive(*byte);
        }
        self.simulator.settle();
        self.listen();
        let end = self.simulator.now() + milliseconds * u64::from(TICKS_PER_MS);
        while self.simulator.now() < end {
            if let Some(edge) = self.simulator.advance(end) {
                self.trace.push(edge, 0);
            }
            self.listen();
        }
        self
    }

    /// The lines that the machine has sent since the last call.
    fn heard(&mut self) -> String {
        std::mem::take(&mut self.said).replace("\r\n", " ")
    }

    fn is_at_rest(&self) -> bool {
        let session = self.simulator.session();
        let snapshot = self.simulator.snapshot();
        snapshot.is_at_rest && snapshot.finished == session.entered()
    }

    fn steps(&self) -> [i32; 3] {
        let steps = self.trace.net_steps();
        [steps[0], steps[1], steps[2]]
    }

    /// True if the machine has been within 0.1 mm of a place, in steps of [`fast`].
    fn has_been_at(&self, x: i32, y: i32) -> bool {
        let (mut at, mut is_met) = ([0_i32; 2], false);
        for edge in &self.trace.edges {
            for (axis, at) in at.iter_mut().enumerate() {
                if edge.raise & 1 << axis != 0 {
                    *at += if edge.directions & 1 << axis == 0 {
                        1
                    } else {
                        -1
                    };
                }
            }
            is_met |= (at[0] - x).abs() <= 8 && (at[1] - y).abs() <= 8;
        }
        is_met
    }
}

#[test]
fn a_line_alone_is_executed_at_once() {
    for mode in ["G61", "G64", "G64P.02", "G64P.02Q.05"] {
        let mut talk = Talk::new(&fast());
        talk.send(&format!("{mode}\nG1X10F1200\n"), 20);
        assert!(!talk.trace.edges.is_empty(), "{mode}");
        talk.send("?", 1000);
        assert!(talk.is_at_rest());
        assert_eq!(talk.steps(), [800, 0, 0], "{mode}");
        assert!(talk.heard().starts_with("ok ok <Run|"), "{mode}");
    }
}

#[test]
fn lines_that_are_sent_one_by_one_are_rounded_all_the_same() {
    let mut talk = Talk::new(&fast());
    talk.send("G64P.5\nG1X20F1200\n", 100);
    talk.send("G1Y20\n", 100).send("G1X40\n", 4000);
    assert_eq!(talk.steps(), [3200, 1600, 0]);
    assert!(talk.is_at_rest());
    // The first line has begun before there was another.
    assert!(talk.has_been_at(1600, 0) && !talk.has_been_at(1600, 1600));
    let mut exact = Talk::new(&fast());
    exact.send("G1X20F1200\n", 100);
    exact.send("G1Y20\n", 100).send("G1X40\n", 4000);
    assert!(exact.has_been_at(1600, 0) && exact.has_been_at(1600, 1600));
}

#[test]
fn what_is_held_back_does_not_slow_the_machine_down() {
    let settings = fast();
    let mut exact = Talk::new(&settings);
    exact.send("G1X20F3000\nX40\n", 3000);
    // The second line comes long before the end of the first, and nothing after it.
    let mut talk = Talk::new(&settings);
    talk.send("G64P.02\nG1X20F3000\n", 100).send("X40\n", 3000);
    assert_eq!(talk.steps(), exact.steps());
    let slower_s = talk.trace.motion_seconds() - exact.trace.motion_seconds();
    assert!(slower_s.abs() < 0.002, "{slower_s} s");
}

/// Lines that wait until everything before them has been done.
const RESTS: [&str; 5] = ["M2\n", "G4P0\n", "M8\n", "G92X0\n", "G10L20P2X0\n"];

#[test]
fn a_line_before_a_rest_goes_on_without_a_stop() {
    let settings = fast();
    let mut exact = Talk::new(&settings);
    exact.send("G1X20F3000\nX40\n", 3000);
    for rest in RESTS {
        let mut talk = Talk::new(&settings);
        // Nothing else comes, nor is anything sent, after the line that waits.
        talk.send("G1X20F3000\nG64P.02\nX40\n", 100)
            .send(rest, 3000);
        assert_eq!(talk.steps(), exact.steps(), "{rest}");
        let slower_s = talk.trace.motion_seconds() - exact.trace.motion_seconds();
        assert!(slower_s.abs() < 0.002, "{rest}: {slower_s} s");
    }
}

#[test]
fn a_line_without_a_step_does_not_hold_up_what_waits_for_it() {
    for rest in RESTS {
        for before_ms in [0, 100, 1000] {
            let mut talk = Talk::new(&fast());
            talk.send("G1X10F1200\nG64\nX10.001\n", before_ms);
            talk.send(rest, 2000);
            assert!(talk.is_at_rest(), "{rest}");
            assert_eq!(talk.steps(), [800, 0, 0], "{rest}");
            let heard = talk.heard();
            assert_eq!(heard.matches("ok").count(), 4, "{rest}: {heard}");
        }
    }
}

#[test]
fn whatever_follows_a_line_comes_after_it() {
    for after in [
        "M3S100\n",
        "G4P.01\n",
        "M8\n",
        "M0\n",
        "M2\n",
        "G92X0\n",
        "G10L20P1X0\n",
        "G61\nX11\nX10\n",
        "G38.3Z-1F100\nG0Z0\n",
        "G93G1X11F60\nX10F60\n",
        "G2X10Y0I-1\n",
        "F100\nG4P0\n",
        "G28.1\n",
        "T1\nG4P0\n",
        "G0X10Y1\nY0\n",
    ] {
        let mut talk = Talk::new(&fast());
        talk.send(&format!("G64P.05\nG1X10F1200\n{after}"), 8000);
        if after == "M0\n" {
            talk.send("~", 100);
        }
        assert!(talk.is_at_rest(), "{after}");
        assert_eq!(talk.steps(), [800, 0, 0], "{after}");
        let heard = talk.heard();
        let answers = after.matches('\n').count() + 2;
        assert_eq!(heard.matches("ok").count(), answers, "{after}: {heard}");
        assert!(
            !heard.contains("error") && !heard.contains("ALARM"),
            "{after}: {heard}"
        );
    }
}

#[test]
fn a_hold_stops_on_the_rounded_path_and_goes_on() {
    let program = "G64P.5\nG1X20F3000\nY20\nX40\nY40\nX60\n";
    let mut through = Talk::new(&fast());
    through.send(program, 6000);
    for hold_ms in [50, 300, 425, 440, 600, 900] {
        let mut talk = Talk::new(&fast());
        talk.send(program, hold_ms).send("!", 500).send("?", 500);
        assert!(talk.heard().contains("<Hold:0|"), "{hold_ms}");
        let held = talk.steps();
        talk.send("?", 100);
        assert_eq!(talk.steps(), held);
        talk.send("~", 6000);
        assert!(talk.is_at_rest(), "{hold_ms}");
        assert_eq!(talk.steps(), [4800, 3200, 0], "{hold_ms}");
        // The same steps, at other times.
        let order = |talk: &Talk| {
            let raises = talk.trace.edges.iter().filter(|edge| edge.raise != 0);
            raises.fold([0_u32; 2], |[x, y], edge| {
                [x + (edge.raise & 1), y + (edge.raise >> 1 & 1)]
            })
        };
        assert_eq!(order(&talk), order(&through), "{hold_ms}");
    }
}

#[test]
fn a_hold_while_nothing_moves_keeps_a_line_until_the_start() {
    let mut talk = Talk::new(&fast());
    talk.send("G64P.5\n", 10)
        .send("!", 10)
        .send("G1X10F1200\n", 500);
    assert_eq!(talk.steps(), [0; 3]);
    talk.send("~", 1500);
    assert_eq!(talk.steps(), [800, 0, 0]);
    assert!(talk.is_at_rest());
}

#[test]
fn a_reset_forgets_what_is_held_back() {
    for reset_ms in [5, 100, 400, 800] {
        let mut talk = Talk::new(&fast());
        talk.send("G64P.5\nG1X20F1200\nY20\nX40\n", reset_ms);
        talk.send("\u{18}", 500).send("$X\n", 10);
        assert!(talk.is_at_rest(), "{reset_ms}");
        let stopped = talk.steps();
        talk.send("?", 2000);
        assert_eq!(talk.steps(), stopped, "{reset_ms}");
        // G64 is gone, and the position is right.
        talk.heard();
        talk.send("$G\nG1X1Y1F1200\n", 4000);
        assert!(!talk.heard().contains("G64"));
        assert_eq!(talk.steps(), [80, 80, 0], "{reset_ms}");
    }
}

#[test]
fn the_end_of_a_program_tells_how_far_the_path_was_left() {
    let program = "G1X20F3000\nX40Y10\nX60\nM2\n";
    for (mode, least, most) in [("G64P.05", 0.049, 0.05), ("G64P.02", 0.019, 0.02)] {
        let said = play(&fast(), &format!("{mode}\n{program}")).messages;
        let told = said.iter().find_map(|text| {
            let text = text.strip_prefix("[MSG:Path deviation: ")?;
            text.strip_suffix(" mm]")?.parse::<f64>().ok()
        });
        let told = told.unwrap_or_else(|| panic!("{said:?}"));
        assert!((least..=most).contains(&told), "{told}");
    }
    let said = play(&fast(), program).messages;
    assert!(
        !said.iter().any(|text| text.contains("deviation")),
        "{said:?}"
    );
}

/// Lines of a program, each with what the sender does after it: how long it waits, and a byte.
fn lines() -> impl Strategy<Value = Vec<([i32; 3], u64, u8)>> {
    let place = prop_oneof![4 => -300..300_i32, 1 => Just(0), 2 => -5..5_i32];
    let wait_ms = prop_oneof![3 => Just(0_u64), 1 => 0..200_u64];
    // Holds and starts, overrides of feed and rapids, a question.
    let byte = prop::sample::select(b"!~~?\x90\x91\x92\x93\x94\x95\x96\x97".to_vec());
    prop::collection::vec((prop::array::uniform3(place), wait_ms, byte), 1..40)
}

proptest! {
    #![proptest_config(cases(12))]

    #[test]
    fn no_order_of_events_loses_a_step_of_what_is_rounded(
        lines in lines(),
        tolerance in prop::sample::select(vec!["", "P0.02", "P0.1Q0", "P0.5Q0.2"]),
        jerk in prop::sample::select(vec![0.0, 0.0, 10_000.0, 200_000.0]),
    ) {
        let settings = Settings { jerk_mm_s3: Axes::all(jerk), ..fast() };
        let mut talk = Talk::new(&settings);
        talk.send(&format!("G64{tolerance}\nF3000\n"), 1);
        for (number, (place, wait_ms, byte)) in lines.iter().enumerate() {
            let word = if number % 5 == 4 { "G0" } else { "G1" };
            let [x, y, z] = place.map(|steps| f64::from(steps) / 100.0);
            // The receive buffer holds some 128 bytes.
            while number + 2 - talk.said.matches("ok").count() > 3 {
                talk.send("~", 20);
            }
            talk.send(&format!("{word}X{x}Y{y}Z{z}\n"), *wait_ms);
            talk.send_bytes(&[*byte], 0);
        }
        talk.send_bytes(b"~\x90\x95", 100);
        // At rest for so long, nothing may be held back any more.
        let mut rests = 0;
        for _ in 0..600 {
            talk.send("~", 100);
            rests = if talk.is_at_rest() { rests + 1 } else { 0 };
            if rests == 3 {
                break;
            }
        }
        prop_assert_eq!(rests, 3);
        prop_assert!(!talk.said.contains("error"), "{}", talk.said);
        let (place, ..) = lines[lines.len() - 1];
        let steps = place.map(|hundredths| (f64::from(hundredths) * 0.8).round() as i32);
        prop_assert_eq!(talk.steps(), steps);
        talk.trace.check_pulses();
    }
}
