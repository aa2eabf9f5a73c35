//! Each rule, broken in a real program: an RTIC application that is proven, with one thing wrong.

#[path = "../project/mod.rs"]
mod project;

use std::{fs, path::Path, process::Command};

use project::{Project, assert_caught};
use schedule::{Report, Rule};

/// The value, or the end of the test, which has printed why there is none.
macro_rules! or_skip {
    ($found:expr) => {
        match $found {
            Some(found) => found,
            None => return,
        }
    };
}

mod certificate;
mod code;
mod releases;
mod startup;
mod tasks_without_deadline;

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
fn a_section_with_several_flaws_is_the_one_that_is_reported() {
    let items = "fn called() { device::write_pins(1); }
    #[inline(never)]
    fn first() { let call: fn() = core::hint::black_box(called); call(); }
    #[inline(never)]
    fn second() { let call: fn() = core::hint::black_box(called); call(); device::write_pins(2); }";
    let section = |name: &str, code: &str| {
        let code = format!("cortex_m::interrupt::free(|_| {{ {code} }});");
        let project = Project::new(name)?.with("idle", &code);
        Some(project.with("items", items).flaws())
    };
    let flaws = or_skip!(section("two-calls", "first(); second();"));
    let found: Vec<(Rule, &str)> = flaws.iter().map(|it| (it.rule, &*it.what)).collect();
    let expected = "a section with interrupts held back has 2 flaws, as: this function calls";
    assert!(found[0].1.starts_with(expected), "{found:?}");
    assert!(found.iter().all(|(rule, _)| *rule != Rule::IndirectCall));
    let flaws = or_skip!(section("one-call", "first();"));
    assert_eq!(flaws[0].rule, Rule::IndirectCall, "{flaws:#?}");
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
    let is_reported = |name: &str| {
        let mut flaws = flaws.iter().filter(|flaw| flaw.rule == Rule::Configuration);
        flaws.any(|flaw| flaw.what.contains(name) && !flaw.remedy.is_empty())
    };
    assert!(
        is_reported("`work`") && is_reported("`labour`"),
        "{flaws:#?}"
    );
}

#[test]
fn a_requirement_that_is_not_met_is_reported_with_both_figures() {
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
fn runs_of_another_regime_never_interfere() {
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
fn a_loop_that_counts_and_reads_may_have_a_bound() {
    let code = "// wcet-bound: twenty: there are no more
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
    let code = "let before = cortex_m::register::basepri::read();
        // SAFETY: it is the ceiling of `sum`.
        unsafe { cortex_m::register::basepri_max::write(0xe0) };
        device::write_pins(*cx.local.pins);
        unsafe { cortex_m::register::basepri::write(before) };";
    let project = or_skip!(Project::new("from-above"));
    let project = project.replacing("device::write_pins(*cx.local.pins);", code);
    let line = project.line("basepri_max::write(0xe0)");
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

/// A function that a task with a deadline calls on a condition.
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
fn a_path_through_a_task_that_no_mode_has_is_caught() {
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
