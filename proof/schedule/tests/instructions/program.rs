//! Instructions for `objdump.rs`; never executed.
#![no_std]
#![no_main]

core::arch::global_asm!(
    r#"
    .syntax unified
    .fpu fpv4-sp-d16
    .section .vector_table, "a"
    .word 0x20004000
    .word start

    .text
    .type start, %function
    .thumb_func
    .globl start
start:
    movs r0, #1
    movs r1, r2
    mov r8, r1
    mov.w r3, r4
    movs.w r3, r4
    movw r5, #4660
    movt r5, #8192
    mvn r6, #7
    mvns.w r6, r7
    mov.w r0, #0x00ab00ab
    mov.w r0, #0xab00ab00
    mov.w r0, #0xabababab
    mov.w r0, #0x3fc00
    lsls r0, r1, #3
    lsrs r0, r1, #32
    asrs r0, r1, #4
    lsl.w r0, r1, r2
    lsls.w r8, r1, r2
    ror.w r0, r1, #3
    rrx r0, r1
    adds r0, r1, r2
    subs r0, r1, r2
    adds r0, r1, #7
    subs r0, r1, #7
    adds r0, #200
    subs r0, #200
    add r0, r8
    add.w r0, r1, r2
    adds.w r0, r1, r2, lsl #3
    sub.w r0, r1, r2
    addw r0, r1, #4095
    subw r0, r1, #4095
    add r0, sp, #16
    add sp, #24
    sub sp, #24
    sub.w sp, sp, #1024
    add.w r7, sp, #1024
    adr r0, 1f
    adr.w r0, 1f
    .align 2
1:  adc r0, r1, #1
    adcs r0, r1
    sbcs r0, r1
    sbc.w r0, r1, r2
    rsbs r0, r1, #0
    rsb.w r0, r1, #9
    and.w r0, r1, #1
    ands r0, r1
    bic.w r0, r1, #1
    bics r0, r1
    orr.w r0, r1, #1
    orrs r0, r1
    orr.w r0, r1, r2, lsl #1
    orn r0, r1, #1
    orn r0, r1, r2
    eor.w r0, r1, #1
    eors r0, r1
    pkhbt r0, r1, r2, lsl #4
    cmp r0, #1
    cmp r0, r1
    cmp r0, r8
    cmp.w r0, #1024
    cmp.w r0, r1, lsl #2
    cmn r0, r1
    cmn.w r0, #1
    tst r0, r1
    tst.w r0, #1
    teq.w r0, r1
    teq.w r0, #1
    muls r0, r1, r0
    mul r8, r1, r2
    mla r0, r1, r2, r3
    mls r0, r1, r2, r3
    umull r0, r1, r2, r3
    smull r0, r1, r2, r3
    umlal r0, r1, r2, r3
    smlal r0, r1, r2, r3
    umaal r0, r1, r2, r3
    smlabb r0, r1, r2, r3
    smulbb r0, r1, r2
    smlad r0, r1, r2, r3
    smmla r0, r1, r2, r3
    smmul r0, r1, r2
    smlalbb r0, r1, r2, r3
    usada8 r0, r1, r2, r3
    sdiv r0, r1, r2
    udiv r0, r1, r2
    ubfx r0, r1, #2, #3
    sbfx r0, r1, #2, #3
    bfi r0, r1, #2, #3
    bfc r0, #2, #3
    ssat r0, #8, r1
    usat r0, #8, r1, lsl #2
    ssat16 r0, #8, r1
    qadd r0, r1, r2
    sadd8 r0, r1, r2
    uhsub16 r0, r1, r2
    sel r0, r1, r2
    sxtb r0, r1
    sxth r0, r1
    uxtb r0, r1
    uxth r0, r1
    uxtb.w r8, r1, ror #8
    sxtab r0, r1, r2
    uxtah r0, r1, r2
    rev r0, r1
    rev16 r0, r1
    revsh r0, r1
    rbit r0, r1
    clz r0, r1
    ldr r0, [r1]
    ldr r0, [r1, #124]
    ldr r0, [sp, #8]
    ldr r0, [r1, r2]
    ldrb r0, [r1, r2]
    ldrh r0, [r1, r2]
    ldrsb r0, [r1, r2]
    ldrsh r0, [r1, r2]
    ldrb r0, [r1, #31]
    ldrh r0, [r1, #62]
    ldr r0, 2f
    ldr.w r0, 2f
    ldrb.w r0, 2f
    ldrsh.w r0, 2f
    ldr.w r8, [r1, #4092]
    ldr r8, [r1, #-255]
    ldr r0, [r1], #4
    ldr r0, [r1, #-4]!
    ldr.w r0, [r1, r2, lsl #2]
    ldrb.w r0, [r1, #1000]
    ldrsb.w r0, [r1, #-1]
    ldrh.w r0, [r1], #2
    ldrsh.w r0, [r1, #1000]
    ldrt r0, [r1, #4]
    pld [r0, #4]
    str r0, [r1]
    str r0, [sp, #8]
    str r0, [r1, r2]
    strb r0, [r1, r2]
    strh r0, [r1, r2]
    strb r0, [r1, #31]
    strh r0, [r1, #62]
    str.w r8, [r1, #4092]
    str r8, [r1, #-255]
    str r0, [r1], #4
    strb r0, [r1, #-1]!
    strh.w r0, [r1, r2, lsl #1]
    ldrd r0, r1, [r2, #8]
    ldrd r0, r1, [r2], #8
    strd r0, r1, [r2, #-8]
    strd r1, r0, [sp, #-16]!
    ldm r0!, {{r1, r2}}
    ldm r1, {{r1, r2}}
    ldm.w r0, {{r1, r8}}
    ldmdb r0!, {{r1, r2}}
    stm r0!, {{r1, r2}}
    stm.w r0, {{r1, r8}}
    stmdb r0!, {{r1, r2}}
    push {{r4, lr}}
    push.w {{r4, r8, lr}}
    pop {{r4, r5}}
    pop.w {{r4, r8}}
    ldrex r0, [r1, #4]
    ldrexb r0, [r1]
    ldrexh r0, [r1]
    strex r0, r2, [r1, #4]
    strexb r0, r2, [r1]
    strexh r0, r2, [r1]
    clrex
    cpsid i
    cpsie i
    cpsid f
    cpsie if
    mrs r0, basepri
    mrs r0, primask
    msr basepri, r0
    msr basepri_max, r0
    msr primask, r0
    msr apsr_nzcvq, r0
    dmb
    dsb
    isb
    nop
    nop.w
    sev
    wfi
    wfe
    yield
    svc #1
    bkpt #0
    ite eq
    moveq r0, #1
    movne r0, #2
    itt cs
    addcs r0, r0, #1
    strcs r0, [r1]
    it mi
    bmi 2f
    beq 2f
    bne.w 2f
    bls 2f
    cbz r0, 2f
    cbnz r0, 2f
    b 2f
    b.w 2f
    bl 2f
    blx r3
    .align 2
2:  bx r3
    vadd.f32 s0, s1, s2
    vsub.f32 s0, s1, s2
    vmul.f32 s0, s1, s2
    vnmul.f32 s0, s1, s2
    vmla.f32 s0, s1, s2
    vmls.f32 s0, s1, s2
    vnmla.f32 s0, s1, s2
    vnmls.f32 s0, s1, s2
    vfma.f32 s0, s1, s2
    vfms.f32 s0, s1, s2
    vfnma.f32 s0, s1, s2
    vfnms.f32 s0, s1, s2
    vdiv.f32 s0, s1, s2
    vsqrt.f32 s0, s1
    vabs.f32 s0, s1
    vneg.f32 s0, s1
    vcmp.f32 s0, s1
    vcmp.f32 s0, #0
    vcvt.s32.f32 s0, s1
    vcvt.f32.u32 s0, s1
    vcvt.f32.s32 s0, s0, #16
    vcvtb.f32.f16 s0, s1
    vmov.f32 s0, s1
    vmov.f32 s0, #1.0
    vmov s0, r1
    vmov r1, s0
    vmov r1, r2, s0, s1
    vmov s0, s1, r1, r2
    vmrs apsr_nzcv, fpscr
    vmrs r0, fpscr
    vmsr fpscr, r0
    vldr s0, [r1, #8]
    vldr d0, [r1, #-8]
    vldr s0, 3f
    vstr s0, [r1, #8]
    vstr d0, [sp]
    vldmia r0!, {{s0, s1, s2}}
    vldmdb r0!, {{d0, d1}}
    vstmia r0, {{s0, s1}}
    vpush {{s16, s17}}
    vpop {{d8}}
    tbb [pc, r0]
    tbh [pc, r0, lsl #1]
    tbb [r1, r0]
    mov pc, r0
    add pc, r0
    ldr pc, [r0, #4]
    ldr pc, [sp], #4
    pop {{r4, pc}}
    ldm.w r0, {{r4, pc}}
    .align 2
3:  bx lr
    .size start, . - start
    "#
);

#[panic_handler]
fn panic(_: &core::panic::PanicInfo) -> ! {
    loop {}
}
