//! Instructions, by the classes of the cycle table.
#![expect(unsafe_code, reason = "the instructions themselves")]

use core::sync::atomic::{AtomicU32, Ordering::Relaxed};

use crate::{
    cycles::{float_sample, sample},
    target::Samples,
};

/// Measures every class.
pub(crate) fn measure(samples: &mut Samples) {
    arithmetic(samples);
    memory(samples);
    branches(samples);
    special(samples);
    float(samples);
    straight_line(samples);
}

fn arithmetic(samples: &mut Samples) {
    let sample = sample!(1, "adds {a}, {a}, #1", a = inout(reg) 1 => _,);
    samples.put("plain", "add", &sample);
    let sample = sample!(1, "add.w {a}, {a}, {b}, lsl #3", a = inout(reg) 1 => _, b = in(reg) 3,);
    samples.put("plain", "shifted", &sample);
    let sample = sample!(1, "ubfx {a}, {a}, #3, #7", a = inout(reg) 1 => _,);
    samples.put("plain", "bits", &sample);
    let sample = sample!(2, "it eq\naddeq {a}, {a}, #1", a = inout(reg) 1 => _,);
    samples.put("plain", "conditional", &sample);
    let sample = sample!(1, "mul {a}, {a}, {b}", a = inout(reg) 77 => _, b = in(reg) u32::MAX,);
    samples.put("multiply", "mul", &sample);
    let sample = sample!(
        1, "smlal {a}, {b}, {c}, {c}",
        a = inout(reg) u32::MAX => _, b = inout(reg) 77 => _, c = in(reg) u32::MAX,
    );
    samples.put("multiply", "smlal", &sample);
    let sample = sample!(
        1, "udiv {a}, {b}, {c}", a = out(reg) _, b = in(reg) u32::MAX, c = in(reg) 1,
    );
    samples.put("divide", "udiv-by-1", &sample);
    let sample = sample!(
        1, "udiv {a}, {b}, {c}", a = out(reg) _, b = in(reg) u32::MAX, c = in(reg) 3,
    );
    samples.put("divide", "udiv-by-3", &sample);
    let sample = sample!(
        1, "sdiv {a}, {b}, {c}", a = out(reg) _, b = in(reg) 0x8000_0001_u32, c = in(reg) 3,
    );
    samples.put("divide", "sdiv-by-3", &sample);
}

fn memory(samples: &mut Samples) {
    static WORDS: [AtomicU32; 4] = [const { AtomicU32::new(0) }; 4];
    let place = WORDS.as_ptr() as u32;
    // A word that holds its own address: each load waits for the one before.
    WORDS[0].store(place, Relaxed);
    let sample = sample!(1, "ldr {p}, [{p}]", p = inout(reg) place => _,);
    samples.put("load", "dependent", &sample);
    let sample = sample!(1, "ldr {a}, [{p}]", a = out(reg) _, p = in(reg) place,);
    samples.put("load", "pipelined", &sample);
    let sample =
        sample!(2, "ldr {a}, [{p}]\nadds {a}, {a}, #1", a = out(reg) _, p = in(reg) place,);
    // The addition takes one of the cycles of two instructions: not more than two of loads.
    samples.put("load", "used", &sample);
    let sample = sample!(1, "str {a}, [{p}]", a = in(reg) 1, p = in(reg) place,);
    samples.put("store", "word", &sample);
    let sample = sample!(1, "strb {a}, [{p}]", a = in(reg) 1, p = in(reg) place,);
    samples.put("store", "byte", &sample);
    let sample = sample!(
        1, "ldmia {p}, {{r0, r1, r2, r3}}", p = in(reg) place,
        out("r0") _, out("r1") _, out("r2") _, out("r3") _,
    );
    samples.put("load_word", "ldm", &sample);
    let sample = sample!(
        1, "stmia {p}, {{r0, r1, r2, r3}}", p = in(reg) place,
        in("r0") 0, in("r1") 0, in("r2") 0, in("r3") 0,
    );
    samples.put("store_word", "stm", &sample);
    let sample = sample!(
        2, "ldrex {a}, [{p}]\nstrex {b}, {a}, [{p}]",
        a = out(reg) _, b = out(reg) _, p = in(reg) place,
    );
    samples.put("exclusive", "pair", &sample);
}

fn branches(samples: &mut Samples) {
    let sample = sample!(1, "b.n 2f\nnop\n2:",);
    samples.put("refill", "short", &sample);
    let sample = sample!(1, "b.w 2f\nnop\n2:",);
    samples.put("refill", "long", &sample);
    let sample = sample!(1, "cbz r3, 2f\nnop\n2:", in("r3") 0,);
    samples.put("refill", "cbz", &sample);
    let sample = sample!(3, "bl 2f\nb 3f\n2: bx lr\n3:", out("lr") _,);
    samples.put("refill", "call", &sample);
    let sample = sample!(1, "tbb [pc, {z}]\n.byte 1, 0", z = in(reg) 0,);
    samples.put("table_jump", "tbb", &sample);
}

fn special(samples: &mut Samples) {
    let sample = sample!(1, "msr basepri, {z}", z = in(reg) 0,);
    samples.put("special", "msr", &sample);
    let sample = sample!(1, "mrs {a}, basepri", a = out(reg) _,);
    samples.put("special", "mrs", &sample);
    let sample = sample!(1, "cpsid i",);
    samples.put("special", "cps", &sample);
    let sample = sample!(1, "dmb",);
    samples.put("barrier", "dmb", &sample);
    let sample = sample!(1, "dsb",);
    samples.put("barrier", "dsb", &sample);
    let sample = sample!(1, "isb",);
    samples.put("barrier", "isb", &sample);
}

fn float(samples: &mut Samples) {
    // An instruction that may take one cycle is counted as two.
    samples.put("float_1", "neg", &float_sample!("vneg.f32 s0, s0"));
    samples.put("float_2", "neg", &float_sample!("vneg.f32 s0, s0"));
    samples.put("float_2", "compare", &float_sample!("vcmp.f32 s0, s1"));
    samples.put("float_2", "flags", &float_sample!("vmrs apsr_nzcv, fpscr"));
    samples.put("float_2", "whole", &float_sample!("vcvt.s32.f32 s0, s1"));
    samples.put("float_2", "add", &float_sample!("vadd.f32 s0, s0, s1"));
    samples.put("float_2", "multiply", &float_sample!("vmul.f32 s0, s0, s1"));
    samples.put("float_4", "fma", &float_sample!("vfma.f32 s0, s1, s2"));
    samples.put("float_4", "mla", &float_sample!("vmla.f32 s0, s1, s2"));
    samples.put("float_15", "divide", &float_sample!("vdiv.f32 s0, s1, s2"));
    samples.put("float_15", "root", &float_sample!("vsqrt.f32 s0, s1"));
    samples.put("float_load", "vldr", &float_sample!("vldr s0, [{p}]"));
}

/// Code that is longer than the instruction cache: every line of four instructions is a miss.
fn straight_line(samples: &mut Samples) {
    const LINES: u32 = 128;
    let sample = crate::cycles::Sample::of(
        LINES,
        crate::cycles::repeated!(512, "", "add.w {a}, {a}, #1", "", a = inout(reg) 1 => _,),
        crate::cycles::repeated!(1024, "", "add.w {a}, {a}, #1", "", a = inout(reg) 1 => _,),
    );
    samples.put("flash_miss", "line", &sample);
}
