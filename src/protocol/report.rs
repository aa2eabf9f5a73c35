//! Everything that is said to the sender, in Grbl 1.1's words.
//!
//! Pure: each function writes one message. Read with Grbl 1.1 `report.c` and its `interface.md`;
//! senders parse these texts with fixed patterns, so every byte counts.

use super::text::{ReportUnit, Text};
use crate::{
    axis::Axes,
    gcode::{LineError, Modal, WorkCoordinates},
    interpreter::Offsets,
    machine::{Alarm, Snapshot, State},
    planner::{Coolant, Plane, Spindle},
    settings::{self, Settings, Value},
    units::{Nm, Steps},
};

/// Status reports between two with the work offset, while the machine is busy and while it is not.
const OFFSET_EVERY: (u8, u8) = (30, 10);
/// Status reports between two with the overrides.
const OVERRIDES_EVERY: (u8, u8) = (20, 10);

/// What a status report shows besides the fields that each has.
#[derive(Debug, Clone, Copy, PartialEq, Eq)]
pub enum Extra {
    /// Nothing.
    None,
    /// `WCO:` the work offset.
    WorkOffset,
    /// `Ov:` the overrides, and `A:` spindle and coolant.
    Overrides,
}

/// Which of the fields that change rarely is due in the next status report.
///
/// Never two in one report. The default is the state after a reset: the work offset is due, then
/// the overrides.
#[derive(Debug, Clone, Copy, Default, PartialEq, Eq)]
pub struct Cadence {
    /// Reports to come before the one with the work offset.
    until_offset: u8,
    /// Reports to come before the one with the overrides.
    until_overrides: u8,
}

impl Cadence {
    /// The work offset has changed: the next report shows it.
    pub fn offset_changed(&mut self) {
        self.until_offset = 0;
    }

    /// Spindle, coolant or an override has changed: the next report shows it.
    pub fn overrides_changed(&mut self) {
        self.until_overrides = 0;
    }

    /// What the next report shows; counts it.
    pub fn next(&mut self, state: State) -> Extra {
        let every = |(busy, idle): (u8, u8)| match state {
            State::Run
            | State::HoldSlowing
            | State::HoldComplete
            | State::Jog
            | State::Home
            | State::DoorClosed
            | State::DoorAjar
            | State::DoorRetracting
            | State::DoorRestoring => busy - 1,
            State::Idle | State::Alarm | State::Check | State::Sleep => idle - 1,
        };
        if self.until_offset == 0 {
            self.until_offset = every(OFFSET_EVERY);
            self.until_overrides = self.until_overrides.saturating_sub(1);
            return Extra::WorkOffset;
        }
        self.until_offset -= 1;
        if self.until_overrides == 0 {
            self.until_overrides = every(OVERRIDES_EVERY);
            return Extra::Overrides;
        }
        self.until_overrides -= 1;
        Extra::None
    }
}

/// What a status report is made from.
#[derive(Debug)]
pub struct Status<'a> {
    /// The machine.
    pub machine: &'a Snapshot,
    /// The settings.
    pub settings: &'a Settings,
    /// Spindle and coolant as programmed.
    pub modal: &'a Modal,
    /// Work position 0 in machine coordinates.
    pub work_offset: Axes<Nm>,
    /// Free bytes for received lines.
    pub received_free: usize,
    /// The field besides those that each report has.
    pub extra: Extra,
}

/// `<Idle|MPos:0.000,0.000,0.000|FS:0,0>`.
pub fn status(text: &mut Text, status: &Status<'_>) {
    let Status {
        machine, settings, ..
    } = status;
    let unit = ReportUnit::of(settings);
    let machine_position = machine_position(machine, settings);
    text.word("<").word(machine.state.name());
    if settings.report_mask & 1 != 0 {
        text.word("|MPos:").coordinates(&machine_position, unit);
    } else {
        let work_position = machine_position.zip(status.work_offset, |m, offset| m - offset);
        text.word("|WPos:").coordinates(&work_position, unit);
    }
    if settings.report_mask & 2 != 0 {
        text.word("|Bf:").natural(u32::from(machine.blocks_free));
        text.word(",").natural(status.received_free as u32);
    }
    text.word("|FS:").rate(machine.feed_mm_min, unit);
    text.word(",").number(machine.spindle_rpm, 0);
    match status.extra {
        Extra::None => {}
        Extra::WorkOffset => {
            text.word("|WCO:").coordinates(&status.work_offset, unit);
        }
        Extra::Overrides => {
            text.word("|Ov:100,100,100");
            accessories(text, status.modal.spindle, status.modal.coolant);
        }
    }
    text.word(">").end();
}

/// The position of each axis from its step counter.
#[must_use]
pub fn machine_position(machine: &Snapshot, settings: &Settings) -> Axes<Nm> {
    settings
        .steps_per_mm
        .zip(machine.steps, |resolution, steps| {
            resolution.position_of(Steps(steps))
        })
}

/// `|A:SF`, nothing when all is off.
fn accessories(text: &mut Text, spindle: Spindle, coolant: Coolant) {
    if spindle == Spindle::Off && coolant == Coolant::default() {
        return;
    }
    text.word("|A:");
    match spindle {
        Spindle::Off => {}
        Spindle::Clockwise => {
            text.byte(b'S');
        }
        Spindle::CounterClockwise => {
            text.byte(b'C');
        }
    }
    if coolant.flood {
        text.byte(b'F');
    }
    if coolant.mist {
        text.byte(b'M');
    }
}

