//! Where program and settings are in the chip's flash.

use crate::{Chip, Part};

/// Start of the flash of every chip.
const FLASH: u32 = 0x0800_0000;
/// Start of the RAM of every chip.
const RAM: u32 = 0x2000_0000;
/// The least that a bootloader must leave for the program: no firmware is as small, and a smaller rest is a mistake in
/// the board's file. Whether an image fits is known when it is built.
const MIN_PROGRAM_KIB: u32 = 256;

/// Where program and settings are.
#[derive(Debug, Clone, Copy, PartialEq, Eq)]
pub struct MemoryLayout {
    /// First address of the program: its vectors.
    pub flash_start: u32,
    /// Bytes from there that the program may have.
    pub flash_bytes: u32,
    /// First address of code, where it does not follow the vectors at once.
    pub code_start: Option<u32>,
    /// Bytes of RAM.
    pub ram_bytes: u32,
    /// The two sectors of the journal of settings; none where an EEPROM has them.
    pub journal: Option<[FlashSector; 2]>,
    /// The last sector that holds no settings: far behind the beginning of a program.
    pub last: FlashSector,
}

/// A sector of the flash.
#[derive(Debug, Clone, Copy, PartialEq, Eq)]
pub struct FlashSector {
    /// Number of the sector.
    pub sector: u8,
    /// Its first address.
    pub address: u32,
    /// Its size, bytes.
    pub bytes: u32,
}

impl MemoryLayout {
    /// Returns the layout of a part, with a bootloader of some KiB before the program, and the settings in flash or in
    /// an EEPROM.
    ///
    /// # Errors
    ///
    /// If the program cannot begin behind the bootloader or has no room there, or no two sectors are left for the
    /// settings.
    pub(crate) fn of(
        chip: &Chip,
        part: &Part,
        bootloader_kib: u32,
        has_eeprom: bool,
    ) -> Result<Self, String> {
        let sectors = Sectors::of(chip, part.flash_kib);
        let end = FLASH + part.flash_kib * 1024;
        let sector = |number: usize| FlashSector {
            sector: number as u8,
            address: sectors.0[number],
            bytes: chip.sectors_kib[number] * 1024,
        };
        let start = bootloader_kib.checked_mul(1024);
        let start = start.and_then(|bytes| FLASH.checked_add(bytes));
        let start = start.and_then(|start| Some((start, sectors.at(start)?)));
        let Some((flash_start, first)) = start else {
            let starts = sectors.0.iter().map(|start| (start - FLASH) / 1024);
            let starts: Vec<_> = starts.map(|kib| kib.to_string()).collect();
            return Err(format!(
                "no sector of the flash begins at {bootloader_kib} KiB; sectors begin at {} KiB",
                starts.join(", ")
            ));
        };
        let last = sectors.0.len() - 1;
        if has_eeprom {
            return Ok(Self {
                flash_start,
                flash_bytes: program_bytes(part, bootloader_kib, end)?,
                code_start: None,
                ram_bytes: chip.ram_kib * 1024,
                journal: None,
                last: sector(last),
            });
        }
        // Behind the program, where sectors are large enough to leave them to the settings: a bootloader writes
        // whole sectors, and a new program must not erase the settings.
        let is_behind = bootloader_kib != 0 && part.flash_kib >= 1024;
        let journal = if is_behind {
            [last - 1, last]
        } else {
            [first + 1, first + 2]
        };
        // A hole between the vectors and the code; it must leave most of the flash.
        if !is_behind && journal[1] > 4 {
            return Err(format!(
                "{} KiB of flash have no two sectors for the settings behind a bootloader of {bootloader_kib} KiB: \
                 32 KiB are the most, or an EEPROM on the board has them: [eeprom]",
                part.flash_kib
            ));
        }
        let program_end = if is_behind { sectors.0[last - 1] } else { end };
        Ok(Self {
            flash_start,
            flash_bytes: program_bytes(part, bootloader_kib, program_end)?,
            code_start: (!is_behind).then(|| sectors.0[journal[1] + 1]),
            ram_bytes: chip.ram_kib * 1024,
            journal: Some(journal.map(sector)),
            last: sector(if is_behind { last - 2 } else { last }),
        })
    }

    /// Returns whether an address is in the flash of the program.
    pub fn is_flash(&self, address: u64) -> bool {
        is_in(address, self.flash_start, self.flash_bytes)
    }

    /// Returns whether an address is in RAM.
    pub fn is_ram(&self, address: u64) -> bool {
        is_in(address, RAM, self.ram_bytes)
    }
}

/// Returns the bytes between a bootloader and the end of what the program may have.
fn program_bytes(part: &Part, bootloader_kib: u32, end: u32) -> Result<u32, String> {
    let kib = ((end - FLASH) / 1024).saturating_sub(bootloader_kib);
    if kib < MIN_PROGRAM_KIB {
        let settings_kib = part.flash_kib - (end - FLASH) / 1024;
        let settings = match settings_kib {
            0 => String::new(),
            kib => format!(", with {kib} KiB for the settings at the end"),
        };
        return Err(format!(
            "a bootloader of {bootloader_kib} KiB leaves {kib} KiB of {} for the program, which needs \
             {MIN_PROGRAM_KIB} at least{settings}",
            part.flash_kib
        ));
    }
    Ok(kib * 1024)
}

fn is_in(address: u64, start: u32, bytes: u32) -> bool {
    let start = u64::from(start);
    (start..start + u64::from(bytes)).contains(&address)
}

/// First addresses of a part's sectors.
struct Sectors(Vec<u32>);

impl Sectors {
    fn of(chip: &Chip, flash_kib: u32) -> Self {
        let mut next = FLASH;
        let mut starts = Vec::new();
        for kib in &chip.sectors_kib {
            if next < FLASH + flash_kib * 1024 {
                starts.push(next);
            }
            next += kib * 1024;
        }
        Self(starts)
    }

    fn at(&self, address: u32) -> Option<usize> {
        self.0.iter().position(|&start| start == address)
    }
}
