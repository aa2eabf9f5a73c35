//! Each rule, broken in a real program: an RTIC application that is proven, with one thing wrong.

#[path = "../project/mod.rs"]
mod project;

use std::{fs, path::Path, process::Command};

use project::{Project, assert_caught, told_at};
use schedule::{Report, Rule};

/// What is found, or the end of the test, which has said why there is nothing.
macro_rules! or_skip {
    ($found:expr) => {
        match $found {
            Some(found) => found,
            None => return,
        }
    };
}

mod startup;
mod uncounted;

/// Builds the fixture with code in the task `receive`, and items beside it, and expects a rule to be
/// broken there, told with these words.
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

/// A function with something wrong in it: name, code, rule and words that tell it.
type Wrong = (&'static str, &'static str, Rule, &'static str);

/// Builds the fixture with calls of such functions, and expects each to be told at its own lines.
fn each_is_caught(name: &str, mark: &str, wrong: &[Wrong], more: &str) {
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
        let mut told = told_at(&flaws, *rule, lines);
        assert!(
            told.any(|flaw| flaw.what.contains(words)),
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
    each_is_caught("in-sections", "idle", &wrong, "");
}

#[test]
fn what_the_proof_rests_on_in_the_processor_is_not_written() {
    const STORE: &str = "a register of the processor";
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
            STORE,
        ),
        (
            "moves_the_vectors",
            "// SAFETY: vector table offset.
            unsafe { (0xe000_ed08 as *mut u32).write_volatile(0x2000_0000) };",
            Rule::Register,
            STORE,
        ),
        (
            "protects_memory",
            "// SAFETY: control of the memory protection.
            unsafe { (0xe000_ed94 as *mut u32).write_volatile(5) };",
            Rule::Register,
            STORE,
        ),
        (
            "disables_a_task",
            "// SAFETY: clear-enable of interrupts.
            unsafe { (0xe000_e184 as *mut u32).write_volatile(0x20) };",
            Rule::Register,
            STORE,
        ),
        (
            "saves_registers_at_once",
            "// SAFETY: floating-point context control.
            unsafe { (0xe000_ef34 as *mut u32).write_volatile(0x8000_0000) };",
            Rule::Register,
            STORE,
        ),
    ];
    each_is_caught("in-the-processor", "idle", &wrong, "");
}

/// Ways of a task to take longer than is told.
const GUISES: [Wrong; 11] = [
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
            while !is_told() {}",
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
        "// SAFETY: a register of USB.
            device::write_pins(unsafe { (0x5000_0000 as *const u32).read_volatile() });",
        Rule::UncostedAccess,
        "USB",
    ),
];

/// What they call.
const CALLED_IN_GUISES: &str = "#[inline(never)]
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
    fn is_told() -> bool {
        BYTES[2].load(Relaxed) != 0
    }
";

#[test]
fn a_task_with_a_deadline_waits_in_no_guise() {
    each_is_caught("in-guises", "receive", &GUISES, CALLED_IN_GUISES);
}

