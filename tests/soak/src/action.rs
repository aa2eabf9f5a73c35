//! What may happen to a machine: lines, realtime bytes, contacts, damage, breaks, time, and the loss of power.

use leadscrew::{axis::AXES, model::Levels};
use proptest::prelude::*;

use crate::random_lines::any_line;

/// Something that happens to the machine.
#[derive(Debug, Clone, PartialEq, Eq)]
pub(crate) enum Action {
    /// The sender sends a line.
    Line(String),
    /// It sends a line several times.
    Lines(String, u8),
    /// It asks for reports: how many, and ms from one to the next.
    Reports(u8, u8),
    /// The same with a bit of one of its bytes changed on the way, the line feed among them.
    DamagedLine { text: String, byte: usize, bit: u8 },
    /// The same with a byte damaged in a way that the receiver notices: the byte is dropped.
    LossyLine { text: String, byte: usize },
    /// The line from the sender is low, ms.
    Break(u32),
    /// A realtime byte, or any other.
    Byte(u8),
    /// A contact closes.
    Close(Contact),
    /// It opens again.
    Open(Contact),
    /// Time passes, ms.
    Pass(u32),
    /// The door opens and is closed again, cycle start and a hold are pressed, each after so many ms.
    HoldBehindDoor(u32),
    /// The power fails.
    PowerFails,
    /// The power fails in the middle of what a line writes to the flash, after some words.
    PowerFailsInWrite { text: String, words: u64, seed: u64 },
}

/// A contact at the inputs.
#[derive(Debug, Clone, Copy, PartialEq, Eq)]
pub(crate) enum Contact {
    Door,
    Hold,
    Reset,
    Start,
    Probe,
    /// The limit switch of an axis, 0 = X.
    Limit(u8),
}

impl Contact {
    /// The input that it closes.
    pub(crate) fn input(self) -> Levels {
        match self {
            Self::Door => Levels::DOOR,
            Self::Hold => Levels::HOLD,
            Self::Reset => Levels::RESET,
            Self::Start => Levels::START,
            Self::Probe => Levels::PROBE,
            Self::Limit(axis) => Levels::limits(1 << axis),
        }
    }
}

/// Lines that write one record to the flash, the same whenever they are sent again.
fn storing_line() -> impl Strategy<Value = String> {
    prop_oneof![
        (1_u8..10, -90_i32..90).prop_map(|(number, x)| format!("G10L2P{number}X{x}Y{}", -x)),
        (1_u8..30, -20..20).prop_map(|(tool, z)| format!("G10L1P{tool}Z{z}")),
        (1_u32..250, 0_u32..999).prop_map(|(mm, part)| format!("$27={mm}.{part}")),
        prop::sample::select(
            &[
                "$N0=G21",
                "$N1=G17",
                "$N0=",
                "$I=cell 3",
                "$I=",
                "$10=255",
                "$10=1",
                "$11=0.01",
                "$11=0.05",
                "$12=0.002",
                "$5=0",
                "$777=1",
                "$777=0",
                "$32=1",
                "$32=0",
                "$30=500",
                "$30=1000",
            ][..]
        )
        .prop_map(str::to_owned),
    ]
}

/// Lines that switch, probe, and move work coordinates more than [`any_line`] does.
fn switching_line() -> impl Strategy<Value = String> {
    prop::sample::select(
        &[
            "M3S800",
            "M4S600",
            "M3S1000G1X-20F2000",
            "M4S700G1Y-30F1500",
            "M8",
            "G38.2Z-90F1500",
            "G38.3X-90F3000",
            "G38.5Z0F2000",
            "G92X1Y2",
            "G10L20P1Z-3",
            "G55G0X-5",
            "$J=G91X-300F5000",
            "G92X60Y60Z60",
            "G10L20P1X50Z50",
            "$J=X-95F6000",
            "$J=Y-90Z-80F5000",
            "(a long comment that fills the queue of the machine before it is played at all)",
            "G4P1",
        ][..],
    )
    .prop_map(str::to_owned)
}

