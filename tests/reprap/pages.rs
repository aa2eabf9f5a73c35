//! The example lines of the RepRap G-code pages, to the byte, with the comments behind them.

use crate::{
    machine::{STEPS_PER_MM, numbered, reprap, reprap_with, xy},
    support::Machine,
};

/// A line as it is printed there, its answer but for the `ok`, and where X, Y and Z are then, mm.
type Example = (&'static str, &'static [&'static str], [f64; 3]);

/// Fails unless each line has its answer and leads to its place.
fn run(machine: &mut Machine, examples: &[Example]) {
    for (line, answer, position) in examples {
        let mut expected = answer.to_vec();
        // A line without words has no answer.
        if !line.trim_start().starts_with([';', '(']) || line.contains("G28") {
            expected.push("ok");
        }
        assert_eq!(machine.ask(line), expected, "{line}");
        let steps = position.map(|mm| (mm * f64::from(STEPS_PER_MM)).round() as i32);
        let at = machine.physical_steps();
        assert_eq!([at[0], at[1], at[2]], steps, "{line}");
    }
}

#[test]
fn comments_numbers_and_checksums_are_as_in_the_examples() {
    let mut machine = reprap();
    assert_eq!(machine.ask("M110 N2"), ["ok"]);
    let off: &[&str] = &["echo:homing is off, $22"];
    run(
        &mut machine,
        &[
            ("N3 T0*57 ; This is a comment", &[], [0.0; 3]),
            ("N4 G92 E0*67", &[], [0.0; 3]),
            ("; So is this", &[], [0.0; 3]),
            ("N5 G28*22", off, [0.0; 3]),
            ("N6 G1 F1500.0*82", &[], [0.0; 3]),
            ("N7 G1 X2.0 Y2.0 F3000.0*85", &[], [2.0, 2.0, 0.0]),
            ("N8 G1 X3.0 Y3.0*33", &[], [3.0, 3.0, 0.0]),
            ("(Home some axes)", &[], [3.0, 3.0, 0.0]),
            (
                "G28 (here come the axes to be homed) X Y",
                off,
                [3.0, 3.0, 0.0],
            ),
        ],
    );
    // A number or a checksum alone, a checksum of another line, and one of five digits.
    for (line, what) in [
        ("N123", "No Checksum with line number"),
        ("*71", "checksum without line number"),
        ("*37428", "checksum without line number"),
        ("N123 [...G Code in here...] *71", "checksum mismatch"),
    ] {
        let refused = format!("Error:{what}, Last Line: 8");
        assert_eq!(machine.ask(line), [&refused, "Resend: 9", "ok"], "{line}");
    }
}

#[test]
fn moves_and_waits_are_as_in_the_examples() {
    let mut machine = reprap();
    run(
        &mut machine,
        &[
            (
                "G0 X12               ; move to 12mm on the X axis",
                &[],
                [12.0, 0.0, 0.0],
            ),
            (
                "G0 F1500             ; Set the feedrate to 1500mm/min",
                &[],
                [12.0, 0.0, 0.0],
            ),
            (
                "G1 X90.6 Y13.8 E22.4 ; Move to 90.6mm on the X axis and 13.8mm on the Y axis while extruding 22.4mm of material",
                &[],
                [90.6, 13.8, 0.0],
            ),
            (
                "G1 F1500           ; Set feedrate to 1500mm/min",
                &[],
                [90.6, 13.8, 0.0],
            ),
            (
                "G1 X50 Y25.3 E22.4 ; Move and extrude",
                &[],
                [50.0, 25.3, 0.0],
            ),
            (
                "G1 X50 Y25.3 E22.4 F3000 ; Accelerate to 3000mm/min",
                &[],
                [50.0, 25.3, 0.0],
            ),
            // Its end is not on the circle about its centre.
            (
                "G2 X90.6 Y13.8 I5 J10 E22.4",
                &["Error:the target cannot be reached (error:33)"],
                [50.0, 25.3, 0.0],
            ),
            (
                "G3 X90.6 Y13.8 I5 J10 E22.4",
                &["Error:the target cannot be reached (error:33)"],
                [50.0, 25.3, 0.0],
            ),
            ("G4 P200", &[], [50.0, 25.3, 0.0]),
            (
                "M587 S\"MYROUTER\" P\"ABCxyz;\"\" 123\"",
                &["echo:Unknown command: \"M587 S\"MYROUTER\" P\"ABCxyz;\"\" 123\"\""],
                [50.0, 25.3, 0.0],
            ),
            (
                "M587 S\"MYROUTER\" P\"ABC'X'Y'Z;\"\" 123\"",
                &["echo:Unknown command: \"M587 S\"MYROUTER\" P\"ABC'X'Y'Z;\"\" 123\"\""],
                [50.0, 25.3, 0.0],
            ),
        ],
    );
    // Each of them is right in a checked line, too.
    let position = machine.ask("M114").remove(0);
    assert!(position.contains(" E:22.400 "), "{position}");
    assert_eq!(machine.ask(&numbered(1, "G4 P200")), ["ok"]);
}

#[test]
fn single_motors_are_moved_as_in_the_examples() {
    let lines = [
        "G6 A45     ; Move SCARA A stepper to the 45\u{b0} position",
        "G6 B20 R   ; Move SCARA B stepper 20\u{b0} counter-clockwise",
        "G6 C10 R   ; Move DELTA C carriage up by 10mm",
    ];
    let mut machine = reprap_with(&["784=1"]);
    run(
        &mut machine,
        &[
            (lines[0], &[], [45.0, 0.0, 0.0]),
            (lines[1], &[], [45.0, 20.0, 0.0]),
            (lines[2], &[], [45.0, 20.0, 10.0]),
        ],
    );
    // Where they are not allowed, they are unknown.
    let mut machine = reprap();
    for line in lines {
        let answer = machine.ask(line);
        assert!(
            answer[0].starts_with("echo:Unknown command: \"G6 "),
            "{answer:?}"
        );
        assert_eq!(answer[1..], ["ok"]);
        assert_eq!(xy(&machine), [0, 0], "{line}");
    }
}
