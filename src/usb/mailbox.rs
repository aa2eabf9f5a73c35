//! What `usb` and `usb_control` tell each other about endpoint 0.
//!
//! `usb` posts events, each with a number; `usb_control` answers each. `usb` interrupts the other task, and may post
//! another event at any time: then the answer to the event before counts no more.
//!
//! # Cost
//! Plain loads and stores, as of the queues of bytes: one core needs the compiler's order only.

use crate::atomic::{
    AtomicU32,
    Ordering::{Relaxed, SeqCst},
    compiler_fence,
};

use super::{PACKET_BYTES, PACKET_WORDS};

/// Something that has happened on endpoint 0.
#[derive(Debug, Clone, Copy, PartialEq, Eq)]
pub(super) enum ControlEvent {
    /// The host has reset the bus.
    Reset,
    /// A SETUP packet has come: [`Mailbox::received`] has its eight bytes.
    Setup,
    /// A packet of so many bytes has come: [`Mailbox::received`] has it.
    Out(usize),
    /// The host has fetched the packet of the last answer.
    In,
}

impl ControlEvent {
    /// Returns the event of its code.
    const fn from_code(code: u32) -> Option<Self> {
        match code & 0x1ff {
            1 => Some(Self::Reset),
            2 => Some(Self::Setup),
            3 => Some(Self::In),
            out if out & OUT != 0 => Some(Self::Out((out & 0xff) as usize)),
            _ => None,
        }
    }

    const fn code(self) -> u32 {
        match self {
            Self::Reset => 1,
            Self::Setup => 2,
            Self::In => 3,
            Self::Out(bytes) => OUT | bytes as u32,
        }
    }
}

/// The bit of an event that is [`ControlEvent::Out`].
const OUT: u32 = 1 << 8;
/// The first bit of the number of an event.
const NUMBER: u32 = 9;

/// The answer to an event, as bits of a word.
#[derive(Debug, Clone, Copy, Default, PartialEq, Eq)]
pub(super) struct Answer(pub(super) u32);

impl Answer {
    /// A packet is to be sent, of so many bytes as the lowest seven bits say.
    const HAS_PACKET: u32 = 1 << 7;
    /// Endpoint 0 refuses the request.
    pub(super) const STALLS: u32 = 1 << 8;
    /// The endpoints begin anew, as the host has chosen a configuration.
    pub(super) const CONFIGURES: u32 = 1 << 9;
    /// There is a configuration, and the endpoints of the data work.
    pub(super) const IS_CONFIGURED: u32 = 1 << 10;
    /// The host's program has opened the port (DTR).
    pub(super) const IS_OPEN: u32 = 1 << 11;
    /// The first of the bits that say which endpoints are halted: of [`halt_bit`].
    pub(super) const HALTED: u32 = 12;
    /// The first of the bits that say which endpoints have been halted, or are no longer.
    pub(super) const HALT_CHANGED: u32 = 15;
    /// The first bit of the address.
    const ADDRESS_SHIFT: u32 = 24;
    /// Bits that stay from an answer to the next.
    const STANDING: u32 = 0x7f << Self::ADDRESS_SHIFT
        | Self::IS_CONFIGURED
        | Self::IS_OPEN
        | HALT_BITS << Self::HALTED;

    pub(super) const fn has(self, bit: u32) -> bool {
        self.0 & bit != 0
    }

    /// Returns the number of bytes of the packet to be sent, if there is one.
    pub(super) const fn packet(self) -> Option<usize> {
        if self.has(Self::HAS_PACKET) {
            Some((self.0 & 0x7f) as usize)
        } else {
            None
        }
    }

    pub(super) const fn with_packet(self, bytes: usize) -> Self {
        Self(self.0 & !0x7f | Self::HAS_PACKET | bytes as u32 & 0x7f)
    }

    /// Returns the address of the device.
    pub(super) const fn address(self) -> u32 {
        self.0 >> Self::ADDRESS_SHIFT & 0x7f
    }

    pub(super) const fn with_address(self, address: u8) -> Self {
        let others = self.0 & !(0x7f << Self::ADDRESS_SHIFT);
        Self(others | (address as u32 & 0x7f) << Self::ADDRESS_SHIFT)
    }

    pub(super) const fn with(self, bit: u32, is_set: bool) -> Self {
        if is_set {
            Self(self.0 | bit)
        } else {
            Self(self.0 & !bit)
        }
    }
}

/// Bits of the endpoints that may be halted.
const HALT_BITS: u32 = 7;

/// Returns the bit of an endpoint that may be halted.
pub(super) const fn halt_bit(endpoint: u8, is_in: bool) -> u32 {
    match (endpoint, is_in) {
        (super::DATA_ENDPOINT, false) => 1,
        (super::DATA_ENDPOINT, true) => 2,
        (super::NOTIFICATION_ENDPOINT, true) => 4,
        _ => 0,
    }
}

/// Events, answers, and their packets.
#[derive(Debug)]
pub struct Mailbox {
    /// The event with its number.
    event: AtomicU32,
    received: [AtomicU32; PACKET_WORDS],
    /// The event that has been answered last, with its number.
    answered: AtomicU32,
    answer: AtomicU32,
    to_send: [AtomicU32; PACKET_WORDS],
}

impl Mailbox {
    /// Returns an empty mailbox.
    #[must_use]
    pub const fn new() -> Self {
        Self {
            event: AtomicU32::new(0),
            received: [const { AtomicU32::new(0) }; PACKET_WORDS],
            answered: AtomicU32::new(0),
            answer: AtomicU32::new(0),
            to_send: [const { AtomicU32::new(0) }; PACKET_WORDS],
        }
    }

