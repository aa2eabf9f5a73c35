//! Tests of the segment ring.

use super::*;
use crate::stepper::{EventRing, StepEvent};

/// Pushes a segment with one event.
fn push(segments: &SegmentRing, ring: &mut EventRing, number: u32, is_standstill: bool) {
    segments.push(&SegmentInfo {
        steps: Axes::all(number.cast_signed()),
        first_event: number,
        duty: 1020,
        is_standstill,
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
        if let Some(late) = writer.appended_late(segments) {
            writer.append(late);
        }
        reader.advance().is_some()
    } else {
        segments.start();
        writer.set_up().is_some()
    };
    assert!(has_event);
}

fn start_segment(segments: &SegmentRing, ring: &mut EventRing) -> SegmentStart {
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
        push(&segments, &mut ring, number, false);
        assert_eq!(start_segment(&segments, &mut ring), nothing);
        let before = number.cast_signed() - 1;
        assert_eq!(segments.position(), Axes::all(before.max(0)));
        set_up(&segments, &mut ring);
        assert_eq!(start_segment(&segments, &mut ring), begun);
        assert_eq!(segments.position(), Axes::all(before + 1));
    }
}

#[test]
fn a_late_segment_start_catches_up_and_takes_the_stop_for_an_underrun_in_motion_only() {
    for is_standstill in [true, false] {
        let (segments, mut ring) = (SegmentRing::new(), EventRing::new());
        push(&segments, &mut ring, 0, false);
        push(&segments, &mut ring, 1, is_standstill);
        set_up(&segments, &mut ring);
        let (_, mut reader) = ring.split();
        while reader.advance().is_some() {}
        segments.stop();
        assert!(start_segment(&segments, &mut ring).has_more && !segments.has_underrun());
        assert!(!start_segment(&segments, &mut ring).has_more);
        assert_eq!(segments.has_underrun(), !is_standstill);
        assert_eq!(segments.position(), Axes::all(1));
    }
}

#[test]
fn no_segment_is_pushed_over_one_that_is_played_or_waits() {
    let (segments, mut ring) = (SegmentRing::new(), EventRing::new());
    let mut pushed = 0;
    while segments.has_room() {
        push(&segments, &mut ring, pushed, false);
        pushed += 1;
    }
    assert_eq!(pushed, SEGMENT_RING as u32 - 1);
    set_up(&segments, &mut ring);
    assert!(start_segment(&segments, &mut ring).duty.is_some());
    assert!(segments.has_room());
}

#[test]
fn the_next_segment_is_due_when_so_much_of_the_played_one_has_been_played() {
    let (segments, mut ring) = (SegmentRing::new(), EventRing::new());
    push(&segments, &mut ring, 0, false);
    segments.set_next_due(1_000);
    assert!(!segments.is_next_due(5_000), "nothing is played");
    set_up(&segments, &mut ring);
    assert!(start_segment(&segments, &mut ring).duty.is_some());
    let began = u32::MAX - 500;
    segments.set_begin(began);
    for (after, elapsed) in [
        (0, 0),
        (999, 999),
        (1_000, 1_000),
        (u32::MAX / 4, SPARSE_SEGMENT_TICKS),
    ] {
        let now = began.wrapping_add(after);
        assert_eq!(segments.elapsed_ticks(now), elapsed);
        assert_eq!(segments.is_next_due(now), elapsed > 1_000);
    }
    assert_eq!(
        segments.elapsed_ticks(began - 1),
        0,
        "it began after the clock was read"
    );
    segments.stop();
    assert_eq!(segments.elapsed_ticks(began.wrapping_add(2_000)), 0);
    assert!(!segments.is_next_due(began.wrapping_add(2_000)));
}
