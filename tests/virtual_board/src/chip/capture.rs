//! TIM11: the crate's model of a timer, and as the firmware measures its crystal with it: it captures its count of the
//! internal oscillator's periods at edges of the crystal, divided by `RTCPRE` and `IC1PSC`. RM0090 7.3.3 and 19.5,
//! RM0383 14.5, RM0390 18.5.

use rigless::{
    device::{Device, DeviceContext, RegisterFile},
    soc::{
        st::tim::{Counter, Family, Kind, Part, Tim, Timer},
        stm32f427::{
            generated::{
                rcc as clock_registers,
                tim11::{Register, ccer, cr1},
            },
            peripherals::{rcc::HSI_HZ, tim::PART},
        },
    },
    time::{EventId, VirtualNanos},
};

/// `OR`: the input is the divided crystal.
const DIVIDED_CRYSTAL: u64 = 2;
/// Flags of `SR`.
const CAPTURED: u64 = 1 << 1;
const OVERRUN: u64 = 1 << 9;
const NANOSECONDS: u128 = 1_000_000_000;

/// TIM11 alone, which has `OR`.
#[derive(Debug, Clone, Copy)]
struct WithOption;

impl Family for WithOption {
    type Register = Register;
    type Instance = Timer;
    const PART: &'static Part = &PART;
    const KINDS: &'static [Kind] = &[Kind::OneChannel];
}

#[derive(Debug)]
pub(super) struct Capture {
    timer: Tim<WithOption>,
    /// The crystal, Hz; 0 where it is off.
    crystal_hz: u64,
    /// `RTCPRE`.
    divider: u64,
    /// Captures since time began.
    taken: u64,
}

impl Capture {
    pub(super) fn new() -> Self {
        let timer = Timer::new("TIM11", Counter::Narrow, Kind::OneChannel);
        Self {
            timer: Tim::with_clock(HSI_HZ, timer),
            crystal_hz: 0,
            divider: 0,
            taken: 0,
        }
    }

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
        if register == Register::Sr {
            self.update(context.now(), registers);
        }
        Device::read(&mut self.timer, register, registers, context)
    }

    fn peek(&self, register: Register, registers: &RegisterFile, now: VirtualNanos) -> Option<u64> {
        Device::peek(&self.timer, register, registers, now)
    }

    fn write(
        &mut self,
        register: Register,
        value: u64,
        registers: &mut RegisterFile,
        context: &mut DeviceContext<'_>,
    ) {
        Device::write(&mut self.timer, register, value, registers, context);
    }

    fn on_event(
        &mut self,
        event: EventId,
        registers: &mut RegisterFile,
        context: &mut DeviceContext<'_>,
    ) {
        Device::on_event(&mut self.timer, event, registers, context);
    }

    fn on_clock(&mut self, hz: u64, registers: &mut RegisterFile, context: &mut DeviceContext<'_>) {
        Device::on_clock(&mut self.timer, hz, registers, context);
    }

    fn reset(&mut self) {
        Device::reset(&mut self.timer);
        self.taken = 0;
    }

    fn reset_line(&mut self, registers: &mut RegisterFile, context: &mut DeviceContext<'_>) {
        Device::reset_line(&mut self.timer, registers, context);
        self.taken = 0;
    }
}
