//! What releases tasks, wrong in a real program.

use schedule::{Flaw, Rule};

use super::project::{Project, assert_caught};

fn release(flaws: &[Flaw]) -> Vec<&str> {
    let found = flaws.iter().filter(|flaw| flaw.rule == Rule::Release);
    found.map(|flaw| &*flaw.what).collect()
}

#[test]
fn a_release_that_no_task_counts_with_is_caught() {
    const PEND: &str = "device::acknowledge_timer(); rtic::pend(device::Interrupt::I2C3_EV);";
    let project = or_skip!(Project::new("undeclared-release"));
    let project = project.replacing("device::acknowledge_timer();", PEND);
    let line = project.line(PEND);
    let elf = project.build();
    let report = project.analyse(&elf);
    let flaw = assert_caught(&report.flaws, Rule::Release, line..=line);
    let expected = "`step` may release `work`, and `schedule.toml` does not say so";
    assert_eq!(flaw.what, expected);
    assert!(report.releases["step"].contains("work") && report.releases["work"].is_empty());
    let deadline = "deadline = \"2us\"";
    let project = project.configured(deadline, &format!("{deadline}\nreleases = [\"work\"]"));
    assert_eq!(release(&project.analyse(&elf).flaws), [""; 0]);
}

#[test]
fn a_task_that_always_releases_itself_is_caught() {
    let declared = |name: &str, code: &str| {
        let project = Project::new(name)?.replacing("BYTES[7].store(sum, Relaxed);", code);
        let deadline = "deadline = \"200us\"";
        let config = format!("{deadline}\nreleases = [\"work\"]");
        Some(project.configured(deadline, &config).flaws())
    };
    let pend = "rtic::pend(device::Interrupt::I2C3_EV);";
    let flaws = or_skip!(declared(
        "endless",
        &format!("BYTES[7].store(sum, Relaxed); {pend}")
    ));
    let expected = "each run of `work` releases the next: what is less urgent never runs";
    assert_eq!(release(&flaws), [expected]);
    let sometimes = format!("if sum == 7 {{ {pend} }} else {{ BYTES[7].store(sum, Relaxed); }}");
    let flaws = or_skip!(declared("not-endless", &sometimes));
    assert_eq!(release(&flaws), [""; 0]);
}

#[test]
fn a_flag_that_is_not_looked_at_or_not_cleared_is_caught() {
    let project = or_skip!(Project::new("uncleared-flag"));
    let sometimes = "if device::has_byte() { device::acknowledge_timer(); }";
    let project = project.replacing("device::acknowledge_timer();", sometimes);
    assert_eq!(
        release(&project.flaws()),
        ["a run of `TIM2` may end without a read of 0x40000010, the flag that releases it"]
    );
    let project = or_skip!(Project::new("unread-byte"));
    let project = project.replacing("u32::from(device::byte())", "7");
    assert_eq!(
        release(&project.flaws()),
        ["`USART1` does not clear the flag that releases it, by 0x40011004: it would run for ever"]
    );
}

#[test]
fn a_register_gets_the_values_that_are_named_and_no_others() {
    /// The status of timer 2 becomes 0, and the pins become whatever is received.
    const IDLE: &str = "device::acknowledge_timer(); device::write_pins(device::byte().into());";
    let control = |name: &str, register: &str| {
        let project = Project::new(name)?.with("idle", IDLE);
        let entry = format!("[[control]]\n{register}\nreason = \"why\"\n\n[[exempt]]");
        Some(project.configured("[[exempt]]", &entry).flaws())
    };
    let flaws = control(
        "right",
        "registers = [0x4000_0010]\nvalues = [1, \"1us - 168\"]",
    );
    assert_eq!(release(&or_skip!(flaws)), [""; 0]);
    let flaws = or_skip!(control(
        "wrong",
        "registers = [0x4000_0010]\nmask = 6\nvalues = [4]"
    ));
    let found = release(&flaws);
    assert_eq!(found.len(), 2, "{found:?}");
    let expected = "writes 0x0 to 0x40000010 in the bits 0x6, and not 0x4: why";
    assert!(found[0].contains(expected), "{found:?}");
    let flaws = or_skip!(control(
        "unknown",
        "registers = [0x4002_0018]\nvalues = [1]"
    ));
    let found = release(&flaws);
    let expected = "writes something unknown to 0x40020018, and not 0x1";
    assert!(
        found.iter().any(|flaw| flaw.contains(expected)),
        "{found:?}"
    );
    let flaws = or_skip!(control(
        "unwritten",
        "registers = [0x4000_0028]\nvalues = [1]"
    ));
    let is_message = |flaw: &Flaw| flaw.what == "nothing is written to 0x40000028: why";
    assert!(flaws.iter().any(is_message), "{flaws:#?}");
}

