//! The step rate that is proven of this image: written into it after it has been linked.

use leadscrew::settings::StepRate;

/// The mark by which a tool makes sure that it writes to the right place.
const MARK: u32 = u32::from_le_bytes(*b"PROV");

/// The mark, and the rate, Hz: 0 until `cargo xtask build` has proven one.
#[unsafe(no_mangle)]
#[expect(unsafe_code, reason = "a symbol that a tool can find")]
static PROVEN: [u32; 2] = [MARK, 0];

/// Returns the step rate that this image may be asked for.
#[expect(unsafe_code, reason = "a value that the compiler must not know")]
pub(super) fn step_rate() -> StepRate {
    // SAFETY: it is a word of a static that nothing ever changes while the program runs.
    StepRate::of_image(unsafe { (&raw const PROVEN[1]).read_volatile() })
}
