//! Small programs, compiled here: their loops, flaws and memory.

/// The value, or the end of the test, which has printed why there is none.
macro_rules! or_skip {
    ($found:expr) => {
        match $found {
            Some(found) => found,
            None => return,
        }
    };
}

mod loops;
mod memory;
#[path = "../support/mod.rs"]
mod support;

use schedule::{Annotations, Count, Function, Image, Program, Rule};

/// The parts that every program needs: a vector table, something that cannot be computed, and a panic.
const FRAME: &str = r#"
#![no_std]
#![no_main]
#![allow(dead_code, unconditional_recursion, static_mut_refs)]
use core::hint::black_box;
use core::ptr::{read_volatile, write_volatile};
use core::sync::atomic::{AtomicU32, Ordering::Relaxed};

#[unsafe(link_section = ".vector_table")]
#[used]
static VECTORS: [unsafe extern "C" fn() -> u32; 2] = [stack, start];
unsafe extern "C" fn stack() -> u32 { 0 }

static COUNT: AtomicU32 = AtomicU32::new(0);
fn input() -> u32 { unsafe { read_volatile(0x4002_0010 as *const u32) } }
fn output(value: u32) { unsafe { write_volatile(0x4002_0014 as *mut u32, value) } }

#[panic_handler]
fn panic(_: &core::panic::PanicInfo) -> ! {
    loop { black_box(()); }
}

#[unsafe(no_mangle)]
pub extern "C" fn start() -> u32 {
    task();
    0
}
"#;

/// The image and annotations of a program whose task is `body`; `None` where it cannot be compiled.
fn read(body: &str) -> Option<(Image, Annotations)> {
    let folder = support::scratch();
    let elf = support::compile(&folder, &format!("{FRAME}{body}"))?;
    let image = Image::load(&elf).expect("it has just been linked");
    let annotations = Annotations::read(&folder).expect("its comments are right");
    Some((image, annotations))
}

/// The flaws of all code that `start` reaches.
fn flaws(program: &Program<'_>) -> Vec<(Rule, String)> {
    let reached = reached(program);
    let flaws = reached.iter().flat_map(|function| &function.flaws);
    flaws
        .map(|flaw| {
            let text = format!("{}; {}", flaw.what, flaw.place.frames.join(", "));
            (flaw.rule, text)
        })
        .collect()
}

fn reached<'p>(program: &'p Program<'_>) -> Vec<&'p Function> {
    let start = program.image.symbol("start").expect("it is exported");
    let reached = program.reach(start);
    reached
        .iter()
        .filter_map(|&address| program.function(address))
        .collect()
}

/// The bounds of all loops that `start` reaches, with their origins.
fn bounds(program: &Program<'_>) -> Vec<(Option<Count>, String)> {
    let loops = reached(program)
        .into_iter()
        .flat_map(|function| &function.loops);
    loops
        .map(|one| match &one.bound {
            Some(bound) => (Some(bound.count.clone()), bound.origin.clone()),
            None => (None, String::new()),
        })
        .collect()
}

/// Asserts that a program has exactly this flaw, at a line of the program.
#[track_caller]
fn assert_flaw(body: &str, rule: Rule) {
    let (image, annotations) = or_skip!(read(body));
    let program = Program::new(&image, &annotations);
    let flaws = flaws(&program);
    let is_found = |(found, text): &(Rule, String)| *found == rule && text.contains("src/main.rs:");
    assert!(
        flaws.iter().any(is_found),
        "{rule:?} is not among {flaws:?}"
    );
}
