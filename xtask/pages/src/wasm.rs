//! A job on the virtual machine, for a browser: the functions that its worker calls.
//!
//! The worker writes its texts into [`room`], calls [`begin`], [`pump`] until the end, and [`finish`], and reads the
//! results from [`text`] and [`length`]. Only numbers and addresses pass. The worker reads and writes the memory
//! itself, so that no address is dereferenced here. After a panic nothing but [`text`] and [`length`] may be called.
#![cfg_attr(
    target_family = "wasm",
    expect(unsafe_code, reason = "a browser finds functions by their names")
)]
// Elsewhere one of the names is the C library's.
#![cfg_attr(
    not(target_family = "wasm"),
    expect(dead_code, reason = "a browser calls them")
)]

mod run;

use std::{
    cell::RefCell,
    panic::{self, PanicHookInfo},
    sync::Once,
};

use run::Run;

thread_local! {
    static RUN: RefCell<Run> = RefCell::default();
    /// What went wrong: beside the run, which a panic leaves as it was.
    static FAILURE: RefCell<Vec<u8>> = const { RefCell::new(Vec::new()) };
}

/// What the worker may take.
const TEXTS: u32 = 3;

fn note(text: &str) {
    FAILURE.with_borrow_mut(|failure| failure.splice(.., text.bytes()).for_each(drop));
}

fn note_panic(info: &PanicHookInfo<'_>) {
    note(&info.to_string());
}

/// Returns 0, or 1 with a note of what went wrong.
fn report(result: anyhow::Result<()>) -> u32 {
    let Err(error) = result else { return 0 };
    note(&format!("{error:#}"));
    1
}

/// Makes room for a text of some bytes: 0 the program, 1 the settings, 2 and 3 the names of both. Returns
/// where it is.
#[cfg_attr(target_family = "wasm", unsafe(no_mangle))]
pub(crate) extern "C" fn room(which: u32, bytes: u32) -> *mut u8 {
    static HOOK: Once = Once::new();
    HOOK.call_once(|| panic::set_hook(Box::new(note_panic)));
    RUN.with_borrow_mut(|run| run.room(which as usize, bytes as usize).as_mut_ptr())
}

/// Begins the job, for a firmware that is proven for a step rate; 0: for none. The machine has switches and a
/// probe plate if `switches` is not 0. Returns 1 where it is refused.
#[cfg_attr(target_family = "wasm", unsafe(no_mangle))]
pub(crate) extern "C" fn begin(step_rate_hz: u32, switches: u32) -> u32 {
    report(RUN.with_borrow_mut(|run| run.begin(step_rate_hz, switches != 0)))
}

/// Goes on for at most so many changes of the machine. Returns 1 at the end.
#[cfg_attr(target_family = "wasm", unsafe(no_mangle))]
pub(crate) extern "C" fn pump(changes: u32) -> u32 {
    RUN.with_borrow_mut(|run| run.pump(changes).into())
}

/// Returns how many bytes of the program have been read.
#[cfg_attr(target_family = "wasm", unsafe(no_mangle))]
pub(crate) extern "C" fn read() -> f64 {
    RUN.with_borrow(Run::read) as f64
}

/// Returns the time of the machine, s.
#[cfg_attr(target_family = "wasm", unsafe(no_mangle))]
pub(crate) extern "C" fn seconds() -> f64 {
    RUN.with_borrow(Run::seconds)
}

/// Makes summary and page. Returns 1 where there is none.
#[cfg_attr(target_family = "wasm", unsafe(no_mangle))]
pub(crate) extern "C" fn finish() -> u32 {
    report(RUN.with_borrow_mut(Run::finish))
}

/// Returns where a text is: 0 what went wrong, 1 the summary in JSON, 2 the page.
#[cfg_attr(target_family = "wasm", unsafe(no_mangle))]
pub(crate) extern "C" fn text(which: u32) -> *const u8 {
    with_text(which, <[u8]>::as_ptr)
}

/// Returns how many bytes it has.
#[cfg_attr(target_family = "wasm", unsafe(no_mangle))]
pub(crate) extern "C" fn length(which: u32) -> u32 {
    with_text(which, |text| text.len() as u32)
}

fn with_text<T>(which: u32, read: impl Fn(&[u8]) -> T) -> T {
    assert!(which < TEXTS, "there is no text {which}");
    match which {
        0 => FAILURE.with_borrow(|failure| read(failure)),
        which => RUN.with_borrow(|run| read(run.outcome(which as usize - 1))),
    }
}
