//! A program file: its memory, functions, vectors and source lines.
//!
//! Code that is executed from RAM is found at the address where it runs; [`Image::load_address`]
//! gives its place in the file.

mod lines;

use std::{
    collections::{BTreeMap, HashMap},
    fmt, fs,
    ops::Range,
    path::Path,
    rc::Rc,
};

use lines::Lines;
use object::{
    Endianness, Object, ObjectSection, ObjectSymbol, SymbolKind,
    elf::PT_LOAD,
    read::elf::{ElfFile32, ProgramHeader},
};

use crate::{Flaw, Place, Rule};

/// The place of a function, from its symbol.
#[derive(Debug, Clone, PartialEq, Eq)]
pub struct Extent {
    /// Address of its first instruction.
    pub address: u32,
    /// Length in bytes, with its tables and constants.
    pub size: u32,
    /// Its demangled name.
    pub name: String,
}

impl Extent {
    /// The address after its end.
    pub const fn end(&self) -> u32 {
        self.address + self.size
    }
}

/// A function's name and line at an instruction.
#[derive(Debug, Clone, PartialEq, Eq, Hash, PartialOrd, Ord)]
pub struct Frame {
    /// Its demangled name, without the hash.
    pub function: Rc<str>,
    /// The file, from the project's root; of a library: from its crate's root, with its name.
    pub file: Rc<str>,
    /// The line; 0: none.
    pub line: u32,
}

impl fmt::Display for Frame {
    fn fmt(&self, f: &mut fmt::Formatter<'_>) -> fmt::Result {
        write!(f, "{} ({}:{})", self.function, self.file, self.line)
    }
}

/// A part of memory that the file loads.
#[derive(Debug, Clone)]
struct Segment {
    address: u32,
    load_address: u32,
    bytes: Vec<u8>,
    /// With what is cleared at start-up.
    size: u32,
}

impl Segment {
    fn range(&self) -> Range<u32> {
        self.address..self.address.saturating_add(self.size)
    }
}

/// See the module.
pub struct Image {
    segments: Vec<Segment>,
    functions: BTreeMap<u32, Extent>,
    symbols: HashMap<String, u32>,
    /// `$d` and `$t` marks: whether code begins there.
    marks: BTreeMap<u32, bool>,
    vectors: Vec<u32>,
    /// Where the section of code is.
    text: Range<u32>,
    lines: Lines,
}

impl Image {
    /// Reads an ELF file.
    ///
    /// # Errors
    ///
    /// Says what is wrong when it cannot be read, or is no 32-bit little-endian ELF file with
    /// symbols and a section `.vector_table`.
    pub fn load(path: &Path) -> Result<Self, String> {
        let bytes = fs::read(path).map_err(|error| failed(path, error))?;
        let file = ElfFile32::<Endianness>::parse(&*bytes).map_err(|error| failed(path, error))?;
        if !file.is_little_endian() {
            return Err(failed(path, "it is big-endian"));
        }
        let segments = segments(&file).map_err(|error| failed(path, error))?;
        let vectors = file
            .section_by_name(".vector_table")
            .ok_or_else(|| failed(path, "it has no section .vector_table"))?
            .data()
            .map_err(|error| failed(path, error))?
            .as_chunks()
            .0
            .iter()
            .map(|&word| u32::from_le_bytes(word))
            .collect();
        let text = file.section_by_name(".text").map_or(0..0, |section| {
            let begin = section.address() as u32;
            begin..begin.saturating_add(section.size() as u32)
        });
        let mut image = Self {
            text,
            segments,
            functions: BTreeMap::new(),
            symbols: HashMap::new(),
            marks: BTreeMap::new(),
            vectors,
            lines: Lines::load(&file).map_err(|error| failed(path, error))?,
        };
        image.read_symbols(&file);
        if image.functions.is_empty() {
            return Err(failed(path, "it has no symbols of functions"));
        }
        Ok(image)
    }

