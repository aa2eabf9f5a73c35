//! Records that this, older and newer firmware has written.

use std::vec;

use super::*;
use crate::{axis::AXES, settings::Settings, units::StepsPerMm};

fn read(key: Key, contents: &[u8]) -> Stored {
    let mut stored = Stored::default();
    key.read(contents, &mut stored);
    stored
}

fn written(key: Key, stored: &Stored) -> vec::Vec<u8> {
    let mut record = Record::new(7);
    key.write(stored, &mut record).unwrap();
    let (generation, contents) = open(record.bytes()).unwrap();
    assert_eq!(generation, 7);
    contents.to_vec()
}

/// `$n` as a whole number, in single precision and in millionths.
fn whole(number: u16, value: u16) -> vec::Vec<u8> {
    [&number.to_le_bytes()[..], &[0x02], &value.to_le_bytes()].concat()
}

fn single(number: u16, value: f32) -> vec::Vec<u8> {
    [&number.to_le_bytes()[..], &[0x14], &value.to_le_bytes()].concat()
}

fn millionths(number: u16, value: u64) -> vec::Vec<u8> {
    [&number.to_le_bytes()[..], &[0x28], &value.to_le_bytes()].concat()
}

#[test]
fn the_fullest_records_are_read_back_exactly() {
    let mut stored = Stored::default();
    stored.settings.junction_deviation_mm = 1.0 / 3.0;
    stored.settings.steps_per_mm = Axes::all(StepsPerMm::from_millionths(100_000_100).unwrap());
    stored.settings.homing = 1;
    stored.settings.soft_limits = true;
    stored.origins.coordinates.0.fill(Axes::all(Nm(-1)));
    stored.origins.g30 = Axes::all(Nm(-9_000_000_000_000_000));
    stored
        .origins
        .rotations
        .0
        .fill(MicroDegrees::new(-359_999_999));
    stored.startup[1] = [b'~'; STORED_LINE].into_iter().collect();
    let mut back = Stored::default();
    for key in Key::ALL {
        let contents = written(key, &stored);
        assert!(contents.len() + 5 <= RECORD_BYTES);
        assert!(!contents.windows(8).any(|bytes| bytes == [0xff; 8]));
        key.read(&contents, &mut back);
    }
    assert_eq!(back, stored);
}

#[test]
fn older_firmware_with_fewer_settings_and_axes_is_understood() {
    let contents = [
        whole(0, 5),
        single(11, 0.25),
        millionths(100, 80_500_000),
        single(110, 3000.5),
    ]
    .concat();
    let settings = read(Key::Settings, &contents).settings;
    let mut expected = Settings {
        step_pulse_us: 5,
        junction_deviation_mm: 0.25,
        ..Settings::default()
    };
    expected.steps_per_mm[0] = StepsPerMm::from_millionths(80_500_000).unwrap();
    expected.max_rate_mm_min[0] = 3000.5;
    assert_eq!(settings, expected);
    // One axis, and no G30.
    let mut contents = vec![1, 54];
    contents.extend(zigzag(Nm(-5)).to_le_bytes());
    contents.push(28);
    contents.extend(zigzag(Nm(7)).to_le_bytes());
    let origins = read(Key::Origins, &contents).origins;
    assert_eq!(
        (origins.coordinates.0[0][0], origins.g28[0]),
        (Nm(-5), Nm(7))
    );
    assert_eq!(origins.coordinates.0[0][1], Nm(0));
    assert_eq!(origins.g30, Axes::default());
}

