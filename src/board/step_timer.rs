//! The step timer: SysTick, which counts core cycles.
//!
//! It is the processor's own: three cycles away, where a timer on the slow bus is fourteen, and its
//! exception needs no acknowledgement. At zero its counter begins again with what is in its reload
//! register. So each interrupt writes the time from the *next* interrupt to the one after that, and
//! the times between events are exact whenever the write comes before the next interrupt.
//!
//! # Cost
//!
//! The registers are addressed from [`SystemControl`], which the compiler cannot look through: it would
//! make an address for each. The address is made when an event is known, and once more for the release,
//! so that no register of the processor has to be saved.

use core::arch::asm;

use cortex_m::{
    asm::{dsb, isb},
    peripheral::{SCB, SYST, syst::RegisterBlock},
};

use leadscrew::stepper::StepEvent;

use super::{emulation, pac::Interrupt, trace};

/// Core cycles in a tick of the events' times: it counts half ticks.
#[cfg(feature = "emulated")]
const CYCLES_PER_TICK: u32 = 2;

/// Bits of SysTick's control register: it counts, it interrupts, what it counts are core cycles.
const COUNTS: u32 = 1;
const INTERRUPTS: u32 = 1 << 1;
const CORE_CYCLES: u32 = 1 << 2;

/// The step interrupt's side of the timer.
pub(super) struct StepTimer(());

#[expect(clippy::unused_self, reason = "whoever has it is the step interrupt")]
impl StepTimer {
    /// There is one timer, and it stands after a reset.
    pub(super) fn new(_: SYST) -> Self {
        Self(())
    }

    /// Makes the time from the next interrupt to the one behind it that of an event. What else the
    /// interrupt does with the processor's registers goes through what this returns.
    #[inline]
    pub(super) fn set_reload(&mut self, event: StepEvent) -> SystemControl {
        let system = SystemControl::after(event);
        system.write(RELOAD, event.half_ticks_less_one());
        system
    }

    /// Releases a task by its vector if an event is the first of a segment: in the same time if not.
    #[inline]
    pub(super) fn pend(&mut self, vector: Interrupt, event: StepEvent) {
        SystemControl::after(event).pend(vector, event.is_boundary());
    }

    /// No interrupt until the next [`start`].
    #[inline]
    pub(super) fn stop(&mut self) -> SystemControl {
        let system = SystemControl::after(StepEvent::NONE);
        system.write(CONTROL, CORE_CYCLES);
        system.write(STATE, NOT_DUE);
        system
    }
}

/// Where registers are that the step interrupt uses, from [`SystemControl`]: control and reload value
/// of the timer, the state of exceptions, and what releases vectors.
const CONTROL: usize = 0x10;
const RELOAD: usize = 0x14;
const STATE: usize = 0xd04;
const RELEASE: usize = 0x200;
/// Bits of the state of exceptions: the timer's interrupt is due, and writing that makes it not due.
const DUE: u32 = 26;
const NOT_DUE: u32 = 1 << 25;

/// The processor's own registers, for the step interrupt.
#[derive(Clone, Copy)]
pub(super) struct SystemControl(*mut u32);

impl SystemControl {
    /// Makes the address.
    #[inline]
    #[expect(unsafe_code, reason = "an address that is opaque")]
    fn after(event: StepEvent) -> Self {
        let base: *mut u32;
        // SAFETY: makes a number.
        unsafe {
            asm!(
                "mov.w {}, #0xe000e000 /* {} */", out(reg) base, in(reg) event.bits(),
                options(pure, nomem, nostack, preserves_flags),
            );
        }
        Self(base)
    }

    #[inline]
    #[expect(unsafe_code, reason = "registers by their addresses")]
    fn write(self, offset: usize, word: u32) {
        let register = self.0.wrapping_byte_add(offset);
        // SAFETY: of the registers, the timer's are the step interrupt's own, as this is; for the
        // others, a one does what it says and a zero nothing.
        unsafe { register.write_volatile(word) };
    }

