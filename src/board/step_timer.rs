//! The step timer: TIM2, 32 bits, running freely at 84 MHz, with output compare.
//!
//! A reload value written too late would make a counter run for a whole wrap; a compare that has
//! already passed can be seen, and forced. Its registers are 12 core cycles away, so they are
//! touched three times an event, after the pins.

use core::sync::atomic::{AtomicU32, Ordering::Relaxed, Ordering::SeqCst, compiler_fence};

use super::pac;

/// When the event being waited for is due, timer ticks.
///
/// Written by the step interrupt while the timer runs, and by [`start`] while it stands.
static DUE: AtomicU32 = AtomicU32::new(0);

/// The step interrupt's side of the timer.
pub(super) struct StepTimer(pac::TIM2);

impl StepTimer {
    /// Lets the counter run, without interrupts. The peripheral's clock must run.
    pub(super) fn new(timer: pac::TIM2, prescaler: u16) -> Self {
        timer.psc().write(|w| w.psc().set(prescaler));
        timer.egr().write(|w| w.ug().set_bit());
        timer.cr1().write(|w| w.cen().set_bit());
        Self(timer)
    }

    /// Ends the interrupt now being served.
    #[inline]
    pub(super) fn acknowledge(&mut self) {
        self.0.sr().write(|w| w.cc1if().clear_bit());
    }

    /// No interrupt until the next [`start`].
    pub(super) fn stop(&mut self) {
        self.0.dier().write(|w| w.cc1ie().clear_bit());
    }

    /// Interrupts again `ticks` after the event before. Whether that time has already passed: then
    /// it interrupts at once.
    #[inline]
    pub(super) fn schedule(&mut self, ticks: u32) -> bool {
        let due = DUE.load(Relaxed).wrapping_add(ticks);
        DUE.store(due, Relaxed);
        self.0.ccr1().write(|w| w.ccr().set(due));
        let now = self.0.cnt().read().cnt().bits();
        let is_late = now.wrapping_sub(due).cast_signed() >= 0;
        if is_late {
            self.force();
        }
        is_late
    }

    /// Interrupts at once.
    #[cold]
    #[inline(never)]
    fn force(&mut self) {
        self.0.egr().write(|w| w.cc1g().set_bit());
    }
}

/// Interrupts now and counts from now. Only while the timer is stopped.
#[expect(unsafe_code, reason = "the interrupt owns the timer")]
pub(super) fn start() {
    // SAFETY: the step interrupt touches neither the registers nor `DUE` while it is stopped, and
    // there is one caller, the task that prepares motion.
    let timer = unsafe { &*pac::TIM2::ptr() };
    DUE.store(timer.cnt().read().cnt().bits(), Relaxed);
    // From the next write on, the interrupt owns `DUE`.
    compiler_fence(SeqCst);
    timer.egr().write(|w| w.cc1g().set_bit());
    timer.dier().write(|w| w.cc1ie().set_bit());
}

/// When the event being waited for is due.
#[cfg(feature = "board-netduino-plus-2")]
pub(super) fn due() -> u32 {
    DUE.load(Relaxed)
}

/// Whether an event is being waited for. Also for code in RAM: it is inlined there.
#[inline(always)]
#[expect(clippy::inline_always, reason = "nothing in flash may be called")]
#[expect(unsafe_code, reason = "the interrupt owns the timer")]
pub(super) fn is_running() -> bool {
    // SAFETY: reads a register without side effects.
    unsafe { (*pac::TIM2::ptr()).dier().read().cc1ie().bit_is_set() }
}

/// The time on the timer's clock.
#[cfg(feature = "board-netduino-plus-2")]
#[expect(unsafe_code, reason = "the interrupt owns the timer")]
pub(super) fn now() -> u32 {
    // SAFETY: reads a register without side effects.
    unsafe { (*pac::TIM2::ptr()).cnt().read().cnt().bits() }
}

/// Sets the clock.
#[cfg(feature = "board-netduino-plus-2")]
#[expect(unsafe_code, reason = "the interrupt owns the timer")]
pub(super) fn set(time: u32) {
    // SAFETY: only the emulator's stand-in for the compare calls this.
    unsafe { (*pac::TIM2::ptr()).cnt().write(|w| w.cnt().set(time)) };
}
