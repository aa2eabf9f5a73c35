//! The conversation with the sender, as two tasks of one priority have it.

use heapless::spsc::Producer;
use leadscrew::{
    machine::Snapshot,
    model::Requests,
    path::Entry,
    protocol::{ByteReader, ByteWriter, Progress, Session},
    tasks::{self, Console},
};

use super::{ChipPort, Storage, pins, serial::Transmitter};

/// The session and its queues, which are small and come first in memory.
#[expect(unreachable_pub, reason = "RTIC wants what is locked to be public")]
#[repr(C)]
pub struct SerialConsole {
    received: ByteReader<'static>,
    sent: ByteWriter<'static>,
    transmitter: Transmitter,
    session: Session,
}

impl SerialConsole {
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

    /// Runs `interpret`. Returns its progress.
    pub(crate) fn run(
        &mut self,
        snapshot: &Snapshot,
        requests: &Requests,
        entries: &mut Producer<'static, Entry>,
        storage: &mut Storage,
    ) -> Progress {
        let store = |change, stored: &_| storage.write(change, stored);
        let console = self.console();
        let port = &mut ChipPort;
        let progress = tasks::interpret(console, snapshot, requests, entries, store, port);
        // Settings change at rest only, and nothing moves before the session goes on.
        pins::configure_if_changed(self.session.settings());
        self.transmitter.send_all(requests);
        progress
    }

    /// Runs `report`. Returns its progress.
    pub(crate) fn report(&mut self, snapshot: &Snapshot, requests: &Requests) -> Progress {
        let progress = tasks::report(self.console(), snapshot, requests);
        self.transmitter.send_all(requests);
        progress
    }

    const fn console(&mut self) -> Console<'_, 'static> {
        Console {
            session: &mut self.session,
            received: &mut self.received,
            sent: &mut self.sent,
        }
    }

    /// Sends a byte if any are left and the port takes one, for `idle`. Returns whether any were left.
    ///
    /// Reads the port's status only then: in the emulator, each read wakes another thread.
    pub(crate) fn send_rest(&mut self, requests: &Requests) -> bool {
        let is_any_left = !self.transmitter.is_done();
        if is_any_left {
            self.transmitter.send_next(requests);
        }
        is_any_left
    }
}
