//! Forbidden code: in a task with a deadline, in `idle`, and in sections.

use schedule::Rule;

use super::project::{Project, assert_caught, flaws_at};

/// Builds the fixture with code in the task `receive`, and further items, and expects a rule to be
/// broken there, reported with these words.
fn in_receive(name: &str, code: &str, items: &str, rule: Rule, words: &str) {
    let project = or_skip!(Project::new(name));
    let project = project.with("receive", code).with("items", items);
    let first = project.line(code.lines().next().expect("there is code"));
    let flaws = project.flaws();
    let flaw = assert_caught(&flaws, rule, first..=first + code.lines().count() - 1);
    assert!(flaw.what.contains(words), "{}", flaw.what);
}

/// Tests of that: name, rule, words, code, items.
macro_rules! in_receive {
    ($($name:ident: $rule:ident, $words:literal, $code:literal, $items:literal;)*) => {$(
        #[test]
        fn $name() {
            in_receive(stringify!($name), $code, $items, Rule::$rule, $words);
        }
    )*};
}

in_receive! {
    an_unchecked_index_is_a_reachable_panic: ReachablePanic, "a panic can be reached",
        "BYTES[cx.local.place.wrapping_mul(3)].store(byte, Relaxed);",
        "";
    formatting_is_an_indirect_call: IndirectCall, "formatting by `core::fmt`",
        "let _ = core::fmt::Write::write_fmt(&mut Out, format_args!(\"{byte}\"));",
        "struct Out;
    impl core::fmt::Write for Out {
        fn write_str(&mut self, text: &str) -> core::fmt::Result {
            text.bytes().for_each(|byte| device::write_pins(byte.into()));
            Ok(())
        }
    }";
    a_trait_object_is_an_indirect_call: IndirectCall, "call",
        "let answer = ANSWERS[(byte & 1) as usize].answer(byte);
            device::write_pins(answer);",
        "trait Answer: Sync {
        fn answer(&self, byte: u32) -> u32;
    }
    struct Double;
    impl Answer for Double {
        fn answer(&self, byte: u32) -> u32 {
            2 * byte
        }
    }
    struct Square;
    impl Answer for Square {
        fn answer(&self, byte: u32) -> u32 {
            byte * byte
        }
    }
    static ANSWERS: [&dyn Answer; 2] = [&Double, &Square];";
    a_division_of_64_bits_is_an_unbounded_loop: UnboundedLoop, "a division of 64 bits (`__aeabi_uldivmod`)",
        "let wide = u64::from(byte) << 40;
            device::write_pins((wide / u64::from(byte | 1).wrapping_mul(0x1_0000_0003)) as u32);",
        "";
    a_copy_of_variable_length_is_an_unbounded_loop: UnboundedLoop, "a copy or filling of variable or great length",
        "let mut copy = [0_u8; 256];
            let source = [byte as u8; 256];
            let length = byte as usize & 255;
            copy[..length].copy_from_slice(core::hint::black_box(&source[..length]));
            device::write_pins(core::hint::black_box(&copy)[7].into());",
        "";
    waiting_for_a_flag_is_an_unbounded_loop: UnboundedLoop, "a loop has no bound",
        "while !device::has_byte() {}",
        "";
    a_counted_loop_that_runs_more_often_than_its_comment_says_is_caught: WrongBound, "10",
        "// wcet-bound: 10
            for _ in 0..1000 {
                device::write_pins(device::byte().into());
            }",
        "";
    a_bound_does_not_make_waiting_for_a_flag_short: Wait, "a loop that waits",
        "// wcet-bound: 1
            while !device::has_byte() {}",
        "";
    a_bound_does_not_make_waiting_for_another_task_short: Wait, "a loop that waits",
        "// wcet-bound: 1
            while BYTES[1].load(Relaxed) & 1 == 0 {}",
        "";
    a_total_is_that_of_one_entry_of_its_loop: BelievedBound, "may enter it, or others that share the total, 2 times",
        "// wcet-bound: one: it is so
            for _ in 0..core::hint::black_box(1) {
                // wcet-total: nine: it is entered once
                for step in 0..core::hint::black_box(9_u32) {
                    device::write_pins(step);
                }
            }",
        "";
    a_total_is_reached_through_the_function_that_it_is_for: BelievedBound, "come to the loop without one",
        "// wcet-total: nine per inlined: it has no more
            for step in 0..core::hint::black_box(9_u32) {
                device::write_pins(step);
            }",
        "";
    a_handler_that_ends_the_locks_of_others_is_refused: CriticalSection, "a lock of a preempted task would end",
        "// SAFETY: it is not.
            unsafe { cortex_m::register::basepri::write(0) };",
        "";
    an_alias_of_a_bit_has_no_time: UncostedAccess, "an alias of a bit",
        "// SAFETY: the alias of a bit of a register of timer 2.
            unsafe { (0x4200_0200 as *mut u32).write_volatile(byte) };",
        "";
}

