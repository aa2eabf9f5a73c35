//! The registers at rest, compared with what the board's file says.

use std::{collections::BTreeMap, fs, path::Path};

use board_data::{Board, Pin, Pull, PwmOutput, SerialPins, Wiring};

use crate::{
    bench::{Bench, Link},
    bootloader::MOST_INTERRUPTS,
    machine::Machine,
    usb_host::PERIOD_US,
};

pub(crate) mod usb;

/// Registers: RM0090 2.3, 3.9, 7.3, 8.4, 17.4, 18.4, 21.4 and 30.6.
const FLASH_ACR: u64 = 0x4002_3C00;
const SYSCFG_EXTICR1: u64 = 0x4001_3808;
const EXTI_IMR: u64 = 0x4001_3C00;
const EXTI_RTSR: u64 = 0x4001_3C08;
const EXTI_FTSR: u64 = 0x4001_3C0C;
const EXTI_PR: u64 = 0x4001_3C14;
const PWR_CR: u64 = 0x4000_7000;
const RCC_BDCR: u64 = 0x4002_3870;
const IWDG_PR: u64 = 0x4000_3004;
const IWDG_RLR: u64 = 0x4000_3008;
const GPIO: u64 = 0x4002_0000;
const MODER: u64 = 0x00;
const OTYPER: u64 = 0x04;
const PUPDR: u64 = 0x0C;
const ODR: u64 = 0x14;
const AFRL: u64 = 0x20;
/// Of a USART.
const BRR: u64 = 0x08;
/// The timer of `usb`.
const TIM11: u64 = 0x4001_4800;
/// Of a timer.
const CR1: u64 = 0x00;
const CCER: u64 = 0x20;
const PSC: u64 = 0x28;
const ARR: u64 = 0x2C;
const CCR1: u64 = 0x34;
const CCMR1: u64 = 0x18;
const BDTR: u64 = 0x44;

/// Of the processor, which a debug probe reads: ISER, IPR, SHPR3, VTOR, AIRCR, ICSR.
const ENABLES: usize = MOST_INTERRUPTS.div_ceil(32);
const PRIORITIES: usize = MOST_INTERRUPTS.div_ceil(4);
pub(crate) const ADDRESSES: [u32; ENABLES + PRIORITIES + 4] = addresses();

const fn addresses() -> [u32; ENABLES + PRIORITIES + 4] {
    let mut addresses = [0; ENABLES + PRIORITIES + 4];
    let mut nth = 0;
    while nth < ENABLES {
        addresses[nth] = 0xE000_E100 + 4 * nth as u32;
        nth += 1;
    }
    while nth < ENABLES + PRIORITIES {
        addresses[nth] = 0xE000_E400 + 4 * (nth - ENABLES) as u32;
        nth += 1;
    }
    addresses[nth] = 0xE000_ED20;
    addresses[nth + 1] = 0xE000_ED08;
    addresses[nth + 2] = 0xE000_ED0C;
    addresses[nth + 3] = 0xE000_ED04;
    addresses
}

/// Periods of the PWM in a second, about: the nearest that a whole prescaler gives.
const PWM_HZ: f64 = 5147.0;
const BAUD: f64 = 115_200.0;
/// How far a frequency may be off.
const TOLERANCE: f64 = 0.005;
const PWM_TOLERANCE: f64 = 0.03;
/// Tasks that src/app.rs binds to vectors of the chip, at least.
const LEAST_PRIORITIES: usize = 6;
/// How long the watchdog may wait at least, ms, and its clock at its fastest, kHz: data sheets, LSI.
const WATCHDOG_MS: std::ops::Range<f64> = 100.0..200.0;
const LSI_KHZ: f64 = 47.0;

/// What a pin should be.
#[derive(Debug, Clone, Copy, PartialEq, Eq, Default)]
struct Mode {
    /// `MODER`: 0 input, 1 output, 2 alternate function.
    direction: u64,
    /// `OTYPER`: an open drain.
    is_open_drain: bool,
    /// `PUPDR`.
    pull: u64,
    /// `AFR`, of an alternate function.
    function: u64,
    /// `ODR`, of an output that has a level of rest.
    is_high: bool,
}

impl Mode {
    fn output(is_high: bool) -> Self {
        Self {
            direction: 1,
            is_high,
            ..Self::default()
        }
    }

