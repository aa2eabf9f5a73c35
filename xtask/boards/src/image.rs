//! What an ELF file has for the chip's memory, and words in it that a tool writes after linking.

use std::ops::Range;

use anyhow::{Context, Result, anyhow, ensure};
use object::{
    LittleEndian, Object, ObjectSection, ObjectSymbol,
    elf::{FileHeader32, PT_LOAD},
    read::elf::{FileHeader as _, ProgramHeader as _},
};

/// A part of the memory that the program has.
pub struct Segment<'a> {
    /// Where its bytes are loaded to.
    pub load_address: u32,
    /// The bytes that are loaded; none where memory is only cleared.
    pub bytes: &'a [u8],
    /// Where the program has it.
    pub address: u32,
    /// How many bytes it has there.
    pub size: u32,
}

impl Segment<'_> {
    /// The addresses that its bytes are loaded to.
    pub fn loaded(&self) -> Range<u32> {
        self.load_address..self.load_address.saturating_add(self.bytes.len() as u32)
    }
}

/// The segments of an ELF file.
pub fn segments(image: &[u8]) -> Result<Vec<Segment<'_>>> {
    let header = FileHeader32::<LittleEndian>::parse(image).context("this is no ELF file")?;
    let endian = header.endian()?;
    let all = header.program_headers(endian, image)?.iter();
    let loaded = all.filter(|segment| segment.p_type(endian) == PT_LOAD);
    loaded
        .map(|segment| {
            let bytes = segment.data(endian, image);
            Ok(Segment {
                load_address: segment.p_paddr(endian),
                bytes: bytes.map_err(|()| anyhow!("a segment is not in the file"))?,
                address: segment.p_vaddr(endian),
                size: segment.p_memsz(endian),
            })
        })
        .collect()
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
        let start = (offset + symbol.address() - section.address()) as usize;
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
