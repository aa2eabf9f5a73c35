//! What the RepRap dialect has and Grbl has no words for: answers to hosts, homing by `G28`, limits.

use super::{RepRap, RestartKind, replies};
use crate::{
    axis::{AXES, Axes, LETTERS, LINEAR},
    gcode::{
        LineError,
        reprap::{self, HostCommand},
    },
    model::{Levels, Override},
    protocol::{
        ByteReader, Text,
        dialect::{NextStep, SenderDialect, SessionContext},
        listing, report,
    },
    settings::Settings,
};

/// The answer is `ok`, behind what has been written.
const OK: NextStep = NextStep::Answer(Ok(()));

/// Limits that a program has lowered, up to the next reset.
#[derive(Debug, Clone, Copy)]
pub(super) struct LoweredLimits {
    speed_mm_min: Axes<f32>,
    acceleration_mm_s2: Axes<f32>,
}

impl LoweredLimits {
    const NONE: Self = Self {
        speed_mm_min: Axes([f32::MAX; AXES]),
        acceleration_mm_s2: Axes([f32::MAX; AXES]),
    };

    /// Lowers the limits of settings.
    pub(super) fn apply(&self, settings: &mut Settings) {
        settings.max_rate_mm_min = settings.max_rate_mm_min.zip(self.speed_mm_min, f32::min);
        settings.acceleration_mm_s2 =
            (settings.acceleration_mm_s2).zip(self.acceleration_mm_s2, f32::min);
    }
}

impl RepRap {
    /// Does what Grbl has no words for, if the line asks for it.
    #[inline(never)]
    pub(super) fn execute(
        &mut self,
        session: &mut SessionContext<'_>,
        received: &ByteReader<'_>,
    ) -> NextStep {
        let Some(command) = self.command else {
            return NextStep::Execute;
        };
        let text = &mut session.reports.message;
        let settings = session.settings;
        let machine = session.machine;
        match command {
            HostCommand::Temperature => {
                replies::temperature(text);
                return NextStep::Skip;
            }
            HostCommand::Position { is_now } => self.write_position(session, is_now),
            HostCommand::Firmware | HostCommand::Settings => return self.list(0, session),
            HostCommand::Echo => {
                let words = session.lines.raw.words().trim_ascii();
                replies::echo(text, words.get(4..).unwrap_or_default());
            }
            HostCommand::Endstops => {
                replies::endstops(text, machine.inputs, settings.homing_direction);
            }
            HostCommand::Files => {
                text.word("Begin file list").end();
                text.word("End file list").end();
            }
            HostCommand::Resolution { is_set: true } => write_line(text, "echo:use $100"),
            HostCommand::Junction { is_set: true } => write_line(text, "echo:use $11"),
            HostCommand::Resolution { is_set: false } | HostCommand::Junction { is_set: false } => {
                replies::limits(text, command, settings);
            }
            HostCommand::Defaults => write_line(text, "echo:use $RST=$"),
            HostCommand::Standstill if !session.is_done || machine.state.is_suspended() => {
                return NextStep::AwaitStandstill;
            }
            HostCommand::Nothing | HostCommand::Standstill => {}
            HostCommand::Home(mask) => return self.home(mask, session),
            HostCommand::Drivers(_) | HostCommand::DriversDelay(_) if !session.is_done => {
                return NextStep::AwaitStandstill;
            }
            HostCommand::Drivers(are_on) => return NextStep::Drivers(are_on),
            HostCommand::DriversDelay(seconds) => {
                self.drivers_delay_s = Some(seconds);
                return NextStep::Configure;
            }
            HostCommand::Acceleration | HostCommand::Speed | HostCommand::CommonAcceleration => {
                return (self.lower_limits(command, session))
                    .unwrap_or_else(|error| NextStep::Answer(Err(error)));
            }
            HostCommand::FeedOverride(percent) => {
                override_feed(session, percent, received.oldest());
            }
            HostCommand::Kill => return self.reset_by_line(RestartKind::Killing),
            HostCommand::Restart => return self.reset_by_line(RestartKind::Unlocking),
            HostCommand::NotPresent(code) if !self.is_first(code) => {}
            HostCommand::NotPresent(code) => replies::not_present(text, code),
            HostCommand::InvalidTool(tool) => replies::invalid_tool(text, tool),
            HostCommand::BusyInterval(seconds) => self.busy_interval_s = seconds,
            HostCommand::PositionInterval(seconds) => self.report_positions(seconds),
        }
        OK
    }

    /// Begins the reset that a line asks for.
    fn reset_by_line(&mut self, kind: RestartKind) -> NextStep {
        self.begin_restart(kind);
        NextStep::Reset {
            is_answered: kind == RestartKind::Unlocking,
        }
    }

