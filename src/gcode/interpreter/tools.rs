//! Tools: the tool length offset, and what lines change in the tool table.
//!
//! Read with LinuxCNC 2.9 "G43", "G10 L1", "G10 L10" and "G10 L11".

use core::num::NonZeroU8;

use super::{Action, CheckedLine, Interpreter, offsets::Frame, reach, targets};
use crate::{
    axis::{Axes, LINEAR, X, Y},
    decimal::Decimal,
    gcode::{LineError, ParsedLine, ToolLength, Word, WordReader, Words, tool_number},
    model::WorkCoordinates,
    settings::{Settings, ToolEntry},
    units::Nm,
};

/// Sets the tool length offset of `G43`, `G43.1`, `G43.2` and `G49`.
pub(super) fn set_length(
    state: &Interpreter,
    parsed: &ParsedLine,
    unused: &mut Words,
    checked: &mut CheckedLine,
) -> Result<(), LineError> {
    let before = state.offsets.tool;
    let given = |none: Axes<Nm>| {
        Axes::from_fn(|axis| {
            if parsed.has_axis(axis) {
                targets::coordinate(parsed, axis)
            } else {
                none[axis]
            }
        })
    };
    checked.tool = match parsed.modal.tool_length {
        ToolLength::None => Axes::all(Nm(0)),
        ToolLength::OfTool => length_of_tool(state, parsed, unused, checked)?,
        ToolLength::Dynamic if parsed.axes == 0 => return Err(LineError::ToolLengthAxis),
        ToolLength::Dynamic => given(before),
        ToolLength::Added => {
            let added = if parsed.axes == 0 {
                length_of_tool(state, parsed, unused, checked)?
            } else {
                given(Axes::all(Nm(0)))
            };
            before.zip(added, |before, added| before + added)
        }
    };
    Ok(())
}

/// Returns the offset of the tool `H`; without it, or with `H0`, of the tool in the spindle.
///
/// With an empty table it is 0, so that programs with `G43` run on a machine whose tools are measured
/// by the sender.
fn length_of_tool(
    state: &Interpreter,
    parsed: &ParsedLine,
    unused: &mut Words,
    checked: &mut CheckedLine,
) -> Result<Axes<Nm>, LineError> {
    unused.remove(Word::H);
    let number = match tool_number(parsed.h)? {
        0 => checked.loaded_tool,
        number => number,
    };
    let none = Axes::all(Nm(0));
    if number == 0 {
        return Ok(none);
    }
    match state.tools.get(number) {
        Some(entry) => Ok(along_all_axes(&entry.offset)),
        None if state.tools.is_empty() => {
            checked.lacks_tools = true;
            Ok(none)
        }
        None => Err(LineError::UnknownTool),
    }
}

/// Returns an offset of the table: there is none along rotary axes.
fn along_all_axes(offset: &[Nm; LINEAR]) -> Axes<Nm> {
    Axes::from_fn(|axis| offset.get(axis).copied().unwrap_or_default())
}

/// `G10 L1`, `L10`, `L11`: the new entry of tool `P`, of which the given words are set. `L10` makes the
/// values those of the present position after `G43`, in the work coordinates of the line; `L11` in those
/// of `G59.3` without `G92`. `R` is the radius.
pub(super) fn set_entry(
    state: &Interpreter,
    settings: &Settings,
    parsed: &ParsedLine,
    unused: &mut Words,
    checked: &mut CheckedLine,
) -> Result<(), LineError> {
    if parsed.axes == 0 && !unused.contains(Word::R) {
        return Err(LineError::NoAxisWords);
    }
    if !unused.contains(Word::P) {
        return Err(LineError::MissingWord);
    }
    let number = NonZeroU8::new(tool_number(parsed.p)?).ok_or(LineError::UnknownTool)?;
    if parsed.axes >> LINEAR != 0 {
        return Err(LineError::UnusedAxisWords);
    }
    let slot = state
        .tools
        .slot_of(number)
        .ok_or(LineError::ToolTableFull)?;
    let mut entry = state.tools.slot(slot).unwrap_or(ToolEntry::new(number));
    if unused.contains(Word::R) {
        entry.diameter = Nm(parsed.length(parsed.radius).0.saturating_mul(2));
    }
    unused.remove(Word::R);
    unused.remove(Word::P);
    unused.remove(Word::L);
    if parsed.subcode() == 1 {
        for (axis, value) in entry.offset.iter_mut().enumerate() {
            if parsed.has_axis(axis) {
                *value = targets::coordinate(parsed, axis);
            }
        }
    } else {
        measure(state, parsed, checked, &mut entry);
    }
    check_entry(&entry, settings)?;
    checked.values = along_all_axes(&entry.offset);
    checked.action = Action::SetTool {
        slot: slot as u8,
        number,
        diameter: entry.diameter,
    };
    Ok(())
}