#[test]
fn a_loop_that_gets_on_by_itself_may_have_a_bound() {
    let code = "BYTES[1].fetch_add(1, Relaxed);
            // wcet-bound: 5
            while BYTES[1].load(Relaxed) != 0 {
                BYTES[1].store(BYTES[1].load(Relaxed) >> 1, Relaxed);
            }
            // wcet-bound: 5
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
    let code = "let call: unsafe extern \"C\" fn() = core::hint::black_box(bare::untold);
            // SAFETY: it returns.
            unsafe { call() };";
    let items = "mod bare {
        core::arch::global_asm!(
            \".section .text.untold\",
            \".thumb\",
            \".global untold\",
            \"untold:\",
            \"cpsid i\",
            \"bx lr\",
        );
        unsafe extern \"C\" {
            pub fn untold();
        }
    }";
    let project = or_skip!(Project::new("untold"));
    let flaws = project.with("idle", code).with("items", items).flaws();
    let mut told = flaws
        .iter()
        .filter(|flaw| flaw.rule == Rule::UnknownInstruction);
    assert!(
        told.any(|flaw| flaw.what.contains("the analysis finds no way")),
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
fn an_application_that_keeps_all_rules_is_proven() {
    let project = or_skip!(Project::new("proven"));
    let report = project.analyse(&project.build());
    assert_eq!(report.flaws, []);
    assert_eq!(report.tasks.len(), 3);
    for task in &report.tasks {
        let (response, deadline) = (task.response_cycles.unwrap(), task.deadline_cycles.unwrap());
        assert!(response as f64 <= deadline, "{task:?}");
    }
    assert!(report.proven_step_rate_hz["115200"] > 100_000);
    assert!(report.stack_worst_bytes > 0 && report.step_wcet_cycles > 24);
}

#[test]
fn recursion_is_refused() {
    let code = "device::write_pins(deeper(byte));";
    let items = "#[inline(never)]
    fn deeper(byte: u32) -> u32 {
        device::write_pins(byte);
        if byte == 0 { 1 } else { byte ^ deeper(byte >> 1).wrapping_mul(byte) }
    }";
    let project = or_skip!(Project::new("recursion"));
    let project = project.with("receive", code).with("items", items);
    let call = project.line("byte ^ deeper");
    assert_caught(&project.flaws(), Rule::Recursion, call..=call);
}

#[test]
fn a_critical_section_anywhere_in_the_image_is_measured() {
    let code = "cortex_m::interrupt::free(|_| {
                // wcet-bound: 50
                for _ in 0..50 {
                    device::write_pins(device::byte().into());
                }
            });";
    let project = or_skip!(Project::new("critical-section"));
    let project = project.with("idle", code);
    let first = project.line("interrupt::free");
    let flaws = project.flaws();
    let flaw = assert_caught(&flaws, Rule::CriticalSection, first..=first + 5);
    assert!(flaw.what.contains("more than 200"), "{}", flaw.what);
}