/// The first line after power-up and after each reset, with an empty line before it.
pub fn welcome(text: &mut Text) {
    text.end().word("Grbl 1.1h ['$' for help]").end();
}

/// `ok`.
pub fn ok(text: &mut Text) {
    text.word("ok").end();
}

/// `error:N`.
pub fn error(text: &mut Text, error: LineError) {
    text.word("error:").natural(u32::from(error.number())).end();
}

/// `ALARM:N`.
pub fn alarm(text: &mut Text, alarm: Alarm) {
    text.word("ALARM:").natural(u32::from(alarm.number())).end();
}

/// What is told without having been asked for.
#[derive(Debug, Clone, Copy, PartialEq, Eq)]
pub enum Feedback {
    /// The machine is locked.
    Locked,
    /// The lock has been taken off.
    Unlocked,
    /// `M2` or `M30`.
    ProgramEnd,
    /// Nothing but a reset helps.
    ResetNeeded,
}

/// `[MSG:…]`.
pub fn feedback(text: &mut Text, feedback: Feedback) {
    let words = match feedback {
        Feedback::Locked => "'$H'|'$X' to unlock",
        Feedback::Unlocked => "Caution: Unlocked",
        Feedback::ProgramEnd => "Pgm End",
        Feedback::ResetNeeded => "Reset to continue",
    };
    text.word("[MSG:").word(words).word("]").end();
}

/// The answer to `$`, without its `ok`.
pub fn help(text: &mut Text) {
    text.word("[HLP:$$ $# $G $I $N $x=val $Nx=line $J=line $SLP $C $X $H ~ ! ? ctrl-x]")
        .end();
}

/// The answer to `$I`, without its `ok`: places for blocks, bytes for received lines.
pub fn build_info(text: &mut Text, blocks: usize, received: usize) {
    text.word("[VER:1.1h.20190830:]").end();
    text.word("[OPT:V,").natural(blocks as u32);
    text.word(",").natural(received as u32).word("]").end();
}

/// The answer to `$N`, without its `ok`: no start-up lines are stored.
pub fn startup_lines(text: &mut Text) {
    text.word("$N0=").end().word("$N1=").end();
}

/// The answer to `$G`, without its `ok`.
pub fn modes(text: &mut Text, modal: &Modal, unit: ReportUnit) {
    text.word("[GC:").word(modal.motion.word());
    text.word(" ").word(modal.coordinates.word());
    text.word(match modal.plane {
        Plane::Xy => " G17 ",
        Plane::Zx => " G18 ",
        Plane::Yz => " G19 ",
    });
    text.word(modal.units.word());
    text.word(" ").word(modal.distance.word());
    text.word(" ").word(modal.feed_mode.word());
    text.word(match modal.spindle {
        Spindle::Clockwise => " M3",
        Spindle::CounterClockwise => " M4",
        Spindle::Off => " M5",
    });
    text.word(match (modal.coolant.mist, modal.coolant.flood) {
        (false, false) => " M9",
        (true, false) => " M7",
        (false, true) => " M8",
        (true, true) => " M7 M8",
    });
    text.word(" T").natural(u32::from(modal.tool));
    text.word(" F").rate(modal.feed, unit);
    text.word(" S").number(modal.speed_rpm, 0).word("]").end();
}

/// One line of the answer to `$#`, counted from 0; false after the last, when nothing is written.
pub fn parameters(text: &mut Text, offsets: &Offsets, line: usize, unit: ReportUnit) -> bool {
    let systems = WorkCoordinates::ALL.len();
    let (name, values) = match (line, line.checked_sub(systems)) {
        (_, None) => match (
            WorkCoordinates::ALL.get(line),
            offsets.coordinates.get(line),
        ) {
            (Some(system), Some(values)) => (system.word(), *values),
            _ => return false,
        },
        (_, Some(0)) => ("G28", offsets.g28),
        (_, Some(1)) => ("G30", offsets.g30),
        (_, Some(2)) => ("G92", offsets.work),
        (_, Some(3)) => {
            text.word("[TLO:").coordinate(offsets.tool_length, unit);
            text.word("]").end();
            return true;
        }
        (_, Some(4)) => {
            text.word("[PRB:").coordinates(&Axes::default(), unit);
            text.word(":0]").end();
            return true;
        }
        _ => return false,
    };
    text.word("[").word(name).word(":");
    text.coordinates(&values, unit).word("]").end();
    true
}

/// One line of the answer to `$$`, counted from 0; false after the last, when nothing is written.
pub fn setting(text: &mut Text, settings: &Settings, line: usize) -> bool {
    let Some((number, value)) = settings::listed(settings, line) else {
        return false;
    };
    text.word("$").natural(u32::from(number)).word("=");
    match value {
        Value::Whole(whole) => text.natural(u32::from(whole)),
        Value::Number(number, decimals) => text.number(number, decimals),
        Value::Resolution(resolution) => text.millionths(resolution.millionths()),
    };
    text.end();
    true
}
