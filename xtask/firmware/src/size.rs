//! `cargo xtask size`: how much of the chip the firmware takes.

use std::process::ExitCode;

use anstream::println;
use anyhow::{Result, ensure};
use common::options::Size as Options;
use object::{Object, ObjectSection, SectionFlags, elf};
use owo_colors::OwoColorize;

use board_data::MemoryLayout;
use firmware::boards::{compile, layout};

pub(crate) fn run(options: &Options) -> Result<ExitCode> {
    let mut rows = Vec::new();
    for board in firmware::boards::chosen(options.board.as_deref(), options.all)? {
        let image = compile::image(&board, &[])?;
        let flash = layout::check(&board, &image)?;
        let ram = static_ram(&image, &board.chosen_memory())?;
        rows.push((board, flash, ram));
    }
    let head = format!("{:<24}{:>28}{:>12}{:>28}", "board", "flash", "free", "RAM");
    println!("{}", head.bold());
    let mut fits = true;
    for (board, flash, ram) in &rows {
        let of_ram = board.chosen_memory().ram_bytes.into();
        println!(
            "{:<24}{:>28}{:>12}{:>28}",
            board.name,
            share(flash.used.into(), flash.usable.into()),
            format!("{:.1} KiB", kib(flash.free().into())),
            share(*ram, of_ram)
        );
        fits &= *ram <= of_ram;
    }
    ensure!(fits, "the firmware does not fit");
    Ok(ExitCode::SUCCESS)
}

fn kib(bytes: u64) -> f64 {
    bytes as f64 / 1024.0
}

/// `used of all, percent`.
fn share(used: u64, all: u64) -> String {
    let percent = used as f64 / all as f64 * 100.0;
    format!("{:.1} of {:.0} KiB {percent:>5.1} %", kib(used), kib(all))
}

/// Adds up the allocated sections that lie in RAM.
fn static_ram(image: &[u8], memory: &MemoryLayout) -> Result<u64> {
    let file = object::File::parse(image)?;
    let sections = file.sections().filter(|section| {
        let SectionFlags::Elf { sh_flags } = section.flags() else {
            return false;
        };
        sh_flags & u64::from(elf::SHF_ALLOC) != 0 && memory.is_ram(section.address())
    });
    Ok(sections.map(|section| section.size()).sum())
}
