//! The endpoints of the core: RM0090 34.16.4 and 34.17.

use std::collections::VecDeque;

/// Bits of the control of an endpoint.
pub(crate) const USBAEP: u32 = 1 << 15;
pub(crate) const NAKSTS: u32 = 1 << 17;
pub(crate) const STALL: u32 = 1 << 21;
pub(crate) const CNAK: u32 = 1 << 26;
pub(crate) const SNAK: u32 = 1 << 27;
pub(crate) const SD0PID: u32 = 1 << 28;
pub(crate) const EPDIS: u32 = 1 << 30;
pub(crate) const EPENA: u32 = 1 << 31;
/// What keeps what is written: size, activity, kind, stall, FIFO.
const KEPT: u32 = 0x07ff | USBAEP | 3 << 18 | STALL | 0xf << 22;
/// Events of an endpoint.
pub(crate) const XFRC: u32 = 1;
pub(crate) const EPDISD: u32 = 2;
pub(crate) const STUP: u32 = 8;

/// What the device says to a packet of the host.
#[derive(Debug, Clone, Copy, PartialEq, Eq)]
pub enum Handshake {
    /// The packet is taken.
    Ack,
    /// Not now.
    Nak,
    /// The endpoint is halted, or the request refused.
    Stall,
    /// Nothing: another address, no such endpoint, or off the bus.
    Silence,
}

/// What the device says when the host wants a packet.
#[derive(Debug, Clone, PartialEq, Eq)]
pub enum FromDevice {
    /// A packet with its toggle.
    Packet(bool, Vec<u8>),
    /// There is none.
    Refusal(Handshake),
}

/// One direction of an endpoint.
#[derive(Debug, Clone, Default)]
pub(crate) struct Endpoint {
    /// Configuration bits and the NAK.
    pub(crate) control: u32,
    pub(crate) events: u32,
    pub(crate) size: u32,
    /// DATA1 is next.
    pub(crate) toggle: bool,
    /// It is being disabled.
    is_disabling: bool,
    /// Words that wait to be sent.
    pub(crate) fifo: VecDeque<u32>,
}

impl Endpoint {
    /// The endpoint after a reset of the core; endpoint 0 is always active.
    pub(crate) fn new(number: usize) -> Self {
        Self {
            control: if number == 0 { USBAEP } else { 0 },
            ..Self::default()
        }
    }

    pub(crate) fn has(&self, bit: u32) -> bool {
        self.control & bit != 0
    }

    /// Bytes of a full packet.
    pub(crate) fn packet_bytes(&self, number: usize) -> usize {
        let field = (self.control & 0x7ff) as usize;
        if number == 0 {
            64 >> (field & 3)
        } else {
            field
        }
    }

    pub(crate) fn packets(&self, number: usize) -> u32 {
        self.size >> 19 & if number == 0 { 3 } else { 0x3ff }
    }

    pub(crate) fn bytes(&self, number: usize) -> usize {
        (self.size & if number == 0 { 0x7f } else { 0x7_ffff }) as usize
    }

    /// One packet of the transfer is done.
    pub(crate) fn count_packet(&mut self, bytes: usize) {
        self.size -= 1 << 19;
        self.size -= self.size.min(bytes as u32) & 0x7_ffff;
        self.toggle = !self.toggle;
    }

    /// The control register is written. Returns what is wrong with that.
    pub(crate) fn write_control(
        &mut self,
        number: usize,
        value: u32,
        is_in: bool,
    ) -> Option<&'static str> {
        let mut wrong = None;
        let always = if number == 0 { USBAEP } else { 0 };
        let nak = self.control & (NAKSTS | EPENA);
        self.control = value & KEPT | always | nak;
        if value & SNAK != 0 {
            self.control |= NAKSTS;
        }
        if value & CNAK != 0 {
            if value & SNAK != 0 {
                wrong = Some("CNAK and SNAK at once");
            }
            self.control &= !NAKSTS;
        }
        if value & SD0PID != 0 {
            self.toggle = false;
        }
        if value & EPENA != 0 {
            if self.is_disabling {
                wrong = Some("an endpoint is enabled while it is being disabled");
            }
            if self.packets(number) == 0 {
                wrong = Some("an endpoint is enabled for no packet");
            }
            self.control |= EPENA;
        }
        if value & EPDIS != 0 {
            // An OUT endpoint needs the global NAK first, which nothing here sets: 34.17.5.
            if !is_in || !self.has(EPENA) || !self.has(NAKSTS) {
                wrong =
                    Some("an endpoint is disabled that is not enabled, or has no NAK, or is OUT");
            } else {
                self.is_disabling = true;
            }
        }
        wrong
    }

    /// Some time has passed.
    pub(crate) fn settle(&mut self) {
        if std::mem::take(&mut self.is_disabling) {
            self.control &= !EPENA;
            self.events |= EPDISD;
        }
    }
}
