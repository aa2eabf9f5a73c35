//! What is reported of inputs, and a break on the line.

use leadscrew::model::Levels;

use crate::machine::Machine;

#[test]
fn an_input_that_is_active_is_reported() {
    let Some(mut machine) = Machine::boot_small() else {
        return;
    };
    assert_eq!(machine.status().field("Pn"), None);
    machine.memory.mount_low(0, 0);
    machine.memory.mount_high(2, 0);
    machine.memory.put_plate(0);
    machine.wait_for_field("Pn", "PXZ");
    machine.set(&["$5=1"]);
    machine.wait_for_field("Pn", "PY");
    machine.memory.put_plate(i32::MIN);
    machine.memory.close(Levels::HOLD);
    machine.wait_for_field("Pn", "YH");
}

#[test]
fn a_break_on_the_line_holds_a_move_that_ends_exactly_after_cycle_start() {
    let Some(mut machine) = Machine::boot() else {
        return;
    };
    assert_eq!(machine.ask("G1X150F400"), ["ok"]);
    machine.memory.wait_for_steps(0, |steps| steps >= 100);
    machine.memory.pull_line(true);
    machine.receive_until(|line| line == "[MSG:Break on the line]");
    machine.wait_for("Hold:0");
    // The break lasts, and holds no second time.
    machine.send(b"~");
    machine.wait_for_idle();
    assert_eq!(machine.memory.steps()[0], 150 * 250);
}
