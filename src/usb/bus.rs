//! Endpoint 0 for `usb-device`: the bus that this crate sees is the mailbox.
//!
//! Data goes by the other task: the endpoints of the data have no packets here.

use usb_device::{
    Result, UsbDirection, UsbError,
    bus::{PollResult, UsbBus, UsbBusAllocator},
    endpoint::{EndpointAddress, EndpointType},
};

use super::{
    DATA_ENDPOINT, Mailbox, NOTIFICATION_ENDPOINT, PACKET_WORDS,
    mailbox::{Answer, ControlEvent, halt_bit},
};
use crate::atomic::{AtomicU32, Ordering::Relaxed};

/// The allocator of endpoints, which `usb-device` wants: as long-lived as [`super::UsbControl`].
pub type ControlBusAllocator<'a> = UsbBusAllocator<ControlBus<'a>>;

/// The events of the mailbox as a bus of `usb-device`.
#[derive(Debug)]
pub struct ControlBus<'a> {
    mailbox: &'a Mailbox,
    /// The event in work, by the bit of its kind; a packet that has been read is none any more.
    work: AtomicU32,
    /// Bytes of the packet that has come with it, and the packet.
    length: AtomicU32,
    packet: [AtomicU32; PACKET_WORDS],
}

/// Kinds of events in work.
const RESET: u32 = 1;
const SETUP: u32 = 2;
const OUT: u32 = 4;
const IN: u32 = 8;
/// Bytes of a SETUP packet.
const SETUP_BYTES: usize = 8;

impl<'a> ControlBus<'a> {
    /// Returns the allocator of a bus over a mailbox.
    #[must_use]
    pub fn allocator(mailbox: &'a Mailbox) -> ControlBusAllocator<'a> {
        UsbBusAllocator::new(Self {
            mailbox,
            work: AtomicU32::new(0),
            length: AtomicU32::new(0),
            packet: [const { AtomicU32::new(0) }; PACKET_WORDS],
        })
    }

    /// Returns the mailbox.
    pub(super) const fn mailbox(&self) -> &'a Mailbox {
        self.mailbox
    }

    /// Takes an event with its packet into work.
    pub(super) fn load(&self, event: ControlEvent, packet: &[u32; PACKET_WORDS]) {
        for (slot, word) in self.packet.iter().zip(packet) {
            slot.store(*word, Relaxed);
        }
        let (work, length) = match event {
            ControlEvent::Reset => (RESET, 0),
            ControlEvent::Setup => (SETUP, SETUP_BYTES),
            ControlEvent::Out(bytes) => (OUT, bytes),
            ControlEvent::In => (IN, 0),
        };
        self.length.store(length as u32, Relaxed);
        self.work.store(work, Relaxed);
    }

    /// Changes a bit of the answer.
    pub(super) fn set(&self, bit: u32, is_set: bool) {
        self.mailbox.change(|answer| answer.with(bit, is_set));
    }
}

impl UsbBus for ControlBus<'_> {
    /// The core answers the end of the request that sets the address by the new address.
    const QUIRK_SET_ADDRESS_BEFORE_STATUS: bool = true;

    fn alloc_ep(
        &mut self,
        direction: UsbDirection,
        _address: Option<EndpointAddress>,
        kind: EndpointType,
        _packet_bytes: u16,
        _interval: u8,
    ) -> Result<EndpointAddress> {
        let endpoint = match kind {
            EndpointType::Control => 0,
            EndpointType::Bulk => DATA_ENDPOINT,
            EndpointType::Interrupt => NOTIFICATION_ENDPOINT,
            EndpointType::Isochronous { .. } => return Err(UsbError::Unsupported),
        };
        Ok(EndpointAddress::from_parts(endpoint.into(), direction))
    }

    /// The driver has its own time for that.
    fn enable(&mut self) {}

    fn reset(&self) {
        self.mailbox.change(|_| Answer::default());
    }

    fn set_device_address(&self, address: u8) {
        self.mailbox.change(|answer| answer.with_address(address));
    }

    fn write(&self, to: EndpointAddress, packet: &[u8]) -> Result<usize> {
        if to.index() != 0 {
            return Err(UsbError::InvalidEndpoint);
        }
        if self.mailbox.write(packet) {
            Ok(packet.len())
        } else {
            Err(UsbError::BufferOverflow)
        }
    }

    /// A packet that finds no room is dropped, and its transfer refused.
    fn read(&self, from: EndpointAddress, to: &mut [u8]) -> Result<usize> {
        let has_packet = self.work.load(Relaxed) & (SETUP | OUT) != 0;
        if from.index() != 0 || !has_packet {
            return Err(UsbError::WouldBlock);
        }
        self.work.store(0, Relaxed);
        let length = self.length.load(Relaxed) as usize;
        let Some(to) = to.get_mut(..length) else {
            self.set(Answer::STALLS, true);
            return Err(UsbError::BufferOverflow);
        };
        for (bytes, word) in to.chunks_mut(4).zip(&self.packet) {
            let word = word.load(Relaxed).to_le_bytes();
            for (to, byte) in bytes.iter_mut().zip(word) {
                *to = byte;
            }
        }
        Ok(length)
    }

    /// The core ends the stall of endpoint 0 itself, with the next SETUP.
    fn set_stalled(&self, address: EndpointAddress, is_stalled: bool) {
        if address.index() == 0 {
            if is_stalled {
                self.set(Answer::STALLS, true);
            }
            return;
        }
        let bit = halt_bit(address.index() as u8, address.is_in());
        self.set(bit << Answer::HALTED, is_stalled);
        self.set(bit << Answer::HALT_CHANGED, true);
    }

    fn is_stalled(&self, address: EndpointAddress) -> bool {
        let bit = halt_bit(address.index() as u8, address.is_in());
        self.mailbox.begun().has(bit << Answer::HALTED)
    }

    /// The driver sees a suspension itself, and ends the output: nothing of endpoint 0 changes.
    fn suspend(&self) {}

    fn resume(&self) {}

    fn poll(&self) -> PollResult {
        let (ep_out, ep_in_complete, ep_setup) = match self.work.load(Relaxed) {
            RESET => return PollResult::Reset,
            SETUP => (0, 0, 1),
            OUT => (1, 0, 0),
            IN => (0, 1, 0),
            _ => return PollResult::None,
        };
        PollResult::Data {
            ep_out,
            ep_in_complete,
            ep_setup,
        }
    }
}
