//! Accesses and jumps: the memory they go to, and tables.

use schedule::{Annotations, Image, Program, Region, Rule};

use super::{flaws, reached, read};

#[test]
fn accesses_have_the_memory_that_they_go_to() {
    let (image, annotations) = or_skip!(read(
        "#[inline(never)]
        fn fill(words: &mut [u32; 16], port: *mut u32) {
            for word in words.iter_mut() { *word = input(); }
            unsafe { write_volatile(port, words[3]) };
        }
        static mut WORDS: [u32; 16] = [0; 16];
        fn task() {
            let words = unsafe { &mut *(&raw mut WORDS) };
            fill(words, 0x4002_0014 as *mut u32);
            fill(words, 0x4002_0414 as *mut u32);
            unsafe { write_volatile(0x4000_0000 as *mut u32, 1) };
            unsafe { write_volatile(0x4001_0000 as *mut u32, 1) };
            unsafe { read_volatile(0xe000_1004 as *mut u32) };
        }",
    ));
    let program = Program::new(&image, &annotations);
    let mut found: Vec<Region> = reached(&program)
        .into_iter()
        .flat_map(|function| function.regions.values().copied())
        .filter(|&region| region != Region::Flash)
        .collect();
    found.sort_unstable();
    found.dedup();
    let expected = [
        Region::Sram,
        Region::Ahb,
        Region::Apb1,
        Region::Apb2,
        Region::Private,
    ];
    assert_eq!(found, expected);
}

#[test]
fn constants_written_to_special_registers_and_ports_are_known() {
    let (image, annotations) = or_skip!(read(
        "fn task() {
            unsafe { core::arch::asm!(\"msr basepri_max, {0}\", in(reg) 0xb0) };
            unsafe { write_volatile(0xe000_e41c as *mut u8, 0x40) };
            unsafe { core::arch::asm!(\"msr basepri, {0}\", in(reg) 0) };
        }",
    ));
    let program = Program::new(&image, &annotations);
    let functions = reached(&program);
    let specials: Vec<u32> = functions
        .iter()
        .flat_map(|function| function.specials.values().copied())
        .collect();
    assert_eq!(specials, [0xb0, 0]);
    let stores: Vec<(u32, Option<u32>)> = functions
        .iter()
        .flat_map(|function| &function.stores)
        .filter_map(|store| Some((store.to?, store.value)))
        .collect();
    assert!(stores.contains(&(0xe000_e41c, Some(0x40))), "{stores:?}");
    let sections = functions.iter().flat_map(|function| &function.blocks);
    let raised = sections.filter(|block| schedule::raises(&block.instructions[0]));
    assert_eq!(raised.count(), 1);
}

#[test]
fn code_that_runs_from_ram_knows_where_it_is_stored() {
    let (image, annotations) = or_skip!(read(
        "#[unsafe(link_section = \".data.erase\")]
        #[unsafe(no_mangle)]
        #[inline(never)]
        extern \"C\" fn erase() { output(black_box(1)); }
        fn task() { erase(); }",
    ));
    let address = image.symbol("erase").expect("it is exported");
    assert_eq!(Region::of(address), Region::Sram);
    let stored = image.load_address(address).expect("it is in a segment");
    assert_eq!(stored - 0x0801_0000, address - 0x2000_0000);
    let program = Program::new(&image, &annotations);
    let function = program.function(address).expect("it was decoded");
    assert!(function.returns);
    assert_eq!(function.flaws, []);
}

#[test]
fn a_match_through_a_table_has_all_its_arms() {
    let (image, annotations) = or_skip!(read(
        "fn task() {
            match input() {
                0 => output(black_box(3)),
                1 => unsafe { write_volatile(0x4002_0014 as *mut u32, 1) },
                2 => COUNT.store(black_box(1), Relaxed),
                3 => output(black_box(input()) * 3),
                4 => output(black_box(input()) / 3),
                5 => output(black_box(input()) ^ 3),
                6 => output(black_box(input()) << black_box(3)),
                7 => output(black_box(input()).leading_zeros()),
                _ => {}
            }
        }",
    ));
    let program = Program::new(&image, &annotations);
    assert_eq!(flaws(&program), []);
    let functions = reached(&program);
    let widest = functions
        .iter()
        .flat_map(|function| &function.blocks)
        .map(|block| block.successors.len())
        .max();
    assert!(widest >= Some(8), "{widest:?}");
}

#[test]
fn constants_after_a_table_are_no_entries_of_it() {
    let (image, annotations) = or_skip!(read(
        "core::arch::global_asm!(
            \".section .text.picked, \\\"ax\\\"\",
            \".p2align 2\",
            \".thumb_func\",
            \".type picked, %function\",
            \"picked: tbb [pc, r0]\",
            \"1: .byte (3f - 1b) / 2, (4f - 1b) / 2, 0, 0, 0, 0\",
            // What aligns a constant, and the constant: as entries they would lead into the middle
            // of instructions.
            \".short 0xbf00\",
            \"2: .word 0x09090909\",
            \"3: ldr.w r0, 2b\",
            \"b.w 5f\",
            \"4: mov.w r0, #0\",
            \"5: bx lr\",
            \".size picked, . - picked\",
        );
        unsafe extern \"C\" { fn picked(index: u32) -> u32; }
        fn task() { output(unsafe { picked(input() & 1) }); }",
    ));
    assert_has_two_targets(&image, &annotations);
}

/// Asserts that `picked` is decoded with two targets.
fn assert_has_two_targets(image: &Image, annotations: &Annotations) {
    let program = Program::new(image, annotations);
    assert_eq!(flaws(&program), []);
    let picked = image.symbol("picked").expect("it is linked") & !1;
    let function = program.function(picked).expect("it was decoded");
    assert_eq!(function.blocks[0].successors.len(), 2, "{function:?}");
}

/// A jump by a table that does not follow directly, with some code before and some after.
fn picked_by_register(before: &str, after: &str) -> Option<(Image, Annotations)> {
    read(&format!(
        "core::arch::global_asm!(
            \".section .text.picked, \\\"ax\\\"\",
            \".p2align 2\",
            \".thumb_func\",
            \".type picked, %function\",
            \"picked:\",
            \"adr.w r2, 1f\",
            \"{before}\",
            \"6: tbb [r2, r0]\",
            \"7: .p2align 2\",
            \"2: .word 0x09090909\",
            \"1: .byte (3f - 7b) / 2, (4f - 7b) / 2\",
            \"3: ldr.w r0, 2b\",
            \"{after}\",
            \"b.w 5f\",
            \"4: mov.w r0, #0\",
            \"5: bx lr\",
            \".size picked, . - picked\",
        );
        unsafe extern \"C\" {{ fn picked(index: u32) -> u32; }}
        fn task() {{ output(unsafe {{ picked(input() & 1) }}); }}"
    ))
}

