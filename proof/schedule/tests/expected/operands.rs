//! Operands of a disassembly.

use schedule::{Address, Writeback};

/// Where an access goes, and what it writes back.
pub(crate) type Access = (Address, Option<Writeback>);

pub(crate) fn register(name: &str) -> Option<u8> {
    match name.trim() {
        "sb" => Some(9),
        "sl" => Some(10),
        "fp" => Some(11),
        "ip" => Some(12),
        "sp" => Some(13),
        "lr" => Some(14),
        "pc" => Some(15),
        name => name.strip_prefix('r')?.parse().ok(),
    }
}

/// All core registers named in `text`.
pub(crate) fn registers(text: &str) -> u16 {
    text.split(|letter: char| !letter.is_ascii_alphanumeric())
        .filter_map(register)
        .fold(0, |mask, register| mask | 1 << register)
}

/// The core registers in braces.
pub(crate) fn list(operands: &str) -> u16 {
    let list = operands.split('{').nth(1).unwrap_or_default();
    list.trim_end_matches('}')
        .split(", ")
        .filter_map(|part| match part.split_once('-') {
            Some((first, last)) => {
                let (first, last) = (register(first)?, register(last)?);
                Some((first..=last).fold(0, |mask, register| mask | 1 << register))
            }
            None => Some(1 << register(part)?),
        })
        .fold(0, |all, mask: u16| all | mask)
}

/// Words that floating-point registers hold: those in braces, or the first.
pub(crate) fn float_words(operands: &str) -> u8 {
    let list = operands.split_once('{').map_or_else(
        || operands.split(", ").next().unwrap_or_default(),
        |(_, list)| list,
    );
    let width = |part: &str| if part.starts_with('d') { 2 } else { 1 };
    list.trim_end_matches('}')
        .split(", ")
        .map(|part| {
            let count = part.split_once('-').map_or(1, |(first, last)| {
                let number = |name: &str| name[1..].parse::<u8>().expect("a register");
                number(last) - number(first) + 1
            });
            width(part) * count
        })
        .sum()
}

/// The access that the operands of a load or store name.
pub(crate) fn address(operands: &str, name: &str, at: u32, words: u8) -> Option<Access> {
    if operands.contains('{') {
        return multiple(operands, name, words);
    }
    let (_, rest) = operands.split_once('[')?;
    let (inside, after) = rest.split_once(']')?;
    let parts: Vec<&str> = inside.split(", ").collect();
    let base = register(parts[0])?;
    let number = |text: &str| text.trim().trim_start_matches('#').parse::<i32>().ok();
    let offset = match parts.get(1) {
        None => 0,
        Some(text) => match register(text) {
            Some(index) => {
                let shift = parts
                    .get(2)
                    .map_or(Some(0), |text| number(text.trim_start_matches("lsl ")))?;
                let shift = shift as u8;
                return Some((Address::Indexed { base, index, shift }, None));
            }
            None => number(text)?,
        },
    };
    if base == 15 {
        let pc = (at + 4) & !3;
        return Some((Address::Absolute(pc.wrapping_add_signed(offset)), None));
    }
    let (offset, writeback) = match after.trim() {
        "" => (offset, None),
        "!" => (offset, Some((base, offset))),
        after => (0, Some((base, number(after.trim_start_matches(", "))?))),
    };
    Some((Address::Offset { base, offset }, writeback))
}

fn multiple(operands: &str, name: &str, words: u8) -> Option<Access> {
    let bytes = 4 * i32::from(words);
    let (base, writes_back, is_down) = match name {
        "push" | "vpush" => (13, true, true),
        "pop" | "vpop" => (13, true, false),
        _ => {
            let base = operands.split(", ").next()?;
            let is_down = name.ends_with("db");
            (
                register(base.trim_end_matches('!'))?,
                base.ends_with('!'),
                is_down,
            )
        }
    };
    let distance = if is_down { -bytes } else { bytes };
    let offset = if is_down { -bytes } else { 0 };
    let writeback = writes_back.then_some((base, distance));
    Some((Address::Offset { base, offset }, writeback))
}
