//! Jogs, overrides, outputs and states.

use crate::machine::{Machine, RESET, wait_for};

#[test]
fn a_jog_can_be_cancelled() {
    let Some(mut machine) = Machine::boot() else {
        return;
    };
    machine.make_fast();
    assert_eq!(machine.ask("$J=G91X1F3000"), ["ok"]);
    machine.wait_for_idle();
    assert_eq!(machine.memory.steps()[0], 80);
    for _ in 0..5 {
        assert_eq!(machine.ask("$J=G91X100F600"), ["ok"]);
    }
    machine.wait_for("Jog");
    machine.send(b"\x85");
    machine.wait_for_idle();
    let stopped = machine.memory.steps()[0];
    assert!((80..80 * 100).contains(&stopped), "{stopped}");
    assert_eq!(machine.ask("$J=X1"), ["error:22"]);
    assert_eq!(machine.ask("$J=F100"), ["error:26"]);
    // The rest of the jogs is forgotten.
    assert_eq!(machine.ask("G91G0X0"), ["ok"]);
    machine.wait_for_idle();
    assert_eq!(machine.memory.steps()[0], stopped);
}

#[test]
fn overrides_change_the_speed_in_motion() {
    let Some(mut machine) = Machine::boot() else {
        return;
    };
    machine.make_fast();
    assert_eq!(machine.ask("G1X400F600"), ["ok"]);
    machine.memory.wait_for_steps(0, |steps| steps >= 400);
    // 200 %, then 25 % of rapids, and the spindle's to 90 %.
    machine.send(&[0x91; 10]);
    machine.send(&[0x97, 0x9b]);
    machine.wait_for_field("Ov", "200,25,90");
    machine.wait_for_field("FS", "1200,");
    machine.send(RESET);
    machine.wait_for_welcome();
}

#[test]
fn spindle_and_coolant_are_switched() {
    let Some(mut machine) = Machine::boot() else {
        return;
    };
    for (line, bits, duty) in [
        ("M3S500", 0b0001, 512..=512),
        ("M4S1000", 0b0011, 1020..=1020),
        ("M8", 0b0111, 1020..=1020),
        ("M5", 0b0100, 0..=0),
        ("M9", 0, 0..=0),
    ] {
        assert_eq!(machine.ask(line), ["ok"]);
        machine.wait_for_idle();
        let switched = machine.memory.switched();
        assert_eq!(switched.bits & 0xf, bits, "{line}");
        assert!(duty.contains(&switched.duty), "{line}: {switched:?}");
    }
}

#[test]
fn a_laser_shines_in_motion_only() {
    let Some(mut machine) = Machine::boot() else {
        return;
    };
    machine.make_fast();
    machine.set(&["$32=1"]);
    assert_eq!(machine.ask("M4S1000"), ["ok"]);
    machine.wait_for_idle();
    assert_eq!(machine.memory.switched().highest_duty, 0);
    assert_eq!(machine.ask("G1X20F3000"), ["ok"]);
    machine.wait_for_idle();
    let switched = machine.memory.switched();
    assert_eq!((switched.duty, switched.highest_duty), (0, 1020));
    machine.memory.forget_duty();
    assert_eq!(machine.ask("G0X0"), ["ok"]);
    machine.wait_for_idle();
    assert_eq!(machine.memory.switched().highest_duty, 0);
}

#[test]
fn drivers_are_released_after_the_idle_delay() {
    let Some(mut machine) = Machine::boot() else {
        return;
    };
    machine.make_fast();
    assert_eq!(machine.memory.switched().drivers(), 0);
    machine.set(&["$1=255"]);
    assert_eq!(machine.ask("G0X1"), ["ok"]);
    machine.wait_for_idle();
    assert_eq!(machine.memory.switched().drivers(), 1);
    machine.set(&["$1=5"]);
    assert_eq!(machine.ask("G0X2"), ["ok"]);
    machine.wait_for_idle();
    wait_for(|| match machine.memory.switched() {
        on if on.drivers() == 1 => Err(on),
        _ => Ok(()),
    });
}

#[test]
fn nothing_moves_in_check_mode_and_asleep() {
    let Some(mut machine) = Machine::boot() else {
        return;
    };
    assert_eq!(machine.ask("$C"), ["[MSG:Enabled]", "ok"]);
    assert_eq!(machine.ask("G1X10F600"), ["ok"]);
    assert_eq!(machine.ask("G1X10F600Y"), ["error:2"]);
    assert_eq!(machine.status().state, "Check");
    machine.send(b"$C\n");
    assert_eq!(machine.receive(), "[MSG:Disabled]");
    machine.wait_for_welcome();
    machine.wait_for("Idle");
    machine.send(b"$SLP\n");
    machine.wait_for("Sleep");
    machine.send(RESET);
    machine.wait_for_welcome();
    assert_eq!(machine.memory.steps(), [0; 6]);
}

#[test]
fn what_is_stored_outlives_a_reset_of_the_chip() {
    let Some(mut machine) = Machine::boot() else {
        return;
    };
    machine.set(&["$100=123.456", "G10L2P1X5", "$N0=G20", "$I=shop 7"]);
    machine.memory.reset_chip();
    machine.wait_for_welcome();
    assert_eq!(machine.receive(), ">G20:ok");
    assert!(machine.ask("$$").contains(&"$100=123.456".to_owned()));
    assert!(machine.ask("$I")[0].ends_with(":SHOP7]"));
    assert!(machine.ask("$#")[0].starts_with("[G54:5.000,"));
    assert_eq!(machine.ask("$RST=*"), ["[MSG:Restoring defaults]", "ok"]);
    machine.wait_for_welcome();
    machine.memory.reset_chip();
    machine.wait_for_welcome();
    assert!(machine.ask("$$").contains(&"$100=250.000".to_owned()));
    assert!(machine.ask("$#")[0].starts_with("[G54:0.000,"));
}

#[test]
fn flash_that_is_written_full_keeps_the_newest() {
    let Some(mut machine) = Machine::boot() else {
        return;
    };
    for number in 1..=300 {
        assert_eq!(machine.ask(&format!("$110={number}")), ["ok"]);
    }
    machine.memory.reset_chip();
    machine.wait_for_welcome();
    assert!(machine.ask("$$").contains(&"$110=300.000".to_owned()));
}
