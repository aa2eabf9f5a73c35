//! Switches, buttons and probe of the virtual machine, through the firmware's own filter.

use leadscrew::{
    axis::{AXES, Axes},
    model::{Levels, State},
    settings::{Settings, assign},
    sim::{Closes, Simulator, Switch},
    units::{TICKS_PER_MS, TICKS_PER_US},
};

/// The machine and what it has sent.
struct Bench {
    machine: Box<Simulator>,
    sent: String,
}

impl Bench {
    fn new(settings: &Settings) -> Self {
        let mut machine = Box::new(Simulator::new(settings));
        machine.settle();
        Self {
            machine,
            sent: String::new(),
        }
    }

    fn run_us(&mut self, us: u64) {
        let end = self.machine.now() + us * u64::from(TICKS_PER_US);
        while self.machine.now() < end {
            while let Some(byte) = self.machine.send() {
                self.sent.push(char::from(byte));
                self.machine.settle();
            }
            self.machine.advance(end);
        }
    }

    fn line(&mut self, line: &str) {
        for byte in line.bytes().chain(*b"\n") {
            self.machine.receive(byte);
        }
        self.machine.settle();
    }

    fn set(&mut self, inputs: Levels, closed: bool) {
        self.machine.set_pin(inputs, closed);
        self.machine.settle();
    }

    fn take_sent(&mut self) -> String {
        self.run_us(1);
        std::mem::take(&mut self.sent)
    }
}

fn fast() -> Settings {
    let mut settings = Settings::default();
    for axis in 0..AXES {
        for (number, value) in [(100, 80), (110, 5000), (120, 500)] {
            let statement = format!("{}={value}", number + axis);
            assign(&mut settings, statement.as_bytes()).unwrap();
        }
    }
    settings
}

/// The lines that come within so many ms of a line.
fn answers(bench: &mut Bench, line: &str, ms: u64) -> Vec<String> {
    bench.take_sent();
    bench.line(line);
    bench.run_us(ms * 1000);
    bench.take_sent().lines().map(String::from).collect()
}

/// Coordinates as they are told, with those of the other axes.
fn told(xyz: &str) -> String {
    xyz.to_owned() + &",0.000".repeat(AXES - 3)
}

/// The status report.
fn status(bench: &mut Bench) -> String {
    bench.take_sent();
    bench.machine.receive(b'?');
    bench.machine.settle();
    bench.run_us(5000);
    bench.take_sent()
}

/// A machine as recorded, with its switches.
fn homing_bench(settings: &Settings) -> Bench {
    let mut bench = Bench::new(&Settings {
        homing: true,
        homing_seek_mm_min: 2000.0,
        homing_feed_mm_min: 200.0,
        ..*settings
    });
    for (axis, steps) in [1600, 1200, 800].into_iter().enumerate() {
        assert!(bench.machine.mount(Switch {
            axis,
            closes: Closes::From(steps),
            input: Levels::limits(1 << axis),
        }));
    }
    bench
}

#[test]
fn homing_is_answered_when_it_is_over() {
    let mut bench = homing_bench(&fast());
    assert_eq!(answers(&mut bench, "$H", 1000), [""; 0]);
    let home = status(&mut bench);
    assert!(home.starts_with("<Home|MPos:"), "{home:?}");
    bench.run_us(3_500_000);
    assert_eq!(bench.take_sent(), "ok\r\n");
    let idle = status(&mut bench);
    assert!(idle.starts_with(&format!("<Idle|MPos:{}|", told("-1.000,-1.000,-1.000"))));
    assert_eq!(answers(&mut bench, "G0X-10", 1000), ["ok"]);
    assert_eq!(bench.machine.physical_steps()[0], 1600 - 800);
}