    fn function(function: u64) -> Self {
        Self {
            direction: 2,
            function,
            ..Self::default()
        }
    }
}

/// What the chip's own bootloader finds as out of a reset with BOOT0 high: RM0090 3.9.1, 7.3, 9.3.1, 12.3.1, 26.6.20.
pub(crate) fn not_as_for_rom(machine: &mut Machine) -> Vec<String> {
    const WANTED: [(&str, u64, u64); 9] = [
        ("RCC_CR", 0x4002_3800, 0x83),
        ("RCC_PLLCFGR", 0x4002_3804, 0x2400_3010),
        ("RCC_CFGR", 0x4002_3808, 0),
        ("RCC_AHB1ENR", 0x4002_3830, 0x10_0000),
        ("RCC_APB1ENR", 0x4002_3840, 0),
        ("RCC_APB2ENR", 0x4002_3844, 0x4000),
        ("FLASH_ACR", FLASH_ACR, 0),
        ("EXTI_IMR", EXTI_IMR, 0),
        ("RTC_BKP19R", 0x4000_289C, 0),
    ];
    let words = WANTED.map(|(name, address, wanted)| (name, machine.chip.word(address), wanted));
    let others = words.into_iter().filter(|(_, word, wanted)| word != wanted);
    others
        .map(|(name, word, wanted)| {
            format!("{name} is {word:#x} before the chip's own bootloader, not {wanted:#x}")
        })
        .collect()
}

/// Everything that differs.
pub(crate) fn faults(bench: &Bench, machine: &mut Machine, words: &[u32]) -> Vec<String> {
    let Ok(wiring) = bench.wiring() else {
        return vec!["the board has no such wiring".into()];
    };
    let mut faults = clocks(&bench.board, wiring, machine);
    let pending = machine.chip.word(EXTI_PR);
    if pending != 0 {
        faults.push(format!("EXTI_PR is {pending:#x}: a flag is not cleared"));
    }
    match bench.link() {
        Link::Uart => faults.extend(baud_fault(wiring, machine)),
        Link::Usb => faults.extend(usb::faults(&mut machine.chip)),
    }
    faults.extend(lines(wiring, machine));
    faults.extend(pins(&expected(bench.link(), wiring), machine));
    faults.extend(processor(bench, words));
    faults
}

fn clocks(board: &Board, wiring: &Wiring, machine: &mut Machine) -> Vec<String> {
    let mut faults = Vec::new();
    let clocks = board.chip.clocks;
    let [core, apb1, apb2] = machine.chip.frequencies().map(|hz| hz as f64 / 1e6);
    let core_mhz = f64::from(clocks.core_mhz);
    for (name, mhz, expected) in [
        ("the core", core, core_mhz),
        ("APB1", apb1, core_mhz / f64::from(clocks.apb1_divider)),
        ("APB2", apb2, core_mhz / f64::from(clocks.apb2_divider)),
    ] {
        if (mhz / expected - 1.0).abs() > TOLERANCE {
            faults.push(format!(
                "{name} runs at {mhz} MHz instead of {expected} (RCC_CFGR, RCC_PLLCFGR)"
            ));
        }
    }
    // The highest voltage of the regulator, for the clock of every board: RM0090 5.4.1, RM0383 5.4.1.
    let scale = machine.chip.word(PWR_CR) >> 14 & 3;
    if scale & 2 == 0 || board.chip.hal == "f411" && scale != 3 {
        faults.push(format!(
            "VOS of PWR_CR is {scale:#b}: the voltage is for a slower clock"
        ));
    }
    let wait_states = machine.chip.word(FLASH_ACR) & 15;
    if wait_states != u64::from(clocks.flash_wait_states) {
        let expected = clocks.flash_wait_states;
        faults.push(format!(
            "FLASH_ACR has {wait_states} wait states instead of {expected}"
        ));
    }
    let prescaler = f64::from(4_u32 << (machine.chip.word(IWDG_PR) & 7));
    let ms = prescaler * (machine.chip.word(IWDG_RLR) + 1) as f64 / LSI_KHZ;
    if !WATCHDOG_MS.contains(&ms) {
        faults.push(format!(
            "the watchdog waits {ms:.0} ms at least (IWDG_PR, IWDG_RLR)"
        ));
    }
    if wiring.has_usb {
        let [prescaler, last] = [PSC, ARR].map(|offset| machine.chip.word(TIM11 + offset));
        let us = (prescaler + 1) * (last + 1) / u64::from(clocks.apb2_timers_mhz());
        if us != PERIOD_US {
            faults.push(format!("TIM11: USB's period is {us} µs, not {PERIOD_US}"));
        }
    }
    if let Some((_, pwm)) = wiring.pwm {
        let timers_mhz = match pwm.timer {
            1 | 8 => clocks.apb2_timers_mhz(),
            _ => clocks.apb1_timers_mhz(),
        };
        let base = u64::from(pwm.base());
        faults.extend(pwm_fault(pwm, f64::from(timers_mhz) * 1e6, |offset| {
            machine.chip.word(base + offset)
        }));
    }
    faults
}

