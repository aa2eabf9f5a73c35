//! Tests of the segment ring.

use super::*;
use crate::stepper::{EventRing, StepEvent};

/// Announces a segment with one event.
fn announce(segments: &SegmentRing, ring: &mut EventRing, number: u32, is_rest: bool) {
    segments.push(&SegmentInfo {
        steps: Axes::all(number.cast_signed()),
        first_event: number,
        duty: 1020,
        is_standstill: is_rest,
        ..SegmentInfo::default()
    });
    let (mut writer, _) = ring.split();
    let mut events = writer.begin();
    events.push(StepEvent::new(1000, 0, 0).at_boundary());
    events.publish();
}

/// Sets up the next event.
fn set_up(segments: &SegmentRing, ring: &mut EventRing) {
    let (mut writer, mut reader) = ring.split();
    let has_event = if segments.is_running() {
        if let Some(missed) = writer.appended_late(segments) {
            writer.append(missed);
        }
        reader.advance().is_some()
    } else {
        segments.start();
        writer.set_up().is_some()
    };
    assert!(has_event);
}

fn turn(segments: &SegmentRing, ring: &mut EventRing) -> SegmentStart {
    segments.start_segment(ring.split().0.tap())
}

#[test]
fn the_position_is_that_of_the_segment_being_played() {
    let (segments, mut ring) = (SegmentRing::new(), EventRing::new());
    let begun = SegmentStart {
        duty: Some(1020),
        has_more: false,
    };
    let nothing = SegmentStart {
        duty: None,
        has_more: false,
    };
    for number in 0..100 {
        announce(&segments, &mut ring, number, false);
        assert_eq!(turn(&segments, &mut ring), nothing);
        let before = number.cast_signed() - 1;
        assert_eq!(segments.position(), Axes::all(before.max(0)));
        set_up(&segments, &mut ring);
        assert_eq!(turn(&segments, &mut ring), begun);
        assert_eq!(segments.position(), Axes::all(before + 1));
    }
}

#[test]
fn a_late_turn_catches_up_and_finds_the_stop_a_fault_in_motion_only() {
    for is_rest in [true, false] {
        let (segments, mut ring) = (SegmentRing::new(), EventRing::new());
        announce(&segments, &mut ring, 0, false);
        announce(&segments, &mut ring, 1, is_rest);
        set_up(&segments, &mut ring);
        let (_, mut reader) = ring.split();
        while reader.advance().is_some() {}
        segments.stop();
        assert!(turn(&segments, &mut ring).has_more && !segments.has_underrun());
        assert!(!turn(&segments, &mut ring).has_more);
        assert_eq!(segments.has_underrun(), !is_rest);
        assert_eq!(segments.position(), Axes::all(1));
    }
}

#[test]
fn no_segment_is_announced_over_one_that_is_played_or_waits() {
    let (segments, mut ring) = (SegmentRing::new(), EventRing::new());
    let mut announced = 0;
    while segments.has_room() {
        announce(&segments, &mut ring, announced, false);
        announced += 1;
    }
    assert_eq!(announced, SEGMENT_RING as u32 - 1);
    set_up(&segments, &mut ring);
    assert!(turn(&segments, &mut ring).duty.is_some());
    assert!(segments.has_room());
}
