//! The core: registers for software, packets for the host.

use std::collections::VecDeque;

use crate::endpoint::{EPENA, Endpoint, FromDevice, Handshake, NAKSTS, STALL, STUP, USBAEP, XFRC};

/// Endpoints of each direction, on the chip that has the fewest.
const ENDPOINTS: usize = 4;
/// Words of all FIFOs.
const FIFO_WORDS: u32 = 320;
/// Time for the core to become a device, and to show a disconnect, µs: 34.16.2, ES0182.
const DEVICE_US: u64 = 25_000;
const DISCONNECT_US: u64 = 3_000;

/// A version of the core.
#[derive(Debug, Clone, Copy, PartialEq, Eq)]
pub enum Version {
    /// F405, F407, F411, F429: RM0090.
    V1,
    /// F446: RM0390. It comes up disconnected, and has other bits for the bus voltage.
    V2,
}

/// How the receive FIFO shows the end of a SETUP.
#[derive(Debug, Clone, Copy, PartialEq, Eq)]
pub enum SetupEnd {
    /// By its entry.
    Entry,
    /// By the entry of an ended transfer, and its own behind that entry, as cores from 3.10a on.
    TransferFirst,
    /// Not at all.
    Missing,
}

/// What differs between chips, or is open in the manual.
#[derive(Debug, Clone, Copy, PartialEq, Eq)]
pub struct Silicon {
    /// The version.
    pub version: Version,
    /// The end of a SETUP.
    pub setup_end: SetupEnd,
    /// A reset of the bus leaves OUT endpoints enabled.
    pub keeps_enabled: bool,
}

/// An entry of the receive FIFO.
#[derive(Debug, Clone)]
struct Entry {
    status: u32,
    words: VecDeque<u32>,
}

/// Kinds of entries.
const OUT_DATA: u32 = 2;
const OUT_DONE: u32 = 3;
const SETUP_DONE: u32 = 4;
const SETUP_DATA: u32 = 6;

/// Something that takes some time.
#[derive(Debug, Clone, Copy, PartialEq, Eq)]
enum Work {
    Reset,
    FlushSent(u32),
    FlushReceived,
}

/// The core.
#[derive(Debug)]
pub struct Core {
    silicon: Silicon,
    now_us: u64,
    /// The clocks of the core and of 48 MHz run.
    pub is_clocked: bool,
    /// A reset or a flush never ends.
    pub is_stuck: bool,
    session: u32,
    usb: u32,
    configuration: u32,
    power: u32,
    flags: u32,
    /// Which events interrupt.
    mask: u32,
    receive_words: u32,
    transmit: [u32; ENDPOINTS],
    device: u32,
    /// The address of the device: a new address counts from the end of its request on.
    address: u8,
    control: u32,
    clocks: u32,
    device_since_us: Option<u64>,
    disconnected_since_us: u64,
    /// How long the last soft disconnect was that has ended.
    disconnect_us: Option<u64>,
    work: Vec<Work>,
    is_suspended: bool,
    received: VecDeque<Entry>,
    /// Words of the packet whose status has been read.
    popped: VecDeque<u32>,
    ins: [Endpoint; ENDPOINTS],
    outs: [Endpoint; ENDPOINTS],
    violations: Vec<String>,
}

/// Bits of registers.
const FDMOD: u32 = 1 << 30;
const SDIS: u32 = 1 << 1;
const PWRDWN: u32 = 1 << 16;
const SENSING: u32 = 1 << 21;
const FORCED_VALID: u32 = 3 << 6;
const AHBIDL: u32 = 1 << 31;
const RXFLVL: u32 = 1 << 4;
const USBSUSP: u32 = 1 << 11;
const USBRST: u32 = 1 << 12;
const ENUMDNE: u32 = 1 << 13;
const WKUPINT: u32 = 1 << 31;
const EVENTS: u32 = USBSUSP | USBRST | ENUMDNE | WKUPINT;

