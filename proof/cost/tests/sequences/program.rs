//! Short instruction sequences whose cost is known by hand, run in QEMU by `sequences.rs`.
//!
//! Each function is called once; its costs are in that file. R4 points to scratch memory.
#![no_std]
#![no_main]

core::arch::global_asm!(
    r#"
    .macro function name
    .type \name, %function
    .thumb_func
    \name:
    .endm
    .macro end name
    bx lr
    .size \name, . - \name
    .endm
    .syntax unified
    .fpu fpv4-sp-d16

    .section .vector_table, "a"
    .word 0x20004000
    .word start
    .rept 12
    .word default
    .endr
    .word PendSV
    .word SysTick

    .text
    .type start, %function
    .thumb_func
    .globl start
start:
    movw r0, #0xed88
    movt r0, #0xe000
    ldr r1, [r0]
    orr r1, r1, #0xf00000
    str r1, [r0]
    dsb
    isb
    ldr r4, =0x20000100
    bl empty
    bl arithmetic
    bl divide
    bl load_alone
    bl load_chain
    bl load_dependent
    bl load_after_skipped
    bl stores
    bl multiples
    bl doubles
    bl exclusives
    bl branch_taken
    bl branch_not_taken
    bl compare_and_branch
    bl loop_of_three
    bl table_branch
    bl if_then_folded
    bl if_then_unfolded
    bl skipped
    bl specials
    bl barriers
    bl calls
    bl pops
    bl tail
    bl float_simple
    bl float_accumulate
    bl float_divide
    bl float_memory
    bl float_transfer
    bl interrupt_once
    bl interrupt_nested
    bl interrupt_chained
    movs r0, #0x18
    ldr r1, =0x20026
    bkpt 0xab
    .size start, . - start
    .ltorg

    function default
    b default
    end default

    function empty
    end empty

    function arithmetic
    movs r0, #1
    adds r0, r0, #2
    add.w r0, r0, r0, lsl #3
    muls r0, r0, r0
    mla r0, r0, r0, r0
    umull r0, r1, r0, r0
    smlal r0, r1, r0, r0
    clz r0, r0
    usat r0, #5, r0
    ubfx r0, r0, #1, #3
    sadd16 r0, r0, r0
    end arithmetic

    function divide
    movs r0, #9
    movs r1, #3
    udiv r0, r0, r1
    sdiv r0, r0, r1
    end divide

    function load_alone
    ldr r0, [r4]
    nop
    ldrb r0, [r4, #1]
    nop
    ldrsh.w r0, [r4, #2]
    end load_alone

    function load_chain
    ldr r0, [r4]
    ldr r1, [r4, #4]
    ldrb r2, [r4, #8]
    ldr.w r3, [r4, #12]
    end load_chain

    function load_dependent
    str r4, [r4]
    ldr r0, [r4]
    ldr r1, [r0]
    ldr r2, [r4, #4]
    end load_dependent

    function load_after_skipped
    cmp r4, #0
    it eq
    ldreq r0, [r4]
    ldr r1, [r4]
    end load_after_skipped

    function stores
    movs r1, #4
    str r0, [r4]
    strb r0, [r4, #1]
    strh.w r0, [r4, #2]
    str r0, [r4, r1]
    str.w r0, [r4, r1, lsl #2]
    end stores

    function multiples
    push {{r0, r1, r2}}
    pop {{r0, r1, r2}}
    add r3, r4, #16
    stm r3!, {{r0, r1}}
    ldmdb r3!, {{r0, r1}}
    end multiples

    function doubles
    strd r0, r1, [r4]
    ldrd r0, r1, [r4]
    end doubles

    function exclusives
    ldrex r0, [r4]
    strex r1, r0, [r4]
    clrex
    end exclusives

    function branch_taken
    b 1f
    nop
1:  b.w 2f
    nop
2:
    end branch_taken

    function branch_not_taken
    cmp r4, #0
    beq 1f
    beq.w 1f
    nop
1:
    end branch_not_taken

    function compare_and_branch
    cbz r4, 1f
    cbnz r4, 1f
    nop
1:
    end compare_and_branch

    function loop_of_three
    movs r0, #3
1:  subs r0, r0, #1
    bne 1b
    end loop_of_three

    function table_branch
    movs r0, #1
    tbb [pc, r0]
1:  .byte (2f - 1b) / 2
    .byte (3f - 1b) / 2
2:  nop
3:
    end table_branch

    function if_then_folded
    cmp r4, #0
    it ne
    movne r0, #1
    end if_then_folded

    function if_then_unfolded
    cmp.w r4, #0
    ite ne
    movne r0, #1
    moveq r0, #2
    end if_then_unfolded

    function skipped
    cmp r4, #0
    itttt eq
    ldreq r0, [r4]
    pusheq {{r0, r1, r2}}
    ldrdeq r0, r1, [r4]
    bxeq lr
    end skipped

    function specials
    mrs r0, basepri
    msr basepri, r0
    cpsie i
    end specials

    function barriers
    dmb
    dsb
    isb
    end barriers

    function calls
    push {{r4, lr}}
    bl empty
    ldr r0, =empty
    blx r0
    pop {{r4, pc}}
    .size calls, . - calls
    .ltorg

    function pops
    push {{lr}}
    ldr pc, [sp], #4
    .size pops, . - pops

    function tail
    b.w tail_target
    .size tail, . - tail
    nop

    function tail_target
    end tail_target

    function float_simple
    vadd.f32 s0, s1, s2
    vmul.f32 s0, s1, s2
    vcvt.s32.f32 s0, s0
    vabs.f32 s0, s1
    vcmp.f32 s0, s1
    vmrs APSR_nzcv, fpscr
    vmov.f32 s0, #1.0
    vnmul.f32 s0, s1, s2
    end float_simple

    function float_accumulate
    vmla.f32 s0, s1, s2
    vmls.f32 s0, s1, s2
    vfma.f32 s0, s1, s2
    vfnms.f32 s0, s1, s2
    end float_accumulate

    function float_divide
    vmov.f32 s1, #1.0
    vdiv.f32 s0, s1, s1
    vsqrt.f32 s0, s1
    end float_divide

    function float_memory
    vldr s0, [r4]
    vstr s0, [r4]
    vldr d0, [r4]
    vpush {{s0-s3}}
    vpop {{s0-s3}}
    end float_memory

    function float_transfer
    vmov r0, s0
    vmov s0, r0
    vmov r0, r1, d0
    vmov d0, r0, r1
    end float_transfer

    function interrupt_once
    ldr r3, =0xe000ed04
    ldr r2, =0x10000000
    str r2, [r3]
    dsb
    isb
    nop
    end interrupt_once
    .ltorg

    function interrupt_nested
    movs r5, #1
    ldr r3, =0xe000ed20
    mov r2, #0xff0000
    str r2, [r3]
    ldr r3, =0xe000ed04
    ldr r2, =0x10000000
    str r2, [r3]
    dsb
    isb
    nop
    end interrupt_nested
    .ltorg

    function interrupt_chained
    movs r5, #1
    ldr r3, =0xe000ed20
    movs r2, #0
    str r2, [r3]
    ldr r3, =0xe000ed04
    ldr r2, =0x10000000
    str r2, [r3]
    dsb
    isb
    nop
    end interrupt_chained
    .ltorg

    function PendSV
    cbz r5, 1f
    movs r5, #0
    ldr r3, =0xe000ed04
    ldr r2, =0x04000000
    str r2, [r3]
    dsb
    isb
    nop
1:
    end PendSV
    .ltorg

    function SysTick
    push {{r4, lr}}
    bl empty
    pop {{r4, pc}}
    .size SysTick, . - SysTick
    "#
);

#[panic_handler]
fn panic(_: &core::panic::PanicInfo) -> ! {
    loop {}
}
