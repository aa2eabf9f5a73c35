//! Bytes that come while flash is erased and programmed, by the firmware's own code.
//!
//! The code uses the last sector without settings as a sector of the settings. The sector holds no part of this
//! program. It may hold a part of the firmware, which is written again afterwards. Three times bytes
//! come: while the sector is erased, while words are programmed, and while these are erased.

#[cfg_attr(feature = "qemu", path = "../../src/board/qemu/flash.rs")]
#[cfg_attr(not(feature = "qemu"), path = "../../src/board/flash.rs")]
#[allow(dead_code, reason = "nothing else is read")]
mod production;

use cortex_m::asm::dsb;
use embedded_storage::nor_flash::{NorFlash as _, ReadNorFlash as _};
use stm32f4xx_hal::pac::flash::cr::PSIZE;

use self::production::SettingsFlash;
use super::{
    Facts,
    chosen::LAST_SECTOR,
    clock, emulation,
    line::Line,
    pac,
    sequence::{BURST, BURSTS, Sequence},
    serial, supply, vectors, watchdog,
};

/// What the firmware's code takes for the two sectors of the settings.
mod chosen {
    use super::{LAST_SECTOR, PAGE};

    pub(super) use crate::board::chosen::flash_access;

    pub(super) struct Page {
        pub(super) sector: u8,
        pub(super) address: usize,
    }

    pub(super) struct Wiring {
        pub(super) journal: [Page; 2],
    }

    /// The halves of the beginning of one sector.
    pub(super) static WIRING: Wiring = Wiring {
        journal: [page(0), page(1)],
    };

    const fn page(index: usize) -> Page {
        let (sector, address) = LAST_SECTOR;
        Page {
            sector,
            address: address + index * PAGE,
        }
    }
}

/// The step timer, which stands.
mod step_timer {
    pub(super) use crate::board::player::is_running;
}

/// Bytes of both pages, for the emulator's stand-in.
pub(super) const BOTH: usize = production::BOTH;
/// Bytes of a page, as much as is programmed and read.
const PAGE: usize = BOTH / 2;
/// Bytes of a word.
const WORD: usize = 4;
/// Says that the bytes of a burst have been compared.
const DONE: u8 = b'.';

/// What comes of an operation.
#[derive(Default)]
struct Outcome {
    /// Whether the firmware's code says so.
    is_done: bool,
    /// Longest time of an erase or of a word.
    cycles: i64,
    /// Words that are not as they should be.
    wrong_words: u32,
    /// Words that were programmed.
    words: u32,
}

/// What is done to the flash while bytes come.
type Operation = fn(&mut SettingsFlash, &Line) -> Outcome;

/// Erases, programs and erases while bytes come.
pub(super) fn measure(
    facts: &mut Facts,
    line: &mut Line,
    registers: pac::FLASH,
    receiver: serial::FlashEraseReceiver,
) {
    let mut flash = SettingsFlash::new(registers);
    flash.set_receiver(receiver);
    let mut expected = Sequence::new(BURSTS);
    let operations: [(&str, Operation); 3] = [
        ("flash.erase", erase),
        ("flash.program", program),
        ("flash.erase_again", erase),
    ];
    for (name, operate) in operations {
        if !line.await_byte() {
            return;
        }
        let lost = line.lost();
        let outcome = operate(&mut flash, line);
        let during = line.waiting() as u32;
        let bytes = line.compare(&mut expected, BURST);
        for (what, number) in [
            ("done", outcome.is_done.into()),
            ("cycles", outcome.cycles),
            ("words", outcome.words.into()),
            ("wrong_words", outcome.wrong_words.into()),
            ("during", during.into()),
            ("received", bytes.count.into()),
            ("wrong", bytes.wrong.into()),
            ("lost", line.lost().wrapping_sub(lost).into()),
        ] {
            facts.put_of(name, what, number);
        }
        line.send(DONE);
    }
    if !emulation::is_emulated() {
        poll_both(facts);
    }
}

/// Erases the sector.
fn erase(flash: &mut SettingsFlash, _: &Line) -> Outcome {
    let start = clock::now();
    let is_done = emulation::has_flaw(c"worn") || flash.erase(0, PAGE as u32).is_ok();
    let cycles = clock::cycles(clock::now().wrapping_sub(start));
    let wrong_words = (0..PAGE / WORD).filter(|index| read(flash, *index) != u32::MAX);
    Outcome {
        is_done,
        cycles,
        wrong_words: wrong_words.count() as u32,
        words: 0,
    }
}

