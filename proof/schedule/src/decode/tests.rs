//! Encodings whose meaning the manual gives, and some that have none.

use super::*;
use crate::Address;

const AT: u32 = 0x0800_1000;

fn decode(first: u16, second: u16) -> Option<Instruction> {
    Decoder::new().decode(AT, [first, second]).ok()
}

fn operation(first: u16, second: u16) -> Operation {
    decode(first, second).unwrap().operation
}

#[test]
fn encodings_that_the_processor_lacks_are_unknown() {
    let unknown = [
        (0xb600, 0),      // no CPS
        (0xb670, 0),      // CPSID of no mask
        (0xb674, 0),      // CPSID A, not on Armv7-M
        (0xb680, 0),      // no endianness change on Armv7-M
        (0xba80, 0),      // HLT, Armv8-M
        (0xbf50, 0),      // an unallocated hint
        (0xb400, 0),      // PUSH of nothing
        (0xe8d0, 0x0f20), // an unallocated exclusive
        (0xee30, 0x0b41), // VSUB.F64
        (0xfe00, 0x0a00), // VSEL, Armv8-M
        (0xee00, 0x0410), // coprocessor 4
        (0xf9a0, 0x0000), // advanced SIMD
        (0xfbf0, 0x0000), // an unallocated division
        (0xf800, 0x0040), // STRB of an address with an unallocated shift
        (0xea0f, 0x0f00), // AND into the program counter without flags
    ];
    for (first, second) in unknown {
        assert_eq!(decode(first, second), None, "{first:04x} {second:04x}");
    }
}

#[test]
fn branches_go_where_the_manual_says() {
    assert_eq!(operation(0xe7fe, 0), Operation::Jump(AT));
    assert_eq!(operation(0xd0fe, 0), Operation::Jump(AT));
    assert_eq!(operation(0xf000, 0xb800), Operation::Jump(AT + 4));
    assert_eq!(operation(0xf7ff, 0xfffe), Operation::Call(AT));
    assert_eq!(operation(0xf43f, 0xaffe), Operation::Jump(AT));
    assert_eq!(operation(0x4718, 0), Operation::JumpRegister(3));
    assert_eq!(operation(0x4798, 0), Operation::CallRegister(3));
    let to = AT + 6;
    let cbz = |is_zero| Operation::JumpOnZero {
        register: 0,
        to,
        is_zero,
    };
    assert_eq!(operation(0xb108, 0), cbz(true));
    assert_eq!(operation(0xb908, 0), cbz(false));
    let table = Operation::TableJump {
        base: 15,
        index: 2,
        entry_bytes: 2,
    };
    assert_eq!(operation(0xe8df, 0xf012), table);
}

#[test]
fn interrupts_are_switched_by_the_masks_that_are_named() {
    let masks = |code| match operation(code, 0) {
        Operation::Interrupts {
            off,
            primask,
            faultmask,
        } => (off, primask, faultmask),
        other => panic!("{other:?}"),
    };
    assert_eq!(masks(0xb672), (true, true, false)); // cpsid i
    assert_eq!(masks(0xb662), (false, true, false)); // cpsie i
    assert_eq!(masks(0xb671), (true, false, true)); // cpsid f
    assert_eq!(masks(0xb663), (false, true, true)); // cpsie if
}

#[test]
fn returns_are_distinguished_from_other_jumps() {
    let is_return = |first, second| decode(first, second).unwrap().is_return();
    assert!(is_return(0x4770, 0)); // bx lr
    assert!(is_return(0xbd10, 0)); // pop {r4, pc}
    assert!(is_return(0xe8bd, 0x8010)); // pop.w {r4, pc}
    assert!(is_return(0xf85d, 0xfb04)); // ldr pc, [sp], #4
    assert!(!is_return(0x4718, 0)); // bx r3
    assert!(!is_return(0xf8d0, 0xf004)); // ldr.w pc, [r0, #4]
    assert!(!is_return(0xbc10, 0)); // pop {r4}
}

