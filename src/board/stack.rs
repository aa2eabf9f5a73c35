//! The stack guard: a stack that grows too far is a fault, before it overwrites the statics below.
//!
//! The memory protection unit forbids access to the lowest part of the stack's memory, next to the
//! statics. It is off while a hard fault is handled, so that the handler has a stack. ARMv7-M
//! reference manual B3.5.

use cortex_m::{asm, peripheral::MPU};

/// Size of the guard, bytes, a power of two: larger than any frame of a task, so that none steps
/// over the guard. `stack_guard_bytes` in `schedule.toml` is the same.
pub(super) const GUARD_BYTES: u32 = 4096;

#[expect(unsafe_code, reason = "a symbol of the linker script")]
unsafe extern "C" {
    /// End of the statics.
    static __sheap: u32;
}

/// Sets up the guard.
#[expect(unsafe_code, reason = "raw words for registers")]
pub(super) fn guard(mpu: &MPU) {
    /// Fields of the region: no execution, no access, the size; enabled.
    const EXECUTE_NEVER: u32 = 1 << 28;
    const SIZE_FIELD: u32 = (GUARD_BYTES.ilog2() - 1) << 1;
    const ENABLE: u32 = 1;
    /// Regions of a Cortex-M4.
    const REGIONS: u32 = 8;
    /// Memory outside of all regions has its default access.
    const DEFAULT_MAP: u32 = 1 << 2;
    let statics_end = (&raw const __sheap) as u32;
    // SAFETY: the region holds only unused stack: `init` uses its other end.
    unsafe {
        // A bootloader may have left others, which would come back with the first.
        for region in 1..REGIONS {
            mpu.rnr.write(region);
            mpu.rasr.write(0);
        }
        mpu.rnr.write(0);
        mpu.rbar.write(statics_end.next_multiple_of(GUARD_BYTES));
        mpu.rasr.write(EXECUTE_NEVER | SIZE_FIELD | ENABLE);
        mpu.ctrl.write(DEFAULT_MAP | ENABLE);
    }
    asm::dsb();
    asm::isb();
}
