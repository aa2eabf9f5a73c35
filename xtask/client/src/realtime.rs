//! Bytes that a machine acts on at once, wherever in a line they come: they take no room and have no answer.

/// Asks for a status report.
pub const REPORT: u8 = b'?';
/// Feed hold.
pub const HOLD: u8 = b'!';
/// Cycle start: goes on after a hold or a program pause.
pub const RESUME: u8 = b'~';
/// Resets the machine, which then says that it is there.
pub const RESET: u8 = 0x18;
/// Opens the safety door.
pub const DOOR: u8 = 0x84;
/// Ends a jog.
pub const JOG_CANCEL: u8 = 0x85;
/// The feed as it is programmed.
pub const FEED_RESET: u8 = 0x90;
/// 10 % more feed.
pub const FEED_PLUS_10: u8 = 0x91;
/// 10 % less feed.
pub const FEED_MINUS_10: u8 = 0x92;
/// 1 % more feed.
pub const FEED_PLUS_1: u8 = 0x93;
/// 1 % less feed.
pub const FEED_MINUS_1: u8 = 0x94;
/// Rapids at full speed.
pub const RAPIDS_FULL: u8 = 0x95;
/// Rapids at half speed.
pub const RAPIDS_HALF: u8 = 0x96;
/// Rapids at a quarter of their speed.
pub const RAPIDS_QUARTER: u8 = 0x97;
/// The speed of the spindle as it is programmed.
pub const SPINDLE_RESET: u8 = 0x99;
/// 10 % more spindle speed.
pub const SPINDLE_PLUS_10: u8 = 0x9a;
/// 10 % less spindle speed.
pub const SPINDLE_MINUS_10: u8 = 0x9b;
/// 1 % more spindle speed.
pub const SPINDLE_PLUS_1: u8 = 0x9c;
/// 1 % less spindle speed.
pub const SPINDLE_MINUS_1: u8 = 0x9d;
/// Stops the spindle in a hold, or starts it again.
pub const SPINDLE_STOP: u8 = 0x9e;
/// Flood coolant on or off.
pub const FLOOD_TOGGLE: u8 = 0xa0;
/// Mist coolant on or off.
pub const MIST_TOGGLE: u8 = 0xa1;
/// Has the machine execute lines in a change of the tool: of grblHAL and Leadscrew.
pub const TOOL_CHANGE: u8 = 0xa3;