#[test]
fn newer_firmware_with_more_settings_axes_and_kinds_is_understood() {
    let contents = [
        whole(0, 5),
        single(107, 4.0),
        whole(399, 1),
        vec![1, 0, 0x33, 1, 2, 3],
        single(27, 2.5),
    ]
    .concat();
    let settings = read(Key::Settings, &contents).settings;
    assert_eq!((settings.step_pulse_us, settings.idle_delay_ms), (5, 25));
    assert_eq!(settings.homing_pull_off_mm, 2.5);
    // Nine axes, and G59.1 before G30.
    let mut contents = vec![9];
    for name in [54, 60, 30] {
        contents.push(name);
        for axis in 0..9 {
            contents.extend(zigzag(Nm(i64::from(name) * 10 + axis)).to_le_bytes());
        }
    }
    let origins = read(Key::Origins, &contents).origins;
    for axis in 0..AXES {
        assert_eq!(
            origins.coordinates.0[0][axis],
            Nm(540 + i64::from(axis as u8))
        );
        assert_eq!(origins.g30[axis], Nm(300 + i64::from(axis as u8)));
    }
    assert_eq!(origins.coordinates.0[1], Axes::default());
    // More parts have generations.
    let mut contents = vec![9, 5, 0, 0, 0];
    contents.extend([1, 6, 0, 0, 0]);
    assert_eq!(Generations::read(&contents).0, [0, 6, 0, 0, 0, 0]);
}

#[test]
fn a_setting_whose_type_has_changed_keeps_its_value() {
    let contents = [
        single(0, 5.0),
        whole(11, 2),
        millionths(12, 125_000),
        single(100, 80.5),
        whole(101, 40),
        millionths(21, 1_000_000),
    ]
    .concat();
    let settings = read(Key::Settings, &contents).settings;
    assert_eq!(settings.step_pulse_us, 5);
    assert_eq!(settings.junction_deviation_mm, 2.0);
    assert_eq!(settings.arc_tolerance_mm, 0.125);
    assert_eq!(settings.steps_per_mm[0].millionths(), 80_500_000);
    assert_eq!(settings.steps_per_mm[1].millionths(), 40_000_000);
    assert!(settings.hard_limits);
}

#[test]
fn a_value_that_a_setting_cannot_have_is_left_out() {
    let contents = [
        whole(0, 2),
        whole(1, 256),
        single(11, -1.0),
        single(12, f32::NAN),
        single(24, f32::INFINITY),
        millionths(100, 0),
        millionths(101, u64::MAX),
        single(102, f32::NAN),
        single(110, 0.0),
        single(120, -0.5),
        whole(20, 1),
    ]
    .concat();
    assert_eq!(read(Key::Settings, &contents), Stored::default());
    let mut contents = vec![1, 54];
    contents.extend(u64::MAX.to_le_bytes());
    assert_eq!(read(Key::Origins, &contents), Stored::default());
}

#[test]
fn contents_that_end_anywhere_are_read_as_far_as_they_go() {
    let mut stored = Stored::default();
    stored.settings.step_pulse_us = 9;
    stored.origins.coordinates.0[0] = Axes::all(Nm(3));
    for key in [Key::Settings, Key::Origins] {
        let contents = written(key, &stored);
        for length in 0..contents.len() {
            let back = read(key, &contents[..length]);
            assert!(back.settings.step_pulse_us == 9 || length < 5 || key != Key::Settings);
        }
    }
    assert_eq!(open(&[1, 0, 0, 0]), None);
    assert_eq!(open(&[2, 0, 0, 0, 0, 9]), None);
}

#[test]
fn a_rotation_keeps_to_its_system_whatever_the_number_of_axes() {
    let mut stored = Stored::default();
    for (rotation, angle) in stored.origins.rotations.0.iter_mut().zip(1..) {
        *rotation = MicroDegrees::new(angle);
    }
    assert_eq!(read(Key::Origins, &written(Key::Origins, &stored)), stored);
    // As many axes as systems: all rotations in a row.
    let systems = WorkCoordinates::ALL.len() as u8;
    let mut contents = vec![systems, ROTATIONS];
    for angle in 1..=i64::from(systems) {
        contents.extend(zigzag(Nm(angle)).to_le_bytes());
    }
    assert_eq!(read(Key::Origins, &contents), stored);
    // Without rotations the record is that of older firmware.
    let plain = written(Key::Origins, &Stored::default());
    assert_eq!(
        plain.len(),
        1 + (WorkCoordinates::ALL.len() + 2) * (1 + 8 * AXES)
    );
}

