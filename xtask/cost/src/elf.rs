//! What the profile need of a program file: functions, data marks, code and the vector table.

/// A named function.
#[derive(Debug, Clone, PartialEq, Eq)]
pub struct Function {
    /// Address of its first instruction.
    pub address: u32,
    /// Length in bytes.
    pub size: u32,
    /// Name as the linker knows it.
    pub name: String,
}

/// A 32-bit little-endian ELF file.
pub struct Program {
    /// Functions in order of address, one per address.
    pub functions: Vec<Function>,
    /// `$t` and `$d` marks in order of address: whether code begins there.
    pub marks: Vec<(u32, bool)>,
    /// Addresses of the exception handlers, from vector 2 on; 0 where there is none.
    pub handlers: Vec<u32>,
    /// Executable sections: address and contents.
    pub code: Vec<(u32, Vec<u8>)>,
}

/// One section header.
struct Section<'a> {
    name: &'a str,
    kind: u32,
    flags: u32,
    address: u32,
    contents: &'a [u8],
    link: usize,
}

impl Program {
    /// Reads a program.
    ///
    /// # Errors
    ///
    /// Says what is wrong when this is not such a file or it has no symbols or vector table.
    pub fn parse(file: &[u8]) -> Result<Self, String> {
        const PROGRAM_BITS: u32 = 1;
        const SYMBOLS: u32 = 2;
        const EXECUTABLE: u32 = 4;
        if file.get(..6) != Some(&[0x7f, b'E', b'L', b'F', 1, 1]) {
            return Err("not a 32-bit little-endian ELF file".into());
        }
        let sections = sections(file).ok_or("damaged section headers")?;
        let table = sections
            .iter()
            .find(|section| section.kind == SYMBOLS)
            .ok_or("no symbol table")?;
        let names = sections.get(table.link).ok_or("no symbol names")?.contents;
        let (functions, marks) = symbols(table.contents, names).ok_or("damaged symbols")?;
        let handlers = sections
            .iter()
            .find(|section| section.name == ".vector_table")
            .ok_or("no section .vector_table")?
            .contents
            .chunks_exact(4)
            .skip(2)
            .map(|vector| word(vector, 0).unwrap_or(0) & !1)
            .collect();
        let code = sections
            .iter()
            .filter(|section| section.kind == PROGRAM_BITS && section.flags & EXECUTABLE != 0)
            .map(|section| (section.address, section.contents.to_vec()))
            .collect();
        Ok(Self {
            functions,
            marks,
            handlers,
            code,
        })
    }

    /// The function that holds `address`, as an index of [`Self::functions`].
    #[must_use]
    pub fn function_at(&self, address: u32) -> Option<usize> {
        let after = self
            .functions
            .partition_point(|function| function.address <= address);
        let index = after.checked_sub(1)?;
        let function = self.functions.get(index)?;
        (address - function.address < function.size.max(2)).then_some(index)
    }

    /// The address of the function called `name`.
    #[must_use]
    pub fn address_of(&self, name: &str) -> Option<u32> {
        self.functions
            .iter()
            .find(|function| function.name == name)
            .map(|function| function.address)
    }
}

fn word(bytes: &[u8], at: usize) -> Option<u32> {
    let bytes = bytes.get(at..)?.first_chunk::<4>()?;
    Some(u32::from_le_bytes(*bytes))
}

fn half(bytes: &[u8], at: usize) -> Option<u16> {
    let bytes = bytes.get(at..)?.first_chunk::<2>()?;
    Some(u16::from_le_bytes(*bytes))
}

/// The zero-terminated text at `at`.
fn text(names: &[u8], at: u32) -> Option<&str> {
    let rest = names.get(at as usize..)?;
    let end = rest.iter().position(|&byte| byte == 0)?;
    str::from_utf8(&rest[..end]).ok()
}

fn sections(file: &[u8]) -> Option<Vec<Section<'_>>> {
    const NO_CONTENTS: u32 = 8;
    let start = word(file, 32)? as usize;
    let size = usize::from(half(file, 46)?);
    let count = usize::from(half(file, 48)?);
    let names_index = usize::from(half(file, 50)?);
    let header = |index: usize| file.get(start + index * size..);
    let contents = |header: &[u8]| {
        if word(header, 4)? == NO_CONTENTS {
            return Some(&file[..0]);
        }
        let offset = word(header, 16)? as usize;
        file.get(offset..offset.checked_add(word(header, 20)? as usize)?)
    };
    let names = contents(header(names_index)?)?;
    (0..count)
        .map(|index| {
            let header = header(index)?;
            Some(Section {
                name: text(names, word(header, 0)?)?,
                kind: word(header, 4)?,
                flags: word(header, 8)?,
                address: word(header, 12)?,
                contents: contents(header)?,
                link: word(header, 24)? as usize,
            })
        })
        .collect()
}

type Symbols = (Vec<Function>, Vec<(u32, bool)>);

fn symbols(table: &[u8], names: &[u8]) -> Option<Symbols> {
    const FUNCTION: u8 = 2;
    let mut functions = Vec::new();
    let mut marks = Vec::new();
    for symbol in table.chunks_exact(16) {
        let name = text(names, word(symbol, 0)?)?;
        let address = word(symbol, 4)?;
        if name.starts_with("$t") {
            marks.push((address, true));
        } else if name.starts_with("$d") {
            marks.push((address, false));
        } else if symbol[12] & 15 == FUNCTION {
            functions.push(Function {
                address: address & !1,
                size: word(symbol, 8)?,
                name: name.to_owned(),
            });
        }
    }
    // Of several names for one address the longest function's, then the alphabet's first.
    functions.sort_by(|a, b| (a.address, b.size, &a.name).cmp(&(b.address, a.size, &b.name)));
    functions.dedup_by_key(|function| function.address);
    marks.sort_unstable();
    Some((functions, marks))
}