/// The baud rate of the sender's serial port.
fn baud_fault(wiring: &Wiring, machine: &mut Machine) -> Option<String> {
    let usart = wiring.serial.usart;
    let [_, apb1, apb2] = machine.chip.frequencies();
    let (base, bus_hz) = match usart {
        1 => (0x4001_1000, apb2),
        6 => (0x4001_1400, apb2),
        2 => (0x4000_4400, apb1),
        _ => (0x4000_4800, apb1),
    };
    let baud = bus_hz as f64 / machine.chip.word(base + BRR).max(1) as f64;
    let is_wrong = (baud / BAUD - 1.0).abs() > TOLERANCE;
    is_wrong.then(|| format!("USART{usart}_BRR makes {baud:.0} baud instead of {BAUD}"))
}

/// The PWM runs with its frequency, and is off.
fn pwm_fault(output: PwmOutput, clock_hz: f64, mut at: impl FnMut(u64) -> u64) -> Option<String> {
    let timer = output.timer;
    let hz = clock_hz / ((at(PSC) + 1) * (at(ARR) + 1)) as f64;
    if (hz / PWM_HZ - 1.0).abs() > PWM_TOLERANCE {
        return Some(format!(
            "TIM{timer}_PSC and TIM{timer}_ARR make {hz:.0} Hz of the PWM instead of about {PWM_HZ}"
        ));
    }
    let channel = u64::from(output.channel) - 1;
    // PWM mode 1, active high, on this channel alone: RM0090 17.4.7, 17.4.9 and 17.4.18.
    let mode = at(CCMR1 + channel / 2 * 4) >> (4 + channel % 2 * 8) & 7;
    if mode != 0b110 || at(CCER) != 1 << (4 * channel) {
        return Some(format!(
            "TIM{timer}_CCMR and TIM{timer}_CCER: the PWM is not that of channel {}",
            channel + 1
        ));
    }
    if matches!(timer, 1 | 8) && at(BDTR) >> 15 & 1 == 0 {
        return Some(format!("TIM{timer}_BDTR: MOE is not set"));
    }
    if at(CR1) & 1 == 0 {
        return Some(format!("TIM{timer}, of the PWM, does not run"));
    }
    let is_on = at(CCR1 + 4 * channel) != 0;
    is_on.then(|| format!("the PWM of TIM{timer} is on"))
}

/// Whether the PWM of a board that has one is high for a part of the time.
pub(crate) fn pwm_is_high(bench: &Bench, machine: &mut Machine) -> Option<bool> {
    let (_, pwm) = bench.wiring().ok()?.pwm?;
    let channel = u64::from(pwm.channel) - 1;
    let compared = u64::from(pwm.base()) + CCR1 + 4 * channel;
    Some(machine.chip.word(compared) != 0)
}

/// The lines of the inputs that interrupt: their ports, and both edges.
fn lines(wiring: &Wiring, machine: &mut Machine) -> Vec<String> {
    let polled = wiring.polled();
    let inputs = wiring
        .inputs
        .iter()
        .filter(|(input, _)| !polled.contains(input));
    let mut faults = Vec::new();
    for (input, signed) in inputs {
        let number = u64::from(signed.pin.number);
        let port = machine.chip.word(SYSCFG_EXTICR1 + number / 4 * 4) >> (number % 4 * 4) & 15;
        if port != u64::from(signed.pin.port) {
            faults.push(format!(
                "SYSCFG_EXTICR: line {number}, {}, is that of port {port}",
                input.key()
            ));
        }
        for (name, register) in [("IMR", EXTI_IMR), ("RTSR", EXTI_RTSR), ("FTSR", EXTI_FTSR)] {
            if machine.chip.word(register) >> number & 1 == 0 {
                faults.push(format!(
                    "EXTI_{name}: line {number}, {}, is off",
                    input.key()
                ));
            }
        }
    }
    faults
}

