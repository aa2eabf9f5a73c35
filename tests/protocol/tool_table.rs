//! The tool table as senders see it: `$TT`, `$#`, `G10 L1` and `G43`.

use std::{fs, path::Path};

use leadscrew::settings::Change;

use super::bench::Bench;

#[test]
fn the_tool_table_is_listed_set_and_stored() {
    let mut bench = Bench::new();
    assert_eq!(bench.ask("$TT"), ["ok"]);
    for line in [
        "$TT7 = T7 P2 X-1 Z10.16 D3.048 ; drill",
        "G10 L1 P3 Z5 R1.0005",
        "$TT9=Z1",
    ] {
        assert_eq!(bench.ask(line), ["ok"], "{line}");
    }
    let table = [
        "T3 P3 X0 Y0 Z5 D2.001",
        "T7 P7 X-1 Y0 Z10.16 D3.048",
        "T9 P9 X0 Y0 Z1 D0",
        "ok",
    ];
    assert_eq!(bench.ask("$TT"), table);
    assert_eq!(bench.ask("G59.1"), ["ok"]);
    assert_eq!(bench.ask("G10L20P0X1"), ["ok"]);
    assert_eq!(
        bench.ask("$#")[11..],
        [
            "[G59.1:-1.000,0.000,0.000]",
            "[T:3|0.000,0.000,5.000|1.001]",
            "[T:7|-1.000,0.000,10.160|1.524]",
            "[T:9|0.000,0.000,1.000|0.000]",
            "ok",
        ]
    );
    assert_eq!(bench.ask("$TT9="), ["ok"]);
    assert_eq!(bench.ask("$TT9="), ["ok"]);
    assert_eq!(bench.ask("$TT9=Q1"), ["error:20"]);
    assert_eq!(bench.ask("$TT")[2..], ["ok"]);
    let tools = |slots: &[usize]| {
        slots
            .iter()
            .map(|&slot| Change::Tool(slot))
            .collect::<Vec<_>>()
    };
    bench.changes.retain(|change| *change != Change::Origins);
    assert_eq!(
        bench.changes,
        tools(&[0, 1, 2, 2]),
        "what is there already is not stored"
    );
}

#[test]
fn a_tool_that_could_not_be_stored_is_as_before() {
    let mut bench = Bench::new();
    assert_eq!(bench.ask("$TT7=Z1"), ["ok"]);
    let before = bench.session.tools().clone();
    bench.flash_fails = true;
    for line in [
        "$TT7=Z2",
        "$TT8=Z1",
        "G10L1P7Z3",
        "$TT7=",
        "$RST=#",
        "$RST=*",
    ] {
        assert_eq!(bench.ask(line), ["error:204"], "{line}");
        assert_eq!(*bench.session.tools(), before, "{line}");
    }
}

#[test]
fn restoring_offsets_clears_the_tools_also_when_a_reset_comes() {
    for (line, resets) in [("$RST=#", false), ("$RST=*", false), ("$RST=#", true)] {
        let mut bench = Bench::new();
        assert_eq!(bench.ask("$TT7=Z1"), ["ok"]);
        bench.resets_in_store = resets;
        assert!(bench.ask(line).contains(&"ok".to_owned()));
        assert!(bench.session.tools().is_empty(), "{line}");
    }
    let mut bench = Bench::new();
    assert_eq!(bench.ask("$TT7=Z1"), ["ok"]);
    assert!(bench.ask("$RST=$").contains(&"ok".to_owned()));
    assert!(!bench.session.tools().is_empty());
}

#[test]
fn g43_changes_the_work_position_at_once_and_reports_the_offset() {
    let mut bench = Bench::new();
    for line in ["$10=0", "$TT1=X1Z-4", "G0Z10"] {
        assert_eq!(bench.ask(line), ["ok"]);
    }
    for _ in 0..3 {
        bench.answer("?");
    }
    assert_eq!(bench.ask("G43H1"), ["ok"]);
    let report = bench.report();
    assert_eq!(report.field("WPos"), Some("-1.000,0.000,14.000"));
    assert_eq!(report.field("WCO"), Some("1.000,0.000,-4.000"));
    assert_eq!(
        bench.ask("$G")[0],
        "[GC:G0 G54 G17 G21 G90 G94 G43 M5 M9 T0 F0 S0]"
    );
    assert_eq!(bench.ask("G43.2X1"), ["ok"]);
    assert!(bench.ask("$G")[0].contains(" G94 G43.2 M5"));
    assert!(
        bench
            .ask("$#")
            .contains(&"[TLO:2.000,0.000,-4.000]".to_owned())
    );
    assert_eq!(bench.ask("G43.1X0"), ["ok"]);
    assert!(bench.ask("$G")[0].contains(" G94 M5"));
}

#[test]
fn g43_with_an_empty_table_is_answered_by_a_message_and_ok() {
    let mut bench = Bench::new();
    let message = "[MSG:Tool table is empty: tool length 0]";
    assert_eq!(bench.ask("G43H1Z5"), [message, "ok"]);
    assert_eq!(bench.machine.steps[2], 1250);
    assert_eq!(bench.ask("G0Z0"), ["ok"]);
    assert_eq!(bench.ask("$TT2=Z1"), ["ok"]);
    assert_eq!(bench.ask("G43H1"), ["error:38"]);
}

#[test]
fn a_startup_line_puts_the_length_of_the_tool_in_the_spindle_back() {
    let mut bench = Bench::new();
    for line in ["$TT3=Z7", "$N0=G43", "M61Q3", "G43"] {
        assert_eq!(bench.ask(line), ["ok"], "{line}");
    }
    assert_eq!(bench.answer("\x18")[2..], [">G43:ok"]);
    assert!(bench.ask("$#").contains(&"[TLO:7.000]".to_owned()));
    let mut other = Bench::booting_with(bench.session.stored(), false);
    assert_eq!(other.serve()[2..], [">G43:ok"]);
    assert!(other.ask("$#").contains(&"[TLO:0.000]".to_owned()));
}

#[test]
fn the_examples_of_the_document_do_what_it_says() {
    let path = Path::new(concat!(env!("CARGO_MANIFEST_DIR"), "/..")).join("docs/tool-lengths.md");
    let document = fs::read_to_string(path).unwrap();
    let mut bench = Bench::new();
    let mut heights = Vec::new();
    let mut blocks = document.split("```").skip(1).step_by(2).peekable();
    assert!(blocks.peek().is_some());
    for block in blocks {
        let (kind, lines) = block.split_once('\n').unwrap();
        if kind == "text" {
            let table: Vec<_> = lines.lines().chain(["ok"]).collect();
            assert_eq!(bench.ask("$TT"), table);
        } else {
            for line in lines.lines() {
                assert_eq!(bench.ask(line), ["ok"], "{line}");
                heights.push(f64::from(bench.machine.steps[2]) / 250.0);
            }
        }
    }
    assert!(heights.ends_with(&[-35.0, -22.5]), "{heights:?}");
    assert!(document.contains("-35 with tool 1 and at -22.5 with tool 2"));
}
