//! The journal in the chip's flash.

use leadscrew::{
    model::Requests,
    protocol::ByteWriter,
    settings::{Change, Journal, Loaded, StoreError, Stored},
};

use super::{flash::SettingsFlash, proven, serial::FlashEraseReceiver};

/// The journal, owned by `interpret`.
pub(crate) struct Storage(Journal<SettingsFlash>);

impl Storage {
    /// Reads the journal. A flash that fails reads as that of a new machine.
    pub(super) fn load(flash: SettingsFlash) -> (Self, Loaded) {
        let mut journal = Journal::new(flash);
        let mut loaded = journal.load().unwrap_or_default();
        loaded.stored.settings.step_rate = proven::step_rate();
        (Self(journal), loaded)
    }

    /// Sets the queue for bytes that come while flash is erased.
    pub(crate) fn receive_while_erasing(
        &mut self,
        requests: &'static Requests,
        received: ByteWriter<'static>,
    ) {
        let flash = self.0.flash();
        flash.set_receiver(FlashEraseReceiver::new(requests, received));
    }

    /// Stores a change. At rest only: this may take 0.8 s.
    pub(super) fn write(&mut self, change: Change, stored: &Stored) -> Result<(), StoreError> {
        self.0.write(change, stored)
    }
}
