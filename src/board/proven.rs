//! The step rate proven for this image; a tool writes it into the image after linking.

use leadscrew::settings::StepRate;

/// Mark in front of the rate: the tool checks it before it writes.
const MARK: u32 = u32::from_le_bytes(*b"PROV");

/// The mark and the rate, Hz; 0 until `cargo xtask build` has proven a rate.
#[unsafe(no_mangle)]
#[expect(unsafe_code, reason = "a symbol that a tool can find")]
static PROVEN: [u32; 2] = [MARK, 0];

/// Returns the proven step rate.
#[expect(unsafe_code, reason = "a value that is written after linking")]
pub(super) fn step_rate() -> StepRate {
    // SAFETY: reads a word of a static, which nothing changes while the program runs.
    StepRate::of_image(unsafe { (&raw const PROVEN[1]).read_volatile() })
}
