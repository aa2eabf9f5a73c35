//! Input pins: what releases `inputs`, and what it reads.
//!
//! An edge on a pin releases the task at once, and then no other edge does for four samples, nor
//! before one has found nothing new. The timer releases the task for the samples, 250 µs apart. So
//! whatever contacts and noise do, there are at most five runs in a millisecond. The timer also
//! releases the task each millisecond, for pins that share their interrupt line with another's.

use leadscrew::{
    machine::{Inputs, SAMPLE_TICKS, SAMPLES, Watch},
    model::Levels,
    stepper::EventTap,
    tasks::{self, InputTrigger, Unlocked},
    units::TICKS_PER_US,
};

use super::{
    ChipPlatform, chosen, emulation, pac,
    step_output::{StepInterrupt, StepSwitch},
};

/// Time between two runs while nothing happens, µs.
const SLOW_US: u16 = 1000;
/// Time between two samples, µs.
const SAMPLE_US: u16 = (SAMPLE_TICKS / TICKS_PER_US) as u16;

/// Time for the pull-ups, 30 to 50 kΩ, to raise the cables of open contacts: 100 µs.
const RISE_CYCLES: u32 = 16_800;

/// Priority 3 as the NVIC has it: that of `inputs`, whose timer RTIC knows.
const PRIORITY: u8 = (16 - 3) << 4;

/// Lines that interrupt, one bit for each.
const LINES: u32 = lines();

/// The pins and what interrupts for them.
pub(crate) struct InputTimer {
    timer: pac::TIM7,
    exti: pac::EXTI,
}

/// The pins and their filter, owned by `inputs`.
pub(crate) struct InputPins {
    timer: pac::TIM7,
    exti: pac::EXTI,
    watch: Watch,
    events: EventTap<'static>,
    /// Samples are taken.
    is_sampling: bool,
    /// Samples before another edge may release the task.
    silent: u32,
}

impl InputTimer {
    /// Sets up the pins, the timer and the lines' interrupts. The clocks of the ports, of the timer
    /// and of SYSCFG must run; the timer's is 84 MHz.
    #[expect(unsafe_code, reason = "vectors that RTIC does not manage")]
    pub(super) fn new(
        timer: pac::TIM7,
        exti: pac::EXTI,
        syscfg: &pac::SYSCFG,
        nvic: &mut pac::NVIC,
    ) -> Self {
        for (_, pin) in chosen::WIRING.inputs {
            pin.make_input();
        }
        cortex_m::asm::delay(RISE_CYCLES);
        choose_ports(syscfg);
        // SAFETY: the bits of lines that exist.
        unsafe {
            exti.rtsr().write(|w| w.bits(LINES));
            exti.ftsr().write(|w| w.bits(LINES));
            exti.imr().write(|w| w.bits(LINES));
        }
        for vector in VECTORS {
            // SAFETY: RTIC keeps interrupts off until `init` has returned, and the priority is that
            // of the only task that the vectors call.
            unsafe {
                nvic.set_priority(vector, PRIORITY);
                pac::NVIC::unmask(vector);
            }
        }
        timer.psc().write(|w| w.psc().set(84 - 1));
        timer.cr1().write(|w| w.urs().set_bit());
        timer.dier().write(|w| w.uie().set_bit());
        let new = Self { timer, exti };
        set_period(&new.timer, SLOW_US);
        new.timer.cr1().write(|w| w.urs().set_bit().cen().set_bit());
        new
    }

    /// Watches the pins from now on.
    pub(crate) fn watch(self, events: EventTap<'static>) -> (InputPins, Inputs) {
        let wired = chosen::WIRING.inputs.iter();
        let inputs = Inputs::wired(wired.fold(Levels::NONE, |wired, (input, _)| wired | *input));
        let pins = InputPins {
            timer: self.timer,
            exti: self.exti,
            watch: Watch::new(read(), &inputs),
            events,
            is_sampling: false,
            silent: 0,
        };
        (pins, inputs)
    }
}

impl InputPins {
    /// The body of `inputs`.
    #[inline]
    pub(crate) fn serve(&mut self, shared: Unlocked<'_>, switch: impl rtic::Mutex<T = StepSwitch>) {
        let mut steps = StepInterrupt {
            switch,
            played: self.events,
        };
        let is_sample = take_due(&self.timer) && self.is_sampling;
        // Before the pins are read: what comes later must not be missed.
        let has_edge = if is_sample {
            self.forget_edges();
            false
        } else {
            self.silence()
        };
        let trigger = if is_sample {
            InputTrigger::Sample
        } else {
            InputTrigger::Edge
        };
        let (closed, watch) = (read(), &mut self.watch);
        let needs_sample = tasks::inputs(
            trigger,
            closed,
            watch,
            shared,
            &mut steps,
            &mut ChipPlatform,
        );
        if is_sample {
            self.silent = self.silent.saturating_sub(1);
            if !needs_sample && self.silent == 0 {
                self.stop_sampling();
            }
        } else {
            if (needs_sample || has_edge) && !self.is_sampling {
                self.start_sampling();
            }
            if has_edge {
                unpend();
            }
        }
    }

    /// Lets no line interrupt any more if one has. Returns whether one has. The pins are read after
    /// this: a later change is left for the sample.
    #[inline]
    #[expect(unsafe_code, reason = "raw words for registers")]
    fn silence(&mut self) -> bool {
        let has_edge = self.exti.pr().read().bits() & LINES != 0;
        if has_edge {
            // SAFETY: no line but those of this task interrupts.
            unsafe { self.exti.imr().write(|w| w.bits(0)) };
        }
        has_edge
    }

