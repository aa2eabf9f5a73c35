//! Source lines of instructions, from the debug information.

use std::{
    cell::RefCell,
    collections::{HashMap, HashSet},
    rc::Rc,
};

use addr2line::Context;
use gimli::{EndianRcSlice, EndianSlice, LittleEndian};
use object::{Object, ObjectSection};

use super::Frame;
use crate::memo::memoised;

/// See the module. Answers are remembered.
pub(super) struct Lines {
    context: Context<EndianRcSlice<LittleEndian>>,
    /// Where the project was compiled.
    root: Option<String>,
    known: RefCell<HashMap<u32, Rc<[Frame]>>>,
    texts: RefCell<HashSet<Rc<str>>>,
    /// Names of functions, by those that the linker knows.
    functions: RefCell<HashMap<String, Rc<str>>>,
    /// Paths as they are shown, by what the debug information says.
    paths: RefCell<HashMap<String, Rc<str>>>,
}

impl Lines {
    pub(super) fn load(file: &object::read::elf::ElfFile32<'_>) -> Result<Self, String> {
        let context = context(file).map_err(|error| error.to_string())?;
        Ok(Self {
            context,
            root: root(file).map_err(|error| error.to_string())?,
            known: RefCell::default(),
            texts: RefCell::default(),
            functions: RefCell::default(),
            paths: RefCell::default(),
        })
    }

    pub(super) fn frames(&self, address: u32) -> Rc<[Frame]> {
        memoised(&self.known, address, || {
            self.find(address).unwrap_or_default().into()
        })
    }

    fn find(&self, address: u32) -> Option<Vec<Frame>> {
        let mut found = self
            .context
            .find_frames(address.into())
            .skip_all_loads()
            .ok()?;
        let mut frames = Vec::new();
        while let Ok(Some(frame)) = found.next() {
            let name = frame
                .function
                .as_ref()
                .and_then(|name| Some(self.demangled(&name.raw_name().ok()?)));
            let (file, line) = match &frame.location {
                Some(location) => (
                    location.file.unwrap_or_default(),
                    location.line.unwrap_or(0),
                ),
                None => ("", 0),
            };
            frames.push(Frame {
                function: name.unwrap_or_else(|| "".into()),
                file: self.path(file),
                line,
            });
        }
        Some(frames)
    }

    /// A function's name as in the source.
    fn demangled(&self, mangled: &str) -> Rc<str> {
        memoised(&self.functions, mangled.to_owned(), || {
            self.text(&format!("{:#}", rustc_demangle::demangle(mangled)))
        })
    }

    /// One copy of each text.
    fn text(&self, text: &str) -> Rc<str> {
        let mut texts = self.texts.borrow_mut();
        if let Some(known) = texts.get(text) {
            return Rc::clone(known);
        }
        let new: Rc<str> = text.into();
        texts.insert(Rc::clone(&new));
        new
    }

    fn path(&self, file: &str) -> Rc<str> {
        memoised(&self.paths, file.to_owned(), || {
            self.text(shorten(file, self.root.as_deref()))
        })
    }
}

/// The debug information of a file.
fn context(
    file: &object::read::elf::ElfFile32<'_>,
) -> Result<Context<EndianRcSlice<LittleEndian>>, gimli::Error> {
    let dwarf = gimli::Dwarf::load(|section| {
        let found = file.section_by_name(section.name());
        let data = found.and_then(|section| section.uncompressed_data().ok());
        let data: Rc<[u8]> = data.unwrap_or_default().into();
        Ok::<_, gimli::Error>(EndianRcSlice::new(data, LittleEndian))
    })?;
    Context::from_dwarf(dwarf)
}

/// A path from the project's root, or from above the crate that it belongs to.
fn shorten<'a>(file: &'a str, root: Option<&str>) -> &'a str {
    let own = root.and_then(|root| file.strip_prefix(root));
    if let Some(own) = own.and_then(|own| own.strip_prefix('/')) {
        return own;
    }
    if let Some((_, crates)) = file.split_once("/registry/src/") {
        return crates.split_once('/').map_or(crates, |(_, path)| path);
    }
    if file.starts_with("/rustc/") || file.contains("/rustlib/") {
        return file.split_once("/library/").map_or(file, |(_, path)| path);
    }
    file
}

/// Where the units were compiled that the compiler was given by a relative path: the project's.
fn root(file: &object::read::elf::ElfFile32<'_>) -> Result<Option<String>, gimli::Error> {
    let sections = gimli::DwarfSections::load(|section| {
        let found = file.section_by_name(section.name());
        let data = found.and_then(|section| section.uncompressed_data().ok());
        Ok::<_, gimli::Error>(data.unwrap_or_default())
    })?;
    let dwarf = sections.borrow(|data| EndianSlice::new(data, LittleEndian));
    let mut units = dwarf.units();
    while let Some(header) = units.next()? {
        let unit = dwarf.unit(header)?;
        let (Some(name), Some(folder)) = (unit.name, unit.comp_dir) else {
            continue;
        };
        let (name, folder) = (name.to_string_lossy(), folder.to_string_lossy());
        if !name.starts_with('/') && !folder.starts_with("/rustc/") {
            return Ok(Some(folder.into_owned()));
        }
    }
    Ok(None)
}
