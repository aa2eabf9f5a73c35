//! Hands over to a bootloader that takes new firmware: `$DFU`, `$UF2`.
//!
//! Only a reset ends the watchdog, so each bootloader gets a mark that outlives a reset. That of the chip's own is in a
//! register of the backup domain, and [`pre_init`](super::pre_init) follows it: the bootloader of a board's maker, which runs
//! before, may use all of the RAM. `TinyUF2` runs before the firmware anyway, and has its mark in RAM.

use cortex_m::{asm, peripheral::SCB};
use leadscrew::model::Bootloader;

use super::{chosen::WIRING, outputs, pac, watchdog};

/// The register of the backup domain, and the mark in it: `pre_init.rs` has both, too.
const BACKUP_REGISTER: usize = 19;
const DFU_MARK: u32 = 0x1ead_0df0;
/// The end of the RAM that `TinyUF2` uses, and its mark for a second press of the reset button: `_board_dfu_dbl_tap` in its
/// `ports/stm32f4`, `DBL_TAP_MAGIC` in its `src/board_api.h`.
const UF2_PLACE: *mut u32 = 0x2000_fffc as *mut u32;
const UF2_MARK: u32 = 0xf016_69ef;
/// Reads of a bit before it counts as stuck: many more than a write takes.
const MAX_READS: u32 = 1000;

/// Lets the last answer leave; for `idle` alone. A reset by the sender, which may come meanwhile, takes the wish back.
#[cold]
#[inline(never)]
pub(crate) fn await_sender() {
    // A tenth of a second: a host fetches what waits for it at USB within some ms.
    watchdog::pause(WIRING.core_hz / 10);
}

/// Resets the chip with the mark of a bootloader; for `idle` alone.
#[cold]
#[inline(never)]
#[expect(unsafe_code, reason = "no task runs any more")]
pub(crate) fn enter(bootloader: Bootloader) -> ! {
    cortex_m::interrupt::disable();
    outputs::switch_off();
    // SAFETY: interrupts are off, and the chip is reset before anything else can use the peripherals or the RAM.
    unsafe {
        match bootloader {
            Bootloader::Dfu => {
                let device = pac::Peripherals::steal();
                let power = &device.PWR;
                device.RCC.apb1enr().modify(|_, w| w.pwren().set_bit());
                power.cr().modify(|_, w| w.dbp().set_bit());
                let _ = watchdog::await_flag(MAX_READS, || power.cr().read().dbp().bit_is_set());
                let mark = device.RTC.bkpr(BACKUP_REGISTER);
                mark.write(|w| w.bits(DFU_MARK));
            }
            Bootloader::Uf2 => {
                // The place may be within the guard of the stack.
                (*cortex_m::peripheral::MPU::PTR).ctrl.write(0);
                asm::dsb();
                UF2_PLACE.write_volatile(UF2_MARK);
            }
        }
    }
    SCB::sys_reset()
}
