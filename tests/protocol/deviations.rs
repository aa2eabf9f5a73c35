//! Deliberate deviations from Grbl: `docs/grbl-compatibility.md`.

use leadscrew::{model::Laser, path::Work};

use super::bench::Bench;

#[test]
fn a_checksum_changes_nothing_of_what_a_line_means() {
    let mut bench = Bench::new();
    assert_eq!(bench.ask("N1 G0 X1*23"), ["error:1"]);
    assert_eq!(bench.ask("G4 P0 S1000"), ["ok"]);
    assert_eq!(bench.ask("G28 X1"), ["ok"]);
    assert_eq!(bench.ask("G1 X1 E1 F100"), ["error:20"]);
}

#[test]
fn the_reported_buffer_sizes_are_true() {
    let mut bench = Bench::set(&["10=3"]);
    let free = bench.received.free();
    assert!(free >= 128, "a sender that counts characters needs 128");
    let report = bench.answer("?");
    assert!(
        report[0].contains(&format!("|Bf:100,{free}|")),
        "{report:?}"
    );
    let messages = bench.ask("$I");
    assert!(
        messages[1].starts_with("[OPT:") && messages[1].ends_with(&format!(",{free}]")),
        "{messages:?}"
    );
}

#[test]
fn what_is_sent_after_the_welcome_is_answered_at_once() {
    let mut bench = Bench::new();
    bench.machine.state = leadscrew::model::State::Run;
    let lines = bench.answer("\x18");
    assert_eq!(lines[0], "ALARM:3");
    assert_eq!(bench.ask("$X")[1], "ok");
}

#[test]
fn the_rapids_of_g28_do_not_burn() {
    let mut bench = Bench::set(&["32=1"]);
    for line in ["M3S500", "G1X1F100", "G28X2", "G30", "G1X4"] {
        assert_eq!(bench.ask(line), ["ok"], "{line}");
    }
    let powers: Vec<_> = bench
        .works()
        .iter()
        .filter_map(|work| match work {
            Work::Move(block) => Some(block.laser),
            _ => None,
        })
        .collect();
    let (on, off) = (Laser::Constant(500.0), Laser::Constant(0.0));
    assert_eq!(powers.first(), Some(&on));
    assert_eq!(powers.last(), Some(&on));
    let between = &powers[1..powers.len() - 1];
    assert!(
        between.len() >= 2 && between.iter().all(|power| *power == off),
        "{powers:?}"
    );
}

#[test]
fn mist_and_flood_are_switched_separately() {
    let mut bench = Bench::new();
    let modes = |bench: &mut Bench| bench.ask("$G")[0].clone();
    assert_eq!(bench.ask("M7"), ["ok"]);
    assert!(modes(&mut bench).contains(" M7 "));
    assert!(bench.report().field("WCO").is_some());
    assert!(bench.answer("?")[0].ends_with("|A:M>"));
    assert_eq!(bench.ask("M8"), ["ok"]);
    assert!(modes(&mut bench).contains(" M7 M8 "));
    assert!(bench.answer("?")[0].ends_with("|A:FM>"));
    assert_eq!(bench.ask("M7M8"), ["error:21"]);
    assert_eq!(bench.ask("M9"), ["ok"]);
    assert!(modes(&mut bench).contains(" M9 "));
}
