//! A sender in this program, at the firmware's serial line or at the port of a USB host.

use std::collections::VecDeque;

use rigless::{
    chip::{Timeline, uart::Peer},
    snapshot::Store,
    time::VirtualNanos,
};

/// The sender's end of the line.
#[derive(Debug, Default)]
pub(crate) struct Sender {
    /// Bytes to the firmware.
    pub(crate) outgoing: VecDeque<u8>,
    /// What the firmware has sent of a line.
    incoming: Vec<u8>,
    /// Lines from the firmware that nobody has looked at.
    pub(crate) lines: VecDeque<String>,
}

impl Sender {
    /// The supply has been off: nothing is under way.
    pub(crate) fn clear(&mut self) {
        self.outgoing.clear();
        self.incoming.clear();
        self.lines.clear();
    }
}

impl Store for Sender {}

impl Peer for Sender {
    fn receive(&mut self, word: u16, _: &mut Timeline<'_, '_>) {
        match word as u8 {
            b'\n' => {
                let line = String::from_utf8_lossy(&self.incoming)
                    .trim_end()
                    .to_owned();
                self.incoming.clear();
                if !line.is_empty() {
                    self.lines.push_back(line);
                }
            }
            byte => self.incoming.push(byte),
        }
    }

    fn transmit(&mut self, _: VirtualNanos) -> Option<u16> {
        self.outgoing.pop_front().map(u16::from)
    }
}
