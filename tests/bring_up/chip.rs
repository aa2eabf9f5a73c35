//! What the chip says of itself, and what its start-up has set.

use cortex_m::peripheral::{CPUID, FPU, MPU, SCB};

use super::{Facts, emulation, pac};

/// Size of the flash, KiB, and the number that no other chip has: RM0090 39.1, 39.2, the same on all parts.
const FLASH_SIZE: usize = 0x1fff_7a22;
const UNIQUE_ID: usize = 0x1fff_7a10;

/// Reads the chip, and what was set before this.
pub(super) fn read(facts: &mut Facts, flash: &pac::FLASH, debug: &pac::DBGMCU, reset_flags: u32) {
    facts.put("emulated", emulation::is_emulated().into());
    facts.put("processor", processor().into());
    facts.put("vectors", register(SCB::PTR.cast(), VTOR).into());
    facts.put("control", register(SCB::PTR.cast(), CCR).into());
    facts.put("fpu.access", register(SCB::PTR.cast(), CPACR).into());
    facts.put("fpu.control", register(FPU::PTR.cast(), 1).into());
    facts.put("guard.control", register(MPU::PTR.cast(), 1).into());
    facts.put("guard.start", register(MPU::PTR.cast(), 3).into());
    facts.put("guard.size", register(MPU::PTR.cast(), 4).into());
    if emulation::is_emulated() {
        return;
    }
    facts.put("chip", debug.idcode().read().bits().into());
    let size = register((FLASH_SIZE & !3) as *const u32, 0);
    facts.put("flash_kib", (size >> (8 * (FLASH_SIZE & 3))).into());
    for (index, name) in ["uid.0", "uid.1", "uid.2"].into_iter().enumerate() {
        facts.put(name, register(UNIQUE_ID as *const u32, index).into());
    }
    facts.put("flash.access", flash.acr().read().bits().into());
    facts.put("flash.options", flash.optcr().read().bits().into());
    facts.put("reset_flags", reset_flags.into());
}

/// Registers of the system control block, in words from its second one, which is the first of [`SCB::PTR`]:
/// ARMv7-M reference manual B3.2.
const VTOR: usize = 1;
const CCR: usize = 4;
const CPACR: usize = 33;

#[expect(unsafe_code, reason = "registers by their addresses")]
fn register(first: *const u32, index: usize) -> u32 {
    // SAFETY: the chips have these registers, whose reads have no side effects.
    unsafe { first.add(index).read_volatile() }
}

#[expect(unsafe_code, reason = "a register that nobody writes")]
fn processor() -> u32 {
    // SAFETY: reads a register without side effects.
    unsafe { (*CPUID::PTR).base.read() }
}
