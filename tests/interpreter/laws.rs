//! Laws for all lines.

use leadscrew::{
    axis::{AXES, X, Z},
    gcode::interpreter::{Interpreter, LineCommands},
    model::Command,
    settings::Settings,
    units::Nm,
};
use proptest::prelude::*;

use crate::support::{after, decimal, send};

/// Lines that are mostly right, and others that mostly are not.
fn any_line() -> impl Strategy<Value = String> {
    prop_oneof![
        "(G0|G1)?X-?[0-9]{1,7}(\\.[0-9]{1,8})?(Z-?[0-9]{1,3})?(F[1-9])?",
        "G[23]X-?[0-9]{1,3}(R-?[0-9]{3,7}|I-?[0-9]{1,3})(P[1-9])?F[1-9]",
        "G(17|18|19|20|21|28|28\\.1|30|49|5[3-9]|59\\.[1-3]|80|90|91|9[01]\\.1|92\\.[1-3]|93|94|97|98|99)",
        "(G10L(2|20)P[0-9]|G92|G52|G43\\.1|G28|G0G28)(X-?[0-9]{1,7}|Z-?[0-9]{1,4})(R-?[0-9]{1,3})?",
        "M(1|48|49|5[013]P[01])|%|O[0-9]{1,4}|G64(P0\\.[0-9])?(Q0\\.[0-9])?|G61(\\.1)?",
        "(G4P[0-9])?(M(0|2|3|4|5|8|9|30))?(S[0-9]{1,4})?(T[0-9]{1,3})?",
        "([GMTFSNPRLXYZIJK](-?[0-9]{1,20}\\.?[0-9]{0,8})){0,6}",
    ]
}

proptest! {
    #![proptest_config(crate::cases(64))]

    #[test]
    fn increments_add_up_exactly(
        step in -20_000_000..20_000_000_i64,
        count in 1..400_i64,
        start in -1_000_000_000_000..1_000_000_000_000_i64,
    ) {
        let mut machine = after(&[&format!("G0X{}", decimal(start)), "G91"]);
        let text = format!("X{}", decimal(step));
        for _ in 0..count {
            send(&mut machine, &text).unwrap();
        }
        prop_assert_eq!(machine.position()[X], Nm(start + count * step));
    }

    #[test]
    fn setting_an_offset_makes_the_work_position_what_was_asked(
        position in -1_000_000_000..1_000_000_000_i64,
        wanted in -1_000_000_000..1_000_000_000_i64,
        length in -1_000_000_000..1_000_000_000_i64,
        system in 1..=6,
    ) {
        let before = [
            "G92Z1.5".to_owned(),
            "G10L2P3Z-7".to_owned(),
            format!("G43.1Z{}", decimal(length)),
            format!("G53G0Z{}", decimal(position)),
            format!("G{}", 53 + system),
        ];
        let before: Vec<&str> = before.iter().map(String::as_str).collect();
        for setting in ["G92", "G10L20P0", &format!("G10L20P{system}")] {
            let mut machine = after(&before);
            send(&mut machine, &format!("{setting}Z{}", decimal(wanted))).unwrap();
            let work = machine.position()[Z] - machine.work_offset(&machine.position())[Z];
            prop_assert_eq!(work, Nm(wanted), "{}", setting);
            prop_assert_eq!(machine.position()[Z], Nm(position));
        }
    }

    #[test]
    fn random_bytes_never_panic(line in prop::collection::vec(any::<u8>(), 0..300)) {
        let mut machine = after(&["F100"]);
        if let Ok(checked) = machine.check(&line, &Settings::default()) {
            machine.commit(&checked, &mut LineCommands::default());
        }
    }

    #[test]
    fn a_refused_line_changes_nothing_and_an_accepted_one_stays_in_reach(
        lines in prop::collection::vec(any_line(), 1..40),
    ) {
        let farthest = Settings::default().farthest();
        let mut machine = Interpreter::new();
        for line in lines {
            let before = machine.clone();
            match send(&mut machine, &line) {
                Err(_) => prop_assert_eq!(&machine, &before),
                Ok(outcome) => {
                    for command in &outcome.commands {
                        if let Command::Line { target, .. } | Command::Arc { target, .. } = command {
                            for axis in 0..AXES {
                                prop_assert!(target.position[axis].0.abs() <= farthest[axis].0);
                            }
                        }
                    }
                }
            }
        }
    }
}