    fn read_symbols(&mut self, file: &ElfFile32<'_>) {
        let mut sizeless = Vec::new();
        for symbol in file.symbols() {
            let Ok(name) = symbol.name() else { continue };
            let address = symbol.address() as u32;
            let is_data = name == "$d" || name.starts_with("$d.");
            if is_data || name == "$t" || name.starts_with("$t.") {
                let code = self.marks.entry(address).or_insert(!is_data);
                *code &= !is_data;
                continue;
            }
            if symbol.is_undefined() || name.is_empty() {
                continue;
            }
            if symbol.kind() != SymbolKind::Text {
                self.symbols.insert(name.to_owned(), address);
                continue;
            }
            let address = address & !1;
            self.symbols.insert(name.to_owned(), address);
            if symbol.size() == 0 {
                sizeless.push((address, name));
                continue;
            }
            let extent = Extent {
                address,
                size: symbol.size() as u32,
                name: demangle(name),
            };
            // Of several names for one address the longest function's, then the alphabet's first.
            let known = self.functions.get(&address);
            if known.is_none_or(|known| (extent.size, &known.name) > (known.size, &extent.name)) {
                self.functions.insert(address, extent);
            }
        }
        for (address, name) in sizeless {
            self.add_sizeless(address, name);
        }
    }

    /// A function whose symbol has no size ends where the next begins, or its segment ends.
    fn add_sizeless(&mut self, address: u32, name: &str) {
        if self.function(address).is_some() {
            return;
        }
        let next = self
            .functions
            .range(address..)
            .next()
            .map(|(&next, _)| next);
        let segment = self.segment(address).map(|segment| segment.range().end);
        if let Some(end) = next.into_iter().chain(segment).min() {
            let extent = Extent {
                address,
                size: end - address,
                name: demangle(name),
            };
            self.functions.insert(address, extent);
        }
    }

    fn segment(&self, address: u32) -> Option<&Segment> {
        self.segments
            .iter()
            .find(|segment| segment.range().contains(&address))
    }

    /// Memory from `address` on, as it is at the start of `main`.
    fn bytes<const N: usize>(&self, address: u32) -> Option<[u8; N]> {
        let segment = self.segment(address)?;
        let offset = (address - segment.address) as usize;
        let stored = segment.bytes.get(offset..).unwrap_or(&[]);
        match stored.first_chunk::<N>() {
            Some(bytes) => Some(*bytes),
            // Cleared at start-up.
            None if stored.is_empty() => Some([0; N]),
            None => None,
        }
    }

    /// The byte at `address`.
    pub fn byte(&self, address: u32) -> Option<u8> {
        self.bytes(address).map(u8::from_le_bytes)
    }

    /// The half-word at `address`.
    pub fn half(&self, address: u32) -> Option<u16> {
        self.bytes(address).map(u16::from_le_bytes)
    }

    /// The word at `address`.
    pub fn word(&self, address: u32) -> Option<u32> {
        self.bytes(address).map(u32::from_le_bytes)
    }

    /// All aligned words that the file puts into memory.
    pub(crate) fn words(&self) -> impl Iterator<Item = u32> {
        let chunks = self
            .segments
            .iter()
            .flat_map(|segment| segment.bytes.as_chunks().0);
        chunks.map(|&word| u32::from_le_bytes(word))
    }

    /// The halves of the instruction at `address`; the second is 0 where memory ends.
    pub fn code(&self, address: u32) -> Option<[u16; 2]> {
        let first = self.half(address)?;
        Some([first, self.half(address.wrapping_add(2)).unwrap_or(0)])
    }

    /// Where the contents of `address` are stored in the chip: what is copied to RAM at start-up
    /// is in flash.
    pub fn load_address(&self, address: u32) -> Option<u32> {
        let segment = self.segment(address)?;
        Some(segment.load_address + (address - segment.address))
    }

    /// The addresses of RAM that the file gives contents or clears.
    pub fn ram(&self) -> impl Iterator<Item = Range<u32>> {
        self.segments
            .iter()
            .map(Segment::range)
            .filter(|range| range.start >= 0x1000_0000)
    }

