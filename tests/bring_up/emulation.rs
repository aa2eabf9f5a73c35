//! Whether this program is for QEMU, and what it finds in QEMU's folder.

/// Returns whether the program runs in QEMU.
pub(super) const fn is_emulated() -> bool {
    cfg!(feature = "qemu")
}

/// Returns whether the folder of the emulator has the file that asks for a flaw.
pub(super) fn has_flaw(file: &core::ffi::CStr) -> bool {
    is_emulated() && semihosting::fs::File::open(file).is_ok()
}
