//! Plain lines: their execution in one go equals checking and committing.

use leadscrew::{
    gcode::{
        NotPlain, PlainPrefix,
        interpreter::{CheckedLine, Interpreter, LineCommands},
    },
    model::Command,
    protocol::Line,
    settings::Settings,
};
use proptest::prelude::*;

use crate::support::{after, send, um};

/// Executes a plain line at once; of another line, returns the plain words at its beginning.
fn plain(
    machine: &mut Interpreter,
    line: &str,
    settings: &Settings,
) -> Result<(CheckedLine, LineCommands), PlainPrefix> {
    plain_in_parts(machine, line, line.len(), settings)
}

/// The same with a line of which the second part begins at a byte.
fn plain_in_parts(
    machine: &mut Interpreter,
    line: &str,
    second: usize,
    settings: &Settings,
) -> Result<(CheckedLine, LineCommands), PlainPrefix> {
    // Nothing of the line before may be left.
    let mut prefix = PlainPrefix::default();
    let other: &[u8] = b"G1F7N8X9Y9Z9\n";
    assert!(prefix.read([other, &[]].map(bytes)).is_ok());
    let before = "M3S500G43.1Z3M30";
    let mut checked = Interpreter::new()
        .check(before.as_bytes(), settings)
        .unwrap();
    let mut outcome = LineCommands::default();
    Interpreter::new().commit(&checked, &mut outcome);
    let all = format!("{line}\nG0");
    let (first, second) = all.as_bytes().split_at(second);
    let parts = [first, second].map(bytes);
    let remaining = machine
        .execute_plain(parts, settings, &mut prefix, &mut checked, &mut outcome)
        .map_err(|_| prefix)?;
    assert_eq!(remaining, 2, "{line}");
    Ok((checked, outcome))
}

fn bytes(text: &[u8]) -> impl ExactSizeIterator<Item = u8> + Clone {
    text.iter().copied()
}

/// Where a line ends in Grbl's single precision, which no comparison of targets looks at.
fn single_mm(outcome: &LineCommands) -> Vec<u32> {
    match outcome.commands.as_slice() {
        [Command::Line { target, .. }] => target.single_mm.iter().map(|mm| mm.to_bits()).collect(),
        other => panic!("{other:?} is not one line"),
    }
}

/// Lines that leave modes and offsets behind.
fn any_mode() -> impl Strategy<Value = String> {
    prop_oneof![
        "G(0|1|20|21|5[4-9]|61|61\\.1|64|80|90|91|92\\.1|93|94)(F[1-9][0-9]{0,3})?",
        "G10L(2|20)P[0-6]X-?[0-9]{1,4}(\\.[0-9]{1,6})?",
        "(G92|G43\\.1)Z-?[0-9]{1,3}(\\.[0-9]{1,6})?",
        "G92X-?[0-9]{1,3}Y-?[0-9]{1,9}",
        "G1X[0-9]{1,3}\\.[0-9]{1,9}Y-?[0-9]{1,10}F100",
        "G2X10I5F100",
        "M(3|4|5|8|9)S[0-9]{1,4}",
    ]
}

/// Numbers short and long, right and wrong.
fn any_number() -> impl Strategy<Value = String> {
    prop_oneof![
        8 => "[-+]?[0-9]{1,4}(\\.[0-9]{0,4})?",
        4 => "-?\\.?[0-9]{1,5}",
        1 => "[-+]?[0-9]{0,12}\\.?[0-9]{0,10}",
        1 => "[-+]{0,2}[0-9]{0,3}\\.{0,2}[0-9]{0,3}",
    ]
}

fn any_line() -> impl Strategy<Value = String> {
    let word = (
        prop_oneof![
            12 => "[XYZ]",
            4 => "[FN]",
            1 => "[xyf]",
            1 => "\\([ -~]{0,3}\\)[XY]",
            1 => ";[ -~]{0,3}X",
            1 => "[A-Z]",
            1 => "[ -~]",
            1 => " [XYZ]",
            1 => "[ \t/]",
        ],
        any_number(),
    )
        .prop_map(|(letter, number)| letter + &number);
    let motion = prop_oneof![
        6 => Just(String::new()),
        4 => Just("G1".to_owned()),
        4 => Just("G0".to_owned()),
        1 => "G[0-9]{1,2}(\\.[0-9])?",
    ];
    (motion, prop::collection::vec(word, 0..6)).prop_map(|(motion, words)| motion + &words.concat())
}

