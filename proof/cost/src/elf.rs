//! The parts of a program file that the profile needs: functions and the vector table.

use object::{Endianness, Object, ObjectSection, ObjectSymbol, SymbolKind, read::elf::ElfFile32};

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

/// A 32-bit ELF file.
pub struct Program {
    /// Functions in order of address, one per address.
    pub functions: Vec<Function>,
    /// Addresses of the exception handlers, from vector 2 on; 0 where there is none.
    pub handlers: Vec<u32>,
}

impl Program {
    /// Reads a program.
    ///
    /// # Errors
    ///
    /// Says what is wrong when this is not such a file or it has no vector table.
    pub fn parse(file: &[u8]) -> Result<Self, String> {
        let file = ElfFile32::<Endianness>::parse(file).map_err(|error| error.to_string())?;
        let functions = file
            .symbols()
            .filter(|symbol| symbol.kind() == SymbolKind::Text);
        let mut functions: Vec<_> = functions
            .map(|symbol| Function {
                address: symbol.address() as u32 & !1,
                size: symbol.size() as u32,
                name: symbol.name().unwrap_or_default().to_owned(),
            })
            .collect();
        // Of several names for one address the longest function's, then the alphabet's first.
        functions.sort_by(|a, b| (a.address, b.size, &a.name).cmp(&(b.address, a.size, &b.name)));
        functions.dedup_by_key(|function| function.address);
        let vectors = file
            .section_by_name(".vector_table")
            .ok_or("no section .vector_table")?
            .data()
            .map_err(|error| error.to_string())?;
        let (vectors, _) = vectors.as_chunks::<4>();
        Ok(Self {
            functions,
            handlers: vectors
                .iter()
                .skip(2)
                .map(|vector| u32::from_le_bytes(*vector) & !1)
                .collect(),
        })
    }

    /// The function that holds `address`, as an index of [`Self::functions`].
    pub fn function_at(&self, address: u32) -> Option<usize> {
        let after = self
            .functions
            .partition_point(|function| function.address <= address);
        let index = after.checked_sub(1)?;
        let function = self.functions.get(index)?;
        (address - function.address < function.size.max(2)).then_some(index)
    }
}
