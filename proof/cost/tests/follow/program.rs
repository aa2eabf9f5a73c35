//! A task with a loop, run in QEMU by `follow.rs`: once each with one to twenty turns.
#![no_std]
#![no_main]

use core::{arch::asm, hint::spin_loop};

#[repr(C)]
union Vector {
    word: u32,
    handler: unsafe extern "C" fn(),
}

#[used]
#[unsafe(link_section = ".vector_table")]
static VECTORS: [Vector; 16] = {
    let mut vectors = [const { Vector { handler: start } }; 16];
    vectors[0] = Vector { word: 0x2000_4000 };
    vectors[14] = Vector { handler: PendSV };
    vectors
};

/// A word that nothing else uses.
const LEFT: *mut u32 = 0x2000_0000 as *mut u32;

#[unsafe(no_mangle)]
#[allow(non_snake_case)]
extern "C" fn PendSV() {
    // wcet-bound: 20
    while left() != 0 {
        unsafe { LEFT.write_volatile(left() - 1) };
    }
}

fn left() -> u32 {
    unsafe { LEFT.read_volatile() }
}

#[unsafe(no_mangle)]
unsafe extern "C" fn start() {
    const CONTROL: *mut u32 = 0xe000_ed04 as *mut u32;
    const PEND: u32 = 1 << 28;
    for turns in 1..=20 {
        unsafe {
            LEFT.write_volatile(turns);
            CONTROL.write_volatile(PEND);
            asm!("dsb", "isb");
        }
    }
    // Semihosting: the program has ended.
    unsafe { asm!("bkpt 0xab", in("r0") 0x18, in("r1") 0x20026) };
}

#[panic_handler]
fn panic(_: &core::panic::PanicInfo) -> ! {
    loop {
        spin_loop();
    }
}
