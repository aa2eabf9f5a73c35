//! The profile on short traces, without QEMU.

use super::*;
use crate::elf::Function;

const HANDLER: u32 = 0x100;
const URGENT: u32 = 0x200;
const NOP: [u16; 2] = [0xbf00, 0];
const RETURN: [u16; 2] = [0x4770, 0];
const IT_EQ: [u16; 2] = [0xbf08, 0];

/// Two handlers and a function at 0x300.
fn profile() -> Profile {
    let function = |address| Function {
        address,
        size: 0x40,
        name: format!("{address:x}"),
    };
    Profile::new(Program {
        functions: [0, HANDLER, URGENT, 0x300].map(function).into(),
        handlers: vec![HANDLER, 0, URGENT],
    })
}

/// Executes instructions as QEMU would: address and code of each.
fn trace(steps: &[(u32, [u16; 2])]) -> Profile {
    let mut profile = profile();
    for &(address, code) in steps {
        let site = profile.site(address, code);
        profile.execute(site);
    }
    profile.close();
    profile
}

fn runs(profile: &Profile, handler: u32) -> (u64, u64, u64) {
    let task = profile.tasks.iter().find(|task| task.handler == handler);
    task.map_or((0, 0, 0), |task| {
        (task.activations, task.total.instructions, task.total.cycles)
    })
}

#[test]
fn an_exception_costs_its_entry_and_exit() {
    let profile = trace(&[(0, NOP), (HANDLER, RETURN), (2, NOP)]);
    assert_eq!(runs(&profile, HANDLER), (1, 1, 12 + 3 + 12));
    assert_eq!(profile.tasks[0].total.cycles, 2);
    assert_eq!(profile.unexplained, 0);
}

#[test]
fn a_return_not_taken_and_preempted_does_not_end_the_handler() {
    let profile = trace(&[
        (0, NOP),
        (HANDLER, IT_EQ),
        (HANDLER + 2, RETURN),
        (URGENT, RETURN),
        (HANDLER + 4, NOP),
        (HANDLER + 6, RETURN),
        (2, NOP),
    ]);
    assert_eq!(runs(&profile, HANDLER), (1, 4, 24 + 1 + 1 + 1 + 3));
    assert_eq!(runs(&profile, URGENT), (1, 1, 24 + 3));
    assert_eq!(profile.tasks[1].span_cycles, 24 + 6 + 24 + 3);
}

#[test]
fn handlers_that_follow_each_other_are_not_nested() {
    let profile = trace(&[
        (0, NOP),
        (HANDLER, RETURN),
        (URGENT, RETURN),
        (HANDLER, RETURN),
        (2, NOP),
    ]);
    assert_eq!(runs(&profile, HANDLER), (2, 2, 2 * 27));
    assert_eq!(profile.tasks[1].span_cycles, 2 * 27);
    assert_eq!(profile.tasks[1].max_span_cycles, 27);
}

#[test]
fn a_preempted_call_goes_on_after_the_exception() {
    let call = [0xf000, 0xf97e]; // bl 0x300
    let profile = trace(&[(0, call), (HANDLER, RETURN), (0x300, RETURN), (4, NOP)]);
    let called = profile.calls[3];
    assert_eq!((called.count, called.total.cycles), (1, 3));
    assert_eq!(profile.tasks[0].total.cycles, 3 + 3 + 1);
}

#[test]
fn a_branch_to_a_handler_is_no_exception() {
    let itself = [0xe7fe, 0];
    let profile = trace(&[(0, NOP), (HANDLER, itself), (HANDLER, itself)]);
    assert_eq!(profile.tasks.len(), 2);
    assert_eq!(runs(&profile, HANDLER).0, 0);
}

#[test]
fn a_jump_out_of_nowhere_is_noticed() {
    let profile = trace(&[(0, NOP), (0x30, NOP)]);
    assert_eq!(profile.unexplained, 1);
    assert_eq!(profile.first_unexplained, Some((0, 0x30)));
}

#[test]
fn a_transfer_that_touched_nothing_was_skipped() {
    let load = [0x6800, 0];
    let mut profile = profile();
    let site = profile.site(0, load);
    profile.execute(site);
    let site = profile.site(2, load);
    profile.execute(site);
    profile.touch(0x4000_0000, false);
    profile.close();
    assert_eq!(profile.tasks[0].total.cycles, 1 + 2);
    assert_eq!(profile.tasks[0].peripheral_reads, 1);
}
