//! The driver of the OTG core: what `usb` does in each period.
//!
//! # Cost
//! A run takes a packet of data, or at most [`MOST_FIFO_ENTRIES`] other entries of the receive FIFO, and sends a packet.
//! Each loop counts constants.

use core::array;

use super::{
    DATA_ENDPOINT, Mailbox, PACKET_BYTES, Registers,
    endpoints::{self, MOST_RUNS, Stuck, Withdrawal},
    mailbox::{Answer, ControlEvent, halt_bit},
    packet::Packet,
    registers::{
        AHBIDL, ALL_FIFOS, BVALOEN, BVALOVAL, CGINAK_CGONAK, CID, CSRST, DAD, DCFG, DCTL, DIEPTXF0,
        DSTS, ENUMDNE, FDMOD, FULL_SPEED, GAHBCFG, GCCFG, GINTMSK, GINTSTS, GOTGCTL, GRSTCTL,
        GRXFSIZ, GRXSTSP, GRXSTSR, GUSBCFG, NOVBUSSENS, PCGCCTL, PHYSEL, PWRDWN, RXFFLSH, RXFLVL,
        SDIS, SNAK, SUSPSTS, TRDT, TXFFLSH, TXFNUM, USBRST, USBSUSP, VERSION_2, WKUPINT, XFRC,
        diepctl, diepint, dieptxf, doepctl, entry, fifo,
    },
};
use crate::{
    model::Requests,
    protocol::{ByteReader, ByteWriter},
    tasks::{self, Platform, Task},
};

/// Runs before the core is a device, 26 ms: it takes 25 ms (RM0090 34.16.2, FDMOD), and no register of a device before.
const RUNS_TO_DEVICE_MODE: u8 = 52;
/// Runs before the core connects: 4 ms behind a soft disconnect, which hosts see after 3 ms (ES0182).
const RUNS_TO_CONNECTION: u8 = RUNS_TO_DEVICE_MODE + 8;
/// Entries of the receive FIFO that a run takes which takes no packet of data, at most: two of a SETUP, and two before.
pub const MOST_FIFO_ENTRIES: usize = 4;

/// Words of the FIFOs, of which the core has 320: RM0090 34.11. Received are three SETUP packets and two packets of
/// data, each with its status, with room to spare.
const RECEIVE_WORDS: u32 = 64;
const CONTROL_WORDS: u32 = 16;
const DATA_WORDS: u32 = 32;
const NOTIFICATION_WORDS: u32 = 16;

/// Both ends of the line of the sender.
#[derive(Debug)]
pub struct SenderQueues<'a, 'r, 's> {
    /// Requests in real time.
    pub requests: &'a Requests,
    /// Received bytes of lines.
    pub received: &'a mut ByteWriter<'r>,
    /// Bytes to be sent.
    pub sent: &'a mut ByteReader<'s>,
}

/// What the core is doing, for so many runs.
#[derive(Debug, Clone, Copy, PartialEq, Eq)]
enum Stage {
    /// It has no set-up.
    Off(u8),
    /// It is being reset.
    Resetting(u8),
    /// It becomes a device, disconnected.
    Disconnected(u8),
    /// Its endpoints are being disabled, for a reset of the bus.
    Disabling,
    /// Its FIFOs are being flushed.
    Flushing(u8),
    /// It works.
    Connected,
}

/// The driver.
#[derive(Debug)]
pub struct Driver<'a> {
    mailbox: &'a Mailbox,
    stage: Stage,
    packet: Packet,
    /// The event whose answer has not been taken.
    posted: Option<ControlEvent>,
    /// A packet of endpoint 0 is in the mailbox, and has not been posted.
    control_packet: Option<usize>,
    /// A SETUP packet is in the mailbox, whose end has not come.
    has_setup: bool,
    /// The withdrawals of packets of endpoint 0 and of the endpoint of data.
    control_withdrawal: Withdrawal,
    data_withdrawal: Withdrawal,
    is_configured: bool,
    is_open: bool,
    /// The host listens: there is a configuration, and the bus is not suspended.
    is_linked: bool,
    /// The host's program has closed the port, and nobody has sent since.
    is_closed: bool,
    /// The line that was begun when the link was lost has not been ended.
    owes_line_end: bool,
    /// The last packet was full: another one must follow, if only an empty one.
    owes_packet: bool,
}

