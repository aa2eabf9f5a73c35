//! Loops of a task without a deadline, which keep `idle` from feeding the watchdog, broken in a real program.

use schedule::{Flaw, Report, Rule};

use super::{
    project::{Project, assert_caught},
    startup::with_watchdog,
};

const FEED_WATCHDOG: &str = "device::write_pins(0xaaaa);";
/// The body of the loop in `work`.
const LOOP_BODY: &str = "left -= 1;";

/// The fixture with a watchdog that `idle` feeds, and with `work` without a deadline; `entry`: what `schedule.toml`
/// says of its loops.
fn project(name: &str, entry: &str) -> Option<Project> {
    let project = with_watchdog(Project::new(name)?).with("idle", FEED_WATCHDOG);
    let project = project.configured(
        "period = \"10s / baud\"\ndeadline = \"200us\"",
        "undeadlined = \"a test\"",
    );
    let period = "period = \"100ms\"";
    Some(project.configured(period, &format!("{period}\n\n{entry}")))
}

fn named(function: &str, reason: &str) -> String {
    format!("[[watchdog.uncounted]]\nfunctions = [\"{function}\"]\nreason = \"{reason}\"\n")
}

/// The same where nothing counts the loop.
fn uncounted(name: &str, entry: &str) -> Option<Project> {
    let project = project(name, entry)?;
    Some(project.replacing("// wcet-bound: words: `count` is less", ""))
}

fn report(project: &Project) -> Report {
    project.analyse(&project.build())
}

/// How long the tasks take without the iterations of uncounted loops.
fn bounded_cycles(report: &Report) -> u64 {
    let found = report.undeadlined.as_ref().expect("there is a watchdog");
    found.rest_cycles.expect("it is known")
}

fn is_reported(flaws: &[Flaw], what: &str) -> bool {
    let mut flaws = flaws.iter().filter(|flaw| flaw.rule == Rule::Configuration);
    flaws.any(|flaw| flaw.what.contains(what))
}

#[test]
fn a_loop_that_nothing_counts_has_to_be_named() {
    let project = or_skip!(uncounted("uncounted", ""));
    let line = project.line("while left != 0");
    let flaws = project.flaws();
    let flaw = assert_caught(&flaws, Rule::UncountedLoop, line - 1..=line + 4);
    assert!(flaw.what.contains("app::work`"), "{}", flaw.what);
    // Another one's name does not excuse it.
    let other = uncounted("uncounted-other", &named("app::receive", "the bytes")).unwrap();
    assert_caught(&other.flaws(), Rule::UncountedLoop, line - 1..=line + 4);
    let project = uncounted("uncounted-named", &named("app::work", "the bytes")).unwrap();
    let report = report(&project);
    assert_eq!(report.flaws, []);
    let found = report.undeadlined.unwrap();
    assert_eq!(found.tasks, ["work"]);
    assert_eq!((found.counted, found.fed), (0, 0));
    assert_eq!(found.uncounted.len(), 1);
    assert_eq!(found.uncounted[0].reason, "the bytes");
    assert_eq!(found.uncounted[0].places.len(), 1);
}

#[test]
fn a_loop_that_is_counted_or_feeds_the_watchdog_needs_no_name() {
    let counted = report(&or_skip!(project("counted", "")));
    assert_eq!(counted.flaws, []);
    let found = counted.undeadlined.unwrap();
    assert_eq!((found.counted, found.fed), (1, 0));
    let feeding = uncounted("feeding", "").unwrap();
    let feeding = report(&feeding.replacing(LOOP_BODY, &format!("{LOOP_BODY}\n{FEED_WATCHDOG}")));
    assert_eq!(feeding.flaws, []);
    let found = feeding.undeadlined.unwrap();
    assert_eq!((found.counted, found.fed), (0, 1));
}

#[test]
fn all_but_the_rounds_of_such_loops_is_in_the_figure() {
    let entry = named("app::work", "the bytes");
    let plain = bounded_cycles(&report(&or_skip!(uncounted("rest", &entry))));
    let stores = "BYTES[7].store(sum, Relaxed);";
    let with = |name: &str, old: &str, new: &str| {
        let project = uncounted(name, &entry).expect("the target is installed");
        bounded_cycles(&report(&project.replacing(old, new)))
    };
    let after = with("rest-after", stores, &stores.repeat(40));
    assert!(after >= plain + 40, "{plain} {after}");
    // The path through the loop counts once at most, with its whole body.
    let within = with("rest-within", LOOP_BODY, &format!("{LOOP_BODY}\n{stores}"));
    assert!(within < plain + 100, "{plain} {within}");
    // Rounds that are counted count.
    let counted = bounded_cycles(&report(&project("rest-counted", "").unwrap()));
    assert!(counted > plain + 64 * 4, "{plain} {counted}");
}

#[test]
fn an_excluded_function_is_neither_analysed_nor_in_the_figure() {
    let slow = "#[inline(never)]
    fn slow(mut left: u32) {
        while left != 0 {
            device::write_pins(left);
            left = left.wrapping_mul(5) & BYTES[1].load(Relaxed);
        }
    }";
    let with = |name: &str, entry: &str| {
        let project = project(name, entry)?.with("items", slow);
        Some(project.replacing("BYTES[7].store(sum, Relaxed);", "slow(sum);"))
    };
    let project = or_skip!(with("not-excluded", ""));
    let line = project.line("while left != 0");
    let line = line.max(project.line("fn slow") + 1);
    assert_caught(&project.flaws(), Rule::UncountedLoop, line..=line + 3);
    let entry = "[[watchdog.excluded]]\nfunction = \"app::slow\"\nreason = \"at rest\"\n";
    let excluded = report(&with("excluded", entry).unwrap());
    assert_eq!(excluded.flaws, []);
    let named = report(&with("not-excluded-named", &named("app::slow", "a test")).unwrap());
    assert_eq!(named.flaws, []);
    assert!(bounded_cycles(&excluded) < bounded_cycles(&named));
}

#[test]
fn a_function_that_calls_itself_leaves_no_figure() {
    let again = "#[inline(never)]
    fn again(left: u32) -> u32 {
        if left & 1 == 0 { left } else { again(left >> 1).rotate_left(3) ^ BYTES[1].load(Relaxed) }
    }";
    let project = or_skip!(project("calls-itself", ""));
    let project = project.with("items", again);
    let project = project.replacing(
        "BYTES[7].store(sum, Relaxed);",
        "BYTES[7].store(again(sum), Relaxed);",
    );
    let report = report(&project);
    assert_eq!(report.undeadlined.unwrap().rest_cycles, None);
    let mut flaws = report
        .flaws
        .iter()
        .filter(|flaw| flaw.rule == Rule::UnboundedLoop);
    assert!(
        flaws.any(|flaw| flaw.what.contains("is not known")),
        "{:#?}",
        report.flaws
    );
}

#[test]
fn an_entry_says_once_what_ends_its_loops() {
    let empty = or_skip!(uncounted("no-reason", &named("app::work", " "))).flaws();
    assert!(
        is_reported(&empty, "does not say what ends loops in `app::work`"),
        "{empty:#?}"
    );
    let twice = named("app::work", "the bytes").repeat(2);
    let twice = uncounted("twice", &twice).unwrap().flaws();
    assert!(is_reported(&twice, "says twice"), "{twice:#?}");
}
