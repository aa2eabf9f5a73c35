//! Code that is in no graph: after a computed jump, or without a symbol.
//!
//! The analysis does not know when such code runs. So such code must not mask interrupts or write a stack
//! pointer: every instruction of the image that does so must belong to an analysed function, and so
//! must every instruction that the decoder does not know.

use std::collections::BTreeSet;

use crate::{
    Config, Decoder, Flaw, Function, Image, Operation, Program, Rule,
    graph::{BASEPRI, BASEPRI_MAX, CONTROL, FAULTMASK, MAIN_STACK, PRIMASK, PROCESS_STACK},
};

/// Returns a flaw for each such instruction.
pub(crate) fn flaws(program: &Program<'_>, config: &Config) -> Vec<Flaw> {
    let image = program.image;
    let functions = program.functions().values();
    let known: BTreeSet<u32> = functions
        .flat_map(Function::instructions)
        .map(|instruction| instruction.address)
        .collect();
    let suspects = image.code_ranges().into_iter().flat_map(|range| {
        let suspects = suspects(image, range);
        suspects.into_iter().filter(|(at, _)| !known.contains(at))
    });
    let counted = suspects.filter(|(at, _)| config.exemption(&image.name(*at)).is_none());
    let flaws = counted.map(|(at, what)| {
        let what = format!("{what}, where the analysis finds no way to");
        let remedy = "Call functions by name, and give assembly a symbol with a type: `.type NAME, %function`.";
        image.flaw(Rule::UnknownInstruction, at, what, remedy)
    });
    flaws.collect()
}

/// The instructions of a range that mask interrupts, write a stack pointer or are not decoded.
fn suspects(image: &Image, range: std::ops::Range<u32>) -> Vec<(u32, String)> {
    let mut found = Vec::new();
    let mut decoder = Decoder::new();
    let mut address = range.start;
    while address < range.end
        && let Some(code) = image.code(address)
    {
        if image.is_data(address) {
            address += 2;
            continue;
        }
        match decoder.decode(address, code) {
            Ok(instruction) => {
                if is_suspect(instruction.operation) {
                    found.push((
                        address,
                        "interrupts are held back, or a stack changed".to_owned(),
                    ));
                }
                address = instruction.end();
            }
            Err(unknown) => {
                found.push((address, unknown.to_string()));
                address += u32::from(crate::decode::size(code[0]));
            }
        }
    }
    found
}

const fn is_suspect(operation: Operation) -> bool {
    match operation {
        Operation::Interrupts { off, .. } => off,
        Operation::WriteSpecial { register, .. } => matches!(
            register,
            BASEPRI | BASEPRI_MAX | PRIMASK | FAULTMASK | CONTROL | MAIN_STACK | PROCESS_STACK
        ),
        _ => false,
    }
}