impl<'a> Driver<'a> {
    /// Returns the driver of a core that has its clocks.
    #[must_use]
    pub const fn new(mailbox: &'a Mailbox) -> Self {
        Self {
            mailbox,
            stage: Stage::Off(0),
            packet: Packet::new(),
            posted: None,
            control_packet: None,
            has_setup: false,
            control_withdrawal: Withdrawal::Done,
            data_withdrawal: Withdrawal::Done,
            is_configured: false,
            is_open: false,
            is_linked: false,
            is_closed: false,
            owes_line_end: false,
            owes_packet: false,
        }
    }

    /// Does what is due. Returns whether `usb_control` is to be released.
    pub fn serve(
        &mut self,
        otg: &mut impl Registers,
        line: &mut SenderQueues<'_, '_, '_>,
        platform: &mut impl Platform,
    ) -> bool {
        let is_working = match self.advance(otg) {
            Ok(true) => self.work(otg, line, platform),
            Ok(false) => Ok(false),
            Err(Stuck) => Err(Stuck),
        };
        if is_working.is_err() {
            self.stage = Stage::Off(0);
        }
        self.packet.drain(line.requests, line.received, platform);
        self.watch_link(otg, line, platform);
        if is_working.is_ok_and(|it| it)
            && self.packet.is_empty()
            && !self.owes_line_end
            && self.is_configured
        {
            endpoints::arm_data(otg);
        }
        self.posted.is_some() && self.mailbox.answer().is_none()
    }

    /// Brings the core to work, a step in each run. Returns whether it works.
    fn advance(&mut self, otg: &mut impl Registers) -> Result<bool, Stuck> {
        self.stage = match self.stage {
            Stage::Off(MOST_RUNS) | Stage::Resetting(MOST_RUNS) | Stage::Flushing(MOST_RUNS) => {
                return Err(Stuck);
            }
            Stage::Off(runs) => {
                power(otg);
                if otg.read(GRSTCTL) & AHBIDL == 0 {
                    Stage::Off(runs + 1)
                } else {
                    otg.write(GRSTCTL, CSRST);
                    Stage::Resetting(0)
                }
            }
            Stage::Resetting(runs) if otg.read(GRSTCTL) & (CSRST | AHBIDL) != AHBIDL => {
                Stage::Resetting(runs + 1)
            }
            Stage::Resetting(_) => {
                power(otg);
                make_device(otg);
                Stage::Disconnected(0)
            }
            Stage::Disconnected(RUNS_TO_CONNECTION) => {
                set_up(otg);
                self.flush(otg)
            }
            Stage::Disconnected(runs) => {
                if runs == RUNS_TO_DEVICE_MODE {
                    otg.write(DCTL, SDIS);
                    validate_session(otg);
                }
                Stage::Disconnected(runs + 1)
            }
            Stage::Connected => {
                if otg.read(GINTSTS) & USBRST == 0 {
                    return Ok(true);
                }
                disable(otg);
                Stage::Disabling
            }
            Stage::Disabling => self.flush(otg),
            Stage::Flushing(runs) if otg.read(GRSTCTL) & (TXFFLSH | RXFFLSH) != 0 => {
                Stage::Flushing(runs + 1)
            }
            Stage::Flushing(_) => {
                self.begin_session(otg);
                Stage::Connected
            }
        };
        Ok(false)
    }

    /// Begins to flush the FIFOs. What was on the way is void.
    fn flush(&mut self, otg: &mut impl Registers) -> Stage {
        otg.write(GRSTCTL, RXFFLSH | TXFFLSH | ALL_FIFOS << TXFNUM);
        (self.is_configured, self.is_open) = (false, false);
        (self.has_setup, self.control_packet) = (false, None);
        (self.control_withdrawal, self.data_withdrawal) = (Withdrawal::Done, Withdrawal::Done);
        (self.owes_packet, self.is_closed) = (false, false);
        Stage::Flushing(0)
    }

    /// Begins anew with an address of 0 and without a configuration, and connects, if it has not yet.
    fn begin_session(&mut self, otg: &mut impl Registers) {
        otg.write(GINTSTS, USBRST | ENUMDNE | USBSUSP | WKUPINT);
        endpoints::accept_setup(otg);
        otg.write(diepint(0), u32::MAX);
        otg.write(DCTL, CGINAK_CGONAK);
        self.post(ControlEvent::Reset);
    }

