//! The states of a machine that somebody stands at: jogs, overrides, the laser, check mode, sleep, buttons and door.

use board_data::{Input, Wiring};

use super::{MOVE_ALL_THE_SAME, RESET};
use crate::script::{Act, PowerUp, Wanted};

/// Feed override to 200 %, that of rapids to 25 %, that of the spindle to 90 %.
const OVERRIDES: &[u8] = &[
    0x91, 0x91, 0x91, 0x91, 0x91, 0x91, 0x91, 0x91, 0x91, 0x91, 0x97, 0x9b,
];
/// Speed and acceleration of X, with which motion takes little time.
const FAST: [&str; 2] = ["$110=3000", "$120=500"];

/// What a sender and a hand do, and the state that the machine is in afterwards.
pub(super) fn script(wiring: &Wiring, right: PowerUp) -> Vec<Act> {
    let has = |input| wiring.inputs.iter().any(|(it, _)| *it == input);
    let mut script = vec![
        Act::Part("states"),
        Act::Case("overrides, jogs and modes".into(), right),
        Act::Await("Grbl "),
        Act::line("G21G91"),
    ];
    script.extend(FAST.map(Act::line));
    script.extend(jogs());
    script.extend(overrides());
    script.extend(laser());
    let backwards = wiring.counter_clockwise;
    script.extend(backwards.map(|_| Act::Want(Wanted::Active("counter-clockwise"))));
    script.extend(modes());
    script.extend(wiring.spindle.map(|_| Act::Want(Wanted::Off("spindle"))));
    if !wiring.enable.is_empty() {
        script.extend([Act::line("$1=5"), Act::line("G91G0X-1"), Act::State("Idle")]);
        script.extend([Act::Pause(50), Act::Want(Wanted::Off("enable 0"))]);
    }
    script.extend([
        Act::Bytes(b"$SLP\n"),
        Act::State("Sleep"),
        Act::Bytes(MOVE_ALL_THE_SAME),
        Act::Pause(100),
        Act::Want(Wanted::Position),
        Act::Bytes(RESET),
        Act::Await("Grbl "),
        Act::line("$X"),
        Act::line("$1=25"),
        Act::line("G91G1X100F600"),
    ]);
    if has(Input::Hold) && has(Input::Start) {
        script.extend(buttons());
    }
    if has(Input::Door) {
        script.extend(door(wiring));
    }
    if has(Input::Reset) {
        script.extend([Act::Press(Input::Reset), Act::Await("ALARM:3")]);
    } else {
        script.extend([Act::Bytes(RESET), Act::Await("ALARM:3")]);
    }
    script.extend([
        Act::Await("Grbl "),
        Act::Await("[MSG:'$H'|'$X' to unlock]"),
        Act::Release(Input::Reset),
        // It brakes.
        Act::Pause(100),
        Act::State("Alarm"),
        Act::Want(Wanted::Position),
        Act::Refused("G1X1"),
        Act::Want(Wanted::Lines("error:9".into(), 1)),
        Act::Want(Wanted::Resets(&[])),
    ]);
    script
}

/// A jog is cancelled, with those behind it.
fn jogs() -> [Act; 11] {
    [
        Act::line("$J=X1F3000"),
        Act::State("Idle"),
        Act::Want(Wanted::OneOf(&["<Idle|MPos:1.000,"])),
        Act::line("$J=X50F600"),
        Act::line("$J=X50F600"),
        Act::State("Jog"),
        Act::Bytes(&[0x85]),
        Act::State("Idle"),
        Act::Want(Wanted::Position),
        Act::Refused("$J=X1"),
        Act::Refused("$J=F100"),
    ]
}

/// A move is as fast as the overrides say.
fn overrides() -> [Act; 9] {
    [
        Act::line("G1X50F600"),
        Act::Pause(100),
        Act::Bytes(OVERRIDES),
        Act::Field("|Ov:200,25,90"),
        Act::Field("|FS:1200,"),
        Act::Bytes(RESET),
        Act::Await("Grbl "),
        Act::Pause(100),
        Act::line("$X"),
    ]
}

/// The beam is on while the machine cuts, and only then.
fn laser() -> [Act; 12] {
    [
        Act::line("$32=1"),
        Act::line("M4S1000"),
        Act::State("Idle"),
        Act::Want(Wanted::PwmOff),
        Act::line("G91G1X-5F600"),
        Act::Pause(200),
        Act::Want(Wanted::PwmOn),
        Act::State("Idle"),
        Act::Want(Wanted::PwmOff),
        Act::line("G0X5"),
        Act::Pause(50),
        Act::Want(Wanted::PwmOff),
    ]
}

/// Nothing moves in check mode.
fn modes() -> [Act; 11] {
    [
        Act::line("M5"),
        Act::State("Idle"),
        Act::line("$32=0"),
        Act::line("$C"),
        Act::line("G1X10F600"),
        Act::Refused("G1X10F600Y"),
        Act::State("Check"),
        Act::Want(Wanted::Position),
        Act::Bytes(b"$C\n"),
        Act::Await("Grbl "),
        Act::State("Idle"),
    ]
}

/// Feed hold and cycle start.
fn buttons() -> [Act; 6] {
    [
        Act::Pause(100),
        Act::Press(Input::Hold),
        Act::State("Hold:0"),
        Act::Release(Input::Hold),
        Act::Press(Input::Start),
        Act::State("Run"),
    ]
}

/// An open door stops motion and coolant, and is not resumed from until it is closed.
fn door(wiring: &Wiring) -> Vec<Act> {
    let mut script = vec![
        Act::Release(Input::Start),
        Act::Bytes(&[0xA0]),
        Act::Pause(100),
        Act::Press(Input::Door),
        Act::State("Door:1"),
    ];
    let flood = wiring.flood.map(|_| Act::Want(Wanted::Off("flood")));
    script.extend(flood);
    script.extend([
        Act::Bytes(b"~"),
        Act::State("Door:1"),
        Act::Release(Input::Door),
        Act::State("Door:0"),
        Act::Want(Wanted::Position),
        Act::Bytes(b"~"),
        Act::State("Run"),
    ]);
    script
}
