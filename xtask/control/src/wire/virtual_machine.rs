//! The virtual machine in real time, amid limit switches and above a probe plate.

use leadscrew::{
    settings::{Settings, StepRate},
    sim::Simulator,
};
use simulation::{
    SwitchPositions,
    machine::Machine,
    settings::{Dump, combine},
};

use super::Wire;

/// The settings of the small mill, for which the examples are.
const MILL: &str = include_str!("../../../../examples/mill.settings");
/// What a mill with switches has beside.
const SWITCHES: &str = "$21=1\n$22=1\n$24=300\n$25=1500\n";
/// A worker that was asleep for longer does not make the machine hurry, ms.
const LONGEST_STEP_MS: u64 = 200;

/// The virtual machine.
pub struct VirtualMachine {
    machine: Machine,
    last_ms: u64,
}

impl VirtualMachine {
    /// The settings of the mill.
    pub fn settings() -> Settings {
        let dump = Dump::read(&[MILL, SWITCHES].concat());
        let start = Settings::new(StepRate::Unproven);
        // The tests see to it that no setting is refused.
        combine(&start, &dump.entries).map_or(start, |combined| combined.settings)
    }

    /// A mill that has just been switched on, at a time in ms.
    pub fn new(now_ms: u64) -> Self {
        let settings = Self::settings();
        let mut simulator = Simulator::new(&settings);
        SwitchPositions::of(&settings).mount_on(&mut simulator);
        Self {
            machine: Machine::amid(simulator, Vec::new()),
            last_ms: now_ms,
        }
    }
}

impl Wire for VirtualMachine {
    fn exchange(&mut self, output: &[u8], now_ms: u64) -> Result<Vec<u8>, String> {
        self.machine.send(output);
        let passed_ms = now_ms.saturating_sub(self.last_ms).min(LONGEST_STEP_MS);
        self.last_ms = now_ms;
        self.machine.run_for(passed_ms as f64 / 1000.0);
        let bytes = self.machine.take_bytes();
        Ok(bytes.into_iter().map(|(_, byte)| byte).collect())
    }
}

#[cfg(test)]
mod tests {
    use super::*;

    /// What the machine says for some time.
    fn run(machine: &mut VirtualMachine, from_ms: u64, ms: u64, output: &[u8]) -> String {
        let mut bytes = machine.exchange(output, from_ms).unwrap();
        for now_ms in (from_ms..=from_ms + ms).step_by(20) {
            bytes.extend(machine.exchange(b"", now_ms).unwrap());
        }
        String::from_utf8(bytes).unwrap()
    }

    #[test]
    fn the_mill_has_its_settings_and_its_switches() {
        let mut machine = VirtualMachine::new(1000);
        let messages = run(&mut machine, 1000, 2000, b"$X\n$$\n");
        for setting in ["$22=1\r\n", "$100=320", "$122=300", "$25=1500"] {
            assert!(messages.contains(setting), "{messages}");
        }
        run(&mut machine, 3000, 60_000, b"$H\n");
        let messages = run(&mut machine, 70_000, 500, b"?");
        assert!(
            messages.contains("<Idle|MPos:-1.000,-1.000,-1.000|"),
            "{messages}"
        );
    }

    #[test]
    fn a_worker_that_slept_makes_nothing_hurry() {
        let mut machine = VirtualMachine::new(0);
        run(&mut machine, 0, 500, b"$X\nG1X5F60\n");
        machine.exchange(b"", 1_000_000).unwrap();
        let messages = run(&mut machine, 1_000_000, 100, b"?");
        assert!(messages.contains("<Run|"), "{messages}");
    }
}