    fn post(&mut self, event: ControlEvent) {
        self.mailbox.post(event);
        self.posted = Some(event);
    }

    /// Moves packets, those of endpoint 0 alone where there is an answer. Returns true.
    fn work(
        &mut self,
        otg: &mut impl Registers,
        line: &mut SenderQueues<'_, '_, '_>,
        platform: &mut impl Platform,
    ) -> Result<bool, Stuck> {
        let had_setup = self.has_setup;
        if self.posted.is_some() && self.mailbox.answer().is_some() {
            self.receive_control(otg);
            // A SETUP that has come just now has no answer yet.
            if self.is_control_free(otg, had_setup)?
                && let Some(answer) = self.mailbox.answer()
            {
                self.answer(answer, otg, line, platform);
            }
            return Ok(true);
        }
        if next_entry(otg).is_some_and(is_data) {
            self.receive_data(otg, line, platform);
        } else {
            self.receive_control(otg);
        }
        if self.is_control_free(otg, had_setup)? && self.posted.is_none() {
            self.post_control(otg);
        }
        if self.data_withdrawal.advance(otg, DATA_ENDPOINT)? && self.is_configured {
            self.send(otg, line, platform);
        }
        Ok(true)
    }

    /// Returns whether endpoint 0 may have an answer: a SETUP voids that to what came before.
    fn is_control_free(
        &mut self,
        otg: &mut impl Registers,
        had_setup: bool,
    ) -> Result<bool, Stuck> {
        if had_setup && self.has_setup {
            // The later cores may send no end of it.
            self.post_setup(otg);
        }
        Ok(self.control_withdrawal.advance(otg, 0)? && !self.has_setup)
    }

    /// Takes a packet of data and its end out of the receive FIFO.
    fn receive_data(
        &mut self,
        otg: &mut impl Registers,
        line: &mut SenderQueues<'_, '_, '_>,
        platform: &mut impl Platform,
    ) {
        let length = packet_bytes(otg.read(GRXSTSP));
        self.is_closed = false;
        let (requests, received) = (line.requests, &mut *line.received);
        self.packet.fill(length, otg, requests, received, platform);
        if next_entry(otg).is_some_and(is_end_of_data) {
            otg.read(GRXSTSP);
        }
    }

    /// Takes what comes before a packet of data.
    fn receive_control(&mut self, otg: &mut impl Registers) {
        // wcet-bound: MOST_FIFO_ENTRIES: each run takes an entry
        for _ in 0..MOST_FIFO_ENTRIES {
            if next_entry(otg).is_none_or(is_data) {
                return;
            }
            self.take_control(otg);
        }
    }

    /// Takes an entry that is no packet of data.
    fn take_control(&mut self, otg: &mut impl Registers) {
        let status = otg.read(GRXSTSP);
        let length = packet_bytes(status);
        match kind(status) {
            (entry::SETUP, _) => {
                self.put(otg, length);
                self.control_packet = None;
                self.has_setup = true;
            }
            (entry::SETUP_DONE, _) if self.has_setup => self.post_setup(otg),
            (entry::DATA, _) => {
                self.put(otg, length);
                self.control_packet = Some(length);
            }
            _ => {}
        }
    }

    /// Moves a packet of endpoint 0 into the mailbox.
    fn put(&mut self, otg: &mut impl Registers, length: usize) {
        // wcet-bound: PACKET_WORDS: the words of a packet
        for index in 0..length.div_ceil(4) {
            self.mailbox.put(index, otg.read(fifo(0)));
        }
    }

    /// Posts a SETUP, which ends the transfer before it.
    fn post_setup(&mut self, otg: &mut impl Registers) {
        self.has_setup = false;
        self.control_packet = None;
        otg.write(diepint(0), XFRC);
        self.control_withdrawal.begin(otg, 0);
        self.post(ControlEvent::Setup);
    }

    /// Posts what else has happened on endpoint 0.
    fn post_control(&mut self, otg: &mut impl Registers) {
        if otg.read(diepint(0)) & XFRC != 0 {
            otg.write(diepint(0), XFRC);
            self.post(ControlEvent::In);
        } else if let Some(bytes) = self.control_packet.take() {
            self.post(ControlEvent::Out(bytes));
        }
    }

