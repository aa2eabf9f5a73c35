//! The conversation with the sender, as two tasks of one priority have it.

use heapless::spsc::Producer;
use leadscrew::{
    machine::Snapshot,
    model::Requests,
    path::Entry,
    protocol::{ByteReader, ByteWriter, Progress, Session},
};

use super::{
    Storage, pins,
    release::{PREPARE, pend},
    serial::Transmitter,
};

/// The session and its queues, which are small and come first in memory.
#[expect(unreachable_pub, reason = "RTIC wants what is locked to be public")]
#[repr(C)]
pub struct Dialogue {
    received: ByteReader<'static>,
    sent: ByteWriter<'static>,
    transmitter: Transmitter,
    session: Session,
}

impl Dialogue {
    /// About what is received; what is to be sent goes through a queue.
    pub(crate) const fn new(
        session: Session,
        received: ByteReader<'static>,
        (sent, sent_out): (ByteWriter<'static>, ByteReader<'static>),
    ) -> Self {
        Self {
            received,
            sent,
            transmitter: Transmitter::new(sent_out),
            session,
        }
    }

    /// The body of `interpret`.
    pub(crate) fn run(
        &mut self,
        snapshot: &Snapshot,
        requests: &Requests,
        entries: &mut Producer<'static, Entry>,
        storage: &mut Storage,
    ) -> Progress {
        let session = &mut self.session;
        let entered = session.entered();
        let (received, sent) = (&mut self.received, &mut self.sent);
        let progress = session.run(snapshot, requests, received, sent, entries);
        let new = session.entered().wrapping_sub(entered) as usize;
        // While an older entry waits, `prepare` looks again by itself.
        if session.takes_release() | (new != 0 && entries.len() <= new) {
            pend(PREPARE);
        }
        let progress = storage.serve(session).unwrap_or(progress);
        // Settings change at rest only, and nothing moves before the session goes on.
        pins::follow(session.settings());
        self.transmitter.send_all(requests);
        progress
    }

    /// The body of `report`.
    pub(crate) fn report(&mut self, snapshot: &Snapshot, requests: &Requests) -> Progress {
        let free = self.received.capacity() - self.received.len();
        let sent = &mut self.sent;
        let progress = self.session.report(snapshot, requests, free, sent);
        self.transmitter.send_all(requests);
        progress
    }

    /// The body of `idle`: sends a byte if any are left and the port takes one; whether any were.
    ///
    /// It does not look at the port for nothing: in the emulator, each look wakes another thread.
    pub(crate) fn send_rest(&mut self, requests: &Requests) -> bool {
        let is_any_left = !self.transmitter.is_done();
        if is_any_left {
            self.transmitter.send_next(requests);
        }
        is_any_left
    }
}
