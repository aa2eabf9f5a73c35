//! TIM9 to TIM14, RM0090 19: the crate's model of a general-purpose timer, in the layouts that it is not bound to.

use rigless::{
    device::ErasedDevice,
    soc::{
        st::tim::{Counter, Family, Kind, Part, Tim, Timer},
        stm32f427::{
            generated::{tim9, tim10},
            peripherals::{rcc, tim::PART},
        },
    },
};

/// TIM9 and TIM12.
#[derive(Debug, Clone, Copy)]
pub(super) struct TwoChannels;
/// TIM10, TIM13 and TIM14.
#[derive(Debug, Clone, Copy)]
pub(super) struct OneChannel;

impl Family for TwoChannels {
    type Register = tim9::Register;
    type Instance = Timer;
    const PART: &'static Part = &PART;
    const KINDS: &'static [Kind] = &[Kind::TwoChannelSlave];
}

impl Family for OneChannel {
    type Register = tim10::Register;
    type Instance = Timer;
    const PART: &'static Part = &PART;
    const KINDS: &'static [Kind] = &[Kind::OneChannel];
}

/// The timers with the clocks that they count, outputs of the clock controller, in the order of [`SmallTimers::model`].
///
/// They count the clock of their bus whether it is enabled for them or not: the crate drives no clock through their
/// enables. Without it, no register of theirs can be reached. TIM11 has a model that captures, too.
pub(super) const CLOCKS: [(&str, usize); 6] = [
    ("TIM9", rcc::APB2_TIMERS),
    ("TIM10", rcc::APB2_TIMERS),
    ("TIM12", rcc::APB1_TIMERS),
    ("TIM13", rcc::APB1_TIMERS),
    ("TIM14", rcc::APB1_TIMERS),
    ("TIM11", rcc::APB2_TIMERS),
];

#[derive(Debug)]
pub(super) struct SmallTimers {
    tim9: Tim<TwoChannels>,
    tim10: Tim<OneChannel>,
    tim12: Tim<TwoChannels>,
    tim13: Tim<OneChannel>,
    tim14: Tim<OneChannel>,
}

impl SmallTimers {
    pub(super) fn new() -> Self {
        const HZ: u64 = rcc::HSI_HZ;
        let two = |name| Timer::new(name, Counter::Narrow, Kind::TwoChannelSlave);
        let one = |name| Timer::new(name, Counter::Narrow, Kind::OneChannel);
        Self {
            tim9: Tim::with_clock(HZ, two("TIM9")),
            tim10: Tim::with_clock(HZ, one("TIM10")),
            tim12: Tim::with_clock(HZ, two("TIM12")),
            tim13: Tim::with_clock(HZ, one("TIM13")),
            tim14: Tim::with_clock(HZ, one("TIM14")),
        }
    }

    pub(super) fn model(&mut self, nth: usize) -> &mut dyn ErasedDevice {
        match nth {
            0 => &mut self.tim9,
            1 => &mut self.tim10,
            2 => &mut self.tim12,
            3 => &mut self.tim13,
            _ => &mut self.tim14,
        }
    }
}
