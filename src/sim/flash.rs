//! A model of two sectors of the STM32F4's flash, with power cuts.
//!
//! An erase sets every bit of a sector. Programming clears bits, a word at a time; a clear bit
//! stays clear until the sector is erased, and programming it to one is an error (RM0090 3.6). A
//! power cut in the middle of a word leaves some of its bits programmed; a power cut in the middle
//! of an erase leaves a part of the sector erased.

use embedded_storage::nor_flash::{
    ErrorType, NorFlash, NorFlashError, NorFlashErrorKind, ReadNorFlash,
};

/// Bytes of a sector, as of the chip's sectors 1 and 2; less where the simulator runs on the chip.
pub const SECTOR: usize = if cfg!(target_os = "none") {
    4 * 1024
} else {
    16 * 1024
};
const WORD: usize = 4;
/// Number of sectors.
pub const SECTORS: usize = 2;

/// The flash of a simulated machine: two sectors of `SIZE` bytes.
#[derive(Debug, Clone, PartialEq, Eq)]
pub struct Flash<const SIZE: usize = SECTOR> {
    sectors: [[u8; SIZE]; SECTORS],
    /// Number of words programmed and sectors erased.
    operations: u64,
    erases: [u32; SECTORS],
    /// Operations before the one in the middle of which the power is cut; `None` without a cut.
    operations_left: Option<u64>,
    is_off: bool,
    random: u64,
}

/// The reason for which an operation fails.
#[derive(Debug, Clone, Copy, PartialEq, Eq)]
pub enum FlashError {
    /// The power is off.
    Off,
    /// Not whole words or sectors.
    NotAligned,
    /// Beyond the end.
    OutOfBounds,
    /// A clear bit would have to be set by programming.
    NotErased,
}

impl NorFlashError for FlashError {
    fn kind(&self) -> NorFlashErrorKind {
        match self {
            Self::NotAligned => NorFlashErrorKind::NotAligned,
            Self::OutOfBounds => NorFlashErrorKind::OutOfBounds,
            Self::Off | Self::NotErased => NorFlashErrorKind::Other,
        }
    }
}

impl<const SIZE: usize> Flash<SIZE> {
    /// Returns an erased flash.
    #[must_use]
    pub const fn new() -> Self {
        Self {
            sectors: [[0xff; SIZE]; SECTORS],
            operations: 0,
            erases: [0; SECTORS],
            operations_left: None,
            is_off: false,
            random: 1,
        }
    }

    /// Returns the contents.
    #[must_use]
    pub fn contents(&self) -> &[u8] {
        self.sectors.as_flattened()
    }

    /// Returns the contents, to be changed without regard to the rules.
    pub fn contents_mut(&mut self) -> &mut [u8] {
        self.sectors.as_flattened_mut()
    }

    /// Returns the number of words programmed and sectors erased so far.
    #[must_use]
    pub const fn operations(&self) -> u64 {
        self.operations
    }

    /// Returns how often each sector was erased.
    #[must_use]
    pub const fn erases(&self) -> [u32; SECTORS] {
        self.erases
    }

    /// Cuts the power in the middle of the operation after the next `operations`; `seed` determines
    /// the contents after the cut.
    pub fn cut_after(&mut self, operations: u64, seed: u64) {
        self.operations_left = Some(operations);
        self.random = seed;
    }

    /// Returns whether the power has been cut.
    #[must_use]
    pub const fn is_off(&self) -> bool {
        self.is_off
    }

    /// Switches the power on, without a further cut.
    pub fn power_up(&mut self) {
        self.is_off = false;
        self.operations_left = None;
    }

    /// Counts an operation. Returns whether the power is cut in the middle of it.
    fn begin(&mut self) -> Result<bool, FlashError> {
        if self.is_off {
            return Err(FlashError::Off);
        }
        self.operations += 1;
        match &mut self.operations_left {
            Some(0) => {
                self.is_off = true;
                Ok(true)
            }
            Some(left) => {
                *left -= 1;
                Ok(false)
            }
            None => Ok(false),
        }
    }

    fn program(&mut self, offset: usize, value: [u8; WORD]) -> Result<(), FlashError> {
        let is_cut = self.begin()?;
        let torn = if is_cut { self.torn_word() } else { 0 };
        let word = self
            .contents_mut()
            .get_mut(offset..)
            .and_then(<[u8]>::first_chunk_mut)
            .ok_or(FlashError::OutOfBounds)?;
        let (old, value) = (u32::from_le_bytes(*word), u32::from_le_bytes(value));
        if value & !old != 0 {
            return Err(FlashError::NotErased);
        }
        *word = (old & (value | torn)).to_le_bytes();
        if is_cut { Err(FlashError::Off) } else { Ok(()) }
    }

