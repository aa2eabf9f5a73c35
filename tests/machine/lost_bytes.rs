//! Bytes that are damaged or lost on their way: nothing of their line is executed, and the sender sees why.

use leadscrew::{model::State, settings::Settings};
use proptest::prelude::*;

use crate::support::{Machine, cases};

/// Steps of a millimetre.
const STEPS: i32 = 250;

/// A byte on its way, or what becomes of it.
#[derive(Debug, Clone, Copy)]
enum Sent {
    Byte(u8),
    Damaged,
}

/// Sends bytes at once, without anything else happening meanwhile.
fn send(machine: &mut Machine, bytes: impl IntoIterator<Item = Sent>) {
    for sent in bytes {
        match sent {
            Sent::Byte(byte) => machine.receive(byte),
            Sent::Damaged => machine.receive_damaged(),
        }
    }
}

fn send_text(machine: &mut Machine, text: &str) {
    send(machine, text.bytes().map(Sent::Byte));
}

/// Returns the answers up to rest, with cycle start pressed wherever the machine is held.
fn all_answers(machine: &mut Machine) -> Vec<String> {
    let mut answers = machine.answers();
    while is_held(machine) {
        answers.extend(machine.answers_to("~"));
    }
    answers
}

fn is_held(machine: &Machine) -> bool {
    machine.state() == State::HoldComplete
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
            let mut machine = Machine::new(&[]);
            send_text(&mut machine, "G0Y1\n");
            send(&mut machine, damaged(line, place, lost));
            send_text(&mut machine, "G0Z1\n");
            let answers = all_answers(&mut machine);
            assert_eq!(answers, ["ok", "error:210", "ok"], "{place} {lost}");
            assert_eq!(machine.xyz(), [0, STEPS, STEPS]);
            assert_eq!(machine.ask("G0Y0"), ["ok"]);
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
        let mut machine = Machine::new(&[]);
        let text = format!("{line}\nG0X13\n");
        send(&mut machine, damaged(&text, line.len(), 1));
        send_text(&mut machine, "G0Z1\n");
        let expected: &[&str] = if line == "\n" {
            &["ok", "error:210", "ok"]
        } else {
            &["error:210", "ok"]
        };
        assert_eq!(machine.answers(), expected, "{line}");
        assert_eq!(machine.xyz(), [0, 0, STEPS], "{line}");
        let settings = machine.ask("$$");
        assert!(settings.contains(&"$110=500.000".to_owned()), "{line}");
    }
}

#[test]
fn a_byte_that_is_lost_while_the_line_waits_for_its_end_counts() {
    let mut machine = Machine::new(&[]);
    send_text(&mut machine, "G0X1");
    assert!(machine.answers().is_empty());
    send(&mut machine, [Sent::Damaged]);
    assert!(machine.answers().is_empty());
    assert_eq!(machine.ask("\nG0Y1"), ["error:210", "ok"]);
    assert_eq!(machine.xyz(), [0, STEPS, 0]);
}

#[test]
fn damaged_bytes_do_nothing_to_a_move() {
    let mut machine = Machine::new(&[]);
    send_text(&mut machine, "G1X10F100\n");
    machine.run(1000);
    send(&mut machine, [Sent::Damaged; 4]);
    machine.run(1000);
    assert_eq!(machine.state(), State::Run);
    machine.answers();
    assert_eq!(machine.xyz(), [10 * STEPS, 0, 0]);
}

#[test]
fn a_program_is_held_where_a_line_of_it_has_lost_bytes() {
    // Grbl's dialect, and that with checked lines.
    for dialect in [0, 2] {
        let mut machine = Machine::with(&Settings {
            dialect,
            ..Settings::default()
        });
        send_text(&mut machine, "G1X10F600\n");
        machine.run(1000);
        send(&mut machine, damaged("G1Z5\n", 2, 1));
        send_text(&mut machine, "G1X0Y1\n");
        assert_eq!(machine.answers(), ["ok", "error:210"], "{dialect}");
        assert!(is_held(&machine), "{dialect}");
        let [x, y, z] = machine.xyz();
        assert!((STEPS..10 * STEPS).contains(&x), "{x}");
        assert_eq!((y, z), (0, 0));
        assert_eq!(machine.answers_to("~"), ["ok"]);
        assert_eq!(machine.xyz(), [0, STEPS, 0]);
    }
}

#[test]
fn nothing_of_a_numbered_line_is_executed_that_has_lost_bytes() {
    for line in ["N7 G1X12", "N1 G1X12*114"] {
        for place in 0..line.len() {
            let mut machine = Machine::new(&["780=2"]);
            send_text(&mut machine, "G1Y10F600\n");
            machine.run(1000);
            send(&mut machine, damaged(&format!("{line}\n"), place, 1));
            let answers = machine.answers();
            let steps = machine.xyz();
            assert_eq!(steps[0], 0, "{line} {place} {answers:?}");
            // A checksum that is wrong asks for the line again.
            let is_asked_for = answers.ends_with(&["[MSG:Resend: 1]".into(), "error:200".into()]);
            let is_refused = answers == ["ok", "error:210"];
            assert!(is_refused != is_asked_for, "{line} {place} {answers:?}");
            assert_eq!(is_held(&machine), is_refused, "{line} {place}");
            assert!(
                line.contains('*') || is_refused,
                "{line} {place} {answers:?}"
            );
        }
    }
}

