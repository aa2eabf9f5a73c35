//! The answers to `$` statements, line by line.
//!
//! Pure, as `report` is: each function writes one line of an answer, which fits one message. `$E…` are in the format that grblHAL publishes ("report extensions").

use super::{
    dollar::{Described, List},
    report::probed,
    text::{ReportUnit, Text},
};
use crate::{
    axis::{AXES, Axes, Z},
    gcode::{ArcDistance, LineError, Modal, RetractMode, interpreter::Offsets},
    model::{Alarm, Plane, Probed, ResetCause, Spindle, WorkCoordinates},
    motion::BLOCKS,
    settings::{
        Change, Changes, Setting, SettingGroup, Settings, StepRate, Stored, StoredLine, TOOLS,
        ToolEntry, ToolTable, Value,
    },
    units::{MicroDegrees, Nm},
};

/// What should never happen, counted since power-up, wrapping; and what should not last.
#[derive(Debug, Clone, Copy, Default, PartialEq, Eq)]
pub struct FaultCounts {
    /// Step events that may have come too late.
    pub late_events: u32,
    /// Received bytes that found no room, were not taken in time, or were damaged.
    pub lost_bytes: u32,
    /// Changes that are in effect, and wait to be stored.
    pub waiting_changes: u32,
}

/// What lists show.
#[derive(Debug)]
pub struct ListContents<'a> {
    /// What outlives power, but for the tools.
    pub stored: &'a Stored,
    /// The offsets in effect.
    pub offsets: &'a Offsets,
    /// The tool table.
    pub tools: &'a ToolTable,
    /// The last probing move.
    pub probed: &'a Probed,
    /// What has been counted since power-up.
    pub faults: FaultCounts,
    /// What is damaged where it is stored.
    pub damaged: Changes,
    /// Why the firmware has begun to run.
    pub reset_cause: ResetCause,
    /// Capacity for received bytes.
    pub received_bytes: usize,
}

impl ListContents<'_> {
    /// Writes one line of a list, counted from 0. Returns false after the last.
    pub fn write(&self, text: &mut Text, list: List, line: usize) -> bool {
        let settings = &self.stored.settings;
        match list {
            List::Settings => setting(text, settings, line),
            List::AllSettings => any_setting(text, settings, line),
            List::Parameters => {
                parameter(text, self.offsets, self.tools, self.probed, line, settings)
            }
            List::Tools => tool(text, self.tools, line),
            List::BuildInfo => self.build_info(text, false, line),
            List::ExtendedBuildInfo => self.build_info(text, true, line),
            List::StartupLines => startup_line(text, &self.stored.startup, line),
            List::Described(what) => description(text, what, line),
        }
    }

    fn build_info(&self, text: &mut Text, is_extended: bool, line: usize) -> bool {
        // Three lines come first in any case.
        let mut shown = 3;
        let mut is_next = |is_shown| {
            shown += usize::from(is_shown);
            is_shown && shown == line + 1
        };
        let has_faults = self.faults != FaultCounts::default();
        match line {
            0 => version(text, &self.stored.build_info),
            1 => options(text, BLOCKS, self.received_bytes),
            2 => step_rate(text, self.stored.settings.step_rate),
            _ if is_next(is_extended) => new_options(text),
            _ if is_next(is_extended || self.reset_cause.alarm().is_some()) => {
                reset_cause(text, self.reset_cause);
            }
            _ if is_next(is_extended || has_faults) => faults(text, self.faults),
            _ if is_next(!self.damaged.is_empty()) => damage(text, self.damaged, self.tools),
            _ => return false,
        }
        true
    }
}

/// Damaged tools that are named: there is room for no more in a message.
const MOST_TOOLS_NAMED: u32 = 3;

/// The answer to `$`, without its `ok`.
pub fn help(text: &mut Text) {
    text.word("[HLP:$$ $# $G $I $N $x=val $Nx=line $J=line $SLP $C $X $H ~ ! ? ctrl-x]")
        .end();
}

/// The first line of the answer to `$I`, with the text that the user has stored.
fn version(text: &mut Text, info: &[u8]) {
    text.word("[VER:1.1h.20190830:").bytes(info).word("]").end();
}

