//! A board with its firmware on the bench, for a script or for somebody's sender.

use std::{
    collections::BTreeMap,
    net::TcpListener,
    sync::Arc,
    time::{Duration, Instant},
};

use anyhow::{Context as _, Result};
use board_data::{Board, Input, Wiring};
use rigless::{
    chip::uart::{Peer, TcpPeer},
    emulator::{self, Driver, Host, Settled, Start, Stop},
    image::Image,
    machine::Board as _,
    session::Session,
    time::VirtualNanos,
};

use crate::{
    bootloader,
    chip::Fitted,
    gaps,
    machine::{Machine, WIRE},
    place::Program,
    run::{Outcome, Run, TICK},
    script::Act,
    wire::Wire,
    world::{Closes, World},
};

/// How long an erasure takes on a board that is served: a sector of 16 KiB takes about as long (data sheets, `t_ERASE16KB`).
const SERVED_ERASE_NS: u64 = 250_000_000;

/// A board and its firmware.
#[derive(Debug)]
pub(crate) struct Bench {
    pub(crate) board: Board,
    pub(crate) axes: usize,
    pub(crate) program: Program,
    /// The firmware, and bootloaders.
    pub(crate) images: Vec<Image>,
    /// Every line from the firmware is shown.
    pub(crate) shows_lines: bool,
}

impl Bench {
    pub(crate) fn wiring(&self) -> Result<&Wiring> {
        let wiring = self.board.wiring(self.axes);
        wiring.with_context(|| format!("{} has no {} axes", self.board.name, self.axes))
    }

    /// Where the firmware's vectors are.
    pub(crate) fn vectors(&self) -> u32 {
        self.board.memory(self.axes).flash_start
    }

    /// Handlers of the chip's interrupts by number, with their names: those that are not the one of all others.
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
        let mut world = World::new(self.wiring()?);
        let machine = self.machine(&mut world, Box::<Wire>::default(), is_protected)?;
        let mut start = self.start();
        start.debugger = Some(&listener);
        let mut session = Session::new(machine, 0, VirtualNanos(TICK))?;
        let run = Run::new(self, script, world, listener.local_addr()?);
        run.watch_start(&mut session);
        let finished = emulator::run(session, &start, run)?;
        let mut outcome = finished.driver.outcome;
        for (fault, by) in gaps::of(&finished.session) {
            outcome.faults.entry(fault).or_insert((Vec::new(), by));
        }
        Ok(outcome)
    }

    /// Runs a board in the time of the wall clock, with its wire at a TCP address.
    pub(crate) fn serve(
        &self,
        peer: TcpPeer,
        switches: &[(Input, Closes)],
        rtt: Option<&TcpListener>,
    ) -> Result<()> {
        let mut world = World::new(self.wiring()?);
        for &(input, closes) in switches {
            world.mount(input, closes);
        }
        let mut machine = self.machine(&mut world, Box::new(peer), true)?;
        machine.chip.flash.erase_ns = SERVED_ERASE_NS;
        let session = Session::new(machine, 0, VirtualNanos(TICK))?;
        let began = Instant::now();
        let mut start = self.start();
        start.rtt = rtt;
        emulator::run(session, &start, Served { world, began })?;
        Ok(())
    }

    fn start(&self) -> Start<'_> {
        let mut start = Start::new(&self.images);
        let has_bootloaders = self.images.len() > 1;
        let vectors = if has_bootloaders {
            bootloader::PLACE
        } else {
            self.vectors()
        };
        start.boot = Some(vectors.into());
        start
    }

    fn machine(
        &self,
        world: &mut World,
        peer: Box<dyn Peer>,
        is_protected: bool,
    ) -> Result<Box<Machine>> {
        let fitted = Fitted::of(&self.board);
        let mut machine = Machine::new(&self.board, self.wiring()?, fitted, is_protected)?;
        world.connect(&mut machine.chip);
        machine.attach_host(WIRE, peer);
        Ok(Box::new(machine))
    }
}

/// A board that somebody uses.
struct Served {
    world: World,
    began: Instant,
}

impl Driver<Machine> for Served {
    fn on_settled(&mut self, session: &mut Session<Machine>, _: &mut dyn Host, _: Settled) {
        let chip = &mut session.board_mut().chip;
        self.world.follow(chip);
        // Nobody asks for it, however long the board runs.
        self.world.forget();
        chip.flash.changes.clear();
    }

    fn on_stop(
        &mut self,
        _: &mut Session<Machine>,
        stop: Stop,
        _: &mut dyn Host,
    ) -> Option<VirtualNanos> {
        let ahead = Duration::from_nanos(stop.at.0).checked_sub(self.began.elapsed());
        if let Some(ahead) = ahead {
            std::thread::sleep(ahead);
        }
        Some(VirtualNanos(stop.at.0 + TICK))
    }
}