/// The pins of the board's file that are in use, each with its function and the expected mode.
fn expected(link: Link, wiring: &Wiring) -> BTreeMap<Pin, (String, Mode)> {
    let mut all: BTreeMap<Pin, (String, Mode)> = BTreeMap::new();
    let outputs = outputs(wiring).into_iter();
    all.extend(outputs.map(|(pin, name, is_high)| (pin, (name.to_owned(), Mode::output(is_high)))));
    for (input, signed) in &wiring.inputs {
        let pull = match signed.pull {
            Pull::None => 0,
            Pull::Up => 1,
            Pull::Down => 2,
        };
        let mode = Mode {
            pull,
            ..Mode::default()
        };
        all.insert(signed.pin, (input.key(), mode));
    }
    if let Some(eeprom) = &wiring.eeprom {
        let wire = Mode {
            is_open_drain: true,
            ..Mode::output(true)
        };
        all.insert(eeprom.clock, ("the EEPROM's clock".into(), wire));
        all.insert(eeprom.data, ("the EEPROM's data".into(), wire));
    }
    // Alternate functions: data sheets.
    if link == Link::Uart {
        let serial = Mode::function(if wiring.serial.usart == 6 { 8 } else { 7 });
        let SerialPins {
            transmit, receive, ..
        } = wiring.serial;
        all.insert(transmit, ("the sender's output".into(), serial));
        all.insert(receive, ("the sender's input".into(), serial));
    }
    if let Some((pin, pwm)) = wiring.pwm {
        let function = match pwm.timer {
            1 | 2 => 1,
            3..=5 => 2,
            8 => 3,
            _ => 9,
        };
        all.insert(pin, ("the PWM's output".into(), Mode::function(function)));
    }
    all
}

/// The outputs, each with its function and its level at rest, true if high.
fn outputs(wiring: &Wiring) -> Vec<(Pin, &'static str, bool)> {
    let motors = wiring.step.iter().chain(&wiring.direction);
    let coils = wiring.phases.as_flattened().iter();
    let second = wiring.second.iter();
    let signed = [
        wiring.spindle,
        wiring.counter_clockwise,
        wiring.flood,
        wiring.mist,
    ];
    let signed = signed.iter().flatten().chain(&wiring.enable);
    let at_boot = wiring.at_boot.iter();
    at_boot
        .map(|&(pin, is_high)| (pin, "at_boot", is_high))
        .chain(motors.map(|&pin| (pin, "a motor's output", false)))
        .chain(coils.map(|&pin| (pin, "a motor's coil", false)))
        .chain(second.map(|motor| (motor.step, "a second motor's step", false)))
        .chain(signed.map(|it| (it.pin, "an output that is off", it.is_active_low)))
        .collect()
}

fn pins(expected: &BTreeMap<Pin, (String, Mode)>, machine: &mut Machine) -> Vec<String> {
    let mut faults = Vec::new();
    for (&pin, (name, mode)) in expected {
        let number = u64::from(pin.number);
        let port = GPIO + 0x400 * u64::from(pin.port);
        let mut bits = |register: u64, width: u64| {
            machine.chip.word(port + register) >> (width * number) & ((1 << width) - 1)
        };
        let mut is = Mode {
            direction: bits(MODER, 2),
            is_open_drain: bits(OTYPER, 1) == 1,
            pull: bits(PUPDR, 2),
            function: 0,
            is_high: bits(ODR, 1) == 1 && mode.direction == 1,
        };
        if mode.direction == 2 {
            let register = port + AFRL + number / 8 * 4;
            is.function = machine.chip.word(register) >> (4 * (number % 8)) & 15;
        }
        // A resistor at an output changes nothing, nor does one at the sender's input.
        if mode.direction != 0 {
            is.pull = mode.pull;
        }
        if is != *mode {
            faults.push(differs(pin, name, is, *mode));
        }
    }
    let is_oscillator = |pin: &Pin| pin.letter() == 'C' && pin.number >= 14;
    if expected.keys().any(is_oscillator) && machine.chip.word(RCC_BDCR) & 1 != 0 {
        faults.push("LSEON of RCC_BDCR is set: C14 and C15 are the oscillator's".into());
    }
    faults
}

