//! Small programs, compiled here: their loops, flaws and memory.

mod support;

use schedule::{Annotations, Count, Function, Image, Program, Region, Rule};

/// What every program needs: a vector table, something that cannot be computed, and a panic.
const FRAME: &str = r#"
#![no_std]
#![no_main]
#![allow(dead_code, unconditional_recursion, static_mut_refs)]
use core::hint::black_box;
use core::ptr::{read_volatile, write_volatile};
use core::sync::atomic::{AtomicU32, Ordering::Relaxed};

#[unsafe(link_section = ".vector_table")]
#[used]
static VECTORS: [unsafe extern "C" fn() -> u32; 2] = [stack, start];
unsafe extern "C" fn stack() -> u32 { 0 }

static COUNT: AtomicU32 = AtomicU32::new(0);
fn input() -> u32 { unsafe { read_volatile(0x4002_0010 as *const u32) } }
fn output(value: u32) { unsafe { write_volatile(0x4002_0014 as *mut u32, value) } }

#[panic_handler]
fn panic(_: &core::panic::PanicInfo) -> ! {
    loop { black_box(()); }
}

#[unsafe(no_mangle)]
pub extern "C" fn start() -> u32 {
    task();
    0
}
"#;

/// The image and annotations of a program whose task is `body`; `None` where it cannot be compiled.
fn read(body: &str) -> Option<(Image, Annotations)> {
    let folder = support::scratch();
    let elf = support::compile(&folder, &format!("{FRAME}{body}"))?;
    let image = Image::load(&elf).expect("it has just been linked");
    let annotations = Annotations::read(&folder).expect("its comments are right");
    Some((image, annotations))
}

/// What is wrong in what `start` reaches.
fn flaws(program: &Program<'_>) -> Vec<(Rule, String)> {
    let reached = reached(program);
    let flaws = reached.iter().flat_map(|function| &function.flaws);
    flaws
        .map(|flaw| {
            let text = format!("{}; {}", flaw.what, flaw.place.frames.join(", "));
            (flaw.rule, text)
        })
        .collect()
}

fn reached<'p>(program: &'p Program<'_>) -> Vec<&'p Function> {
    let start = program.image.symbol("start").expect("it is exported");
    let reached = program.reach(start);
    reached
        .iter()
        .filter_map(|&address| program.function(address))
        .collect()
}

/// The bounds of all loops that `start` reaches, with their origins.
fn bounds(program: &Program<'_>) -> Vec<(Option<Count>, String)> {
    let loops = reached(program)
        .into_iter()
        .flat_map(|function| &function.loops);
    loops
        .map(|one| match &one.bound {
            Some(bound) => (Some(bound.count.clone()), bound.origin.clone()),
            None => (None, String::new()),
        })
        .collect()
}

/// Asserts that a program has exactly this flaw, and that it names a line of the program.
#[track_caller]
fn assert_flaw(body: &str, rule: Rule) {
    let Some((image, annotations)) = read(body) else {
        return;
    };
    let program = Program::new(&image, &annotations);
    let flaws = flaws(&program);
    let is_found = |(found, text): &(Rule, String)| *found == rule && text.contains("src/main.rs:");
    assert!(
        flaws.iter().any(is_found),
        "{rule:?} is not among {flaws:?}"
    );
}

#[test]
fn a_loop_over_constants_needs_no_comment() {
    let Some((image, annotations)) = read(
        "fn task() {
            let mut sum = 0;
            for _ in 0..100 { sum += black_box(1); }
            for word in &WORDS { output(word.load(Relaxed) + sum); }
        }
        static WORDS: [AtomicU32; 40] = [const { AtomicU32::new(0) }; 40];",
    ) else {
        return;
    };
    let program = Program::new(&image, &annotations);
    assert_eq!(flaws(&program), []);
    let bounds = bounds(&program);
    assert!(!bounds.is_empty());
    for (count, origin) in bounds {
        let Some(Count::Number(count)) = count else {
            panic!("{count:?}");
        };
        assert!((1..=100).contains(&count), "{count}");
        assert_eq!(origin, "constants");
    }
}

#[test]
fn a_loop_without_a_bound_is_named() {
    let body = "fn task() {
        let mut left = input();
        while left != 0 { left = black_box(left - 1); }
    }";
    assert_flaw(body, Rule::UnboundedLoop);
}

#[test]
fn a_comment_bounds_the_loop_beneath_it_and_no_other() {
    let Some((image, annotations)) = read(
        "fn task() {
            // wcet-bound: 5
            for _ in 0..input() {
                output(black_box(1));
                let mut left = input();
                while left != 0 { left = black_box(left - 1); }
            }
        }",
    ) else {
        return;
    };
    let program = Program::new(&image, &annotations);
    let found = bounds(&program);
    assert_eq!(found.len(), 2, "{found:?}");
    assert_eq!(found[0].0, Some(Count::Number(5)), "{found:?}");
    assert_eq!(found[1].0, None, "{found:?}");
}