/// The second line of the answer to `$I`: capacity for blocks, and for received bytes.
fn options(text: &mut Text, blocks: usize, received: usize) {
    // Variable spindle, mist, parking, homing of single axes, an input for the door.
    text.word("[OPT:VMPH+,").natural(blocks as u32);
    text.word(",").natural(received as u32).word("]").end();
}

/// The third line of the answer to `$I`: the step rate that no settings may exceed.
fn step_rate(text: &mut Text, rate: StepRate) {
    text.word("[MSG:Step rate: ").natural(rate.hz());
    text.word(match rate {
        StepRate::Proven(_) => " Hz, proven]",
        StepRate::Unproven => " Hz, unproven]",
    });
    text.end();
}

/// The line of the answer to `$I+` that names what is built in beyond Grbl, in grblHAL's words.
fn new_options(text: &mut Text) {
    // Tool changes by `M6`, with the state `Tool`.
    text.word("[NEWOPT:TC]").end();
}

/// The line of the answer to `$I+` that tells why the firmware has begun to run; in the answer to `$I` after
/// a fault.
fn reset_cause(text: &mut Text, cause: ResetCause) {
    text.word("[MSG:Last reset: ").word(cause.text());
    text.word("]").end();
}

/// The line of the answer to `$I+` with the numbers of missed deadlines, of lost bytes, and of changes that wait to be
/// stored; in the answer to `$I` if any is not 0.
fn faults(text: &mut Text, faults: FaultCounts) {
    let counts = [
        ("[MSG:Late events: ", faults.late_events),
        (", lost bytes: ", faults.lost_bytes),
        (", not stored yet: ", faults.waiting_changes),
    ];
    // What waits is no fault, and is told where there is any.
    let shown = if faults.waiting_changes == 0 { 2 } else { 3 };
    for (name, count) in counts.into_iter().take(shown) {
        text.word(name).natural(count);
    }
    text.word("]").end();
}

/// `[MSG:Damaged in storage: settings, $N0, T3]`: at the start, and the line of the answer to `$I` while it is so.
pub fn damage(text: &mut Text, damaged: Changes, tools: &ToolTable) {
    text.word("[MSG:");
    damaged_records(text, damaged, tools);
    text.word("]").end();
}

/// `Damaged in storage: settings, $N0, T3`. A tool of which no record is left has no number, and more than three are
/// `tools`.
pub fn damaged_records(text: &mut Text, damaged: Changes, tools: &ToolTable) {
    const NAMES: [(Change, &str); 5] = [
        (Change::Settings, "settings"),
        (Change::Origins, "offsets"),
        (Change::Startup(0), "$N0"),
        (Change::Startup(1), "$N1"),
        (Change::BuildInfo, "build info"),
    ];
    let mut separator = "Damaged in storage: ";
    for (change, name) in NAMES {
        if damaged.contains(change) {
            text.word(core::mem::replace(&mut separator, ", "))
                .word(name);
        }
    }
    if damaged.tools() > MOST_TOOLS_NAMED {
        text.word(separator).word("tools");
        return;
    }
    for slot in 0..TOOLS {
        if !damaged.contains(Change::Tool(slot)) {
            continue;
        }
        text.word(core::mem::replace(&mut separator, ", "));
        match tools.slot(slot) {
            Some(tool) => text.word("T").natural(u32::from(tool.number.get())),
            None => text.word("a tool"),
        };
    }
}

/// One line of the answer to `$N`, counted from 0. Returns false after the last.
fn startup_line(text: &mut Text, lines: &[StoredLine], number: usize) -> bool {
    let Some(line) = lines.get(number) else {
        return false;
    };
    text.word("$N").natural(number as u32).byte(b'=');
    text.bytes(line).end();
    true
}