fn differs(pin: Pin, name: &str, is: Mode, should: Mode) -> String {
    let port = format!("GPIO{}", pin.letter());
    let which = if is.direction != should.direction {
        format!(
            "{port}_MODER has {} instead of {}",
            is.direction, should.direction
        )
    } else if is.pull != should.pull {
        format!("{port}_PUPDR has {} instead of {}", is.pull, should.pull)
    } else if is.function != should.function {
        format!(
            "{port}_AFR has {} instead of {}",
            is.function, should.function
        )
    } else if is.is_open_drain != should.is_open_drain {
        format!(
            "{port}_OTYPER has {} instead of {}",
            u8::from(is.is_open_drain),
            u8::from(should.is_open_drain)
        )
    } else {
        format!(
            "{port}_ODR has {} instead of {}",
            u8::from(is.is_high),
            u8::from(should.is_high)
        )
    };
    format!("{pin}, {name}: {which}")
}

/// The processor's own registers.
fn processor(bench: &Bench, words: &[u32]) -> Vec<String> {
    let mut faults = Vec::new();
    let [.., system, vectors, reset, pending] = words else {
        return vec!["the debug port has read too few words".into()];
    };
    if *vectors != bench.vectors() {
        faults.push(format!(
            "VTOR is {vectors:#x} instead of {:#x}",
            bench.vectors()
        ));
    }
    if reset & 0x700 != 0 {
        faults.push(format!(
            "AIRCR groups priorities: PRIGROUP is {}",
            reset >> 8 & 7
        ));
    }
    if pending & (1 << 28) != 0 {
        faults.push("ICSR: PendSV is pending".into());
    }
    let priorities = priorities();
    if priorities.len() < LEAST_PRIORITIES {
        faults.push(format!(
            "src/app.rs has only {} priorities",
            priorities.len()
        ));
    }
    faults.extend(interrupts(bench, words, &priorities, (system >> 24) as u8));
    faults
}

/// Each interrupt with a handler is enabled, with the priority of its task and below that of the step timer.
fn interrupts(
    bench: &Bench,
    words: &[u32],
    priorities: &BTreeMap<String, u8>,
    step: u8,
) -> Vec<String> {
    let mut faults = Vec::new();
    let handlers = bench.handlers();
    for number in 0..MOST_INTERRUPTS {
        let name = handlers.get(&number).map(|handler| handler.1.as_str());
        let has_handler = name.is_some();
        let is_enabled = words[number / 32] >> (number % 32) & 1 == 1;
        let name = name.unwrap_or("nothing");
        if has_handler && !is_enabled {
            faults.push(format!(
                "NVIC_ISER: the interrupt {number} has the handler {name} and is not enabled"
            ));
        }
        if is_enabled && !has_handler {
            faults.push(format!(
                "NVIC_ISER: the interrupt {number} is enabled and has no handler"
            ));
        }
        if !is_enabled {
            continue;
        }
        let priority = (words[ENABLES + number / 4] >> (8 * (number % 4))) as u8;
        let name = if name.starts_with("EXTI") {
            "TIM1_UP_TIM10"
        } else {
            name
        };
        let name = if name.starts_with("USART") {
            "USART1"
        } else {
            name
        };
        let expected = priorities.get(name);
        // What a supply that falls starts goes before everything.
        let is_above = priority < step && name != "PVD";
        if expected.is_some_and(|&expected| expected != priority) || is_above {
            faults.push(format!("NVIC_IPR: the priority of {name} is {priority:#x}"));
        }
    }
    faults
}

/// The priorities of the tasks by their vectors, as the processor has them, from the firmware's own source.
fn priorities() -> BTreeMap<String, u8> {
    let path = Path::new(env!("CARGO_MANIFEST_DIR")).join("../../src/app.rs");
    let source = fs::read_to_string(path).unwrap_or_default();
    let tasks = source.split("binds = ").skip(1);
    let tasks = tasks.filter_map(|task| {
        let (vector, tail) = task.split_once(',')?;
        let (_, tail) = tail.split_once("priority = ")?;
        let digits = tail.split(|it: char| !it.is_ascii_digit()).next()?;
        let priority: u8 = digits.parse().ok()?;
        Some((vector.to_owned(), (16 - priority) << 4))
    });
    tasks.collect()
}