#[test]
fn a_line_whose_comment_resembles_a_checksum_is_held_for() {
    for line in ["G1Z5;size5*3\n", "G1Z5(5*3)\n"] {
        let mut machine = Machine::new(&["780=2"]);
        send_text(&mut machine, "G1X10F600\n");
        machine.run(1000);
        send(&mut machine, damaged(line, 4, 1));
        send_text(&mut machine, "G1X0Y5\n");
        assert_eq!(machine.answers(), ["ok", "error:210"], "{line}");
        assert!(is_held(&machine), "{line}");
        let [_, y, z] = machine.xyz();
        assert_eq!([y, z], [0, 0], "{line}");
    }
}

#[test]
fn a_jog_and_a_machine_at_rest_are_not_held_for_a_line_that_has_lost_bytes() {
    let mut machine = Machine::new(&[]);
    send(&mut machine, damaged("G0X1\n", 2, 1));
    assert_eq!(machine.answers(), ["error:210"]);
    assert_eq!(machine.state(), State::Idle);
    send_text(&mut machine, "$J=X10F600\n");
    machine.run(100);
    assert_eq!(machine.state(), State::Jog);
    send(&mut machine, damaged("$J=Y10F600\n", 4, 1));
    assert_eq!(machine.answers(), ["ok", "error:210"]);
    assert_eq!(machine.xyz(), [10 * STEPS, 0, 0]);
}

#[test]
fn what_a_full_queue_loses_refuses_the_line_and_no_other() {
    let mut machine = Machine::new(&[]);
    send_text(&mut machine, "!");
    machine.answers();
    // 1023 bytes fit: 102 lines, and three bytes of the next.
    let line = "G91G0X012\n";
    send_text(&mut machine, &line.repeat(104));
    assert_eq!(machine.lost(), 17);
    send_text(&mut machine, "~");
    let answers = machine.answers();
    assert!(answers.iter().all(|answer| answer == "ok"));
    let answers = [answers, machine.ask("\nG0X1")].concat();
    let refused = answers.iter().position(|answer| answer == "error:210");
    assert_eq!((refused, answers.len()), (Some(102), 104));
    assert_eq!(machine.xyz(), [(102 * 12 + 1) * STEPS, 0, 0]);
}

#[test]
fn a_reset_ends_what_was_lost_of_the_lines_that_it_drops() {
    let mut machine = Machine::new(&[]);
    send(&mut machine, damaged("G0X1", 2, 1));
    machine.answers();
    send_text(&mut machine, "\x18");
    machine.answers();
    assert_eq!(machine.ask("G0Y1"), ["ok"]);
    assert_eq!(machine.xyz(), [0, STEPS, 0]);
}

#[test]
fn the_build_information_tells_what_was_lost() {
    let line = |lost| format!("[MSG:Late events: 0, lost bytes: {lost}]");
    let mut machine = Machine::new(&[]);
    let before = machine.ask("$I");
    assert!(!before.iter().any(|line| line.contains("Late")));
    assert!(machine.ask("$I+").contains(&line(0)));
    send(&mut machine, damaged("G0X1\n", 2, 1));
    send(&mut machine, damaged("G0X1\n", 2, 2));
    assert_eq!(machine.answers(), ["error:210"; 2]);
    for command in ["$I\n", "$I+\n", "\x18", "$I\n"] {
        let lines = machine.answers_to(command);
        assert!(command == "\x18" || lines.contains(&line(2)), "{lines:?}");
    }
}

#[test]
fn lines_of_the_operator_that_have_lost_bytes_are_refused_in_a_change_of_the_tool() {
    for has_program in [false, true] {
        let mut machine = Machine::new(&[]);
        machine.ask("M6T2");
        if has_program {
            send_text(&mut machine, "G0X1\n");
        }
        send(&mut machine, [Sent::Byte(0xa3)]);
        machine.answers();
        assert_eq!(machine.state(), State::Tool);
        send(&mut machine, damaged("$J=G91X12F500\n", 9, 1));
        assert_eq!(machine.answers(), ["error:210"]);
        machine.answers_to("~");
        // The lines that waited have other numbers, so that nobody knows: they are refused.
        let x = if has_program { 0 } else { STEPS };
        if !has_program {
            machine.ask("G0X1");
        }
        machine.ask("G0Y1");
        machine.ask("G0Z1");
        assert_eq!((machine.xyz()[0], machine.xyz()[2]), (x, STEPS));
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
        let mut machine = Machine::new(&[]);
        let text = "G91G0X12\n".repeat(30);
        let mut answers = Vec::new();
        let mut bursts = bursts.into_iter().cycle();
        let mut left = 0;
        for (place, byte) in text.bytes().enumerate() {
            send(&mut machine, [if faults.contains(&place) {
                Sent::Damaged
            } else {
                Sent::Byte(byte)
            }]);
            if left == 0 {
                left = bursts.next().unwrap_or(1);
                machine.run(20);
            }
            left -= 1;
        }
        send_text(&mut machine, "\n");
        answers.extend(all_answers(&mut machine));
        let moved = answers.iter().filter(|answer| *answer == "ok").count();
        let refused = answers.iter().filter(|answer| *answer == "error:210").count();
        prop_assert_eq!(moved + refused, answers.len());
        // The line end behind them all is answered, too, unless it ends the last of them.
        let is_last_damaged = answers.last().is_some_and(|answer| answer == "error:210");
        let empty = usize::from(!is_last_damaged);
        let moves = i32::try_from(moved - empty).unwrap();
        prop_assert_eq!(machine.xyz()[0], moves * 12 * STEPS);
        let has_fault = faults.iter().any(|place| *place < text.len());
        prop_assert_eq!(refused != 0, has_fault);
    }
}
