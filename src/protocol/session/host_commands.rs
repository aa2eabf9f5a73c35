//! What the RepRap dialect has and Grbl has no words for: answers to hosts, homing by `G28`, limits.

use super::{AfterCommands, LineStage, Links, Progress, Session, host::Restart};
use crate::{
    axis::{AXES, Axes, LETTERS, LINEAR},
    gcode::{
        LineError,
        reprap::{self, HostCommand},
    },
    machine::Snapshot,
    model::{Levels, Override, Requests, timing::IDLE_DELAY_INFINITE},
    path::Work,
    protocol::{listing, replies, report},
    settings::Settings,
};

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
}

impl Session {
    /// Does what Grbl has no words for.
    #[inline(never)]
    pub(super) fn execute_host_command(
        &mut self,
        command: HostCommand,
        links: &mut Links<'_, '_>,
    ) -> Progress {
        let machine = links.machine;
        let text = &mut self.reports.message;
        let settings = &self.persistence.stored.settings;
        match command {
            HostCommand::Nothing => {}
            HostCommand::Temperature => {
                replies::temperature(text);
                return self.begin_line();
            }
            HostCommand::Position { is_now } => self.write_position(machine, is_now),
            HostCommand::Firmware => return self.list_firmware(0),
            HostCommand::Settings => return self.list_host_settings(0),
            HostCommand::Echo => {
                let words = self.host.raw.words().trim_ascii();
                replies::echo(text, words.get(4..).unwrap_or_default());
            }
            HostCommand::Endstops => {
                replies::endstops(text, machine.inputs, settings.homing_direction);
            }
            HostCommand::Files => {
                text.word("Begin file list").end();
                text.word("End file list").end();
            }
            HostCommand::Resolution { is_set: true } => text_only(text, "echo:use $100"),
            HostCommand::Junction { is_set: true } => text_only(text, "echo:use $11"),
            HostCommand::Resolution { is_set: false } | HostCommand::Junction { is_set: false } => {
                replies::limits(text, command, settings);
            }
            HostCommand::Defaults => text_only(text, "echo:use $RST=$"),
            HostCommand::Standstill => {
                if !self.is_done(machine) || machine.state.is_suspended() {
                    return self.await_standstill();
                }
            }
            HostCommand::Home(mask) => return self.home_from_host(mask, links),
            HostCommand::Drivers(are_on) => return self.switch_drivers(are_on, links),
            HostCommand::DriversDelay(seconds) => return self.delay_drivers(seconds, links),
            HostCommand::Acceleration | HostCommand::Speed | HostCommand::CommonAcceleration => {
                return self.lower_limits(command, links);
            }
            HostCommand::FeedOverride(percent) => {
                override_feed(links.requests, percent, links.received.oldest());
                self.machine_sync.has_release_request = true;
            }
            HostCommand::Kill => {
                self.host.restart(Restart::Killing);
                self.stage = LineStage::Resetting;
                return Progress::Again;
            }
            HostCommand::Restart => {
                self.host.restart(Restart::Unlocking);
                return self.answer_and_reset();
            }
            HostCommand::NotPresent(code) if !self.host.is_first(code) => {}
            HostCommand::NotPresent(code) => replies::not_present(text, code),
            HostCommand::InvalidTool(tool) => replies::invalid_tool(text, tool),
            HostCommand::BusyInterval(seconds) => self.host.busy_interval_s = seconds,
            HostCommand::PositionInterval(seconds) => self.host.report_positions(seconds),
        }
        self.accept()
    }

    /// Switches the drivers at standstill.
    fn switch_drivers(&mut self, are_on: bool, links: &mut Links<'_, '_>) -> Progress {
        if !self.is_done(links.machine) {
            return self.await_standstill();
        }
        self.send_work(Work::Drivers(are_on), links);
        self.stage = LineStage::Completing(AfterCommands::Answer);
        Progress::Again
    }

    /// Sets the time of standstill after which the drivers go off, s; 0 for never.
    fn delay_drivers(&mut self, seconds: u16, links: &mut Links<'_, '_>) -> Progress {
        if !self.is_done(links.machine) {
            return self.await_standstill();
        }
        self.host.drivers_delay_s = Some(seconds);
        self.configure(links);
        self.stage = LineStage::Completing(AfterCommands::Answer);
        Progress::Again
    }

    /// Writes the answer to `M114`, without its `ok`.
    pub(super) fn write_position(&mut self, machine: &Snapshot, is_now: bool) {
        let position = if is_now {
            report::machine_position(machine, &self.persistence.stored.settings)
        } else {
            self.interpreter.position()
        };
        let offset = self.interpreter.work_offset(&position);
        let work = position.zip(offset, |position, offset| position - offset);
        let extruded = self.host.extruder.position;
        replies::position(&mut self.reports.message, &work, extruded, &machine.steps);
    }

    /// Writes the next line of the answer to `M115`, and its `ok` after the last.
    pub(super) fn list_firmware(&mut self, line: usize) -> Progress {
        let settings = &self.persistence.stored.settings;
        if !replies::firmware(&mut self.reports.message, line, settings) {
            return self.accept();
        }
        self.stage = LineStage::ListingFirmware(line + 1);
        Progress::Again
    }

