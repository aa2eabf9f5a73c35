//! A refused line leaves everything as it was.

use leadscrew::model::{Levels, State};
use proptest::prelude::*;

use super::bench::{Bench, answers};

/// Lines that are right, to be made nearly right.
const LINES: [&str; 36] = [
    "G0X1Y2Z3",
    "G1X1F100",
    "G2X10I5F100",
    "G3X1R5F20",
    "G38.2Z-10F50",
    "G91G20G18G55",
    "G90G21G17G54",
    "G93G1X5F2",
    "G94",
    "G10L2P3X1Y2",
    "G10L20P0Z5",
    "G28X1",
    "G28.1",
    "G30.1",
    "G92X5",
    "G92.1",
    "G43.1Z2",
    "G49",
    "G53G0X1",
    "G4P0.01",
    "M3S500",
    "M8",
    "T5",
    "N10S20",
    "M2",
    "$110=600",
    "$22=1",
    "$N0=G21G90",
    "$N1=G0X1",
    "$I=ABC",
    "$RST=#",
    "$J=G91X1F100",
    "$J=G53X-5F10",
    "$H",
    "$HX",
    "$X",
];

/// A line with something put in, left out or replaced here and there.
fn near_miss() -> impl Strategy<Value = String> {
    let edit = (
        0_usize..40,
        0_u8..3,
        prop::sample::select(b"GMXYZIJKRPLFST$=#.-0123589".to_vec()),
    );
    let edits = prop::collection::vec(edit, 0..4);
    (prop::sample::select(LINES.to_vec()), edits).prop_map(|(line, edits)| {
        let mut bytes = line.as_bytes().to_vec();
        for (place, kind, byte) in edits {
            let place = place % (bytes.len() + 1);
            match (kind, bytes.get_mut(place)) {
                (1, Some(_)) => drop(bytes.remove(place)),
                (2, Some(old)) => *old = byte,
                _ => bytes.insert(place, byte),
            }
        }
        String::from_utf8_lossy(&bytes).into_owned()
    })
}

fn any_line() -> impl Strategy<Value = String> {
    prop_oneof![
        6 => near_miss(),
        // Whatever can be printed, but for realtime bytes.
        1 => "[ \"->@-}]{0,40}",
        1 => "\\$[A-Z#$+]{0,3}=?[-.0-9A-Z]{0,8}",
    ]
}

proptest! {
    #![proptest_config(crate::cases(75))]

    #[test]
    fn a_refused_line_changes_nothing(
        lines in prop::collection::vec((any_line(), 0_u8..8, 0_u8..4), 1..40),
        soft_limits: bool,
    ) {
        let settings: &[&str] = if soft_limits { &["22=1", "20=1"] } else { &[] };
        let mut bench = Bench::set(settings);
        for (line, state, inputs) in lines {
            if matches!(bench.machine.state, State::Idle | State::Jog | State::Alarm) {
                bench.machine.state = match state {
                    0 => State::Alarm,
                    1 => State::Jog,
                    _ => State::Idle,
                };
            }
            bench.flash_fails = state == 2;
            bench.close(if inputs == 0 { Levels(1) } else { Levels::NONE });
            // An alarm ends compensation before anything is refused.
            bench.answer("");
            let before = (
                bench.session.stored().clone(),
                bench.session.interpreter().clone(),
            );
            let messages = bench.ask(&line);
            let answers = answers(&messages);
            if answers.iter().any(|answer| answer.starts_with("error:")) && answers.len() == 1 {
                prop_assert_eq!(bench.session.stored(), &before.0, "{:?}: {:?}", &line, &messages);
                prop_assert_eq!(bench.session.interpreter(), &before.1, "{:?}: {:?}", &line, &messages);
            }
            if bench.machine.state == State::HoldComplete {
                bench.answer("~");
            }
            if matches!(bench.machine.state, State::Sleep) || bench.machine.is_critical {
                bench.answer("\x18");
                bench.machine.state = State::Idle;
            }
        }
    }
}