#[test]
fn an_encoding_that_is_not_known_is_refused() {
    let code = "device::odd();";
    let project = or_skip!(Project::new("unknown-instruction"));
    let code = code.replace(
        "device::odd();",
        "// SAFETY: it is never executed.
            unsafe { core::arch::asm!(\".inst.w 0xee000e10\") }",
    );
    let project = project.with("receive", &code);
    let line = project.line(".inst.w");
    assert_caught(&project.flaws(), Rule::UnknownInstruction, line..=line);
}

#[test]
fn a_priority_that_is_not_the_binary_s_is_caught() {
    let project = or_skip!(Project::new("wrong-priority"));
    let elf = project.build();
    let project = project.replacing(
        "binds = USART1, priority = 2",
        "binds = USART1, priority = 4",
    );
    let flaws = project.analyse(&elf).flaws;
    let line = project.line("fn receive(");
    let flaw = assert_caught(&flaws, Rule::Mismatch, line - 1..=line);
    assert!(flaw.what.contains("priority"), "{}", flaw.what);
}

#[test]
fn an_exception_of_the_processor_may_be_a_task_and_its_priority_is_compared() {
    let project = or_skip!(Project::new("system-exception"));
    let project = project.replacing("binds = TIM2", "binds = SysTick");
    let elf = project.build();
    let report = project.analyse(&elf);
    assert_eq!(report.flaws, []);
    assert_eq!(report.tasks[0].name, "step");
    let project = project.replacing(
        "binds = SysTick, priority = 3",
        "binds = SysTick, priority = 5",
    );
    let flaws = project.analyse(&elf).flaws;
    let line = project.line("fn step(");
    let flaw = assert_caught(&flaws, Rule::Mismatch, line - 1..=line);
    assert!(flaw.what.contains("priority of vector 15"), "{}", flaw.what);
}

#[test]
fn a_vector_that_is_not_the_binary_s_is_caught() {
    let project = or_skip!(Project::new("wrong-vector"));
    let elf = project.build();
    let project = project.replacing("binds = USART1", "binds = USART2");
    let flaws = project.analyse(&elf).flaws;
    let line = project.line("fn receive(");
    let flaw = assert_caught(&flaws, Rule::Mismatch, line - 1..=line);
    assert!(flaw.what.contains("USART2"), "{}", flaw.what);
}

#[test]
fn a_ceiling_that_is_not_the_binary_s_is_caught() {
    let project = or_skip!(Project::new("wrong-ceiling"));
    let elf = project.build();
    // Now the source says that nobody above idle locks it.
    let project = project.replacing(", local = [place], shared = [sum]", ", local = [place]");
    let flaws = project.analyse(&elf).flaws;
    let line = project.line("sum.rotate_left(1)");
    assert_caught(&flaws, Rule::Mismatch, line..=line);
}

#[test]
fn a_deadline_that_is_too_short_is_missed() {
    let project = or_skip!(Project::new("missed-deadline"));
    let project = project.configured("deadline = \"200us\"", "deadline = \"3us\"");
    let flaws = project.flaws();
    let line = project.line("fn work(");
    let flaw = assert_caught(&flaws, Rule::DeadlineMissed, line - 1..=line + 10);
    assert!(
        flaw.what.contains("`work`") && flaw.what.contains("3.0 µs"),
        "{}",
        flaw.what
    );
}

#[test]
fn a_task_without_times_is_a_fault_of_the_configuration() {
    let project = or_skip!(Project::new("no-times"));
    let project = project.configured("[task.work]", "[task.labour]");
    let flaws = project.flaws();
    let told = |name: &str| {
        let mut flaws = flaws.iter().filter(|flaw| flaw.rule == Rule::Configuration);
        flaws.any(|flaw| flaw.what.contains(name) && !flaw.remedy.is_empty())
    };
    assert!(told("`work`") && told("`labour`"), "{flaws:#?}");
}

#[test]
fn a_requirement_that_is_not_met_is_told_with_both_figures() {
    let project = or_skip!(Project::new("unmet"));
    let project = project.configured("step_wcet_cycles = 200", "step_wcet_cycles = 20");
    let flaws = project.flaws();
    let flaw = flaws.iter().find(|flaw| flaw.rule == Rule::Requirement);
    let flaw = flaw.unwrap_or_else(|| panic!("{flaws:#?}"));
    assert!(
        flaw.what.contains("20 cycles") && !flaw.remedy.is_empty(),
        "{}",
        flaw.what
    );
}

#[test]
fn the_wait_of_tasks_without_a_deadline_has_the_limit_that_is_required() {
    let with = |name: &str, us: &str| {
        let limit = format!("step_wcet_cycles = 200\nundeadlined_wait_us = {{ 115200 = {us} }}");
        let project = Project::new(name)?;
        Some(project.configured("step_wcet_cycles = 200", &limit))
    };
    let project = or_skip!(with("short-wait", "100"));
    let report = project.analyse(&project.build());
    assert_eq!(report.flaws, []);
    let mut waits = report.undeadlined_waits.iter();
    let wait = waits.find(|it| (it.step_rate_hz, it.baud) == (report.step_rate_hz, report.baud));
    let wait = wait.and_then(|it| it.cycles).unwrap();
    // The task of the lowest priority ends last, and no other is released a second time before.
    let lowest = report.tasks.last().unwrap();
    assert_eq!(Some(wait), lowest.response_cycles, "{}", lowest.name);
    let project = with("long-wait", "1").expect("the target is installed");
    let flaws = project.flaws();
    let flaw = flaws.iter().find(|flaw| flaw.rule == Rule::Requirement);
    let flaw = flaw.unwrap_or_else(|| panic!("{flaws:#?}"));
    assert!(
        flaw.what.contains("wait without a deadline at 100000 Hz"),
        "{}",
        flaw.what
    );
}

#[test]
fn code_in_ram_that_needs_the_flash_is_caught() {
    let project = or_skip!(Project::new("flash-from-ram"));
    let items = |body: &str| {
        format!(
            "#[unsafe(link_section = \".data.resident\")]
            #[inline(never)]
            fn resident() {{
                {body}
            }}
            #[inline(never)]
            fn distant() {{
                device::write_pins(core::hint::black_box(1));
            }}"
        )
    };
    let project = project.with("idle", "resident();");
    let project = project.with("items", &items("distant();"));
    let line = project.line("distant();");
    let flaws = project.flaws();
    let flaw = assert_caught(&flaws, Rule::CodeInRam, line..=line);
    assert!(flaw.what.contains("distant"), "{}", flaw.what);
    let inlined = "device::write_pins(core::hint::black_box(1));";
    let project = project.replacing("distant();", inlined);
    assert_eq!(project.flaws(), []);
}

#[test]
fn runs_of_another_regime_are_never_in_the_way() {
    let response = |name: &str, regimes: [&str; 2]| {
        let mode = |name: &str, regime: &str| {
            format!(
                "[task.work.mode.{name}]\nexcludes = []\nperiod = \"10s / baud\"\n\
                 deadline = \"200us\"\nregime = \"{regime}\"\n"
            )
        };
        let project = Project::new(name)?.configured(
            "[task.work]\nperiod = \"10s / baud\"\ndeadline = \"200us\"\n",
            &(mode("one", regimes[0]) + &mode("two", regimes[1])),
        );
        let report = project.analyse(&project.build());
        let task = report.tasks.iter().find(|task| task.name == "work: one");
        task.and_then(|task| task.response_cycles)
    };
    let together = or_skip!(response("one-regime", ["a", "a"]));
    let alone = response("two-regimes", ["a", "b"]).expect("it is bounded");
    assert!(alone < together, "{alone} of {together} cycles");
}

#[test]
fn a_loop_that_counts_beside_what_it_reads_may_have_a_bound() {
    let code = "// wcet-bound: 20
            for _ in 0..core::hint::black_box(20) {
                if device::has_byte() {
                    break;
                }
            }";
    let project = or_skip!(Project::new("counted-wait"));
    assert_eq!(project.with("receive", code).flaws(), []);
}

#[test]
fn a_section_below_the_task_that_enters_it_is_caught() {
    let code = "// SAFETY: it is the ceiling of `sum`.
        unsafe { cortex_m::register::basepri::write(0xe0) };
        device::write_pins(*cx.local.pins);
        unsafe { cortex_m::register::basepri::write(0) };";
    let project = or_skip!(Project::new("from-above"));
    let project = project.replacing("device::write_pins(*cx.local.pins);", code);
    let line = project.line("basepri::write(0xe0)");
    let flaws = project.flaws();
    let flaw = assert_caught(&flaws, Rule::CriticalSection, line..=line);
    assert!(flaw.what.contains("is entered by `step`"), "{}", flaw.what);
}

#[test]
fn floating_point_in_an_urgent_task_is_caught() {
    let code = "let level = f32::from(device::byte()) * 1.5;
            device::write_pins(core::hint::black_box(level) as u32);";
    let project = or_skip!(Project::new("float"));
    let project = project.with("receive", code);
    // The compiler may compute in advance.
    let lines = project.line("fn receive(")..=project.line("f32::from") + 1;
    let flaws = project.flaws();
    let flaw = assert_caught(&flaws, Rule::FloatingPoint, lines);
    assert!(flaw.what.contains("`receive`"), "{}", flaw.what);
}

/// What a task with a deadline calls, on a condition.
const HELPER_MODULE: &str = "mod helper {
        #[inline(never)]
        pub fn main() {
            while !crate::device::has_byte() {}
        }
    }";

#[test]
fn an_exemption_is_for_the_function_of_that_whole_path() {
    let code = "if byte > 100 { helper::main(); }";
    let project = or_skip!(Project::new("exempt-by-name"));
    let project = project.with("receive", code).with("items", HELPER_MODULE);
    let line = project.line("has_byte() {}");
    assert_caught(&project.flaws(), Rule::UnboundedLoop, line..=line);
}

#[test]
fn what_is_exempt_is_not_called_by_a_task_with_a_deadline() {
    let code = "if byte > 100 { helper::main(); }";
    let project = or_skip!(Project::new("exempt-call"));
    let project = project.with("receive", code).with("items", HELPER_MODULE);
    let exempt = "[[exempt]]\nfunction = \"exempt-call::app::app::helper::main\"\n\
                  reason = \"at rest only\"\n\n[[exempt]]";
    let exempt = exempt.replace("exempt-call::", "exempt_call::");
    let project = project.configured("[[exempt]]", &exempt);
    let line = project.line("helper::main();");
    let flaws = project.flaws();
    let flaw = assert_caught(&flaws, Rule::Exemption, line..=line);
    assert!(flaw.what.contains("helper::main`"), "{}", flaw.what);
}

#[test]
fn a_way_through_a_task_that_no_mode_has_is_caught() {
    let build = |name: &str, second: &str| {
        let items = "#[inline(never)]
    fn produce() {
        device::write_pins(core::hint::black_box(1));
    }
    #[inline(never)]
    fn answer() {
        device::write_pins(core::hint::black_box(2));
    }";
        let code = format!(
            "if BYTES[1].load(Relaxed) != 0 {{ produce(); }}
        {second} BYTES[2].load(Relaxed) != 0 {{ answer(); }}
        BYTES[7].store(sum, Relaxed);"
        );
        let mode = |name: &str, excluded: &str| {
            format!(
                "[task.work.mode.{name}]\nexcludes = [\"app::{excluded}\"]\n\
                 period = \"10s / baud\"\ndeadline = \"200us\"\n"
            )
        };
        let project = Project::new(name)?.configured(
            "[task.work]\nperiod = \"10s / baud\"\ndeadline = \"200us\"\n",
            &(mode("one", "produce") + &mode("two", "answer")),
        );
        let project = project.replacing("BYTES[7].store(sum, Relaxed);", &code);
        Some(project.with("items", items))
    };
    let alternatives = or_skip!(build("one-mode-each", "else if"));
    assert_eq!(alternatives.flaws(), []);
    let both = build("both-modes", "if").expect("the target is installed");
    let line = both.line("answer(); }");
    let flaws = both.flaws();
    let flaw = assert_caught(&flaws, Rule::Mode, line..=line);
    let names = ["::produce`", "::answer`"];
    assert!(
        names.iter().all(|name| flaw.what.contains(name)),
        "{}",
        flaw.what
    );
}

#[test]
fn a_mode_that_excludes_a_name_of_several_functions_is_refused() {
    let build = |name: &str, excluded: &str| {
        let mode = format!(
            "[task.work.mode.one]\nexcludes = [\"{excluded}\"]\n\
             period = \"10s / baud\"\ndeadline = \"200us\"\n"
        );
        let project = Project::new(name)?.configured(
            "[task.work]\nperiod = \"10s / baud\"\ndeadline = \"200us\"\n",
            &mode,
        );
        let code = "if BYTES[1].load(Relaxed) != 0 { produce(); other::produce(); }
        BYTES[7].store(sum, Relaxed);";
        let project = project.replacing("BYTES[7].store(sum, Relaxed);", code);
        let items = "#[inline(never)]
    fn produce() {
        device::write_pins(core::hint::black_box(1));
    }
    mod other {
        #[inline(never)]
        pub fn produce() {
            crate::device::write_pins(core::hint::black_box(2));
        }
    }";
        Some(project.with("items", items))
    };
    let one = or_skip!(build("one-function", "other::produce"));
    assert_eq!(one.flaws(), []);
    let two = build("two-functions", "produce").expect("the target is installed");
    let flaws = two.flaws();
    assert!(
        flaws.iter().any(|flaw| flaw.rule == Rule::Configuration
            && flaw.what.contains("excludes `produce`")
            && flaw.what.contains("several functions")),
        "{flaws:?}"
    );
}

/// How many response times of a report another program finds to be right, or what it finds wrong;
/// `None`, and a word why, where there is no Python.
fn recompute(report: &Path) -> Option<Result<usize, String>> {
    let script = Path::new(env!("CARGO_MANIFEST_DIR")).join("tests/recompute.py");
    let Ok(output) = Command::new("python3").arg(script).arg(report).output() else {
        println!("skipped: there is no python3");
        return None;
    };
    let said = String::from_utf8_lossy(&output.stdout).trim().to_owned();
    Some(if output.status.success() {
        Ok(said.parse().expect("it prints a number"))
    } else {
        Err(said)
    })
}

#[test]
fn response_times_follow_from_the_report_alone() {
    let project = or_skip!(Project::new("recomputed"));
    let mut report = project.analyse(&project.build());
    let path = Path::new(env!("CARGO_TARGET_TMPDIR")).join("rules/recomputed.json");
    let found = |report: &Report| {
        fs::write(&path, serde_json::to_string(report).unwrap()).unwrap();
        recompute(&path)
    };
    assert_eq!(or_skip!(found(&report)), Ok(3));
    let response = report.tasks[1].response_cycles.as_mut().unwrap();
    *response += 1;
    let wrong = found(&report).unwrap().unwrap_err();
    assert!(wrong.contains("receive"), "{wrong}");
    *report.tasks[1].response_cycles.as_mut().unwrap() -= 1;
    for wait in &mut report.undeadlined_waits {
        wait.cycles = wait.cycles.map(|cycles| cycles + 1);
    }
    let wrong = found(&report).unwrap().unwrap_err();
    assert!(wrong.contains("without a deadline"), "{wrong}");
    // The report that the documents show.
    let shown = Path::new(env!("CARGO_MANIFEST_DIR")).join("../../docs/schedule.json");
    let text = fs::read_to_string(&shown).unwrap();
    let value: serde_json::Value = serde_json::from_str(&text).unwrap();
    let tasks = value["tasks"].as_array().unwrap().iter();
    let with_window = tasks.filter(|task| task["window"].is_object());
    assert_eq!(recompute(&shown), Some(Ok(with_window.count())));
}