impl Core {
    /// The core out of the reset of the chip.
    #[must_use]
    pub fn new(silicon: Silicon) -> Self {
        Self {
            silicon,
            now_us: 0,
            is_clocked: true,
            is_stuck: false,
            session: 0,
            usb: 0x1440,
            configuration: 0,
            power: 0,
            flags: 0,
            mask: 0,
            receive_words: 0x200,
            transmit: [0x0200_0200; ENDPOINTS],
            device: 0x0220_0000,
            address: 0,
            control: match silicon.version {
                Version::V1 => 0,
                Version::V2 => SDIS,
            },
            clocks: 0,
            device_since_us: None,
            disconnected_since_us: 0,
            disconnect_us: None,
            work: Vec::new(),
            is_suspended: false,
            received: VecDeque::new(),
            popped: VecDeque::new(),
            ins: std::array::from_fn(Endpoint::new),
            outs: std::array::from_fn(Endpoint::new),
            violations: Vec::new(),
        }
    }

    /// What software has done that the manual forbids.
    #[must_use]
    pub fn violations(&self) -> &[String] {
        &self.violations
    }

    /// Takes them out.
    pub fn take_violations(&mut self) -> Vec<String> {
        std::mem::take(&mut self.violations)
    }

    fn forbid(&mut self, what: impl Into<String>) {
        let what = format!("{} µs: {}", self.now_us, what.into());
        self.violations.push(what);
    }

    /// Lets time pass.
    pub fn pass(&mut self, us: u64) {
        self.now_us += us;
        if self.is_stuck {
            return;
        }
        for work in std::mem::take(&mut self.work) {
            match work {
                Work::Reset => self.reset(),
                Work::FlushReceived => {
                    self.received.clear();
                    self.popped.clear();
                }
                Work::FlushSent(number) => self.flush(number),
            }
        }
        for endpoint in self.ins.iter_mut().chain(&mut self.outs) {
            endpoint.settle();
        }
    }

    fn reset(&mut self) {
        let fresh = Self::new(self.silicon);
        let (now_us, is_clocked) = (self.now_us, self.is_clocked);
        let violations = std::mem::take(&mut self.violations);
        *self = Self {
            now_us,
            is_clocked,
            violations,
            disconnected_since_us: now_us,
            ..fresh
        };
    }

    fn flush(&mut self, number: u32) {
        for (endpoint, index) in self.ins.iter_mut().zip(0..) {
            if number == 0x10 || number == index {
                endpoint.fifo.clear();
            }
        }
    }

    /// Whether the core is a device: it takes its time after it has been told to be.
    fn is_device(&self) -> bool {
        { self.device_since_us }.is_some_and(|since| self.now_us - since >= DEVICE_US)
    }

    /// Whether the host sees a device.
    #[must_use]
    pub fn is_connected(&self) -> bool {
        let is_valid = match self.silicon.version {
            Version::V1 => self.power & SENSING != 0,
            Version::V2 => self.power & SENSING == 0 && self.session & FORCED_VALID == FORCED_VALID,
        };
        let is_powered = self.is_clocked && self.power & PWRDWN != 0 && self.clocks == 0;
        is_powered && is_valid && self.is_device() && self.control & SDIS == 0
    }

    /// Reads a register, as software does.
    pub fn read(&mut self, offset: usize) -> u32 {
        if !self.is_clocked {
            self.forbid("a register is read without clocks");
            return 0;
        }
        match offset {
            0x01c => self.next_status(),
            0x020 => self.pop(),
            0x1000..=0x4fff => self.popped.pop_front().unwrap_or_else(|| {
                self.forbid("more words are read than the packet has");
                0
            }),
            _ => self.peek(offset).unwrap_or_else(|| {
                self.forbid(format!("{offset:#x} is read, which has no model"));
                0
            }),
        }
    }

    /// A register as a debug probe sees it; `None` for FIFOs and for what has no model.
    #[must_use]
    pub fn peek(&self, offset: usize) -> Option<u32> {
        let register = match offset {
            0x000 => self.session,
            0x008 => self.configuration,
            0x00c => self.usb,
            0x010 => self.resets(),
            0x014 => self.flags | if self.received.is_empty() { 0 } else { RXFLVL },
            0x018 => self.mask,
            0x024 => self.receive_words,
            0x028 => self.transmit[0],
            0x038 => self.power,
            0x03c => match self.silicon.version {
                Version::V1 => 0x1200,
                Version::V2 => 0x2000,
            },
            0x104..=0x10c => self.transmit[(offset - 0x100) / 4],
            0x800 => self.device,
            0x804 => self.control,
            0x808 => u32::from(self.is_suspended) | 3 << 1,
            0x900..=0x97f => Self::read_endpoint(&self.ins[(offset - 0x900) / 0x20], offset)?,
            0xb00..=0xb7f => Self::read_endpoint(&self.outs[(offset - 0xb00) / 0x20], offset)?,
            0xe00 => self.clocks,
            _ => return None,
        };
        Some(register)
    }