/// Lines of hosts of 3D printers: to another machine they are mostly errors. None becomes `M118` by one bit, which says
/// whatever it is told.
fn host_line() -> impl Strategy<Value = String> {
    let words = prop::sample::select(
        &[
            "G1 X-5 E2 F3000",
            "G92 E0",
            "G92 X0",
            "G28",
            "G28 X",
            "M20",
            "M105",
            "M114",
            "M115",
            "M119",
            "M112",
            "M999",
            "M410",
            "M108",
            "M106 S128",
            "M107",
            "M82",
            "M83",
            "M220 S50",
            "M204 S200",
            "M400",
            "M117 Done!",
            "M0 S1",
            "M84",
            "M503",
            "M154 S1",
            "M154 S0",
            "G4 P20",
            "G0 S1 X-20",
        ][..],
    );
    (words, prop::option::of(0_u8..6)).prop_map(|(words, number)| match number {
        Some(number) => {
            let line = format!("N{number} {words}");
            let checksum = line.bytes().fold(0, |sum, byte| sum ^ byte);
            format!("{line}*{checksum}")
        }
        None => words.to_owned(),
    })
}

fn line() -> impl Strategy<Value = String> {
    prop_oneof![
        2 => host_line(),
        12 => any_line(),
        3 => storing_line(),
        6 => switching_line(),
        2 => prop::sample::select(&["$32=1", "$32=0"][..]).prop_map(str::to_owned),
        1 => prop::sample::select(&["$H", "$HX", "$C", "$X", "$", "$$", "$+", "$I+", "$RST=#", "G28.1", "G30.1", "G10L20P2X1"][..])
            .prop_map(str::to_owned),
    ]
}

fn contact() -> impl Strategy<Value = Contact> {
    prop_oneof![
        4 => Just(Contact::Door),
        2 => Just(Contact::Hold),
        1 => Just(Contact::Reset),
        4 => Just(Contact::Start),
        4 => Just(Contact::Probe),
        2 => (0..AXES as u8).prop_map(Contact::Limit),
    ]
}

fn realtime_byte() -> impl Strategy<Value = u8> {
    prop_oneof![
        8 => Just(b'?'),
        6 => Just(b'~'),
        4 => Just(b'!'),
        1 => Just(0x18),
        8 => 0x80_u8..0xa4,
        1 => any::<u8>(),
    ]
}

fn action() -> impl Strategy<Value = Action> {
    prop_oneof![
        60 => line().prop_map(Action::Line),
        2 => (line(), 2_u8..80).prop_map(|(line, times)| Action::Lines(line, times)),
        2 => (1_u8..45, 6_u8..60).prop_map(|(times, ms)| Action::Reports(times, ms)),
        3 => (line(), 0_usize..80, 0_u8..8)
            .prop_filter("a setting with a wrong number may be any", |(text, ..)| !text.starts_with('$'))
            .prop_map(|(text, byte, bit)| Action::DamagedLine { text, byte, bit }),
        3 => (line(), 0_usize..80).prop_map(|(text, byte)| Action::LossyLine { text, byte }),
        2 => prop_oneof![0_u32..60, 150_u32..500].prop_map(Action::Break),
        20 => realtime_byte().prop_map(Action::Byte),
        3 => contact().prop_map(Action::Close),
        6 => contact().prop_map(Action::Open),
        12 => prop_oneof![0_u32..20, 0_u32..3000].prop_map(Action::Pass),
        2 => (20_u32..2500).prop_map(Action::HoldBehindDoor),
        1 => Just(Action::PowerFails),
        2 => (storing_line(), 0_u64..120, any::<u64>())
            .prop_map(|(text, words, seed)| Action::PowerFailsInWrite { text, words, seed }),
    ]
}

/// Histories of up to `longest` actions.
pub(crate) fn history(longest: usize) -> impl Strategy<Value = Vec<Action>> {
    prop::collection::vec(action(), 1..=longest)
}