#[test]
fn an_increment_counts_in_single_precision_from_where_the_position_was_set() {
    let settings = Settings::default();
    let mut set = after(&["G91G1X5Y5F100"]);
    set.set_position(um(12_300, -700, 0));
    for [x, y] in [["X0.002", "Y0.002"], ["X-1.7", "Y0.3"]] {
        let readers: [fn(&mut Interpreter, &str, &Settings) -> LineCommands; 2] = [
            |machine, line, settings| plain(machine, line, settings).unwrap().1,
            |machine, line, _| send(machine, line).unwrap(),
        ];
        let number = |word: &str| word[1..].parse::<f32>().unwrap();
        let expected = [12.3 + number(x), -0.7 + number(y)].map(f32::to_bits);
        for execute_line in readers {
            let outcome = execute_line(&mut set.clone(), &format!("{x}{y}"), &settings);
            assert_eq!(single_mm(&outcome)[..2], expected, "{x}{y}");
        }
    }
}

#[test]
fn straight_moves_are_plain_and_nothing_else_is() {
    let is_plain =
        |before: &[&str], line: &str| plain(&mut after(before), line, &Settings::default()).is_ok();
    for line in [
        "G1X5.000Y8.200Z7.693F600",
        "G0X1",
        "G01Y-.5F10",
        "X+1.",
        "N10G0X1Y2",
        "G1F5X00001.0000",
        "  G1 F5  X1 ",
    ] {
        assert!(is_plain(&[], line), "{line}");
    }
    for (before, line) in [("G91", "X1"), ("G55", "X1"), ("F10", "G1X1"), ("G64", "X1")] {
        assert!(is_plain(&[before], line), "{before} {line}");
    }
    for line in [
        "",
        "G1",
        "F10",
        "G1X1",
        "G2X1I1F1",
        "G1X1S1F1",
        "X1X2",
        "G0G1X1F1",
        "G1X1F-1",
        "X1.12345",
        "X123456789",
        "X",
        "X-",
        "X1P1",
        "G1.0X1F1",
        "N1.0X1",
        "N10000001X1",
        "G90X1",
        "G0X 1",
        "G0X1 1",
        "X1\0",
        "X60000000",
    ] {
        assert!(!is_plain(&[], line), "{line}");
    }
    for (before, line) in [
        ("G20", "X1"),
        ("G93", "G1X1F1"),
        ("G80", "X1"),
        ("G2X10I5F1", "X1"),
    ] {
        assert!(!is_plain(&[before], line), "{before} {line}");
    }
    let settings = Settings {
        laser: true,
        ..Settings::default()
    };
    assert!(plain(&mut after(&[]), "X1", &settings).is_err());
}

#[test]
fn comments_and_lower_case_may_stand_between_plain_words() {
    let is_plain = |line| plain(&mut after(&[]), line, &Settings::default()).is_ok();
    for line in [
        "x1",
        "g1 x1 f5 (right)",
        "(a) X1 (b)(c; d) ; e (f",
        "X1(open",
    ] {
        assert!(is_plain(line), "{line}");
    }
    for line in ["X(a)1", "X1(a)1", "X1)", "(a)"] {
        assert!(!is_plain(line), "{line}");
    }
}

#[test]
fn a_truncated_line_changes_nothing_and_may_be_plain_yet() {
    let line = "G1 F100 X-1.5 Y2\nG0";
    let settings = Settings::default();
    let mut machine = Interpreter::new();
    let (mut prefix, mut checked, mut outcome) = Default::default();
    for length in 0..line.len() {
        let parts = [&line.as_bytes()[..length], &[]].map(bytes);
        let result =
            machine.execute_plain(parts, &settings, &mut prefix, &mut checked, &mut outcome);
        if line[..length].contains('\n') {
            assert!(result.is_ok(), "{length}");
            return;
        }
        assert_eq!(result.err(), Some(NotPlain::Incomplete), "{length}");
        assert_eq!(machine, Interpreter::new(), "{length}");
        // A line that does not stay where it waits is continued in the same way.
        let (text, same) = (b"G1F100X-1.5Y2", &settings);
        let continued = machine.check_after(&prefix, text, same);
        assert_eq!(continued, machine.check(text, same), "{length}");
    }
}

