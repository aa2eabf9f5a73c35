//! Text beside G-code in the languages of the world: it acts on nothing, and no line of code is read without it.

use leadscrew::model::{Coolant, Overrides, State};

use crate::support::Machine;

/// Comments and other texts as CAM systems write them.
const TEXTS: [&str; 8] = [
    "粗加工 速度 · 仕上げ・やり直し",
    "Änderung, Größe 6 mm, ± 0,1",
    "черновая обработка → чистовая",
    "Φρεζάρισμα",
    "épaisseur – « fraise » — ‘’“”…",
    "Ø6 × 2 @ 45°",
    "\u{2009}\u{a0}\u{feff}",
    "🛠️ 𝄞",
];

/// Asserts that nothing but lines has had an effect.
fn assert_undisturbed(machine: &Machine, text: &str) {
    let snapshot = machine.snapshot();
    assert_eq!(snapshot.overrides, Overrides::NONE, "{text}");
    assert_eq!(snapshot.coolant, Coolant::OFF, "{text}");
    assert_eq!(machine.state(), State::Idle, "{text}");
}

#[test]
fn texts_in_comments_act_on_nothing_and_behind_them_realtime_bytes_do() {
    for text in TEXTS {
        let mut machine = Machine::new(&[]);
        let lines = format!("G0 X1 ({text})\n; {text}\n({text}) G0 X2\n");
        assert_eq!(machine.answers_to(lines.as_bytes()), ["ok"; 3], "{text}");
        assert_undisturbed(&machine, text);
        assert_eq!(machine.xyz()[0], 500, "{text}");
        machine.send_for(format!("(a{text}").as_bytes(), 10);
        machine.receive(0xa0);
        machine.run(5);
        assert!(machine.snapshot().coolant.flood, "{text}");
    }
}

#[test]
fn texts_outside_of_comments_refuse_their_line() {
    for text in TEXTS {
        for line in [
            format!("G0 X1{text}"),
            format!("{text}G0 X1"),
            format!("$I={text}"),
        ] {
            let mut machine = Machine::new(&[]);
            let answers = machine.answers_to(format!("{line}\nG0 Y1\n").as_bytes());
            assert_eq!(answers.len(), 2, "{line}");
            assert!(answers[0].starts_with("error:"), "{line}: {answers:?}");
            assert_eq!(answers[1], "ok", "{line}");
            assert_undisturbed(&machine, &line);
            assert_eq!(machine.xyz(), [0, 250, 0], "{line}");
        }
    }
}

#[test]
fn a_non_breaking_space_is_a_blank() {
    let mut machine = Machine::new(&[]);
    let line = "G0\u{a0}X\u{a0}1.\u{a0}5\u{a0}\n";
    assert_eq!(machine.answers_to(line.as_bytes()), ["ok"]);
    assert_undisturbed(&machine, line);
    assert_eq!(machine.xyz()[0], 375);
}

/// A top bit that flips in a byte makes a request of one, and text of the others.
#[test]
fn a_flipped_top_bit_moves_no_axis_to_another_place() {
    let line = b"G1X1.5Y-2F900(b)\n";
    for place in 0..line.len() {
        let mut bytes = line.to_vec();
        bytes[place] |= 0x80;
        let mut machine = Machine::new(&[]);
        machine.answers_to([&bytes[..], b"\n"].concat());
        let [x, y, _] = machine.xyz();
        let is_done = [x, y] == [375, -500];
        assert!(
            [x, y] == [0; 2] || is_done && place >= 13,
            "{place}: {x} {y}"
        );
    }
}

#[test]
fn realtime_bytes_act_within_5_ms_also_in_utf_8() {
    for form in [&[0xa0][..], "\u{a0}".as_bytes()] {
        let mut machine = Machine::new(&[]);
        for byte in form {
            machine.receive(*byte);
        }
        machine.run(5);
        assert!(machine.snapshot().coolant.flood, "{form:x?}");
        assert_eq!(machine.answers_to("G0X1\n"), ["ok"]);
    }
}
