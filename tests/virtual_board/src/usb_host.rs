//! A host at the other end of a USB cable: it enumerates a device, opens its port, and carries the bytes of a sender.
//!
//! `otg::Host` waits for a device by calling. Here the device is a chip whose time passes elsewhere, so the host has a
//! thread of its own; the core is with one of both at a time, and what they do has an order.

use std::{
    collections::VecDeque,
    sync::mpsc::{Receiver, Sender, channel},
};

use otg::{Core, Host, HostError, PACKET_BYTES, Silicon, System};
use usbip::Server;

/// How often the host runs, µs: the shortest period that a driver may have, for which `otg::Host` waits.
pub(crate) const PERIOD_US: u64 = 500;
/// Periods of a frame, and the packets of 64 bytes for which a frame has room: USB 2.0, table 5-9.
const FRAME_PERIODS: usize = 2;
const FRAME_PACKETS: usize = 19;
/// Periods without a start of frame after which a device is suspended, 3 ms: USB 2.0 7.1.7.6.
const SUSPEND_PERIODS: usize = 6;
/// Periods for which a resume is signalled, 20 ms: USB 2.0 7.1.7.7.
const RESUME_PERIODS: usize = 40;

/// What somebody does at the host.
#[derive(Debug, Clone, Copy, PartialEq, Eq)]
pub(crate) enum HostAction {
    /// The bus is reset, and the device set up as by a system.
    Enumerate(System),
    /// A program opens the port.
    Open,
    /// It closes the port.
    Close,
    /// The host sends no start of frame any more: it sleeps, or the cable is out.
    Suspend,
    /// It does again.
    Resume,
}

/// The bytes at the host, and what it is to do.
#[derive(Debug)]
pub(crate) struct Port {
    system: System,
    pub(crate) actions: VecDeque<HostAction>,
    pub(crate) is_open: bool,
    /// Bytes to the device, and from it.
    pub(crate) outgoing: VecDeque<u8>,
    pub(crate) incoming: Vec<u8>,
    /// Resets of the chip.
    pub(crate) chip_resets: usize,
    /// What the host has missed.
    pub(crate) faults: Vec<String>,
}

impl Port {
    /// Whether the host takes more bytes of its program.
    pub(crate) fn has_room(&self) -> bool {
        self.is_open && self.outgoing.len() < FRAME_PACKETS * PACKET_BYTES
    }

    /// Bytes that wait are lost.
    pub(crate) fn close(&mut self) {
        self.is_open = false;
        self.outgoing.clear();
    }
}

/// What goes to and fro between the chip and the host.
type Handover = (Core, Port);

/// A cable with a host.
#[derive(Debug)]
pub(crate) struct Cable {
    pub(crate) port: Port,
    silicon: Silicon,
    to_host: Sender<Handover>,
    from_host: Receiver<Handover>,
}

impl Cable {
    /// A cable from a chip of some silicon to a host with some system.
    pub(crate) fn new(system: System, silicon: Silicon) -> Self {
        Self::to(silicon, system, Bus::live)
    }

    /// A cable to this computer, which has clients elsewhere.
    pub(crate) fn exported(server: Server, silicon: Silicon) -> Self {
        Self::to(silicon, System::Linux, |bus| bus.export(server))
    }

    fn to(silicon: Silicon, system: System, host: impl FnOnce(Bus) + Send + 'static) -> Self {
        let (to_host, from_chip) = channel();
        let (to_chip, from_host) = channel();
        let bus = Bus {
            port: Port::of(system),
            silicon,
            from_chip,
            to_chip,
            is_alone: false,
        };
        std::thread::spawn(move || host(bus));
        Self {
            port: Port::of(system),
            silicon,
            to_host,
            from_host,
        }
    }

    /// The host runs for a period.
    pub(crate) fn run_host(&mut self, core: &mut Core) {
        let of_host = std::mem::replace(core, Core::new(self.silicon));
        let port = std::mem::replace(&mut self.port, Port::of(System::Linux));
        let sent = self.to_host.send((of_host, port));
        let back = sent.ok().and_then(|()| self.from_host.recv().ok());
        (*core, self.port) = back.expect("the host lives as long as the cable");
    }
}

impl Port {
    fn of(system: System) -> Self {
        Self {
            system,
            actions: VecDeque::new(),
            is_open: false,
            outgoing: VecDeque::new(),
            incoming: Vec::new(),
            chip_resets: 0,
            faults: Vec::new(),
        }
    }
}

/// The host's end of the cable.
struct Bus {
    port: Port,
    silicon: Silicon,
    from_chip: Receiver<Handover>,
    to_chip: Sender<Handover>,
    /// Nobody is at the other end.
    is_alone: bool,
}

impl Bus {
    /// Ends the period, and waits for the next.
    fn wait(&mut self, core: &mut Core) {
        let of_chip = std::mem::replace(core, Core::new(self.silicon));
        let port = std::mem::replace(&mut self.port, Port::of(System::Linux));
        if self.to_chip.send((of_chip, port)).is_ok() {
            self.begin(core);
        } else {
            self.is_alone = true;
        }
    }

