//! What is in the image of a firmware: the step rate that it is proven for, `static PROVEN` of `src/board/proven.rs`,
//! and its compiler.

use std::path::Path;

use crate::boards::{compile, image::PatchedWords, seal};
use anyhow::{Context, Result};
use object::{File, Object, ObjectSection};

/// The mark and the rate, Hz.
const PROVEN: PatchedWords = PatchedWords {
    symbol: "PROVEN",
    marks: &[*b"PROV"],
};

/// What an image says that it is proven for, Hz; 0: for nothing.
pub fn read(elf: &Path) -> Result<u32> {
    let image = compile::read(elf)?;
    let words = PROVEN.place(&image);
    let words = words.with_context(|| format!("{}", elf.display()))?;
    let rate = image[words].last_chunk().context("half a word")?;
    Ok(u32::from_le_bytes(*rate))
}

/// Writes what is proven into an image, and its CRC.
pub fn write(image: &mut [u8], hz: u32) -> Result<()> {
    write_rate(image, hz)?;
    seal::seal(image)
}

fn write_rate(image: &mut [u8], hz: u32) -> Result<()> {
    let words = PROVEN.place(image)?;
    image[words.start + 4..words.end].copy_from_slice(&hz.to_le_bytes());
    Ok(())
}

/// The compiler that made a program, as it signs.
pub fn compiler(elf: &Path) -> Result<String> {
    let image = compile::read(elf)?;
    let file = File::parse(&*image).with_context(|| format!("{} is no ELF file", elf.display()))?;
    let section = file.section_by_name(".comment");
    let section = section.context("the ELF names no compiler")?;
    let signatures = String::from_utf8_lossy(section.data()?);
    let mut signatures = signatures.split('\0');
    let rustc = signatures.find(|it| it.starts_with("rustc"));
    Ok(rustc.context("the ELF names no rustc")?.to_owned())
}

#[cfg(test)]
mod tests {
    use object::{
        Architecture, BinaryFormat, Endianness, SectionKind, SymbolFlags, SymbolKind, SymbolScope,
        write::{Object as Written, Symbol, SymbolSection},
    };

    use super::*;

    /// An ELF file with these bytes behind some others, under a name.
    fn image(name: &str, bytes: &[u8]) -> Vec<u8> {
        let mut file = Written::new(BinaryFormat::Elf, Architecture::Arm, Endianness::Little);
        let section = file.add_section(Vec::new(), b".rodata".to_vec(), SectionKind::ReadOnlyData);
        file.append_section_data(section, &[0xaa; 20], 4);
        let value = file.append_section_data(section, bytes, 4);
        file.add_symbol(Symbol {
            name: name.into(),
            value,
            size: bytes.len() as u64,
            kind: SymbolKind::Data,
            scope: SymbolScope::Linkage,
            weak: false,
            section: SymbolSection::Section(section),
            flags: SymbolFlags::None,
        });
        file.write().unwrap()
    }

    #[test]
    fn the_rate_is_written_where_it_is_read_and_nowhere_else() {
        let before = image(PROVEN.symbol, b"PROV\0\0\0\0");
        let mut after = before.clone();
        write_rate(&mut after, 0x0001_2345).unwrap();
        let words = &after[PROVEN.place(&after).unwrap()];
        assert_eq!(words, b"PROV\x45\x23\x01\x00");
        let differing = before.iter().zip(&after).filter(|(a, b)| a != b);
        assert_eq!(differing.count(), 3);
        assert_eq!(before.len(), after.len());
    }

    #[test]
    fn an_image_without_the_place_is_refused_with_the_reason() {
        for (mut image, reason) in [
            (image("OTHER", b"PROV\0\0\0\0"), "has no symbol PROVEN"),
            (image(PROVEN.symbol, b"DONE\0\0\0\0"), "another mark"),
            (b"no image".to_vec(), "no ELF file"),
        ] {
            let before = image.clone();
            let error = write_rate(&mut image, 1).unwrap_err().to_string();
            assert!(error.contains(reason), "{error}");
            assert_eq!(image, before);
        }
    }
}
