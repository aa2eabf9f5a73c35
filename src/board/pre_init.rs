//! The state of the processor after a reset, made again: the first that runs, before memory has its first values.
//!
//! A bootloader jumps into the firmware without a reset, and may have left SysTick running, interrupts enabled or
//! pending, priorities in groups, another stack or a memory protection. ARMv7-M reference manual B1.4, B3.2 to B3.5.
//!
//! It also sets VTOR, with interrupts off: with the feature `set-vtor` of cortex-m-rt, which sets VTOR earlier, a
//! pending interrupt would run a task that has no data yet. A DMA that still runs could write over the initial data in
//! memory, so every DMA controller is reset. A loader that jumps from within an exception is not undone: nothing but a
//! reset ends its priority.

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
        "dsb",
        "isb",
        "cpsie i",
        "bx lr",
        ".size __pre_init, . - __pre_init",
    );
}
