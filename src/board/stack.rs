//! A stack that grows too far stops the machine, before it overwrites what lies below it.
//!
//! The memory protection unit forbids the lowest part of the stack's room, next to the statics. A
//! fault is handled without that protection, so its handler has a stack. ARMv7-M reference manual
//! B3.5.

use cortex_m::{asm, peripheral::MPU};

/// Size of the forbidden part, a power of two: no frame of a task is as large, so none steps over it.
const SIZE: u32 = 4096;

#[expect(unsafe_code, reason = "a symbol of the linker script")]
unsafe extern "C" {
    /// Where the statics end.
    static __sheap: u32;
}

/// Forbids the end of the stack from now on.
#[expect(unsafe_code, reason = "raw words for registers")]
pub(super) fn guard(mpu: &MPU) {
    const NEVER_EXECUTED: u32 = 1 << 28;
    const SIZE_FIELD: u32 = (SIZE.ilog2() - 1) << 1;
    const ENABLED: u32 = 1;
    /// What no region names is as without the unit.
    const OTHERS_AS_BEFORE: u32 = 1 << 2;
    let statics_end = (&raw const __sheap) as u32;
    // SAFETY: the region holds nothing but unused stack: `init` is far from its end.
    unsafe {
        mpu.rnr.write(0);
        mpu.rbar.write(statics_end.next_multiple_of(SIZE));
        mpu.rasr.write(NEVER_EXECUTED | SIZE_FIELD | ENABLED);
        mpu.ctrl.write(OTHERS_AS_BEFORE | ENABLED);
    }
    asm::dsb();
    asm::isb();
}
