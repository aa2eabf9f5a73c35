//! Answers in the words of Marlin, which hosts of 3D printers parse.
//!
//! Pure, as `report` is. Read with Marlin 2.1 `language.h`, and with the texts that Printrun 2.2 and OctoPrint 1.11
//! look for in an answer: a line with `Error:` at its beginning ends a job, unless it has certain words.

use crate::protocol::{
    checked::{FailedCheck, next_number},
    listing,
    text::{ReportUnit, Text},
};
use crate::{
    axis::{AXES, Axes, LETTERS},
    gcode::{LineError, reprap::HostCommand},
    model::{Alarm, Levels},
    settings::{Changes, Settings, ToolTable},
    units::{Nm, StepsPerMm},
};

/// How a refusal by a machine begins that has stopped.
const STOPPED: &str = "Error:Printer stopped due to errors. ";

/// Bytes of a line that are shown as the sender has typed them.
const SHOWN_BYTES: usize = 64;

/// Beginnings of what hosts take for an answer, a fault or a reset.
const PARSED: [&[u8]; 7] = [b"ok", b"error", b"resend", b"rs", b"start", b"wait", b"!!"];

/// Bytes of a text of `M118` that are sent.
const MAX_ECHO_BYTES: usize = 128;

/// Asks for the line after the last accepted one, without the `ok`.
pub fn resend(text: &mut Text, failed: FailedCheck, last: i32) {
    text.word("Error:").word(match failed {
        FailedCheck::Checksum => "checksum mismatch",
        FailedCheck::MissingChecksum => "No Checksum with line number",
        FailedCheck::MissingNumber => "checksum without line number",
        FailedCheck::Number => "Line Number is not Last Line Number+1",
    });
    text.word(", Last Line: ");
    text.integer(last).end();
    text.word("Resend: ");
    text.integer(next_number(last)).end();
}

/// The reason why a line has been refused, without the `ok`. `line` is what the sender has typed, without
/// number and checksum.
pub fn refusal(
    text: &mut Text,
    error: LineError,
    line: &[u8],
    alarm: Option<Alarm>,
    is_homing: bool,
) {
    match error {
        _ if line.trim_ascii_start().starts_with(b"$") => {
            text.word("echo:error ").natural(u32::from(error.number()));
            text.word(": ").plain(error.text()).end();
        }
        LineError::Unsupported => unknown(text, line),
        LineError::Locked => match alarm {
            Some(alarm) => stopped(text, alarm),
            None => {
                text.word(STOPPED).word(unlocking(is_homing)).end();
            }
        },
        _ => {
            text.word("Error:").plain(error.text());
            text.word(" (error:").natural(u32::from(error.number()));
            text.word(")").end();
        }
    }
}

/// `echo:Unknown command: "G99"`.
pub fn unknown(text: &mut Text, line: &[u8]) {
    let line = line.trim_ascii();
    text.word("echo:Unknown command: \"");
    for byte in line.iter().take(SHOWN_BYTES) {
        let is_shown = matches!(byte, b' '..=b'~');
        text.byte(if is_shown { *byte } else { b'?' });
    }
    text.word("\"").end();
}

/// The machine is locked, for this reason.
pub fn stopped(text: &mut Text, alarm: Alarm) {
    if alarm == Alarm::Killed {
        text.word("Error:Printer halted. kill() called!").end();
        return;
    }
    text.word(STOPPED).plain(alarm.text()).word(" (ALARM:");
    text.natural(u32::from(alarm.number()))
        .word("); M999 to go on")
        .end();
}

/// The machine sleeps, after `$SLP`.
pub fn asleep(text: &mut Text) {
    text.word(STOPPED).word("It sleeps; M999 to go on").end();
}

/// The first lines after power-up and after each reset.
pub fn welcome(text: &mut Text, is_homing: bool) {
    text.word("start").end();
    text.word("echo:Leadscrew ")
        .word(VERSION)
        .word(" (RepRap); homing ");
    text.word(if is_homing { "on" } else { "off" }).end();
}

/// Follows them where the machine is locked: `echo:G28 homes the machine; M999 to go on`.
pub fn locked(text: &mut Text, is_homing: bool) {
    text.word("echo:").word(unlocking(is_homing)).end();
}

/// `echo:Damaged in storage: settings, T3`, at the start.
pub fn damage(text: &mut Text, damaged: Changes, tools: &ToolTable) {
    text.word("echo:");
    listing::damaged_records(text, damaged, tools);
    text.end();
}

/// `ok T:0.0 /0.0`: there is no heater.
pub fn temperature(text: &mut Text) {
    text.word("ok T:0.0 /0.0").end();
}

/// `X:1.000 Y:2.000 Z:3.000 E:0.000 Count X:250 Y:500 Z:750`, in mm.
pub fn position(text: &mut Text, position: &Axes<Nm>, extruded: Nm, steps: &Axes<i32>) {
    for (letter, value) in ["X:", " Y:", " Z:"].into_iter().zip(position) {
        text.word(letter).coordinate(*value, ReportUnit::Millimetre);
    }
    text.word(" E:")
        .coordinate(extruded, ReportUnit::Millimetre)
        .word(" Count");
    for (letter, value) in [" X:", " Y:", " Z:"].into_iter().zip(steps) {
        text.word(letter).integer(*value);
    }
    text.end();
}