#[test]
fn a_loop_of_a_library_needs_a_comment_of_its_own() {
    const FIND: &str = "let words: &[u32] = unsafe { core::slice::from_raw_parts(
            input() as *const u32, input() as usize) };";
    let Some((image, annotations)) = read(&format!(
        "fn task() {{
            {FIND}
            // wcet-bound: 5
            for _ in 0..input() {{
                output(words.iter().filter(|&&word| black_box(word) == 9).count() as u32);
            }}
        }}"
    )) else {
        return;
    };
    let program = Program::new(&image, &annotations);
    let found = bounds(&program);
    // The compiler may make two of the outer loop.
    let (known, unknown): (Vec<_>, Vec<_>) = found.iter().partition(|(count, _)| count.is_some());
    let is_five = |(count, _): &&(Option<Count>, String)| *count == Some(Count::Number(5));
    assert!(known.iter().all(is_five), "{known:?}");
    assert_eq!(unknown.len(), 1, "{found:?}");
    let rules: Vec<Rule> = flaws(&program).into_iter().map(|(rule, _)| rule).collect();
    assert!(rules.contains(&Rule::UnboundedLoop), "{rules:?}");
}

#[test]
fn a_comment_above_a_statement_bounds_the_loops_of_libraries_in_it() {
    let Some((image, annotations)) = read(
        "fn task() {
            let words: &[u32] = unsafe {
                core::slice::from_raw_parts(input() as *const u32, input() as usize & 63)
            };
            // wcet-bound: 64
            let found = words.iter().filter(|&&word| black_box(word) == 9).count();
            output(found as u32);
        }",
    ) else {
        return;
    };
    let program = Program::new(&image, &annotations);
    assert_eq!(flaws(&program), []);
    let found = bounds(&program);
    assert!(!found.is_empty());
    let origins = found.iter().map(|(_, origin)| origin.as_str());
    assert!(
        origins
            .into_iter()
            .all(|origin| origin.starts_with("src/main.rs:"))
    );
}

#[test]
fn names_and_totals_are_kept() {
    let Some((image, annotations)) = read(
        "fn task() {
            // wcet-bound: axes, wcet-total: segment_steps
            for _ in 0..input() { output(black_box(1)); }
        }",
    ) else {
        return;
    };
    let names: Vec<(&str, String)> = annotations.names().collect();
    assert_eq!(names.len(), 2);
    let program = Program::new(&image, &annotations);
    let functions = reached(&program);
    let one = functions.iter().find_map(|function| function.loops.first());
    let one = one.expect("there is a loop");
    let bound = one.bound.as_ref().map(|bound| &bound.count);
    let total = one.total.as_ref().map(|total| &total.count);
    assert_eq!(bound, Some(&Count::Named("axes".to_owned())));
    assert_eq!(total, Some(&Count::Named("segment_steps".to_owned())));
    assert!(
        names
            .iter()
            .all(|(_, place)| place.starts_with("src/main.rs:"))
    );
}

#[test]
fn a_comment_that_is_too_small_is_wrong() {
    let body = "fn task() {
        // wcet-bound: 3
        for step in 0..1000 { output(black_box(step)); }
    }";
    assert_flaw(body, Rule::WrongBound);
}

#[test]
fn an_index_that_is_not_checked_is_a_panic() {
    let body = "fn task() {
        output(WORDS[input() as usize].load(Relaxed));
    }
    static WORDS: [AtomicU32; 8] = [const { AtomicU32::new(0) }; 8];";
    assert_flaw(body, Rule::ReachablePanic);
}

#[test]
fn a_function_that_calls_itself_is_recursion() {
    let body = "#[inline(never)]
    fn deeper(depth: u32) -> u32 {
        if depth == 0 { 0 } else { black_box(deeper(black_box(depth - 1))) + 1 }
    }
    fn task() { output(deeper(input())); }";
    assert_flaw(body, Rule::Recursion);
}

#[test]
fn a_call_through_a_trait_object_is_indirect() {
    let body = "trait Act { fn act(&self); }
    struct One; struct Two;
    impl Act for One { fn act(&self) { output(1); } }
    impl Act for Two { fn act(&self) { output(2); } }
    fn task() {
        let acts: [&dyn Act; 2] = [&One, &Two];
        black_box(&acts)[input() as usize & 1].act();
    }";
    assert_flaw(body, Rule::IndirectCall);
}