/// Programs words as long as bytes come, and one at least.
fn program(flash: &mut SettingsFlash, line: &Line) -> Outcome {
    let mut outcome = Outcome {
        is_done: true,
        ..Outcome::default()
    };
    for index in 0..PAGE / WORD {
        let start = clock::now();
        let word = scatter(index).to_le_bytes();
        outcome.is_done &= flash.write((index * WORD) as u32, &word).is_ok();
        let cycles = clock::cycles(clock::now().wrapping_sub(start));
        outcome.cycles = outcome.cycles.max(cycles);
        outcome.words += 1;
        if line.waiting() >= BURST as usize {
            break;
        }
    }
    let words = 0..outcome.words as usize;
    let wrong_words = words.filter(|index| read(flash, *index) != scatter(*index));
    outcome.wrong_words = wrong_words.count() as u32;
    outcome
}

fn read(flash: &mut SettingsFlash, index: usize) -> u32 {
    let mut word = [0; WORD];
    let _ = flash.read((index * WORD) as u32, &mut word);
    u32::from_le_bytes(word)
}

/// Returns a word that no other index has, and that is not erased.
const fn scatter(index: usize) -> u32 {
    (index as u32 + 1).wrapping_mul(0x9e37_79b1)
}

/// Keys that unlock the flash: RM0090 3.6.1.
const UNLOCK_KEYS: [u32; 2] = [0x4567_0123, 0xcdef_89ab];

/// Programs a word and erases the sector once more, in silence, to see when the chip says that it is busy.
#[expect(unsafe_code, reason = "the code of the firmware has the flash")]
fn poll_both(facts: &mut Facts) {
    // SAFETY: that code is not used any more.
    let flash = unsafe { &*pac::FLASH::ptr() };
    // A low supply may have kept the firmware's code from locking what a bootloader has left unlocked.
    if flash.cr().read().lock().bit_is_set() {
        for key in UNLOCK_KEYS {
            flash.keyr().write(|w| w.key().set(key));
        }
    }
    cortex_m::interrupt::disable();
    let polls = [
        (
            "flash.program",
            poll_program(flash, LAST_SECTOR.1 as *mut u32),
        ),
        ("flash.erase", poll_erase(flash, LAST_SECTOR.0)),
    ];
    for (name, [at_once, second]) in polls {
        facts.put_of(name, "busy_at_once", at_once.into());
        facts.put_of(name, "busy", second.into());
    }
    flash.cr().write(|w| w.lock().set_bit());
}

type FlashRegisters = pac::flash::RegisterBlock;

/// Programs a word with zeros. Returns whether the flash is busy for the first read and for the second.
#[inline(never)]
#[unsafe(link_section = ".data.poll_program")]
#[expect(
    unsafe_code,
    reason = "a section in RAM, and memory beside the program"
)]
fn poll_program(flash: &FlashRegisters, place: *mut u32) -> [bool; 2] {
    flash.cr().write(|w| {
        // The PAC would set the lock, as a reset does.
        w.lock()
            .clear_bit()
            .psize()
            .variant(PSIZE::Psize32)
            .pg()
            .set_bit()
    });
    // SAFETY: no reference points to the sector.
    unsafe { place.write_volatile(0) };
    poll(flash)
}

/// Erases a sector. Returns whether the flash is busy for the first read and for the second.
#[inline(never)]
#[unsafe(link_section = ".data.poll_erase")]
#[expect(unsafe_code, reason = "a section in RAM")]
fn poll_erase(flash: &FlashRegisters, sector: u8) -> [bool; 2] {
    flash.cr().write(|w| {
        w.lock().clear_bit().psize().variant(PSIZE::Psize32);
        // SAFETY: a sector of this number exists.
        unsafe { w.snb().bits(sector) };
        w.ser().set_bit().strt().set_bit()
    });
    poll(flash)
}

/// Reads the flag with the very next instruction, and where the firmware reads it for the first time.
#[inline(always)]
#[expect(clippy::inline_always, reason = "nothing in flash may be called")]
fn poll(flash: &FlashRegisters) -> [bool; 2] {
    let at_once = flash.sr().read().bsy().bit_is_set();
    dsb();
    let second = flash.sr().read().bsy().bit_is_set();
    while flash.sr().read().bsy().bit_is_set() {}
    [at_once, second]
}
