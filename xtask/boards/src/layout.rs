//! Where an image lies in the chip's memory, compared with where the board's file wants it.

use std::ops::Range;

use anyhow::{Context, Result, bail, ensure};
use common::text::separated;

use crate::{
    Board,
    image::{Segment, segments},
};

/// Start of the flash and of the RAM of every chip.
const FLASH: u32 = 0x0800_0000;
const RAM: u32 = 0x2000_0000;
/// What each firmware leaves free of the flash that it may use, bytes: room for what owners add, and for mends.
pub const LEAST_FREE_BYTES: u32 = 32 * 1024;

/// What an image takes of the flash that it may use.
#[derive(Debug, Clone, Copy, PartialEq, Eq)]
pub struct FlashUse {
    /// Bytes up to the last that is loaded, without those between vectors and code that hold settings or nothing.
    pub used: u32,
    /// Bytes that the program may use.
    pub usable: u32,
}

impl FlashUse {
    /// Bytes that are left.
    pub fn free(&self) -> u32 {
        self.usable.saturating_sub(self.used)
    }
}

/// Compares an image with the board's memory: no byte that is loaded may lie in the sectors of the settings, in a
/// bootloader or outside of the chip's flash, and stack and data must be in the chip's RAM.
pub fn check(board: &Board, image: &[u8]) -> Result<FlashUse> {
    let memory = &board.memory;
    let segments = segments(image)?;
    let of_ram = segments.iter().filter(|segment| segment.address >= RAM);
    for segment in of_ram {
        check_ram(board, segment)?;
    }
    let mut end = memory.flash_start;
    for segment in segments.iter().filter(|it| !it.bytes.is_empty()) {
        let loaded = segment.loaded();
        for (area, name) in forbidden(board) {
            let (first, last) = (loaded.start.max(area.start), loaded.end.min(area.end));
            if first < last {
                bail!(
                    "{} bytes of the program, {first:#010x} to {:#010x}, lie {name}",
                    separated((last - first).into()),
                    last - 1
                );
            }
        }
        end = end.max(loaded.end);
    }
    check_vectors(board, &segments)?;
    let first = memory.code_start.unwrap_or(memory.flash_start);
    Ok(FlashUse {
        used: end.saturating_sub(first),
        usable: memory.flash_start + memory.flash_bytes - first,
    })
}

/// Areas that hold no byte of a program, and what is said of bytes there.
fn forbidden(board: &Board) -> Vec<(Range<u32>, String)> {
    let memory = &board.memory;
    let end = FLASH + board.part.flash_kib * 1024;
    let chip = format!("outside of the flash of the STM32{}", board.part_name);
    let bootloader = format!(
        "in the bootloader, which has the first {} KiB",
        board.bootloader_kib
    );
    let mut areas = vec![
        (0..FLASH, chip.clone()),
        (end..u32::MAX, chip),
        (FLASH..memory.flash_start, bootloader),
    ];
    areas.extend(memory.journal.as_slice().as_flattened().iter().map(|it| {
        let name = format!("in sector {}, which holds settings", it.sector);
        (it.address..it.address + it.bytes, name)
    }));
    areas
}

/// Compares data and cleared memory with the chip's RAM.
fn check_ram(board: &Board, segment: &Segment<'_>) -> Result<()> {
    let end = u64::from(segment.address) + u64::from(segment.size);
    let of_chip = u64::from(RAM + board.memory.ram_bytes);
    ensure!(
        end <= of_chip,
        "{} bytes of data lie behind {:#010x}, the end of the RAM of the STM32{}",
        separated(end - of_chip),
        of_chip - 1,
        board.part_name
    );
    Ok(())
}

/// Compares the first two vectors, of the stack and of the first instruction: RM0090 2.4.
fn check_vectors(board: &Board, segments: &[Segment<'_>]) -> Result<()> {
    let start = board.memory.flash_start;
    let vectors = segments.iter().find(|it| it.loaded().contains(&start));
    let word = |index: usize| {
        let vectors = vectors?;
        let at = (start - vectors.load_address) as usize + 4 * index;
        let word = vectors.bytes.get(at..)?.first_chunk()?;
        Some(u32::from_le_bytes(*word))
    };
    let missing = || format!("the program has no vectors at {start:#010x}");
    let (stack, reset) = (
        word(0).with_context(missing)?,
        word(1).with_context(missing)?,
    );
    let ram = RAM..=RAM + board.memory.ram_bytes;
    ensure!(
        ram.contains(&stack) && stack != RAM,
        "the stack begins at {stack:#010x}, which is not in the RAM of the STM32{}",
        board.part_name
    );
    let first = reset & !1;
    let is_loaded = segments.iter().any(|it| it.loaded().contains(&first));
    ensure!(
        is_loaded && reset & 1 == 1,
        "the first instruction would be at {first:#010x}, where the program has none"
    );
    Ok(())
}
