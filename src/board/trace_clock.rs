//! The clock of `trace`, which counts core cycles.

use cortex_m::peripheral::{DWT, SYST};

/// Returns the time, core cycles.
pub(super) fn now() -> u32 {
    DWT::cycle_count()
}

/// Returns the core cycles since the event being served was due. Before the step timer has its next time, as its counter
/// began with the value that is still in the reload register.
pub(super) fn lateness() -> u32 {
    SYST::get_reload().wrapping_sub(SYST::get_current())
}
