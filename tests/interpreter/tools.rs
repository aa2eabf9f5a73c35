//! The tool table and the tool length offset.

use std::num::NonZeroU8;

use leadscrew::{
    axis::{Axes, X, Y, Z},
    gcode::{LineError, interpreter::Message},
    settings::{Settings, TOOLS, ToolEntry},
    units::Nm,
};

use crate::support::{after, error, send, um};

/// The entry of a tool.
fn entry(lines: &[&str], number: u8) -> ToolEntry {
    after(lines).tools().get(number).unwrap()
}

/// The tool length offset after lines.
fn length(lines: &[&str]) -> Axes<Nm> {
    after(lines).offsets().tool
}

const TOOL: &str = "G10L1P3X1Y-2Z10.16R1.5";

#[test]
fn a_tool_is_created_and_the_words_that_are_given_are_set() {
    let tool = entry(&[TOOL], 3);
    let [x, y, z] = [X, Y, Z].map(|axis| um(1000, -2000, 10_160)[axis]);
    assert_eq!((tool.offset, tool.diameter), ([x, y, z], Nm(3_000_000)));
    let changed = entry(&[TOOL, "G10L1P3Z5"], 3);
    assert_eq!(changed.offset, [x, y, Nm(5_000_000)]);
    assert_eq!(changed.diameter, tool.diameter);
    assert_eq!(
        entry(&[TOOL, "G20G10L1P3R-1"], 3).diameter,
        Nm(-2 * Nm::PER_INCH)
    );
    // Distances of G91 do not matter, and nothing else changes.
    assert_eq!(entry(&["G91G0X1", "G10L1P3X1"], 3).offset[0], x);
    assert_eq!(length(&[TOOL]), um(0, 0, 0));
}

#[test]
fn the_length_of_a_tool_is_in_effect_from_g43_to_g49() {
    let tool = um(1000, -2000, 10_160);
    assert_eq!(length(&[TOOL, "G43H3"]), tool);
    assert_eq!(after(&[TOOL, "G43H3", "G0X0Y0Z0"]).position(), tool);
    assert_eq!(after(&[TOOL, "G43H3Z0"]).position(), um(0, 0, 10_160));
    assert_eq!(length(&[TOOL, "G43H3", "M2"]), tool);
    assert_eq!(
        length(&[TOOL, "G43H3", "G10L1P3Z1"]),
        tool,
        "not before the next G43"
    );
    assert_eq!(length(&[TOOL, "G43H3", "G49"]), um(0, 0, 0));
}

#[test]
fn without_h_the_length_is_that_of_the_tool_in_the_spindle() {
    let tool = um(1000, -2000, 10_160);
    for line in ["G43", "G43H0", "G43.2H0"] {
        assert_eq!(length(&[TOOL, "M61Q3", line]), tool, "{line}");
        assert_eq!(length(&[TOOL, line]), um(0, 0, 0), "{line}");
        assert_eq!(error(&[TOOL, "M61Q4", line]).number(), 38, "{line}");
    }
    assert_eq!(length(&[TOOL, "M61Q3G43"]), tool);
    assert_eq!(
        length(&[TOOL, "T3", "G43"]),
        um(0, 0, 0),
        "it is only selected"
    );
}

#[test]
fn g43_2_adds_a_tool_or_the_axis_words() {
    assert_eq!(length(&[TOOL, "G43H3", "G43.2H3"]), um(2000, -4000, 20_320));
    assert_eq!(
        length(&[TOOL, "G43H3", "G43.2X1Z1"]),
        um(2000, -2000, 11_160)
    );
    assert_eq!(length(&[TOOL, "G0G43.2H3"]), um(1000, -2000, 10_160));
    for (line, number) in [
        ("G43.2", 28),
        ("G43.2H3X1", 48),
        ("G0G43.2H3X1", 48),
        ("G0G43.2X1", 24),
        ("G43.2H4", 38),
        ("G43.2H3.5", 23),
    ] {
        assert_eq!(error(&[TOOL, line]).number(), number, "{line}");
    }
}

#[test]
fn g43_with_an_empty_table_is_no_length_and_says_so() {
    for line in ["G43H1", "M61Q4G43", "G43.2H9"] {
        let mut machine = after(&[]);
        let outcome = send(&mut machine, line).unwrap();
        assert_eq!(outcome.message, Some(Message::EmptyToolTable), "{line}");
        assert_eq!(machine.offsets().tool, um(0, 0, 0));
    }
    for line in ["G43", "G43H0", "G49", "G43.1Z1"] {
        assert_eq!(send(&mut after(&[]), line).unwrap().message, None, "{line}");
    }
    assert_eq!(error(&["G10L1P2Z1", "G43H1"]).number(), 38);
}

