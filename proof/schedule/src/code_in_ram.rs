//! Code in RAM, which runs while the flash cannot be read, and so must not need the flash.
//!
//! The section of a function puts only the function itself into RAM: a callee stays in flash unless
//! the compiler inlines it, and a `match` may become a table in flash.

use crate::{Config, Flaw, Frame, Function, Place, Program, Region, Rule, config::Exempt};

/// Returns the uses of flash by code in RAM, and the code in flash that must be in RAM.
pub(crate) fn flaws(program: &Program<'_>, config: &Config) -> Vec<Flaw> {
    let functions = program.functions().values();
    let resident = functions.filter(|function| is_in_ram(function.address));
    let uses = resident.flat_map(|function| of_function(program, function));
    let outside = config.resident.iter();
    let outside = outside.filter_map(|resident| outside_ram(program, resident));
    uses.chain(outside).collect()
}

/// Code of a function that must be in RAM, inlined or not, and is in flash.
fn outside_ram(program: &Program<'_>, resident: &Exempt) -> Option<Flaw> {
    let is_of = |frame: &Frame| *frame.function == *resident.function;
    let mut instructions = program
        .functions()
        .values()
        .filter(|function| !is_in_ram(function.address))
        .flat_map(Function::instructions);
    let found = instructions.find(|it| program.image.frames(it.address).iter().any(is_of))?;
    let what = format!("`{}` is in flash: {}", resident.function, resident.reason);
    let remedy = "Put it into RAM, by the section of the function, and keep it out of its callers.";
    Some(
        program
            .image
            .flaw(Rule::CodeInRam, found.address, what, remedy),
    )
}

fn is_in_ram(address: u32) -> bool {
    Region::of(address) == Region::Sram
}

fn of_function(program: &Program<'_>, function: &Function) -> Vec<Flaw> {
    let image = program.image;
    let flaw = |place: Place, what: String| {
        let remedy = "Inline what it calls, and look nothing up in a constant.";
        Flaw::new(Rule::CodeInRam, what, place, remedy)
    };
    let blocks = function.blocks.iter();
    let calls = blocks.filter_map(|block| Some((block.last(), block.call?)));
    let calls = calls.filter(|(_, called)| leads_to_flash(program, *called));
    let calls = calls.map(|(address, called)| {
        let what = format!("code in RAM calls `{}` in flash", image.name(called));
        flaw(image.place(address), what)
    });
    let regions = function.regions.iter();
    let reads = regions.filter(|(_, region)| **region == Region::Flash);
    let reads = reads.map(|(address, _)| {
        let what = "code in RAM reads a constant in flash".to_owned();
        flaw(image.place(*address), what)
    });
    calls.chain(reads).collect()
}

/// Whether a function is in flash, or is what the linker puts in between because it is so far away.
fn leads_to_flash(program: &Program<'_>, address: u32) -> bool {
    let function = program.function(address);
    let is_computed = |flaw: &Flaw| flaw.rule == Rule::IndirectCall;
    !is_in_ram(address) || function.is_some_and(|it| it.flaws.iter().any(is_computed))
}
