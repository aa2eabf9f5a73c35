//! What outlives a reset: the facts, and which fault is made next.

use core::{cell::UnsafeCell, fmt, fmt::Write as _, mem::MaybeUninit};

/// Room for the facts.
const BYTES: usize = 8192;
/// Says that the last reset was made here.
const ARMED: u32 = 0xb219_0001;

/// The facts: a line of a name and a number for each.
#[repr(C)]
pub(super) struct Facts {
    length: usize,
    text: [u8; BYTES],
}

impl Facts {
    /// Writes a fact.
    pub(super) fn put(&mut self, name: &str, number: i64) {
        self.line(format_args!("{name} {number}"));
    }

    /// Writes a fact about something.
    pub(super) fn put_of(&mut self, subject: &str, name: &str, number: i64) {
        self.line(format_args!("{subject}.{name} {number}"));
    }

    fn line(&mut self, line: fmt::Arguments<'_>) {
        // A fact that is left out is missed by whoever reads them.
        let _ = writeln!(self, "{line}");
    }

    /// Returns the lines.
    pub(super) fn text(&self) -> &str {
        let text = self.text.get(..self.length).unwrap_or_default();
        core::str::from_utf8(text).unwrap_or_default()
    }

    /// Forgets the lines.
    pub(super) fn clear(&mut self) {
        self.length = 0;
    }
}

impl fmt::Write for Facts {
    fn write_str(&mut self, text: &str) -> fmt::Result {
        let end = self.length + text.len();
        let room = self.text.get_mut(self.length..end).ok_or(fmt::Error)?;
        room.copy_from_slice(text.as_bytes());
        self.length = end;
        Ok(())
    }
}

/// The memory of the main program.
#[repr(C)]
struct Memory {
    armed: u32,
    stage: usize,
    facts: Facts,
}

/// Numbers that a fault leaves.
pub(super) const NOTES: usize = 5;

/// Memory that nothing initialises: every word and byte of it is a number.
struct Uninitialised<T>(UnsafeCell<MaybeUninit<T>>);

#[expect(unsafe_code, reason = "statics that change")]
// SAFETY: the main program has the one, which `Kept::take` hands out once. The other is of words that are
// written by the main program, and by handlers of faults, when the main program runs no more.
unsafe impl<T> Sync for Uninitialised<T> {}

#[unsafe(link_section = ".uninit.bring_up")]
#[expect(unsafe_code, reason = "a section that nothing initialises")]
static MEMORY: Uninitialised<Memory> = Uninitialised(UnsafeCell::new(MaybeUninit::uninit()));

#[unsafe(link_section = ".uninit.bring_up_note")]
#[expect(unsafe_code, reason = "a section that nothing initialises")]
static NOTE: Uninitialised<[u32; NOTES]> = Uninitialised(UnsafeCell::new(MaybeUninit::uninit()));

/// The memory, for the main program.
pub(super) struct Kept(&'static mut Memory);

impl Kept {
    /// Returns the memory, once; it counts only after a reset that was made here.
    #[expect(unsafe_code, reason = "memory that nothing initialises")]
    pub(super) fn take() -> Self {
        // SAFETY: `bring_up` alone calls this, once; every word and byte is a number.
        let memory = unsafe { (*MEMORY.0.get()).assume_init_mut() };
        if memory.armed != ARMED {
            memory.stage = 0;
        }
        memory.armed = 0;
        Self(memory)
    }

    /// Returns the number of faults that have been made.
    pub(super) fn stage(&self) -> usize {
        self.0.stage
    }

    /// Begins anew.
    pub(super) fn begin(&mut self) -> &mut Facts {
        self.0.facts.length = 0;
        &mut self.0.facts
    }

    /// Returns the facts.
    pub(super) fn facts(&mut self) -> &mut Facts {
        &mut self.0.facts
    }

    /// Counts a fault that is about to be made.
    pub(super) fn arm(&mut self) {
        self.0.stage += 1;
        self.0.armed = ARMED;
        cortex_m::asm::dsb();
    }

    /// Counts a fault that is not made.
    pub(super) fn skip(&mut self) {
        self.0.stage += 1;
    }

    /// A fault has made no reset.
    pub(super) fn disarm(&mut self) {
        self.0.armed = 0;
    }

    /// Returns the facts of all faults; after the next reset everything begins anew.
    pub(super) fn end(self) -> &'static mut Facts {
        &mut self.0.facts
    }
}

/// Leaves a number, before a fault and in the middle of it.
#[expect(unsafe_code, reason = "memory that nothing initialises")]
pub(super) fn leave(index: usize, number: u32) {
    if index < NOTES {
        // SAFETY: the word is there.
        unsafe { NOTE.0.get().cast::<u32>().add(index).write_volatile(number) };
    }
}

/// Returns a number that was left.
#[expect(unsafe_code, reason = "memory that nothing initialises")]
pub(super) fn left(index: usize) -> u32 {
    if index >= NOTES {
        return 0;
    }
    // SAFETY: the word is there.
    unsafe { NOTE.0.get().cast::<u32>().add(index).read_volatile() }
}
