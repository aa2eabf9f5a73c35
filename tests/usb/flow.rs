//! Every byte comes once and in order, whoever is slow, and whenever the host begins anew.

use std::collections::VecDeque;

use leadscrew::model::queues::RECEIVED_RING;
use otg::{Core, Handshake, Host, System};

use crate::{
    Random,
    board::{Board, silicons},
    opened,
};

/// What is on the way in a session between a host and a board.
struct Session {
    seed: u64,
    random: Random,
    core: Core,
    board: Board,
    host: Host,
    /// Taken from the host and not yet read.
    taken: VecDeque<u8>,
    /// Given to the board and not yet fetched.
    given: VecDeque<u8>,
    /// The next byte that the board sends.
    number: u8,
    refusals: u32,
}

impl Session {
    /// Something happens by chance.
    fn act(&mut self) {
        match self.random.below(12) {
            0..5 => self.offer(),
            5 | 6 => {
                let n = self.random.below(80) as usize;
                self.read(n);
            }
            7 => self.give(),
            8 => self.fetch(),
            _ => self.board.period(&mut self.core),
        }
    }

    fn offer(&mut self) {
        // Letters, which are no requests.
        let length = self.random.below(65);
        let packet: Vec<u8> = (0..length)
            .map(|_| b'A' + self.random.below(26) as u8)
            .collect();
        if self.host.offer(&mut self.core, &packet) {
            self.taken.extend(packet);
        } else {
            self.refusals += 1;
        }
    }

    fn read(&mut self, n: usize) {
        for _ in 0..n {
            let Some(byte) = self.board.received.dequeue() else {
                break;
            };
            assert_eq!(self.taken.pop_front(), Some(byte), "seed {}", self.seed);
        }
    }

    fn give(&mut self) {
        let length = self.random.below(200) as u8;
        let bytes: Vec<u8> = (0..length).map(|n| self.number.wrapping_add(n)).collect();
        if self.board.sent.append(&bytes) {
            self.given.extend(bytes);
            self.number = self.number.wrapping_add(length);
        }
    }

    fn fetch(&mut self) {
        for byte in self.host.take(&mut self.core).unwrap_or_default() {
            assert_eq!(self.given.pop_front(), Some(byte), "seed {}", self.seed);
        }
    }

    /// At rest, everything arrives.
    fn settle(&mut self) {
        for _ in 0..60 {
            self.board.period(&mut self.core);
            self.read(usize::MAX);
            self.fetch();
        }
        assert!(
            self.taken.is_empty() && self.given.is_empty(),
            "seed {}",
            self.seed
        );
    }

    /// The host begins anew in the middle: what the core has not given is void, and the line that was begun is ended.
    fn begin_anew(&mut self) {
        let system = System::ALL[self.random.below(3) as usize];
        let Self {
            core, board, host, ..
        } = self;
        let result = host.enumerate(core, system, &mut |core| board.period(core));
        assert_eq!(result, Ok(()), "seed {}", self.seed);
        let mut rest = self.board.lines();
        self.board.periods(&mut self.core, 2);
        rest.extend(self.board.lines());
        let text = rest.strip_suffix(b"\n").unwrap_or(&rest);
        let expected: Vec<u8> = self.taken.iter().copied().take(text.len()).collect();
        assert_eq!(text, expected, "seed {}", self.seed);
        assert!(self.taken.len() - text.len() <= 64, "seed {}", self.seed);
        self.taken.clear();
        self.given.clear();
    }
}

#[test]
fn no_byte_is_lost_doubled_or_of_the_session_before() {
    let kinds = silicons();
    let mut refusals = 0;
    for seed in 1..2000_u64 {
        let silicon = kinds[seed as usize % kinds.len()];
        let (core, board, host) = opened(silicon);
        let mut session = Session {
            seed,
            random: Random(seed),
            core,
            board,
            host,
            taken: VecDeque::new(),
            given: VecDeque::new(),
            number: 0,
            refusals: 0,
        };
        for _ in 0..4 {
            session.board.control_wait = session.random.below(5) as u32;
            for _ in 0..session.random.below(200) {
                session.act();
            }
            if session.random.below(2) == 0 {
                session.settle();
            }
            session.begin_anew();
        }
        refusals += session.refusals;
        assert_eq!(
            session.core.violations(),
            [""; 0],
            "seed {seed} {silicon:?}"
        );
    }
    assert!(refusals > 1000, "{refusals}");
}

