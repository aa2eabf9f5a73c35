//! The step rate that a firmware is proven for, in its image: `static PROVEN` of `src/board/proven.rs`.

use std::{ops::Range, path::Path};

use anyhow::{Context, Result, ensure};
use boards::compile;
use object::{Object, ObjectSection, ObjectSymbol};

/// The symbol of the two words, the mark and the rate in Hz.
const SYMBOL: &str = "PROVEN";
/// The mark.
const MARK: [u8; 4] = *b"PROV";

/// What an image says that it is proven for, Hz; 0: for nothing.
pub fn read(elf: &Path) -> Result<u32> {
    let image = compile::read(elf)?;
    let place = place(&image).with_context(|| format!("{}", elf.display()))?;
    let word = image[place].first_chunk().context("half a word")?;
    Ok(u32::from_le_bytes(*word))
}

/// Writes what is proven into an image.
pub fn write(image: &mut [u8], hz: u32) -> Result<()> {
    let place = place(image)?;
    image[place].copy_from_slice(&hz.to_le_bytes());
    Ok(())
}

/// Where in the file the rate is.
fn place(image: &[u8]) -> Result<Range<usize>> {
    let file = object::File::parse(image).context("this is no ELF file")?;
    let symbol = file.symbols().find(|symbol| symbol.name() == Ok(SYMBOL));
    let symbol = symbol.with_context(|| format!("the image has no symbol {SYMBOL}"))?;
    let section = symbol.section_index().context("it is in no section")?;
    let section = file.section_by_index(section)?;
    let (offset, _) = section.file_range().context("it is not in the file")?;
    let start = (offset + symbol.address() - section.address()) as usize;
    let mark = image.get(start..start + MARK.len());
    ensure!(
        mark == Some(&MARK),
        "the image has another mark at {SYMBOL}: it is not one of this version"
    );
    let rate = start + MARK.len()..start + 2 * MARK.len();
    ensure!(rate.end <= image.len(), "the image ends within {SYMBOL}");
    Ok(rate)
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
        let before = image(SYMBOL, b"PROV\0\0\0\0");
        let mut after = before.clone();
        write(&mut after, 0x0001_2345).unwrap();
        let rate = &after[place(&after).unwrap()];
        assert_eq!(rate, [0x45, 0x23, 0x01, 0x00]);
        let differing = before.iter().zip(&after).filter(|(a, b)| a != b);
        assert_eq!(differing.count(), 3);
        assert_eq!(before.len(), after.len());
    }

    #[test]
    fn an_image_without_the_place_is_refused_with_the_reason() {
        for (mut image, reason) in [
            (image("OTHER", b"PROV\0\0\0\0"), "has no symbol PROVEN"),
            (image(SYMBOL, b"DONE\0\0\0\0"), "another mark"),
            (b"no image".to_vec(), "no ELF file"),
        ] {
            let before = image.clone();
            let error = write(&mut image, 1).unwrap_err().to_string();
            assert!(error.contains(reason), "{error}");
            assert_eq!(image, before);
        }
    }
}