#[test]
fn l10_measures_a_tool_where_it_touches() {
    let lines = ["G10L2P1X5Z-30", "G92X1", "G0X10Z-20"];
    let measured = |line: &str| {
        let mut machine = after(&lines);
        send(&mut machine, line).unwrap();
        send(&mut machine, "G43H1").unwrap();
        let work = machine
            .position()
            .zip(machine.work_offset(&machine.position()), |at, offset| {
                at - offset
            });
        (machine.offsets().tool, work)
    };
    let (tool, work) = measured("G10L10P1Z0");
    let machine = after(&lines).position();
    assert_eq!(
        (tool[Z], tool[X], work[Z]),
        (machine[Z] + Nm(30_000_000), Nm(0), Nm(0))
    );
    // In another system, which the line changes to.
    assert_eq!(measured("G55G10L10P1X2").1[X], Nm(2_000_000));
    let (tool, _) = measured("G10L11P1X3Z1R2");
    assert_eq!(tool[X], machine[X] - Nm(3_000_000));
    let l11 = ["G10L2P9Z7", "G92Z5", "G10L11P1Z1R2"];
    assert_eq!(entry(&l11, 1).offset[2], Nm(-8_000_000));
    assert_eq!(entry(&l11, 1).diameter, Nm(4_000_000));
}

#[test]
fn l10_under_a_rotation_gives_the_present_point_the_values() {
    for lines in [
        ["G10L2P1X10Y20R30", "G0X3Y4Z5", "G10L10P1X1"],
        ["G10L2P1X10Y20R90", "G92X7Y8", "G10L10P1X1Y4Z2"],
    ] {
        let mut machine = after(&lines);
        let before = machine.position();
        send(&mut machine, "G43H1").unwrap();
        send(&mut machine, "G0X1").unwrap();
        let moved = machine.position().zip(before, |now, before| now - before);
        assert!(
            moved.iter().all(|moved| moved.0.abs() <= 2),
            "{lines:?}: {moved:?}"
        );
    }
}

#[test]
fn g10_with_a_tool_is_refused_as_the_table_of_errors_says() {
    for (line, number) in [
        ("G10L1P1", 26),
        ("G10L1Z1", 28),
        ("G10L1P0Z1", 38),
        ("G10L1P256Z1", 38),
        ("G10L1P1.5Z1", 23),
        ("G10L1P-1Z1", 4),
        ("G10L1P1Z1I1", 36),
        ("G10L1P1Z2147.483648", 33),
        ("G10L1P1Z-2147.483648", 33),
        ("G10L1P1R1073.741824", 33),
        ("G10L0P1Z1", 20),
        ("G10L12P1Z1", 20),
        ("H1", 20),
        ("G1X1F100H1", 20),
        ("G43.1Z1H1", 20),
        ("G43H-1", 4),
        ("G43H1.5", 23),
        ("G43H256", 38),
        ("G43H1H2", 25),
        ("G43H3P1", 36),
        ("G43G49", 21),
        ("G80G43H3X1", 31),
    ] {
        assert_eq!(error(&[TOOL, line]).number(), number, "{line}");
    }
}

#[test]
fn a_full_table_takes_no_tool_more() {
    let lines: Vec<_> = (1..=TOOLS).map(|n| format!("G10L1P{}Z1", 5 * n)).collect();
    let lines: Vec<_> = lines.iter().map(String::as_str).collect();
    let one_more = [&lines[..], &["G10L1P1Z1"]].concat();
    assert_eq!(error(&one_more), LineError::ToolTableFull);
    assert_eq!(
        entry(&[&lines[..], &["G10L1P5Z2"]].concat(), 5).offset[2],
        Nm(2_000_000)
    );
}

#[test]
fn a_line_of_a_tool_table_is_read() {
    let machine = after(&[TOOL]);
    let read = |number, words: &str| {
        let number = NonZeroU8::new(number).unwrap();
        machine.read_tool(number, words.as_bytes(), &Settings::default())
    };
    let (slot, tool) = read(3, "T3P1X+0.5Y-2Z10.16D3.048").unwrap().unwrap();
    let tool = tool.unwrap();
    assert_eq!(slot, 0);
    assert_eq!(tool.offset, [Nm(500_000), Nm(-2_000_000), Nm(10_160_000)]);
    assert_eq!(tool.diameter, Nm(3_048_000));
    let (slot, tool) = read(4, "Z1").unwrap().unwrap();
    let tool = tool.unwrap();
    assert_eq!((slot, tool.offset[0], tool.diameter), (1, Nm(0), Nm(0)));
    assert_eq!(read(3, ""), Ok(Some((0, None))), "the slot of a known tool");
    assert_eq!(read(4, ""), Ok(None));
    for (words, number) in [
        ("T4Z1", 39),
        ("Z1Z2", 25),
        ("Z1Q0", 20),
        ("5", 1),
        ("Z", 2),
        ("Z2147.483648", 33),
        ("D-2147.5", 33),
    ] {
        assert_eq!(read(3, words).unwrap_err().number(), number, "{words}");
    }
}
