//! A board with its firmware on the bench, for a script or for somebody's sender.

use std::{
    collections::BTreeMap,
    net::TcpListener,
    sync::{
        Arc,
        atomic::{AtomicBool, Ordering},
    },
    time::{Duration, Instant},
};

use anyhow::{Context as _, Result};
use board_data::{Board, Input, Wiring};
use rigless::{
    chip::uart::TcpPeer,
    emulator::{self, Driver, Host, Settled, Start, Stop},
    image::Image,
    machine::Board as _,
    session::Session,
    time::VirtualNanos,
};
use signal_hook::consts::{SIGINT, SIGTERM};
use usbip::Server;

use crate::{
    bootloader,
    chip::FittedParts,
    machine::{Machine, WIRE},
    plant::{Closes, Plant, Step},
    program::Program,
    run::{Outcome, Run, STOP_INTERVAL_NS},
    script::Act,
    sender::Sender,
    unmodelled,
};

/// How long an erasure takes on a board that is served: a sector of 16 KiB takes about as long (data sheets, `t_ERASE16KB`).
const SERVED_ERASE_NS: u64 = 250_000_000;

/// What leads to the sender.
#[derive(Debug, Clone, Copy, PartialEq, Eq)]
pub(crate) enum Link {
    /// A serial port of the chip.
    Uart,
    /// The OTG full-speed core of the chip.
    Usb,
}

/// What serves that link to somebody's sender.
#[derive(Debug)]
pub(crate) enum Line {
    /// Bytes at a TCP address.
    Tcp(TcpPeer),
    /// A USB device, which clients attach.
    UsbIp(Server),
}

/// A board and its firmware.
#[derive(Debug)]
pub(crate) struct Bench {
    pub(crate) board: Board,
    pub(crate) axes: usize,
    pub(crate) program: Program,
    /// The firmware, what the chip's maker has written, and bootloaders.
    pub(crate) images: Vec<Image>,
    /// The vectors out of a reset: the firmware's, or the bootloaders'.
    pub(crate) boot: u32,
    /// Every line from the firmware is shown.
    pub(crate) shows_lines: bool,
}

impl Bench {
    pub(crate) fn wiring(&self) -> Result<&Wiring> {
        let wiring = self.board.wiring(self.axes);
        wiring.with_context(|| format!("{} has no {} axes", self.board.name, self.axes))
    }

    /// What leads to the sender.
    pub(crate) fn link(&self) -> Link {
        if self.board.has_usb() {
            Link::Usb
        } else {
            Link::Uart
        }
    }

    /// Where the firmware's vectors are.
    pub(crate) fn vectors(&self) -> u32 {
        self.board.memory(self.axes).flash_start
    }

    /// Handlers of the chip's interrupts by number, with their names: all but the default handler.
    pub(crate) fn handlers(&self) -> BTreeMap<usize, (u64, String)> {
        let vectors = (0..bootloader::MOST_INTERRUPTS).map_while(|number| {
            let at = u64::from(self.vectors()) + 64 + 4 * number as u64;
            Some((number, u64::from(self.program.word(at)?) & !1))
        });
        let vectors: Vec<_> = vectors.collect();
        let count = |of: u64| vectors.iter().filter(|(_, it)| *it == of).count();
        let common = { vectors.iter().map(|it| it.1) }.max_by_key(|&it| count(it));
        let own = vectors
            .iter()
            .filter(|(_, it)| *it != 0 && Some(*it) != common);
        own.map(|&(number, handler)| {
            let name = self.program.name_at(handler).unwrap_or("a handler");
            (number, (handler, name.to_owned()))
        })
        .collect()
    }

    /// Handlers that must not run before memory is initialised: those, and `SysTick`'s and `PendSV`'s.
    pub(crate) fn all_handlers(&self) -> Vec<u64> {
        let vectors = u64::from(self.vectors());
        let of_processor = [14, 15].map(|number| self.program.word(vectors + 4 * number));
        let of_processor = of_processor.into_iter().flatten();
        let of_chip = self.handlers().into_values().map(|it| it.0);
        let mut all: Vec<_> = of_processor
            .map(|it| u64::from(it) & !1)
            .chain(of_chip)
            .collect();
        all.sort_unstable();
        all.dedup();
        all
    }

