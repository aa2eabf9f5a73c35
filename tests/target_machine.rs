//! The machine on the target's processor: G-code in, exact steps out, whatever comes in between.
#![cfg_attr(target_os = "none", no_std, no_main)]

#[cfg(target_os = "none")]
#[path = "support/target.rs"]
mod target;

#[cfg(not(target_os = "none"))]
fn main() {
    println!("skipped on the host: `cargo xtask test` runs it in QEMU");
}

/// A machine and what came of a program.
#[cfg(target_os = "none")]
mod rig {
    use leadscrew::{
        axis::Axes,
        model::State,
        settings::Settings,
        sim::{Simulator, StepStatistics},
    };

    pub(crate) struct Rig<'a> {
        machine: &'a mut Simulator,
        pub(crate) tally: StepStatistics,
        pub(crate) answers: u32,
        pub(crate) errors: u32,
        line: heapless::Vec<u8, 128>,
    }

    impl<'a> Rig<'a> {
        /// Switches on a machine. It stays where it was made: there is no room for two.
        pub(crate) fn new(machine: &'a mut Simulator) -> Self {
            let settings = Settings {
                max_rate_mm_min: Axes::all(5000.0),
                acceleration_mm_s2: Axes::all(500.0),
                ..Settings::default()
            };
            machine.switch_on(&settings, None);
            machine.settle();
            Self {
                machine,
                tally: StepStatistics::new(),
                answers: 0,
                errors: 0,
                line: heapless::Vec::new(),
            }
        }

        pub(crate) fn assert_state(&self, expected: State) {
            let found = self.machine.snapshot().state;
            defmt::assert!(found == expected, "{}", defmt::Debug2Format(&found));
        }

        pub(crate) fn steps(&self) -> Axes<i32> {
            self.machine.snapshot().steps
        }

        pub(crate) fn send(&mut self, bytes: &[u8]) {
            for &byte in bytes {
                self.machine.receive(byte);
                self.machine.settle();
                self.listen();
            }
        }

        /// Plays so many edges, or all that are due.
        pub(crate) fn play(&mut self, edges: usize) {
            for _ in 0..edges {
                let Some(due) = self.machine.due() else {
                    break;
                };
                if let Some(edge) = self.machine.advance(due) {
                    self.tally.add(&edge);
                }
                self.listen();
            }
        }

        fn listen(&mut self) {
            while let Some(byte) = self.machine.send() {
                if byte == b'\n' {
                    self.answers += u32::from(self.line.starts_with(b"ok"));
                    self.errors += u32::from(self.line.starts_with(b"error:"));
                    self.line.clear();
                } else {
                    let _ = self.line.push(byte);
                }
            }
            self.machine.settle();
        }
    }
}

#[cfg(target_os = "none")]
#[defmt_test::tests]
mod tests {
    use defmt::{assert, assert_eq};
    use leadscrew::{model::State, sim::Simulator};

    use crate::rig::Rig;

    #[test]
    fn lines_and_arcs_end_on_their_steps() {
        let mut machine = Simulator::off();
        let mut rig = Rig::new(&mut machine);
        rig.send(b"G21G90\nG1X10Y-5.004F3000\nG3X0Y-5.004I-5J0\nG18G2X2Z2R2\nG91G0X-0.3\n");
        rig.play(usize::MAX);
        assert_eq!(rig.answers, 5);
        assert_eq!(rig.steps().0[..3], [425, -1251, 500]);
        assert_eq!(rig.tally.steps.0[..3], [425, -1251, 500]);
        rig.assert_state(State::Idle);
    }

    #[test]
    fn a_hold_makes_no_step_more_or_less() {
        let mut machine = Simulator::off();
        let mut rig = Rig::new(&mut machine);
        rig.send(b"G1X8Y3F4000\nX0Y0\n");
        for _ in 0..5 {
            rig.play(400);
            rig.send(b"!");
            rig.play(usize::MAX);
            rig.assert_state(State::HoldComplete);
            rig.send(b"~");
        }
        rig.play(usize::MAX);
        assert_eq!(rig.steps().0[..2], [0, 0]);
        assert_eq!(rig.tally.pulses.0[..2], [4000, 1500]);
    }

    #[test]
    fn a_reset_in_motion_keeps_the_position() {
        let mut machine = Simulator::off();
        let mut rig = Rig::new(&mut machine);
        rig.send(b"G1X8F4000\n");
        rig.play(1000);
        rig.send(b"\x18");
        rig.play(usize::MAX);
        rig.assert_state(State::Alarm);
        assert_eq!(i64::from(rig.steps().0[0]), rig.tally.steps.0[0]);
        assert!(rig.steps().0[0] < 2000);
    }

    #[test]
    fn bad_lines_get_an_error_each_and_move_nothing() {
        let mut machine = Simulator::off();
        let mut rig = Rig::new(&mut machine);
        rig.send(b"G1X1\nG2X1Y1F100\nG0X1e9\nX\0Y\xffZ\n(\n$7\nG0X99999999999999999999\n");
        rig.play(usize::MAX);
        assert_eq!(rig.errors, 6);
        assert_eq!(rig.answers, 1);
        assert_eq!(rig.tally.events, 0);
    }
}
