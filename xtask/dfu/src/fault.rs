//! Why a transfer or a command has failed, in words for the board's owner.

use std::{error::Error, fmt};

use dfu_core::Status;

/// Why a transfer or a command has failed.
#[derive(Debug)]
pub enum Fault {
    /// The device is no longer at USB.
    Gone,
    /// It does not take the request.
    Stalled,
    /// It does not answer in time.
    Silent,
    /// It reports an error.
    Refused(Status),
    /// Something else of the system's USB.
    Usb(String),
    /// The device is not what it seems to be.
    Device(dfu_core::Error),
}

impl fmt::Display for Fault {
    fn fmt(&self, f: &mut fmt::Formatter<'_>) -> fmt::Result {
        match self {
            Self::Gone => f.write_str("the board is no longer at USB: its cable, or its supply"),
            Self::Stalled => f.write_str("the chip's bootloader does not take the request"),
            Self::Silent => f.write_str("the chip's bootloader does not answer"),
            Self::Refused(Status::ErrVendor) => f.write_str(
                "the chip is protected from being read (option byte RDP): STM32CubeProgrammer takes that away, and \
                 erases the chip with it",
            ),
            Self::Refused(status @ (Status::ErrErase | Status::ErrWrite | Status::ErrProg)) => {
                write!(
                    f,
                    "the chip reports: {status} The sector may be write-protected: STM32CubeProgrammer shows it among \
                     the option bytes"
                )
            }
            Self::Refused(status) => write!(f, "the chip reports: {status}"),
            Self::Usb(error) => write!(f, "USB: {error}"),
            Self::Device(error) => write!(f, "{error}"),
        }
    }
}

impl Error for Fault {}

impl From<dfu_core::Error> for Fault {
    fn from(error: dfu_core::Error) -> Self {
        Self::Device(error)
    }
}
