//! EXTI and the registers of SYSCFG that say which port a line listens to: RM0090 12.2 and 9.2, RM0383 10.2 and 7.2,
//! RM0390 10.2 and 8.2.
//!
//! A port announces each change of a pin's level as a request, which reaches the EXTI. So edges of all pins are recorded
//! here, too.

use board_data::Pin;
use rigless::{
    device::{Device, DeviceContext, Level, RegisterFile, RequestChange},
    soc::stm32f427::{
        PORTS,
        generated::{exti::Register, syscfg},
    },
    time::VirtualNanos,
};

/// Numbers of the interrupts: the vendor's file gives that of the supply to PWR alone, RM0090 table 62.
pub(super) const INTERRUPTS: [u16; 9] = [2, 6, 7, 8, 9, 10, 23, 40, 1];
/// The lines of each.
const LINES: [u64; 9] = [1 << 21, 1, 2, 4, 8, 0x10, 0x3E0, 0xFC00, 1 << SUPPLY_LINE];
/// The line of the detector of the supply.
const SUPPLY_LINE: u8 = 16;

/// A change of the level of a pin.
#[derive(Debug, Clone, Copy, PartialEq, Eq)]
pub(crate) struct Edge {
    pub(crate) at: VirtualNanos,
    pub(crate) pin: Pin,
    pub(crate) level: Level,
}

#[derive(Debug, Default)]
pub(crate) struct Exti {
    /// The port of each line.
    pub(super) sources: [usize; 16],
    levels: [[Option<Level>; 16]; PORTS.len()],
    supply: Option<Level>,
    /// Edges that nobody has looked at.
    pub(crate) edges: Vec<Edge>,
}

impl Exti {
    fn drive(registers: &RegisterFile, context: &mut DeviceContext<'_>) {
        let pending = registers.get(Register::Pr) & registers.get(Register::Imr);
        for (position, lines) in LINES.into_iter().enumerate() {
            context.interrupt(position, Level::from(pending & lines != 0));
        }
    }

    /// A line has changed.
    fn edge(line: u8, level: Level, registers: &mut RegisterFile, context: &mut DeviceContext<'_>) {
        let trigger = match level {
            Level::High => Register::Rtsr,
            Level::Low => Register::Ftsr,
        };
        if registers.get(trigger) >> line & 1 != 0 {
            registers.set(Register::Pr, registers.get(Register::Pr) | 1 << line);
            Self::drive(registers, context);
        }
    }

    /// What the detector of the supply says: high where it is too low.
    pub(super) fn supply(
        &mut self,
        level: Level,
        registers: &mut RegisterFile,
        context: &mut DeviceContext<'_>,
    ) {
        if self.supply.replace(level) != Some(level) {
            Self::edge(SUPPLY_LINE, level, registers, context);
        }
    }
}

impl Device for Exti {
    type Register = Register;

    fn write(
        &mut self,
        register: Register,
        value: u64,
        registers: &mut RegisterFile,
        context: &mut DeviceContext<'_>,
    ) {
        match register {
            // The flags are cleared already, and with them what software has triggered: 12.3.6.
            Register::Pr => {
                registers.set(Register::Swier, registers.get(Register::Swier) & !value);
            }
            Register::Swier => {
                let triggered = registers.get(Register::Swier) & registers.get(Register::Imr);
                registers.set(Register::Pr, registers.get(Register::Pr) | triggered);
            }
            _ => {}
        }
        Self::drive(registers, context);
    }

    fn on_request(
        &mut self,
        change: RequestChange,
        registers: &mut RegisterFile,
        context: &mut DeviceContext<'_>,
    ) {
        let Some(port) = PORTS.iter().position(|&port| port == change.instance) else {
            return;
        };
        let number = change.request;
        let before = self.levels[port][number].replace(change.level);
        let pin = Pin {
            port: port as u8,
            number: number as u8,
        };
        self.edges.push(Edge {
            at: context.now(),
            pin,
            level: change.level,
        });
        let is_edge = before.is_some_and(|before| before != change.level);
        if is_edge && self.sources[number] == port {
            Self::edge(pin.number, change.level, registers, context);
        }
    }

    fn reset(&mut self) {
        // The ports announce again what they hold.
        self.levels = Default::default();
    }
}

/// SYSCFG: its registers alone.
#[derive(Debug)]
pub(super) struct Syscfg;

impl Device for Syscfg {
    type Register = syscfg::Register;
}

/// The port of each line.
pub(super) fn sources(registers: &RegisterFile) -> [usize; 16] {
    use syscfg::Register::{Exticr1, Exticr2, Exticr3, Exticr4};
    let words = [Exticr1, Exticr2, Exticr3, Exticr4].map(|register| registers.get(register));
    std::array::from_fn(|line| (words[line / 4] >> (line % 4 * 4) & 0xF) as usize)
}
