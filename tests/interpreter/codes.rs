//! The table of codes against the interpreter.

use leadscrew::gcode::{
    LineError,
    codes::{CODES, CodeGroup},
    interpreter::Interpreter,
};

use crate::support::{error, send};

fn code(line: &str) -> String {
    line.replace(' ', "")
}

#[test]
fn the_examples_of_every_code_are_executed_and_refused_as_the_table_says() {
    for row in CODES {
        let mut machine = Interpreter::new();
        for line in row.example {
            let sent = send(&mut machine, &code(line));
            assert!(sent.is_ok(), "{}: `{line}`: {sent:?}", row.code);
        }
        let shown = row.example.last().unwrap();
        let has_code = shown.split(' ').any(|word| word == row.code);
        assert!(has_code, "{}: `{shown}` does not show it", row.code);
        for (line, why) in row.refused {
            assert_eq!(error(&[&code(line)]), *why, "{}: `{line}`", row.code);
        }
    }
}

#[test]
fn every_code_that_is_read_is_in_the_table() {
    let known = |text: &str| CODES.iter().any(|row| row.code == text);
    for letter in ["G", "M"] {
        for tenths in 0..1000 {
            let (whole, tenth) = (tenths / 10, tenths % 10);
            let text = match tenth {
                0 => format!("{letter}{whole}"),
                _ => format!("{letter}{whole}.{tenth}"),
            };
            let read = send(&mut Interpreter::new(), &text);
            let is_unknown = matches!(read, Err(LineError::Unsupported | LineError::NotInteger));
            // The fraction of `G49` does not count, as in Grbl.
            let is_listed = known(&text) || whole == 49 && letter == "G";
            assert_eq!(
                is_listed, !is_unknown,
                "{text}: {read:?}: a code needs its row in src/gcode/codes.rs, and a row a code"
            );
        }
    }
}

#[test]
fn every_group_has_codes() {
    for group in CodeGroup::ALL {
        assert!(CODES.iter().any(|row| row.group == group), "{group:?}");
    }
}
