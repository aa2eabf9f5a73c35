//! Random programs over all codes, sent to the whole simulated machine.
//!
//! Each line is answered once, a refused line changes nothing, and with soft limits no step leaves the
//! travel.

use leadscrew::{
    axis::Axes,
    gcode::{Modal, interpreter::Offsets},
    model::State,
    protocol::Session,
    units::Nm,
};
use proptest::prelude::*;

use super::{
    machine::{execute, execute_with, is_answer, limited},
    random_lines::any_line,
    support::cases,
};

/// What comes between the bytes of a line, without one answer more.
fn realtime() -> impl Strategy<Value = Option<u8>> {
    prop::sample::select(vec![
        None,
        None,
        None,
        None,
        None,
        None,
        Some(b'?'),
        Some(b'!'),
        Some(b'~'),
        Some(0x84),
        Some(0x85),
        Some(0x88),
        Some(0x91),
        Some(0x95),
        Some(0x99),
        Some(0x9e),
        Some(0xa0),
        Some(0xa3),
    ])
}

/// Modes, offsets and the programmed position, all that realtime bytes leave alone at rest.
fn changed_by_lines(session: &Session) -> (Modal, Offsets, Axes<Nm>) {
    let state = session.interpreter();
    (*state.modal(), *state.offsets(), state.position())
}

proptest! {
    #![proptest_config(cases(300))]

    #[test]
    fn programs_of_all_codes_are_answered_line_by_line_and_stay_in_the_travel(
        program in prop::collection::vec((any_line(), realtime(), prop::bool::weighted(0.3)), 1..24),
    ) {
        let mut machine = limited();
        let mut is_disturbed = false;
        for (line, between, stands_still) in &program {
            if *stands_still {
                machine.run_to_standstill();
                machine.lines();
            }
            let session = machine.session();
            let before = (changed_by_lines(session), session.stored().clone());
            let was_asleep = machine.state() == State::Sleep;
            let lines = execute_with(&mut machine, line, *between);
            let answers: Vec<_> = lines.iter().filter(|line| is_answer(line)).collect();
            prop_assert_eq!(answers.len(), usize::from(!was_asleep), "{}: {:?}", line, lines);
            let session = machine.session();
            // Realtime bytes may switch the coolant and end a jog.
            is_disturbed |= !matches!(between, None | Some(b'?'));
            if *stands_still && !is_disturbed && answers.iter().any(|answer| *answer != "ok") {
                prop_assert_eq!(changed_by_lines(session), before.0, "{}", line);
                prop_assert_eq!(session.stored(), &before.1, "{}", line);
            }
            is_disturbed = !matches!(between, None | Some(b'?'));
            if machine.state() == State::Alarm {
                machine.run_to_standstill();
                let lines = execute(&mut machine, "$X");
                prop_assert!(lines.iter().any(|line| line == "ok"), "{:?}", lines);
            }
        }
        prop_assert!(!machine.answers().iter().any(|line| is_answer(line)));
        prop_assert_eq!(machine.late(), 0);
        prop_assert_eq!(machine.lost(), 0);
    }
}
