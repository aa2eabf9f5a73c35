//! A model of the USB bootloader in the ROM of STM32F4, as control transfers see it.
//!
//! Written from ST AN2606 (the chips), AN3156 (the commands), UM0424 (the strings for memory), USB DFU 1.1 (requests and
//! states), and lists of `dfu-util` of the chips. Where these are silent, the model does what is worse for a host.
//!
//! - The address of a block is `(number - 2) * length + pointer`, with the length of that transfer, as AN3156 says.
//! - Flash is NOR: a programmed byte can clear bits only; a sector is erased as a whole. A wrong result is no error of the
//!   device, which verifies nothing.
//! - A command is executed by the GETSTATUS after it, whose answer is `dfuDNBUSY`. Another request than GETSTATUS before
//!   `dfuDNLOAD-IDLE` is an error.
//! - A request that the state does not allow is stalled, and is an error that CLRSTATUS ends.
//!
//! Left out: time (a poll timeout is told, and a host that does not wait is not found), signals and packets of the bus,
//! the other alternate settings (they are described, and reading or writing beside the flash is `errTARGET`), RAM and
//! system memory, option bytes (a read protection is there or not), power cuts within a sector or block, what the program
//! does to which the device leaves.

mod chip;
mod device;
mod flash;
mod server;

pub use crate::{
    chip::Chip,
    device::{Device, Failure, Faults, TRANSFER_BYTES},
    flash::FLASH,
    server::serve,
};
