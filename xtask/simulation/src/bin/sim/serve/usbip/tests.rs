//! Hosts at a socket, byte by byte.

use std::{
    io::{Read as _, Write as _},
    net::TcpStream,
    thread,
    time::Duration,
};

use leadscrew::settings::{Settings, assign};
use usbip::MOST_TRANSFERS;

use super::*;

/// A host that has a connection, and after an import the device.
struct Peer {
    stream: TcpStream,
    number: u32,
}

/// What the server says: command, number, status, and what a transfer has read.
type Answer = (u32, u32, i32, Vec<u8>);

const GUARD: Duration = Duration::from_mins(1);
const SUBMITTED: u32 = 3;
const UNLINKED: u32 = 4;
const DATA: u32 = 1;
const NOTIFICATIONS: u32 = 2;
/// As Linux numbers it, and a flag of it.
const STALLED: i32 = -32;
const ZERO_PACKET: u32 = 0x40;
const NO_SETUP: [u8; 8] = [0; 8];
const GET_DEVICE: [u8; 8] = [0x80, 6, 0, 1, 0, 0, 18, 0];
const GET_CONFIGURATION: [u8; 8] = [0x80, 6, 0, 2, 0, 0, 255, 0];
const SET_CONFIGURATION: [u8; 8] = [0, 9, 1, 0, 0, 0, 0, 0];
const OPEN: [u8; 8] = [0x21, 0x22, 1, 0, 0, 0, 0, 0];

impl Peer {
    fn new(address: SocketAddr) -> Self {
        let stream = TcpStream::connect(address).unwrap();
        stream.set_nodelay(true).unwrap();
        // A guard against a test that hangs, no measure.
        stream.set_read_timeout(Some(GUARD)).unwrap();
        Self { stream, number: 0 }
    }

    fn read(&mut self, bytes: usize) -> Vec<u8> {
        let mut read = vec![0; bytes];
        self.stream.read_exact(&mut read).unwrap();
        read
    }

    /// Asks for an operation. Returns the status and what follows.
    fn operate(&mut self, code: u16, name: &[u8], bytes: usize) -> (u32, Vec<u8>) {
        let mut request = vec![0x01, 0x11];
        request.extend(code.to_be_bytes());
        request.extend([0; 4]);
        request.extend(name);
        self.stream.write_all(&request).unwrap();
        let head = self.read(8);
        assert_eq!(head[..4], [0x01, 0x11, 0, code as u8]);
        let status = number(&head, 4);
        let bytes = if status == 0 { bytes } else { 0 };
        (status, self.read(bytes))
    }

    fn import(&mut self, bus: &str) -> (u32, Vec<u8>) {
        let mut name = bus.as_bytes().to_vec();
        name.resize(32, 0);
        self.operate(0x8003, &name, 312)
    }

    fn command(&mut self, words: [u32; 10], setup: [u8; 8], data: &[u8]) -> u32 {
        self.number += 1;
        let mut bytes = words.map(u32::to_be_bytes).concat();
        bytes[4..8].copy_from_slice(&self.number.to_be_bytes());
        bytes.extend(setup);
        bytes.extend(data);
        self.stream.write_all(&bytes).unwrap();
        self.number
    }

    /// Submits a transfer from the device. Returns its number.
    fn ask(&mut self, endpoint: u32, setup: [u8; 8], length: u32, flags: u32) -> u32 {
        let words = [1, 0, 0x1_0002, 1, endpoint, flags, length, 0, u32::MAX, 0];
        self.command(words, setup, &[])
    }

    /// Submits a transfer to the device. Returns its number.
    fn give(&mut self, endpoint: u32, setup: [u8; 8], data: &[u8], flags: u32) -> u32 {
        let length = data.len() as u32;
        let words = [1, 0, 0x1_0002, 0, endpoint, flags, length, 0, 0, 0];
        self.command(words, setup, data)
    }

    fn unlink(&mut self, of: u32) -> u32 {
        self.command([2, 0, 0x1_0002, 0, 0, of, 0, 0, 0, 0], NO_SETUP, &[])
    }

    /// The next answer to a transfer of either direction.
    fn answer(&mut self, is_in: bool) -> Answer {
        let head = self.read(48);
        let length = if is_in { number(&head, 24) } else { 0 };
        let status = number(&head, 20).cast_signed();
        let data = self.read(length as usize);
        (number(&head, 0), number(&head, 4), status, data)
    }