    /// Returns the bits that a cut keeps from being programmed: all, none, or any.
    fn torn_word(&mut self) -> u32 {
        match self.next() % 4 {
            0 => 0,
            1 => u32::MAX,
            2 => self.next() | self.next(),
            _ => self.next(),
        }
    }

    fn erase_sector(&mut self, sector: usize) -> Result<(), FlashError> {
        let is_cut = self.begin()?;
        let mut partial = self.partial_erase();
        let bytes = self.sectors.get_mut(sector);
        let bytes = bytes.ok_or(FlashError::OutOfBounds)?;
        if let Some(erases) = self.erases.get_mut(sector) {
            *erases += 1;
        }
        if !is_cut {
            bytes.fill(0xff);
            return Ok(());
        }
        for (index, word) in bytes.as_chunks_mut::<WORD>().0.iter_mut().enumerate() {
            *word = (u32::from_le_bytes(*word) | partial.erased(index)).to_le_bytes();
        }
        Err(FlashError::Off)
    }

    fn partial_erase(&mut self) -> PartialErase {
        let mut word = || self.next() as usize % (SIZE / WORD);
        let (one, other) = (word(), word());
        PartialErase {
            mode: self.next() % 5,
            from: one.min(other),
            to: one.max(other),
            random: self.next().into(),
        }
    }

    fn next(&mut self) -> u32 {
        random(&mut self.random)
    }
}

impl<const SIZE: usize> Default for Flash<SIZE> {
    fn default() -> Self {
        Self::new()
    }
}

/// The part of an erase that is done before a cut.
struct PartialErase {
    mode: u32,
    from: usize,
    to: usize,
    random: u64,
}

impl PartialErase {
    /// Returns the bits of a word that are erased.
    fn erased(&mut self, index: usize) -> u32 {
        let all = |is_erased| if is_erased { u32::MAX } else { 0 };
        match self.mode {
            0 => all(index < self.from),
            1 => all(index >= self.from),
            2 => all((self.from..self.to).contains(&index)),
            3 => all(random(&mut self.random) & 1 == 0),
            _ => random(&mut self.random),
        }
    }
}

/// Returns the next number of a linear congruential generator (Knuth's MMIX), its upper half.
fn random(state: &mut u64) -> u32 {
    *state = state
        .wrapping_mul(6_364_136_223_846_793_005)
        .wrapping_add(1_442_695_040_888_963_407);
    (*state >> 32) as u32
}

impl<const SIZE: usize> ErrorType for Flash<SIZE> {
    type Error = FlashError;
}

impl<const SIZE: usize> ReadNorFlash for Flash<SIZE> {
    const READ_SIZE: usize = 1;

    fn read(&mut self, offset: u32, bytes: &mut [u8]) -> Result<(), FlashError> {
        if self.is_off {
            return Err(FlashError::Off);
        }
        let stored = self.contents().get(offset as usize..);
        let stored = stored.and_then(|stored| stored.get(..bytes.len()));
        bytes.copy_from_slice(stored.ok_or(FlashError::OutOfBounds)?);
        Ok(())
    }

    fn capacity(&self) -> usize {
        SECTORS * SIZE
    }
}

impl<const SIZE: usize> NorFlash for Flash<SIZE> {
    const WRITE_SIZE: usize = WORD;
    const ERASE_SIZE: usize = SIZE;

    fn erase(&mut self, from: u32, to: u32) -> Result<(), FlashError> {
        let (from, to) = (from as usize, to as usize);
        if !from.is_multiple_of(SIZE) || !to.is_multiple_of(SIZE) {
            return Err(FlashError::NotAligned);
        }
        (from / SIZE..to / SIZE).try_for_each(|sector| self.erase_sector(sector))
    }

    fn write(&mut self, offset: u32, bytes: &[u8]) -> Result<(), FlashError> {
        let (words, rest) = bytes.as_chunks();
        if !rest.is_empty() || !(offset as usize).is_multiple_of(WORD) {
            return Err(FlashError::NotAligned);
        }
        for (at, &word) in (offset as usize..).step_by(WORD).zip(words) {
            self.program(at, word)?;
        }
        Ok(())
    }
}
