//! What the receiver of bytes writes: requests in real time, and the queue of the bytes of lines.
//!
//! # Cost
//! Both lie side by side, so that the receiver gets along with one address.

use super::{ByteReader, ByteWriter, Bytes, bytes::ByteCount};
use crate::model::{Requests, queues::RECEIVED_RING};

/// Requests and received bytes.
#[derive(Debug, Default)]
#[repr(C)]
pub struct Incoming {
    requests: Requests,
    bytes: Bytes<RECEIVED_RING>,
}

impl Incoming {
    /// No requests, and an empty queue.
    #[must_use]
    pub const fn new() -> Self {
        Self {
            requests: Requests::new(),
            bytes: Bytes::new(),
        }
    }

    /// Returns the requests, and the ends of the receiver and of the reader.
    pub const fn split(&mut self) -> (&Requests, IncomingWriter<'_>, ByteReader<'_>) {
        let incoming: &Self = self;
        let reader = incoming.bytes.reader();
        (&incoming.requests, IncomingWriter(incoming), reader)
    }
}

/// The end of the receiver.
#[derive(Debug)]
pub struct IncomingWriter<'a>(&'a Incoming);

impl<'a> IncomingWriter<'a> {
    /// Returns a second one, for the time in which the owner of the first cannot run.
    #[must_use]
    pub const fn second(&self) -> Self {
        Self(self.0)
    }

    /// Returns what tells how many bytes are enqueued.
    #[must_use]
    pub const fn count(&self) -> ByteCount<'a> {
        self.0.bytes.writer().count()
    }

    /// Returns the requests, and the queue.
    #[inline(always)]
    #[expect(
        clippy::inline_always,
        reason = "called from RAM, where nothing in flash may be"
    )]
    pub const fn parts(&mut self) -> (&'a Requests, ByteWriter<'a>) {
        (&self.0.requests, self.0.bytes.writer())
    }
}
