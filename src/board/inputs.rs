//! Input pins: what releases `inputs`, and what it reads.
//!
//! An edge on a pin releases the task at once. While contacts bounce, a timer releases it for a
//! sample, and a pin that has had its edge has no other before the task is content: so no noise can
//! take more of the processor than that. The timer also looks slowly at all times, for pins that
//! share their interrupt line with another's.

use leadscrew::{
    machine::{Cause, Inputs, Levels, SAMPLE_TICKS, Watch, Watched},
    protocol::realtime::Requests,
    stepper::{EventTap, StepCounts},
    units::TICKS_PER_US,
};

use super::{chosen, emulation, pac, release::PREPARE};

/// Time between two looks while nothing happens, µs.
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
    /// Lines that have had their edge since the task was content.
    silenced: u32,
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
            silenced: 0,
        };
        (pins, inputs)
    }
}

impl InputPins {
    /// The body of `inputs`.
    #[inline]
    pub(crate) fn serve(&mut self, requests: &Requests, inputs: &Inputs, counts: &StepCounts) {
        let cause = self.cause();
        let (watch, events) = (&mut self.watch, &self.events);
        let watched = watch.run(cause, read(), inputs, requests, counts, events);
        if watched.prepare {
            rtic::pend(PREPARE);
        }
        self.follow(watched);
    }

    /// Why the task runs. From now on whatever changes releases it again.
    #[inline]
    #[expect(unsafe_code, reason = "raw words for a register")]
    fn cause(&mut self) -> Cause {
        let is_due = self.timer.sr().read().uif().bit_is_set() || emulation::is_sample();
        if is_due {
            self.timer.sr().write(|w| w.uif().clear_bit());
        }
        let edges = self.exti.pr().read().bits() & LINES;
        self.silenced |= edges;
        // SAFETY: the bits of lines that exist; a one clears.
        unsafe { self.exti.pr().write(|w| w.bits(edges)) };
        if is_due && self.is_sampling {
            Cause::Sample
        } else {
            Cause::Edge
        }
    }

    /// Takes samples from now on if the task asks for them, or else waits for edges.
    #[inline]
    #[expect(unsafe_code, reason = "raw words for a register")]
    fn follow(&mut self, watched: Watched) {
        if watched.sample != self.is_sampling {
            self.is_sampling = watched.sample;
            set_period(
                &self.timer,
                if watched.sample { SAMPLE_US } else { SLOW_US },
            );
            emulation::sample_every(if watched.sample { SAMPLE_TICKS } else { 0 });
        }
        if !watched.sample {
            self.silenced = 0;
        }
        // SAFETY: the bits of lines that exist. An edge on a line that was silenced interrupts now.
        unsafe { self.exti.imr().write(|w| w.bits(LINES & !self.silenced)) };
    }
}

fn set_period(timer: &pac::TIM7, period_us: u16) {
    timer.arr().write(|w| w.arr().set(period_us - 1));
    timer.egr().write(|w| w.ug().set_bit());
}

/// The contacts that are closed: those whose pins are low.
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

/// The lines of all inputs.
const fn lines() -> u32 {
    let inputs = chosen::WIRING.inputs;
    let (mut lines, mut index) = (0, 0);
    while index < inputs.len() {
        lines |= 1 << inputs[index].1.place().1;
        index += 1;
    }
    lines
}

/// Connects each line with the port of the first input that has its number.
#[expect(unsafe_code, reason = "pins are chosen by a table, not by type")]
fn choose_ports(syscfg: &pac::SYSCFG) {
    let mut words = [0; 4];
    for (_, pin) in chosen::WIRING.inputs.iter().rev() {
        let (port, number) = pin.place();
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

call_inputs!(EXTI0, EXTI1, EXTI2, EXTI3, EXTI4, EXTI9_5, EXTI15_10);

#[expect(unsafe_code, reason = "the handler is RTIC's")]
unsafe extern "C" {
    fn TIM7();
}
