//! The lines that a machine may send.

use grbl_client::Report;
use leadscrew::{axis::AXES, gcode::LineError, model::Alarm, settings::Setting};

/// What a message may tell.
const MESSAGES: [&str; 32] = [
    "Reset to continue",
    "Compensation waits for the next move",
    "'$H'|'$X' to unlock",
    "Caution: Unlocked",
    "Enabled",
    "Disabled",
    "Check Door",
    "Break on the line",
    "A line was refused: '~' goes on without it",
    "Check Limits",
    "Tool table is empty: tool length 0",
    "Pgm End",
    "Restoring defaults",
    "Restoring spindle",
    "Waiting for spindle",
    "Sleeping",
    "Arc not on steps",
    "G53 ends at the pull-off, before the switch",
    "Probe contact outside of a probing move",
    "Spindle is off",
    "Spindle speed is 0",
    "Stored when idle with the spindle off",
    "Not stored: lost when power is off",
    "Step rate: ",
    "Last reset: ",
    "Late events: ",
    "Tool change: T",
    "Dwell of ",
    "Path deviation: ",
    "Resend: ",
    " is missing",
    "I J K fit as absolute",
];

/// Whether a machine may send such a line.
pub(crate) fn is_known(line: &str) -> bool {
    if let Some(number) = line.strip_prefix("error:") {
        return LineError::ALL
            .iter()
            .any(|error| error.number().to_string() == number);
    }
    if let Some(number) = line.strip_prefix("ALARM:") {
        return Alarm::ALL
            .iter()
            .any(|alarm| alarm.number().to_string() == number);
    }
    if let Some(words) = line
        .strip_prefix('[')
        .and_then(|line| line.strip_suffix(']'))
    {
        return is_known_in_brackets(words);
    }
    if let Some(report) = Report::read(line) {
        // Commas between the fields are Grbl 0.9's.
        return line.contains('|') && is_report(&report);
    }
    if let Some((_, answer)) = line
        .strip_prefix('>')
        .and_then(|line| line.rsplit_once(':'))
    {
        // `>G21:ok`, and `>G99:error:20`, whose last part is a number.
        return answer == "ok" || answer.parse::<u8>().is_ok();
    }
    line.is_empty()
        || line == "ok"
        || line == "Grbl 1.1h ['$' for help]"
        || is_assignment(line)
        || is_tool(line)
        || is_position(line)
}

/// Whether a machine may send such a line to a host of 3D printers.
pub(crate) fn is_known_to_hosts(line: &str) -> bool {
    const BEGINNINGS: [&str; 8] = [
        "ok ",
        "Error:",
        "echo:",
        "//",
        "FIRMWARE_NAME:Leadscrew ",
        "Cap:",
        "Reporting endstop status",
        "X:",
    ];
    let is_switch = |state: &str| matches!(state, "open" | "TRIGGERED");
    matches!(line, "start" | "wait" | "Begin file list" | "End file list")
        || BEGINNINGS
            .iter()
            .any(|beginning| line.starts_with(beginning))
        || line.strip_prefix("Resend: ").is_some_and(are_numbers)
        || line.split_once(": ").is_some_and(|(switch, state)| {
            (switch.ends_with("_min") || switch.ends_with("_max")) && is_switch(state)
        })
        || !line.starts_with("error:") && !line.starts_with("Grbl") && is_known(line)
}

/// Whether a line is a message that the program has for its operator: its text has been sent behind a parenthesis.
pub(crate) fn is_of_program(line: &str, sent: &[u8]) -> bool {
    let text = line.strip_prefix("[MSG:");
    let text = text.and_then(|it| it.strip_suffix(']')).unwrap_or_default();
    let comment = sent.splitn(2, |byte| *byte == b'(').nth(1);
    let mut windows = comment.unwrap_or_default().windows(text.len().max(1));
    windows.any(|window| window == text.as_bytes())
}

fn is_known_in_brackets(words: &str) -> bool {
    let Some((name, value)) = words.split_once(':') else {
        return false;
    };
    match name {
        "MSG" => MESSAGES.iter().any(|message| value.contains(message)),
        "GC" => value.split(' ').count() >= 11,
        "PRB" => value
            .rsplit_once(':')
            .is_some_and(|(place, success)| are_coordinates(place) && matches!(success, "0" | "1")),
        "TLO" => are_numbers(value),
        "G28" | "G30" | "G92" => are_coordinates(value),
        "G54" | "G55" | "G56" | "G57" | "G58" | "G59" | "G59.1" | "G59.2" | "G59.3" => {
            let (place, angle) = value.split_once(':').unwrap_or((value, "0"));
            are_coordinates(place) && are_numbers(angle)
        }
        "VER" | "HLP" | "NEWOPT" | "SETTING" | "SETTINGGROUP" | "ERRORCODE" | "ALARMCODE" => true,
        "OPT" => value.split(',').count() == 3,
        // `[T:2|0.000,0.000,4.000|0.750]`.
        "T" => value.split('|').count() == 3,
        _ => false,
    }
}