    /// Does what the answer of `usb_control` says.
    fn answer(
        &mut self,
        answer: Answer,
        otg: &mut impl Registers,
        line: &mut SenderQueues<'_, '_, '_>,
        platform: &mut impl Platform,
    ) {
        let event = self.posted.take();
        let configuration = otg.read(DCFG) & !DAD;
        otg.write(DCFG, configuration | answer.address() << 4);
        self.configure(otg, answer);
        self.set_open(otg, answer.has(Answer::IS_OPEN), line, platform);
        if answer.has(Answer::STALLS) {
            endpoints::stall_control(otg);
            endpoints::accept_setup(otg);
            return;
        }
        if let Some(bytes) = answer.packet() {
            endpoints::begin_packet(otg, 0, bytes);
            // wcet-bound: PACKET_WORDS: the words of a packet
            for word in self.mailbox.to_send().take(bytes.div_ceil(4)) {
                otg.write(fifo(0), word);
            }
        }
        if event != Some(ControlEvent::Reset) {
            endpoints::arm_control(otg);
        }
    }

    /// Begins or ends a configuration, and halts endpoints.
    fn configure(&mut self, otg: &mut impl Registers, answer: Answer) {
        let is_configured = answer.has(Answer::IS_CONFIGURED);
        if is_configured && answer.has(Answer::CONFIGURES) {
            endpoints::configure(otg);
            self.data_withdrawal.begin(otg, DATA_ENDPOINT);
            self.owes_packet = false;
        } else if !is_configured && self.is_configured {
            endpoints::deconfigure(otg);
        }
        self.is_configured = is_configured;
        for (endpoint, is_in) in [
            (DATA_ENDPOINT, false),
            (DATA_ENDPOINT, true),
            (super::NOTIFICATION_ENDPOINT, true),
        ] {
            let bit = halt_bit(endpoint, is_in);
            if answer.has(bit << Answer::HALT_CHANGED) {
                let control = if is_in {
                    diepctl(endpoint)
                } else {
                    doepctl(endpoint)
                };
                endpoints::set_halt(otg, control, answer.has(bit << Answer::HALTED));
            }
        }
    }

    /// Notes whether the host's program has the port open. A new one is welcomed.
    fn set_open(
        &mut self,
        otg: &mut impl Registers,
        is_open: bool,
        line: &mut SenderQueues<'_, '_, '_>,
        platform: &mut impl Platform,
    ) {
        if is_open == self.is_open {
            return;
        }
        self.is_open = is_open;
        self.is_closed = !is_open;
        if is_open {
            line.requests.request_greeting();
            platform.pend(Task::Wake);
        } else {
            self.data_withdrawal.begin(otg, DATA_ENDPOINT);
            self.lose_link(line, platform);
        }
    }

    /// Sends the next packet, if the host has fetched the one before.
    fn send(
        &mut self,
        otg: &mut impl Registers,
        line: &mut SenderQueues<'_, '_, '_>,
        platform: &mut impl Platform,
    ) {
        let before = line.sent.len();
        let is_wanted = before != 0 || self.owes_packet;
        if !self.is_linked
            || self.is_closed
            || !is_wanted
            || endpoints::is_sending(otg, DATA_ENDPOINT)
        {
            return;
        }
        let length = before.min(PACKET_BYTES);
        endpoints::begin_packet(otg, DATA_ENDPOINT, length);
        let mut number = line.sent.oldest();
        // wcet-bound: PACKET_WORDS: the words of a packet
        for _ in 0..length.div_ceil(4) {
            // The core sends nothing of what is behind the last byte.
            let bytes = array::from_fn(|index| line.sent.peek(number.wrapping_add(index)));
            otg.write(fifo(DATA_ENDPOINT), u32::from_le_bytes(bytes));
            number = number.wrapping_add(4);
        }
        line.sent.consume(length);
        self.owes_packet = length == PACKET_BYTES;
        tasks::serial_tx(before, line.sent.len(), line.requests, platform);
    }

