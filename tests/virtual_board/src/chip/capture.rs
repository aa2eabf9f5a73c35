//! TIM11 as the firmware measures its crystal with it: it captures its count of the internal oscillator's periods at
//! edges of the crystal, divided by `RTCPRE` and `IC1PSC`. RM0090 7.3.3 and 19.5, RM0383 14.5, RM0390 18.5.

use rigless::{
    device::{Device, DeviceContext, RegisterFile},
    soc::stm32f427::{
        generated::{
            rcc as clock_registers,
            tim11::{Register, ccer, cr1},
        },
        peripherals::rcc::HSI_HZ,
    },
    time::VirtualNanos,
};

/// `OR`: the input is the divided crystal.
const DIVIDED_CRYSTAL: u64 = 2;
/// Flags of `SR`.
const CAPTURED: u64 = 1 << 1;
const OVERRUN: u64 = 1 << 9;
const NANOSECONDS: u128 = 1_000_000_000;

#[derive(Debug, Default)]
pub(super) struct Capture {
    /// The crystal, Hz; 0 where it is off.
    crystal_hz: u64,
    /// `RTCPRE`.
    divider: u64,
    /// Captures since time began.
    taken: u64,
}

impl Capture {
    /// Takes over what the clock controller says.
    pub(super) fn follow(&mut self, crystal_hz: u64, clocks: &RegisterFile) {
        let is_ready =
            clock_registers::cr::HSERDY.is_set(clocks.get(clock_registers::Register::Cr));
        self.crystal_hz = if is_ready { crystal_hz } else { 0 };
        self.divider = clocks.get(clock_registers::Register::Cfgr) >> 16 & 31;
    }

    /// Brings flag and captured count up to now.
    fn update(&mut self, now: VirtualNanos, registers: &mut RegisterFile) {
        let is_on = cr1::CEN.is_set(registers.get(Register::Cr1))
            && ccer::CC1E.is_set(registers.get(Register::Ccer))
            && registers.get(Register::Or) & 3 == DIVIDED_CRYSTAL;
        if !is_on || self.crystal_hz == 0 || self.divider < 2 {
            return;
        }
        let periods = self.divider << (registers.get(Register::Ccmr1Input) >> 2 & 3);
        let crystal = u128::from(now.0) * u128::from(self.crystal_hz) / NANOSECONDS;
        let captures = (crystal / u128::from(periods)) as u64;
        if captures > self.taken {
            self.taken = captures;
            let edges = u128::from(captures) * u128::from(periods);
            let count = edges * u128::from(HSI_HZ) / u128::from(self.crystal_hz);
            registers.set(Register::Ccr1, count as u64 & 0xFFFF);
            let flags = registers.get(Register::Sr);
            let overrun = if flags & CAPTURED == 0 { 0 } else { OVERRUN };
            registers.set(Register::Sr, flags | CAPTURED | overrun);
        }
    }
}

impl Device for Capture {
    type Register = Register;

    fn read(
        &mut self,
        register: Register,
        registers: &mut RegisterFile,
        context: &mut DeviceContext<'_>,
    ) -> Option<u64> {
        match register {
            Register::Sr => {
                self.update(context.now(), registers);
                Some(registers.get(Register::Sr))
            }
            Register::Ccr1 => {
                registers.set(Register::Sr, registers.get(Register::Sr) & !CAPTURED);
                Some(registers.get(Register::Ccr1))
            }
            _ => None,
        }
    }

    fn reset(&mut self) {
        *self = Self::default();
    }
}
