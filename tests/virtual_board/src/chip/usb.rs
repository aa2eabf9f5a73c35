//! The OTG full-speed core at its addresses, and what its cable leads to. RM0090 34.16, RM0383 22.16, RM0390 31.15.
//!
//! The core is that of `otg`; here it gets its time, its clocks, and a host. Its pages and FIFOs are a window of the
//! bus, which no register table of the crate describes.

use std::{any::Any, num::NonZeroU64};

use board_data::Board;
use otg::{Core, SetupEnd, Silicon, System, Version};
use rigless::{
    chip::{Timeline, uart::Peer},
    device::{DeviceContext, ErasedDevice, RegisterFile, RequestChange},
    soc::{
        Gate, RegisterSpec, Width, Window,
        stm32f427::{generated::rcc as clock_registers, peripherals::rcc::Rcc},
    },
    time::{EventId, VirtualNanos},
};
use usbip::Server;

use crate::usb_host::{Cable, HostAction, PERIOD_US};

const BASE: u64 = 0x5000_0000;
/// Pages of registers and the FIFOs of the endpoints; behind them is the memory of the FIFOs, for debugging.
const BYTES: u64 = 0x2_0000;
pub(super) const END: u64 = BASE + BYTES;
const NS_PER_US: u64 = 1000;

/// Instances of the crate's description whose addresses the window takes: they get none.
pub(super) const INSTANCES: [&str; 4] = [
    "OTG_FS_GLOBAL",
    "OTG_FS_HOST",
    "OTG_FS_DEVICE",
    "OTG_FS_PWRCLK",
];

/// The window of a chip's bus, which is closed without the clock: RM0090 6.3.11, bit 7.
pub(super) fn window() -> Window {
    let bytes = NonZeroU64::new(BYTES).expect("it has registers");
    Window::new("OTG_FS", BASE, bytes).gated(Gate::by("RCC", "AHB2ENR", "OTGFSEN"))
}

/// What is at the cable: a host, and the program at its port, if it is not elsewhere.
#[derive(Debug)]
struct Plugged {
    cable: Cable,
    program: Option<Box<dyn Peer>>,
}

/// The core, and what it is plugged into.
#[derive(Debug)]
pub(crate) struct Otg {
    pub(crate) core: Core,
    plugged: Option<Plugged>,
    /// The table of a window's registers, which is empty, as the bus has it.
    pub(super) registers: &'static [RegisterSpec],
    /// The time up to which the core has been brought, and when the host runs next, µs.
    now_us: u64,
    host_us: u64,
    /// What has been seen to be wrong before the core was reset.
    faults: Vec<String>,
}

impl Otg {
    pub(super) fn new(board: &Board) -> Self {
        let silicon = Silicon {
            version: if board.chip.hal == "f446" {
                Version::V2
            } else {
                Version::V1
            },
            setup_end: SetupEnd::Entry,
            keeps_enabled: true,
        };
        let mut core = Core::new(silicon);
        core.is_clocked = false;
        Self {
            core,
            plugged: None,
            registers: &[],
            now_us: 0,
            host_us: 0,
            faults: Vec::new(),
        }
    }

    /// Plugs the cable into a host, at whose port a program is.
    pub(crate) fn plug(&mut self, system: System, program: Box<dyn Peer>) {
        self.plugged = Some(Plugged {
            cable: Cable::new(system, self.core.silicon()),
            program: Some(program),
        });
    }

    /// Plugs the cable into this computer, which has clients elsewhere.
    pub(crate) fn export(&mut self, server: Server) {
        self.plugged = Some(Plugged {
            cable: Cable::exported(server, self.core.silicon()),
            program: None,
        });
    }

    /// The program at the host's port.
    pub(crate) fn program_mut(&mut self) -> Option<&mut dyn Peer> {
        let plugged = self.plugged.as_mut()?;
        Some(plugged.program.as_mut()?.as_mut())
    }

    /// That program, if it is of a type.
    pub(crate) fn program_as<P: Peer>(&mut self) -> Option<&mut P> {
        let program: &mut dyn Any = self.program_mut()?;
        program.downcast_mut()
    }

    /// Somebody does something at the host.
    pub(crate) fn act(&mut self, action: HostAction) {
        if let Some(Plugged { cable, .. }) = &mut self.plugged {
            cable.port.actions.push_back(action);
        }
    }

    /// What software and host have found wrong since this was asked before, without its times.
    pub(crate) fn take_faults(&mut self) -> Vec<String> {
        self.keep_violations();
        let of_host = { self.plugged.as_mut() }.map(|it| &mut it.cable.port.faults);
        let of_host = of_host.map(std::mem::take).unwrap_or_default();
        self.faults.drain(..).chain(of_host).collect()
    }

