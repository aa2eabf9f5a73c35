//! The state of the processor after a reset, made again: the first that runs, before memory has its first values.
//!
//! A bootloader jumps into the firmware without a reset, and may have left SysTick running, interrupts enabled or
//! pending, priorities in groups, another stack or a memory protection. ARMv7-M reference manual B1.4, B3.2 to B3.5.
//!
//! It also sets VTOR, with interrupts off: with the feature `set-vtor` of cortex-m-rt, which sets VTOR earlier, a
//! pending interrupt would run a task that has no data yet. A DMA that still runs could write over the initial data in
//! memory, so every DMA controller is reset. A loader that jumps from within an exception is not undone: nothing but a
//! reset ends its priority.
//!
//! Then it follows the mark of `$DFU`, see [`bootloader`](super::bootloader): clocks and peripherals get their state after a
//! reset, too, and the chip's own bootloader begins as if BOOT0 had been high. AN2606; RM0090 7.3, 9.3.1, 26.6.20.

#[expect(unsafe_code, reason = "runs before memory has its first values")]
mod assembly {
    core::arch::global_asm!(
        ".section .text.__pre_init, \"ax\"",
        ".global __pre_init",
        ".type __pre_init, %function",
        ".thumb_func",
        "__pre_init:",
        "cpsid i",
        "movs r1, #0",
        // The main stack, privileged; no threshold of priorities.
        "msr control, r1",
        "isb",
        "msr basepri, r1",
        "cpsie f",
        // The registers of the processor begin at 0xE000_E000.
        "movw r0, #0xe000",
        "movt r0, #0xe000",
        // ACTLR: as after a reset.
        "str r1, [r0, #0x8]",
        // SYST_CSR: SysTick is off.
        "str r1, [r0, #0x10]",
        // NVIC_ICER and NVIC_ICPR: no interrupt is enabled or pending.
        "mvns r2, r1",
        ".irp offset, 0x180, 0x184, 0x188, 0x18c, 0x280, 0x284, 0x288, 0x28c",
        "str r2, [r0, #\\offset]",
        ".endr",
        // ICSR: PendSV and SysTick are not pending.
        "mov r2, #0x0a000000",
        "str r2, [r0, #0xd04]",
        // VTOR.
        "movw r2, #:lower16:__vector_table",
        "movt r2, #:upper16:__vector_table",
        "str r2, [r0, #0xd08]",
        // AIRCR with its key: each priority is a group of its own.
        "movs r2, #0",
        "movt r2, #0x05fa",
        "str r2, [r0, #0xd0c]",
        // SCR: sleep is not deep. CCR: the stack is aligned, and unaligned accesses are no faults.
        "str r1, [r0, #0xd10]",
        "mov r2, #0x200",
        "str r2, [r0, #0xd14]",
        // SHCSR: each fault is a hard fault. MPU_CTRL: off.
        "str r1, [r0, #0xd24]",
        "str r1, [r0, #0xd94]",
        // FPCCR and FPDSCR: registers of floating point are saved, when they are used.
        "mov r2, #0xc0000000",
        "str r2, [r0, #0xf34]",
        "str r1, [r0, #0xf3c]",
        // RCC_AHB1RSTR: DMA1, DMA2, and those of graphics, Ethernet and USB.
        "movw r0, #0x3810",
        "movt r0, #0x4002",
        "movs r2, #0",
        "movt r2, #0x22e0",
        "str r2, [r0]",
        "str r1, [r0]",
        // FLASH_ACR: no caches, and emptied ones: a loader has read the flash before it was written anew. RM0090 3.5.
        "movw r0, #0x3800",
        "movt r0, #0x4002",
        "ldr r2, [r0, #0x400]",
        "bic r2, r2, #0x700",
        "str r2, [r0, #0x400]",
        "orr r2, r2, #0x1800",
        "str r2, [r0, #0x400]",
        "bic r2, r2, #0x1800",
        "str r2, [r0, #0x400]",
        "dsb",
        "isb",
        // RCC_APB1ENR: the registers of the supply get their clock; RTC_BKP19R has the mark, or not.
        "mov r2, #0x10000000",
        "str r2, [r0, #0x40]",
        "dsb",
        "movw r3, #0x289c",
        "movt r3, #0x4000",
        "ldr r2, [r3]",
        "movw ip, #0x0df0",
        "movt ip, #0x1ead",
        "cmp r2, ip",
        "beq 1f",
        "cpsie i",
        "bx lr",
        // PWR_CR: the backup domain takes the removal of the mark, which must not start the bootloader for ever; without
        // the removal the firmware starts.
        "1:",
        "movw r2, #0x7000",
        "movt r2, #0x4000",
        "ldr ip, [r2]",
        "orr ip, ip, #0x100",
        "str ip, [r2]",
        ".rept 8",
        "str r1, [r3]",
        "ldr ip, [r3]",
        "cmp ip, #0",
        "beq 2f",
        ".endr",
        "cpsie i",
        "bx lr",
        "2:",
        // RCC_CR: the internal oscillator is on; RCC_CFGR: it is the clock; RCC_CR: no other runs.
        "ldr r2, [r0]",
        "orr r2, r2, #1",
        "str r2, [r0]",
        "3:",
        "ldr r2, [r0]",
        "lsls r2, r2, #30",
        "bpl 3b",
        "str r1, [r0, #0x8]",
        "4:",
        "ldr r2, [r0, #0x8]",
        "tst r2, #0xc",
        "bne 4b",
        "ldr r2, [r0]",
        "bic r2, r2, #0x80000",
        "str r2, [r0]",
        "movs r2, #0x81",
        "str r2, [r0]",
        "5:",
        "ldr r2, [r0]",
        "tst r2, #0x2a000000",
        "bne 5b",
        // RCC_PLLCFGR, RCC_CIR, RCC_DCKCFGR and RCC_DCKCFGR2.
        "movw r2, #0x3010",
        "movt r2, #0x2400",
        "str r2, [r0, #0x4]",
        "mov r2, #0xff0000",
        "str r2, [r0, #0xc]",
        "str r1, [r0, #0x8c]",
        "str r1, [r0, #0x94]",
        // Every peripheral is reset, and none has a clock but SYSCFG.
        "mvns r2, r1",
        ".irp offset, 0x10, 0x14, 0x20, 0x24",
        "str r2, [r0, #\\offset]",
        ".endr",
        "dsb",
        ".irp offset, 0x10, 0x14, 0x20, 0x24, 0x34, 0x40",
        "str r1, [r0, #\\offset]",
        ".endr",
        "mov r2, #0x100000",
        "str r2, [r0, #0x30]",
        "mov r2, #0x4000",
        "str r2, [r0, #0x44]",
        // FLASH_ACR: no caches, which would show the old contents of a sector that was written.
        "str r1, [r0, #0x400]",
        // FLASH_CR is locked: the keys of an open one would lock the flash until a reset.
        "mov r2, #0x80000000",
        "str r2, [r0, #0x410]",
        // EXTI_IMR.
        "movw r3, #0x3c00",
        "movt r3, #0x4001",
        "str r1, [r3]",
        // SYSCFG_MEMRMP and VTOR: its vectors are at 0.
        "movw r3, #0x3800",
        "movt r3, #0x4001",
        "movs r2, #1",
        "str r2, [r3]",
        "movw r3, #0xe000",
        "movt r3, #0xe000",
        "str r1, [r3, #0xd08]",
        "dsb",
        "isb",
        "movw r0, #0",
        "movt r0, #0x1fff",
        "ldr r2, [r0]",
        "msr msp, r2",
        "ldr r0, [r0, #4]",
        "cpsie i",
        "bx r0",
        ".size __pre_init, . - __pre_init",
    );
}
