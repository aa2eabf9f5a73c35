//! The memory map of a board's chip: RM0090 2.3 and 3.4, RM0383 2.2 and 3.3, RM0390 2.2 and 3.4.

use std::{
    num::{NonZeroU32, NonZeroU64},
    path::Path,
};

use anyhow::Result;
use board_data::Board;
use rigless::{
    image::Image,
    soc::{EraseBlocks, Region},
};

/// The first address of the flash.
pub(crate) const FLASH: u64 = 0x0800_0000;
const KIB: u64 = 1024;

/// Chips without the memory that the core alone reaches.
const WITHOUT_CORE_MEMORY: [&str; 2] = ["f411", "f446"];
/// Chips without a memory that a battery keeps.
const WITHOUT_BACKUP_MEMORY: [&str; 1] = ["f411"];

/// The memories of a board's chip, which live as long as the program: a bus wants them so.
pub(super) fn of(board: &Board) -> &'static [Region] {
    let flash_bytes = u64::from(board.part.flash_kib) * KIB;
    let flash = Region::flash("flash", FLASH, flash_bytes)
        .erased_in(erase_blocks(&sectors(board)))
        .erased_to(0xFF)
        .programmed_by("FLASH");
    let mut regions = vec![
        flash,
        Region::system("system", 0x1FFF_0000, 32 * KIB),
        Region::ram("sram", 0x2000_0000, u64::from(board.chip.ram_kib) * KIB),
    ];
    let chip = board.chip.hal.as_str();
    if !WITHOUT_CORE_MEMORY.contains(&chip) {
        regions.push(Region::ram("ccm", 0x1000_0000, 64 * KIB));
    }
    if !WITHOUT_BACKUP_MEMORY.contains(&chip) {
        regions.push(Region::ram("backup_sram", 0x4002_4000, 4 * KIB));
    }
    regions.leak()
}

/// What the chip's maker has written: the number that no other chip has, and, 18 bytes behind its beginning, the size of
/// the flash, KiB. RM0090 39.1 and 39.2, RM0383 24.1 and 24.2, RM0390 34.1 and 34.2.
pub(crate) fn made(board: &Board) -> Result<Image> {
    const NUMBER: u64 = 0x1FFF_7A10;
    const SIZE_OFFSET: usize = 18;
    let mut bytes = b"a model chip".to_vec();
    bytes.resize(SIZE_OFFSET, 0);
    bytes.extend((board.part.flash_kib as u16).to_le_bytes());
    Ok(Image::new(
        Path::new("what the chip's maker has written"),
        bytes,
        Some(NUMBER),
    )?)
}

/// The first addresses of the sectors and their sizes, bytes.
pub(super) fn sectors(board: &Board) -> Vec<(u64, u64)> {
    let end = FLASH + u64::from(board.part.flash_kib) * KIB;
    let mut next = FLASH;
    let sizes = { board.chip.sectors_kib.iter() }.map(|&kib| u64::from(kib) * KIB);
    let starts = sizes.map(|bytes| {
        let start = next;
        next += bytes;
        (start, bytes)
    });
    starts.take_while(|(start, _)| *start < end).collect()
}

/// Sectors of one size each.
fn erase_blocks(sectors: &[(u64, u64)]) -> &'static [EraseBlocks] {
    let blocks: Vec<_> = { sectors.chunk_by(|first, second| first.1 == second.1) }
        .map(|equal| EraseBlocks {
            size: NonZeroU64::new(equal[0].1).expect("a sector has bytes"),
            count: NonZeroU32::new(equal.len() as u32).expect("there is one"),
        })
        .collect();
    blocks.leak()
}
