//! Transfers as transactions on the bus: what the host controller of a computer does. USB 2.0, chapters 5, 8 and 9.

use std::collections::{BTreeMap, VecDeque};

use otg::{Core, FromDevice, Handshake, PACKET_BYTES};

/// Why a transfer has failed, as Linux numbers it: `errno` with a minus.
const STALLED: i32 = -32;
const NO_ANSWER: i32 = -71;
const TOO_LONG: i32 = -75;
pub(crate) const UNLINKED: i32 = -104;
const TOO_SHORT: i32 = -121;

/// Flags of a transfer: a short packet is an error; a full last packet is followed by an empty one.
const SHORT_NOT_OK: u32 = 0x01;
const ZERO_PACKET: u32 = 0x40;

/// Periods in a row without an answer of the device that end a transfer, as host controllers have it.
const MOST_UNANSWERED: u8 = 3;
/// Endpoints of each direction that USB has.
const ENDPOINTS: usize = 16;

/// Requests that change what the host knows of its device.
const TO_DEVICE: u8 = 0x00;
const TO_INTERFACE: u8 = 0x01;
const TO_ENDPOINT: u8 = 0x02;
const CLEAR_FEATURE: u8 = 1;
const SET_ADDRESS: u8 = 5;
const SET_CONFIGURATION: u8 = 9;
const SET_INTERFACE: u8 = 11;

/// A transfer as a driver submits it.
#[derive(Debug, Clone, PartialEq, Eq)]
pub(crate) struct Urb {
    pub(crate) number: u32,
    pub(crate) is_in: bool,
    pub(crate) endpoint: usize,
    pub(crate) flags: u32,
    /// The request, on endpoint 0.
    pub(crate) setup: [u8; 8],
    /// Bytes that it moves, at most.
    pub(crate) length: usize,
    /// To the device; from it, what has come.
    pub(crate) data: Vec<u8>,
}

impl Urb {
    fn is_control(&self) -> bool {
        self.endpoint == 0
    }

    /// Bytes that a request wants to move.
    fn requested(&self) -> usize {
        u16::from_le_bytes([self.setup[6], self.setup[7]]).into()
    }

    /// Whether its data come from the device; without data, a request is answered as after data to the device.
    fn reads(&self) -> bool {
        if self.is_control() {
            self.setup[0] & 0x80 != 0 && self.requested() != 0
        } else {
            self.is_in
        }
    }

    /// Bytes that it moves at most.
    fn wanted(&self) -> usize {
        if self.is_control() {
            self.length.min(self.requested())
        } else {
            self.length
        }
    }
}

/// A transfer that has ended.
#[derive(Debug)]
pub(crate) struct Finished {
    pub(crate) urb: Urb,
    pub(crate) status: i32,
    /// Bytes that it has moved.
    pub(crate) moved: usize,
}

/// Part of a transfer.
#[derive(Debug, Clone, Copy, PartialEq, Eq)]
enum Stage {
    Setup,
    Data,
    Status,
}

/// What becomes of a transfer at a transaction.
#[derive(Debug, PartialEq, Eq)]
enum Outcome {
    Goes,
    /// The device has refused: it is asked again in the next period.
    Waits,
    Ends(i32),
}

/// A transfer under way.
#[derive(Debug)]
struct Transfer {
    urb: Urb,
    stage: Stage,
    moved: usize,
    /// Of the next packet of endpoint 0.
    toggle: bool,
    unanswered: u8,
}

/// What a host knows of its device.
#[derive(Debug, Default)]
struct HostState {
    address: u8,
    /// Of the next packets to the endpoints, and from them.
    to: [bool; ENDPOINTS],
    from: [bool; ENDPOINTS],
}

/// The transfers of a host with its device.
#[derive(Debug, Default)]
pub(crate) struct Transfers {
    known: HostState,
    /// By endpoint and direction: each of them has its turn.
    queues: BTreeMap<(usize, bool), VecDeque<Transfer>>,
}

impl Transfers {
    /// None, with a device that has an address and no configuration.
    pub(crate) fn new(address: u8) -> Self {
        let known = HostState {
            address,
            ..HostState::default()
        };
        Self {
            known,
            queues: BTreeMap::new(),
        }
    }

    /// How many wait.
    pub(crate) fn count(&self) -> usize {
        self.queues.values().map(VecDeque::len).sum()
    }

    /// Begins a transfer behind those of its endpoint.
    pub(crate) fn submit(&mut self, urb: Urb) {
        let queue = (urb.endpoint, urb.is_in && !urb.is_control());
        let transfer = Transfer {
            stage: if urb.is_control() {
                Stage::Setup
            } else {
                Stage::Data
            },
            urb,
            moved: 0,
            toggle: true,
            unanswered: 0,
        };
        self.queues.entry(queue).or_default().push_back(transfer);
    }

    /// Gives a transfer up. Returns false if it has ended.
    pub(crate) fn unlink(&mut self, number: u32) -> bool {
        let before = self.count();
        for queue in self.queues.values_mut() {
            queue.retain(|transfer| transfer.urb.number != number);
        }
        self.count() < before
    }

    /// Does what is possible within a period. Returns the transfers that have ended.
    pub(crate) fn step(&mut self, core: &mut Core) -> Vec<Finished> {
        let mut ended = Vec::new();
        for queue in self.queues.values_mut() {
            while let Some(transfer) = queue.front_mut() {
                let status = match transfer.transact(core, &mut self.known) {
                    Outcome::Goes => continue,
                    Outcome::Waits => break,
                    Outcome::Ends(status) => status,
                };
                let transfer = queue.pop_front();
                ended.extend(transfer.map(|Transfer { urb, moved, .. }| Finished {
                    urb,
                    status,
                    moved,
                }));
            }
        }
        ended
    }
}