    /// Writes the next line of the answer to `M503`, and its `ok` after the last.
    pub(super) fn list_host_settings(&mut self, line: usize) -> Progress {
        let text = &mut self.reports.message;
        text.word("echo:");
        if !listing::any_setting(text, &self.persistence.stored.settings, line) {
            text.clear();
            return self.accept();
        }
        self.stage = LineStage::ListingHostSettings(line + 1);
        Progress::Again
    }

    /// Homes the axes of a mask, 0 for all but the one that `E` drives.
    fn home_from_host(&mut self, mask: u8, links: &mut Links<'_, '_>) -> Progress {
        let settings = &self.persistence.stored.settings;
        if !settings.is_homing_on() {
            text_only(&mut self.reports.message, "echo:homing is off, $22");
            return self.accept();
        }
        if links.machine.inputs.has(Levels::DOOR) {
            return self.refuse(LineError::DoorOpen);
        }
        let mask = match mask {
            0 if settings.extruder_axis != 0 => (1 << LINEAR) - 1,
            mask => mask,
        };
        self.home(mask, links)
    }

    /// Ends homing by `G28`: the axes are at their travel from its negative end.
    pub(super) fn end_host_homing(&mut self) -> Progress {
        let Some(HostCommand::Home(mask)) = self.host.command else {
            return self.accept();
        };
        let settings = &self.persistence.stored.settings;
        let mask = if mask == 0 { (1 << LINEAR) - 1 } else { mask };
        let position = self.interpreter.position();
        let work = Axes::from_fn(|axis| {
            let [lowest, _] = settings.travel(axis).unwrap_or_default();
            position[axis] - lowest
        });
        self.interpreter.place(mask, &work);
        self.reports.cadence.offset_changed();
        self.accept()
    }

    /// `M201`, `M203`, `M204`: answers with the limits of the axes, or lowers them.
    fn lower_limits(&mut self, command: HostCommand, links: &mut Links<'_, '_>) -> Progress {
        let words = self.host.raw.words();
        let is_common = command == HostCommand::CommonAcceleration;
        let letters: &[u8] = if is_common { b"STP" } else { &LETTERS };
        let per_setting = if command == HostCommand::Speed {
            60.0
        } else {
            1.0
        };
        let mut limits = Axes::all(None);
        for (index, letter) in letters.iter().enumerate() {
            let limit = match reprap::value(words, *letter) {
                Ok(None) => continue,
                Ok(Some(limit)) if limit.to_f32() <= 0.0 => {
                    return self.refuse(LineError::NotPositive);
                }
                Ok(Some(limit)) => limit.to_f32() * per_setting,
                Err(error) => return self.refuse(error),
            };
            if !Settings::AXIS_LIMITS.contains(&limit) {
                return self.refuse(LineError::ValueOutOfRange);
            }
            for (axis, place) in limits.iter_mut().enumerate() {
                if is_common && axis < LINEAR || !is_common && axis == index {
                    *place = Some(limit);
                }
            }
        }
        if limits.iter().all(Option::is_none) {
            let settings = self.settings_in_effect();
            replies::limits(&mut self.reports.message, command, &settings);
            return self.accept();
        }
        if !self.is_done(links.machine) {
            return self.await_standstill();
        }
        let lowered = self.host.lowered.get_or_insert(LoweredLimits::NONE);
        for (axis, limit) in limits.iter().enumerate() {
            let Some(limit) = limit else { continue };
            match command {
                HostCommand::Speed => lowered.speed_mm_min[axis] = *limit,
                _ => lowered.acceleration_mm_s2[axis] = *limit,
            }
        }
        self.configure(links);
        self.stage = LineStage::Completing(AfterCommands::Answer);
        Progress::Again
    }

    /// Returns the settings with what a program has changed until a reset.
    pub(super) fn settings_in_effect(&self) -> Settings {
        let mut settings = self.persistence.stored.settings;
        if let Some(lowered) = &self.host.lowered {
            settings.max_rate_mm_min = settings.max_rate_mm_min.zip(lowered.speed_mm_min, f32::min);
            settings.acceleration_mm_s2 = settings
                .acceleration_mm_s2
                .zip(lowered.acceleration_mm_s2, f32::min);
        }
        if self.host.drivers_delay_s.is_some() {
            settings.idle_delay_ms = IDLE_DELAY_INFINITE;
        }
        settings
    }
}

/// Writes one line.
fn text_only(text: &mut crate::protocol::Text, line: &str) {
    text.word(line).end();
}

/// Makes the feed override a percentage, by the realtime commands for it. They fit their queue.
fn override_feed(requests: &Requests, percent: u8, received: usize) {
    let difference = percent.abs_diff(100);
    let (ten, one) = if percent < 100 {
        (Override::FeedLess, Override::FeedFineLess)
    } else {
        (Override::FeedMore, Override::FeedFineMore)
    };
    requests.accept_later(Override::FeedReset as u8, received);
    for _ in 0..difference / 10 {
        requests.accept_later(ten as u8, received);
    }
    for _ in 0..difference % 10 {
        requests.accept_later(one as u8, received);
    }
}
