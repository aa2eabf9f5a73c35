//! Laws for any input.

use leadscrew::model::State;
use proptest::prelude::*;

use super::bench::{Bench, WELCOME, answers};

/// Lines with known answers, to be mixed with anything.
fn known_line() -> impl Strategy<Value = (&'static str, &'static str)> {
    prop::sample::select(vec![
        ("G0X1\n", "ok"),
        ("G1X2F100\n", "ok"),
        ("G33\n", "error:20"),
        ("\n", "ok"),
        ("(comment)\r", "ok"),
        ("$7=1\n", "error:3"),
        ("$1=25\n", "ok"),
        ("$G\n", "ok"),
        ("$#\n", "ok"),
        ("G4P0.01\n", "ok"),
        ("G10L2P1X1\n", "ok"),
        ("M3S10\n", "ok"),
        ("G0G1\n", "error:24"),
        ("X\n", "error:2"),
        ("$0=1\n", "error:6"),
    ])
}

proptest! {
    #![proptest_config(crate::cases(50))]

    #[test]
    fn one_answer_for_each_line_in_order_whatever_is_mixed_in(
        lines in prop::collection::vec(known_line(), 1..40),
        realtime in prop::collection::vec((0_usize..400, prop::sample::select(vec![&b"?"[..], b"~", b"\x91", b"\x85", b"\xc2\x91"])), 0..40),
        pauses in prop::collection::vec(0_usize..400, 0..10),
    ) {
        let mut bytes: Vec<u8> = lines.iter().flat_map(|line| line.0.bytes()).collect();
        let is_lead = |byte: Option<&u8>| byte == Some(&0xc2);
        for &(place, request) in &realtime {
            let mut place = place % (bytes.len() + 1);
            // A byte within a character is a part of it.
            place += usize::from(place != 0 && is_lead(bytes.get(place - 1)));
            bytes.splice(place..place, request.iter().copied());
        }
        let mut bench = Bench::new();
        let mut output = Vec::new();
        for (index, &byte) in bytes.iter().enumerate() {
            bench.receive(&[byte]);
            if pauses.contains(&index) {
                bench.receive(b"!");
                output.extend(bench.serve());
                bench.receive(b"~");
            }
        }
        output.extend(bench.serve());
        let expected: Vec<_> = lines.iter().map(|line| line.1).collect();
        prop_assert_eq!(answers(&output), expected);
        let reports = output.iter().filter(|line| line.starts_with('<')).count();
        prop_assert!(reports <= realtime.len());
    }

    #[test]
    fn any_bytes_are_answered_once_for_each_line_end(
        bytes in prop::collection::vec(prop_oneof![4 => 0_u8..128, 1 => any::<u8>(), 1 => Just(b'\n')], 0..1500),
    ) {
        let mut bench = Bench::new();
        let bytes: Vec<_> = bytes.into_iter().filter(|b| !matches!(b, 0x18 | b'!' | b'?')).collect();
        let ends = bytes.iter().filter(|b| matches!(b, b'\n' | b'\r')).count();
        let mut lines = Vec::new();
        for part in bytes.chunks(500) {
            bench.receive(part);
            lines.extend(bench.serve());
            while bench.machine.state == State::HoldComplete {
                // M0 waits for cycle start.
                lines.extend(bench.answer("~"));
            }
        }
        let answered = answers(&lines).len();
        if lines.iter().any(|line| line == "[MSG:Disabled]") {
            // Check mode ends with a reset, which drops what has come.
            prop_assert!(answered <= ends, "{answered} answers, {ends} line ends");
        } else {
            prop_assert_eq!(answered, ends);
        }
    }

    #[test]
    fn resets_anywhere_leave_a_session_that_answers(
        bytes in prop::collection::vec(prop_oneof![8 => 0x20_u8..0x60, 1 => Just(b'\n'), 1 => Just(0x18)], 0..600),
    ) {
        let mut bench = Bench::new();
        bench.receive(&bytes);
        bench.serve();
        bench.receive(b"\x18");
        let lines = bench.serve();
        prop_assert!(lines.ends_with(&[WELCOME[0].into(), WELCOME[1].into()]), "{lines:?}");
        prop_assert_eq!(bench.ask("$X"), ["ok"]);
    }

    #[test]
    fn listed_settings_set_again_are_the_same_settings(
        values in prop::collection::vec((0_usize..40, 0_u32..300, 0_u32..1000), 0..60),
    ) {
        let mut bench = Bench::new();
        let names: Vec<_> = bench.ask("$$").into_iter().filter_map(|line| {
            line.split_once('=').map(|(name, _)| name.to_owned())
        }).collect();
        for (place, whole, thousandths) in values {
            let name = &names[place % names.len()];
            let before = *bench.session.settings();
            let answer = bench.ask(&format!("{name}={whole}.{thousandths:03}"));
            if answer != ["ok"] {
                prop_assert_eq!(*bench.session.settings(), before, "{:?}", answer);
            }
        }
        let listed = bench.ask("$$");
        let mut other = Bench::new();
        // Homing first: soft limits are refused without it.
        let homing = listed.iter().filter(|line| line.starts_with("$22"));
        for line in homing.chain(&listed) {
            if line.starts_with('$') {
                prop_assert_eq!(other.ask(line), ["ok"], "{}", line);
            }
        }
        prop_assert_eq!(other.ask("$$"), listed);
        let (mut stored, shown) = (*bench.session.settings(), *other.session.settings());
        // Spindle speeds are listed without their fraction.
        stored.spindle_max_rpm = shown.spindle_max_rpm;
        stored.spindle_min_rpm = shown.spindle_min_rpm;
        prop_assert_eq!(stored, shown);
    }
}
