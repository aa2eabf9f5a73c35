//! A board as `rigless` runs it: the chip, and what leads to the sender.

use std::num::{NonZeroU32, NonZeroU64};

use anyhow::{Context, Result};
use board_data::{Board, Wiring};
use otg::System;
use rigless::{
    chip::uart::Peer,
    cpu,
    device::Level,
    machine::{Board as RiglessBoard, HostWire, Target, armv7m},
    mcu::{Mcu, Operate as _},
    snapshot::Store,
    soc::stm32f427::peripherals::SERIAL_PORTS,
    time::VirtualNanos,
};

use crate::{
    bench::Link,
    chip::{Chip, FittedParts},
};

/// The names of what leads to the sender, and of the chip.
pub(crate) const WIRE: &str = "sender";
const CHIP: &str = "chip";
/// Bits of a priority: PM0214 4.3.
const PRIORITY_BITS: u8 = 4;
/// The supply, mV.
pub(crate) const SUPPLY_MV: u32 = 3300;

/// A board.
#[derive(Debug)]
pub(crate) struct Machine {
    pub(crate) chip: Chip,
    /// Which of the chip's serial ports is the sender's; with none, its USB is.
    port: Option<usize>,
    core_hz: NonZeroU64,
    regions: armv7m::MpuRegions,
}

impl Machine {
    /// The board, before its supply is on. Without the memory protection unit, it takes half the time.
    pub(crate) fn new(
        board: &Board,
        wiring: &Wiring,
        link: Link,
        fitted: FittedParts,
        is_protected: bool,
    ) -> Result<Self> {
        let name = format!("USART{}", wiring.serial.usart);
        let port = { SERIAL_PORTS.iter() }.position(|port| port.instance == name);
        let port = port.with_context(|| format!("the model has no {name}"))?;
        let port = (link == Link::Uart).then_some(port);
        let core_hz = u64::from(board.chip.clocks.core_mhz) * 1_000_000;
        let mut chip = Chip::new(board, fitted)?;
        chip.models.set_supply(SUPPLY_MV);
        if port.is_some() {
            // A line at rest is high: the model of the port takes words, and no levels.
            chip.hold(VirtualNanos(0), wiring.serial.receive, Some(Level::High));
        }
        Ok(Self {
            chip,
            port,
            core_hz: NonZeroU64::new(core_hz).context("the core has no clock")?,
            regions: if is_protected {
                armv7m::MpuRegions::Eight
            } else {
                armv7m::MpuRegions::None
            },
        })
    }

    /// What is at the sender's end.
    pub(crate) fn peer_mut<P: Peer>(&mut self) -> Option<&mut P> {
        match self.port {
            Some(port) => self.chip.models.usart[port].chip_mut(),
            None => self.chip.otg.program_as(),
        }
    }
}

impl Store for Machine {}

impl RiglessBoard for Machine {
    fn name(&self) -> &'static str {
        "leadscrew"
    }

    fn target_names(&self) -> Vec<&'static str> {
        vec![CHIP]
    }

    fn mcu(&mut self, target: usize) -> Option<&mut dyn Mcu> {
        (target == 0).then_some(&mut self.chip)
    }

    fn targets(&mut self) -> Vec<Target<'_>> {
        let lines = u32::from(self.chip.cpu().interrupt_lines);
        let core = armv7m::Core {
            variant: armv7m::Variant::M4,
            clock_hz: self.core_hz,
            interrupt_lines: NonZeroU32::new(lines).expect("the chip has interrupts"),
            priority_bits: PRIORITY_BITS,
            refclk_divider: NonZeroU32::new(8).expect("8 is not 0"),
            // One in each cycle: time is what the model does not know of.
            instructions_per_second: self.core_hz,
            boot: "flash",
        }
        .spec_with_parts(
            &cpu::armv7m::windows(self.chip.bus()),
            armv7m::Fpu::FpV4Sp,
            self.regions,
        );
        vec![Target::new(CHIP, &mut self.chip, core)]
    }

    fn hosts(&self) -> Vec<HostWire> {
        vec![HostWire {
            name: WIRE,
            port: 0,
        }]
    }

    fn attach_host(&mut self, name: &str, peer: Box<dyn Peer>) -> bool {
        let is_known = name == WIRE;
        match self.port {
            Some(port) if is_known => self.chip.models.usart[port].attach_boxed(peer),
            None if is_known => self.chip.otg.plug(System::Linux, peer),
            _ => {}
        }
        is_known
    }

    fn host_mut(&mut self, name: &str) -> Option<&mut dyn Peer> {
        match self.port {
            _ if name != WIRE => None,
            Some(port) => self.chip.models.usart[port].peer_mut(),
            None => self.chip.otg.program_mut(),
        }
    }
}
