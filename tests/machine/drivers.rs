//! Drivers that want time between their enabling and the first step, `$786`.

use leadscrew::{model::State, units::TICKS_PER_MS};

use crate::support::Machine;

const MS: u64 = TICKS_PER_MS as u64;

/// A machine, with when its drivers were enabled last, and each first step since then.
struct Enabling {
    machine: Machine,
    enabled: Option<u64>,
    /// From enabling to the first step, ticks.
    leads: Vec<u64>,
    is_stepping: bool,
}

impl Enabling {
    fn new(assignments: &[&str]) -> Self {
        Self {
            machine: Machine::new(assignments),
            enabled: None,
            leads: Vec::new(),
            is_stepping: false,
        }
    }

    /// Sends bytes, and runs for some milliseconds.
    fn send_for(&mut self, bytes: &str, ms: u64) {
        self.machine.send(bytes);
        let end = self.machine.now() + ms * MS;
        self.observe(self.machine.edges.len());
        while self.machine.now() < end {
            let edges = self.machine.edges.len();
            self.machine.advance_to(end);
            self.observe(edges);
        }
    }

    /// Observes the drivers, and steps after so many edges.
    fn observe(&mut self, edges: usize) {
        let now = self.machine.now();
        let is_step = self.machine.edges[edges..]
            .iter()
            .any(|edge| edge.raise != 0);
        if is_step && !self.is_stepping {
            let enabled = self.enabled;
            let enabled = enabled.expect("a motor steps whose driver is disabled");
            self.leads.push(now - enabled);
            self.is_stepping = true;
        }
        match (self.machine.outputs().drivers, self.enabled) {
            (true, None) => {
                self.enabled = Some(now);
                self.is_stepping = false;
            }
            (false, _) => self.enabled = None,
            (true, Some(_)) => {}
        }
    }

    fn x(&self) -> i32 {
        self.machine.xyz()[0]
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
        let mut drivers = Enabling::new(&["786=200"]);
        drivers.send_for("G91\n", 0);
        for number in 1..=2 {
            drivers.send_for(&format!("{line}\n"), 10000);
            let leads = &drivers.leads;
            assert_eq!(leads.len(), number, "{line}");
            let lead = leads[number - 1];
            assert!((200 * MS..240 * MS).contains(&lead), "{line}: {lead} ticks");
            // The drivers are disabled meanwhile.
            assert_eq!(drivers.enabled, None, "{line}");
        }
        assert!(
            !drivers.machine.received.contains("error"),
            "{}",
            drivers.machine.received
        );
    }
}

#[test]
fn drivers_that_are_enabled_need_no_time() {
    let mut drivers = Enabling::new(&["786=200", "1=255"]);
    drivers.send_for("G0X1\n", 100);
    assert!(drivers.x() > 0);
}

#[test]
fn without_the_setting_a_dwell_enables_no_driver_and_a_move_begins_at_once() {
    let mut drivers = Enabling::new(&[]);
    drivers.send_for("G4P1\n", 500);
    assert_eq!(drivers.enabled, None);
    drivers.send_for("", 1000);
    drivers.send_for("G0X1\n", 1000);
    assert!(drivers.leads[0] < 25 * MS, "{:?}", drivers.leads);
}

#[test]
fn a_hold_before_the_first_step_holds_and_a_reset_ends_the_move() {
    for home in [false, true] {
        let mut drivers = Enabling::new(&["786=500", "22=1", "788=7"]);
        drivers.send_for("$X\nG0X1\n", 0);
        if home {
            drivers.send_for("\x18", 1000);
            drivers.send_for("$H\n", 0);
        }
        drivers.send_for("", 100);
        assert_eq!(drivers.x(), 0);
        drivers.send_for("!", 2000);
        if !home {
            assert_eq!(drivers.machine.state(), State::HoldComplete);
            assert_eq!(drivers.x(), 0);
            drivers.send_for("~", 5000);
            assert_eq!(drivers.x(), 250);
            drivers.send_for("G0X0\n", 100);
        }
        drivers.send_for("\x18", 2000);
        assert!(
            drivers.machine.received.ends_with("to unlock]\r\n")
                || drivers.machine.received.ends_with("help]\r\n")
        );
        drivers.send_for("$X\nG91G0X1\n", 5000);
        assert!(
            drivers.machine.received.ends_with("ok\r\n"),
            "{}",
            drivers.machine.received
        );
    }
}
