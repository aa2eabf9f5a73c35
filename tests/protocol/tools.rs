//! Tools: which one is in the spindle, and who is told.

use super::bench::{Bench, WELCOME};

/// Returns the tool of the next status report, if it has one.
fn told(bench: &mut Bench) -> Option<String> {
    let report = bench.answer("?").remove(0);
    let (_, tool) = report.trim_end_matches('>').split_once("|T:")?;
    Some(tool.to_owned())
}

#[test]
fn a_new_tool_is_told_once() {
    let mut bench = Bench::new();
    let mut reports = |line: &str| {
        assert_eq!(bench.ask(line), ["ok"], "{line}");
        [told(&mut bench), told(&mut bench)]
    };
    assert_eq!(reports("T3"), [None, None]);
    assert_eq!(reports("M61Q3"), [Some("3".into()), None]);
    assert_eq!(reports("M61Q3"), [None, None]);
    assert_eq!(reports("M61Q255"), [Some("255".into()), None]);
}

#[test]
fn a_program_that_is_only_checked_changes_no_tool() {
    let mut bench = Bench::new();
    assert_eq!(bench.ask("M61Q3"), ["ok"]);
    assert_eq!(told(&mut bench), Some("3".into()));
    assert_eq!(bench.ask("$C"), ["[MSG:Enabled]", "ok"]);
    assert_eq!(bench.ask("M61Q4"), ["ok"]);
    assert_eq!(told(&mut bench), None);
    assert_eq!(bench.ask("$C")[2..], WELCOME);
    assert_eq!(bench.ask("M61Q3"), ["ok"]);
    assert_eq!(told(&mut bench), None);
}