#[test]
fn waiting_for_an_interrupt_is_forbidden() {
    let body = "fn task() {
        unsafe { core::arch::asm!(\"wfi\") };
    }";
    assert_flaw(body, Rule::ForbiddenInstruction);
}

#[test]
fn a_trap_is_found() {
    let body = "fn task() {
        if input() == 3 { unsafe { core::arch::asm!(\"udf #1\") }; }
    }";
    assert_flaw(body, Rule::ReachableTrap);
}

#[test]
fn an_instruction_of_another_processor_is_unknown() {
    let body = "fn task() {
        unsafe { core::arch::asm!(\".inst.w 0xfe000a00\") };
    }";
    assert_flaw(body, Rule::UnknownInstruction);
}

#[test]
fn an_exclusive_store_is_tried_again_once() {
    let Some((image, annotations)) = read("fn task() { COUNT.fetch_add(1, Relaxed); }") else {
        return;
    };
    let program = Program::new(&image, &annotations);
    assert_eq!(flaws(&program), []);
    let counts: Vec<Option<Count>> = bounds(&program)
        .into_iter()
        .map(|(count, _)| count)
        .collect();
    assert_eq!(counts, [Some(Count::Number(1))]);
}

#[test]
fn accesses_have_the_memory_that_they_go_to() {
    let Some((image, annotations)) = read(
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
    ) else {
        return;
    };
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
    let Some((image, annotations)) = read(
        "fn task() {
            unsafe { core::arch::asm!(\"msr basepri_max, {0}\", in(reg) 0xb0) };
            unsafe { write_volatile(0xe000_e41c as *mut u8, 0x40) };
            unsafe { core::arch::asm!(\"msr basepri, {0}\", in(reg) 0) };
        }",
    ) else {
        return;
    };
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
        .map(|&(_, address, value)| (address, value))
        .collect();
    assert!(stores.contains(&(0xe000_e41c, Some(0x40))), "{stores:?}");
    let sections = functions.iter().flat_map(|function| &function.blocks);
    let raised = sections.filter(|block| schedule::raises(&block.instructions[0]));
    assert_eq!(raised.count(), 1);
}

#[test]
fn code_that_runs_from_ram_knows_where_it_is_stored() {
    let Some((image, annotations)) = read(
        "#[unsafe(link_section = \".data.erase\")]
        #[unsafe(no_mangle)]
        #[inline(never)]
        extern \"C\" fn erase() { output(black_box(1)); }
        fn task() { erase(); }",
    ) else {
        return;
    };
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
    let Some((image, annotations)) = read(
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
    ) else {
        return;
    };
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
fn constants_behind_a_table_are_no_entries_of_it() {
    let Some((image, annotations)) = read(
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
        unsafe extern \"C\" { fn picked(way: u32) -> u32; }
        fn task() { output(unsafe { picked(input() & 1) }); }",
    ) else {
        return;
    };
    let program = Program::new(&image, &annotations);
    assert_eq!(flaws(&program), []);
    let picked = image.symbol("picked").expect("it is linked") & !1;
    let function = program.function(picked).expect("it was decoded");
    assert_eq!(function.blocks[0].successors.len(), 2, "{function:?}");
}

/// A jump by a table that does not lie right behind it, with some code before and some behind.
fn picked_by_register(before: &str, behind: &str) -> Option<(Image, Annotations)> {
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
            \"{behind}\",
            \"b.w 5f\",
            \"4: mov.w r0, #0\",
            \"5: bx lr\",
            \".size picked, . - picked\",
        );
        unsafe extern \"C\" {{ fn picked(way: u32) -> u32; }}
        fn task() {{ output(unsafe {{ picked(input() & 1) }}); }}"
    ))
}

#[test]
fn a_table_may_lie_where_a_register_points() {
    let Some((image, annotations)) = picked_by_register("nop", "nop") else {
        return;
    };
    let program = Program::new(&image, &annotations);
    assert_eq!(flaws(&program), []);
    let picked = image.symbol("picked").expect("it is linked") & !1;
    let function = program.function(picked).expect("it was decoded");
    assert_eq!(function.blocks[0].successors.len(), 2, "{function:?}");
}

#[test]
fn a_table_that_another_register_may_point_to_is_unknown() {
    for (before, behind) in [
        // Another address, one that may be another, and a way past what makes it.
        ("mov r2, r1", "nop"),
        ("cmp r1, #0\\nit eq\\nmoveq r2, r1", "nop"),
        ("nop", "mov r2, r1\\nb 6b"),
    ] {
        let Some((image, annotations)) = picked_by_register(before, behind) else {
            return;
        };
        let program = Program::new(&image, &annotations);
        let flaws = flaws(&program);
        let is_told = flaws.iter().any(|(rule, _)| *rule == Rule::IndirectCall);
        assert!(is_told, "{before}, {behind}: {flaws:?}");
    }
}

#[test]
fn a_reference_in_a_struct_on_the_stack_keeps_its_memory() {
    let Some((image, annotations)) = read(
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
    ) else {
        return;
    };
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
    let Some((image, annotations)) = read(
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
    ) else {
        return;
    };
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
    let Some((image, annotations)) = read(
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
    ) else {
        return;
    };
    let program = Program::new(&image, &annotations);
    assert_eq!(flaws(&program), []);
    let has_trap = reached(&program).iter().any(|function| {
        let mut blocks = function.blocks.iter();
        blocks.any(|block| block.traps)
    });
    assert!(has_trap, "the table has no entries that lead to a trap");
}
