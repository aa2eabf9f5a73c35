//! Random changes of everything that is stored, the same in every run.

use std::num::NonZeroU8;

use leadscrew::{
    axis::AXES,
    settings::{
        Change, Changes, Erasing, Journal, StoreError, Stored, StoredLine, ToolEntry, ToolTable,
        assign,
    },
    sim::Flash,
    units::Nm,
};

/// A flash whose pages are full after a few dozen changes.
pub(crate) type Small = Flash<3072>;

/// Tools in a flash of that size, at most.
const FEW_TOOLS: u32 = 4;

/// Everything that is stored.
#[derive(Debug, Clone, Default, PartialEq)]
pub(crate) struct Contents {
    pub(crate) stored: Stored,
    pub(crate) tools: ToolTable,
}

/// The contents of a flash at power-up.
pub(crate) struct Loaded {
    pub(crate) contents: Contents,
    pub(crate) is_first_boot: bool,
    pub(crate) damaged: Changes,
}

/// A random history of changes.
pub(crate) struct History {
    random: u64,
    /// What is stored after the changes so far.
    pub(crate) contents: Contents,
}

impl History {
    pub(crate) fn new(seed: u64) -> Self {
        Self {
            random: seed,
            contents: Contents::default(),
        }
    }

    /// A number below `end`.
    pub(crate) fn below(&mut self, end: u32) -> u32 {
        self.random = self
            .random
            .wrapping_mul(6_364_136_223_846_793_005)
            .wrapping_add(1_442_695_040_888_963_407);
        ((self.random >> 33) as u32) % end
    }

    /// Makes the next change.
    pub(crate) fn change(&mut self) -> Change {
        match self.below(20) {
            0..=5 => self.setting(),
            6..=9 => self.origin(),
            10..=13 => self.tool(FEW_TOOLS),
            14 | 15 => {
                let line = self.below(2) as usize;
                self.contents.stored.startup[line] = self.text();
                Change::Startup(line)
            }
            16 => {
                self.contents.stored.build_info = self.text();
                Change::BuildInfo
            }
            17 => {
                self.contents.stored.settings = Stored::default().settings;
                Change::RestoreSettings
            }
            18 => {
                self.contents.stored.origins = Stored::default().origins;
                self.contents.tools.clear();
                Change::RestoreOrigins
            }
            _ => {
                self.contents = Contents::default();
                Change::RestoreAll
            }
        }
    }

    /// Changes a setting.
    pub(crate) fn setting(&mut self) -> Change {
        let value = self.below(1_000_000);
        let statements = [
            "22=1".to_owned(),
            "20=1".to_owned(),
            "22=0".to_owned(),
            format!("0={}", 3 + value % 200),
            format!("23={}", value % 8),
            format!("11={}.{}", value % 7, value),
            format!("30={value}"),
            format!(
                "{}={}.{}",
                100 + value as usize % AXES,
                1 + value % 900,
                value
            ),
            format!(
                "{}={}.{}",
                110 + value as usize % AXES,
                1 + value % 900,
                value
            ),
            format!("{}={}", 130 + value as usize % AXES, value),
        ];
        let which = self.below(statements.len() as u32) as usize;
        // A refused statement, as for soft limits without homing, stores the settings unchanged.
        let _ = assign(
            &mut self.contents.stored.settings,
            statements[which].as_bytes(),
        );
        Change::Settings
    }

    fn origin(&mut self) -> Change {
        let axis = self.below(AXES as u32) as usize;
        let nm = Nm(i64::from(self.below(u32::MAX).cast_signed()) * 1000 - 1);
        self.random ^= 1;
        let origins = &mut self.contents.stored.origins;
        let references = [&mut origins.g28, &mut origins.g30];
        let mut positions: Vec<_> = origins.coordinates.0.iter_mut().chain(references).collect();
        let which = (self.random >> 40) as usize % positions.len();
        positions[which][axis] = nm;
        Change::Origins
    }

    /// Sets or removes one of the first tools.
    pub(crate) fn tool(&mut self, tools: u32) -> Change {
        let slot = self.below(tools) as usize;
        let number = NonZeroU8::new(7 * slot as u8 + 1).unwrap();
        let mut length = || Nm(i64::from(self.below(1 << 31)) - (1 << 30));
        let entry = ToolEntry {
            number,
            offset: [length(), length(), length()],
            diameter: length(),
        };
        let entry = (self.below(8) != 0).then_some(entry);
        self.contents.tools.replace(slot, entry);
        Change::Tool(slot)
    }

    fn text(&mut self) -> StoredLine {
        let length = if self.below(4) == 0 { 128 } else { 20 };
        let length = self.below(length);
        (0..length).map(|_| b' ' + self.below(95) as u8).collect()
    }
}

/// Switches the power on and reads what is stored.
pub(crate) fn power_up<const SIZE: usize>(
    mut flash: Flash<SIZE>,
) -> (Journal<Flash<SIZE>>, Loaded) {
    flash.power_up();
    let mut journal = Journal::new(flash);
    let loaded = load(&mut journal).expect("the power is on");
    (journal, loaded)
}

/// Reads what is stored.
pub(crate) fn load<const SIZE: usize>(
    journal: &mut Journal<Flash<SIZE>>,
) -> Result<Loaded, StoreError> {
    let loaded = journal.load()?;
    let mut contents = Contents {
        stored: loaded.stored,
        tools: ToolTable::new(),
    };
    journal.load_tools(&mut contents.tools)?;
    Ok(Loaded {
        contents,
        is_first_boot: loaded.is_first_boot,
        damaged: loaded.damaged,
    })
}

/// Stores a change.
pub(crate) fn write<const SIZE: usize>(
    journal: &mut Journal<Flash<SIZE>>,
    change: Change,
    contents: &Contents,
) -> Result<(), StoreError> {
    journal.write(change, Erasing::Allowed, &contents.stored, &contents.tools)
}
