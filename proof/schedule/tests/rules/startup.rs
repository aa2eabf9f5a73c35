//! The order of the initialisation and the feeding of the watchdog, broken in a real program.

use schedule::Rule;

use super::project::{Project, assert_caught};

/// Configures the register of pins as that of a watchdog, which 0xaaaa feeds.
pub(crate) fn with_watchdog(project: Project) -> Project {
    project.configured(
        "[[exempt]]",
        "[watchdog]\nkey = 0x4002_0018\nfeed = 0xaaaa\nperiod = \"100ms\"\n\n\
         [[watchdog.unfed]]\nfunction = \"HardFault_\"\nreason = \"the end\"\n\n\
         [[watchdog.unfed]]\nfunction = \"DefaultHandler_\"\nreason = \"the end\"\n\n\
         [[exempt]]",
    )
}

#[test]
fn a_loop_that_waits_without_feeding_the_watchdog_is_caught() {
    const FEED: &str = "device::write_pins(0xaaaa);";
    let idle = |name: &str, code: &str| {
        let project = with_watchdog(Project::new(name)?).with("idle", code);
        let first = project.line(code.lines().next()?);
        Some((project.flaws(), first))
    };
    let (flaws, _) = or_skip!(idle("fed", FEED));
    assert_eq!(flaws, []);
    let fed = format!("{FEED}\nwhile !device::has_byte() {{ {FEED} }}");
    let (flaws, _) = or_skip!(idle("fed-twice", &fed));
    assert_eq!(flaws, []);
    let waits = format!("{FEED}\nwhile !device::has_byte() {{}}");
    let (flaws, line) = or_skip!(idle("unfed", &waits));
    let flaw = assert_caught(&flaws, Rule::Watchdog, line + 1..=line + 1);
    assert!(flaw.what.contains("may last"), "{}", flaw.what);
    // Another key feeds nothing, nor does one in some runs.
    let sometimes = format!("if device::has_byte() {{ {FEED} }}");
    for (name, code) in [
        ("other-key", "device::write_pins(0x5555);"),
        ("sometimes", &sometimes),
    ] {
        let (flaws, _) = or_skip!(idle(name, code));
        let mut found = flaws.iter().filter(|flaw| flaw.rule == Rule::Watchdog);
        assert!(
            found.any(|flaw| flaw.what.contains("no loop feeds")),
            "{flaws:#?}"
        );
    }
}

#[test]
fn a_watchdog_that_waits_less_than_the_tasks_with_deadlines_may_take_is_caught() {
    let project = or_skip!(Project::new("short-watchdog"));
    let project = with_watchdog(project).with("idle", "device::write_pins(0xaaaa);");
    let project = project.configured("period = \"100ms\"", "period = \"0.5us\"");
    let flaws = project.flaws();
    let mut found = flaws.iter().filter(|flaw| flaw.rule == Rule::Requirement);
    assert!(
        found.any(|flaw| flaw.what.starts_with("wait of the watchdog")),
        "{flaws:#?}"
    );
}

#[test]
fn a_function_that_need_not_feed_the_watchdog_and_is_not_there_is_reported() {
    let reported = |name: &str, only: &str| {
        let entry = format!(
            "[[watchdog.unfed]]\nfunction = \"old_name\"\nreason = \"it was there\"\n{only}\n[[exempt]]"
        );
        let project =
            with_watchdog(Project::new(name)?).with("idle", "device::write_pins(0xaaaa);");
        Some(configuration_flaws(
            &project.configured("[[exempt]]", &entry),
        ))
    };
    let what = "a `[[watchdog.unfed]]` names `old_name`, which is no function of the program";
    assert_eq!(or_skip!(reported("stranger", "")), [what]);
    // Another program may have it.
    let others = or_skip!(reported("stranger-of-some", "only = \"some boards\"\n"));
    assert_eq!(others, [""; 0]);
}

#[test]
fn a_program_with_a_watchdog_of_which_nothing_is_said_is_reported() {
    let project = or_skip!(Project::new("no-tables"));
    let store = "// SAFETY: the register that feeds the watchdog.
            unsafe { (0x4000_3000 as *mut u32).write_volatile(0xaaaa) };";
    let project = project.with("idle", store);
    let reported = ["startup", "watchdog"].map(|table| {
        format!("the program has a watchdog, and `schedule.toml` has no table [{table}]")
    });
    assert_eq!(configuration_flaws(&project), reported);
}

/// The flaws of `schedule.toml`.
fn configuration_flaws(project: &Project) -> Vec<String> {
    let flaws = project.flaws().into_iter();
    let flaws = flaws.filter(|flaw| flaw.rule == Rule::Configuration);
    flaws.map(|flaw| flaw.what).collect()
}

/// The parts of an initialisation.
const ITEMS: &str = "#[inline(always)]
    fn outputs() {
        device::write_pins(1);
        device::write_pins(2);
    }
    #[inline(always)]
    fn clocks() {
        device::acknowledge_timer();
    }
    #[inline(never)]
    fn cause() {
        let _ = device::has_byte();
    }";

#[test]
fn an_initialisation_in_the_wrong_order_is_caught() {
    let flaws = |name: &str, code: &str| {
        let project = Project::new(name)?;
        let project = project.configured(
            "[[exempt]]",
            "[startup]\nfunction = \"__rtic_init_resources\"\n\
             order = [\"outputs\", \"clocks\"]\nsafe = \"outputs\"\nbefore = [\"cause\"]\n\n[[exempt]]",
        );
        let project = project.replacing("#[shared]", &format!("{ITEMS}\n    #[shared]"));
        let project = project.replacing(
            "(Shared { sum: 0 }",
            &format!("{code} (Shared {{ sum: 0 }}"),
        );
        let mut flaws = project.flaws();
        flaws.retain(|flaw| matches!(flaw.rule, Rule::Startup | Rule::Configuration));
        Some(flaws.into_iter().map(|flaw| flaw.what).collect::<Vec<_>>())
    };
    let may_begin = "`clocks` may begin before `outputs` is over";
    for (name, code, expected) in [
        ("in-order", "cause(); outputs(); clocks();", &[][..]),
        (
            "early-clocks",
            "clocks(); outputs(); cause();",
            &[may_begin, "something is done before `outputs` is over"],
        ),
        (
            "early-byte",
            "cause(); let _ = device::byte(); outputs(); clocks();",
            &["something is done before `outputs` is over"],
        ),
        (
            "in-between",
            "cause(); outputs(); clocks(); outputs();",
            &[may_begin, "something is done before `outputs` is over"],
        ),
        (
            "some-outputs",
            "cause(); if device::has_byte() { outputs(); } clocks();",
            &[may_begin, "something is done before `outputs` is over"],
        ),
        (
            "no-clocks",
            "cause(); outputs();",
            &["`clocks` does nothing in `"],
        ),
        (
            "no-cause",
            "outputs(); clocks();",
            &["`before` of [startup] names `cause`, which is no function of the program"],
        ),
    ] {
        let flaws = or_skip!(flaws(name, code));
        assert_eq!(flaws.len(), expected.len(), "{name}: {flaws:#?}");
        for text in expected {
            assert!(
                flaws.iter().any(|flaw| flaw.contains(text)),
                "{name}: {flaws:#?}"
            );
        }
    }
}
