//! The stamp before each record of the journal, by which a record that is missing is noticed.
//!
//! ```text
//! stamped record   2 │ keys: u8 │ number of the change: u32 │ version of each key: u8… │ record
//! ```
//!
//! Every change of a key makes its version another one. The newest stamp has the versions of all keys as they were
//! then, so a key of which an older record is found, or none, has lost its newest one. What is lost stays so in the
//! stamps of later changes, until the key is stored anew. Records of firmware without stamps have version 0, as
//! have keys without a record.

use sequential_storage::map::{SerializationError, Value};

use super::record::KEYS;

/// The first byte of a stamped record: one without a stamp begins with its format.
const STAMPED: u8 = 2;
/// The last version before the first one again: no byte is 0xFF, as flash is that is not written.
const LAST_VERSION: u8 = 0xfe;

/// Bytes of a stamp.
pub(super) const STAMP_BYTES: usize = 1 + 1 + 4 + KEYS;

/// The version of each key.
pub(super) type Versions = [u8; KEYS];

/// Returns the version after another one: never 0.
pub(super) const fn next_version(version: u8) -> u8 {
    if version >= LAST_VERSION {
        1
    } else {
        version + 1
    }
}

/// A stamp.
#[derive(Debug, Clone, Copy, PartialEq, Eq)]
pub(super) struct Stamp {
    /// Number of the change.
    pub(super) number: u32,
    pub(super) versions: Versions,
}

impl Stamp {
    /// That of a journal without a change.
    pub(super) const NONE: Self = Self {
        number: 0,
        versions: [0; KEYS],
    };
}

/// A record with its stamp, if it has one.
pub(super) struct Stamped<'a> {
    pub(super) stamp: Option<Stamp>,
    pub(super) record: &'a [u8],
}

impl<'a> Stamped<'a> {
    fn read(bytes: &'a [u8]) -> Option<Self> {
        let (&[STAMPED, keys, ref number @ ..], others) = bytes.split_first_chunk::<6>()? else {
            return None;
        };
        let (stored, record) = others.split_at_checked(keys.into())?;
        let mut versions = [0; KEYS];
        for (version, stored) in versions.iter_mut().zip(stored) {
            *version = *stored;
        }
        let number = u32::from_le_bytes(*number);
        let stamp = Some(Stamp { number, versions });
        Some(Self { stamp, record })
    }
}

impl<'a> Value<'a> for Stamped<'a> {
    fn serialize_into(&self, buffer: &mut [u8]) -> Result<usize, SerializationError> {
        let stamp = self.stamp.unwrap_or(Stamp::NONE);
        let parts = [
            &[STAMPED, KEYS as u8][..],
            &stamp.number.to_le_bytes(),
            &stamp.versions,
            self.record,
        ];
        let mut end = 0;
        for part in parts {
            buffer
                .get_mut(end..end + part.len())
                .ok_or(SerializationError::BufferTooSmall)?
                .copy_from_slice(part);
            end += part.len();
        }
        Ok(end)
    }

    fn deserialize_from(buffer: &'a [u8]) -> Result<(Self, usize), SerializationError> {
        let unstamped = Self {
            stamp: None,
            record: buffer,
        };
        Ok((Self::read(buffer).unwrap_or(unstamped), buffer.len()))
    }
}
