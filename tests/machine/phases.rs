//! Motors that are driven by phases: which coils are energised when.

use leadscrew::{
    model::HAS_PHASES,
    settings::{Settings, StepRate},
};

use crate::support::{MS, Machine};

/// A machine whose X makes a step for each mm.
fn machine() -> Machine {
    let mut machine = Machine::with(&Settings::new(StepRate::Unproven));
    for line in ["$100=1", "$110=15000", "$120=1000000", "G91"] {
        assert_eq!(machine.ask(line), ["ok"], "{line}");
    }
    machine
}

/// Which coils of X are energised, IN1 first.
fn pattern(machine: &Machine) -> String {
    let coils = machine.coils()[0];
    let digit = |coil: u8| if coils >> coil & 1 != 0 { '1' } else { '0' };
    (0..4).map(digit).collect()
}

/// Sends a line, runs for some milliseconds, and gives the patterns of X whenever they change.
fn patterns(machine: &mut Machine, line: &str, ms: u64) -> Vec<String> {
    let end = machine.now() + ms * MS;
    machine.send(format!("{line}\n"));
    let mut patterns = vec![pattern(machine)];
    while machine.now() < end {
        machine.advance_to(end);
        patterns.push(pattern(machine));
    }
    patterns.dedup();
    patterns
}

#[test]
fn nine_full_steps_and_one_back_energise_the_coils_of_the_data_sheet() {
    let mut machine = machine();
    assert_eq!(machine.ask("$1=255"), ["ok"]);
    let expected = [
        "1100", "0110", "0011", "1001", "1100", "0110", "0011", "1001", "1100", "0110",
    ];
    assert_eq!(pattern(&machine), "0000", "nothing moves yet");
    assert_eq!(patterns(&mut machine, "G1 X9 F15000", 1000), expected);
    assert_eq!(patterns(&mut machine, "X-1", 1000), ["0110", "1100"]);
}

#[test]
fn idle_motors_are_released_and_go_on_where_they_stood() {
    let mut machine = machine();
    assert_eq!(
        patterns(&mut machine, "G1 X1 F15000", 1000),
        ["1100", "0110", "0000"]
    );
    assert_eq!(patterns(&mut machine, "X1", 1000), ["0110", "0011", "0000"]);
    // `$1` is the time between the last step and the release.
    machine.send_for("X1\n", 20);
    assert_eq!(pattern(&machine), "1001");
    machine.run(20);
    assert_eq!(pattern(&machine), "0000");
}

#[test]
fn a_turn_of_the_shaft_ends_at_its_first_pattern() {
    for (half_steps, steps) in [(0, 2048), (1, 4096)] {
        let mut machine = machine();
        assert_eq!(machine.ask("$1=255"), ["ok"]);
        assert_eq!(machine.ask(&format!("$791={half_steps}")), ["ok"]);
        assert_eq!(machine.ask("G1 X1 F15000"), ["ok"]);
        let first = pattern(&machine);
        let patterns = patterns(&mut machine, &format!("X{steps}"), 60_000);
        // The first is that before the first step.
        assert_eq!(patterns.len(), steps + 1);
        assert!(
            patterns.iter().all(|it| it != "0000"),
            "no step without one"
        );
        assert_eq!(*patterns.last().unwrap(), first);
    }
}

#[test]
fn a_change_to_full_steps_energises_the_next_whole_phase() {
    let mut machine = machine();
    for line in ["$1=255", "$791=1", "G1 X1 F15000"] {
        assert_eq!(machine.ask(line), ["ok"], "{line}");
    }
    assert_eq!(pattern(&machine), "0100");
    assert_eq!(machine.ask("$791=0"), ["ok"]);
    assert_eq!(pattern(&machine), "0110");
    let steps = machine.xyz();
    assert_eq!(machine.ask("X-1"), ["ok"]);
    assert_eq!(pattern(&machine), "1100");
    assert_eq!(machine.xyz()[0], steps[0] - 1);
}

#[test]
fn a_reset_and_a_sleep_keep_the_phase() {
    let mut machine = machine();
    assert_eq!(machine.ask("$1=255"), ["ok"]);
    machine.send_for("G1 X100 F15000\n", 200);
    machine.send_for([0x18], 1000);
    machine.received.clear();
    assert_eq!(pattern(&machine), "0000", "a reset releases the motors");
    assert_eq!(machine.ask("$X"), ["[MSG:Caution: Unlocked]", "ok"]);
    let steps = machine.xyz()[0];
    assert!((10..90).contains(&steps), "{steps}");
    let full = ["1100", "0110", "0011", "1001"];
    let expected = [steps, steps + 1].map(|steps| full[steps as usize % 4]);
    let found = patterns(&mut machine, "G91 G1 X1 F15000", 1000);
    assert_eq!(found, expected);
}

#[test]
fn speeds_that_the_motors_cannot_follow_are_refused_where_they_are_driven_by_phases() {
    let mut machine = Machine::new(&[]);
    // 51.2 steps/mm at 586 mm/min are 500.05 steps/s.
    for (line, with_phases, without) in [
        ("$100=51.2", "ok", "ok"),
        ("$110=585", "ok", "ok"),
        ("$110=586", "error:12", "ok"),
        ("$791=1", "ok", "ok"),
        ("$110=1171", "ok", "ok"),
        ("$110=1172", "error:12", "ok"),
        ("$791=0", "error:12", "ok"),
    ] {
        let expected = if HAS_PHASES { with_phases } else { without };
        assert_eq!(machine.ask(line), [expected], "{line}");
    }
    let default = Settings::default().steps_per_mm[0].to_f32();
    assert!((default - if HAS_PHASES { 51.2 } else { 250.0 }).abs() < 1e-4);
}
