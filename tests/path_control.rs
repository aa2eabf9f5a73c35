//! Path control as the step pins show it: `G61`, `G61.1`, `G64`.
#![cfg(not(target_os = "none"))]

mod support;

use leadscrew::{
    settings::Settings,
    sim::{Edge, End, Simulator, Stream, Watcher},
};
use support::{Trace, check_limits, fast};

/// What a program does: its pins, and what the machine says.
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
    assert_eq!(end, End::Complete);
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
    // As if each move were the only one, but for the time that a pause in between takes.
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
