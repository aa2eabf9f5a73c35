//! A program, and where its instructions are in the sources.

use std::path::Path;

use addr2line::{
    Context, gimli,
    gimli::{EndianSlice, LittleEndian},
};
use anyhow::{Context as _, Result};
use object::{Object as _, ObjectSection as _, ObjectSymbol as _, SymbolKind};

/// A program.
#[derive(Debug)]
pub(crate) struct Program {
    /// The functions by address, with their names.
    functions: Vec<(u64, String)>,
    /// What is loaded: the first address of each segment, and its bytes.
    pub(crate) segments: Vec<(u64, Vec<u8>)>,
}

impl Program {
    /// Reads an ELF file.
    pub(crate) fn read(path: &Path) -> Result<Self> {
        let bytes =
            std::fs::read(path).with_context(|| format!("cannot read {}", path.display()))?;
        let file = object::File::parse(&*bytes).context("this is no ELF file")?;
        let symbols = file.symbols().filter(|it| it.kind() == SymbolKind::Text);
        let functions = symbols.map(|symbol| {
            let name = symbol.name().unwrap_or_default();
            // The lowest bit says that the code is Thumb.
            (symbol.address() & !1, name.to_owned())
        });
        let mut functions: Vec<_> = functions.collect();
        functions.sort();
        Ok(Self {
            functions,
            segments: segments(&bytes)?,
        })
    }

    /// Whether an address is in what is loaded.
    pub(crate) fn holds(&self, address: u64) -> bool {
        let mut segments = self.segments.iter();
        segments.any(|(start, bytes)| (*start..start + bytes.len() as u64).contains(&address))
    }

    /// The address of a function, by its name.
    pub(crate) fn function(&self, name: &str) -> Option<u64> {
        let mut functions = self.functions.iter();
        functions.find(|it| it.1 == name).map(|it| it.0)
    }

    /// Whether a function has this in its name.
    pub(crate) fn names(&self, part: &str) -> bool {
        let mut functions = self.functions.iter();
        functions.any(|it| it.1.contains(part))
    }

    /// The name of the function at an address.
    pub(crate) fn name_at(&self, address: u64) -> Option<&str> {
        let mut functions = self.functions.iter();
        functions.find(|it| it.0 == address).map(|it| it.1.as_str())
    }

    /// A word of what is loaded.
    pub(crate) fn word(&self, address: u64) -> Option<u32> {
        let holding = |(start, bytes): &(u64, Vec<u8>)| {
            let offset = usize::try_from(address.checked_sub(*start)?).ok()?;
            let word = bytes.get(offset..offset + 4)?;
            word.try_into().ok().map(u32::from_le_bytes)
        };
        self.segments.iter().find_map(holding)
    }
}

/// The debug information of a program.
pub(crate) struct Lines(Context<EndianSlice<'static, LittleEndian>>);

impl Lines {
    /// Reads an ELF file.
    pub(crate) fn read(path: &Path) -> Result<Self> {
        let bytes =
            std::fs::read(path).with_context(|| format!("cannot read {}", path.display()))?;
        let file = object::File::parse(&*bytes).context("this is no ELF file")?;
        let load = |id: gimli::SectionId| -> Result<_> {
            // It lives as long as this program.
            let data: &'static [u8] = match file.section_by_name(id.name()) {
                Some(section) => section.uncompressed_data()?.into_owned().leak(),
                None => &[],
            };
            Ok(EndianSlice::new(data, LittleEndian))
        };
        Ok(Self(Context::from_dwarf(gimli::Dwarf::load(load)?)?))
    }

    /// Where the instruction at an address is: `function, file:line`, the innermost first.
    pub(crate) fn describe(&self, address: u64) -> String {
        let mut places = Vec::new();
        if let Ok(mut frames) = self.0.find_frames(address).skip_all_loads() {
            while let Ok(Some(frame)) = frames.next() {
                let name = frame.function.as_ref().and_then(|name| {
                    let name = name.demangle().ok()?;
                    Some(name.rsplit("::").nth(1).unwrap_or_default().to_owned())
                });
                let location = frame.location.and_then(|it| Some((it.file?, it.line?)));
                let Some((file, line)) = location else {
                    continue;
                };
                // Of the project alone: what it has inlined from libraries tells little.
                if let Some(at) = file.rfind("src/").filter(|_| is_own(file)) {
                    let name = name.unwrap_or_default();
                    places.push(format!("{name}, {}:{line}", &file[at..]));
                }
            }
        }
        if places.is_empty() {
            return format!("{address:#x}");
        }
        places.truncate(3);
        format!("{address:#x}: {}", places.join(", from "))
    }
}

/// Whether a source file is the project's: what Cargo or the compiler has brought lies in folders of theirs.
fn is_own(file: &str) -> bool {
    !file.contains("/registry/src/") && !file.contains("/library/") && !file.contains("src/rust/")
}

/// What a loader writes into memory, by physical addresses.
fn segments(bytes: &[u8]) -> Result<Vec<(u64, Vec<u8>)>> {
    use object::read::elf::{ElfFile32, ProgramHeader as _};
    let file: ElfFile32<'_, object::Endianness> = ElfFile32::parse(bytes)?;
    let endian = file.endian();
    let mut segments = Vec::new();
    for header in file.elf_program_headers() {
        if header.p_type(endian) == object::elf::PT_LOAD && header.p_filesz(endian) > 0 {
            let data = header.data(endian, bytes);
            let data = data.ok().context("a segment lies outside of the file")?;
            segments.push((u64::from(header.p_paddr(endian)), data.to_vec()));
        }
    }
    Ok(segments)
}
