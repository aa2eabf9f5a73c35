//! What outlives power, in the chip's flash or in an EEPROM, and the session that is made of its contents.
//!
//! # Cost
//! RTIC lets the first tasks run while the frame of the initialisation is still on the stack. So large values
//! are made by functions out of line, one after the other, and have their places in [`Memory`]. Nothing is in
//! these places before: an initial value would be kept in flash, with all zeros of its queues.

use core::mem::MaybeUninit;

use leadscrew::{
    motion::{Motion, QueuedBlock},
    protocol::{IncomingWriter, Session},
    settings::{Change, Erasing, Loaded, StoreError, Stored, ToolTable},
};

use super::proven;
#[cfg(not(feature = "eeprom"))]
use super::serial::FlashEraseReceiver;

/// Where the settings are, and how they are kept there.
#[cfg(not(feature = "eeprom"))]
mod medium {
    pub(crate) use crate::board::flash::SettingsFlash as Medium;

    pub(crate) type Store = leadscrew::settings::Journal<Medium>;
}
#[cfg(feature = "eeprom")]
mod medium {
    pub(crate) use crate::board::eeprom::SettingsEeprom as Medium;

    use leadscrew::settings::{EEPROM_KIB, EepromStore, SMALL_EEPROM_KIB, TOOLS};

    const KIB: usize = if cfg!(feature = "eeprom-4") {
        SMALL_EEPROM_KIB
    } else {
        EEPROM_KIB
    };

    pub(crate) type Store = EepromStore<Medium, KIB>;

    const _: () = assert!(
        Store::HAS_ROOM && TOOLS <= Store::TOOLS,
        "the EEPROM is too small for so many axes or tools"
    );
}

pub(super) use medium::Medium;

/// The storage, owned by `interpret`.
pub(crate) struct Storage(medium::Store);

/// The place of the motion: zeros until power-up.
pub(crate) struct MotionMemory(MaybeUninit<Motion>);

impl MotionMemory {
    pub(crate) const fn new() -> Self {
        Self(MaybeUninit::zeroed())
    }

    /// Makes the motion of a machine that is not yet configured, without blocks.
    #[inline(never)]
    #[expect(unsafe_code, reason = "what is known to be zero need not be written")]
    pub(crate) fn power_up(&mut self) -> &mut Motion {
        // A free block may be anything that is a block, as zeros are.
        const _: QueuedBlock = {
            // SAFETY: a constant that is no value of its type is an error of the build.
            unsafe { MaybeUninit::zeroed().assume_init() }
        };
        let beginning = self.0.as_mut_ptr().cast::<Motion<0>>();
        // SAFETY: both types have C's layout with the blocks last, so that the one is the beginning of the other.
        // The blocks are zeros, and such blocks are valid.
        unsafe {
            beginning.write(Motion::without_blocks());
            self.0.assume_init_mut()
        }
    }
}

/// The places of the storage and of the session.
pub(crate) struct Memory {
    pub(crate) storage: &'static mut MaybeUninit<Storage>,
    pub(crate) session: &'static mut MaybeUninit<Session>,
}

impl Memory {
    /// Makes the session of a machine that has just been switched on. A storage that fails reads as that of
    /// a new machine.
    #[inline(never)]
    pub(super) fn power_up(self, flash: Medium) -> (&'static mut Session, &'static mut Storage) {
        let storage = self.storage.write(Storage(medium::Store::new(flash)));
        let loaded = storage.load();
        let session = make_session(self.session, &loaded);
        storage.load_tools(session.tools_mut());
        (session, storage)
    }
}

#[inline(never)]
fn make_session(
    memory: &'static mut MaybeUninit<Session>,
    loaded: &Loaded,
) -> &'static mut Session {
    let session = memory.write(Session::new(&loaded.stored, loaded.is_first_boot));
    session.set_damaged(loaded.damaged);
    session
}

impl Storage {
    #[inline(never)]
    fn load(&mut self) -> Loaded {
        let mut loaded = self.0.load().unwrap_or_default();
        loaded.stored.settings.step_rate = proven::step_rate();
        loaded
    }

    #[inline(never)]
    fn load_tools(&mut self, tools: &mut ToolTable) {
        let _ = self.0.load_tools(tools);
    }

    /// Sets the queue for bytes that come while flash is erased.
    #[cfg(not(feature = "eeprom"))]
    pub(crate) fn receive_while_erasing(&mut self, reception: IncomingWriter<'static>) {
        let flash = self.0.flash();
        flash.set_receiver(FlashEraseReceiver::new(reception));
    }

    /// Does nothing: the chip runs while an EEPROM is written.
    #[cfg(feature = "eeprom")]
    #[expect(clippy::unused_self, reason = "flash needs it")]
    pub(crate) fn receive_while_erasing(&mut self, _: IncomingWriter<'static>) {}

    /// Stores a change. At rest only: an erase may take 2 s.
    pub(crate) fn write(
        &mut self,
        change: Change,
        #[cfg_attr(feature = "eeprom", expect(unused, reason = "an EEPROM is not erased"))]
        erasing: Erasing,
        stored: &Stored,
        tools: &ToolTable,
    ) -> Result<(), StoreError> {
        #[cfg(feature = "eeprom")]
        return self.0.write(change, stored, tools);
        #[cfg(not(feature = "eeprom"))]
        self.0.write(change, erasing, stored, tools)
    }
}
