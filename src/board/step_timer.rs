//! The step timer: SysTick, which counts core cycles.
//!
//! SysTick belongs to the processor, and its exception needs no acknowledgement. At zero its
//! counter begins again with the value of its reload register. So each interrupt writes the time
//! from the *next* interrupt to the one after that, and the times between events are exact whenever
//! the write comes before the next interrupt. Registers: ARMv7-M reference manual B3.2, B3.3, B3.4.
//!
//! # Cost
//!
//! A register of SysTick is three cycles away, one of a timer on the slow bus fourteen. The
//! registers are addressed from [`SystemControl`], which the compiler cannot look through: it would
//! make an address for each. The address is made when an event is known, and once more for the
//! release, so that no register of the processor has to be saved. A release takes the same time
//! whether it is due or not. [`is_running`] is inlined, as code in RAM calls it.

use core::arch::asm;

use cortex_m::{
    asm::{dsb, isb},
    peripheral::{SCB, SYST, syst::RegisterBlock},
};

use leadscrew::stepper::StepEvent;

use super::{pac::Interrupt, trace};

/// Bits of `SYST_CSR`: the counter runs, its zero interrupts, its clock is that of the core.
const ENABLE: u32 = 1;
pub(crate) const TICKINT: u32 = 1 << 1;
const CLKSOURCE: u32 = 1 << 2;

/// The timer for the step interrupt.
pub(crate) struct StepTimer(());

#[expect(clippy::unused_self, reason = "whoever has it is the step interrupt")]
impl StepTimer {
    /// Returns the timer, which stands after a reset.
    pub(crate) fn new(_: SYST) -> Self {
        Self(())
    }

    /// Sets the time from the next interrupt to the interrupt after it: the time of an event. Returns the access to the
    /// other registers.
    pub(crate) fn set_reload(&mut self, event: StepEvent) -> SystemControl {
        let system = SystemControl::after(event);
        system.write(SYST_RVR, event.half_ticks_less_one());
        system
    }

    /// Releases a task by its vector if an event is the first of a segment.
    pub(crate) fn pend(&mut self, vector: Interrupt, event: StepEvent) {
        SystemControl::after(event).pend(vector, event.is_boundary());
    }

    /// Stops the timer until the next [`start`].
    pub(crate) fn stop(&mut self) -> SystemControl {
        let system = SystemControl::after(StepEvent::NONE);
        system.write(SYST_CSR, CLKSOURCE);
        system.write(ICSR, PENDSTCLR);
        system
    }
}

/// Offsets of registers from [`SystemControl`]: control and reload value of SysTick, the state of
/// interrupts, and the first of the registers that pend vectors.
const SYST_CSR: usize = 0x10;
const SYST_RVR: usize = 0x14;
const ICSR: usize = 0xd04;
const NVIC_ISPR: usize = 0x200;
/// Bits of `ICSR`: the number of the bit that shows SysTick pending, and the bit to clear it.
const PENDSTSET: u32 = 26;
const PENDSTCLR: u32 = 1 << 25;

/// The system control space, the registers of the processor, for the step interrupt.
#[derive(Clone, Copy)]
pub(crate) struct SystemControl(*mut u32);

impl SystemControl {
    /// Returns the address of the space, made after an event is known.
    #[expect(
        unsafe_code,
        reason = "an address that the compiler cannot look through"
    )]
    fn after(event: StepEvent) -> Self {
        let base: *mut u32;
        // SAFETY: writes a number into a register.
        unsafe {
            asm!(
                "mov.w {}, #0xe000e000 /* {} */", out(reg) base, in(reg) event.bits(),
                options(pure, nomem, nostack, preserves_flags),
            );
        }
        Self(base)
    }

    #[expect(unsafe_code, reason = "registers by their addresses")]
    fn write(self, offset: usize, word: u32) {
        let register = self.0.wrapping_byte_add(offset);
        // SAFETY: the registers of SysTick belong to the step interrupt, as this does; of the
        // others, a one has its effect and a zero none.
        unsafe { register.write_volatile(word) };
    }

    /// Returns 1 if the next interrupt of the timer is pending, otherwise 0: then the last time was
    /// written too late. The bits above are those of exceptions that nothing pends.
    #[expect(unsafe_code, reason = "a register by its address")]
    pub(crate) fn is_late(self) -> u32 {
        let register = self.0.wrapping_byte_add(ICSR);
        // SAFETY: reads a register without side effects.
        unsafe { register.read_volatile() >> PENDSTSET }
    }

    /// Releases a task by its vector, if it `is_due`.
    pub(crate) fn pend(self, vector: Interrupt, is_due: bool) {
        if is_due {
            trace::release(vector);
        }
        let number = vector as usize;
        let register = NVIC_ISPR + 4 * (number / 32);
        self.write(register, u32::from(is_due) << (number % 32));
    }
}

/// Sets the time from the next interrupt to the interrupt after it: the time of an event which the step interrupt did
/// not know of.
pub(crate) fn set_reload(event: StepEvent) {
    reload(registers(), event);
    // An interrupt that came before the write has run when this returns.
    dsb();
    isb();
}

/// Sets the time to the first interrupt, before [`start`].
pub(crate) fn set_up(event: StepEvent) {
    let timer = registers();
    reload(timer, event);
    clear_counter(timer);
}

/// Starts the timer with the time that has been set up; the time to the interrupt after it is the time of an event.
/// Only while the timer stands, under the lock of `StepTimerToken`.
pub(crate) fn start(following: StepEvent) {
    let timer = registers();
    // The counter begins with the time in the reload register. Where a preempting task lets it come
    // round, the first interrupt is later, and the time after it still right.
    control(timer, CLKSOURCE | ENABLE);
    dsb();
    reload(timer, following);
    control(timer, CLKSOURCE | ENABLE | TICKINT);
}

/// Stops the timer at once until the next [`start`], from any task.
pub(crate) fn halt() {
    control(registers(), CLKSOURCE);
    SCB::clear_pendst();
    // An interrupt that was on its way has run when this returns.
    dsb();
    isb();
}

/// Returns whether the timer runs to an event.
#[cfg_attr(
    feature = "eeprom",
    allow(dead_code, reason = "the bring-up erases flash on every board")
)]
#[inline(always)]
#[expect(clippy::inline_always, reason = "nothing in flash may be called")]
pub(crate) fn is_running() -> bool {
    registers().csr.read() & TICKINT != 0
}

#[expect(unsafe_code, reason = "a raw word for a register")]
fn reload(timer: &RegisterBlock, event: StepEvent) {
    // SAFETY: any number of 24 bits is legal; this one has 20.
    unsafe { timer.rvr.write(event.half_ticks_less_one()) };
}

#[expect(unsafe_code, reason = "a raw word for a register")]
fn clear_counter(timer: &RegisterBlock) {
    // SAFETY: any write makes the counter zero; the timer stands.
    unsafe { timer.cvr.write(0) };
}

#[expect(unsafe_code, reason = "a raw word for a register")]
fn control(timer: &RegisterBlock, bits: u32) {
    // SAFETY: bits of the register; the handler of the exception is a task.
    unsafe { timer.csr.write(bits) };
}

/// Returns the registers of the timer for other tasks than `step`: to start the timer, while it
/// stands; to halt it, under the lock of the token; and to set a time while the interrupt has none
/// to set.
#[inline(always)]
#[expect(clippy::inline_always, reason = "nothing in flash may be called")]
#[expect(unsafe_code, reason = "the interrupt owns the timer")]
fn registers() -> &'static RegisterBlock {
    // SAFETY: every Cortex-M4 has these registers.
    unsafe { &*SYST::PTR }
}
