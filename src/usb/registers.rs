//! The registers of the OTG full-speed core that a device needs: RM0090 34.16.

/// The registers of the core, by their offset from its base.
pub trait Registers {
    /// Reads a register: a read of [`GRXSTSP`] or of a FIFO takes what it returns out of the FIFO.
    fn read(&mut self, offset: usize) -> u32;

    /// Writes a register.
    fn write(&mut self, offset: usize, value: u32);
}

/// Control and status of OTG: whether the session counts as valid.
pub const GOTGCTL: usize = 0x000;
/// Configuration of the bus: whether the core interrupts.
pub const GAHBCFG: usize = 0x008;
/// Configuration of USB.
pub const GUSBCFG: usize = 0x00c;
/// Resets, and the flushing of FIFOs.
pub const GRSTCTL: usize = 0x010;
/// Events.
pub const GINTSTS: usize = 0x014;
/// Events that interrupt.
pub const GINTMSK: usize = 0x018;
/// Status of the oldest entry of the receive FIFO, which stays.
pub const GRXSTSR: usize = 0x01c;
/// The same, which a read takes out.
pub const GRXSTSP: usize = 0x020;
/// Size of the receive FIFO.
pub const GRXFSIZ: usize = 0x024;
/// Place and size of the transmit FIFO of endpoint 0.
pub const DIEPTXF0: usize = 0x028;
/// Configuration of the core: the PHY, and the sensing of the bus voltage.
pub const GCCFG: usize = 0x038;
/// The version of the core.
pub const CID: usize = 0x03c;
/// Configuration of the device: speed and address.
pub const DCFG: usize = 0x800;
/// Control of the device: the soft disconnect.
pub const DCTL: usize = 0x804;
/// Status of the device: suspension.
pub const DSTS: usize = 0x808;
/// Control of the clocks.
pub const PCGCCTL: usize = 0xe00;

/// Returns the offset of the place and size of the transmit FIFO of an IN endpoint from 1 on.
#[must_use]
pub const fn dieptxf(endpoint: u8) -> usize {
    0x100 + 4 * endpoint as usize
}

/// Returns the offset of the control register of an IN endpoint.
#[must_use]
pub const fn diepctl(endpoint: u8) -> usize {
    0x900 + 0x20 * endpoint as usize
}

/// Returns the offset of the events of an IN endpoint.
#[must_use]
pub const fn diepint(endpoint: u8) -> usize {
    diepctl(endpoint) + 8
}

/// Returns the offset of the size of the transfer of an IN endpoint.
#[must_use]
pub const fn dieptsiz(endpoint: u8) -> usize {
    diepctl(endpoint) + 0x10
}

/// Returns the offset of the control register of an OUT endpoint.
#[must_use]
pub const fn doepctl(endpoint: u8) -> usize {
    0xb00 + 0x20 * endpoint as usize
}

/// Returns the offset of the size of the transfer of an OUT endpoint.
#[must_use]
pub const fn doeptsiz(endpoint: u8) -> usize {
    doepctl(endpoint) + 0x10
}

/// Returns the offset of the FIFO of an endpoint: the one receive FIFO, or its transmit FIFO.
#[must_use]
pub const fn fifo(endpoint: u8) -> usize {
    0x1000 + 0x1000 * endpoint as usize
}

/// The session counts as valid, whatever the bus voltage: of cores from [`VERSION_2`] on.
pub const BVALOEN: u32 = 1 << 6;
/// The value that [`BVALOEN`] puts in the place of the comparator's.
pub const BVALOVAL: u32 = 1 << 7;
/// The transceiver within the chip.
pub const PHYSEL: u32 = 1 << 6;
/// The first bit of the turnaround time.
pub const TRDT: u32 = 10;
/// The core is a device, whatever the pin ID says.
pub const FDMOD: u32 = 1 << 30;
/// Resets the core.
pub const CSRST: u32 = 1;
/// Flushes the receive FIFO.
pub const RXFFLSH: u32 = 1 << 4;
/// Flushes transmit FIFOs: the one of the number from bit [`TXFNUM`] on, or all with [`ALL_FIFOS`].
pub const TXFFLSH: u32 = 1 << 5;
/// The first bit of the number of the transmit FIFO.
pub const TXFNUM: u32 = 6;
/// The number that means all transmit FIFOs.
pub const ALL_FIFOS: u32 = 0x10;
/// The core is idle.
pub const AHBIDL: u32 = 1 << 31;
/// The receive FIFO has an entry.
pub const RXFLVL: u32 = 1 << 4;
/// The host has suspended the bus, or is gone.
pub const USBSUSP: u32 = 1 << 11;
/// The host resets the bus.
pub const USBRST: u32 = 1 << 12;
/// The reset of the bus has ended.
pub const ENUMDNE: u32 = 1 << 13;
/// The host resumes the bus.
pub const WKUPINT: u32 = 1 << 31;
/// The transceiver has power.
pub const PWRDWN: u32 = 1 << 16;
/// The bus voltage is not sensed: of cores before [`VERSION_2`]. In later ones this bit switches the sensing on.
pub const NOVBUSSENS: u32 = 1 << 21;
/// The first of the versions whose bits of the bus voltage are those of RM0390.
pub const VERSION_2: u32 = 0x2000;
/// Full speed, by the transceiver within the chip.
pub const FULL_SPEED: u32 = 3;
/// The address of the device.
pub const DAD: u32 = 0x7f << 4;
/// Soft disconnect.
pub const SDIS: u32 = 1 << 1;
/// Clears the NAK of all endpoints, IN and OUT.
pub const CGINAK_CGONAK: u32 = 1 << 8 | 1 << 10;
/// The bus is suspended.
pub const SUSPSTS: u32 = 1;

/// The endpoint is active in this configuration.
pub const USBAEP: u32 = 1 << 15;
/// The first bit of the kind of an endpoint.
pub const EPTYP: u32 = 18;
/// The kind of endpoints of data.
pub const BULK_TYPE: u32 = 2;
/// The kind of endpoints of notifications.
pub const INTERRUPT: u32 = 3;
/// The endpoint answers with STALL.
pub const STALL: u32 = 1 << 21;
/// The first bit of the number of the transmit FIFO of an IN endpoint.
pub const ENDPOINT_FIFO: u32 = 22;
/// Clears the NAK.
pub const CNAK: u32 = 1 << 26;
/// Sets the NAK.
pub const SNAK: u32 = 1 << 27;
/// The next packet is DATA0.
pub const SD0PID: u32 = 1 << 28;
/// Disables the endpoint.
pub const EPDIS: u32 = 1 << 30;
/// Enables the endpoint for a transfer; clear when the transfer has ended.
pub const EPENA: u32 = 1 << 31;
/// Bits of an endpoint's control that keep what they are written.
pub const KEPT: u32 = 0x07ff | USBAEP | 3 << EPTYP | STALL | 0xf << ENDPOINT_FIFO;
/// The transfer has ended.
pub const XFRC: u32 = 1;
/// The first bit of the number of packets of a transfer.
pub const PKTCNT: u32 = 19;
/// Room for three SETUP packets in a row.
pub const STUPCNT: u32 = 3 << 29;

/// The kinds of entries of the receive FIFO, from bit 17 of [`GRXSTSP`] on.
pub mod entry {
    /// A packet of data.
    pub const DATA: u32 = 2;
    /// The end of a transfer.
    pub const OUT_DONE: u32 = 3;
    /// The end of a SETUP.
    pub const SETUP_DONE: u32 = 4;
    /// A SETUP packet.
    pub const SETUP: u32 = 6;
}
