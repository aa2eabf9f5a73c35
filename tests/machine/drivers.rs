//! Drivers that want time between their enabling and the first step, `$786`.

use leadscrew::{
    axis::Axes,
    model::State,
    settings::{Settings, assign},
    sim::Simulator,
    units::{TICKS_PER_MS, TICKS_PER_SECOND},
};

const MS: u64 = TICKS_PER_MS as u64;
const SECOND: u64 = TICKS_PER_SECOND as u64;

/// A machine, with when its drivers were enabled last, and each first step since then.
struct Machine {
    simulator: Box<Simulator>,
    told: String,
    enabled: Option<u64>,
    /// From enabling to the first step, ticks.
    leads: Vec<u64>,
    is_stepping: bool,
}

impl Machine {
    fn with(assignments: &[&str]) -> Self {
        let mut settings = Settings::default();
        for assignment in assignments {
            assign(&mut settings, assignment.as_bytes()).unwrap();
        }
        let mut machine = Self {
            simulator: Box::new(Simulator::new(&settings)),
            told: String::new(),
            enabled: None,
            leads: Vec::new(),
            is_stepping: false,
        };
        machine.run(SECOND);
        machine
    }

    fn send(&mut self, text: &str) {
        for byte in text.bytes() {
            self.simulator.receive(byte);
        }
        self.look();
    }

    fn look(&mut self) {
        self.simulator.settle();
        while let Some(byte) = self.simulator.send() {
            self.told.push(byte.into());
            self.simulator.settle();
        }
        match (self.simulator.outputs().drivers, self.enabled) {
            (true, None) => {
                self.enabled = Some(self.simulator.now());
                self.is_stepping = false;
            }
            (false, _) => self.enabled = None,
            (true, Some(_)) => {}
        }
    }

    fn run(&mut self, ticks: u64) {
        let end = self.simulator.now() + ticks;
        self.look();
        while let Some(due) = self.simulator.due().filter(|due| *due <= end) {
            let edge = self.simulator.advance(due);
            if edge.is_some_and(|edge| edge.raise != 0) && !self.is_stepping {
                let enabled = self
                    .enabled
                    .expect("a motor steps whose driver is disabled");
                self.leads.push(self.simulator.now() - enabled);
                self.is_stepping = true;
            }
            self.look();
        }
        self.simulator.advance(end);
        self.look();
    }

    fn x(&self) -> i32 {
        let Axes([x, ..]) = self.simulator.physical_steps();
        x
    }
}

#[test]
fn the_first_step_comes_when_the_drivers_have_had_their_time() {
    for line in [
        "G0X1",
        "G1X1F100",
        "$J=G91X1F100",
        "G2X1I.5F100",
        "G4P0.01\nG0X1",
        "G38.3X1F100",
        "G0X0\nG0X1",
    ] {
        let mut machine = Machine::with(&["786=200"]);
        machine.send("G91\n");
        for number in 1..=2 {
            machine.send(&format!("{line}\n"));
            machine.run(10 * SECOND);
            let leads = &machine.leads;
            assert_eq!(leads.len(), number, "{line}");
            let lead = leads[number - 1];
            assert!((200 * MS..240 * MS).contains(&lead), "{line}: {lead} ticks");
            // The drivers are disabled meanwhile.
            assert_eq!(machine.enabled, None, "{line}");
        }
        assert!(!machine.told.contains("error"), "{}", machine.told);
    }
}

#[test]
fn drivers_that_are_enabled_need_no_time() {
    let mut machine = Machine::with(&["786=200", "1=255"]);
    machine.send("G0X1\n");
    machine.run(100 * MS);
    assert!(machine.x() > 0);
}

#[test]
fn without_the_setting_a_dwell_enables_no_driver_and_a_move_begins_at_once() {
    let mut machine = Machine::with(&[]);
    machine.send("G4P1\n");
    machine.run(SECOND / 2);
    assert_eq!(machine.enabled, None);
    machine.run(SECOND);
    machine.send("G0X1\n");
    machine.run(SECOND);
    assert!(machine.leads[0] < 25 * MS, "{:?}", machine.leads);
}

#[test]
fn a_hold_before_the_first_step_holds_and_a_reset_ends_the_move() {
    for home in [false, true] {
        let mut machine = Machine::with(&["786=500", "22=1", "788=7"]);
        machine.send("$X\nG0X1\n");
        if home {
            machine.send("\x18");
            machine.run(SECOND);
            machine.send("$H\n");
        }
        machine.run(100 * MS);
        assert_eq!(machine.x(), 0);
        machine.send("!");
        machine.run(2 * SECOND);
        if !home {
            assert_eq!(machine.simulator.snapshot().state, State::HoldComplete);
            assert_eq!(machine.x(), 0);
            machine.send("~");
            machine.run(5 * SECOND);
            assert_eq!(machine.x(), 250);
            machine.send("G0X0\n");
            machine.run(100 * MS);
        }
        machine.send("\x18");
        machine.run(2 * SECOND);
        assert!(machine.told.ends_with("to unlock]\r\n") || machine.told.ends_with("help]\r\n"));
        machine.send("$X\nG91G0X1\n");
        machine.run(5 * SECOND);
        assert!(machine.told.ends_with("ok\r\n"), "{}", machine.told);
    }
}