    fn begin(&mut self, core: &mut Core) {
        match self.from_chip.recv() {
            Ok(handover) => (*core, self.port) = handover,
            Err(_) => self.is_alone = true,
        }
    }

    fn wait_for(&mut self, core: &mut Core, periods: usize) {
        for _ in 0..periods {
            self.wait(core);
        }
    }

    /// Sets up whatever is plugged in, and serves it as long as it is there.
    fn live(mut self) {
        let mut core = Core::new(self.silicon);
        let mut host = Host::default();
        self.begin(&mut core);
        while !self.is_alone {
            self.port.close();
            while let Some(action) = self.port.actions.pop_front() {
                if let HostAction::Enumerate(system) = action {
                    self.port.system = system;
                }
            }
            if core.is_connected() {
                self.serve(&mut host, &mut core);
            } else {
                self.wait(&mut core);
            }
        }
    }

    /// Sets the device up and serves it, until it is to be set up anew.
    fn serve(&mut self, host: &mut Host, core: &mut Core) {
        let resets = self.port.chip_resets;
        let system = self.port.system;
        let enumerated = host.enumerate(core, system, &mut |core| self.wait(core));
        self.judge(resets, core, "enumerate", enumerated);
        self.port.is_open = enumerated.is_ok();
        let (mut period, mut room, mut is_suspended) = (0, 0, false);
        while enumerated.is_ok() && self.is_there(resets, core) {
            let action = self.port.actions.front().copied();
            if let Some(HostAction::Enumerate(_)) = action {
                return;
            }
            self.port.actions.pop_front();
            if let Some(action) = action {
                is_suspended |= action == HostAction::Suspend;
                is_suspended &= action != HostAction::Resume;
                self.act(action, host, core);
            }
            if period % FRAME_PERIODS == 0 {
                room = FRAME_PACKETS;
            }
            if self.port.is_open && !is_suspended {
                room -= self.carry(host, core, room);
            }
            period += 1;
            self.wait(core);
        }
        // A host tries again, and not at once.
        self.wait(core);
    }

    /// Has clients elsewhere use whatever is plugged in, as long as it is there.
    fn export(mut self, mut server: Server) {
        let mut core = Core::new(self.silicon);
        self.begin(&mut core);
        while !self.is_alone {
            self.wait(&mut core);
            if !core.is_connected() {
                continue;
            }
            let resets = self.port.chip_resets;
            let mut answered = server.plug(&mut core, &mut |core| self.wait(core));
            while answered.is_ok() && self.is_there(resets, &core) {
                answered = server.read(&mut core, &mut |core| self.wait(core));
                server.run(&mut core, &mut |_| ());
                server.write(&mut core);
                for (word, sentence) in server.events.drain(..) {
                    println!("{word} {sentence}");
                }
                self.wait(&mut core);
            }
            server.detach(&mut core, "the device is off the bus");
        }
    }

    fn is_there(&self, resets: usize, core: &Core) -> bool {
        !self.is_alone && core.is_connected() && self.port.chip_resets == resets
    }

    /// What fails with a device that has not been reset meanwhile is its fault.
    fn judge(&mut self, resets: usize, core: &Core, what: &str, result: Result<(), HostError>) {
        if let Err(error) = result
            && self.is_there(resets, core)
        {
            let system = self.port.system;
            let fault = format!("USB: {system:?} cannot {what}: {error:?}");
            self.port.faults.push(fault);
        }
    }

    fn act(&mut self, action: HostAction, host: &mut Host, core: &mut Core) {
        let resets = self.port.chip_resets;
        let system = self.port.system;
        match action {
            HostAction::Enumerate(_) => {}
            HostAction::Open => {
                let opened = host.open(core, system, &mut |core| self.wait(core));
                self.judge(resets, core, "open the port", opened);
                self.port.is_open = opened.is_ok();
            }
            HostAction::Close => {
                self.port.close();
                let closed = host.set_lines(core, 0, &mut |core| self.wait(core));
                self.judge(resets, core, "close the port", closed);
            }
            HostAction::Suspend => {
                self.wait_for(core, SUSPEND_PERIODS);
                core.suspend(true);
            }
            HostAction::Resume => {
                core.suspend(false);
                self.wait_for(core, RESUME_PERIODS);
            }
        }
    }

    /// Moves bytes as long as the frame has room and the device takes and has some. Returns the packets.
    fn carry(&mut self, host: &mut Host, core: &mut Core, room: usize) -> usize {
        let mut packets = 0;
        let mut is_taken = true;
        while is_taken && packets < room && !self.port.outgoing.is_empty() {
            let length = self.port.outgoing.len().min(PACKET_BYTES);
            let packet: Vec<u8> = self.port.outgoing.iter().copied().take(length).collect();
            is_taken = host.offer(core, &packet);
            if is_taken {
                self.port.outgoing.drain(..length);
                packets += 1;
            }
        }
        while packets < room
            && let Some(packet) = host.take(core)
        {
            self.port.incoming.extend(packet);
            packets += 1;
        }
        packets
    }
}
