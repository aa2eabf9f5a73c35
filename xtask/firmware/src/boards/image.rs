//! What an ELF file has for the chip's memory, and words in it that a tool writes after linking.

use std::ops::Range;

use anyhow::{Context, Result, anyhow, ensure};
use object::{
    LittleEndian, Object, ObjectSection, ObjectSymbol,
    elf::{EM_ARM, FileHeader32, PF_X, PT_LOAD},
    read::elf::{FileHeader as _, ProgramHeader as _},
};

/// A part of the memory that the program has.
#[derive(Clone, Copy)]
pub struct Segment<'a> {
    /// Where its bytes are loaded to: in flash, also those of data.
    pub load_address: u32,
    /// The bytes that are loaded; none where memory is only cleared.
    pub bytes: &'a [u8],
    /// Where the program has it when it runs.
    pub address: u32,
    /// How many bytes it has there.
    pub size: u32,
    /// Whether it holds code.
    pub is_code: bool,
}

impl Segment<'_> {
    /// The addresses that its bytes are loaded to.
    pub fn loaded(&self) -> Range<u64> {
        range(self.load_address, self.bytes.len() as u64)
    }

    /// The addresses at which the program has it.
    pub fn occupied(&self) -> Range<u64> {
        range(self.address, self.size.into())
    }
}

fn range(start: u32, bytes: u64) -> Range<u64> {
    let start = u64::from(start);
    start..start + bytes
}

/// The segments of an ELF file for the chip's processor.
pub fn segments(image: &[u8]) -> Result<Vec<Segment<'_>>> {
    let header = FileHeader32::<LittleEndian>::parse(image).context("this is no ELF file")?;
    let endian = header.endian()?;
    ensure!(
        header.e_machine(endian) == EM_ARM,
        "this is no program for the chip's processor"
    );
    let all = header.program_headers(endian, image)?.iter();
    let loaded = all.filter(|segment| segment.p_type(endian) == PT_LOAD);
    loaded
        .map(|segment| {
            let bytes = segment.data(endian, image);
            let bytes = bytes.map_err(|()| anyhow!("a segment is not in the file"))?;
            let size = segment.p_memsz(endian);
            ensure!(
                bytes.len() as u64 <= u64::from(size),
                "a segment has more bytes than it takes"
            );
            Ok(Segment {
                load_address: segment.p_paddr(endian),
                bytes,
                address: segment.p_vaddr(endian),
                size,
                is_code: segment.p_flags(endian) & PF_X != 0,
            })
        })
        .collect()
}

/// The bytes that are loaded into flash, with their addresses, in the order of these.
pub fn parts(image: &[u8]) -> Result<Vec<(u32, &[u8])>> {
    let mut segments = segments(image)?;
    segments.retain(|segment| !segment.bytes.is_empty());
    segments.sort_by_key(|segment| segment.load_address);
    let parts = segments.iter().map(|it| (it.load_address, it.bytes));
    Ok(parts.collect())
}

/// Two words of an image, a mark and a value, that a tool writes after linking.
pub struct PatchedWords {
    /// Their symbol.
    pub symbol: &'static str,
    /// The marks that the first word may have.
    pub marks: &'static [[u8; 4]],
}

impl PatchedWords {
    /// Where in the file they are.
    pub fn place(&self, image: &[u8]) -> Result<Range<usize>> {
        let name = self.symbol;
        let file = object::File::parse(image).context("this is no ELF file")?;
        let symbol = file.symbols().find(|symbol| symbol.name() == Ok(name));
        let symbol = symbol.with_context(|| format!("the image has no symbol {name}"))?;
        let section = symbol.section_index().context("it is in no section")?;
        let section = file.section_by_index(section)?;
        let (offset, _) = section.file_range().context("it is not in the file")?;
        let within = symbol.address().checked_sub(section.address());
        let start = (offset + within.context("it is before its section")?) as usize;
        let mark = image.get(start..start + 4).and_then(<[u8]>::first_chunk);
        ensure!(
            mark.is_some_and(|mark| self.marks.contains(mark)),
            "the image has another mark at {name}: it is not one of this version"
        );
        ensure!(start + 8 <= image.len(), "the image ends within {name}");
        Ok(start..start + 8)
    }
}

/// The address of a symbol.
pub fn symbol(image: &[u8], name: &str) -> Result<u32> {
    let file = object::File::parse(image).context("this is no ELF file")?;
    let symbol = file.symbols().find(|symbol| symbol.name() == Ok(name));
    let symbol = symbol.with_context(|| format!("the image has no symbol {name}"))?;
    Ok(symbol.address() as u32)
}
