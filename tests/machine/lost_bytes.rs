//! Bytes that are damaged or lost on their way: nothing of their line is executed, and the sender sees why.

use leadscrew::{
    axis::Axes,
    model::State,
    settings::Settings,
    sim::Simulator,
    units::{TICKS_PER_MS, TICKS_PER_SECOND},
};
use proptest::prelude::*;

use crate::{support::cases, terminal};

/// Steps of a millimetre.
const STEPS: i32 = 250;

/// A byte on its way, or what becomes of it.
#[derive(Debug, Clone, Copy)]
enum Sent {
    Byte(u8),
    Damaged,
}

struct Machine {
    simulator: Box<Simulator>,
    told: Vec<u8>,
}

impl Machine {
    fn new() -> Self {
        Self::with(&Settings::default())
    }

    fn with(settings: &Settings) -> Self {
        let mut machine = Self {
            simulator: Box::new(Simulator::new(settings)),
            told: Vec::new(),
        };
        machine.run(TICKS_PER_SECOND.into());
        machine.told.clear();
        machine
    }

    /// Sends bytes at once, without anything else happening meanwhile.
    fn send(&mut self, bytes: impl IntoIterator<Item = Sent>) {
        for sent in bytes {
            match sent {
                Sent::Byte(byte) => self.simulator.receive(byte),
                Sent::Damaged => self.simulator.receive_damaged(),
            }
        }
    }

    fn send_text(&mut self, text: &str) {
        self.send(text.bytes().map(Sent::Byte));
    }

    fn run(&mut self, ticks: u64) {
        terminal::run(&mut self.simulator, &mut self.told, ticks);
    }

    /// Returns the lines of the machine since the last call, up to the end of all motion.
    fn answers(&mut self) -> Vec<String> {
        self.run(600 * u64::from(TICKS_PER_SECOND));
        terminal::lines(&mut self.told)
    }

    fn ask(&mut self, text: &str) -> Vec<String> {
        self.send_text(text);
        self.answers()
    }

    /// Returns the answers up to the end of all motion, with cycle start pressed wherever the machine is held.
    fn all_answers(&mut self) -> Vec<String> {
        let mut answers = self.answers();
        while self.is_held() {
            answers.extend(self.ask("~"));
        }
        answers
    }

    fn is_held(&self) -> bool {
        self.simulator.snapshot().state == State::HoldComplete
    }

    fn steps(&self) -> [i32; 3] {
        let Axes([x, y, z, ..]) = self.simulator.physical_steps();
        [x, y, z]
    }
}

/// The bytes of a text of which one is damaged, and of which this many in all do not come through.
fn damaged(text: &str, place: usize, lost: usize) -> Vec<Sent> {
    let bytes = text.bytes().enumerate();
    bytes
        .filter(|(index, _)| !(place + 1..place + lost).contains(index))
        .map(|(index, byte)| {
            if index == place {
                Sent::Damaged
            } else {
                Sent::Byte(byte)
            }
        })
        .collect()
}

#[test]
fn nothing_of_a_line_is_executed_that_has_lost_bytes() {
    let line = "G1X12F100\n";
    for lost in [1, 2] {
        for place in 0..line.len() - 2 {
            let mut machine = Machine::new();
            machine.send_text("G0Y1\n");
            machine.send(damaged(line, place, lost));
            machine.send_text("G0Z1\n");
            let answers = machine.all_answers();
            assert_eq!(answers, ["ok", "error:210", "ok"], "{place} {lost}");
            assert_eq!(machine.steps(), [0, STEPS, STEPS]);
            assert_eq!(machine.ask("G0Y0\n"), ["ok"]);
        }
    }
}

#[test]
fn two_lines_whose_end_is_lost_are_one_that_is_refused() {
    for line in [
        "G0X12",
        "$110=700",
        "g0 x12",
        "(comment) G0X12",
        "\n",
        "$J=X5F100",
    ] {
        let mut machine = Machine::new();
        let text = format!("{line}\nG0X13\n");
        machine.send(damaged(&text, line.len(), 1));
        machine.send_text("G0Z1\n");
        let expected: &[&str] = if line == "\n" {
            &["ok", "error:210", "ok"]
        } else {
            &["error:210", "ok"]
        };
        assert_eq!(machine.answers(), expected, "{line}");
        assert_eq!(machine.steps(), [0, 0, STEPS], "{line}");
        let settings = machine.ask("$$\n");
        assert!(settings.contains(&"$110=500.000".to_owned()), "{line}");
    }
}