#[test]
fn conditions_come_from_branches_and_from_it() {
    assert_eq!(decode(0xd0fe, 0).unwrap().condition, 0);
    assert_eq!(decode(0xe7fe, 0).unwrap().condition, ALWAYS);
    // ITTE EQ, three moves, and a fourth that is unconditional.
    let mut decoder = Decoder::new();
    let mut next = |code| {
        let instruction = decoder.decode(AT, [code, 0]).unwrap();
        (instruction.condition, instruction.in_if_then)
    };
    assert_eq!(next(0xbf06), (ALWAYS, false));
    assert_eq!(next(0x2001), (0, true));
    assert_eq!(next(0x2002), (0, true));
    assert_eq!(next(0x2003), (1, true));
    assert_eq!(next(0x2004), (ALWAYS, false));
}

#[test]
fn it_knows_how_many_instructions_it_governs() {
    for (code, count) in [(0xbf08, 1), (0xbf04, 2), (0xbf16, 3), (0xbf01, 4)] {
        assert_eq!(operation(code, 0), Operation::IfThen(count));
    }
}

#[test]
fn flags_are_set_by_comparisons_and_by_what_says_so() {
    let sets = |first, second| decode(first, second).unwrap().sets_flags;
    assert!(sets(0x2801, 0)); // cmp r0, #1
    assert!(sets(0x3801, 0)); // subs r0, #1
    assert!(sets(0x4288, 0)); // cmp r0, r1
    assert!(sets(0xf1b0, 0x0001)); // subs.w r0, r0, #1
    assert!(!sets(0xf1a0, 0x0001)); // sub.w r0, r0, #1
    assert!(sets(0x1e40, 0)); // subs r0, r0, #1
    assert!(!sets(0x4408, 0)); // add r0, r1
    assert!(sets(0xeef1, 0xfa10)); // vmrs APSR_nzcv, fpscr
    assert!(!sets(0xfa00, 0xf001)); // lsl.w r0, r0, r1
    assert!(sets(0xfa10, 0xf001)); // lsls.w r0, r0, r1
    let mut decoder = Decoder::new();
    decoder.decode(AT, [0xbf08, 0]).unwrap();
    assert!(!decoder.decode(AT, [0x3801, 0]).unwrap().sets_flags);
}

#[test]
fn constants_are_expanded() {
    let constant = |first, second| match operation(first, second) {
        Operation::Constant { value, .. } => value,
        other => panic!("{other:?}"),
    };
    assert_eq!(constant(0xf04f, 0x10ab), 0x00ab_00ab); // repeated
    assert_eq!(constant(0xf04f, 0x20ab), 0xab00_ab00);
    assert_eq!(constant(0xf04f, 0x30ab), 0xabab_abab);
    assert_eq!(constant(0xf04f, 0x4000), 0x8000_0000); // rotated by 8
    assert_eq!(constant(0xf44f, 0x7080), 0x0000_0100); // rotated by 30
    assert_eq!(constant(0xf06f, 0x0001), !1); // mvn
    assert_eq!(constant(0xf241, 0x2034), 0x1234); // movw
    let top = Operation::ConstantTop {
        to: 0,
        value: 0x2000,
    };
    assert_eq!(operation(0xf2c2, 0x0000), top);
}

#[test]
fn transfers_know_their_words_and_addresses() {
    let address = |base, offset| Address::Offset { base, offset };
    let push = Operation::Store {
        words: 3,
        address: address(13, -12),
        writeback: Some((13, -12)),
        source: None,
        reads: 0x4030,
        bytes: 4,
    };
    assert_eq!(operation(0xb530, 0), push); // push {r4, r5, lr}
    let post = Operation::Load {
        writes: 1,
        first: Some(0),
        words: 1,
        bytes: 1,
        address: address(1, 0),
        writeback: Some((1, 1)),
    };
    assert_eq!(operation(0xf811, 0x0b01), post); // ldrb r0, [r1], #1
    let down = Operation::Store {
        words: 1,
        address: address(2, -8),
        writeback: None,
        source: Some(3),
        reads: 8,
        bytes: 4,
    };
    assert_eq!(operation(0xf842, 0x3c08), down); // str r3, [r2, #-8]
    let literal = Operation::FloatLoad {
        words: 1,
        address: Address::Absolute(AT + 4 + 8),
        writeback: None,
    };
    assert_eq!(operation(0xed9f, 0x0a02), literal); // vldr s0, [pc, #8]
}
