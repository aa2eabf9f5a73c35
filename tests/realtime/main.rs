//! Holds, overrides, jogs, the door and the outputs, as the pins and the clock show them.
#![cfg(not(target_os = "none"))]

mod beam;
mod door;
mod jogs;
mod laws;
mod parking;
mod speed;
mod states;
#[path = "../support/mod.rs"]
mod support;
mod switches;

use leadscrew::{
    model::{Command, FeedRate, Notice, Notices, State},
    path::Work,
    settings::Settings,
    units::TICKS_PER_MS,
};
use support::{Rig, at, line_at};

const MS: u64 = TICKS_PER_MS as u64;
const DOOR: u8 = 0x84;
const CANCEL: u8 = 0x85;

fn jog(mm: &[f64], mm_min: f32) -> Command {
    line_at(at(mm), FeedRate::Jog(mm_min))
}

/// The rig, moving.
fn moving(settings: &Settings, command: &Command) -> Rig {
    let mut rig = Rig::new(settings);
    go(&mut rig, command);
    rig
}

fn go(rig: &mut Rig, command: &Command) {
    let work = rig.router.route(command).expect("it moves");
    assert!(rig.enqueue(work));
    rig.prepare();
}

fn send(rig: &mut Rig, work: Work) {
    assert!(rig.enqueue(work));
    rig.prepare();
}

fn notices(rig: &Rig) -> Vec<Notice> {
    let notices: Notices = rig.snapshot().notices;
    let mut seen = 0;
    std::iter::from_fn(|| notices.next(&mut seen)).collect()
}

fn state(rig: &Rig) -> State {
    rig.snapshot().state
}