#[test]
fn a_byte_that_is_lost_while_the_line_waits_for_its_end_counts() {
    let mut machine = Machine::new();
    machine.send_text("G0X1");
    assert!(machine.answers().is_empty());
    machine.send([Sent::Damaged]);
    assert!(machine.answers().is_empty());
    assert_eq!(machine.ask("\nG0Y1\n"), ["error:210", "ok"]);
    assert_eq!(machine.steps(), [0, STEPS, 0]);
}

#[test]
fn damaged_bytes_do_nothing_to_a_move() {
    let mut machine = Machine::new();
    machine.send_text("G1X10F100\n");
    machine.run(u64::from(TICKS_PER_SECOND));
    machine.send([Sent::Damaged; 4]);
    machine.run(u64::from(TICKS_PER_SECOND));
    assert_eq!(machine.simulator.snapshot().state, State::Run);
    machine.answers();
    assert_eq!(machine.steps(), [10 * STEPS, 0, 0]);
}

#[test]
fn a_program_is_held_where_a_line_of_it_has_lost_bytes() {
    // Grbl's dialect, and that with checked lines.
    for dialect in [0, 2] {
        let mut machine = Machine::with(&Settings {
            dialect,
            ..Settings::default()
        });
        machine.send_text("G1X10F600\n");
        machine.run(TICKS_PER_SECOND.into());
        machine.send(damaged("G1Z5\n", 2, 1));
        machine.send_text("G1X0Y1\n");
        assert_eq!(machine.answers(), ["ok", "error:210"], "{dialect}");
        assert!(machine.is_held(), "{dialect}");
        let [x, y, z] = machine.steps();
        assert!((STEPS..10 * STEPS).contains(&x), "{x}");
        assert_eq!((y, z), (0, 0));
        assert_eq!(machine.ask("~"), ["ok"]);
        assert_eq!(machine.steps(), [0, STEPS, 0]);
    }
}

#[test]
fn nothing_of_a_numbered_line_is_executed_that_has_lost_bytes() {
    for line in ["N7 G1X12", "N1 G1X12*114"] {
        for place in 0..line.len() {
            let mut machine = Machine::with(&Settings {
                dialect: 2,
                ..Settings::default()
            });
            machine.send_text("G1Y10F600\n");
            machine.run(TICKS_PER_SECOND.into());
            machine.send(damaged(&format!("{line}\n"), place, 1));
            let answers = machine.answers();
            let steps = machine.steps();
            assert_eq!(steps[0], 0, "{line} {place} {answers:?}");
            // A checksum that is wrong asks for the line again.
            let is_asked_for = answers.ends_with(&["[MSG:Resend: 1]".into(), "error:200".into()]);
            let is_refused = answers == ["ok", "error:210"];
            assert!(is_refused != is_asked_for, "{line} {place} {answers:?}");
            assert_eq!(machine.is_held(), is_refused, "{line} {place}");
            assert!(
                line.contains('*') || is_refused,
                "{line} {place} {answers:?}"
            );
        }
    }
}

#[test]
fn a_line_whose_comment_looks_like_a_checksum_is_held_for() {
    for line in ["G1Z5;size5*3\n", "G1Z5(5*3)\n"] {
        let mut machine = Machine::with(&Settings {
            dialect: 2,
            ..Settings::default()
        });
        machine.send_text("G1X10F600\n");
        machine.run(TICKS_PER_SECOND.into());
        machine.send(damaged(line, 4, 1));
        machine.send_text("G1X0Y5\n");
        assert_eq!(machine.answers(), ["ok", "error:210"], "{line}");
        assert!(machine.is_held(), "{line}");
        let [_, y, z] = machine.steps();
        assert_eq!([y, z], [0, 0], "{line}");
    }
}

#[test]
fn a_jog_and_a_machine_at_rest_are_not_held_for_a_line_that_has_lost_bytes() {
    let mut machine = Machine::new();
    machine.send(damaged("G0X1\n", 2, 1));
    assert_eq!(machine.answers(), ["error:210"]);
    assert_eq!(machine.simulator.snapshot().state, State::Idle);
    machine.send_text("$J=X10F600\n");
    machine.run(u64::from(TICKS_PER_MS * 100));
    assert_eq!(machine.simulator.snapshot().state, State::Jog);
    machine.send(damaged("$J=Y10F600\n", 4, 1));
    assert_eq!(machine.answers(), ["ok", "error:210"]);
    assert_eq!(machine.steps(), [10 * STEPS, 0, 0]);
}

