//! Pins: buttons, switches, the probe, and what is switched.

use leadscrew::machine::Levels;

use crate::machine::Machine;

#[test]
fn the_buttons_hold_resume_and_reset() {
    let Some(mut machine) = Machine::boot() else {
        return;
    };
    assert_eq!(machine.ask("G1X150F400"), ["ok"]);
    while machine.memory.steps()[0] < 100 {}
    machine.memory.close(Levels::HOLD);
    while !machine.status().starts_with("<Hold:0") {}
    machine.memory.close(Levels::NONE);
    let held = machine.memory.steps();
    machine.memory.close(Levels::START);
    while !machine.status().starts_with("<Run") {}
    machine.memory.close(Levels::RESET);
    machine.wait_for_welcome();
    machine.memory.close(Levels::NONE);
    assert!(machine.status().starts_with("<Alarm"));
    assert!(machine.memory.steps()[0] >= held[0]);
}
