//! Received bytes: what each asks for, and whom it releases.

use leadscrew::{
    model::{Awaited, Override, Release, Requests},
    protocol::{Bytes, Incoming, Utf8RequestWatch, realtime::receive},
};
use proptest::prelude::*;

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

    /// Receives bytes, and has `idle` scan them, silence of so many ms before. Returns whether it has made a request.
    fn scan(&mut self, bytes: &[u8], silence_ms: u8, forms: &mut Utf8RequestWatch) -> bool {
        for byte in bytes {
            self.receive(*byte);
        }
        let received = self.received.split().0.count();
        forms
            .scan(silence_ms, received, &self.requests)
            .has_requests
    }
}

/// Whether something has been asked for since the last call.
fn has_asked(requests: &Requests, asked: &mut u32) -> bool {
    let _ = requests.take_overrides();
    std::mem::replace(asked, requests.count()) != requests.count()
}

#[test]
fn every_byte_is_a_request_or_part_of_a_line() {
    for byte in 0..=u8::MAX {
        let mut line = Line::new(Awaited::ALL);
        let (asked, reset_count) = (line.requests.count(), line.requests.reset_count());
        let release = line.receive(byte);
        let requests = &line.requests;
        let commands: Vec<u8> = requests.take_overrides().into_iter().flatten().collect();
        assert_eq!(
            commands.first().and_then(|byte| Override::from_byte(*byte)),
            Override::from_byte(byte),
            "{byte:#x}"
        );
        assert_eq!(requests.take_status(), byte == b'?', "{byte:#x}");
        assert_eq!(requests.take_hold(), byte == b'!', "{byte:#x}");
        assert_eq!(requests.take_start(), byte == b'~', "{byte:#x}");
        assert_eq!(requests.take_door(), byte == 0x84, "{byte:#x}");
        assert_eq!(requests.take_jog_cancel(), byte == 0x85, "{byte:#x}");
        let has_reset = requests.reset_count() != reset_count;
        assert_eq!(has_reset, byte == 0x18, "{byte:#x}");
        assert_eq!(commands.contains(&0xa3), byte == 0xa3, "{byte:#x}");
        // Those that mean nothing release `prepare` for nothing.
        let is_command = matches!(byte, b'!' | b'~' | 0x18 | 0x80..=0xa3);
        assert_eq!(requests.count() != asked, is_command, "{byte:#x}");
        assert_eq!(release == Release::Prepare, is_command, "{byte:#x}");
        assert_eq!(release == Release::Report, byte == b'?', "{byte:#x}");
        let is_line = !is_command && byte != b'?';
        assert_eq!(line.take(), is_line.then_some(byte), "{byte:#x}");
    }
}

#[test]
fn no_character_is_a_request_and_a_byte_behind_it_is() {
    let mut line = Line::new(Awaited::NONE);
    let (mut asked, mut forms) = (line.requests.count(), Utf8RequestWatch::new());
    for character in '\u{a0}'..=char::MAX {
        let text = std::format!("({character}");
        assert!(!line.scan(text.as_bytes(), 0, &mut forms), "{character}");
        assert!(!has_asked(&line.requests, &mut asked), "{character}");
        for byte in text.bytes() {
            assert_eq!(line.take(), Some(byte), "{character}");
        }
        line.receive(0x90);
        assert!(has_asked(&line.requests, &mut asked), "{character}");
    }
    assert_eq!(line.requests.lost(), 0);
}

#[test]
fn a_character_that_is_broken_off_makes_no_text_of_the_bytes_behind_it() {
    for text in [
        &b"\xe3\x81G"[..],
        b"\xe3G",
        b"\xf0\x9f\n",
        b"\xc3\xa4\xb5\xb5\xb5\xb5",
        b"\xb5",
        b"\xff\x80\x80\x80\x80\x80\x80\x80G",
    ] {
        let mut line = Line::new(Awaited::NONE);
        for byte in text {
            line.receive(*byte);
        }
        assert!(!line.requests.take_door(), "{text:x?}");
        line.receive(0x84);
        assert!(line.requests.take_door(), "{text:x?}");
        assert!(
            text.iter().all(|byte| line.take() == Some(*byte)),
            "{text:x?}"
        );
    }
}

#[test]
fn text_that_finds_the_queue_full_is_lost_and_no_request() {
    let mut line = Line::new(Awaited::NONE);
    for _ in 0..1023 {
        line.receive(b'A');
    }
    let (mut asked, mut losses) = (line.requests.count(), 0);
    for byte in "\u{3084}\u{2014}\u{e4}\u{84}\u{1f600}".bytes() {
        line.receive(byte);
        losses += 1;
        assert_eq!(line.requests.lost(), losses);
        assert!(!has_asked(&line.requests, &mut asked));
    }
    line.receive(0x84);
    assert!(line.requests.take_door());
}