#[test]
fn a_driver_that_stands_still_for_2_s_loses_nothing() {
    for silicon in silicons() {
        let (mut core, mut board, mut host) = opened(silicon);
        let mut taken = 0;
        // As while the flash is erased.
        for _ in 0..4000 {
            core.pass(500);
            taken += usize::from(host.offer(&mut core, &[b'G'; 64])) * 64;
        }
        assert_eq!(taken, 64, "{silicon:?}");
        board.period(&mut core);
        assert!(host.offer(&mut core, b"1\n"));
        board.period(&mut core);
        assert_eq!(board.lines(), [&[b'G'; 64][..], b"1\n"].concat());
        assert!(!board.requests.take_link_loss());
    }
}

#[test]
fn a_full_queue_refuses_and_a_request_behind_it_is_found_all_the_same() {
    for silicon in silicons() {
        let (mut core, mut board, mut host) = opened(silicon);
        let mut taken = 0;
        for _ in 0..100 {
            if host.offer(&mut core, &[b'G'; 63]) {
                taken += 63;
            }
            board.period(&mut core);
        }
        // The queue, and what waits for room.
        assert!(
            (RECEIVED_RING - 1..RECEIVED_RING - 1 + 64).contains(&taken),
            "{taken}"
        );
        let lines = board.received.len();
        assert_eq!(lines, RECEIVED_RING - 1);
        // With room for a packet, one is taken whose text has none.
        board.received.consume(taken - lines);
        board.periods(&mut core, 2);
        assert!(board.received.len() == RECEIVED_RING - 1 && !board.requests.take_hold());
        assert!(host.offer(&mut core, b"G1X1!\n?G2"), "{silicon:?}");
        board.period(&mut core);
        assert!(board.requests.take_hold() && board.requests.take_status());
        assert!(!host.offer(&mut core, b"!"));
        // Endpoint 0 answers meanwhile.
        let device = &mut |core: &mut Core| board.period(core);
        assert_eq!(host.set_lines(&mut core, 3, device), Ok(()));
        board.received.consume(RECEIVED_RING - 1);
        board.period(&mut core);
        assert_eq!(board.lines(), b"G1X1\nG2");
        assert_eq!(board.requests.lost(), 0);
    }
}

#[test]
fn text_that_waits_for_room_stays_text() {
    let (mut core, mut board, mut host) = opened(silicons()[0]);
    while board.received.len() < RECEIVED_RING - 1 {
        let n = (RECEIVED_RING - 1 - board.received.len()).min(64);
        host.offer(&mut core, &vec![b'G'; n]);
        board.period(&mut core);
    }
    board.period(&mut core);
    // A character whose second byte alone would be an override, split over two packets.
    assert!(host.offer(&mut core, b"(\xc3"));
    board.periods(&mut core, 2);
    board.received.consume(500);
    board.periods(&mut core, 2);
    assert!(host.offer(&mut core, b"\x89)\x90"));
    board.periods(&mut core, 2);
    let requests = board
        .requests
        .take_overrides()
        .map(Iterator::collect::<Vec<_>>);
    assert_eq!(requests, Some(vec![0x90]));
    assert_eq!(board.lines()[523..], *b"(\xc3\x89)");
}

#[test]
fn a_packet_that_the_host_offers_again_is_taken_once() {
    let (mut core, mut board, mut host) = opened(silicons()[0]);
    for packet in [b"G1X1\n", b"G1X2\n"] {
        assert_eq!(host.offer_unheard(&mut core, packet), Handshake::Ack);
        board.periods(&mut core, 3);
        assert!(host.offer(&mut core, packet));
        board.periods(&mut core, 3);
    }
    assert_eq!(board.lines(), b"G1X1\nG1X2\n");
}

#[test]
fn a_full_packet_is_followed_by_a_shorter_one() {
    for length in [63, 64, 65, 128] {
        let (mut core, mut board, mut host) = opened(silicons()[0]);
        assert!(board.sent.append(&vec![b'x'; length]));
        let mut lengths = Vec::new();
        for _ in 0..10 {
            board.period(&mut core);
            lengths.extend(host.take(&mut core).map(|packet| packet.len()));
        }
        let full = vec![64; length / 64];
        assert_eq!(lengths, [full, vec![length % 64]].concat());
    }
}