    fn keep_violations(&mut self) {
        let violations = self.core.take_violations().into_iter();
        let untimed = violations.map(|it| {
            let what = it.split_once(" µs: ").map_or(&*it, |(_, what)| what);
            format!("OTG_FS: {what}")
        });
        self.faults.extend(untimed);
    }

    /// Takes over the core's reset from the clock controller, RM0090 6.3.6, and the first clock of the transceiver. A
    /// crystal that stops later is the clock security system's.
    pub(super) fn follow(&mut self, clocks: &Rcc, registers: &RegisterFile) {
        let resets = registers.get(clock_registers::Register::Ahb2rstr);
        if clock_registers::ahb2rstr::OTGFSRST.is_set(resets) {
            self.restart();
        }
        self.core.is_clocked |= clocks.pll48(registers) != 0;
    }

    /// The core is out of a reset of the chip, or of the clock controller's.
    pub(super) fn restart(&mut self) {
        self.keep_violations();
        self.core = Core::new(self.core.silicon());
        self.core.is_clocked = false;
        if let Some(Plugged { cable, .. }) = &mut self.plugged {
            cable.port.chip_resets += 1;
            cable.port.close();
        }
    }

    fn pass_to(&mut self, now: VirtualNanos) {
        let us = (now.0 / NS_PER_US).saturating_sub(self.now_us);
        if us != 0 {
            self.now_us += us;
            self.core.pass(us);
        }
    }

    /// The host runs when it is due.
    pub(super) fn visit(&mut self, context: &mut DeviceContext<'_>) {
        self.pass_to(context.now());
        let Some(Plugged { cable, program }) = &mut self.plugged else {
            return;
        };
        if self.now_us < self.host_us {
            return;
        }
        self.host_us = self.now_us - self.now_us % PERIOD_US + PERIOD_US;
        while cable.port.has_room()
            && let Some(word) = { program.as_mut() }.and_then(|it| it.transmit(context.now()))
        {
            cable.port.outgoing.push_back(word as u8);
        }
        cable.run_host(&mut self.core);
        for byte in cable.port.incoming.drain(..) {
            if let Some(program) = program {
                program.receive(byte.into(), &mut Timeline::new(context));
            }
        }
    }
}

impl ErasedDevice for Otg {
    fn layout(&self) -> &'static [RegisterSpec] {
        self.registers
    }

    fn read_window(&mut self, offset: u64, width: Width, context: &mut DeviceContext<'_>) -> u64 {
        self.pass_to(context.now());
        self.check_width(offset, width);
        self.core.read(offset as usize).into()
    }

    fn write_window(
        &mut self,
        offset: u64,
        width: Width,
        value: u64,
        context: &mut DeviceContext<'_>,
    ) {
        self.pass_to(context.now());
        self.check_width(offset, width);
        self.core.write(offset as usize, value as u32);
    }

    fn peek_window(&self, offset: u64, _: Width, _: VirtualNanos) -> Option<u64> {
        self.core.peek(offset as usize).map(u64::from)
    }

    fn poll(&mut self, _: &mut RegisterFile, context: &mut DeviceContext<'_>) {
        self.visit(context);
    }

    fn reset(&mut self) {
        self.restart();
    }

    fn read(&mut self, _: usize, _: &mut RegisterFile, _: &mut DeviceContext<'_>) -> Option<u64> {
        None
    }

    fn write(&mut self, _: usize, _: u64, _: &mut RegisterFile, _: &mut DeviceContext<'_>) {}

    fn on_event(&mut self, _: EventId, _: &mut RegisterFile, _: &mut DeviceContext<'_>) {}

    fn on_request(&mut self, _: RequestChange, _: &mut RegisterFile, _: &mut DeviceContext<'_>) {}

    fn on_clock(&mut self, _: u64, _: &mut RegisterFile, _: &mut DeviceContext<'_>) {}

    fn on_access(&mut self, _: u64, _: u64, _: &mut RegisterFile, _: &mut DeviceContext<'_>) {}

    fn on_refused(&mut self, _: u64, _: &mut RegisterFile, _: &mut DeviceContext<'_>) {}
}

impl Otg {
    /// Registers and FIFOs are words: RM0090 34.16.
    fn check_width(&mut self, offset: u64, width: Width) {
        if width != Width::W32 || !offset.is_multiple_of(4) {
            let fault = format!("OTG_FS: {offset:#x} is accessed as {width:?}");
            self.faults.push(fault);
        }
    }
}
