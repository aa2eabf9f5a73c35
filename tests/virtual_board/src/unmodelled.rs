//! Accesses to registers that no model answers for, and what models report: each is a fault. Where one must be borne, it
//! is listed here with the reason.

use rigless::session::Session;

use crate::machine::Machine;

/// Registers that may be touched although nothing stands for them: instance, register, and why.
const KNOWN: [(&str, &str, &str); 0] = [];

/// Addresses of registers that the emulator's chips do not have, and why they may be touched.
const UNMAPPED: [(u64, &str); 1] = [(
    0x4002_3894,
    "DCKCFGR2 of RCC: the F446 has it, and the emulator knows the registers of the F405",
)];

/// What models say of registers that is no fault of the firmware: instance, register, and why.
const HARMLESS: [(&str, &str, &str); 0] = [];

/// The accesses of a run without a model, the refused accesses, and the complaints of models, each with the first
/// instruction where it is known.
pub(crate) fn of(session: &Session<Machine>) -> Vec<(String, Option<u64>)> {
    let is_listed = |list: &[(&str, &str, &str)], instance: &str, register: &str| {
        let mut list = list.iter();
        list.any(|(of, name, _)| *of == instance && *name == register)
    };
    let unmapped = session.unmapped().into_iter();
    let unmapped = unmapped.filter(|gap| !UNMAPPED.iter().any(|(known, _)| *known == gap.address));
    let unmapped = unmapped.map(|gap| {
        let message = format!("no register of the chip is at {:#x}", gap.address);
        (message, Some(gap.program_counter))
    });
    let unimplemented = session.unimplemented().values();
    let unimplemented = unimplemented
        .filter(|gap| !is_listed(&KNOWN, gap.instance, gap.register))
        .map(|gap| {
            let message = format!("no model answers for {}.{}", gap.instance, gap.register);
            (message, Some(gap.program_counter))
        });
    let refused = session.refused().iter();
    let refused = refused.map(|(address, fault)| (format!("{fault}, at {address:#x}"), None));
    let complaints = session
        .told()
        .filter(|of| !is_listed(&HARMLESS, of.instance, of.register))
        .map(|of| {
            (
                format!("{}.{}: {}", of.instance, of.register, of.reason),
                None,
            )
        });
    let unrouted = { session.unrouted().iter() }.map(|(instance, number)| {
        let message = format!("the interrupt {number} of {instance} has no line");
        (message, None)
    });
    unmapped
        .chain(unimplemented)
        .chain(refused)
        .chain(complaints)
        .chain(unrouted)
        .collect()
}