    /// Runs a script. Without the memory protection unit, everything takes half the time.
    pub(crate) fn play(self: &Arc<Self>, script: Vec<Act>, is_protected: bool) -> Result<Outcome> {
        let listener = TcpListener::bind(("127.0.0.1", 0))?;
        let mut plant = Plant::new(self.wiring()?);
        let mut machine = self.machine(&mut plant, is_protected)?;
        machine.attach_host(WIRE, Box::<Sender>::default());
        let mut start = self.start();
        start.debugger = Some(&listener);
        let mut session = Session::new(machine, 0, VirtualNanos(STOP_INTERVAL_NS))?;
        let run = Run::new(self, script, plant, listener.local_addr()?);
        run.watch_start(&mut session);
        let finished = emulator::run(session, &start, run)?;
        let mut outcome = finished.driver.outcome;
        for (fault, by) in unmodelled::of(&finished.session) {
            outcome.faults.entry(fault).or_insert((Vec::new(), by));
        }
        Ok(outcome)
    }

    /// Runs a board in the time of the wall clock, with a line to its sender, until the program is to end. It has the
    /// memory protection unit where RTT is served. Returns the steps at the pins, if they are wanted.
    pub(crate) fn serve(
        &self,
        line: Line,
        switches: &[(Input, Closes)],
        rtt: Option<&TcpListener>,
        wants_steps: bool,
    ) -> Result<Option<Vec<Step>>> {
        let is_ended = Arc::new(AtomicBool::new(false));
        for signal in [SIGINT, SIGTERM] {
            signal_hook::flag::register(signal, Arc::clone(&is_ended))?;
        }
        let mut plant = Plant::new(self.wiring()?);
        for &(input, closes) in switches {
            plant.mount(input, closes);
        }
        let mut machine = self.machine(&mut plant, rtt.is_some())?;
        match line {
            Line::Tcp(peer) => drop(machine.attach_host(WIRE, Box::new(peer))),
            Line::UsbIp(server) => machine.chip.otg.export(server),
        }
        machine.chip.flash.erase_ns = SERVED_ERASE_NS;
        let session = Session::new(machine, 0, VirtualNanos(STOP_INTERVAL_NS))?;
        let mut start = self.start();
        start.rtt = rtt;
        let served = Served {
            plant,
            began: Instant::now(),
            steps: wants_steps.then(Vec::new),
            is_ended,
        };
        Ok(emulator::run(session, &start, served)?.driver.steps)
    }

    fn start(&self) -> Start<'_> {
        let mut start = Start::new(&self.images);
        start.boot = Some(self.boot.into());
        start
    }

    fn machine(&self, plant: &mut Plant, is_protected: bool) -> Result<Box<Machine>> {
        let fitted = FittedParts::of(&self.board);
        let link = self.link();
        let mut machine = Machine::new(&self.board, self.wiring()?, link, fitted, is_protected)?;
        plant.connect(&mut machine.chip);
        Ok(Box::new(machine))
    }
}

/// A board that somebody uses.
struct Served {
    plant: Plant,
    began: Instant,
    steps: Option<Vec<Step>>,
    is_ended: Arc<AtomicBool>,
}

impl Driver<Machine> for Served {
    fn on_settled(&mut self, session: &mut Session<Machine>, _: &mut dyn Host, _: Settled) {
        let chip = &mut session.board_mut().chip;
        self.plant.follow(chip);
        if let Some(steps) = &mut self.steps {
            steps.append(&mut self.plant.steps);
        }
        // Nobody asks for it, however long the board runs.
        self.plant.forget();
        chip.flash.changes.clear();
        chip.otg.take_faults();
    }

    fn on_stop(
        &mut self,
        _: &mut Session<Machine>,
        stop: Stop,
        _: &mut dyn Host,
    ) -> Option<VirtualNanos> {
        if self.is_ended.load(Ordering::Relaxed) {
            return None;
        }
        let ahead = Duration::from_nanos(stop.at.0).checked_sub(self.began.elapsed());
        if let Some(ahead) = ahead {
            std::thread::sleep(ahead);
        }
        Some(VirtualNanos(stop.at.0 + STOP_INTERVAL_NS))
    }
}