#[test]
fn a_tool_is_read_back_exactly_and_newer_firmware_may_add_to_it() {
    let mut tool = ToolEntry::new(NonZeroU8::MAX);
    tool.offset = [Nm(-1), ToolEntry::LONGEST, Nm(10_160_000)];
    tool.diameter = Nm(-3);
    let contents = |tool: Option<ToolEntry>| {
        let mut record = Record::new(7);
        write_tool(tool, &mut record).unwrap();
        open(record.bytes()).unwrap().1.to_vec()
    };
    let mut bytes = contents(Some(tool));
    assert!(!bytes.windows(8).any(|bytes| bytes == [0xff; 8]));
    assert_eq!(read_tool(&bytes), Some(tool));
    assert_eq!(read_tool(&bytes[..20]), None);
    bytes.extend([1, 2, 3]);
    assert_eq!(read_tool(&bytes), Some(tool));
    bytes[1..9].fill(0xff);
    assert_eq!(
        read_tool(&bytes),
        None,
        "a length that the table cannot hold"
    );
    assert_eq!(read_tool(&contents(None)), None);
    for slot in [0, TOOLS - 1] {
        assert_eq!(tool_key(slot).and_then(tool_slot), Some(slot));
    }
    assert_eq!(tool_key(TOOLS), None);
    let keys = Key::ALL
        .map(|key| key as u8)
        .into_iter()
        .chain([GENERATIONS]);
    assert!(keys.into_iter().all(|key| tool_slot(key).is_none()));
}

/// The stored name of each work coordinate system: no firmware may give a name to another system.
const SYSTEMS: &[(&str, u8)] = &[
    ("G54", 54),
    ("G55", 55),
    ("G56", 56),
    ("G57", 57),
    ("G58", 58),
    ("G59", 59),
    ("G59.1", 60),
    ("G59.2", 61),
    ("G59.3", 62),
];

/// Returns what is to be done for systems with other names than those of [`SYSTEMS`], a line for each.
fn renamed(systems: &[(&str, u8)]) -> std::string::String {
    let sentence = |&(word, name): &(&str, u8)| {
        let is_new = SYSTEMS.iter().all(|system| system.0 != word);
        let is_free = SYSTEMS.iter().all(|system| system.1 != name);
        match (is_new, is_free) {
            (true, true) => std::format!("add (\"{word}\", {name}) to SYSTEMS as the last\n"),
            (true, false) => std::format!(
                "make {word} the last row of `work_coordinates!` (src/model/modes.rs): the name {name} \
                 is that of another system\n"
            ),
            (false, _) if SYSTEMS.contains(&(word, name)) => std::string::String::new(),
            (false, _) => {
                std::format!("{word} is stored as {name}, under another name than before\n")
            }
        }
    };
    systems.iter().map(sentence).collect()
}

#[test]
fn every_work_coordinate_system_keeps_its_stored_name() {
    let mut stored = Stored::default();
    let names = positions(&mut stored).map(|(name, _)| name);
    let words = WorkCoordinates::ALL.map(WorkCoordinates::word);
    let systems: vec::Vec<(&str, u8)> = words.into_iter().zip(names).collect();
    let renamed_now = renamed(&systems);
    assert!(renamed_now.is_empty(), "\n{renamed_now}");
    let mut inserted = SYSTEMS.to_vec();
    inserted[5] = ("G58.5", 59);
    assert!(renamed(&inserted).starts_with("make G58.5 the last row"));
    assert!(renamed(&[("G59", 60)]).starts_with("G59 is stored as 60"));
    assert!(renamed(&[("G59.4", 63)]).starts_with("add (\"G59.4\", 63)"));
}