    /// A request that reads. Returns its status, and what it has read.
    fn request(&mut self, setup: [u8; 8]) -> (i32, Vec<u8>) {
        let length = u16::from_le_bytes([setup[6], setup[7]]);
        let asked = self.ask(0, setup, length.into(), 0);
        let (command, answered, status, data) = self.answer(true);
        assert_eq!((command, answered), (SUBMITTED, asked));
        (status, data)
    }

    /// A transfer to the device. Returns its status.
    fn send(&mut self, endpoint: u32, setup: [u8; 8], data: &[u8]) -> i32 {
        let given = self.give(endpoint, setup, data, 0);
        let (command, answered, status, _) = self.answer(false);
        assert_eq!((command, answered), (SUBMITTED, given));
        status
    }

    /// Imports the device, and opens its port.
    fn open(address: SocketAddr) -> Self {
        let mut peer = Self::new(address);
        assert_eq!(peer.import("1-1").0, 0);
        for setup in [SET_CONFIGURATION, OPEN] {
            assert_eq!(peer.send(0, setup, &[]), 0);
        }
        assert_eq!(peer.listen(512), "\r\nGrbl 1.1h ['$' for help]\r\n");
        peer
    }

    /// A transfer of data from the device: what it says.
    fn listen(&mut self, length: u32) -> String {
        self.ask(DATA, NO_SETUP, length, 0);
        let (_, _, status, data) = self.answer(true);
        assert_eq!(status, 0);
        String::from_utf8(data).unwrap()
    }

    /// Sends bytes of which the device makes one transfer.
    fn talk(&mut self, bytes: &[u8]) -> String {
        assert_eq!(self.send(DATA, NO_SETUP, bytes), 0);
        self.listen(4096)
    }

    /// Waits until reports have a state.
    fn wait_for(&mut self, state: &str) {
        let head = format!("<{state}|");
        while !self.talk(b"?").starts_with(&head) {}
    }
}

fn number(bytes: &[u8], at: usize) -> u32 {
    u32::from_be_bytes(bytes[at..at + 4].try_into().unwrap())
}

/// Serves a machine with assignments as long as a host talks.
fn served(assignments: &[&str], host: impl FnOnce(SocketAddr) + Send + 'static) -> Figures {
    let mut settings = Settings::default();
    for assignment in assignments {
        assign(&mut settings, assignment.as_bytes()).unwrap();
    }
    let mut recorder = ();
    let simulator = Box::new(Simulator::new(&settings));
    let server = UsbIp::at("127.0.0.1:0", simulator, None, &mut recorder).unwrap();
    let address = server.address();
    let (stop, stopper) = UnixStream::pair().unwrap();
    let host = thread::spawn(move || {
        let _stopper = stopper;
        host(address);
    });
    let figures = server.serve(&stop).unwrap();
    host.join().unwrap();
    figures
}

#[test]
fn the_list_has_the_device_with_its_descriptors() {
    served(&[], |address| {
        let mut peer = Peer::new(address);
        // Twice: who has asked stays connected.
        for _ in 0..2 {
            let (status, list) = peer.operate(0x8005, &[], 4 + 312 + 2 * 4);
            assert_eq!((status, number(&list, 0)), (0, 1));
            let device = &list[4..];
            assert_eq!(device[256..260], *b"1-1\0");
            assert_eq!([288, 292, 296].map(|at| number(device, at)), [1, 2, 2]);
            assert_eq!(device[300..306], [0x12, 0x09, 0x00, 0x01, 0x00, 0x10]);
            // A composite device by associations; configuration 1 of 1, two interfaces.
            assert_eq!(device[306..312], [0xef, 2, 1, 1, 1, 2]);
            assert_eq!(device[312..], [2, 2, 0, 0, 0x0a, 0, 0, 0]);
        }
    });
}

#[test]
fn one_host_has_the_device_and_others_are_refused() {
    served(&[], |address| {
        let mut first = Peer::new(address);
        assert_eq!(first.import("2-1").0, 4);
        let (status, device) = first.import("1-1");
        assert_eq!((status, &device[300..304]), (0, &[0x12, 0x09, 0, 1][..]));
        let mut second = Peer::new(address);
        assert_eq!(second.import("1-1").0, 2);
        assert_eq!(first.request(GET_DEVICE).0, 0);
        drop(first);
        // As soon as the server has noticed.
        while second.import("1-1").0 != 0 {}
        assert_eq!(second.request(GET_DEVICE).0, 0);
    });
}