    fn resets(&self) -> u32 {
        let bits = self.work.iter().map(|work| match work {
            Work::Reset => 1,
            Work::FlushReceived => 1 << 4,
            Work::FlushSent(_) => 1 << 5,
        });
        let bits = bits.fold(0, |bits, bit| bits | bit);
        if bits & 1 == 0 { bits | AHBIDL } else { bits }
    }

    fn read_endpoint(endpoint: &Endpoint, offset: usize) -> Option<u32> {
        match offset & 0x1f {
            0x00 => Some(endpoint.control),
            0x08 => Some(endpoint.events),
            0x10 => Some(endpoint.size),
            _ => None,
        }
    }

    /// The status of the oldest entry of the receive FIFO, which stays.
    fn next_status(&mut self) -> u32 {
        if !self.popped.is_empty() {
            self.forbid("a packet has not been read when the next status is");
        }
        self.received.front().map_or(0, |entry| entry.status)
    }

    /// The same, which is taken out.
    fn pop(&mut self) -> u32 {
        if !self.popped.is_empty() {
            self.forbid("a packet has not been read when the next status is");
        }
        let Some(Entry { status, words }) = self.received.pop_front() else {
            self.forbid("the status of an empty receive FIFO is read");
            return 0;
        };
        self.popped = words;
        let endpoint = &mut self.outs[(status & 0xf) as usize];
        match status >> 17 & 0xf {
            SETUP_DONE => {
                endpoint.control &= !EPENA;
                endpoint.events |= STUP;
            }
            OUT_DONE => {
                endpoint.control &= !EPENA;
                endpoint.events |= XFRC;
            }
            _ => {}
        }
        status
    }

    /// Writes a register, as software does.
    pub fn write(&mut self, offset: usize, value: u32) {
        if !self.is_clocked {
            self.forbid("a register is written without clocks");
            return;
        }
        match offset {
            0x000 => self.session = value,
            0x008 => self.configuration = value,
            0x00c => {
                let forced = value & FDMOD != 0;
                self.device_since_us = forced.then(|| self.device_since_us.unwrap_or(self.now_us));
                self.usb = value;
            }
            0x010 => self.begin_work(value),
            0x014 => self.flags &= !(value & EVENTS),
            0x018 => self.mask = value,
            0x024 => self.receive_words = value,
            0x028 => self.transmit[0] = value,
            0x038 => self.power = value,
            0x104..=0x10c => self.transmit[(offset - 0x100) / 4] = value,
            0xe00 => self.clocks = value,
            // Of a device: 34.16.4.
            0x800..=0xbff if !self.is_device() => {}
            0x800 => {
                self.device = value;
                if self.new_address() == 0 {
                    self.address = 0;
                }
            }
            0x804 => self.write_control(value),
            0x900..=0x97f => self.write_endpoint((offset - 0x900) / 0x20, offset, value, true),
            0xb00..=0xb7f => self.write_endpoint((offset - 0xb00) / 0x20, offset, value, false),
            0x1000..=0x4fff => self.push((offset - 0x1000) / 0x1000, value),
            _ => self.forbid(format!("{offset:#x} is written, which has no model")),
        }
    }

    fn begin_work(&mut self, value: u32) {
        if !self.work.is_empty() {
            self.forbid("a reset or a flush is begun while another one is under way");
        }
        if value & 1 != 0 {
            self.work.push(Work::Reset);
        }
        if value & 1 << 4 != 0 {
            self.work.push(Work::FlushReceived);
        }
        if value & 1 << 5 != 0 {
            let number = value >> 6 & 0x1f;
            let is_meant = |index: usize| number == 0x10 || number as usize == index;
            let is_sending = |endpoint: &Endpoint| endpoint.has(EPENA) && !endpoint.has(NAKSTS);
            let mut flushed = { self.ins.iter().enumerate() }.filter(|(index, _)| is_meant(*index));
            if flushed.any(|(_, endpoint)| is_sending(endpoint)) {
                self.forbid("the FIFO of an endpoint that is sending is flushed");
            }
            self.work.push(Work::FlushSent(number));
        }
    }