#[test]
fn a_table_may_lie_where_a_register_points() {
    let (image, annotations) = or_skip!(picked_by_register("nop", "nop"));
    assert_has_two_targets(&image, &annotations);
}

#[test]
fn a_table_that_another_register_may_point_to_is_unknown() {
    for (before, after) in [
        // Another address, a possible other address, and a path around the instruction that makes
        // the address.
        ("mov r2, r1", "nop"),
        ("cmp r1, #0\\nit eq\\nmoveq r2, r1", "nop"),
        ("nop", "mov r2, r1\\nb 6b"),
    ] {
        let (image, annotations) = or_skip!(picked_by_register(before, after));
        let program = Program::new(&image, &annotations);
        let flaws = flaws(&program);
        let is_reported = flaws.iter().any(|(rule, _)| *rule == Rule::IndirectCall);
        assert!(is_reported, "{before}, {after}: {flaws:?}");
    }
}

#[test]
fn a_reference_in_a_struct_on_the_stack_keeps_its_memory() {
    let (image, annotations) = or_skip!(read(
        "struct Writer<'a> { ring: &'a [AtomicU32; 64], number: u32 }
        impl Writer<'_> {
            #[inline(never)]
            fn put(&mut self, value: u32) {
                self.ring[self.number as usize & 63].store(value, Relaxed);
                self.number = self.number.wrapping_add(black_box(1));
            }
        }
        static RING: [AtomicU32; 64] = [const { AtomicU32::new(0) }; 64];
        fn task() {
            let mut writer = Writer { ring: &RING, number: input() };
            if input() != 0 { writer.put(1); }
            writer.put(input());
            writer.ring[writer.number as usize & 63].store(9, Relaxed);
        }",
    ));
    let program = Program::new(&image, &annotations);
    let regions = reached(&program)
        .into_iter()
        .flat_map(|function| &function.regions);
    let unknown: Vec<String> = regions
        .filter(|&(_, &region)| region == Region::Unknown)
        .map(|(&address, _)| image.place(address).frames.join(" < "))
        .collect();
    assert!(unknown.is_empty(), "{unknown:?}");
}

#[test]
fn a_pointer_that_is_changed_on_a_condition_may_point_to_either() {
    let (image, annotations) = or_skip!(read(
        "static TABLE: [u32; 4] = [1, 2, 3, 4];
        static COUNTS: [AtomicU32; 4] = [const { AtomicU32::new(7) }; 4];
        fn task() {
            let mut pointer = TABLE.as_ptr();
            COUNTS[0].store(input(), Relaxed);
            unsafe {
                core::arch::asm!(
                    \"cmp {number}, #1\", \"it lo\", \"movlo {pointer}, {counts}\",
                    \"ldr {pointer}, [{pointer}]\",
                    number = in(reg) input(), pointer = inout(reg) pointer,
                    counts = in(reg) COUNTS.as_ptr(),
                );
            }
            output(pointer as u32);
        }",
    ));
    let program = Program::new(&image, &annotations);
    let regions = reached(&program)
        .into_iter()
        .flat_map(|function| function.regions.values());
    assert!(
        regions.clone().any(|region| *region == Region::Unknown),
        "{:?}",
        regions.collect::<Vec<_>>()
    );
}

#[test]
fn a_value_that_an_enum_cannot_have_is_no_trap() {
    let (image, annotations) = or_skip!(read(
        "#[derive(Clone, Copy)]
        #[repr(u8)]
        enum Kind { A, B = 2, C, D, E = 6, F, G, H }
        #[inline(never)]
        fn act(kind: Kind) {
            match kind {
                Kind::A => output(black_box(3)),
                Kind::B => unsafe { write_volatile(0x4002_0018 as *mut u32, 1) },
                Kind::C => COUNT.store(black_box(1), Relaxed),
                Kind::D => output(black_box(input()) * 3),
                Kind::E => output(black_box(input()) / 3),
                Kind::F => output(black_box(input()) ^ 3),
                Kind::G => output(black_box(input()) << black_box(3)),
                Kind::H => output(black_box(input()).leading_zeros()),
            }
        }
        fn task() {
            act(unsafe { core::mem::transmute::<u8, Kind>(input() as u8) });
        }",
    ));
    let program = Program::new(&image, &annotations);
    assert_eq!(flaws(&program), []);
    let has_trap = reached(&program).iter().any(|function| {
        let mut blocks = function.blocks.iter();
        blocks.any(|block| block.traps)
    });
    assert!(has_trap, "the table has no entries that lead to a trap");
}