    /// Returns 1 if the timer's next interrupt is due already: the last time may have come too late.
    /// 0 if not: the bits above are of exceptions that nothing here makes due.
    #[inline]
    #[expect(unsafe_code, reason = "a register by its address")]
    pub(super) fn is_late(self) -> u32 {
        let register = self.0.wrapping_byte_add(STATE);
        // SAFETY: reads a register without side effects.
        unsafe { register.read_volatile() >> DUE }
    }

    /// Releases a task by its vector, if it `is_due`: in the same time if not.
    #[inline]
    pub(super) fn pend(self, vector: Interrupt, is_due: bool) {
        if is_due {
            trace::release(vector);
        }
        let number = vector as usize;
        let register = RELEASE + 4 * (number / 32);
        self.write(register, u32::from(is_due) << (number % 32));
    }
}

/// Makes the time from the next interrupt to the one behind it that of the event that the step
/// interrupt did not know of.
pub(super) fn set_reload(event: StepEvent) {
    reload(registers(), event);
    // An interrupt that has come before that runs before this ends.
    dsb();
    isb();
}

/// Before [`start`]: the time to the first interrupt.
pub(super) fn set_up(event: StepEvent) {
    let timer = registers();
    reload(timer, event);
    clear_counter(timer);
    if emulation::is_emulated() {
        emulation::count(event.ticks());
    }
}

/// Interrupts for the first time when what has been set up is over; then as [`StepTimer::set_reload`].
/// Only while the timer stands, and with the lock around it.
#[inline]
pub(super) fn start(following: StepEvent) {
    let timer = registers();
    let counts = if emulation::is_emulated() {
        CORE_CYCLES
    } else {
        CORE_CYCLES | COUNTS
    };
    // It begins with the time that is in the register. Who preempts this may let it go round: then
    // the first interrupt is later, and the time behind it still right.
    control(timer, counts);
    dsb();
    reload(timer, following);
    control(timer, counts | INTERRUPTS);
}

/// No interrupt until the next [`start`], from the next instruction on; whoever interrupted.
pub(super) fn halt() {
    control(registers(), CORE_CYCLES);
    SCB::clear_pendst();
    // One that was on its way has run by then, and what it uses is used after that.
    dsb();
    isb();
}

/// Returns the core cycles since the event that is served was due. Until [`StepTimer::set_reload`],
/// the counter has begun with what is in the reload register.
#[cfg(all(feature = "trace", not(feature = "trace-emulated")))]
#[inline]
pub(super) fn lateness() -> u32 {
    let timer = registers();
    timer.rvr.read().wrapping_sub(timer.cvr.read())
}

/// Returns the ticks from the next interrupt to the one after it.
#[cfg(feature = "emulated")]
pub(super) fn reload_ticks() -> u32 {
    (registers().rvr.read() + 1) / CYCLES_PER_TICK
}

/// Returns whether an event is being waited for. Inlined, as code in RAM calls it.
#[inline(always)]
#[expect(clippy::inline_always, reason = "nothing in flash may be called")]
pub(super) fn is_running() -> bool {
    registers().csr.read() & INTERRUPTS != 0
}

#[inline]
#[expect(unsafe_code, reason = "a raw word for a register")]
fn reload(timer: &RegisterBlock, event: StepEvent) {
    // SAFETY: any number of 24 bits is legal, and this has 20.
    unsafe { timer.rvr.write(event.half_ticks_less_one()) };
}

#[inline]
#[expect(unsafe_code, reason = "a raw word for a register")]
fn clear_counter(timer: &RegisterBlock) {
    // SAFETY: whatever is written makes it zero; it stands.
    unsafe { timer.cvr.write(0) };
}

#[inline]
#[expect(unsafe_code, reason = "a raw word for a register")]
fn control(timer: &RegisterBlock, bits: u32) {
    // SAFETY: bits that the register has; the exception's handler is a task.
    unsafe { timer.csr.write(bits) };
}

/// The timer's registers, for others than the step interrupt: who starts the timer, while it stands;
/// who stops it, holding the same lock; and who sets a time while the interrupt has none to set.
#[inline(always)]
#[expect(clippy::inline_always, reason = "nothing in flash may be called")]
#[expect(unsafe_code, reason = "the interrupt owns the timer")]
fn registers() -> &'static RegisterBlock {
    // SAFETY: every processor of this kind has them.
    unsafe { &*SYST::PTR }
}