    /// The words of the vector table: the stack's top first, then the handlers.
    pub fn vectors(&self) -> &[u32] {
        &self.vectors
    }

    /// The address of a symbol, by its name in the file; of a function without the Thumb bit.
    pub fn symbol(&self, name: &str) -> Option<u32> {
        self.symbols.get(name).copied()
    }

    /// All symbols but marks: name and address.
    pub fn symbols(&self) -> impl Iterator<Item = (&str, u32)> {
        self.symbols
            .iter()
            .map(|(name, &address)| (name.as_str(), address))
    }

    /// The function that holds `address`.
    pub fn function(&self, address: u32) -> Option<&Extent> {
        let (_, extent) = self.functions.range(..=address).next_back()?;
        (address < extent.end()).then_some(extent)
    }

    /// All functions in the order of their addresses.
    pub fn functions(&self) -> impl Iterator<Item = &Extent> {
        self.functions.values()
    }

    /// The name of the function that holds `address`.
    pub fn name(&self, address: u32) -> String {
        match self.function(address) {
            Some(extent) => extent.name.clone(),
            None => format!("{address:#010x}"),
        }
    }

    /// Whether what is at `address` is data in the middle of code: constants, a jump table.
    pub fn is_data(&self, address: u32) -> bool {
        let mark = self.marks.range(..=address).next_back();
        mark.is_some_and(|(_, &is_code)| !is_code)
    }

    /// The ranges of code: between the marks of data in the section of code, and functions outside of it.
    pub(crate) fn code_ranges(&self) -> Vec<Range<u32>> {
        let mut marks = self.marks.range(self.text.clone()).peekable();
        let mut ranges = Vec::new();
        while let Some((&start, &is_code)) = marks.next() {
            let end = marks.peek().map_or(self.text.end, |next| *next.0);
            if is_code {
                ranges.push(start..end);
            }
        }
        let elsewhere = self.functions.values();
        let elsewhere = elsewhere.filter(|it| !self.text.contains(&it.address));
        ranges.extend(elsewhere.map(|extent| extent.address..extent.end()));
        ranges
    }

    /// Where code continues after the data at `address`.
    pub fn data_end(&self, address: u32) -> Option<u32> {
        let mut marks = self.marks.range(address..);
        marks.find(|&(_, &is_code)| is_code).map(|(&end, _)| end)
    }

    /// The source lines of an instruction: that of the innermost inlined function first.
    pub fn frames(&self, address: u32) -> Rc<[Frame]> {
        self.lines.frames(address)
    }

    /// The place of an instruction for a message.
    pub fn place(&self, address: u32) -> Place {
        let mut frames: Vec<String> = self
            .frames(address)
            .iter()
            .map(ToString::to_string)
            .collect();
        if frames.is_empty() {
            frames.push(self.name(address));
        }
        Place { address, frames }
    }

    /// A flaw at an address.
    pub(crate) fn flaw(
        &self,
        rule: Rule,
        address: u32,
        what: impl Into<String>,
        remedy: impl Into<String>,
    ) -> Flaw {
        Flaw::new(rule, what, self.place(address), remedy)
    }
}

fn failed(path: &Path, error: impl fmt::Display) -> String {
    format!("{}: {error}", path.display())
}

/// A name as it is in the source.
fn demangle(name: &str) -> String {
    format!("{:#}", rustc_demangle::demangle(name))
}

fn segments(file: &ElfFile32<'_>) -> Result<Vec<Segment>, &'static str> {
    let endian = file.endian();
    let headers = file.elf_program_headers().iter();
    headers
        .filter(|header| header.p_type(endian) == PT_LOAD && header.p_memsz(endian) != 0)
        .map(|header| {
            let bytes = header.data(endian, file.data());
            Ok(Segment {
                address: header.p_vaddr(endian),
                load_address: header.p_paddr(endian),
                bytes: bytes.map_err(|()| "a segment is cut off")?.to_vec(),
                size: header.p_memsz(endian),
            })
        })
        .collect()
}
