//! Lines that are refused.

use leadscrew::{
    gcode::{LineError, interpreter::Interpreter},
    settings::Settings,
    units::StepsPerMm,
};

use crate::support::{error, send};

#[test]
fn what_an_axis_cannot_count_is_no_target() {
    // 250 steps/mm and a quarter of 2^31 steps.
    for text in [
        "X2147484",
        "X-2147484",
        "X99999999999999999999",
        "G20Z-90000000000000000",
        "G10L2P1X3000000",
        "G10L20P1X-3000000",
        "G92X3000000",
        "G43.1Z-3000000",
        "G2X1I3000000F1",
        "G2X1R3000000F1",
        "G2X0I-99999999999999999999F1",
    ] {
        assert_eq!(error(&[text]), LineError::InvalidTarget, "{text}");
    }
    assert!(send(&mut Interpreter::new(), "X2147483Y-2147483").is_ok());
    let far = ["G0X2000000", "G91", "X200000"];
    assert_eq!(error(&far), LineError::InvalidTarget);
    let offset = ["G10L2P1X2000000", "X200000"];
    assert_eq!(error(&offset), LineError::InvalidTarget);
}

#[test]
fn a_radius_that_the_finer_axis_of_the_plane_cannot_count_is_no_target() {
    let mut settings = Settings::default();
    settings.steps_per_mm[2] = StepsPerMm::from_millionths(100_000_000_000).unwrap();
    let machine = Interpreter::new();
    // 5.4 m of Z at 100 000 steps/mm.
    for (line, is_right) in [
        ("G18G3X0Z0I10000F1", true),
        ("G18G2X0Z0I-11000F1", false),
        ("G18G3X0Z0I11000F1", false),
        ("G2X1R11000F1", true),
    ] {
        let checked = machine.check(line.as_bytes(), &settings);
        let expected = (!is_right).then_some(LineError::InvalidTarget);
        assert_eq!(checked.err(), expected, "{line}");
    }
}

#[test]
fn numbers_out_of_range_are_errors() {
    for (line, number) in [
        ("N10000001", 27),
        ("N99999999999999999999999", 27),
        ("T256", 38),
        ("T255.5", 23),
        ("T1.5", 23),
        ("T99999999999999999999999", 38),
        ("T-1", 4),
        ("G4P99999999", 39),
        ("G10L2P99999999999999999999X1", 29),
        ("G99999999999999999999", 20),
        ("M99999999999999999999", 23),
        ("G59.4", 23),
        ("G58.1", 23),
    ] {
        assert_eq!(error(&[line]).number(), number, "{line}");
    }
}

#[test]
fn a_probe_move_is_checked_as_grbl_does() {
    for (line, error_of_line) in [
        ("G38.2", LineError::FeedUndefined),
        ("G38.2F10", LineError::NoAxisWords),
        ("G38.2Z0F10", LineError::InvalidTarget),
        ("G38.2X1Z-1F10P1", LineError::UnusedWords),
    ] {
        assert_eq!(error(&[line]), error_of_line, "{line}");
    }
}
