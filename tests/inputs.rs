//! Switches, buttons and probe of the virtual machine, through the firmware's own filter.

use leadscrew::{
    axis::AXES,
    machine::{Levels, State},
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
    for statement in ["100=80", "110=5000", "120=500"] {
        assign(&mut settings, statement.as_bytes()).unwrap();
    }
    settings
}

#[test]
fn a_contact_counts_after_the_filter() {
    let mut bench = Bench::new(&fast());
    bench.set(Levels::PROBE | Levels::limits(1), true);
    bench.run_us(399);
    assert_eq!(bench.machine.snapshot().inputs, Levels::NONE);
    bench.run_us(2);
    let both = Levels::PROBE | Levels::limits(1);
    assert_eq!(bench.machine.snapshot().inputs, both);
    bench.set(Levels::PROBE, false);
    bench.run_us(250);
    bench.set(Levels::PROBE, true);
    bench.run_us(1000);
    assert_eq!(bench.machine.snapshot().inputs, both);
    bench.set(both, false);
    bench.run_us(401);
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
    bench.run_us(500);
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
