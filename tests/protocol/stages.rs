//! Lines on the whole simulated machine, disturbed at any stage of them.

use leadscrew::model::State;

use super::{
    bench::answers,
    machine::{assert_true, execute, limited},
    support::{Machine, each},
};

/// Changes of the machine from one stage to the next.
const CHANGES: usize = 3;
/// What stops the motion for a while, or changes its speed.
const DISTURBANCES: [&[u8]; 5] = [b"!", b"\x84", b"\x95", b"\x91\x9b", b"?!"];

/// Presses cycle start wherever the machine rests, also where a line pauses.
fn go_on(machine: &mut Machine) {
    for _ in 0..4 {
        machine.run_to_standstill();
        machine.send(b"~");
    }
    machine.run_to_standstill();
}

/// Lines that are disturbed.
pub(crate) struct Disturbed<'a> {
    /// What is executed before.
    pub(crate) setup: &'a [&'a str],
    pub(crate) lines: &'a [&'a str],
    /// Stages that there are at least, and that are tried at most.
    pub(crate) stages: [usize; 2],
}

impl Disturbed<'_> {
    /// The machine before the lines.
    pub(crate) fn ready(&self) -> Machine {
        let mut machine = limited();
        for line in self.setup {
            assert_eq!(execute(&mut machine, line), ["ok"], "{line}");
        }
        machine.run_to_standstill();
        machine
    }

    /// The machine to which the lines have just been sent.
    pub(crate) fn sent(&self) -> Machine {
        let mut machine = self.ready();
        machine.send(self.lines.join("\n") + "\n");
        machine
    }

    /// Disturbs the machine at each stage.
    pub(crate) fn at_each_stage(&self, mut disturb: impl FnMut(Machine, usize)) {
        let [least, most] = self.stages;
        for stage in (0..most).step_by(each(5)) {
            let mut machine = self.sent();
            if !(0..stage * CHANGES).all(|_| machine.advance()) {
                assert!(stage > least, "{:?} end at stage {stage}", self.lines);
                return;
            }
            disturb(machine, stage);
        }
    }

    /// Holds, the door and overrides at each stage change nothing but the time.
    pub(crate) fn assert_undisturbed(&self, check: impl Fn(&Machine, &str)) {
        let oks = vec!["ok"; self.lines.len()];
        let mut undisturbed = self.sent();
        go_on(&mut undisturbed);
        assert_eq!(answers(&undisturbed.lines()), oks);
        assert_true(&undisturbed, "undisturbed");
        let end = undisturbed.physical_steps();
        for bytes in DISTURBANCES {
            self.at_each_stage(|mut machine, stage| {
                machine.send(bytes);
                let what = format!("{:?}: {bytes:?} at {stage}", self.lines);
                go_on(&mut machine);
                assert_eq!(answers(&machine.lines()), oks, "{what}");
                assert_eq!(machine.physical_steps(), end, "{what}");
                assert_true(&machine, &what);
                assert_eq!(machine.state(), State::Idle, "{what}");
                check(&machine, &what);
            });
        }
    }
}
