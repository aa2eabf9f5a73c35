//! `cargo xtask size`: how much of the chip the firmware takes.

use std::{fs, path::Path, process::ExitCode};

use anstream::println;
use anyhow::{Context, Result, ensure};
use object::{Object, ObjectSection, SectionFlags, elf};
use owo_colors::OwoColorize;

use boards::compile;
use common::cargo;

/// Build the firmware and show how much flash and RAM it takes
///
/// The memory is that of `memory.x`: what the smallest supported chip has. RAM is what is taken
/// statically; the rest is the stack's.
#[derive(clap::Args)]
pub(crate) struct Options {
    /// The board; every board without it
    #[arg(long, value_name = "NAME")]
    board: Option<String>,
}

pub(crate) fn run(options: &Options) -> Result<ExitCode> {
    let script = cargo::root().join("memory.x");
    let text =
        fs::read_to_string(&script).with_context(|| format!("cannot read {}", script.display()))?;
    let memory = Memory::parse(&text)?;
    let mut rows = Vec::new();
    for board in boards::chosen(options.board.as_deref())? {
        let usage = Usage::of(&compile::firmware(&board)?, &memory)?;
        rows.push((board.name, usage));
    }
    let head = format!("{:<20}{:>28}{:>28}", "board", "flash", "RAM");
    println!("{}", head.bold());
    let mut fits = true;
    for (name, usage) in &rows {
        let flash = share(usage.flash, memory.flash.length);
        let ram = share(usage.ram, memory.ram.length);
        println!("{name:<20}{flash:>28}{ram:>28}");
        fits &= usage.flash <= memory.flash.length && usage.ram <= memory.ram.length;
    }
    ensure!(fits, "the firmware does not fit");
    Ok(ExitCode::SUCCESS)
}

/// `used of all, percent`.
fn share(used: u64, all: u64) -> String {
    let percent = used as f64 / all as f64 * 100.0;
    let kib = |bytes: u64| bytes as f64 / 1024.0;
    format!("{:.1} of {:.0} KiB {percent:>5.1} %", kib(used), kib(all))
}

/// One `MEMORY` region.
#[derive(Debug, PartialEq, Eq)]
struct Region {
    origin: u64,
    length: u64,
}

impl Region {
    fn holds(&self, address: u64) -> bool {
        (self.origin..self.origin + self.length).contains(&address)
    }
}

/// The regions of `memory.x`.
struct Memory {
    flash: Region,
    ram: Region,
}

impl Memory {
    fn parse(text: &str) -> Result<Self> {
        Ok(Self {
            flash: region(text, "FLASH")?,
            ram: region(text, "RAM")?,
        })
    }
}

/// Reads `NAME : ORIGIN = 0x…, LENGTH = …K`.
fn region(text: &str, name: &str) -> Result<Region> {
    let found = text.lines().find_map(|line| {
        let (head, rest) = line.split_once(':')?;
        (head.trim() == name).then_some(())?;
        let (origin, length) = rest.split_once(',')?;
        Some(Region {
            origin: number(origin.split_once('=')?.1)?,
            length: number(length.split_once('=')?.1)?,
        })
    });
    found.with_context(|| format!("memory.x has no `{name} : ORIGIN = …, LENGTH = …`"))
}

/// A number of a linker script: decimal or hexadecimal, with `K` or `M`.
fn number(text: &str) -> Option<u64> {
    let text = text.trim();
    let (digits, scale) = match text.as_bytes().last()? {
        b'K' => (&text[..text.len() - 1], 1024),
        b'M' => (&text[..text.len() - 1], 1024 * 1024),
        _ => (text, 1),
    };
    let value = match digits.strip_prefix("0x") {
        Some(hexadecimal) => u64::from_str_radix(hexadecimal, 16),
        None => digits.parse(),
    };
    value.ok()?.checked_mul(scale)
}

/// Bytes of each memory that a program takes.
struct Usage {
    flash: u64,
    ram: u64,
}

impl Usage {
    /// Adds up the allocated sections. Initialised data counts twice: its first values lie in
    /// flash.
    fn of(path: &Path, memory: &Memory) -> Result<Self> {
        let bytes = fs::read(path).with_context(|| format!("cannot read {}", path.display()))?;
        let file = object::File::parse(&*bytes)
            .with_context(|| format!("{} is no ELF file", path.display()))?;
        let mut usage = Self { flash: 0, ram: 0 };
        for section in file.sections() {
            let SectionFlags::Elf { sh_flags } = section.flags() else {
                continue;
            };
            if sh_flags & u64::from(elf::SHF_ALLOC) == 0 {
                continue;
            }
            let has_content = section.kind() != object::SectionKind::UninitializedData;
            if memory.ram.holds(section.address()) {
                usage.ram += section.size();
                usage.flash += if has_content { section.size() } else { 0 };
            } else if memory.flash.holds(section.address()) {
                usage.flash += section.size();
            }
        }
        Ok(usage)
    }
}

#[cfg(test)]
mod tests {
    use super::*;

    #[test]
    fn regions_are_read_from_the_linker_script() {
        let script = "MEMORY\n{\n  FLASH : ORIGIN = 0x08000000, LENGTH = 512K\n  RAM   : ORIGIN = 0x20000000, LENGTH = 98304\n}\n";
        let memory = Memory::parse(script).unwrap();
        assert_eq!(memory.flash.origin, 0x0800_0000);
        assert_eq!(memory.flash.length, 512 * 1024);
        assert_eq!(memory.ram.length, 96 * 1024);
        assert!(Memory::parse("MEMORY { }").is_err());
    }
}
