//! Places in the stream of received bytes that requests refer to.

/// A place in the stream of received bytes: the number of bytes of lines before it, wrapping.
#[derive(Debug, Clone, Copy, Default, PartialEq, Eq)]
pub struct ReceivedPosition(pub(super) u32);

impl ReceivedPosition {
    /// The place after a number of bytes, wrapping.
    #[must_use]
    pub const fn new(received: usize) -> Self {
        Self(received as u32)
    }

    /// Returns the number of bytes from another place, of this number, to this one. Less than 2^24.
    #[must_use]
    pub const fn distance_from(self, number: usize) -> usize {
        (self.0.wrapping_sub(number as u32) & 0xff_ffff) as usize
    }
}

/// Where the operator's lines lie in the stream of received bytes.
#[derive(Debug, Clone, Copy, Default, PartialEq, Eq)]
pub struct ToolChangeSpan {
    /// Number of changes in which there were such lines, wrapping.
    pub changes: u8,
    /// Where the lines begin: at 0xA3.
    pub begin: ReceivedPosition,
    /// Where they end: at cycle start.
    pub end: ReceivedPosition,
}

impl ToolChangeSpan {
    /// No change yet.
    pub const NONE: Self = Self {
        changes: 0,
        begin: ReceivedPosition(0),
        end: ReceivedPosition(0),
    };
}