#[test]
fn what_a_full_queue_loses_refuses_the_line_and_no_other() {
    let mut machine = Machine::new();
    machine.send_text("!");
    machine.answers();
    // 1023 bytes fit: 102 lines, and three bytes of the next.
    let line = "G91G0X012\n";
    machine.send_text(&line.repeat(104));
    assert_eq!(machine.simulator.lost(), 17);
    machine.send_text("~");
    let answers = machine.answers();
    assert!(answers.iter().all(|answer| answer == "ok"));
    let answers = [answers, machine.ask("\nG0X1\n")].concat();
    let refused = answers.iter().position(|answer| answer == "error:210");
    assert_eq!((refused, answers.len()), (Some(102), 104));
    assert_eq!(machine.steps(), [(102 * 12 + 1) * STEPS, 0, 0]);
}

#[test]
fn a_reset_ends_what_was_lost_of_the_lines_that_it_drops() {
    let mut machine = Machine::new();
    machine.send(damaged("G0X1", 2, 1));
    machine.answers();
    machine.send_text("\x18");
    machine.answers();
    assert_eq!(machine.ask("G0Y1\n"), ["ok"]);
    assert_eq!(machine.steps(), [0, STEPS, 0]);
}

#[test]
fn the_build_information_tells_what_was_lost() {
    let line = |lost| format!("[MSG:Late events: 0, lost bytes: {lost}]");
    let mut machine = Machine::new();
    let before = machine.ask("$I\n");
    assert!(!before.iter().any(|line| line.contains("Late")));
    assert!(machine.ask("$I+\n").contains(&line(0)));
    machine.send(damaged("G0X1\n", 2, 1));
    machine.send(damaged("G0X1\n", 2, 2));
    assert_eq!(machine.answers(), ["error:210"; 2]);
    for command in ["$I\n", "$I+\n", "\x18", "$I\n"] {
        let told = machine.ask(command);
        assert!(command == "\x18" || told.contains(&line(2)), "{told:?}");
    }
}

#[test]
fn lines_of_the_operator_that_have_lost_bytes_are_refused_in_a_change_of_the_tool() {
    for has_program in [false, true] {
        let mut machine = Machine::new();
        machine.ask("M6T2\n");
        if has_program {
            machine.send_text("G0X1\n");
        }
        machine.send([Sent::Byte(0xa3)]);
        machine.answers();
        assert_eq!(machine.simulator.snapshot().state, State::Tool);
        machine.send(damaged("$J=G91X12F500\n", 9, 1));
        assert_eq!(machine.answers(), ["error:210"]);
        machine.ask("~");
        // The lines that waited have other numbers, so that nobody knows: they are refused.
        let x = if has_program { 0 } else { STEPS };
        if !has_program {
            machine.ask("G0X1\n");
        }
        machine.ask("G0Y1\n");
        machine.ask("G0Z1\n");
        assert_eq!((machine.steps()[0], machine.steps()[2]), (x, STEPS));
    }
}

/// Faults at places of a text.
fn faults() -> impl Strategy<Value = Vec<usize>> {
    prop::collection::vec(0_usize..300, 1..5)
}

proptest! {
    #![proptest_config(cases(24))]

    #[test]
    fn a_machine_has_moved_as_far_as_the_lines_say_that_were_answered_with_ok(
        faults in faults(),
        bursts in prop::collection::vec(1_usize..60, 1..20),
    ) {
        let mut machine = Machine::new();
        let text = "G91G0X12\n".repeat(30);
        let mut answers = Vec::new();
        let mut bursts = bursts.into_iter().cycle();
        let mut left = 0;
        for (place, byte) in text.bytes().enumerate() {
            machine.send([if faults.contains(&place) {
                Sent::Damaged
            } else {
                Sent::Byte(byte)
            }]);
            if left == 0 {
                left = bursts.next().unwrap_or(1);
                machine.run(u64::from(TICKS_PER_MS * 20));
            }
            left -= 1;
        }
        machine.send_text("\n");
        answers.extend(machine.all_answers());
        let moved = answers.iter().filter(|answer| *answer == "ok").count();
        let refused = answers.iter().filter(|answer| *answer == "error:210").count();
        prop_assert_eq!(moved + refused, answers.len());
        // The line end behind them all is answered, too, unless it ends the last of them.
        let is_last_damaged = answers.last().is_some_and(|answer| answer == "error:210");
        let empty = usize::from(!is_last_damaged);
        let moves = i32::try_from(moved - empty).unwrap();
        prop_assert_eq!(machine.steps()[0], moves * 12 * STEPS);
        let has_fault = faults.iter().any(|place| *place < text.len());
        prop_assert_eq!(refused != 0, has_fault);
    }
}
