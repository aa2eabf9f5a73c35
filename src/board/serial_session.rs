//! The session on the serial line.
//!
//! # Cost
//!
//! The queues are small and come first in memory: short offsets reach them. The status of the port is
//! read only while bytes wait to be sent.

use heapless::spsc::Producer;
use leadscrew::{
    machine::{Inputs, Snapshot},
    model::{Bootloader, Requests},
    path::Entry,
    protocol::{ByteReader, ByteWriter, Progress, Session},
    settings::{Change, Erasing, StoreError, Stored, ToolTable},
    stepper::{EventTap, SegmentRing},
    tasks::{self, SessionIo},
};

use super::{pins, pwm, release::ChipPlatform, serial::Transmitter};

/// The session, its queues and the transmitter, shared by `interpret`, `report` and `idle`.
#[expect(unreachable_pub, reason = "RTIC wants what is locked to be public")]
#[repr(C)]
pub struct SerialSession {
    received: ByteReader<'static>,
    sent: ByteWriter<'static>,
    transmitter: Transmitter,
    session: &'static mut Session,
    events: EventTap<'static>,
    /// What `idle` has to hand over to.
    bootloader: Option<Bootloader>,
}

impl SerialSession {
    /// Joins a session with the queues of received bytes and of bytes to be sent.
    pub(crate) const fn new(
        session: &'static mut Session,
        received: ByteReader<'static>,
        sent: ByteWriter<'static>,
        transmitter: Transmitter,
        events: EventTap<'static>,
    ) -> Self {
        Self {
            received,
            sent,
            transmitter,
            session,
            events,
            bootloader: None,
        }
    }

    /// Runs `interpret`, whose changes `store` stores. Returns its progress.
    pub(crate) fn run(
        &mut self,
        snapshot: &Snapshot,
        requests: &Requests,
        inputs: &Inputs,
        segments: &SegmentRing,
        entries: &mut Producer<'static, Entry>,
        store: impl FnOnce(Change, Erasing, &Stored, &ToolTable) -> Result<(), StoreError>,
    ) -> Progress {
        self.session.set_late_events(self.events.late());
        pins::follow_standing_order(self.session.settings(), inputs);
        let io = self.io();
        let platform = &mut ChipPlatform;
        let progress = tasks::interpret(io, snapshot, requests, segments, entries, store, platform);
        // Settings change at rest only, and nothing moves before the session goes on.
        pins::configure_if_changed(self.session.settings());
        pwm::configure(self.session.settings());
        self.bootloader = self.session.wanted_bootloader(snapshot);
        self.transmitter.send_all(requests);
        progress
    }

    /// Runs `report`. Returns its progress.
    pub(crate) fn report(&mut self, snapshot: &Snapshot, requests: &Requests) -> Progress {
        let progress = tasks::report(self.io(), snapshot, requests);
        self.transmitter.send_all(requests);
        progress
    }

    const fn io(&mut self) -> SessionIo<'_, 'static> {
        SessionIo {
            session: self.session,
            received: &mut self.received,
            sent: &mut self.sent,
        }
    }

    /// Returns the bootloader to which `idle` has to hand over, once nothing waits to be sent.
    pub(crate) const fn wanted_bootloader(&self) -> Option<Bootloader> {
        self.bootloader
    }

    /// Sends a byte if any waits and the port takes one, for `idle`. Returns whether any waited.
    pub(crate) fn send_remaining(&mut self, requests: &Requests) -> bool {
        let has_waiting = !self.transmitter.is_done();
        if has_waiting {
            self.transmitter.send_next(requests);
        }
        has_waiting
    }
}