/// The answer to `$G`, without its `ok`.
pub fn modes(text: &mut Text, modal: &Modal, is_changing_tool: bool, unit: ReportUnit) {
    // Every mode, so that a new one is listed or named here as unlisted.
    let Modal {
        motion,
        feed_mode,
        units,
        distance,
        plane,
        compensation,
        arc_distance,
        retract,
        overrides: _,
        tool_length,
        coordinates,
        path,
        spindle,
        coolant,
        tool,
        feed,
        feed_units: _,
        speed_rpm,
    } = modal;
    text.word("[GC:").word(motion.word());
    text.word(" ").word(coordinates.word());
    text.word(match plane {
        Plane::Xy => " G17 ",
        Plane::Zx => " G18 ",
        Plane::Yz => " G19 ",
    });
    text.word(units.word());
    text.word(" ").word(distance.word());
    text.word(" ").word(feed_mode.word());
    let words = [path.word(), compensation.word(), tool_length.word()];
    for word in words.into_iter().flatten() {
        text.word(" ").word(word);
    }
    if *retract == RetractMode::ReferencePlane {
        text.word(" G99");
    }
    if *arc_distance == ArcDistance::Absolute {
        text.word(" G90.1");
    }
    if is_changing_tool {
        text.word(" M6");
    }
    text.word(match spindle {
        Spindle::Clockwise => " M3",
        Spindle::CounterClockwise => " M4",
        Spindle::Off => " M5",
    });
    text.word(match (coolant.mist, coolant.flood) {
        (false, false) => " M9",
        (true, false) => " M7",
        (false, true) => " M8",
        (true, true) => " M7 M8",
    });
    text.word(" T").natural(u32::from(*tool));
    text.word(" F").rate(*feed, unit);
    text.word(" S").number(*speed_rpm, 0).word("]").end();
}

/// One line of the answer to `$#`, counted from 0. Returns false after the last.
fn parameter(
    text: &mut Text,
    offsets: &Offsets,
    tools: &ToolTable,
    last: &Probed,
    line: usize,
    settings: &Settings,
) -> bool {
    let unit = ReportUnit::of(settings);
    let systems = WorkCoordinates::ALL;
    let (of_grbl, others) = systems.split_at(WorkCoordinates::FIRST_BEYOND_GRBL.index());
    if let Some(system) = of_grbl.get(line) {
        origin(text, offsets, *system, unit);
        return true;
    }
    match line - of_grbl.len() {
        0 => position(text, "G28", &offsets.origins.g28, unit),
        1 => position(text, "G30", &offsets.origins.g30, unit),
        2 => position(text, "G92", &offsets.work, unit),
        3 => tool_offset(text, &offsets.tool, unit),
        4 => probed(text, last, settings),
        // These only where they have been set, so that a sender of Grbl never sees them unasked.
        after => {
            let mut set = others.iter().filter(|system| {
                let origins = &offsets.origins;
                origins.coordinates[**system] != Axes::all(Nm(0))
                    || origins.rotations[**system] != MicroDegrees::ZERO
            });
            let set_systems = set.clone().count();
            if let Some(system) = set.nth(after - 5) {
                origin(text, offsets, *system, unit);
            } else if let Some(entry) = tools.nth(after - 5 - set_systems) {
                known_tool(text, &entry, unit);
            } else {
                return false;
            }
        }
    }
    true
}

/// `[G28:0.000,0.000,0.000]`.
fn position(text: &mut Text, name: &str, values: &Axes<Nm>, unit: ReportUnit) {
    text.word("[").word(name).word(":");
    text.coordinates(values, unit).word("]").end();
}

/// `[G54:0.000,0.000,0.000]`, with the rotation behind it if there is one: `:30.00`, degrees.
fn origin(text: &mut Text, offsets: &Offsets, system: WorkCoordinates, unit: ReportUnit) {
    text.word("[").word(system.word()).word(":");
    text.coordinates(&offsets.origin(system), unit);
    let angle = offsets.origins.rotations[system];
    if angle != MicroDegrees::ZERO {
        text.word(":").degrees(angle);
    }
    text.word("]").end();
}

/// `[TLO:0.000]`: along Z alone where there is nothing along X and Y.
fn tool_offset(text: &mut Text, tool: &Axes<Nm>, unit: ReportUnit) {
    text.word("[TLO:");
    let is_length = (0..AXES).all(|axis| axis == Z || tool[axis] == Nm(0));
    if is_length {
        text.coordinate(tool[Z], unit);
    } else {
        text.coordinates(tool, unit);
    }
    text.word("]").end();
}

