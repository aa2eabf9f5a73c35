//! The priorities of the firmware's tasks, read from `src/app.rs` when this is compiled: there is no copy of them.

use cortex_m::peripheral::{SCB, scb::SystemHandler};

use super::{
    Facts,
    pac::{Interrupt, NVIC},
    vectors::nvic_priority,
};

/// The application, as text.
const APP_SOURCE: &[u8] = include_bytes!("../../src/app.rs");

/// Priority of `step`.
pub(super) const STEP: u8 = bound(b"SysTick");
/// Priority of `serial_rx`.
pub(super) const SERIAL: u8 = bound(b"USART1");

/// The vectors of all tasks but `step`, each with its name and priority.
const VECTORS: [(&str, Interrupt, u8); 6] = [
    ("USART1", Interrupt::USART1, SERIAL),
    ("I2C3_EV", Interrupt::I2C3_EV, bound(b"I2C3_EV")),
    (
        "TIM1_UP_TIM10",
        Interrupt::TIM1_UP_TIM10,
        bound(b"TIM1_UP_TIM10"),
    ),
    (
        "TIM1_BRK_TIM9",
        Interrupt::TIM1_BRK_TIM9,
        bound(b"TIM1_BRK_TIM9"),
    ),
    ("TIM4", Interrupt::TIM4, bound(b"TIM4")),
    ("I2C2_EV", Interrupt::I2C2_EV, dispatched(b"I2C2_EV")),
];

/// Sets the priorities, but that of `serial_rx`, which is set as in the firmware. The vectors stay masked.
#[expect(unsafe_code, reason = "vectors that RTIC does not manage")]
pub(super) fn set(nvic: &mut NVIC) {
    for (_, vector, priority) in VECTORS {
        if vector != Interrupt::USART1 {
            // SAFETY: the vector is masked.
            unsafe { nvic.set_priority(vector, nvic_priority(priority)) };
        }
    }
}

/// Reads the priorities of all tasks.
pub(super) fn read(facts: &mut Facts) {
    let step = SCB::get_priority(SystemHandler::SysTick);
    facts.put_of("priority", "SysTick", step.into());
    for (name, vector, _) in VECTORS {
        facts.put_of("priority", name, NVIC::get_priority(vector).into());
    }
}

/// Returns the priority of the task that binds a vector.
const fn bound(vector: &[u8]) -> u8 {
    let mut at = after(0, b"binds = ");
    while !(is_at(at, vector) && APP_SOURCE[at + vector.len()] == b',') {
        at = after(at, b"binds = ");
    }
    number(after(at, b"priority = "))
}

/// Returns the priority of the software tasks, which have this dispatcher, and no other.
const fn dispatched(vector: &[u8]) -> u8 {
    let list = after(0, b"dispatchers = [");
    assert!(is_at(list, vector) && APP_SOURCE[list + vector.len()] == b']');
    let mut at = after(list, b"#[task(");
    loop {
        while APP_SOURCE[at].is_ascii_whitespace() {
            at += 1;
        }
        if is_at(at, b"priority = ") {
            return number(after(at, b"priority = "));
        }
        at = after(at, b"#[task(");
    }
}

/// Returns the place behind the next such text; none stops the compiler.
const fn after(mut at: usize, text: &[u8]) -> usize {
    while !is_at(at, text) {
        at += 1;
    }
    at + text.len()
}

const fn is_at(place: usize, text: &[u8]) -> bool {
    assert!(
        place + text.len() < APP_SOURCE.len(),
        "src/app.rs does not have it"
    );
    let mut index = 0;
    while index < text.len() {
        if APP_SOURCE[place + index] != text[index] {
            return false;
        }
        index += 1;
    }
    true
}

/// Returns the number of one digit at a place.
const fn number(place: usize) -> u8 {
    assert!(APP_SOURCE[place].is_ascii_digit() && !APP_SOURCE[place + 1].is_ascii_digit());
    APP_SOURCE[place] - b'0'
}
