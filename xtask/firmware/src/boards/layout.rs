//! Where an image lies in the chip's memory, compared with where the board's file wants it.

use std::ops::Range;

use anyhow::{Context, Result, bail, ensure};
use common::{cargo, text::separated};

use super::{
    Board,
    image::{Segment, segments, symbol},
};

/// Start of the flash and of the RAM of every chip.
const FLASH: u32 = 0x0800_0000;
const RAM: u32 = 0x2000_0000;
/// Minimum free part of the flash of a firmware, bytes: room for additions of owners and for fixes.
pub const MIN_FREE_BYTES: u32 = 32 * 1024;

/// The use of the flash by an image.
#[derive(Debug, Clone, Copy, PartialEq, Eq)]
pub struct FlashUse {
    /// Bytes up to the last loaded byte, without the sectors of the settings between vectors and code.
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

/// Compares an image with the memory of the board. No loaded byte may lie in the sectors of the settings, in a
/// bootloader or outside of the flash. Code must run where it is loaded; stack and data must lie in the RAM.
pub fn check(board: &Board, image: &[u8]) -> Result<FlashUse> {
    check_segments(board, &segments(image)?)
}

/// The same of bytes that are loaded to addresses, of which nothing else is known.
pub fn check_parts(board: &Board, parts: &[(u32, &[u8])]) -> Result<()> {
    let segments = parts.iter().map(|(address, bytes)| Segment {
        load_address: *address,
        bytes,
        address: *address,
        size: bytes.len() as u32,
        is_code: true,
    });
    check_segments(board, &segments.collect::<Vec<_>>()).map(|_| ())
}

fn check_segments(board: &Board, segments: &[Segment<'_>]) -> Result<FlashUse> {
    let memory = board.chosen_memory();
    let mut end = u64::from(memory.flash_start);
    for segment in segments.iter().filter(|it| !it.bytes.is_empty()) {
        let loaded = segment.loaded();
        for (area, name) in forbidden(board) {
            let (first, last) = (loaded.start.max(area.start), loaded.end.min(area.end));
            if first < last {
                bail!(
                    "{} bytes of the program, {first:#010x} to {:#010x}, lie {name}",
                    separated(last - first),
                    last - 1
                );
            }
        }
        end = end.max(loaded.end);
    }
    check_overlaps(segments)?;
    for segment in segments.iter().filter(|it| it.size > 0) {
        check_place(board, segment)?;
    }
    check_vectors(board, segments)?;
    let first = memory.code_start.unwrap_or(memory.flash_start);
    Ok(FlashUse {
        used: (end as u32).saturating_sub(first),
        usable: memory.flash_start + memory.flash_bytes - first,
    })
}

/// What the program file of a firmware for QEMU names, and no other does.
const OF_QEMU: &[u8] = b"src/board/qemu";

/// Compares an image with the board and the number of axes that it was built for.
pub fn check_board(board: &Board, image: &[u8]) -> Result<()> {
    let expected = board_data::fingerprint(board, cargo::axes().into());
    ensure!(
        symbol(image, board_data::FINGERPRINT)? == expected,
        "it was built for another board, or for another number of axes"
    );
    let names_qemu = image.windows(OF_QEMU.len()).any(|bytes| bytes == OF_QEMU);
    ensure!(
        names_qemu == board.is_in_qemu,
        "it was built for QEMU, or is for it and was not"
    );
    Ok(())
}

/// Areas that hold no byte of a program, and what is said of bytes there.
fn forbidden(board: &Board) -> Vec<(Range<u64>, String)> {
    let memory = board.chosen_memory();
    let start = u64::from(FLASH);
    let end = start + u64::from(board.part.flash_kib) * 1024;
    let chip = format!("outside of the flash of the STM32{}", board.part_name);
    let bootloader = format!(
        "in the bootloader, which has the first {} KiB",
        board.bootloader_kib
    );
    let mut areas = vec![
        (0..start, chip.clone()),
        (end..u64::MAX, chip),
        (start..memory.flash_start.into(), bootloader),
    ];
    areas.extend(memory.journal.as_slice().as_flattened().iter().map(|it| {
        let name = format!("in sector {}, which holds settings", it.sector);
        let first = u64::from(it.address);
        (first..first + u64::from(it.bytes), name)
    }));
    areas
}

/// Makes sure that no byte is loaded twice.
fn check_overlaps(segments: &[Segment<'_>]) -> Result<()> {
    let mut loaded: Vec<_> = segments.iter().map(Segment::loaded).collect();
    loaded.retain(|it| !it.is_empty());
    loaded.sort_by_key(|it| it.start);
    let mut pairs = loaded.iter().zip(loaded.iter().skip(1));
    if let Some((_, twice)) = pairs.find(|(one, other)| one.end > other.start) {
        bail!("what is at {:#010x} is loaded twice", twice.start);
    }
    Ok(())
}

/// Makes sure that the program has a segment in the chip's RAM, or in flash and there where it is loaded.
fn check_place(board: &Board, segment: &Segment<'_>) -> Result<()> {
    let occupied = segment.occupied();
    let ram = ram(board);
    let is_loaded = !segment.bytes.is_empty();
    if is_loaded && segment.address == segment.load_address {
        return Ok(());
    }
    ensure!(
        ram.contains(&occupied.start),
        "{} bytes at {:#010x} lie neither in the RAM of the STM32{} nor where they are loaded",
        separated(occupied.end - occupied.start),
        occupied.start,
        board.part_name
    );
    ensure!(
        occupied.end <= ram.end,
        "{} bytes of data lie behind {:#010x}, the end of the RAM of the STM32{}",
        separated(occupied.end - ram.end),
        ram.end - 1,
        board.part_name
    );
    Ok(())
}

/// The chip's RAM.
fn ram(board: &Board) -> Range<u64> {
    let start = u64::from(RAM);
    start..start + u64::from(board.chosen_memory().ram_bytes)
}

/// Compares the first two vectors, of the stack and of the first instruction: RM0090 2.4.
fn check_vectors(board: &Board, segments: &[Segment<'_>]) -> Result<()> {
    let start = board.chosen_memory().flash_start;
    let vectors = segments
        .iter()
        .find(|it| it.loaded().contains(&start.into()));
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
    let ram = ram(board);
    let data = segments.iter().map(Segment::occupied);
    let data_end = data.filter(|it| ram.contains(&it.start)).map(|it| it.end);
    let data_end = data_end.max().unwrap_or(ram.start);
    ensure!(
        data_end < u64::from(stack) && u64::from(stack) <= ram.end && stack.is_multiple_of(8),
        "the stack begins at {stack:#010x}, which is not in the RAM of the STM32{} behind the data",
        board.part_name
    );
    let first = reset & !1;
    let mut code = segments.iter().filter(|it| it.is_code);
    let is_code = code.any(|it| {
        it.address == it.load_address && it.loaded().contains(&first.into()) && first >= start + 8
    });
    ensure!(
        is_code && reset & 1 == 1,
        "the first instruction would be at {first:#010x}, where the program has none"
    );
    Ok(())
}

#[cfg(test)]
mod tests {
    use super::*;

    /// An ELF file with segments: address of loading, address, bytes, size.
    fn elf(segments: &[(u32, u32, &[u8], u32)]) -> Vec<u8> {
        const HEADER_BYTES: u32 = 52;
        const ENTRY_BYTES: u32 = 32;
        let mut file = b"\x7fELF\x01\x01\x01\0\0\0\0\0\0\0\0\0".to_vec();
        let half = |file: &mut Vec<u8>, value: u16| file.extend(value.to_le_bytes());
        let words = |file: &mut Vec<u8>, values: &[u32]| {
            file.extend(values.iter().flat_map(|value| value.to_le_bytes()));
        };
        for value in [2, 40] {
            half(&mut file, value);
        }
        words(&mut file, &[1, 0, HEADER_BYTES, 0, 0]);
        let [header, entry] = [HEADER_BYTES, ENTRY_BYTES].map(|bytes| bytes as u16);
        for value in [header, entry, segments.len() as u16, 40, 0, 0] {
            half(&mut file, value);
        }
        let mut offset = HEADER_BYTES + ENTRY_BYTES * segments.len() as u32;
        for (load_address, address, bytes, size) in segments {
            let in_file = bytes.len() as u32;
            words(
                &mut file,
                &[1, offset, *address, *load_address, in_file, *size, 7, 4],
            );
            offset += in_file;
        }
        file.extend(segments.iter().flat_map(|(_, _, bytes, _)| *bytes));
        file
    }

    /// The firmware of a board with vectors, code and data; `change` changes the vector of the stack, the address of
    /// code and its bytes.
    fn image(name: &str, stack: Option<u32>, code: Option<u32>, bytes: usize) -> Vec<u8> {
        let memory = crate::boards::named(name).unwrap().chosen_memory();
        let vectors_at = memory.flash_start;
        let code_at = code.unwrap_or(memory.code_start.unwrap_or(vectors_at + 0x1c4));
        let stack = stack.unwrap_or(RAM + memory.ram_bytes);
        let mut vectors = [stack, code_at | 1].map(u32::to_le_bytes).concat();
        vectors.resize(0x1c4, 0);
        let code = vec![0xbf; bytes];
        elf(&[
            (vectors_at, vectors_at, &vectors, 0x1c4),
            (code_at, code_at, &code, code.len() as u32),
            (0, RAM, &[], 0x1000),
        ])
    }

    fn refusal(name: &str, image: &[u8]) -> String {
        let board = crate::boards::named(name).unwrap();
        check(&board, image).unwrap_err().to_string()
    }

    #[test]
    fn an_image_in_its_place_is_measured_against_what_it_may_use() {
        for (name, usable_kib, vectors) in [
            ("nucleo-f446re", 512 - 48, 0),
            ("btt-skr-2", 1024 - 32 - 256, 0x1c4),
            ("flexi-hal", 512 - 64, 0x1c4),
        ] {
            let image = image(name, None, None, 1000);
            let found = check(&crate::boards::named(name).unwrap(), &image).unwrap();
            let usable = usable_kib * 1024;
            let used = 1000 + vectors;
            assert_eq!(found, FlashUse { used, usable }, "{name}");
            assert_eq!(found.free(), usable - used);
        }
    }

    #[test]
    fn a_program_in_a_sector_of_the_settings_is_refused() {
        let after_vectors = image("nucleo-f446re", None, Some(0x0800_01c4), 0x5000);
        assert_eq!(
            refusal("nucleo-f446re", &after_vectors),
            "4 548 bytes of the program, 0x08004000 to 0x080051c3, lie in sector 1, which holds settings"
        );
        let up_to_the_end = image("btt-skr-2", None, None, 0xb_8000);
        let message = refusal("btt-skr-2", &up_to_the_end);
        assert!(
            message.ends_with("lie in sector 10, which holds settings"),
            "{message}"
        );
    }

    #[test]
    fn a_program_beyond_the_end_of_the_flash_is_refused() {
        let image = image("nucleo-f446re", None, None, 0x7_4100);
        assert_eq!(
            refusal("nucleo-f446re", &image),
            "256 bytes of the program, 0x08080000 to 0x080800ff, lie outside of the flash of the STM32F446RE"
        );
    }

    #[test]
    fn a_program_in_the_bootloader_is_refused() {
        let image = image("btt-skr-2", None, Some(0x0800_7ff0), 0x100);
        assert_eq!(
            refusal("btt-skr-2", &image),
            "16 bytes of the program, 0x08007ff0 to 0x08007fff, lie in the bootloader, which has the first 32 KiB"
        );
    }

    #[test]
    fn the_stack_and_the_data_of_a_chip_with_more_memory_are_refused() {
        let image = image("btt-skr-2", Some(0x2003_0000), None, 0x100);
        assert_eq!(
            refusal("btt-skr-2", &image),
            "the stack begins at 0x20030000, which is not in the RAM of the STM32F407VG behind the data"
        );
        let vectors = [0x2002_0000, 0x0800_8001].map(u32::to_le_bytes).concat();
        let image = elf(&[
            (0x0800_8000, 0x0800_8000, &vectors, 8),
            (0, 0x2000_0000, &[], 0x2_0010),
        ]);
        assert_eq!(
            refusal("btt-skr-2", &image),
            "16 bytes of data lie behind 0x2001ffff, the end of the RAM of the STM32F407VG"
        );
    }

    #[test]
    fn a_program_that_the_bootloader_could_not_start_is_refused() {
        let vectors = |reset: u32| [0x2002_0000, reset].map(u32::to_le_bytes).concat();
        let start = 0x0800_8000;
        for (at, bytes, reason) in [
            (start, vectors(0x0801_0101), "where the program has none"),
            (start, vectors(start), "where the program has none"),
            (start, vec![0; 4], "no vectors at 0x08008000"),
            (start + 16, vectors(start + 17), "no vectors at 0x08008000"),
            (start, vectors(start + 5), "where the program has none"),
        ] {
            let message = refusal("btt-skr-2", &elf(&[(at, at, &bytes, 8)]));
            assert!(message.contains(reason), "{message}");
        }
    }

    #[test]
    fn code_that_is_not_where_it_is_loaded_and_data_that_is_not_in_ram_are_refused() {
        let vectors = [0x2002_0000, 0x0800_8009].map(u32::to_le_bytes).concat();
        let program = [&vectors[..], &[0xbf; 8]].concat();
        let program = (0x0800_8000, 0x0800_8000, &program[..], 16);
        for (other, reason) in [
            (
                (0, 0x1000_0000, &[][..], 8),
                "8 bytes at 0x10000000 lie neither",
            ),
            (
                (0, 0x080c_0000, &[], 8),
                "8 bytes at 0x080c0000 lie neither",
            ),
            (
                (0x0801_0000, 0x0805_0000, &[1; 8], 8),
                "8 bytes at 0x08050000 lie neither",
            ),
            (
                (0x0800_8008, 0x2000_0000, &[1; 4], 4),
                "0x08008008 is loaded twice",
            ),
            (
                (0xffff_fffe, 0x2000_0000, &[1; 2], 2),
                "2 bytes of the program",
            ),
            (
                (0, 0x2000_0000, &[], 0x2_0000),
                "the stack begins at 0x20020000",
            ),
        ] {
            let message = refusal("btt-skr-2", &elf(&[program, other]));
            assert!(message.contains(reason), "{message}");
        }
        let mut other_machine = elf(&[program]);
        other_machine[18] = 62;
        let message = refusal("btt-skr-2", &other_machine);
        assert!(
            message.contains("no program for the chip's processor"),
            "{message}"
        );
    }

    #[test]
    fn the_whole_sector_of_the_settings_is_closed_to_programs() {
        let vectors = [0x2002_0000, 0x0800_8009].map(u32::to_le_bytes).concat();
        let program = [&vectors[..], &[0xbf; 8]].concat();
        let program = (0x0800_8000, 0x0800_8000, &program[..], 16);
        for last in [0x080d_ffff, 0x080f_ffff] {
            let message = refusal("btt-skr-2", &elf(&[program, (last, last, &[1], 1)]));
            assert!(message.contains("which holds settings"), "{message}");
        }
    }
}