#[test]
fn homing_that_fails_locks_the_machine() {
    let mut bench = Bench::new(&Settings {
        homing: true,
        homing_seek_mm_min: 5000.0,
        max_travel_mm: Axes::all(50.0),
        ..fast()
    });
    let lines = answers(&mut bench, "$H", 3000);
    let lock = "[MSG:'$H'|'$X' to unlock]";
    let expected = ["ALARM:9", "ok", "", "Grbl 1.1h ['$' for help]", lock];
    assert_eq!(lines, expected);
    let alarm = status(&mut bench);
    assert!(
        alarm.starts_with(&format!("<Alarm|MPos:{}|", told("0.000,0.000,75.000"))),
        "{alarm:?}"
    );
}

#[test]
fn the_door_ends_homing() {
    let mut bench = homing_bench(&fast());
    bench.line("$H");
    bench.run_us(200_000);
    bench.take_sent();
    bench.machine.receive(0x84);
    bench.machine.settle();
    bench.run_us(1_000_000);
    let lines = bench.take_sent();
    assert!(lines.starts_with("ALARM:7\r\nok\r\n\r\nGrbl"), "{lines}");
    assert_eq!(bench.machine.snapshot().state, State::Alarm);
}

#[test]
fn homing_does_not_start_on_a_switch() {
    let mut bench = homing_bench(&fast());
    bench.set(Levels::limits(1), true);
    bench.run_us(1000);
    let lines = answers(&mut bench, "$H", 100);
    assert_eq!(lines, ["[MSG:Check Limits]", "error:203"]);
    assert_eq!(bench.machine.snapshot().state, State::Alarm);
    assert_eq!(bench.machine.physical_steps(), Axes::all(0));
}

#[test]
fn probing_is_answered_as_by_grbl() {
    let plate = Switch {
        axis: 2,
        closes: Closes::DownFrom(-400),
        input: Levels::PROBE,
    };
    let mut bench = Bench::new(&fast());
    assert!(bench.machine.mount(plate));
    let lines = answers(&mut bench, "G38.2 Z-10 F600", 2000);
    assert_eq!(
        lines,
        [&format!("[PRB:{}:1]", told("0.000,0.000,-5.000")), "ok"]
    );
    // From where it rests, not from where it was to go.
    let rest = bench.machine.physical_steps()[2];
    assert_eq!(answers(&mut bench, "G91G0Z1", 2000), ["ok"]);
    assert_eq!(bench.machine.physical_steps()[2], rest + 80);
    let lines = answers(&mut bench, "G38.3 Z-1", 2000);
    assert_eq!(
        lines,
        [&format!("[PRB:{}:1]", told("0.000,0.000,-5.000")), "ok"]
    );
    let lines = answers(&mut bench, "G38.2 Z-1", 2000);
    assert_eq!(lines, ["ALARM:4", "ok"]);
}

#[test]
fn a_missed_probe_is_answered_as_by_grbl() {
    let mut bench = Bench::new(&fast());
    let lines = answers(&mut bench, "G38.3 Z-1 F600", 2000);
    assert_eq!(
        lines,
        [&format!("[PRB:{}:0]", told("0.000,0.000,-1.000")), "ok"]
    );
    let lines = answers(&mut bench, "G38.2 Z-3 F600", 2000);
    assert_eq!(
        lines,
        [
            "ALARM:5",
            &format!("[PRB:{}:0]", told("0.000,0.000,-1.000")),
            "ok"
        ]
    );
    assert_eq!(answers(&mut bench, "G0Z0", 50), ["error:9"]);
}