fn is_report(report: &Report) -> bool {
    leadscrew::model::State::ALL
        .iter()
        .any(|known| known.name() == report.state)
        && report.fields.iter().all(|(name, value)| match &**name {
            "MPos" | "WPos" | "WCO" => are_coordinates(value),
            "Bf" | "FS" => value.split(',').count() == 2 && are_numbers(value),
            "Ov" => value.split(',').count() == 3 && are_numbers(value),
            "T" => are_numbers(value),
            "Pn" => value.bytes().all(|letter| b"PXYZABCDRHS".contains(&letter)),
            "A" => value.bytes().all(|letter| b"SCFM".contains(&letter)),
            _ => false,
        })
}

/// `$27=1.000`, `$N0=G21`.
fn is_assignment(line: &str) -> bool {
    let Some((name, value)) = line.strip_prefix('$').and_then(|line| line.split_once('=')) else {
        return false;
    };
    matches!(name, "N0" | "N1")
        || are_numbers(value) && Setting::all().any(|setting| setting.number().to_string() == name)
}

/// `T2 P2 X0 Y0 Z4 D1.5`.
fn is_tool(line: &str) -> bool {
    line.split(' ')
        .map(|word| word.chars().next())
        .eq("TPXYZD".chars().map(Some))
        && line.split(' ').all(|word| are_numbers(&word[1..]))
}

/// `X:45,Y:22,Z:0`, of the position stream.
fn is_position(line: &str) -> bool {
    line.split(',').zip("XYZ".chars()).all(|(word, letter)| {
        word.strip_prefix(letter)
            .and_then(|word| word.strip_prefix(':'))
            .is_some_and(are_numbers)
    })
}

fn are_coordinates(numbers: &str) -> bool {
    numbers.split(',').count() == AXES && are_numbers(numbers)
}

fn are_numbers(numbers: &str) -> bool {
    numbers
        .split(',')
        .all(|number| number.parse::<f64>().is_ok())
}

#[cfg(test)]
mod tests {
    use leadscrew::{protocol::STATEMENTS, settings::Settings, sim::Simulator};

    use super::*;

    #[test]
    fn a_message_of_the_program_has_been_sent() {
        let sent = b"G1 X1(MSG, hallo)G0 X2";
        assert!(is_of_program("[MSG:hallo]", sent));
        for line in ["[MSG:hello]", "[MSG:G1 X1]", "[MSG:]", "hallo"] {
            assert!(!is_of_program(line, sent), "{line}");
        }
    }

    #[test]
    fn the_answer_to_each_statement_is_known() {
        for statement in STATEMENTS {
            let mut machine = Box::new(Simulator::new(&Settings::default()));
            for byte in format!("${}\n", statement.example).bytes() {
                machine.receive(byte);
                machine.settle();
            }
            let mut answer = Vec::new();
            while let Some(byte) = machine.send() {
                answer.push(byte);
                machine.settle();
            }
            let answer = String::from_utf8(answer).expect("an answer is text");
            assert!(answer.contains('\n'), "${}: {answer}", statement.example);
            for line in answer.lines() {
                assert!(
                    is_known(line),
                    "{line}: the answer to ${}",
                    statement.example
                );
            }
        }
    }

    #[test]
    fn what_no_machine_sends_is_not_known() {
        let zeros = ["0.000"; AXES].join(",");
        let known = [
            "",
            "ok",
            "error:20",
            "ALARM:3",
            ">G21:ok",
            ">G99:error:20",
            "$27=1.500",
            "$N0=G21",
            "T2 P2 X0 Y0 Z4 D1.5",
            "X:45,Y:-22",
            "[MSG:Tool change: T2 hello]",
            "[MSG:Q is missing]",
            &format!("[PRB:{zeros}:1]"),
            &format!("[G55:{zeros}:30.00]"),
            &format!("<Hold:0|MPos:{zeros}|FS:0,0|Pn:PX|WCO:{zeros}>"),
        ];
        for line in known {
            assert!(is_known(line), "{line}");
        }
        let unknown = [
            "o",
            "okok",
            "error:99",
            "error:",
            "ALARM:12",
            ">G21:",
            "$1234=1",
            "$27=x",
            "X:45,Z:2",
            "[MSG:hello]",
            "[MSG:Pgm End",
            "[FOO:1]",
            &format!("[PRB:{zeros}:2]"),
            "[G55:0.000]",
            &format!("<Hold:7|MPos:{zeros}|FS:0,0>"),
            &format!("<Idle|MPos:{zeros}|FS:0>"),
            &format!("<Idle,MPos:{zeros}>"),
        ];
        for line in unknown {
            assert!(!is_known(line), "{line}");
            assert!(!is_known_to_hosts(line) || line.starts_with("X:"), "{line}");
        }
        for (line, is_known) in [
            ("start", true),
            ("ok T:0.0 /0.0", true),
            ("Resend: 7", true),
            ("y_min: open", true),
            ("[MSG:Pgm End]", true),
            ("error:20", false),
            ("Resend: x", false),
            ("y_min: shut", false),
            ("Grbl 1.1h ['$' for help]", false),
        ] {
            assert_eq!(is_known_to_hosts(line), is_known, "{line}");
        }
    }
}