/// `[T:1|0.000,0.000,10.160|1.524]`: a tool, its offset and its radius, in grblHAL's form.
fn known_tool(text: &mut Text, entry: &ToolEntry, unit: ReportUnit) {
    let offset = Axes::from_fn(|axis| entry.offset.get(axis).copied().unwrap_or_default());
    text.word("[T:").natural(u32::from(entry.number.get()));
    text.word("|").coordinates(&offset, unit);
    text.word("|").coordinate(Nm(entry.diameter.0 / 2), unit);
    text.word("]").end();
}

/// One line of the answer to `$TT`, counted from 0: `T1 P1 X0 Y0 Z10.16 D3.048`, as in a tool table of
/// LinuxCNC, in mm. Returns false after the last.
fn tool(text: &mut Text, tools: &ToolTable, line: usize) -> bool {
    let Some(entry) = tools.nth(line) else {
        return false;
    };
    let number = u32::from(entry.number.get());
    text.word("T").natural(number).word(" P").natural(number);
    for (letter, length) in [" X", " Y", " Z", " D"].into_iter().zip(entry.lengths()) {
        text.word(letter).length(length);
    }
    text.end();
    true
}

/// One line of the answer to `$$`, counted from 0. Returns false after the last.
pub fn setting(text: &mut Text, settings: &Settings, line: usize) -> bool {
    let mut settings_of_grbl = Setting::all().filter(Setting::is_of_grbl);
    write_setting(text, settings, settings_of_grbl.nth(line))
}

/// One line of the answer to `$+`: as `$$`, with the settings that Grbl does not have. Returns false
/// after the last.
pub fn any_setting(text: &mut Text, settings: &Settings, line: usize) -> bool {
    write_setting(text, settings, Setting::all().nth(line))
}

fn write_setting(text: &mut Text, settings: &Settings, setting: Option<Setting>) -> bool {
    let Some(setting) = setting else {
        return false;
    };
    text.word("$").natural(u32::from(setting.number()));
    text.word("=");
    match setting.value(settings) {
        Value::Whole(whole) => text.natural(u32::from(whole)),
        Value::Number(number) => text.number(number, setting.row.kind.decimals()),
        Value::Millionths(millionths) => text.millionths(millionths.unsigned_abs()),
    };
    text.end();
    true
}

/// One line of the answers to `$ES`, `$EG`, `$EE` and `$EA`. Returns false after the last.
fn description(text: &mut Text, what: Described, line: usize) -> bool {
    let has_line = match what {
        Described::Settings => Setting::all()
            .nth(line)
            .map(|setting| describe_setting(text, setting))
            .is_some(),
        Described::Groups => SettingGroup::ALL
            .get(line)
            .map(|group| {
                text.word("[SETTINGGROUP:").natural(*group as u32);
                text.word("|0|").word(group.name());
            })
            .is_some(),
        Described::Errors => LineError::ALL
            .get(line)
            .map(|error| {
                text.word("[ERRORCODE:").natural(u32::from(error.number()));
                text.word("||").plain(error.text());
            })
            .is_some(),
        Described::Alarms => Alarm::ALL
            .get(line)
            .map(|alarm| {
                text.word("[ALARMCODE:").natural(u32::from(alarm.number()));
                text.word("||").plain(alarm.text());
            })
            .is_some(),
    };
    if has_line {
        text.word("]").end();
    }
    has_line
}

/// `[SETTING:id|group|name|unit|datatype|format|min|max`.
fn describe_setting(text: &mut Text, setting: Setting) {
    let row = setting.row;
    text.word("[SETTING:").natural(u32::from(setting.number()));
    text.word("|").natural(row.group as u32).word("|");
    if let Some(letter) = setting.letter() {
        text.byte(letter).word("-axis ");
    }
    text.plain(row.name).word("|").plain(row.unit);
    text.word("|").natural(row.kind.data_type() as u32);
    text.word("|").word(row.kind.format()).word("|");
    if let Some(range) = row.kind.range() {
        text.number(range.least, range.decimals);
        text.word("|").number(range.most, range.decimals);
    } else {
        text.word("|");
    }
}
