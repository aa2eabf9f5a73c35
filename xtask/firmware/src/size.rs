//! `cargo xtask size`: how much of the chip the firmware takes.

use std::{fs, path::Path, process::ExitCode};

use anstream::println;
use anyhow::{Context, Result, ensure};
use object::{Object, ObjectSection, SectionFlags, elf};
use owo_colors::OwoColorize;

use board_data::MemoryLayout;
use boards::compile;

/// Build the firmware and show how much flash and RAM it takes
///
/// RAM is what is taken statically; the rest is the stack's.
#[derive(clap::Args)]
pub(crate) struct Options {
    /// A board's name, or the path of a file; netduino-plus-2 without it
    #[arg(long, value_name = "BOARD")]
    board: Option<String>,
    /// Every board of the project
    #[arg(long, conflicts_with = "board")]
    all: bool,
}

pub(crate) fn run(options: &Options) -> Result<ExitCode> {
    let mut rows = Vec::new();
    for board in boards::chosen(options.board.as_deref(), options.all)? {
        let usage = Usage::of(&compile::firmware(&board)?, &board.memory)?;
        rows.push((board, usage));
    }
    let head = format!("{:<24}{:>28}{:>28}", "board", "flash", "RAM");
    println!("{}", head.bold());
    let mut fits = true;
    for (board, usage) in &rows {
        let (flash, ram) = (
            board.memory.flash_bytes.into(),
            board.memory.ram_bytes.into(),
        );
        println!(
            "{:<24}{:>28}{:>28}",
            board.name,
            share(usage.flash, flash),
            share(usage.ram, ram)
        );
        fits &= usage.flash <= flash && usage.ram <= ram;
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

/// Bytes of each memory that a program takes.
struct Usage {
    flash: u64,
    ram: u64,
}

impl Usage {
    /// Adds up the allocated sections. Initialised data counts twice: its first values lie in
    /// flash.
    fn of(path: &Path, memory: &MemoryLayout) -> Result<Self> {
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
            if memory.is_ram(section.address()) {
                usage.ram += section.size();
                usage.flash += if has_content { section.size() } else { 0 };
            } else if memory.is_flash(section.address()) {
                usage.flash += section.size();
            }
        }
        Ok(usage)
    }
}
