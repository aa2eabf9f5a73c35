//! USB: the driver and its device against a model of the core, with hosts as operating systems are.
#![cfg(not(target_os = "none"))]

mod board;
mod enumeration;
mod flow;
mod link;
mod machine;

use board::Board;
use otg::{Core, Host, Silicon, System};

/// A board of some silicon whose port a host has opened.
pub(crate) fn opened(silicon: Silicon) -> (Core, Board, Host) {
    let (mut core, mut board, mut host) = (Core::new(silicon), Board::new(), Host::default());
    let enumerated = host.enumerate(&mut core, System::Linux, &mut |core| board.period(core));
    assert_eq!(enumerated, Ok(()), "{silicon:?} {:?}", core.violations());
    board.periods(&mut core, 3);
    let _ = board.requests.take_greeting();
    (core, board, host)
}

/// Numbers as by chance, the same for a seed.
pub(crate) struct Random(pub(crate) u64);

impl Random {
    /// A number below another one.
    pub(crate) fn below(&mut self, end: u64) -> u64 {
        self.0 ^= self.0 << 13;
        self.0 ^= self.0 >> 7;
        self.0 ^= self.0 << 17;
        (self.0 >> 16) % end
    }
}
