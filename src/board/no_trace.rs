//! The functions of `trace` without the feature: they record nothing.

/// An activation.
pub(crate) struct Activation;

/// Begins an activation of `step`.
pub(crate) const fn step() -> Activation {
    Activation
}

/// Begins an activation of `serial_rx`.
#[cfg(not(feature = "usb"))]
pub(crate) const fn serial_rx() -> Activation {
    Activation
}

/// Begins an activation of `usb`.
#[cfg(feature = "usb")]
pub(crate) const fn usb() -> Activation {
    Activation
}

/// Begins an activation of `inputs`.
pub(crate) const fn inputs() -> Activation {
    Activation
}

/// Begins an activation of `segment_start`.
pub(crate) const fn segment_start() -> Activation {
    Activation
}

/// Begins an activation of `prepare`.
pub(crate) const fn prepare() -> Activation {
    Activation
}

/// Records the time of a release.
pub(super) const fn release(_vector: super::pac::Interrupt) {}

/// Starts the cycle counter.
pub(super) const fn init(
    _control: &mut cortex_m::peripheral::DCB,
    _watch: &mut cortex_m::peripheral::DWT,
    _debug: &super::pac::DBGMCU,
) {
}