    /// Clears the edges so far. The pins are read after this: a later change is an edge.
    #[inline]
    #[expect(unsafe_code, reason = "raw words for a register")]
    fn forget_edges(&mut self) {
        // SAFETY: the bits of lines that exist; a one clears.
        unsafe { self.exti.pr().write(|w| w.bits(LINES)) };
    }

    /// Lets all lines interrupt again.
    #[inline]
    #[expect(unsafe_code, reason = "raw words for a register")]
    fn listen(&mut self) {
        // SAFETY: the bits of lines that exist.
        unsafe { self.exti.imr().write(|w| w.bits(LINES)) };
    }

    #[inline]
    fn start_sampling(&mut self) {
        self.is_sampling = true;
        self.silent = SAMPLES;
        set_period(&self.timer, SAMPLE_US);
        emulation::sample_every(SAMPLE_TICKS);
    }

    #[inline]
    fn stop_sampling(&mut self) {
        self.is_sampling = false;
        // The counter is below that, and goes on.
        self.timer.arr().write(|w| w.arr().set(SLOW_US - 1));
        emulation::sample_every(0);
        self.listen();
    }
}

/// Releases the task no more for other lines' edges: the pins have been read, and all are silent.
#[inline]
#[expect(unsafe_code, reason = "raw words for registers")]
fn unpend() {
    // SAFETY: only vectors of this task are released no more.
    unsafe {
        let nvic = &*pac::NVIC::PTR;
        nvic.icpr[0].write(PENDING[0]);
        nvic.icpr[1].write(PENDING[1]);
    }
}

/// Returns once whether the timer, or the emulator, releases the task for a sample.
#[inline]
fn take_due(timer: &pac::TIM7) -> bool {
    let is_due = timer.sr().read().uif().bit_is_set() || emulation::is_sample();
    if is_due {
        timer.sr().write(|w| w.uif().clear_bit());
    }
    is_due
}

/// Ticks, of a microsecond each, since the timer released the task; `None` if it has not.
#[cfg(feature = "trace")]
#[inline]
#[expect(unsafe_code, reason = "the task owns the timer")]
pub(super) fn timer_age() -> Option<u16> {
    // SAFETY: reads registers without side effects.
    let timer = unsafe { &*pac::TIM7::ptr() };
    // In this order: the flag of a time that ends in between must not go with the time before it.
    let is_due = timer.sr().read().uif().bit_is_set();
    let age = timer.cnt().read().cnt().bits();
    is_due.then_some(age)
}

fn set_period(timer: &pac::TIM7, period_us: u16) {
    timer.arr().write(|w| w.arr().set(period_us - 1));
    timer.egr().write(|w| w.ug().set_bit());
}

/// Returns the contacts that are closed: those whose pins are low.
#[inline]
#[expect(unsafe_code, reason = "pins are chosen by a table, not by type")]
fn read() -> Levels {
    if emulation::is_emulated() {
        return emulation::contacts();
    }
    // SAFETY: reads registers without side effects.
    let ports = unsafe {
        [
            (*pac::GPIOA::ptr()).idr().read().bits(),
            (*pac::GPIOB::ptr()).idr().read().bits(),
            (*pac::GPIOC::ptr()).idr().read().bits(),
        ]
    };
    let mut closed = Levels::NONE;
    // wcet-bound: 11
    for &(input, pin) in chosen::WIRING.inputs {
        if pin.is_low(ports) {
            closed = closed | input;
        }
    }
    closed
}

/// Returns the lines of all inputs.
const fn lines() -> u32 {
    let inputs = chosen::WIRING.inputs;
    let (mut lines, mut index) = (0, 0);
    while index < inputs.len() {
        lines |= 1 << inputs[index].1.port_and_number().1;
        index += 1;
    }
    lines
}

/// Connects each line with the port of the first input that has its number.
#[expect(unsafe_code, reason = "pins are chosen by a table, not by type")]
fn choose_ports(syscfg: &pac::SYSCFG) {
    let mut words = [0; 4];
    for (_, pin) in chosen::WIRING.inputs.iter().rev() {
        let (port, number) = pin.port_and_number();
        let (word, shift) = (usize::from(number / 4), u32::from(number % 4) * 4);
        words[word] = words[word] & !(0xf << shift) | (port as u32) << shift;
    }
    let [first, second, third, fourth] = words;
    // SAFETY: each field holds the number of a port that exists.
    unsafe {
        syscfg.exticr1().write(|w| w.bits(first));
        syscfg.exticr2().write(|w| w.bits(second));
        syscfg.exticr3().write(|w| w.bits(third));
        syscfg.exticr4().write(|w| w.bits(fourth));
    }
}

/// Makes the vectors of all lines call `inputs`.
macro_rules! call_inputs {
    ($($vector:ident),*) => {
        const VECTORS: [pac::Interrupt; 7] = [$(pac::Interrupt::$vector),*];
        $(
            #[unsafe(no_mangle)]
            #[expect(unsafe_code, reason = "the handler is RTIC's")]
            extern "C" fn $vector() {
                // SAFETY: the vector of `inputs`, whose priority this one has: the task is never
                // interrupted by itself.
                unsafe { TIM7() }
            }
        )*
    };
}

/// The vectors' bits in the registers that release.
const PENDING: [u32; 2] = {
    let mut words = [0; 2];
    let mut index = 0;
    while index < VECTORS.len() {
        let number = VECTORS[index] as usize;
        words[number / 32] |= 1 << (number % 32);
        index += 1;
    }
    words
};

call_inputs!(EXTI0, EXTI1, EXTI2, EXTI3, EXTI4, EXTI9_5, EXTI15_10);

#[expect(unsafe_code, reason = "the handler is RTIC's")]
unsafe extern "C" {
    fn TIM7();
}
