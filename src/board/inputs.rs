//! Input pins: the interrupts that release `inputs`, and its run.
//!
//! An edge on a pin releases the task at once and masks all lines until four samples have been
//! taken and the last one has found no change. The timer, TIM10, releases the task for the samples,
//! 250 µs apart. So there are at most five runs in a millisecond, whatever contacts and noise do.
//! The timer also releases the task twice a millisecond, for pins that share their interrupt line with
//! another pin.
//!
//! # Cost
//!
//! `inputs` has a deadline: everything in a run is inlined.

use leadscrew::{
    machine::{Inputs, SAMPLES, Watch},
    model::Levels,
    stepper::EventTap,
    tasks::{self, InputTrigger, SharedAtomics},
};

use super::{
    chosen::WIRING,
    contacts::{self, SampleTimer},
    pac,
    release::ChipPlatform,
    step_output::{StepInterrupt, StepTimerToken},
    supply, vectors, watchdog,
};

/// Time for the pull-ups to raise the cables of open contacts, core cycles: 10 ms, in which 50 kΩ
/// bring 160 nF, more than the capacitor of a filter at the pin, to the 0.7 of the supply that reads as high
/// (data sheet, I/O characteristics).
const PULL_UP_CYCLES: u32 = WIRING.core_hz / 100;

/// Priority of `inputs` in `src/app.rs`.
const PRIORITY: u8 = 3;

/// Interrupt lines of the inputs, one bit for each.
const LINES: u32 = lines();

/// The timer and the interrupt lines of the inputs, set up.
pub(crate) struct InputInterrupts {
    timer: SampleTimer,
    exti: pac::EXTI,
}

/// The pins and their filter, owned by `inputs`.
pub(crate) struct InputPins {
    timer: SampleTimer,
    exti: pac::EXTI,
    watch: Watch,
    events: EventTap<'static>,
    /// Whether samples are being taken.
    is_sampling: bool,
    /// Samples before the lines may be unmasked.
    masked_samples: u32,
}

impl InputInterrupts {
    /// Sets up the pins, the timer and the interrupt lines. The clocks of the ports, of the timer
    /// and of SYSCFG must run.
    #[expect(unsafe_code, reason = "raw words for registers")]
    pub(super) fn new(
        timer: pac::TIM10,
        exti: pac::EXTI,
        syscfg: &pac::SYSCFG,
        nvic: &mut pac::NVIC,
    ) -> Self {
        for input in WIRING.inputs {
            input.pin.make_input(input.pull);
        }
        watchdog::pause(PULL_UP_CYCLES);
        connect_lines(syscfg);
        // SAFETY: the bits of lines that exist.
        unsafe {
            exti.rtsr().write(|w| w.bits(LINES | supply::LINE));
            exti.ftsr().write(|w| w.bits(LINES));
            exti.imr().write(|w| w.bits(LINES | supply::LINE));
        }
        vectors::unmask(nvic, &LINE_VECTORS, PRIORITY);
        let timer = SampleTimer::new(timer);
        Self { timer, exti }
    }

    /// Returns the pins with their filter, which has the present levels, and the inputs.
    pub(crate) fn watch(self, events: EventTap<'static>) -> (InputPins, Inputs) {
        let wired = WIRING.inputs.iter();
        let inputs = Inputs::wired(wired.fold(Levels::NONE, |wired, input| wired | input.levels));
        let pins = InputPins {
            timer: self.timer,
            exti: self.exti,
            watch: Watch::new(contacts::read(), &inputs),
            events,
            is_sampling: false,
            masked_samples: 0,
        };
        (pins, inputs)
    }
}

impl InputPins {
    /// Runs `inputs`.
    pub(crate) fn serve(
        &mut self,
        shared: SharedAtomics<'_>,
        token: impl rtic::Mutex<T = StepTimerToken>,
    ) {
        let mut steps = StepInterrupt {
            token,
            event_tap: self.events,
        };
        let is_sample = self.timer.take_due() && self.is_sampling;
        // Before the pins are read, so that no later change is missed.
        let has_edge = if is_sample {
            self.clear_edges();
            // An edge that came since stays pending, as its line does.
            clear_pending();
            false
        } else {
            self.mask_lines_after_edge()
        };
        let trigger = if is_sample {
            InputTrigger::Sample
        } else {
            InputTrigger::Edge
        };
        let (closed, watch) = (contacts::read(), &mut self.watch);
        let needs_sample = tasks::inputs(
            trigger,
            closed,
            watch,
            shared,
            &mut steps,
            &mut ChipPlatform,
        );
        if is_sample {
            self.masked_samples = self.masked_samples.saturating_sub(1);
            if !needs_sample && self.masked_samples == 0 {
                self.stop_sampling();
            }
        } else {
            if (needs_sample || has_edge) && !self.is_sampling {
                self.start_sampling();
            }
            if has_edge {
                clear_pending();
            }
        }
    }