/// Moves the offset of a tool so that the present position gets the given values.
fn measure(state: &Interpreter, parsed: &ParsedLine, checked: &CheckedLine, entry: &mut ToolEntry) {
    let offsets = &state.offsets;
    let (system, work) = if parsed.subcode() == 10 {
        (checked.modal.coordinates, offsets.work)
    } else {
        (WorkCoordinates::G59_3, Axes::all(Nm(0)))
    };
    let tool = along_all_axes(&entry.offset);
    let frame = Frame::of(
        &offsets.origins,
        system,
        &work,
        &tool,
        &state.frame.rotation,
    );
    let present = frame.work_position(&state.position);
    let mut moved = Axes::from_fn(|axis| {
        if parsed.has_axis(axis) {
            present[axis] - targets::coordinate(parsed, axis)
        } else {
            Nm(0)
        }
    });
    if !frame.rotation.is_none() {
        // The offset is along the axes of the machine.
        [moved[X], moved[Y]] = frame.rotation.rotate([moved[X], moved[Y]]);
    }
    for (value, moved) in entry.offset.iter_mut().zip(&moved) {
        *value = *value + *moved;
    }
}

/// Checks that the table can hold the lengths of a tool, and that every axis can count up to its offset.
fn check_entry(entry: &ToolEntry, settings: &Settings) -> Result<(), LineError> {
    if !entry.fits() {
        return Err(LineError::InvalidTarget);
    }
    reach::check_position(settings, &along_all_axes(&entry.offset))
}

impl CheckedLine {
    /// Returns whether the line sets a tool of the tool table.
    #[must_use]
    pub fn sets_tool(&self) -> bool {
        matches!(self.action, Action::SetTool { .. })
    }

    /// Returns the slot and the entry of a tool that the line sets.
    #[must_use]
    pub fn new_tool(&self) -> Option<(usize, ToolEntry)> {
        let Action::SetTool {
            slot,
            number,
            diameter,
        } = self.action
        else {
            return None;
        };
        let entry = ToolEntry {
            number,
            offset: core::array::from_fn(|axis| self.values[axis]),
            diameter,
        };
        Some((usize::from(slot), entry))
    }
}

impl Interpreter {
    /// Reads the words of a tool as a line of LinuxCNC's tool table has them, in mm: `T1 P1 X0 Y0 Z10.16
    /// D3.048`, all of which may be left out. `P` has no meaning. Returns the slot of the tool, and its
    /// entry. Without any text there is none; nor is there a slot, if the table has no such tool.
    ///
    /// # Errors
    /// 1 and 2 for text without words; 20 for other words; 25 for a word given twice; 33 for lengths that an axis
    /// cannot count; 39 for the number of another tool; 206 when the table is full.
    pub fn read_tool(
        &self,
        number: NonZeroU8,
        words: &[u8],
        settings: &Settings,
    ) -> Result<Option<(usize, Option<ToolEntry>)>, LineError> {
        if words.is_empty() {
            let slot = self.tools.slot_with(number);
            return Ok(slot.map(|slot| (slot, None)));
        }
        let mut entry = ToolEntry::new(number);
        let mut read = Words::NONE;
        for word in WordReader::new(words.iter().copied()) {
            let (letter, value) = word?;
            let length = Nm(Decimal::to_millionths(value));
            match letter {
                b'X' => entry.offset[0] = length,
                b'Y' => entry.offset[1] = length,
                b'Z' => entry.offset[2] = length,
                b'D' => entry.diameter = length,
                b'T' if !value.is_whole() || value.trunc() != i64::from(number.get()) => {
                    return Err(LineError::ValueOutOfRange);
                }
                b'T' | b'P' => {}
                _ => return Err(LineError::Unsupported),
            }
            if read.contains(Word::new(letter)) {
                return Err(LineError::RepeatedWord);
            }
            read.insert(Word::new(letter));
        }
        check_entry(&entry, settings)?;
        let slot = self.tools.slot_of(number).ok_or(LineError::ToolTableFull)?;
        Ok(Some((slot, Some(entry))))
    }
}