/// The text of `M118`: behind `echo:` where it begins with `E1`, or as hosts parse an answer; behind `//` where
/// it begins with `A1`.
pub fn echo(text: &mut Text, words: &[u8]) {
    let mut words = words.trim_ascii_start();
    let mut start = "";
    loop {
        (start, words) = match words {
            [b'E' | b'e', b'1', b' ', tail @ ..] => ("echo:", tail.trim_ascii_start()),
            [b'A' | b'a', b'1', b' ', tail @ ..] => ("//", tail.trim_ascii_start()),
            _ => break,
        };
    }
    let is_parsed = |begin: &&[u8]| {
        let start = words.get(..begin.len());
        start.is_some_and(|start| start.eq_ignore_ascii_case(begin))
    };
    if start.is_empty() && PARSED.iter().any(is_parsed) {
        start = "echo:";
    }
    text.word(start)
        .bytes(words.get(..MAX_ECHO_BYTES).unwrap_or(words))
        .end();
}

/// `echo:U: no such axis`.
pub fn no_axis(text: &mut Text, letter: u8) {
    text.word("echo:").byte(letter).word(": no such axis").end();
}

/// The answer to `M119`, without its `ok`: the switches at the ends to which the axes home.
pub fn endstops(text: &mut Text, inputs: Levels, homing_direction: u8) {
    text.word("Reporting endstop status").end();
    for (axis, letter) in LETTERS.iter().enumerate().take(AXES) {
        let is_negative = homing_direction >> axis & 1 != 0;
        text.byte(letter.to_ascii_lowercase());
        text.word(if is_negative { "_min: " } else { "_max: " });
        let is_closed = inputs.has(Levels(1 << axis));
        text.word(if is_closed { "TRIGGERED" } else { "open" })
            .end();
    }
}

/// `echo:M201 X500.000 Y500.000 Z500.000`: what a command sets for each axis; of `M205` the junction
/// deviation.
pub fn limits(text: &mut Text, command: HostCommand, settings: &Settings) {
    let (code, limits) = match command {
        HostCommand::Junction { .. } => {
            text.word("echo:M205 J")
                .number(settings.junction_deviation_mm, 3);
            text.end();
            return;
        }
        HostCommand::Resolution { .. } => ("M92", settings.steps_per_mm.map(StepsPerMm::to_f32)),
        HostCommand::Speed => ("M203", settings.max_rate_mm_min.map(|rate| rate / 60.0)),
        HostCommand::CommonAcceleration => ("M204", settings.acceleration_mm_s2),
        _ => ("M201", settings.acceleration_mm_s2),
    };
    text.word("echo:").word(code);
    for (letter, limit) in LETTERS.iter().zip(&limits) {
        text.byte(b' ').byte(*letter).number(*limit, 3);
    }
    text.end();
}

/// `echo:M109: not present`.
pub fn not_present(text: &mut Text, code: u16) {
    text.word("echo:M").natural(u32::from(code));
    text.word(": not present").end();
}

/// `echo:T1 Invalid extruder`.
pub fn invalid_tool(text: &mut Text, tool: u16) {
    text.word("echo:T").natural(u32::from(tool));
    text.word(" Invalid extruder").end();
}

/// One line of the answer to `M115`, counted from 0. Returns false after the last.
pub fn firmware(text: &mut Text, number: usize, settings: &Settings) -> bool {
    const CAPABILITIES: [&str; 9] = [
        "EMERGENCY_PARSER:1",
        "BUSY_PROTOCOL:1",
        "AUTOREPORT_POS:1",
        "AUTOREPORT_TEMP:0",
        "ARCS:1",
        "PAREN_COMMENTS:1",
        "QUOTED_STRINGS:1",
        "EEPROM:1",
        "SDCARD:0",
    ];
    if number == 0 {
        text.word("FIRMWARE_NAME:Leadscrew ").word(VERSION);
        if !SOURCE_CODE_URL.is_empty() {
            text.word(" SOURCE_CODE_URL:").word(SOURCE_CODE_URL);
        }
        text.word(" PROTOCOL_VERSION:1.0 MACHINE_TYPE:").word(BOARD);
        text.word(" EXTRUDER_COUNT:")
            .word(if settings.extruder_axis == 0 {
                "0"
            } else {
                "1"
            });
        text.end();
        return true;
    }
    let capability = CAPABILITIES.get(number - 1);
    if let Some(capability) = capability {
        text.word("Cap:").word(capability).end();
    }
    capability.is_some()
}

/// What ends the lock of a machine that is not homed.
const fn unlocking(is_homing: bool) -> &'static str {
    if is_homing {
        "G28 homes the machine; M999 to go on"
    } else {
        "M999 to go on"
    }
}

/// The version of the firmware, and the address of its sources: none where the package has none.
const VERSION: &str = env!("CARGO_PKG_VERSION");
const SOURCE_CODE_URL: &str = env!("CARGO_PKG_REPOSITORY");
/// The maker's name of the board, or its substitute on the host, from `build.rs`.
const BOARD: &str = env!("LEADSCREW_BOARD_TITLE");