    /// Masks all lines if an edge has come. Returns whether one has. The pins are read after this:
    /// the sample sees a later change.
    #[expect(unsafe_code, reason = "raw words for registers")]
    fn mask_lines_after_edge(&mut self) -> bool {
        let has_edge = self.exti.pr().read().bits() & LINES != 0;
        if has_edge {
            // SAFETY: the bit of a line that exists.
            unsafe { self.exti.imr().write(|w| w.bits(supply::LINE)) };
        }
        has_edge
    }

    /// Clears the edges that have come. The pins are read after this: a later change is a new edge.
    #[expect(unsafe_code, reason = "raw words for a register")]
    fn clear_edges(&mut self) {
        // SAFETY: the bits of lines that exist; a one clears.
        unsafe { self.exti.pr().write(|w| w.bits(LINES)) };
    }

    /// Unmasks all lines.
    #[expect(unsafe_code, reason = "raw words for a register")]
    fn unmask_lines(&mut self) {
        // SAFETY: the bits of lines that exist.
        unsafe { self.exti.imr().write(|w| w.bits(LINES | supply::LINE)) };
    }

    fn start_sampling(&mut self) {
        self.is_sampling = true;
        self.masked_samples = SAMPLES;
        self.timer.start_sampling();
    }

    fn stop_sampling(&mut self) {
        self.is_sampling = false;
        self.timer.stop_sampling();
        self.unmask_lines();
    }
}

/// Clears releases of the task by lines whose edges have been cleared or masked: else each of their
/// vectors would run the task once more, for nothing.
#[expect(unsafe_code, reason = "raw words for registers")]
fn clear_pending() {
    // SAFETY: the vectors are those of this task.
    unsafe {
        let nvic = &*pac::NVIC::PTR;
        nvic.icpr[0].write(PENDING[0]);
        nvic.icpr[1].write(PENDING[1]);
    }
}

/// Returns the interrupt lines of all inputs.
const fn lines() -> u32 {
    let inputs = WIRING.inputs;
    let (mut lines, mut index) = (0, 0);
    while index < inputs.len() {
        lines |= 1 << inputs[index].pin.number();
        index += 1;
    }
    lines
}

/// Connects each line to the port of the first input whose pin has the number of the line.
#[expect(unsafe_code, reason = "pins are chosen by a table, not by type")]
fn connect_lines(syscfg: &pac::SYSCFG) {
    let mut words = [0; 4];
    for input in WIRING.inputs.iter().rev() {
        let (port, number) = (input.pin.port(), input.pin.number());
        let (word, shift) = (usize::from(number / 4), u32::from(number % 4) * 4);
        words[word] = words[word] & !(0xf << shift) | u32::from(port) << shift;
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

/// The vectors of all lines.
const LINE_VECTORS: [pac::Interrupt; 7] = [
    pac::Interrupt::EXTI0,
    pac::Interrupt::EXTI1,
    pac::Interrupt::EXTI2,
    pac::Interrupt::EXTI3,
    pac::Interrupt::EXTI4,
    pac::Interrupt::EXTI9_5,
    pac::Interrupt::EXTI15_10,
];

vectors::forward_vectors!(EXTI0, EXTI1, EXTI2, EXTI3, EXTI4, EXTI9_5, EXTI15_10 => TIM1_UP_TIM10);

/// The bits of these vectors in the first two registers of the NVIC that clear releases.
const PENDING: [u32; 2] = {
    let mut words = [0; 2];
    let mut index = 0;
    while index < LINE_VECTORS.len() {
        let number = LINE_VECTORS[index] as usize;
        words[number / 32] |= 1 << (number % 32);
        index += 1;
    }
    words
};