#[test]
fn requests_have_data_of_any_length_a_status_or_a_stall() {
    served(&[], |address| {
        let mut peer = Peer::new(address);
        peer.import("1-1");
        let (status, device) = peer.request(GET_DEVICE);
        assert_eq!((status, device.len()), (0, 18));
        assert_eq!(device[8..12], [0x09, 0x12, 1, 0]);
        // Two packets, as much as is asked for, and a full packet.
        let (status, all) = peer.request(GET_CONFIGURATION);
        assert_eq!((status, all.len(), all[2]), (0, 75, 75));
        for length in [9, 64, 75] {
            let mut setup = GET_CONFIGURATION;
            setup[6] = length;
            let (status, part) = peer.request(setup);
            assert_eq!((status, &part[..]), (0, &all[..length.into()]));
        }
        // Another speed, which there is not; then the device goes on.
        let (status, data) = peer.request([0x80, 6, 0, 6, 0, 0, 10, 0]);
        assert_eq!((status, data), (STALLED, Vec::new()));
        assert_eq!(peer.send(0, SET_CONFIGURATION, &[]), 0);
        let coding = [0x00, 0x96, 0, 0, 0, 0, 8];
        assert_eq!(peer.send(0, [0x21, 0x20, 0, 0, 0, 0, 7, 0], &coding), 0);
        let read = peer.request([0xa1, 0x21, 0, 0, 0, 0, 7, 0]);
        assert_eq!(read, (0, coding.to_vec()));
        // More than the device has room for.
        let setup = [0x21, 0x20, 0, 0, 0, 0, 200, 0];
        assert_eq!(peer.send(0, setup, &[0; 200]), STALLED);
        // An address of its own is followed.
        assert_eq!(peer.send(0, [0, 5, 77, 0, 0, 0, 0, 0], &[]), 0);
        assert_eq!(peer.request(GET_DEVICE), (0, device));
    });
}

#[test]
fn an_endpoint_that_is_halted_or_missing_ends_its_transfers() {
    served(&[], |address| {
        let mut peer = Peer::open(address);
        for endpoint in [3, 15, 16] {
            assert_eq!(peer.send(endpoint, NO_SETUP, b"?"), -71);
        }
        let halt = |request, endpoint| [2, request, 0, 0, endpoint, 0, 0, 0];
        // With a packet before, so that the next toggle is not the first one.
        assert!(peer.talk(b"?").starts_with("<Idle"));
        for endpoint in [0x01, 0x81] {
            assert_eq!(peer.send(0, halt(3, endpoint), &[]), 0);
        }
        assert_eq!(peer.send(DATA, NO_SETUP, b"?"), STALLED);
        peer.ask(DATA, NO_SETUP, 64, 0);
        assert_eq!(peer.answer(true).2, STALLED);
        for endpoint in [0x01, 0x81] {
            assert_eq!(peer.send(0, halt(1, endpoint), &[]), 0);
        }
        assert!(peer.talk(b"?").starts_with("<Idle"));
    });
}

#[test]
fn a_transfer_without_data_waits_until_it_is_given_up_and_keeps_nobody_waiting() {
    served(&[], |address| {
        let mut peer = Peer::open(address);
        let notified = peer.ask(NOTIFICATIONS, NO_SETUP, 8, 0);
        let waiting = [
            peer.ask(DATA, NO_SETUP, 64, 0),
            peer.ask(DATA, NO_SETUP, 64, 0),
        ];
        assert_eq!(peer.request(GET_DEVICE).0, 0);
        let unlink = peer.unlink(waiting[0]);
        assert_eq!(peer.answer(false), (UNLINKED, unlink, -104, Vec::new()));
        // The next one has its turn.
        assert_eq!(peer.send(DATA, NO_SETUP, b"\n"), 0);
        assert_eq!(
            peer.answer(true),
            (SUBMITTED, waiting[1], 0, b"ok\r\n".to_vec())
        );
        let unlink = peer.unlink(waiting[1]);
        assert_eq!(peer.answer(false), (UNLINKED, unlink, 0, Vec::new()));
        let unlink = peer.unlink(notified);
        assert_eq!(peer.answer(false), (UNLINKED, unlink, -104, Vec::new()));
    });
}