#[test]
fn realtime_bytes_in_utf_8_are_requests_where_no_text_can_be() {
    /// What comes before, how long the line is silent then, and which of U+0080 to U+00BF are requests.
    const CASES: [(&[u8], u8, std::ops::RangeInclusive<u8>); 6] = [
        (b"", 0, 0x80..=0xa3),
        (b"G1 X1\n", 0, 0x80..=0xa3),
        (b"\xc2\x90", 0, 0x80..=0x9f),
        (b"(a", 0, 0x80..=0x9f),
        (b"G1 X", 100, 0x80..=0xa3),
        (b"G1 X", 99, 0x80..=0x9f),
    ];
    for (before, silence_ms, requests) in CASES {
        for byte in 0x80..=0xbf {
            let mut line = Line::new(Awaited::NONE);
            let (mut asked, mut forms) = (line.requests.count(), Utf8RequestWatch::new());
            line.scan(before, 0, &mut forms);
            has_asked(&line.requests, &mut asked);
            assert!(!line.scan(&[], silence_ms, &mut forms));
            // The look may also come between the two.
            let is_utf8_request =
                line.scan(&[0xc2], 0, &mut forms) | line.scan(&[byte], 0, &mut forms);
            assert_eq!(
                is_utf8_request,
                requests.contains(&byte),
                "{before:x?} {byte:x}"
            );
            assert_eq!(
                has_asked(&line.requests, &mut asked),
                is_utf8_request,
                "{byte:x}"
            );
        }
    }
}

#[test]
fn of_realtime_bytes_in_utf_8_each_is_a_request_once() {
    let mut line = Line::new(Awaited::NONE);
    let mut forms = Utf8RequestWatch::new();
    line.scan("\u{91}\u{91}\u{84}\u{92}".as_bytes(), 0, &mut forms);
    let mut taken = Vec::new();
    for _ in 0..4 {
        taken.extend(line.requests.take_overrides().into_iter().flatten());
        line.scan(&[], 0, &mut forms);
    }
    assert_eq!(taken, [0x91, 0x91, 0x92]);
    assert!(line.requests.take_door() && !line.requests.take_door());
}

#[test]
fn text_releases_the_interpreter_in_time() {
    let mut line = Line::new(Awaited::LINE);
    let mut forms = Utf8RequestWatch::new();
    line.receive(b'(');
    for byte in "\u{3042}".repeat(300).bytes() {
        assert_eq!(line.receive(byte), Release::Nobody);
    }
    let received = line.received.split().0.count();
    let seen = forms.scan(0, received, &line.requests);
    assert!(seen.has_text && !seen.has_requests);
    assert!(line.received.split().1.may_have_line());
}

#[test]
fn of_more_overrides_than_there_is_room_for_the_newest_count() {
    let mut line = Line::new(Awaited::NONE);
    for byte in (0x90..0xa0).chain(0x90..0x98) {
        line.receive(byte);
    }
    let taken: Vec<u8> = line
        .requests
        .take_overrides()
        .into_iter()
        .flatten()
        .collect();
    assert_eq!(taken, (0x98..0xa0).chain(0x90..0x98).collect::<Vec<_>>());
    assert!(line.requests.take_overrides().is_none());
}

proptest! {
    #![proptest_config(crate::cases(256))]

    #[test]
    fn bytes_are_sorted_as_utf_8_says(bytes in prop::collection::vec(any::<u8>(), 0..300)) {
        let mut line = Line::new(Awaited::NONE);
        // How many bytes of a character may follow.
        let mut missing = 0;
        for byte in bytes {
            let is_next = missing != 0 && matches!(byte, 0x80..=0xbf);
            missing = match byte {
                _ if is_next => missing - 1,
                0xc0..=0xdf => 1,
                0xe0..=0xef => 2,
                0xf0..=0xf7 => 3,
                // No character begins with these: nothing is known of what follows.
                0xf8.. => return Ok(()),
                b'?' | b'!' | b'~' | 0x18 => missing,
                _ => 0,
            };
            let is_request = matches!(byte, b'?' | b'!' | b'~' | 0x18 | 0x80..=0xa3) && !is_next;
            line.receive(byte);
            prop_assert_eq!(line.take(), (!is_request).then_some(byte));
        }
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
fn a_second_receiver_continues_where_the_first_has_ended_also_within_a_character() {
    let mut incoming = Incoming::new();
    let (requests, mut first, mut reader) = incoming.split();
    let mut second = first.second();
    for (place, byte) in "a\u{3084}b".bytes().enumerate() {
        let reception = if place % 2 == 0 {
            &mut first
        } else {
            &mut second
        };
        let (requests, mut received) = reception.parts();
        receive(Ok(byte), received.enqueued(), requests, &mut received);
    }
    assert!(!requests.take_door());
    assert!(
        "a\u{3084}b"
            .bytes()
            .all(|byte| reader.dequeue() == Some(byte))
    );
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
