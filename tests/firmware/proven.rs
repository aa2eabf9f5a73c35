//! The step rate that is in the image: what the firmware says and refuses.

use crate::machine::Machine;

/// Asks for as many steps on one axis as are allowed, and for more.
fn keeps_to(machine: &mut Machine, hz: u32, word: &str) {
    assert_eq!(
        machine.ask("$I")[2],
        format!("[MSG:Step rate: {hz} Hz, {word}]")
    );
    assert_eq!(machine.ask("$0=3"), ["ok"]);
    // 1000 mm/s on an axis with as many steps per mm as there are thousands of steps per second; or
    // with as many as the pulses leave room for.
    let resolution = hz.min(60_000) / 1000;
    assert_eq!(machine.ask(&format!("$100={resolution}")), ["ok"]);
    assert_eq!(machine.ask("$110=60000"), ["ok"]);
    let more = hz / 1000 + 1;
    assert_eq!(machine.ask(&format!("$100={more}")), ["error:12"]);
    if resolution * 1000 == hz {
        assert_eq!(machine.ask("$110=60000.01"), ["error:12"]);
    }
    assert!(machine.ask("$$").contains(&"$110=60000.000".to_owned()));
}

#[test]
fn the_number_in_the_image_is_the_limit() {
    if let Some(mut machine) = Machine::boot() {
        keeps_to(&mut machine, 200_000, "proven");
    }
}

#[test]
fn another_number_in_the_image_is_another_limit() {
    if let Some(mut machine) = Machine::boot_image("SLOW_FIRMWARE_ELF") {
        keeps_to(&mut machine, 20_000, "proven");
    }
}

#[test]
fn an_image_of_which_nothing_is_proven_keeps_to_a_low_rate() {
    if let Some(mut machine) = Machine::boot_image("UNPROVEN_FIRMWARE_ELF") {
        keeps_to(&mut machine, 30_000, "unproven");
    }
}