/// Builds the fixture with code in `idle`, and expects a rule to be broken there, or in the items if there are any.
fn in_idle(name: &str, code: &str, items: &str, rule: Rule, words: &str) {
    let project = or_skip!(Project::new(name));
    let project = project.with("idle", code).with("items", items);
    let first = project.line(code.lines().next().expect("there is code"));
    let (first, lines) = match items.lines().next() {
        Some(item) => (project.line(item), items.lines()),
        None => (first, code.lines()),
    };
    let last = first + lines.count() - 1;
    let flaws = project.flaws();
    let flaw = assert_caught(&flaws, rule, first..=last);
    assert!(flaw.what.contains(words), "{}", flaw.what);
}

/// Tests of that: name, rule, words, code, items.
macro_rules! in_idle {
    ($($name:ident: $rule:ident, $words:literal, $code:literal, $items:literal;)*) => {$(
        #[test]
        fn $name() {
            in_idle(stringify!($name), $code, $items, Rule::$rule, $words);
        }
    )*};
}

in_idle! {
    a_priority_that_is_not_known_begins_a_section: CriticalSection, "a priority that is not known",
        "// SAFETY: the level is that of a byte.
            unsafe { cortex_m::register::basepri::write(device::byte()) };
            device::write_pins(1);
            unsafe { cortex_m::register::basepri::write(0) };",
        "";
    a_section_that_outlasts_its_function_is_caught: CriticalSection, "is not over when its function returns",
        "raise();
            device::write_pins(1);
            lower();",
        "#[inline(never)]
    fn raise() {
        // SAFETY: it is the ceiling of `sum`.
        unsafe { cortex_m::register::basepri::write(0xe0) };
    }
    #[inline(never)]
    fn lower() {
        // SAFETY: nothing is locked.
        unsafe { cortex_m::register::basepri::write(0) };
    }";
    a_mask_that_is_put_back_within_another_section_does_not_end_that: CriticalSection, "more than 200",
        "let (outer, inner): (u32, u32);
            // SAFETY: both are written back.
            unsafe { core::arch::asm!(\"mrs {}, primask\", out(reg) outer) };
            cortex_m::interrupt::disable();
            unsafe { core::arch::asm!(\"mrs {}, primask\", out(reg) inner) };
            cortex_m::interrupt::disable();
            unsafe { core::arch::asm!(\"msr primask, {}\", in(reg) inner) };
            // wcet-bound: 50
            for _ in 0..50 {
                device::write_pins(device::byte().into());
            }
            unsafe { core::arch::asm!(\"msr primask, {}\", in(reg) outer) };",
        "";
    a_priority_at_a_computed_address_is_refused: Register, "at a computed address",
        "// SAFETY: a register of the interrupt controller.
            unsafe { (0xe000_e400_usize as *mut u8).add(device::byte().into()).write_volatile(0) };",
        "";
    an_address_that_may_be_any_is_refused_where_it_is_a_registers: Register, "at a computed address",
        "let address = usize::from(device::byte()) * 0x0101_0101;
            // SAFETY: it may be a register.
            unsafe { (address as *mut u8).write_volatile(0) };",
        "";
    interrupts_that_are_enabled_must_be_known: Mismatch, "is enabled and belongs to no task",
        "let bits = core::hint::black_box(0x200_u32);
            // SAFETY: a register of the interrupt controller.
            unsafe { (0xe000_e104 as *mut u32).write_volatile(bits) };",
        "";
    wait_states_of_the_flash_must_be_those_of_the_clock: Register, "becomes 0x30f, and not 0x205",
        "// SAFETY: the access control of the flash.
            unsafe { (0x4002_3c00 as *mut u32).write_volatile(0x70f) };",
        "";
    prescalers_that_are_changed_are_refused: Register, "a store to 0x40023808, a register of the clocks",
        "let clocks = 0x4002_3808 as *mut u32;
            // SAFETY: the division of the clocks.
            unsafe { clocks.write_volatile(clocks.read_volatile() | 0x1400) };",
        "";
    a_stream_of_dma_is_refused: Register, "a store to 0x40026410, a register of DMA",
        "// SAFETY: the control of a stream.
            unsafe { (0x4002_6410 as *mut u32).write_volatile(1) };",
        "";
    the_grouping_of_priorities_is_refused: Register, "a store to 0xe000ed0c, a register of the processor",
        "// SAFETY: application interrupt and reset control.
            unsafe { (0xe000_ed0c as *mut u32).write_volatile(0x05fa_0700) };",
        "";
    a_bit_of_the_clocks_is_a_register_of_the_clocks: Register, "a store to 0x40023808",
        "// SAFETY: the alias of a bit of the division of the clocks.
            unsafe { (0x4247_0128 as *mut u32).write_volatile(1) };",
        "";
}

/// A faulty function: name, code, broken rule and words of the report.
type Wrong = (&'static str, &'static str, Rule, &'static str);

/// Builds the fixture with calls of such functions, and expects each to be reported at its own lines.
fn check_each_is_reported(name: &str, mark: &str, wrong: &[Wrong], more: &str) {
    let project = or_skip!(Project::new(name));
    let calls: Vec<String> = wrong.iter().map(|it| format!("{}();\n", it.0)).collect();
    let functions = wrong
        .iter()
        .map(|(name, code, ..)| format!("#[inline(never)]\n    fn {name}() {{\n{code}\n    }}\n"));
    let items: String = functions.chain([more.to_owned()]).collect();
    let project = project.with(mark, &calls.concat()).with("items", &items);
    let flaws = project.flaws();
    for (name, code, rule, words) in wrong {
        let first = project.line(&format!("fn {name}()"));
        let lines = first..=first + code.lines().count();
        let mut found = flaws_at(&flaws, *rule, lines);
        assert!(
            found.any(|flaw| flaw.what.contains(words)),
            "`{name}`: no {rule:?} that tells {words:?} in {flaws:#?}"
        );
    }
}

#[test]
fn what_holds_tasks_up_neither_sleeps_nor_waits_nor_calls_what_is_not_known() {
    let wrong: [Wrong; 5] = [
        (
            "sleeps",
            "// SAFETY: it is the ceiling of `sum`.
            unsafe { cortex_m::register::basepri::write(0xe0) };
            cortex_m::asm::wfi();
            // SAFETY: nothing is locked.
            unsafe { cortex_m::register::basepri::write(0) };",
            Rule::ForbiddenInstruction,
            "holds up tasks with deadlines",
        ),
        (
            "waits",
            "cortex_m::interrupt::free(|_| {
                // wcet-bound: 1
                while !device::has_byte() {}
            });",
            Rule::Wait,
            "holds up tasks with deadlines",
        ),
        (
            "calls",
            "let call: fn() = core::hint::black_box(device::acknowledge_timer);
            cortex_m::interrupt::free(|_| {
                call();
            });",
            Rule::IndirectCall,
            "holds up tasks with deadlines",
        ),
        (
            "counts_short",
            "cortex_m::interrupt::free(|_| {
                // wcet-bound: 1
                for _ in 0..200 {
                    device::write_pins(device::byte().into());
                }
            });",
            Rule::WrongBound,
            "holds up tasks with deadlines",
        ),
        (
            "opens_another_mask",
            "// SAFETY: faults stay masked.
            unsafe { core::arch::asm!(\"cpsid f\", \"cpsie i\") };
            device::write_pins(1);",
            Rule::CriticalSection,
            "is not over when its function returns",
        ),
    ];
    check_each_is_reported("in-sections", "idle", &wrong, "");
}

#[test]
fn system_registers_of_the_processor_are_not_written() {
    const PROCESSOR_REGISTER: &str = "a register of the processor";
    let wrong: [Wrong; 7] = [
        (
            "takes_privileges",
            "// SAFETY: what follows runs without privileges.
            unsafe { core::arch::asm!(\"msr control, {}\", in(reg) 1) };",
            Rule::Register,
            "a write of CONTROL",
        ),
        (
            "moves_the_stack",
            "// SAFETY: the top of the memory.
            unsafe { core::arch::asm!(\"msr psp, {}\", in(reg) 0x2002_0000) };",
            Rule::Register,
            "a write of another stack pointer",
        ),
        (
            "sleeps_deeply",
            "// SAFETY: system control.
            unsafe { (0xe000_ed10 as *mut u32).write_volatile(4) };",
            Rule::Register,
            PROCESSOR_REGISTER,
        ),
        (
            "moves_the_vectors",
            "// SAFETY: vector table offset.
            unsafe { (0xe000_ed08 as *mut u32).write_volatile(0x2000_0000) };",
            Rule::Register,
            PROCESSOR_REGISTER,
        ),
        (
            "protects_memory",
            "// SAFETY: control of the memory protection.
            unsafe { (0xe000_ed94 as *mut u32).write_volatile(5) };",
            Rule::Register,
            PROCESSOR_REGISTER,
        ),
        (
            "disables_a_task",
            "// SAFETY: clear-enable of interrupts.
            unsafe { (0xe000_e184 as *mut u32).write_volatile(0x20) };",
            Rule::Register,
            PROCESSOR_REGISTER,
        ),
        (
            "saves_registers_at_once",
            "// SAFETY: floating-point context control.
            unsafe { (0xe000_ef34 as *mut u32).write_volatile(0x8000_0000) };",
            Rule::Register,
            PROCESSOR_REGISTER,
        ),
    ];
    check_each_is_reported("in-the-processor", "idle", &wrong, "");
}

/// Ways for a task to exceed its bound.
const HIDDEN_DELAYS: [Wrong; 14] = [
    (
        "names_too_few",
        "// wcet-bound: axes: it is not
            for step in 0..100_u32 {
                device::write_pins(core::hint::black_box(step));
            }",
        Rule::WrongBound,
        "says that it runs 3 times at most",
    ),
    (
        "names_nothing",
        "// wcet-bound: axles: there are as many
            for step in 0..core::hint::black_box(3_u32) {
                device::write_pins(step);
            }",
        Rule::Configuration,
        "the bound `axles`",
    ),
    (
        "gives_no_reason",
        "// wcet-bound: 9
            for step in 0..core::hint::black_box(9_u32) {
                device::write_pins(step);
            }",
        Rule::BelievedBound,
        "does not say why its bound holds",
    ),
    (
        "never_ends",
        "if device::has_byte() {
                hang();
            }",
        Rule::UnboundedLoop,
        "never returns",
    ),
    (
        "counts_in_all",
        "// wcet-total: 10
            for _ in 0..1000 {
                device::write_pins(device::byte().into());
            }",
        Rule::WrongBound,
        "runs 1",
    ),
    (
        "sleeps",
        "cortex_m::asm::wfe();",
        Rule::ForbiddenInstruction,
        "waits for an event",
    ),
    (
        "calls_a_supervisor",
        "// SAFETY: nobody answers.
            unsafe { core::arch::asm!(\"svc 0\") };",
        Rule::ForbiddenInstruction,
        "a supervisor call",
    ),
    (
        "waits_while_it_works",
        "let mut turns = 0_u32;
            // wcet-bound: 2
            while BYTES[1].load(Relaxed) & 1 == 0 {
                device::write_pins(turns);
                turns = turns.wrapping_add(1);
            }",
        Rule::Wait,
        "a loop that waits",
    ),
    (
        "waits_by_a_call",
        "// wcet-bound: 1
            while !is_ready() {}",
        Rule::Wait,
        "a loop that waits",
    ),
    (
        "waits_by_a_call_for_memory",
        "// wcet-bound: 1
            while !is_set() {}",
        Rule::Wait,
        "a loop that waits",
    ),
    (
        "gives_up_late",
        "// wcet-bound: 20
            for _ in 0..997 {
                if is_ready() {
                    break;
                }
            }",
        Rule::WrongBound,
        "that waits may run",
    ),
    (
        "counts_far",
        "// wcet-bound: 10
            for _ in 0..20_000 {
                next();
            }",
        Rule::WrongBound,
        "runs more than",
    ),
    (
        "stores_for_ever",
        "let mut failed: u32;
            // SAFETY: the store always fails: nothing was loaded.
            unsafe {
                core::arch::asm!(
                    \"2: strex {0}, {1}, [{2}]\",
                    \"cmp {0}, #0\",
                    \"bne 2b\",
                    out(reg) failed,
                    in(reg) 1,
                    in(reg) BYTES[1].as_ptr(),
                );
            }
            device::write_pins(failed);",
        Rule::UnboundedLoop,
        "a loop has no bound",
    ),
    (
        "asks_usb",
        "// SAFETY: a register of the high-speed core.
            device::write_pins(unsafe { (0x4004_0000 as *const u32).read_volatile() });",
        Rule::UncostedAccess,
        "USB",
    ),
];

/// Their callees.
const CALLED_BY_HIDDEN_DELAYS: &str = "#[inline(never)]
    fn is_ready() -> bool {
        device::has_byte()
    }
    #[inline(never)]
    fn next() {
        device::write_pins(core::hint::black_box(1));
    }
    #[inline(never)]
    fn hang() -> ! {
        loop {
            device::write_pins(1);
        }
    }
    #[inline(never)]
    fn is_set() -> bool {
        BYTES[2].load(Relaxed) != 0
    }
";

#[test]
fn a_task_with_a_deadline_hides_no_delay() {
    check_each_is_reported(
        "hidden-delays",
        "receive",
        &HIDDEN_DELAYS,
        CALLED_BY_HIDDEN_DELAYS,
    );
}

/// Builds the fixture with so many calls of a function that shares a total with what it calls.
fn with_calls(name: &str, calls: &str) -> Option<Project> {
    let items = "#[inline(never)]
    fn both(byte: u32) {
        some(byte);
        some(30 - byte);
    }
    #[inline(never)]
    fn some(count: u32) {
        // wcet-total: thirty per both: both have 30 together
        for step in 0..core::hint::black_box(count) {
            device::write_pins(step);
        }
    }";
    Some(
        Project::new(name)?
            .with("receive", calls)
            .with("items", items),
    )
}

#[test]
fn a_total_is_that_of_one_call() {
    let once = or_skip!(with_calls("one-call", "both(byte & 7);"));
    assert_eq!(once.flaws(), []);
    let twice = with_calls("two-calls", "both(byte & 7); both(byte & 3);");
    let twice = twice.expect("the target is installed");
    let first = twice.line("fn some");
    let flaws = twice.flaws();
    let flaw = assert_caught(&flaws, Rule::BelievedBound, first..=first + 5);
    assert!(flaw.what.contains("may make several"), "{}", flaw.what);
}

#[test]
fn a_loop_that_gets_on_by_itself_may_have_a_bound() {
    let code = "BYTES[1].fetch_add(1, Relaxed);
            // wcet-bound: five: it is shifted out
            while BYTES[1].load(Relaxed) != 0 {
                BYTES[1].store(BYTES[1].load(Relaxed) >> 1, Relaxed);
            }
            // wcet-bound: five: it comes round
            while BYTES[2].load(Relaxed) & 1 == 0 {
                next();
            }";
    let items = "#[inline(never)]
    fn next() {
        BYTES[2].store(BYTES[2].load(Relaxed).rotate_left(1), Relaxed);
    }";
    let project = or_skip!(Project::new("by-itself"));
    let project = project.with("receive", code).with("items", items);
    assert_eq!(project.flaws(), []);
}

#[test]
fn code_that_no_symbol_tells_holds_no_interrupts_back() {
    let code = "let call: unsafe extern \"C\" fn() = core::hint::black_box(bare::unanalysed);
            // SAFETY: it returns.
            unsafe { call() };";
    let items = "mod bare {
        core::arch::global_asm!(
            \".section .text.unanalysed\",
            \".thumb\",
            \".global unanalysed\",
            \"unanalysed:\",
            \"cpsid i\",
            \"bx lr\",
        );
        unsafe extern \"C\" {
            pub fn unanalysed();
        }
    }";
    let project = or_skip!(Project::new("unanalysed"));
    let flaws = project.with("idle", code).with("items", items).flaws();
    let mut found = flaws
        .iter()
        .filter(|flaw| flaw.rule == Rule::UnknownInstruction);
    assert!(
        found.any(|flaw| flaw.what.contains("the analysis finds no way")),
        "{flaws:#?}"
    );
}

#[test]
fn a_vector_whose_handler_is_exempt_is_enabled_by_who_may() {
    let code = "// SAFETY: the handler does nothing.
            unsafe { (0xe000_e104 as *mut u32).write_volatile(1 << 18) };";
    let items = "#[unsafe(no_mangle)]
    extern \"C\" fn TIM5() {
        device::write_pins(1);
    }";
    let exempt = "[[exempt]]\nfunction = \"TIM5\"\nreason = \"it is never enabled\"\n\n[[exempt]]";
    let project = or_skip!(Project::new("exempt-vector"));
    let project = project.with("idle", code).with("items", items);
    let project = project.configured("[[exempt]]", exempt);
    let elf = project.build();
    let flaws = project.analyse(&elf).flaws;
    let line = project.line("1 << 18");
    let flaw = assert_caught(&flaws, Rule::Mismatch, line..=line);
    assert!(flaw.what.contains("vector 66 is enabled"), "{}", flaw.what);
    let register = "[[register]]\nfrom = 0xe000_e104\nto = 0xe000_e108\nby = [\"::idle\"]\n\
                    reason = \"it may\"\n\n[[exempt]]\nfunction = \"main\"";
    let project = project.configured("[[exempt]]\nfunction = \"main\"", register);
    assert_eq!(project.analyse(&elf).flaws, []);
}

#[test]
fn what_two_tasks_write_without_a_lock_is_caught() {
    let items = "static PLACE: AtomicU32 = AtomicU32::new(0);";
    let urgent = "device::acknowledge_timer(); PLACE.store(1 ^ PLACE.load(Relaxed), Relaxed);";
    let project = or_skip!(Project::new("race"));
    let project = project
        .with("items", items)
        .with("idle", "PLACE.store(2, Relaxed);");
    let project = project.replacing("device::acknowledge_timer();", urgent);
    let line = project.line(urgent);
    let elf = project.build();
    let flaw = assert_caught(&project.analyse(&elf).flaws, Rule::Race, line..=line).clone();
    assert!(
        flaw.what
            .starts_with("`step` and the less urgent `idle` both write 0x2"),
        "{}",
        flaw.what
    );
    let entry = "[[shared]]\nby = [\"src/app.rs\"]\nreason = \"why not\"\n\n[[exempt]]";
    let project = project.configured("[[exempt]]", entry);
    assert_eq!(project.analyse(&elf).flaws, []);
    // What is read and written in one step is no race.
    let project = or_skip!(Project::new("no-race"));
    let idle = "PLACE.fetch_add(2, Relaxed);";
    let project = project.with("items", items).with("idle", idle);
    let urgent = "device::acknowledge_timer(); PLACE.fetch_add(1, Relaxed);";
    let project = project.replacing("device::acknowledge_timer();", urgent);
    assert_eq!(project.flaws(), []);
}
