//! Each rule, broken in a real program: an RTIC application that is proven, with one thing wrong.

mod project;

use project::{Project, assert_caught};
use schedule::Rule;

/// What is found, or the end of the test, which has said why there is nothing.
macro_rules! or_skip {
    ($found:expr) => {
        match $found {
            Some(found) => found,
            None => return,
        }
    };
}

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
