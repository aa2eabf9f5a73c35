//! Motors that are driven by phases: which coils are energised when.

use leadscrew::{
    model::HAS_PHASES,
    settings::{Settings, StepRate},
    sim::Simulator,
    units::TICKS_PER_MS,
};

/// A machine whose X makes a step for each mm.
struct Machine(Box<Simulator>);

impl Machine {
    fn new() -> Self {
        let settings = Settings::new(StepRate::Unproven);
        let mut machine = Self(Box::new(Simulator::new(&settings)));
        for line in ["$100=1", "$110=15000", "$120=1000000", "G91"] {
            assert_eq!(machine.ask(line), "ok", "{line}");
        }
        machine
    }

    /// Which coils of X are energised, IN1 first.
    fn pattern(&self) -> String {
        let coils = self.0.coils()[0];
        let digit = |coil: u8| if coils >> coil & 1 != 0 { '1' } else { '0' };
        (0..4).map(digit).collect()
    }

    /// Sends a line and waits until nothing is going on; gives the last line that has come.
    fn ask(&mut self, line: &str) -> String {
        self.say(line);
        self.run(60_000);
        let mut received = Vec::new();
        while let Some(byte) = self.0.send() {
            received.push(byte);
            self.0.settle();
        }
        let received = String::from_utf8(received).unwrap();
        received.lines().last().unwrap_or_default().to_owned()
    }

    fn say(&mut self, line: &str) {
        self.0.settle();
        for byte in line.bytes().chain([b'\n']) {
            self.0.receive(byte);
            self.0.settle();
        }
    }

    /// Runs so long, and gives the patterns of X whenever they change.
    fn run(&mut self, ms: u64) -> Vec<String> {
        let end = self.0.now() + ms * u64::from(TICKS_PER_MS);
        let mut patterns = vec![self.pattern()];
        while let Some(due) = self.0.due().filter(|due| *due <= end) {
            self.0.advance(due);
            patterns.push(self.pattern());
        }
        self.0.advance(end);
        patterns.dedup();
        patterns
    }
}

#[test]
fn nine_full_steps_and_one_back_energise_the_coils_of_the_data_sheet() {
    let mut machine = Machine::new();
    assert_eq!(machine.ask("$1=255"), "ok");
    let patterns = [
        "1100", "0110", "0011", "1001", "1100", "0110", "0011", "1001", "1100", "0110",
    ];
    assert_eq!(machine.pattern(), "0000", "nothing moves yet");
    machine.say("G1 X9 F15000");
    assert_eq!(machine.run(1000), patterns);
    machine.say("X-1");
    assert_eq!(machine.run(1000), ["0110", "1100"]);
}

#[test]
fn idle_motors_are_released_and_go_on_where_they_stood() {
    let mut machine = Machine::new();
    machine.say("G1 X1 F15000");
    assert_eq!(machine.run(1000), ["1100", "0110", "0000"]);
    machine.say("X1");
    assert_eq!(machine.run(1000), ["0110", "0011", "0000"]);
    // `$1` is the time between the last step and the release.
    machine.say("X1");
    machine.run(20);
    assert_eq!(machine.pattern(), "1001");
    machine.run(20);
    assert_eq!(machine.pattern(), "0000");
}

#[test]
fn a_turn_of_the_shaft_ends_at_its_first_pattern() {
    for (half_steps, steps) in [(0, 2048), (1, 4096)] {
        let mut machine = Machine::new();
        assert_eq!(machine.ask("$1=255"), "ok");
        assert_eq!(machine.ask(&format!("$791={half_steps}")), "ok");
        assert_eq!(machine.ask("G1 X1 F15000"), "ok");
        let first = machine.pattern();
        machine.say(&format!("X{steps}"));
        let patterns = machine.run(60_000);
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
    let mut machine = Machine::new();
    for line in ["$1=255", "$791=1", "G1 X1 F15000"] {
        assert_eq!(machine.ask(line), "ok", "{line}");
    }
    assert_eq!(machine.pattern(), "0100");
    assert_eq!(machine.ask("$791=0"), "ok");
    assert_eq!(machine.pattern(), "0110");
    let steps = machine.0.physical_steps();
    assert_eq!(machine.ask("X-1"), "ok");
    assert_eq!(machine.pattern(), "1100");
    assert_eq!(machine.0.physical_steps()[0], steps[0] - 1);
}

#[test]
fn a_reset_and_a_sleep_keep_the_phase() {
    let mut machine = Machine::new();
    assert_eq!(machine.ask("$1=255"), "ok");
    machine.say("G1 X100 F15000");
    machine.run(200);
    machine.0.receive(0x18);
    machine.run(1000);
    assert_eq!(machine.pattern(), "0000", "a reset releases the motors");
    assert_eq!(machine.ask("$X"), "ok");
    let steps = machine.0.physical_steps()[0];
    assert!((10..90).contains(&steps), "{steps}");
    machine.say("G91 G1 X1 F15000");
    let full = ["1100", "0110", "0011", "1001"];
    let [before, after] = [steps, steps + 1].map(|steps| full[steps as usize % 4]);
    assert_eq!(machine.run(1000), [before, after]);
}

#[test]
fn speeds_that_the_motors_cannot_follow_are_refused_where_they_are_driven_by_phases() {
    let mut machine = Machine(Box::new(Simulator::new(&Settings::default())));
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
        assert_eq!(machine.ask(line), expected, "{line}");
    }
    let default = Settings::default().steps_per_mm[0].to_f32();
    assert!((default - if HAS_PHASES { 51.2 } else { 250.0 }).abs() < 1e-4);
}
