//! Received bytes: what each asks for, and whom it releases.

use leadscrew::{
    model::{Awaited, Override, Release, Requests},
    protocol::{Bytes, realtime::receive},
};

/// What waits for bytes, and what they have asked for.
struct Line {
    requests: Requests,
    received: Bytes<1024>,
}

impl Line {
    fn new(awaited: Awaited) -> Self {
        let requests = Requests::new();
        requests.wake_on(awaited);
        Self {
            requests,
            received: Bytes::new(),
        }
    }

    fn receive(&mut self, byte: u8) -> Release {
        let (mut received, _) = self.received.split();
        receive(Ok(byte), received.enqueued(), &self.requests, &mut received)
    }

    fn take(&mut self) -> Option<u8> {
        self.received.split().1.dequeue()
    }
}

#[test]
fn every_byte_is_a_request_or_part_of_a_line_or_dropped() {
    for byte in 0..=u8::MAX {
        let mut line = Line::new(Awaited::ALL);
        let (asked, reset_count) = (line.requests.count(), line.requests.reset_count());
        let release = line.receive(byte);
        let requests = &line.requests;
        let command = requests.take_override();
        assert_eq!(
            command.and_then(Override::from_byte),
            Override::from_byte(byte),
            "{byte:#x}"
        );
        assert_eq!(requests.take_status(), byte == b'?', "{byte:#x}");
        assert_eq!(requests.take_hold(), byte == b'!', "{byte:#x}");
        assert_eq!(requests.take_start(), byte == b'~', "{byte:#x}");
        assert_eq!(requests.take_door(), byte == 0x84, "{byte:#x}");
        assert_eq!(requests.take_jog_cancel(), byte == 0x85, "{byte:#x}");
        assert_eq!(
            requests.reset_count() != reset_count,
            byte == 0x18,
            "{byte:#x}"
        );
        assert_eq!(
            requests.take_tool_change().is_some(),
            byte == 0xa3,
            "{byte:#x}"
        );
        let is_command =
            matches!(byte, b'!' | b'~' | 0x18 | 0x84 | 0x85 | 0xa3) || command.is_some();
        assert_eq!(requests.count() != asked, is_command, "{byte:#x}");
        assert_eq!(release == Release::Prepare, is_command, "{byte:#x}");
        assert_eq!(release == Release::Report, byte == b'?', "{byte:#x}");
        let is_line = byte.is_ascii() && !is_command && byte != b'?';
        assert_eq!(line.take(), is_line.then_some(byte), "{byte:#x}");
    }
}

#[test]
fn the_end_of_a_line_releases_the_interpreter_if_it_waits_for_one() {
    for end in [b'\n', b'\r'] {
        let mut line = Line::new(Awaited::LINE);
        assert_eq!(line.receive(b'G'), Release::Nobody);
        assert_eq!(line.receive(end), Release::Interpret);
        let mut line = Line::new(Awaited::ENTRIES);
        assert_eq!(line.receive(end), Release::Nobody);
    }
}

#[test]
fn a_line_without_an_end_does_not_fill_the_queue_before_a_release() {
    let mut line = Line::new(Awaited::LINE);
    let mut unreleased = 0;
    for _ in 0..10_000 {
        unreleased += 1;
        if line.receive(b'0') == Release::Interpret {
            assert!(unreleased <= 256);
            unreleased = 0;
            while line.take().is_some() {}
        }
    }
    assert_eq!(line.requests.lost(), 0);
}

#[test]
fn bytes_that_find_the_queue_full_are_counted_and_those_before_them_stay() {
    let mut line = Line::new(Awaited::NONE);
    for byte in (b'A'..=b'Z').cycle().take(1023) {
        line.receive(byte);
    }
    assert_eq!(line.requests.lost(), 0);
    line.receive(b'#');
    line.receive(b'\n');
    assert_eq!(line.requests.lost(), 2);
    assert_eq!(line.receive(b'!'), Release::Prepare);
    assert!(line.requests.take_hold());
    for byte in (b'A'..=b'Z').cycle().take(1023) {
        assert_eq!(line.take(), Some(byte));
    }
    assert_eq!(line.take(), None);
}

#[test]
fn a_second_writer_continues_where_the_first_has_ended() {
    let mut ring = Bytes::<8>::new();
    let (mut writer, mut reader) = ring.split();
    let mut second = writer.second_writer();
    assert_eq!(writer.enqueue(1), Ok(1));
    assert_eq!(second.enqueue(2), Ok(2));
    assert_eq!(writer.enqueue(3), Ok(3));
    assert_eq!([1, 2, 3].map(Some), [(); 3].map(|()| reader.dequeue()));
}

#[test]
fn a_wait_for_several_entries_ends_with_four_or_some_time_after_one() {
    let requests = Requests::new();
    let wait = || {
        requests.begin_batch();
        requests.wake_on(Awaited::ENTRIES_BATCHED);
    };
    wait();
    let mut takes = (1..).map(|_| requests.awaits(Awaited::ENTRIES));
    assert_eq!(takes.position(|is_released| is_released), Some(3));
    wait();
    assert!((0..1000).all(|_| !requests.awaits(Awaited::SEGMENTS)));
    assert!(!requests.awaits(Awaited::ENTRIES));
    assert!((1..48).all(|_| !requests.awaits(Awaited::SEGMENTS)));
    // Whoever reports meanwhile changes nothing.
    requests.wake_on(Awaited::ALL);
    requests.wake_on(Awaited::ENTRIES_BATCHED);
    assert!(!requests.awaits(Awaited::ROOM));
    assert!(requests.awaits(Awaited::SEGMENTS));
}