#[test]
fn a_hard_limit_is_told_and_waits_for_a_reset() {
    let mut bench = Bench::new(&Settings {
        hard_limits: true,
        ..fast()
    });
    assert_eq!(answers(&mut bench, "G1X50F1000", 200), ["ok"]);
    bench.set(Levels::limits(1), true);
    bench.run_us(100_000);
    let lines: Vec<_> = bench.take_sent().lines().map(String::from).collect();
    assert_eq!(lines, ["ALARM:1", "[MSG:Reset to continue]"]);
    let steps = bench.machine.physical_steps();
    assert_eq!(bench.machine.snapshot().steps, steps);
    assert_eq!(answers(&mut bench, "$X", 100), [""; 0]);
    bench.set(Levels::limits(1), false);
    bench.run_us(1000);
    bench.machine.receive(0x18);
    bench.machine.settle();
    bench.run_us(100_000);
    bench.take_sent();
    assert_eq!(
        answers(&mut bench, "$X", 100),
        ["[MSG:Caution: Unlocked]", "ok"]
    );
    assert_eq!(answers(&mut bench, "G1X0F1000", 5000), ["ok"]);
    assert_eq!(bench.machine.physical_steps(), Axes::all(0));
}

#[test]
fn a_contact_counts_after_the_filter() {
    let mut bench = Bench::new(&fast());
    bench.set(Levels::PROBE | Levels::limits(1), true);
    bench.run_us(999);
    assert_eq!(bench.machine.snapshot().inputs, Levels::NONE);
    bench.run_us(2);
    let both = Levels::PROBE | Levels::limits(1);
    assert_eq!(bench.machine.snapshot().inputs, both);
    bench.set(Levels::PROBE, false);
    bench.run_us(700);
    bench.set(Levels::PROBE, true);
    bench.run_us(2000);
    assert_eq!(bench.machine.snapshot().inputs, both);
    bench.set(both, false);
    bench.run_us(1001);
    assert_eq!(bench.machine.snapshot().inputs, Levels::NONE);
    assert_eq!(bench.machine.due(), None);
}

#[test]
fn inverted_inputs_are_active_while_open() {
    let mut bench = Bench::new(&Settings {
        limit_invert: true,
        ..fast()
    });
    bench.set(Levels::limits(2), true);
    bench.run_us(1500);
    let others = Levels::limits((1 << AXES) - 1 - 2);
    assert_eq!(bench.machine.snapshot().inputs, others);
}

#[test]
fn buttons_act_when_they_close() {
    let mut bench = Bench::new(&fast());
    bench.line("G1X10F1000");
    bench.run_us(100_000);
    bench.set(Levels::HOLD, true);
    bench.run_us(200_000);
    assert_eq!(bench.machine.snapshot().state, State::HoldComplete);
    bench.set(Levels::START, true);
    bench.run_us(5000);
    assert_eq!(bench.machine.snapshot().state, State::Run);
    bench.set(Levels::HOLD | Levels::START, false);
    bench.run_us(5000);
    assert_eq!(bench.machine.snapshot().state, State::Run);
    bench.take_sent();
    bench.set(Levels::RESET, true);
    bench.run_us(100_000);
    let sent = bench.take_sent();
    assert!(
        sent.starts_with("ALARM:3") && sent.contains("Grbl 1.1h"),
        "{sent}"
    );
    bench.set(Levels::RESET, false);
    bench.run_us(100_000);
    assert_eq!(bench.take_sent(), "");
}

#[test]
fn a_switch_closes_at_its_position() {
    for (closes, target) in [(Closes::From(40), "1"), (Closes::DownFrom(-40), "-1")] {
        let mut bench = Bench::new(&fast());
        let switch = Switch {
            axis: 0,
            closes,
            input: Levels::limits(1),
        };
        assert!(bench.machine.mount(switch));
        bench.line(&format!("G1X{target}F600"));
        bench.run_us(1);
        while !bench.machine.snapshot().inputs.has(Levels::limits(1)) {
            assert!(bench.machine.now() < u64::from(TICKS_PER_MS) * 200);
            bench.machine.advance(u64::MAX);
        }
        let steps = bench.machine.physical_steps()[0];
        assert!(switch.is_closed_at(steps), "{steps}");
        assert!((40..45).contains(&steps.abs()), "{steps}");
        bench.line("G0X0");
        bench.run_us(500_000);
        assert_eq!(bench.machine.snapshot().inputs, Levels::NONE);
        assert_eq!(bench.machine.physical_steps()[0], 0);
    }
}
