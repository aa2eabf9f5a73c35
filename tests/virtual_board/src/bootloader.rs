//! Bootloaders that leave the chip in other states than a reset does, and jump to the firmware as bootloaders do, without
//! a reset. Instructions: ARMv7-M reference manual, A7.7.

use std::path::Path;

use anyhow::Result;
use rigless::image::Image;

/// Where a bootloader is: the system memory, which has the chip's own.
pub(crate) const PLACE: u32 = 0x1FFF_0000;
/// The most interrupts that a chip has: RM0390 table 38.
pub(crate) const MOST_INTERRUPTS: usize = 97;
/// Vectors of the processor and of the largest chip.
const VECTORS: usize = 16 + MOST_INTERRUPTS;
/// Its instructions, behind its vectors and what these lead to.
pub(crate) const HANDLER: u32 = PLACE + 4 * VECTORS as u32;
/// Where it begins.
pub(crate) const ENTRY: u32 = HANDLER + 4;
/// The RAM that all chips have, at whose end is the bootloader's stack.
pub(crate) const RAM_START: u32 = 0x2000_0000;
const RAM: [u32; 2] = [RAM_START, 0x2002_0000];
/// The word that says which bootloader runs, from 1 on; with none, the firmware begins as out of a reset. It is between
/// the firmware's statics and its stack, so that a bootloader runs at each reset of a case.
pub(crate) const SELECTION: u32 = 0x2001_8000;
/// Where `TinyUF2` looks for its mark: the end of the RAM of its ports/stm32f4.
pub(crate) const UF2_PLACE: u32 = 0x2000_FFFC;
/// What is left in RAM.
const PATTERN: u32 = 0xDEAD_BEEF;

const SYST_CSR: u32 = 0xE000_E010;
const SYST_RVR: u32 = 0xE000_E014;
const NVIC_ISER: u32 = 0xE000_E100;
const NVIC_ISPR: u32 = 0xE000_E200;
const ICSR: u32 = 0xE000_ED04;
const VTOR: u32 = 0xE000_ED08;
const AIRCR: u32 = 0xE000_ED0C;
/// `SysTick` and `PendSV` are made pending.
const PEND: u32 = 1 << 26 | 1 << 28;
const PWR_CR: u32 = 0x4000_7000;
const RCC_CR: u32 = 0x4002_3800;
const RCC_PLLCFGR: u32 = 0x4002_3804;
const RCC_CFGR: u32 = 0x4002_3808;
const RCC_APB1ENR: u32 = 0x4002_3840;
const RCC_BDCR: u32 = 0x4002_3870;
const FLASH_ACR: u32 = 0x4002_3C00;

/// What a bootloader leaves, beside other vectors, another stack and a RAM that has been used.
#[derive(Debug, Clone, Copy)]
pub(crate) struct State {
    /// The core runs at 60 MHz from the PLL of the crystal, as behind the ROM's bootloader.
    pub(crate) has_pll: bool,
    /// How priorities are grouped.
    pub(crate) priority_group: u32,
    /// `SysTick` interrupts each 10 µs.
    pub(crate) has_ticks: bool,
    /// Every interrupt is enabled and pending, behind a mask that is left on.
    pub(crate) has_interrupts: bool,
    /// The oscillator at C14 and C15 runs.
    pub(crate) has_lse: bool,
}

impl State {
    /// Nothing of it.
    pub(crate) const NONE: Self = Self {
        has_pll: false,
        priority_group: 0,
        has_ticks: false,
        has_interrupts: false,
        has_lse: false,
    };
    /// All of it.
    pub(crate) const ALL: Self = Self {
        has_pll: true,
        priority_group: 5,
        has_ticks: true,
        has_interrupts: true,
        has_lse: true,
    };

    /// The bootloader that leaves this, with its number.
    fn code(self, number: u16, crystal_mhz: u32, interrupts: u32) -> Code {
        let mut code = Code::default();
        code.mask_interrupts();
        code.store(VTOR, PLACE);
        code.fill_ram();
        code.store(SELECTION, number.into());
        if self.has_pll {
            code.start_pll(crystal_mhz);
        }
        if self.has_lse {
            code.store(RCC_APB1ENR, 1 << 28);
            code.store(PWR_CR, 0xC100);
            code.store(RCC_BDCR, 1);
        }
        code.store(AIRCR, 0x05FA_0000 | self.priority_group << 8);
        if self.has_ticks {
            code.store(SYST_RVR, 10 * 60 - 1);
            code.store(SYST_CSR, 0b111);
        }
        if self.has_interrupts {
            for word in 0..interrupts.div_ceil(32) {
                let bits = u32::MAX >> (32 * (word + 1)).saturating_sub(interrupts);
                code.store(NVIC_ISER + 4 * word, bits);
                code.store(NVIC_ISPR + 4 * word, bits);
            }
            code.store(ICSR, PEND);
        } else {
            code.unmask_interrupts();
        }
        code
    }
}