#[test]
fn a_short_packet_ends_a_transfer_and_a_full_one_does_not() {
    let figures = served(&[], |address| {
        let mut peer = Peer::open(address);
        // Many packets, of which the last is short.
        let all = peer.talk(b"$$\n");
        assert!(all.starts_with("$0=10\r\n") && all.ends_with("ok\r\n") && all.len() > 300);
        // One full packet of 16 answers: an empty one ends it, in this transfer or in the next.
        assert_eq!(peer.talk(&[b'\n'; 16]).len(), 64);
        assert_eq!(peer.send(DATA, NO_SETUP, &[b'\n'; 16]), 0);
        assert_eq!(peer.listen(64).len(), 64);
        assert_eq!(peer.listen(64), "");
        // To the device: several packets, an empty one, and one behind a full packet.
        let comment = [b"(", &[b'x'; 61][..], b")\n"].concat();
        assert_eq!(peer.send(DATA, NO_SETUP, &comment.repeat(3)), 0);
        let mut answers = String::new();
        while answers.len() < 12 {
            answers += &peer.listen(64);
        }
        assert_eq!(answers, "ok\r\n".repeat(3));
        assert_eq!(peer.send(DATA, NO_SETUP, &[]), 0);
        peer.give(DATA, NO_SETUP, &comment, ZERO_PACKET);
        assert_eq!(peer.answer(false).2, 0);
        assert_eq!(peer.listen(64), "ok\r\n");
        // A short packet where that is an error, and one that is too long.
        assert_eq!(peer.send(DATA, NO_SETUP, b"\n"), 0);
        peer.ask(DATA, NO_SETUP, 64, 1);
        assert_eq!(peer.answer(true).2, -121);
        assert_eq!(peer.send(DATA, NO_SETUP, b"\n"), 0);
        peer.ask(DATA, NO_SETUP, 3, 0);
        assert_eq!(peer.answer(true).2, -75);
    });
    assert_eq!((figures.responses.refused(), figures.events), (0, 0));
}

#[test]
fn a_host_that_leaves_has_pulled_the_plug() {
    for (setting, state, x) in [
        ("787=1", "Hold:0", 0..250 * 100),
        ("787=0", "Idle", 25_000..25_001),
    ] {
        let fast = ["110=3000", "120=500", setting];
        let figures = served(&fast, move |address| {
            let mut peer = Peer::open(address);
            assert_eq!(peer.talk(b"G1X100F3000\n"), "ok\r\n");
            peer.wait_for("Run");
            drop(peer);
            let mut peer = Peer::new(address);
            while peer.import("1-1").0 != 0 {}
            // It is enumerated again, and nothing of the session before is left.
            assert_eq!(peer.send(DATA, NO_SETUP, b"?"), -71);
            for setup in [SET_CONFIGURATION, OPEN] {
                assert_eq!(peer.send(0, setup, &[]), 0);
            }
            assert_eq!(peer.listen(512), "\r\nGrbl 1.1h ['$' for help]\r\n");
            peer.wait_for(state);
        });
        assert!(
            x.contains(&figures.end.steps[0]),
            "{setting}: {:?}",
            figures.end
        );
        assert_eq!(
            figures.steps_axis[0],
            u64::from(figures.end.steps[0].unsigned_abs())
        );
    }
}

#[test]
fn who_speaks_something_else_is_disconnected_and_the_others_stay() {
    served(&[], |address| {
        let is_closed =
            |peer: &mut Peer| peer.stream.read(&mut [0]).is_ok_and(|length| length == 0);
        for words in [
            *b"GET / HTTP",
            *b"\x01\x06\x80\x05\0\0\0\0\0\0",
            *b"\x01\x11\x80\x07\0\0\0\0\0\0",
        ] {
            let mut peer = Peer::new(address);
            peer.stream.write_all(&words).unwrap();
            assert!(is_closed(&mut peer), "{words:?}");
        }
        // An isochronous transfer, one that is too long, and no command.
        let head = [1, 0, 0, 1, 1, 0, 64, 0, 0, 0];
        for (at, value) in [(8, 1), (6, 1 << 21), (0, 5)] {
            let mut peer = Peer::new(address);
            while peer.import("1-1").0 != 0 {}
            let mut words = head;
            words[at] = value;
            peer.command(words, NO_SETUP, &[]);
            assert!(is_closed(&mut peer), "{words:?}");
        }
        let mut peer = Peer::open(address);
        for _ in 0..=MOST_TRANSFERS {
            peer.ask(NOTIFICATIONS, NO_SETUP, 8, 0);
        }
        assert!(is_closed(&mut peer));
        assert!(Peer::open(address).talk(b"?").starts_with("<Idle"));
    });
}

#[test]
fn what_a_host_has_fetched_and_the_steps_are_recorded() {
    let figures = served(&[], |address| {
        let mut peer = Peer::open(address);
        assert_eq!(peer.talk(b"G1X0.1F500\n"), "ok\r\n");
        assert_eq!(peer.talk(b"G999\n"), "error:20\r\n");
        peer.wait_for("Idle");
    });
    assert_eq!((figures.lines, figures.responses.refused()), (2, 1));
    assert_eq!((figures.steps_axis[0], figures.end.mpos_mm[0]), (25, 0.1));
}