#[test]
fn checking_continues_at_the_first_word_that_is_not_plain() {
    for (line, rest) in [
        ("", ""),
        ("?1", "?1"),
        ("G2X1", "G2X1"),
        ("G1X1S1Y2", "S1Y2"),
        ("n1 (a) g1 x1 (b;) ; c", ""),
        ("X1 2Y3", "X12Y3"),
        ("G1X1 .5", "X1.5"),
        ("G1X1(a)5", "X15"),
        ("G1X1\t5", "X15"),
        ("G1X1/5", "X15"),
        ("G1X1-5", "X1-5"),
        ("G0X1X2", "X2"),
        ("G1X1.12345Y", "Y"),
        ("X1Y123456789Z", "Y123456789Z"),
        ("X1G", "G"),
    ] {
        let mut stripped = Line::new();
        assert!(stripped.take_from(line.bytes().chain([b'\n'])));
        // In a mode in which no line without G0 is plain, nor one with G1, which has no feed.
        let mut machine = after(&["G80"]);
        let prefix = plain(&mut machine, line, &Settings::default()).unwrap_err();
        let stripped = stripped.text().unwrap();
        assert_eq!(prefix.rest_of(stripped), rest.as_bytes(), "{line}");
    }
}

proptest! {
    #![proptest_config(crate::cases(500))]

    #[test]
    fn a_plain_line_does_what_checking_and_committing_do(
        modes in prop::collection::vec(any_mode(), 0..6),
        lines in prop::collection::vec((any_line(), any::<prop::sample::Index>()), 1..20),
        laser in prop::bool::weighted(0.1),
    ) {
        let settings = Settings { laser, ..Settings::default() };
        let mut machine = Interpreter::new();
        for mode in modes {
            let _ = send(&mut machine, &mode);
        }
        for (line, second) in lines {
            let before = machine.clone();
            // Blanks, comments and lower case may be left in a plain line, and in no other.
            let mut stripped = Line::new();
            prop_assert!(stripped.take_from(line.bytes().chain([b'\n'])));
            let text = stripped.text().unwrap();
            let checked = machine.check(text, &settings);
            let second = second.index(line.len() + 3);
            let (in_parts, short) = match plain_in_parts(&mut machine, &line, second, &settings) {
                Ok(executed) => executed,
                Err(prefix) => {
                    prop_assert_eq!(&machine, &before, "{}", line);
                    let continued = machine.check_after(&prefix, text, &settings);
                    prop_assert_eq!(&continued, &checked, "{}", line);
                    if let Ok(checked) = checked {
                        machine.commit(&checked, &mut LineCommands::default());
                    }
                    continue;
                }
            };
            let checked = checked.map_err(|error| {
                TestCaseError::fail(format!("{line:?} is plain and {error}"))
            })?;
            let mut other = before;
            let mut long = LineCommands::default();
            other.commit(&checked, &mut long);
            prop_assert_eq!(&machine, &other, "{}", line);
            prop_assert_eq!(&short, &long, "{}", line);
            prop_assert_eq!(single_mm(&short), single_mm(&long), "{}", line);
            prop_assert!(checked.moves() && in_parts.moves());
            for checked in [&checked, &in_parts] {
                prop_assert!(!checked.waits_for_standstill() && !checked.answers_when_done());
                prop_assert!(!checked.ends_program() && checked.probing().is_none());
                prop_assert!(machine.origins_after(checked).is_none());
            }
        }
    }
}

#[test]
fn an_increment_from_where_the_machine_was_stopped_is_rounded_as_from_there() {
    let mut machine = after(&["G91", "G1X7.7Y0.3F100"]);
    let stopped = um(1234, -567, 8);
    machine.set_position(stopped);
    let outcome = send(&mut machine, "X0.002Y0.002Z0.002").unwrap();
    let sums = stopped.map(|nm| (nm.to_mm() + 0.002).to_bits());
    assert_eq!(single_mm(&outcome)[..3], sums.0[..3]);
}