/// Bootloaders that leave some states before a firmware, on a board with a crystal: one is selected in RAM.
pub(crate) fn image(
    states: &[State],
    firmware: u32,
    crystal_mhz: u32,
    interrupts: u32,
) -> Result<Image> {
    let [_, end] = RAM;
    let mut code = Code::default();
    for (number, state) in (1..).zip(states) {
        let mut start = state.code(number, crystal_mhz, interrupts);
        start.jump_to(firmware, end - 0x100);
        code.select(number, start);
    }
    code.begin(firmware);
    let path = Path::new("the bootloaders");
    Ok(Image::new(path, code.image(), Some(PLACE.into()))?)
}

/// Instructions.
#[derive(Default)]
struct Code(Vec<u16>);

impl Code {
    /// MOVW, encoding T3, and MOVT, encoding T1: any word into one of the registers up to 7.
    fn load(&mut self, register: u16, word: u32) {
        for (opcode, half) in [(0xF240, word & 0xFFFF), (0xF2C0, word >> 16)] {
            let half = half as u16;
            self.0.push(opcode | half >> 12 | (half >> 11 & 1) << 10);
            self.0
                .push((half >> 8 & 7) << 12 | register << 8 | half & 0xFF);
        }
    }

    /// STR, encoding T1.
    fn store(&mut self, address: u32, word: u32) {
        self.load(0, address);
        self.load(1, word);
        self.0.push(0x6001);
    }

    /// CPSID i.
    fn mask_interrupts(&mut self) {
        self.0.push(0xB672);
    }

    /// CPSIE i.
    fn unmask_interrupts(&mut self) {
        self.0.push(0xB662);
    }

    /// Waits for a bit of the register whose address is in r0: LDR r2, [r0]; TST r2, r1; BEQ.
    fn await_bit(&mut self, address: u32, bit: u32) {
        self.load(0, address);
        self.load(1, bit);
        self.0.extend([0x6802, 0x420A, 0xD0FC]);
    }

    /// The PLL at 240 MHz of the crystal, 60 MHz of it for the core; RM0090 7.3.
    fn start_pll(&mut self, crystal_mhz: u32) {
        self.store(FLASH_ACR, 1);
        self.store(RCC_CR, 0x1_0083);
        self.await_bit(RCC_CR, 1 << 17);
        self.store(
            RCC_PLLCFGR,
            crystal_mhz | 240 << 6 | 1 << 16 | 1 << 22 | 5 << 24,
        );
        self.store(RCC_CR, 0x101_0083);
        self.await_bit(RCC_CR, 1 << 25);
        self.store(RCC_CFGR, 2);
        self.await_bit(RCC_CFGR, 2 << 2);
    }

    /// A loop: STR r2, [r0]; ADDS r0, #4; CMP r0, r1; BNE.
    fn fill_ram(&mut self) {
        let [start, end] = RAM;
        self.load(0, start);
        self.load(1, end);
        self.load(2, PATTERN);
        self.0.extend([0x6002, 0x3004, 0x4288, 0xD1FB]);
    }

    /// MSR MSP, r1; LDR r0, [r0, #4]; BX r0.
    fn jump_to(&mut self, firmware: u32, stack: u32) {
        self.load(0, firmware);
        self.load(1, stack);
        self.0.extend([0xF381, 0x8808, 0x6840, 0x4700]);
    }

    /// As a reset does: the vectors are the firmware's, and so is the stack. LDR r1, [r0]; MSR MSP, r1; LDR r0, [r0, #4];
    /// BX r0.
    fn begin(&mut self, firmware: u32) {
        self.store(VTOR, firmware);
        self.load(0, firmware);
        self.0.extend([0x6801, 0xF381, 0x8808, 0x6840, 0x4700]);
    }

    /// Where the selection is a number, runs some code: LDR r0, [r0]; CMP r0, #number; BEQ; B.W over it.
    fn select(&mut self, number: u16, selected: Self) {
        self.load(0, SELECTION);
        let skipped = selected.0.len() as u32;
        self.0.extend([0x6800, 0x2800 | number, 0xD001]);
        // B.W, encoding T4, from its own address and 4.
        self.0.push(0xF000 | (skipped >> 11 & 0x3FF) as u16);
        self.0.push(0xB800 | (skipped & 0x7FF) as u16);
        self.0.extend(selected.0);
    }

    /// Vectors, all of which lead to BX LR, and the code.
    fn image(&self) -> Vec<u8> {
        let mut image = [HANDLER | 1; VECTORS].map(u32::to_le_bytes).concat();
        let [_, end] = RAM;
        image[..4].copy_from_slice(&end.to_le_bytes());
        image[4..8].copy_from_slice(&(ENTRY | 1).to_le_bytes());
        let instructions = [0x4770, 0xBF00].iter().chain(&self.0);
        image.extend(instructions.flat_map(|half| half.to_le_bytes()));
        image
    }
}
