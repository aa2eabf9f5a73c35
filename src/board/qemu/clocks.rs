//! The clocks, which stay as they are: QEMU has none.

use leadscrew::model::SelfTestFault;
use stm32f4xx_hal::rcc::Rcc;

use super::{chosen::flash_access, pac};

/// The clocks, which never fail.
pub(super) struct Clocks {
    pub(super) rcc: Rcc,
    pub(super) fault: Option<SelfTestFault>,
}

/// Sets what the chip's clocks want of the flash, which the proof looks for.
pub(super) fn start(rcc: Rcc, flash: &pac::FLASH) -> Clocks {
    flash.acr().write(|w| flash_access(w).dcen().set_bit());
    Clocks { rcc, fault: None }
}