#[test]
fn a_handler_that_is_exempt_is_caught() {
    let project = or_skip!(Project::new("exempt-handler"));
    let entry = "[[exempt]]\nfunction = \"TIM2\"\nreason = \"why not\"\n\n[[exempt]]";
    let flaws = project.configured("[[exempt]]", entry).flaws();
    let mut found = flaws.iter().filter(|flaw| flaw.rule == Rule::Mismatch);
    let expected = "`TIM2`, the handler of a task, is exempt";
    assert!(found.any(|flaw| flaw.what == expected), "{flaws:#?}");
}

#[test]
fn what_must_be_in_ram_is_not_in_flash() {
    let project = or_skip!(Project::new("in-flash"));
    let name = "in-flash".replace('-', "_");
    let entry = format!(
        "[[resident]]\nfunction = \"{name}::device::acknowledge_timer\"\nreason = \"a test\"\n\n[[exempt]]"
    );
    let flaws = project.configured("[[exempt]]", &entry).flaws();
    let mut found = flaws.iter().filter(|flaw| flaw.rule == Rule::CodeInRam);
    assert!(
        found.any(|flaw| flaw.what.ends_with("is in flash: a test")),
        "{flaws:#?}"
    );
}

#[test]
fn a_store_that_only_a_test_lets_happen_comes_after_it() {
    let guarded = |name: &str, code: &str| {
        let project = Project::new(name)?.replacing("device::write_pins(*cx.local.pins);", code);
        let entry = "[[guarded]]\nregister = 0x4002_0018\ntest = 0x4001_1000\nreason = \"why\"\n\n[[exempt]]";
        let flaws = project.configured("[[exempt]]", entry).flaws();
        let found = flaws.into_iter().filter(|flaw| flaw.rule == Rule::Register);
        Some(found.map(|flaw| flaw.what).collect::<Vec<_>>())
    };
    let tested = "if device::has_byte() { device::write_pins(3); }";
    assert_eq!(or_skip!(guarded("guarded", tested)), [""; 0]);
    for (name, code) in [
        ("unguarded", "device::write_pins(3);"),
        (
            "read-for-nothing",
            "let _ = device::has_byte(); device::write_pins(3);",
        ),
    ] {
        let expected = "a store to 0x40020018 does not depend on 0x40011000: why";
        assert_eq!(or_skip!(guarded(name, code)), [expected]);
    }
}

#[test]
fn nobody_may_store_anywhere() {
    for (name, from, to, by) in [
        ("anybody", "0x4002_3800", "0x4002_3c00", ""),
        ("all-regions", "0", "0xffff_ffff", "Reset"),
    ] {
        let project = or_skip!(Project::new(name));
        let entry = format!(
            "[[register]]\nfrom = {from}\nto = {to}\nby = [\"{by}\"]\nreason = \"why\"\n\n[[exempt]]"
        );
        let flaws = project.configured("[[exempt]]", &entry).flaws();
        let mut found = flaws.iter().filter(|flaw| flaw.rule == Rule::Configuration);
        assert!(
            found.any(|flaw| flaw.what.contains("allows stores to")),
            "{flaws:#?}"
        );
    }
}