    fn write_control(&mut self, value: u32) {
        let was_off = self.control & SDIS != 0;
        let is_off = value & SDIS != 0;
        if !was_off && is_off {
            self.disconnected_since_us = self.now_us;
        }
        self.control = value & SDIS;
        if was_off && !is_off {
            let us = self.now_us - self.disconnected_since_us;
            self.disconnect_us = Some(us);
            if us < DISCONNECT_US {
                self.forbid("the soft disconnect is too short");
            }
            self.check_set_up();
        }
    }

    /// What must be right before the host sees the device.
    fn check_set_up(&mut self) {
        let fifos = self.transmit.map(|fifo| (fifo & 0xffff, fifo >> 16));
        // What has not been set is not used.
        let mut ranges: Vec<_> = { fifos.iter() }
            .filter(|fifo| **fifo != (0x200, 0x200))
            .collect();
        ranges.sort_unstable();
        let mut end = self.receive_words;
        for (start, words) in ranges {
            if *start < end || *words < 16 {
                self.violations
                    .push("FIFOs overlap, or are too small".into());
            }
            end = start + words;
        }
        if end > FIFO_WORDS {
            self.forbid("the FIFOs are larger than their memory");
        }
        if self.device & 3 != 3 {
            self.forbid("the speed is not that of the transceiver within the chip");
        }
        if self.usb >> 10 & 0xf < 6 {
            self.forbid("the turnaround is too short");
        }
        if self.configuration & 1 != 0 {
            self.forbid("the core interrupts");
        }
    }

    fn write_endpoint(&mut self, number: usize, offset: usize, value: u32, is_in: bool) {
        let endpoint = if is_in {
            &mut self.ins[number]
        } else {
            &mut self.outs[number]
        };
        let wrong = match offset & 0x1f {
            0x00 => endpoint.write_control(number, value, is_in),
            0x08 => {
                endpoint.events &= !value;
                None
            }
            0x10 => {
                let is_busy = endpoint.has(EPENA);
                endpoint.size = value;
                is_busy.then_some("the size of a transfer is changed while the endpoint is enabled")
            }
            _ => Some("a register without a model is written"),
        };
        if let Some(wrong) = wrong {
            self.forbid(format!("{wrong}, endpoint {number}, IN {is_in}"));
        }
    }

    fn push(&mut self, number: usize, word: u32) {
        let room = (self.transmit[number] >> 16) as usize;
        let endpoint = &mut self.ins[number];
        let expected = endpoint.bytes(number).div_ceil(4);
        if !endpoint.has(EPENA) || endpoint.fifo.len() >= room.min(expected) {
            self.forbid(format!("a word too many is written to FIFO {number}"));
            return;
        }
        endpoint.fifo.push_back(word);
    }
}

/// Returns whether there is such an endpoint in the present configuration.
fn is_active(endpoints: &[Endpoint; ENDPOINTS], number: usize) -> bool {
    { endpoints.get(number) }.is_some_and(|endpoint| endpoint.has(USBAEP))
}

/// The side of the host.
impl Core {
    /// The host resets the bus: the flags are those of the beginning and of the end.
    pub fn reset_bus(&mut self) {
        if !self.is_connected() {
            return;
        }
        self.flags |= USBRST | ENUMDNE;
        self.flags &= !USBSUSP;
        self.is_suspended = false;
        let keeps_enabled = self.silicon.keeps_enabled;
        for (number, endpoint) in self.outs.iter_mut().enumerate() {
            if !keeps_enabled {
                endpoint.control &= !EPENA;
            }
            if number != 0 {
                endpoint.control &= !USBAEP;
            }
        }
        for endpoint in self.ins.iter_mut().skip(1) {
            endpoint.control &= !USBAEP;
        }
    }

    /// The host suspends the bus, is gone, or resumes.
    pub fn suspend(&mut self, is_suspended: bool) {
        if self.is_connected() && is_suspended != self.is_suspended {
            self.is_suspended = is_suspended;
            self.flags |= if is_suspended { USBSUSP } else { WKUPINT };
        }
    }

    fn answers(&self, address: u8) -> bool {
        let is_reset = self.flags & USBRST != 0;
        self.is_connected() && !self.is_suspended && !is_reset && self.address == address
    }

    fn new_address(&self) -> u8 {
        (self.device >> 4 & 0x7f) as u8
    }

    /// Words that the receive FIFO has room for.
    fn room(&self) -> usize {
        let words = |words: &VecDeque<u32>| words.len();
        let entries = self.received.iter().map(|entry| 1 + words(&entry.words));
        let taken: usize = entries.sum::<usize>() + words(&self.popped);
        (self.receive_words as usize).saturating_sub(taken)
    }

