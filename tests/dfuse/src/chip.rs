//! The chips, as their bootloaders describe the flash.

use std::fmt::Write as _;

/// A chip.
#[derive(Debug, Clone, Copy, PartialEq, Eq)]
pub struct Chip {
    /// Its name, as `f446`.
    pub name: &'static str,
    /// The KiB of its sectors: how many of which size, in order.
    sectors_kib: &'static [(u32, u32)],
    /// The string of its option bytes.
    pub(crate) option_bytes: &'static str,
}

/// The sectors up to 512 KiB, and those up to 1 MiB.
const HALF: &[(u32, u32)] = &[(4, 16), (1, 64), (3, 128)];
const WHOLE: &[(u32, u32)] = &[(4, 16), (1, 64), (7, 128)];
/// The two banks of F42x with 2 MiB.
const TWO_BANKS: &[(u32, u32)] = &[(4, 16), (1, 64), (7, 128), (4, 16), (1, 64), (7, 128)];
/// The option bytes of chips with one bank, and with two.
const OF_ONE_BANK: &str = "@Option Bytes  /0x1FFFC000/01*016 e";
const OF_TWO_BANKS: &str = "@Option Bytes  /0x1FFFC000/01*016 e/0x1FFEC000/01*016 e";

impl Chip {
    /// The chips of boards; `f429-2m` is the larger one, with which some boards are sold.
    pub const ALL: [Self; 6] = [
        Self::new("f405", WHOLE, OF_ONE_BANK),
        Self::new("f407", WHOLE, OF_ONE_BANK),
        Self::new("f411", HALF, OF_ONE_BANK),
        Self::new("f429", WHOLE, OF_TWO_BANKS),
        Self::new("f429-2m", TWO_BANKS, OF_TWO_BANKS),
        Self::new("f446", HALF, OF_ONE_BANK),
    ];

    const fn new(
        name: &'static str,
        sectors_kib: &'static [(u32, u32)],
        option_bytes: &'static str,
    ) -> Self {
        Self {
            name,
            sectors_kib,
            option_bytes,
        }
    }

    /// Returns the chip of a name.
    #[must_use]
    pub fn named(name: &str) -> Option<Self> {
        Self::ALL.into_iter().find(|chip| chip.name == name)
    }

    /// Returns the bytes of each sector, in order.
    pub fn sectors(self) -> impl Iterator<Item = u32> {
        let kinds = self.sectors_kib.iter();
        kinds.flat_map(|(count, kib)| (0..*count).map(move |_| kib * 1024))
    }

    /// Returns the string of the alternate setting of the flash: readable, erasable and writable.
    #[must_use]
    pub fn layout(self) -> String {
        let mut text = "@Internal Flash  /0x08000000/".to_owned();
        for (index, (count, kib)) in self.sectors_kib.iter().enumerate() {
            let comma = if index == 0 { "" } else { "," };
            let _ = write!(text, "{comma}{count:02}*{kib:03}Kg");
        }
        text
    }
}