    /// Notes whether the host listens, and drops the output where nobody does.
    fn watch_link(
        &mut self,
        otg: &mut impl Registers,
        line: &mut SenderQueues<'_, '_, '_>,
        platform: &mut impl Platform,
    ) {
        let is_suspended = otg.read(DSTS) & SUSPSTS != 0;
        let is_linked = self.stage == Stage::Connected && self.is_configured && !is_suspended;
        if self.is_linked && !is_linked {
            if self.stage == Stage::Connected {
                self.data_withdrawal.begin(otg, DATA_ENDPOINT);
            }
            self.lose_link(line, platform);
        }
        self.is_linked = is_linked;
        if !is_linked || self.is_closed {
            let before = line.sent.len();
            line.sent.consume(before);
            self.owes_packet = false;
            tasks::serial_tx(before, 0, line.requests, platform);
        }
        if self.owes_line_end && self.packet.is_empty() {
            self.owes_line_end = false;
            self.packet.end_line(line.requests, line.received);
        }
    }

    /// The sender is gone: its last line may have no end.
    fn lose_link(&mut self, line: &SenderQueues<'_, '_, '_>, platform: &mut impl Platform) {
        self.owes_line_end = true;
        line.requests.report_link_loss();
        platform.pend(Task::Wake);
    }
}

/// Returns the status of the oldest entry of the receive FIFO, which stays.
fn next_entry(otg: &mut impl Registers) -> Option<u32> {
    (otg.read(GINTSTS) & RXFLVL != 0).then(|| otg.read(GRXSTSR))
}

/// Returns the kind of an entry by its status, and its endpoint.
const fn kind(status: u32) -> (u32, u32) {
    (status >> 17 & 0xf, status & 0xf)
}

/// Returns whether an entry is a packet of data.
const fn is_data(status: u32) -> bool {
    matches!(kind(status), (entry::DATA, 1..))
}

/// Returns whether an entry is the end of a transfer of data.
const fn is_end_of_data(status: u32) -> bool {
    matches!(kind(status), (entry::OUT_DONE, 1..))
}

/// Returns the bytes of the packet of an entry of the receive FIFO.
fn packet_bytes(status: u32) -> usize {
    ((status >> 4 & 0x7ff) as usize).min(PACKET_BYTES)
}

/// Switches the transceiver on. The session is not valid yet, so that the host does not see a device that has no set-up.
fn power(otg: &mut impl Registers) {
    otg.write(GCCFG, PWRDWN);
    otg.write(GOTGCTL, BVALOEN);
}

/// Has the session count as valid, as no pin senses the bus voltage.
fn validate_session(otg: &mut impl Registers) {
    if otg.read(CID) < VERSION_2 {
        otg.write(GCCFG, PWRDWN | NOVBUSSENS);
    } else {
        otg.write(GOTGCTL, BVALOEN | BVALOVAL);
    }
}

/// Begins to make a device of the core after its reset.
fn make_device(otg: &mut impl Registers) {
    // The turnaround time for a bus of 32 MHz and more: RM0090 table 206.
    otg.write(GUSBCFG, PHYSEL | FDMOD | 6 << TRDT);
    otg.write(PCGCCTL, 0);
}

/// Sets the device up, still off the bus. Nothing interrupts.
fn set_up(otg: &mut impl Registers) {
    otg.write(GAHBCFG, 0);
    otg.write(GINTMSK, 0);
    otg.write(DCFG, FULL_SPEED);
    otg.write(GRXFSIZ, RECEIVE_WORDS);
    let mut start = RECEIVE_WORDS;
    let sizes = [
        (DIEPTXF0, CONTROL_WORDS),
        (dieptxf(DATA_ENDPOINT), DATA_WORDS),
        (dieptxf(super::NOTIFICATION_ENDPOINT), NOTIFICATION_WORDS),
    ];
    for (register, words) in sizes {
        otg.write(register, words << 16 | start);
        start += words;
    }
}

/// Disables all endpoints at a reset of the bus.
fn disable(otg: &mut impl Registers) {
    otg.write(GINTSTS, USBRST);
    let configuration = otg.read(DCFG) & !DAD;
    otg.write(DCFG, configuration);
    for endpoint in [0, DATA_ENDPOINT, super::NOTIFICATION_ENDPOINT] {
        let mut withdrawal = Withdrawal::Done;
        withdrawal.begin(otg, endpoint);
    }
    for endpoint in [0, DATA_ENDPOINT] {
        otg.write(doepctl(endpoint), SNAK);
    }
}