    fn enter(&mut self, kind: u32, endpoint: usize, bytes: &[u8]) {
        let words = bytes.chunks(4).map(|bytes| {
            let mut word = [0; 4];
            word[..bytes.len()].copy_from_slice(bytes);
            u32::from_le_bytes(word)
        });
        let status = kind << 17 | (bytes.len() as u32) << 4 | endpoint as u32;
        self.received.push_back(Entry {
            status,
            words: words.collect(),
        });
    }

    /// The host sends a SETUP packet, which endpoint 0 takes whatever it does: 34.17.5.
    pub fn setup(&mut self, address: u8, request: [u8; 8]) -> Handshake {
        // Room that the manual wants to be left for three of them, and for what follows.
        if !self.answers(address) || self.room() < 5 {
            return Handshake::Silence;
        }
        for endpoint in [&mut self.ins[0], &mut self.outs[0]] {
            endpoint.control &= !STALL;
            endpoint.control |= NAKSTS;
            endpoint.toggle = true;
        }
        self.enter(SETUP_DATA, 0, &request);
        match self.silicon.setup_end {
            SetupEnd::Entry => self.enter(SETUP_DONE, 0, &[]),
            SetupEnd::TransferFirst => {
                self.enter(OUT_DONE, 0, &[]);
                self.enter(SETUP_DONE, 0, &[]);
            }
            SetupEnd::Missing => self.outs[0].control &= !EPENA,
        }
        Handshake::Ack
    }

    /// The host sends a packet of data with a toggle.
    pub fn out(&mut self, address: u8, number: usize, toggle: bool, bytes: &[u8]) -> Handshake {
        if !self.answers(address) || !is_active(&self.outs, number) {
            return Handshake::Silence;
        }
        let room = self.room();
        let endpoint = &mut self.outs[number];
        if endpoint.has(STALL) {
            return Handshake::Stall;
        }
        if toggle != endpoint.toggle {
            // It has been taken already: its acknowledgement was lost.
            return Handshake::Ack;
        }
        let is_ready =
            endpoint.has(EPENA) && !endpoint.has(NAKSTS) && endpoint.packets(number) != 0;
        if !is_ready || room < 2 + bytes.len().div_ceil(4) {
            return Handshake::Nak;
        }
        let is_short = bytes.len() < endpoint.packet_bytes(number);
        endpoint.count_packet(bytes.len());
        let is_done = is_short || endpoint.packets(number) == 0;
        if is_done {
            endpoint.control |= NAKSTS;
        }
        self.enter(OUT_DATA, number, bytes);
        if is_done {
            self.enter(OUT_DONE, number, &[]);
        }
        Handshake::Ack
    }

    /// The host fetches a packet, and has it.
    pub fn fetch(&mut self, address: u8, number: usize) -> FromDevice {
        if !self.answers(address) || !is_active(&self.ins, number) {
            return FromDevice::Refusal(Handshake::Silence);
        }
        let endpoint = &mut self.ins[number];
        if endpoint.has(STALL) {
            return FromDevice::Refusal(Handshake::Stall);
        }
        let length = endpoint.bytes(number).min(endpoint.packet_bytes(number));
        let words = length.div_ceil(4);
        if !endpoint.has(EPENA) || endpoint.has(NAKSTS) || endpoint.fifo.len() < words {
            return FromDevice::Refusal(Handshake::Nak);
        }
        let words = endpoint.fifo.drain(..words);
        let mut bytes: Vec<u8> = words.flat_map(u32::to_le_bytes).collect();
        bytes.truncate(length);
        let toggle = endpoint.toggle;
        endpoint.count_packet(length);
        if endpoint.packets(number) == 0 {
            endpoint.control &= !EPENA;
            endpoint.events |= XFRC;
        }
        if number == 0 {
            self.address = self.new_address();
        }
        FromDevice::Packet(toggle, bytes)
    }

    /// The address of the device.
    #[must_use]
    pub const fn address(&self) -> u8 {
        self.address
    }

    /// How long the last soft disconnect was that has ended since the reset of the core, µs.
    #[must_use]
    pub const fn disconnect_us(&self) -> Option<u64> {
        self.disconnect_us
    }

    /// The silicon that is modelled.
    #[must_use]
    pub const fn silicon(&self) -> Silicon {
        self.silicon
    }
}
