//! Endpoints: made active, given a packet, and relieved of a packet that nobody fetches.

use super::{
    DATA_ENDPOINT, NOTIFICATION_BYTES, NOTIFICATION_ENDPOINT, PACKET_BYTES, Registers,
    registers::{
        BULK_TYPE, CNAK, ENDPOINT_FIFO, EPDIS, EPENA, EPTYP, GRSTCTL, INTERRUPT, KEPT, PKTCNT,
        SD0PID, SNAK, STALL, STUPCNT, TXFFLSH, TXFNUM, USBAEP, diepctl, dieptsiz, doepctl,
        doeptsiz,
    },
};

/// Runs of `usb` after which something that has been asked of the core counts as failed: 10 ms.
pub(super) const MOST_RUNS: u8 = 20;

/// Begins a configuration: all toggles at DATA0, nothing halted.
pub(super) fn configure(otg: &mut impl Registers) {
    let bulk = USBAEP | BULK_TYPE << EPTYP | SD0PID | PACKET_BYTES as u32;
    let interrupt = USBAEP | INTERRUPT << EPTYP | SD0PID | u32::from(NOTIFICATION_BYTES);
    let data_fifo = u32::from(DATA_ENDPOINT) << ENDPOINT_FIFO;
    let notifications_fifo = u32::from(NOTIFICATION_ENDPOINT) << ENDPOINT_FIFO;
    otg.write(diepctl(DATA_ENDPOINT), bulk | data_fifo | SNAK);
    otg.write(
        diepctl(NOTIFICATION_ENDPOINT),
        interrupt | notifications_fifo | SNAK,
    );
    // A transfer that was begun before goes on: its packet has not come.
    let is_armed = otg.read(doepctl(DATA_ENDPOINT)) & EPENA != 0;
    let nak = if is_armed { CNAK } else { SNAK };
    otg.write(doepctl(DATA_ENDPOINT), bulk | nak);
}

/// Ends a configuration: the endpoints of data answer no more.
pub(super) fn deconfigure(otg: &mut impl Registers) {
    otg.write(diepctl(DATA_ENDPOINT), SNAK);
    otg.write(diepctl(NOTIFICATION_ENDPOINT), SNAK);
    otg.write(doepctl(DATA_ENDPOINT), SNAK);
}

/// Halts an endpoint, or ends its halt: then its next packet is DATA0.
pub(super) fn set_halt(otg: &mut impl Registers, control: usize, is_halted: bool) {
    let kept = otg.read(control) & KEPT & !STALL;
    let change = if is_halted { STALL } else { SD0PID };
    otg.write(control, kept | change);
}

/// Lets the next packet of the host into the endpoint of data, if none is awaited.
pub(super) fn arm_data(otg: &mut impl Registers) {
    let control = otg.read(doepctl(DATA_ENDPOINT));
    if control & (EPENA | USBAEP) == USBAEP {
        otg.write(doeptsiz(DATA_ENDPOINT), 1 << PKTCNT | PACKET_BYTES as u32);
        otg.write(doepctl(DATA_ENDPOINT), control & KEPT | EPENA | CNAK);
    }
}

/// Lets the next packet of a transfer into endpoint 0, if none is awaited; SETUP packets come in at any time.
pub(super) fn arm_control(otg: &mut impl Registers) {
    if otg.read(doepctl(0)) & EPENA == 0 {
        accept_setup(otg);
        otg.write(doepctl(0), EPENA | CNAK);
    }
}

/// Makes room for SETUP packets. The size of a transfer that has been begun may not be changed: its room is left.
pub(super) fn accept_setup(otg: &mut impl Registers) {
    if otg.read(doepctl(0)) & EPENA == 0 {
        let size = STUPCNT | 1 << PKTCNT | PACKET_BYTES as u32;
        otg.write(doeptsiz(0), size);
    }
}

/// Refuses the present transfer of endpoint 0.
pub(super) fn stall_control(otg: &mut impl Registers) {
    otg.write(diepctl(0), STALL | SNAK);
    otg.write(doepctl(0), STALL | SNAK);
}

/// Gives an IN endpoint a packet of so many bytes, whose words are written to its FIFO next. Only while the endpoint has
/// none.
pub(super) fn begin_packet(otg: &mut impl Registers, endpoint: u8, bytes: usize) {
    let kept = otg.read(diepctl(endpoint)) & KEPT;
    otg.write(dieptsiz(endpoint), 1 << PKTCNT | bytes as u32);
    otg.write(diepctl(endpoint), kept | EPENA | CNAK);
}

/// Returns whether an IN endpoint still has its packet.
pub(super) fn is_sending(otg: &mut impl Registers, endpoint: u8) -> bool {
    otg.read(diepctl(endpoint)) & EPENA != 0
}

/// The withdrawal of the packet that an IN endpoint has, and that nobody shall get: RM0090 34.17.5, "IN endpoint
/// disable".
#[derive(Debug, Clone, Copy, PartialEq, Eq)]
pub(super) enum Withdrawal {
    /// There is none.
    Done,
    /// The endpoint is being disabled, for so many runs.
    Disabling(u8),
    /// Its FIFO is being flushed.
    Flushing(u8),
}

/// The core does not do something in time.
#[derive(Debug)]
pub(super) struct Stuck;

impl Withdrawal {
    /// Begins to withdraw the packet of an endpoint, if it has one.
    pub(super) fn begin(&mut self, otg: &mut impl Registers, endpoint: u8) {
        if *self == Self::Done && is_sending(otg, endpoint) {
            let kept = otg.read(diepctl(endpoint)) & KEPT;
            otg.write(diepctl(endpoint), kept | SNAK | EPDIS);
            *self = Self::Disabling(0);
        }
    }

    /// Goes on. Returns whether the endpoint is free.
    ///
    /// # Errors
    /// After [`MOST_RUNS`] runs without an effect.
    pub(super) fn advance(
        &mut self,
        otg: &mut impl Registers,
        endpoint: u8,
    ) -> Result<bool, Stuck> {
        *self = match *self {
            Self::Done => return Ok(true),
            Self::Disabling(MOST_RUNS) | Self::Flushing(MOST_RUNS) => return Err(Stuck),
            Self::Disabling(runs) => {
                let is_flushing = otg.read(GRSTCTL) & TXFFLSH != 0;
                if is_sending(otg, endpoint) || is_flushing {
                    Self::Disabling(runs + 1)
                } else {
                    otg.write(GRSTCTL, TXFFLSH | u32::from(endpoint) << TXFNUM);
                    Self::Flushing(0)
                }
            }
            Self::Flushing(runs) if otg.read(GRSTCTL) & TXFFLSH != 0 => Self::Flushing(runs + 1),
            Self::Flushing(_) => Self::Done,
        };
        Ok(*self == Self::Done)
    }
}
