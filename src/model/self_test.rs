//! What the self-test at power-up finds wrong.

/// The fault with which the machine comes up in alarm 16, at the frequency of the internal oscillator: it says so, and
/// moves nothing.
#[derive(Debug, Clone, Copy, PartialEq, Eq)]
pub enum SelfTestFault {
    /// The crystal does not run.
    NoCrystal,
    /// The crystal is another one than the board's file says.
    OtherCrystal {
        /// Its measured frequency, kHz.
        khz: u32,
        /// That of the board's file, kHz.
        expected_khz: u32,
    },
    /// The supply is too low for the full speed of the core.
    LowSupply,
}
