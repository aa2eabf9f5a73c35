//! Tests of the event ring.

use super::*;

fn push(writer: &mut EventWriter<'_>, event: StepEvent) {
    assert!(writer.push(event));
}

/// The event of a number; none is like its neighbours.
fn numbered(number: u32) -> StepEvent {
    StepEvent::new(1 + number % 1000, number, 0)
}

/// An event, and another or none.
fn upcoming(event: u32, following: u32) -> Upcoming {
    Upcoming {
        event: numbered(event),
        following: if following == 0 {
            StepEvent::NONE
        } else {
            numbered(following)
        },
    }
}

fn start(writer: &mut EventWriter<'_>, segments: &SegmentRing) -> Option<Upcoming> {
    let upcoming = writer.set_up()?;
    segments.start();
    Some(upcoming)
}

#[test]
fn events_come_out_in_order_over_many_rounds_of_the_ring() {
    let mut ring = EventRing::new();
    let segments = SegmentRing::new();
    let (mut writer, mut reader) = ring.split();
    let (mut written, mut set_up) = (0, 0);
    let mut next = None;
    for batch in (0..5000_u32).map(|k| k * 7 % (EVENT_RING as u32 + 1)) {
        for _ in 0..batch.min(writer.room()) {
            push(&mut writer, numbered(written));
            written += 1;
        }
        if next.is_none() {
            segments.stop();
            next = start(&mut writer, &segments);
        }
        if let Some(late) = writer.appended_late(&segments) {
            writer.append(late);
        }
        for _ in 0..(batch * 5 % EVENT_RING as u32) {
            let Some(Upcoming {
                event,
                following: then,
            }) = next
            else {
                break;
            };
            assert_eq!(event, numbered(set_up));
            assert!(then == StepEvent::NONE || then == numbered(set_up + 1));
            set_up += 1;
            next = reader.advance();
            assert_eq!(writer.tap().output_count(), set_up);
        }
        assert_eq!(writer.room(), EVENT_RING as u32 - (written - set_up));
    }
    assert!(set_up > 100_000);
}

#[test]
fn a_full_ring_has_no_room_and_an_empty_one_no_event() {
    let mut ring = EventRing::new();
    let segments = SegmentRing::new();
    let (mut writer, _) = ring.split();
    assert!(!writer.has_pending());
    assert_eq!(start(&mut writer, &segments), None);
    assert!(!segments.is_running());
    for number in 0..EVENT_RING as u32 {
        push(&mut writer, numbered(number));
    }
    assert!(writer.has_pending());
    assert_eq!(writer.room(), 0);
}

#[test]
fn a_word_of_an_earlier_round_is_not_taken_for_an_event() {
    let mut ring = EventRing::new();
    let segments = SegmentRing::new();
    let (mut writer, mut reader) = ring.split();
    for number in 0..3 * WORDS as u32 {
        push(&mut writer, numbered(number));
        assert_eq!(start(&mut writer, &segments), Some(upcoming(number, 0)));
        assert_eq!(reader.advance(), None);
        segments.stop();
    }
}

#[test]
fn an_event_behind_the_last_is_not_played_before_the_timer_is_appended_its_time() {
    for is_appended in [false, true] {
        let mut ring = EventRing::new();
        let segments = SegmentRing::new();
        let (mut writer, mut reader) = ring.split();
        push(&mut writer, numbered(0));
        assert_eq!(start(&mut writer, &segments), Some(upcoming(0, 0)));
        assert_eq!(writer.appended_late(&segments), None);
        push(&mut writer, numbered(1));
        push(&mut writer, numbered(2));
        let late = writer.appended_late(&segments);
        assert_eq!(late, Some(numbered(1)));
        if is_appended {
            writer.append(late.unwrap());
            assert_eq!(writer.appended_late(&segments), None);
        }
        let expected = is_appended.then_some(upcoming(1, 2));
        assert_eq!(reader.advance(), expected);
        assert_eq!(writer.tap().output_count(), 1);
        assert!(writer.has_pending());
    }
}

#[test]
fn what_is_appended_after_the_stop_is_of_no_effect() {
    let mut ring = EventRing::new();
    let segments = SegmentRing::new();
    let (mut writer, mut reader) = ring.split();
    push(&mut writer, numbered(0));
    assert!(start(&mut writer, &segments).is_some());
    push(&mut writer, numbered(1));
    let late = writer.appended_late(&segments).unwrap();
    // The step interrupt comes in between.
    assert_eq!(reader.advance(), None);
    segments.stop();
    writer.append(late);
    assert_eq!(start(&mut writer, &segments), Some(upcoming(1, 0)));
    assert_eq!(reader.advance(), None);
    assert_eq!(writer.tap().output_count(), 2);
}

#[test]
fn a_halt_leaves_exactly_what_has_been_output() {
    for played in 0..4 {
        let mut ring = EventRing::new();
        let segments = SegmentRing::new();
        let (mut writer, mut reader) = ring.split();
        for number in 0..6 {
            push(&mut writer, numbered(number));
        }
        let tap = writer.tap();
        assert!(start(&mut writer, &segments).is_some());
        for _ in 0..played {
            assert!(reader.advance().is_some());
        }
        tap.halt(&segments);
        assert_eq!((tap.output_count(), segments.is_running()), (played, false));
        assert_eq!(writer.discard_pending(), played);
        assert!(!writer.has_pending());
    }
}

#[test]
fn an_event_for_which_there_is_no_room_is_not_pushed() {
    let mut ring = EventRing::new();
    let (mut writer, mut reader) = ring.split();
    for number in 0..EVENT_RING as u32 {
        assert!(writer.push(numbered(number)));
    }
    assert!(!writer.push(numbered(1)));
    assert_eq!(writer.set_up(), Some(upcoming(0, 1)));
    assert_eq!(reader.advance(), Some(upcoming(1, 2)));
    assert!(writer.push(numbered(1)));
    assert!(!writer.push(numbered(1)));
}