    /// Sets the time between two reports of the position, s; 0 for none.
    fn report_positions(&mut self, interval_s: u8) {
        self.position_interval_s = interval_s;
        self.timers.position_ms = 0;
    }

    /// Writes the answer to `M114`, without its `ok`.
    pub(super) fn write_position(&self, session: &mut SessionContext<'_>, is_now: bool) {
        let position = if is_now {
            report::machine_position(session.machine, session.settings)
        } else {
            session.interpreter.position()
        };
        let offset = session.interpreter.work_offset(&position);
        let work = position.zip(offset, |position, offset| position - offset);
        let extruded = self.extruder.position;
        let steps = &session.machine.steps;
        replies::position(&mut session.reports.message, &work, extruded, steps);
    }

    /// Writes the next line of the answer to `M115` or `M503`, and its `ok` after the last.
    pub(super) fn list(&self, line: usize, session: &mut SessionContext<'_>) -> NextStep {
        let text = &mut session.reports.message;
        let has_line = if self.command == Some(HostCommand::Firmware) {
            replies::firmware(text, line, session.settings)
        } else {
            text.word("echo:");
            listing::any_setting(text, session.settings, line)
        };
        if has_line {
            NextStep::List(line + 1)
        } else {
            text.clear();
            OK
        }
    }

    /// Homes the axes of a mask, 0 for all but the one that `E` drives.
    fn home(&mut self, mask: u8, session: &mut SessionContext<'_>) -> NextStep {
        let settings = session.settings;
        if !settings.is_homing_on() {
            write_line(&mut session.reports.message, "echo:homing is off, $22");
            return OK;
        }
        if session.machine.inputs.has(Levels::DOOR) {
            return NextStep::Answer(Err(LineError::DoorOpen));
        }
        self.homes = Some(mask);
        NextStep::Home(match mask {
            0 if settings.extruder_axis != 0 => (1 << LINEAR) - 1,
            mask => mask,
        })
    }

    /// `M201`, `M203`, `M204`: answers with the limits of the axes, or lowers them.
    fn lower_limits(
        &mut self,
        command: HostCommand,
        session: &mut SessionContext<'_>,
    ) -> Result<NextStep, LineError> {
        let words = session.lines.raw.words();
        let is_common = command == HostCommand::CommonAcceleration;
        let letters: &[u8] = if is_common { b"STP" } else { &LETTERS };
        let per_setting = if command == HostCommand::Speed {
            60.0
        } else {
            1.0
        };
        let mut limits = Axes::all(None);
        for (index, letter) in letters.iter().enumerate() {
            let Some(limit) = reprap::value(words, *letter)? else {
                continue;
            };
            if limit.to_f32() <= 0.0 {
                return Err(LineError::NotPositive);
            }
            let limit = limit.to_f32() * per_setting;
            if !Settings::AXIS_LIMITS.contains(&limit) {
                return Err(LineError::ValueOutOfRange);
            }
            for (axis, place) in limits.iter_mut().enumerate() {
                if is_common && axis < LINEAR || !is_common && axis == index {
                    *place = Some(limit);
                }
            }
        }
        if limits.iter().all(Option::is_none) {
            let settings = self.settings_in_effect(session.settings);
            replies::limits(&mut session.reports.message, command, &settings);
            return Ok(OK);
        }
        if !session.is_done {
            return Ok(NextStep::AwaitStandstill);
        }
        let lowered = self.lowered.get_or_insert(LoweredLimits::NONE);
        for (axis, limit) in limits.iter().enumerate() {
            let Some(limit) = limit else { continue };
            match command {
                HostCommand::Speed => lowered.speed_mm_min[axis] = *limit,
                _ => lowered.acceleration_mm_s2[axis] = *limit,
            }
        }
        Ok(NextStep::Configure)
    }
}

/// Writes one line.
fn write_line(text: &mut Text, line: &str) {
    text.word(line).end();
}

/// Makes the feed override a percentage, by the realtime commands for it. They fit their queue.
fn override_feed(session: &mut SessionContext<'_>, percent: u8, received: usize) {
    let requests = session.requests;
    *session.has_release_request = true;
    let difference = percent.abs_diff(100);
    let (ten, one) = if percent < 100 {
        (Override::FeedLess, Override::FeedFineLess)
    } else {
        (Override::FeedMore, Override::FeedFineMore)
    };
    requests.accept_from_interpret(Override::FeedReset as u8, received);
    for _ in 0..difference / 10 {
        requests.accept_from_interpret(ten as u8, received);
    }
    for _ in 0..difference % 10 {
        requests.accept_from_interpret(one as u8, received);
    }
}