    /// Stores a word of a packet of the host; for `usb` alone.
    pub(super) fn put(&self, index: usize, word: u32) {
        if let Some(slot) = self.received.get(index) {
            slot.store(word, Relaxed);
        }
    }

    /// Posts an event; for `usb` alone.
    pub(super) fn post(&self, event: ControlEvent) {
        let number = (self.event.load(Relaxed) >> NUMBER).wrapping_add(1);
        compiler_fence(SeqCst);
        self.event.store(number << NUMBER | event.code(), Relaxed);
    }

    /// Returns the answer to the newest event, once there is one; for `usb` alone.
    pub(super) fn answer(&self) -> Option<Answer> {
        let is_answered = self.answered.load(Relaxed) == self.event.load(Relaxed);
        compiler_fence(SeqCst);
        is_answered.then(|| Answer(self.answer.load(Relaxed)))
    }

    /// Returns the words of the packet of the answer; for `usb` alone.
    pub(super) fn to_send(&self) -> impl Iterator<Item = u32> {
        self.to_send.iter().map(|word| word.load(Relaxed))
    }

    /// Begins an answer, if the newest event has none. Returns the event, the code by which the answer is given, and the
    /// packet that has come with the event; for `usb_control` alone, as are all below.
    pub(super) fn begin(&self) -> Option<(ControlEvent, u32, [u32; PACKET_WORDS])> {
        // Each further try is for an event that has come meanwhile: the host sends few in a row.
        for _ in 0..4 {
            let code = self.event.load(Relaxed);
            if code == self.answered.load(Relaxed) {
                return None;
            }
            compiler_fence(SeqCst);
            let mut packet = [0; PACKET_WORDS];
            for (word, slot) in packet.iter_mut().zip(&self.received) {
                *word = slot.load(Relaxed);
            }
            compiler_fence(SeqCst);
            if code == self.event.load(Relaxed) {
                self.change(|last| Answer(last.0 & Answer::STANDING));
                return ControlEvent::from_code(code).map(|event| (event, code, packet));
            }
        }
        None
    }

    /// Returns the answer that has been begun.
    pub(super) fn begun(&self) -> Answer {
        Answer(self.answer.load(Relaxed))
    }

    /// Changes the answer that has been begun.
    pub(super) fn change(&self, change: impl FnOnce(Answer) -> Answer) {
        self.answer.store(change(self.begun()).0, Relaxed);
    }

    /// Puts the packet of the answer. Returns false where it is too long.
    pub(super) fn write(&self, packet: &[u8]) -> bool {
        if packet.len() > PACKET_BYTES {
            return false;
        }
        for (bytes, slot) in packet.chunks(4).zip(&self.to_send) {
            let mut word = [0; 4];
            for (to, byte) in word.iter_mut().zip(bytes) {
                *to = *byte;
            }
            slot.store(u32::from_le_bytes(word), Relaxed);
        }
        self.change(|answer| answer.with_packet(packet.len()));
        true
    }

    /// Gives the answer to the event of a code.
    pub(super) fn finish(&self, code: u32) {
        compiler_fence(SeqCst);
        self.answered.store(code, Relaxed);
    }
}

impl Default for Mailbox {
    fn default() -> Self {
        Self::new()
    }
}

#[cfg(test)]
mod tests {
    use super::*;

    #[test]
    fn an_answer_counts_for_the_newest_event_only() {
        let mailbox = Mailbox::new();
        assert!(mailbox.begin().is_none());
        mailbox.put(0, 0x0100_0680);
        mailbox.post(ControlEvent::Setup);
        assert!(mailbox.answer().is_none());
        let (event, code, packet) = mailbox.begin().expect("an event has been posted");
        assert_eq!((event, packet[0]), (ControlEvent::Setup, 0x0100_0680));
        assert!(mailbox.write(b"hello"));
        mailbox.post(ControlEvent::Reset);
        mailbox.finish(code);
        assert!(mailbox.answer().is_none());
        let (event, code, _) = mailbox.begin().expect("an event has been posted");
        assert_eq!(event, ControlEvent::Reset);
        mailbox.change(|answer| answer.with_address(9));
        mailbox.finish(code);
        let answer = mailbox.answer().expect("the reset is answered");
        assert_eq!((answer.packet(), answer.address()), (None, 9));
        assert!(mailbox.begin().is_none());
    }

    #[test]
    fn what_stands_stays_from_an_answer_to_the_next_and_a_packet_does_not() {
        let mailbox = Mailbox::new();
        for (event, bytes) in [
            (ControlEvent::Out(64), 64),
            (ControlEvent::Out(0), 0),
            (ControlEvent::In, 3),
        ] {
            mailbox.post(event);
            let (posted, code, _) = mailbox.begin().expect("an event has been posted");
            assert_eq!(posted, event);
            assert_eq!(mailbox.begun().packet(), None);
            mailbox.change(|answer| answer.with(Answer::IS_OPEN, true).with_address(127));
            mailbox.change(|answer| answer.with(Answer::STALLS, true));
            assert!(mailbox.write(&[7; 64][..bytes]));
            assert!(!mailbox.write(&[7; 65]));
            mailbox.finish(code);
            let answer = mailbox.answer().expect("the event is answered");
            assert_eq!((answer.packet(), answer.address()), (Some(bytes), 127));
        }
        mailbox.post(ControlEvent::Setup);
        assert!(mailbox.begin().is_some());
        let begun = mailbox.begun();
        assert!(begun.has(Answer::IS_OPEN) && !begun.has(Answer::STALLS));
        assert_eq!(begun.address(), 127);
    }
}
