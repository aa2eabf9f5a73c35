//! The PWM of the spindle, whose duty is recorded: the timer of its pin may be a stand-in.

use leadscrew::settings::Settings;

pub(super) use super::qemu::memory::record_duty as set_pulse;

pub(super) const fn init() {}

pub(super) const fn configure(_: &Settings) {}