impl HostState {
    /// The device has carried a request out.
    fn follow(&mut self, setup: [u8; 8]) {
        match (setup[0], setup[1]) {
            (TO_DEVICE, SET_ADDRESS) => self.address = setup[2],
            (TO_DEVICE, SET_CONFIGURATION) | (TO_INTERFACE, SET_INTERFACE) => {
                (self.to, self.from) = ([false; ENDPOINTS], [false; ENDPOINTS]);
            }
            (TO_ENDPOINT, CLEAR_FEATURE) => {
                let is_in = setup[4] & 0x80 != 0;
                let toggles = if is_in { &mut self.from } else { &mut self.to };
                toggles[usize::from(setup[4]) % ENDPOINTS] = false;
            }
            _ => {}
        }
    }
}

impl Transfer {
    /// Makes the next transaction.
    fn transact(&mut self, core: &mut Core, known: &mut HostState) -> Outcome {
        let number = self.urb.endpoint;
        if number >= ENDPOINTS {
            return Outcome::Ends(NO_ANSWER);
        }
        let progress = match (self.stage, self.urb.reads()) {
            (Stage::Setup, _) => self.begin(core, known.address),
            (Stage::Data, true) if number == 0 => self.fetch(core, known.address, None),
            (Stage::Data, false) if number == 0 => self.give(core, known.address, None),
            (Stage::Data, true) => self.fetch(core, known.address, Some(&mut known.from[number])),
            (Stage::Data, false) => self.give(core, known.address, Some(&mut known.to[number])),
            (Stage::Status, true) => {
                let handshake = core.out(known.address, 0, true, &[]);
                self.after(handshake, Outcome::Ends(0))
            }
            (Stage::Status, false) => match core.fetch(known.address, 0) {
                FromDevice::Packet(..) => Outcome::Ends(0),
                FromDevice::Refusal(handshake) => self.after(handshake, Outcome::Ends(0)),
            },
        };
        match progress {
            Outcome::Ends(0) if self.stage == Stage::Data && number == 0 => {
                self.stage = Stage::Status;
                Outcome::Goes
            }
            Outcome::Ends(0) if number == 0 => {
                known.follow(self.urb.setup);
                Outcome::Ends(0)
            }
            progress => progress,
        }
    }

    /// Returns what follows from the device's handshake, if that is not a refusal.
    fn after(&mut self, handshake: Handshake, taken: Outcome) -> Outcome {
        let unanswered = std::mem::take(&mut self.unanswered) + 1;
        match handshake {
            Handshake::Ack => taken,
            Handshake::Nak => Outcome::Waits,
            Handshake::Stall => Outcome::Ends(STALLED),
            Handshake::Silence if unanswered >= MOST_UNANSWERED => Outcome::Ends(NO_ANSWER),
            Handshake::Silence => {
                self.unanswered = unanswered;
                Outcome::Waits
            }
        }
    }

    /// Sends the request.
    fn begin(&mut self, core: &mut Core, address: u8) -> Outcome {
        let handshake = core.setup(address, self.urb.setup);
        let progress = self.after(handshake, Outcome::Goes);
        if progress == Outcome::Goes {
            self.stage = if self.urb.wanted() == 0 {
                Stage::Status
            } else {
                Stage::Data
            };
        }
        progress
    }

    /// Fetches a packet; endpoint 0 has its toggle in the transfer.
    fn fetch(&mut self, core: &mut Core, address: u8, toggle: Option<&mut bool>) -> Outcome {
        let (with, bytes) = match core.fetch(address, self.urb.endpoint) {
            FromDevice::Packet(with, bytes) => (with, bytes),
            FromDevice::Refusal(handshake) => {
                return self.after(handshake, Outcome::Goes);
            }
        };
        self.unanswered = 0;
        let toggle = toggle.unwrap_or(&mut self.toggle);
        if with != *toggle {
            // The packet before, again.
            return Outcome::Waits;
        }
        *toggle = !*toggle;
        let wanted = self.urb.wanted();
        let is_short = bytes.len() < PACKET_BYTES;
        if bytes.len() > wanted - self.moved {
            return Outcome::Ends(TOO_LONG);
        }
        self.urb.data.extend_from_slice(&bytes);
        self.moved = self.urb.data.len();
        if self.moved == wanted {
            Outcome::Ends(0)
        } else if !is_short {
            Outcome::Goes
        } else if self.urb.flags & SHORT_NOT_OK == 0 {
            Outcome::Ends(0)
        } else {
            Outcome::Ends(TOO_SHORT)
        }
    }

    /// Sends a packet; endpoint 0 has its toggle in the transfer.
    fn give(&mut self, core: &mut Core, address: u8, toggle: Option<&mut bool>) -> Outcome {
        let rest = &self.urb.data[self.moved..self.urb.wanted().min(self.urb.data.len())];
        let packet = &rest[..rest.len().min(PACKET_BYTES)];
        let is_last = packet.len() == rest.len();
        let ends_empty = self.urb.flags & ZERO_PACKET != 0 && !self.urb.is_control();
        let owes_empty = packet.len() == PACKET_BYTES && ends_empty;
        let bytes = packet.len();
        let with = toggle.as_deref().copied().unwrap_or(self.toggle);
        let handshake = core.out(address, self.urb.endpoint, with, packet);
        let progress = self.after(handshake, Outcome::Goes);
        if progress == Outcome::Goes {
            let toggle = toggle.unwrap_or(&mut self.toggle);
            *toggle = !*toggle;
            self.moved += bytes;
            if is_last && !owes_empty {
                return Outcome::Ends(0);
            }
        }
        progress
    }
}
