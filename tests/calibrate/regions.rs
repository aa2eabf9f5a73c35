//! Cycles that a bus adds to a load or a store.
#![expect(unsafe_code, reason = "registers by their addresses")]

use crate::{cycles::sample, target::Samples};

/// Registers whose reading has no effect, and to which writing 0 has none, by class: RM0090.
const REGISTERS: &[(&str, u32, u32)] = &[
    // GPIOA: IDR, BSRR.
    ("ahb", 0x4002_0010, 0x4002_0018),
    // TIM2, which stands still: CNT, CCR1.
    ("apb1", 0x4000_0024, 0x4000_0034),
    // EXTI: PR.
    ("apb2", 0x4001_3c14, 0x4001_3c14),
    // NVIC: ISER0.
    ("private", 0xe000_e100, 0xe000_e100),
    // OTG_FS: CID, GINTSTS.
    #[cfg(feature = "usb")]
    ("usb", 0x5000_003c, 0x5000_0014),
];
/// The start of the flash, and of the memory that the processor alone reaches.
const FLASH: u32 = 0x0800_0000;
#[cfg(feature = "chip-f405")]
const CORE_MEMORY: u32 = 0x1000_0000;

/// Measures every region.
pub(crate) fn measure(samples: &mut Samples) {
    let word = [0_u32];
    let memory = word.as_ptr() as u32;
    let sample = sample!(1, "ldr {a}, [{p}]", a = out(reg) _, p = in(reg) memory,);
    samples.put("sram", "read", &sample);
    for &(class, to_read, to_write) in REGISTERS {
        let sample = sample!(1, "ldr {a}, [{p}]", a = out(reg) _, p = in(reg) to_read,);
        samples.put(class, "read", &sample);
        let sample = sample!(1, "str {a}, [{p}]", a = in(reg) 0, p = in(reg) to_write,);
        samples.put(class, "write", &sample);
    }
    #[cfg(feature = "chip-f405")]
    {
        let sample = sample!(1, "ldr {a}, [{p}]", a = out(reg) _, p = in(reg) CORE_MEMORY,);
        samples.put("ccm", "read", &sample);
    }
    let sample = sample!(1, "ldr {a}, [{p}]", a = out(reg) _, p = in(reg) FLASH,);
    samples.put("flash_data", "hit", &sample);
    // One load in each line of the data cache, of which there are eight.
    let sample = sample!(1, "ldr {a}, [{p}], #16", a = out(reg) _, p = inout(reg) FLASH => _,);
    samples.put("flash_data", "miss", &sample);
}
