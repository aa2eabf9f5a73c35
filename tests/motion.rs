//! Moves as the step pins show them: exact counts, limits kept, path kept.
#![cfg(not(target_os = "none"))]

mod support;

use support::{Rig, check_path, fast, line};

#[test]
fn a_line_makes_its_steps() {
    let commands = [line(&[10.0, -5.0, 2.5], 3000.0)];
    let trace = Rig::play(&fast(), &commands);
    assert_eq!(trace.net_steps().0[..3], [800, -400, 200]);
    trace.check_pulses();
    check_path(&fast(), &commands, &trace, 0.0);
}
