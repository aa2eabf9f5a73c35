//! Bootloaders that a statement can start.

/// A bootloader of a board to which the firmware can hand over.
#[derive(Debug, Clone, Copy, PartialEq, Eq)]
pub enum Bootloader {
    /// The chip's own, which takes firmware over USB: `$DFU`.
    Dfu,
    /// One in flash that shows a drive and takes UF2 files: `$UF2`.
    Uf2,
}

/// The bootloaders that a board has.
#[derive(Debug, Clone, Copy, Default, PartialEq, Eq)]
pub struct Bootloaders {
    /// [`Bootloader::Dfu`], at a USB socket.
    pub dfu: bool,
    /// [`Bootloader::Uf2`].
    pub uf2: bool,
}

impl Bootloaders {
    /// Returns whether the board has a bootloader.
    #[must_use]
    pub const fn has(self, bootloader: Bootloader) -> bool {
        match bootloader {
            Bootloader::Dfu => self.dfu,
            Bootloader::Uf2 => self.uf2,
        }
    }
}
