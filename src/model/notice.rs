//! What the machine tells the sender without having been asked.

use super::Alarm;

/// Notices that are kept: more than can come up between two runs of `interpret`.
const KEPT: usize = 8;

/// Something that has happened.
#[derive(Debug, Clone, Copy, PartialEq, Eq)]
pub enum Notice {
    /// The machine has locked itself.
    Alarm(Alarm),
    /// The safety door has been opened.
    CheckDoor,
    /// The spindle is being switched on again after it was stopped in a hold.
    RestoringSpindle,
    /// The machine sleeps: only a reset wakes it.
    Sleeping,
    /// A probing move has ended: `probed` of the snapshot says how.
    Probed,
}

/// The latest notices and how many there have been: each reader keeps its own count.
#[derive(Debug, Clone, Copy, Default, PartialEq)]
pub struct Notices {
    ring: [Option<Notice>; KEPT],
    count: u32,
}

impl Notices {
    /// None yet.
    #[must_use]
    pub const fn new() -> Self {
        Self {
            ring: [None; KEPT],
            count: 0,
        }
    }

    /// How many there have been, wrapping.
    #[must_use]
    pub const fn count(&self) -> u32 {
        self.count
    }

    /// Adds one.
    pub fn push(&mut self, notice: Notice) {
        if let Some(place) = self.ring.get_mut(self.count as usize % KEPT) {
            *place = Some(notice);
        }
        self.count = self.count.wrapping_add(1);
    }

    /// The first that a reader has not seen; it has seen `seen`, which is counted up.
    pub fn next(&self, seen: &mut u32) -> Option<Notice> {
        let unseen = self.count.wrapping_sub(*seen);
        if unseen == 0 {
            return None;
        }
        if unseen as usize > KEPT {
            *seen = self.count.wrapping_sub(KEPT as u32);
        }
        let notice = self.ring.get(*seen as usize % KEPT).copied().flatten();
        *seen = seen.wrapping_add(1);
        notice
    }
}

#[cfg(test)]
mod tests {
    use super::*;

    #[test]
    fn every_reader_sees_every_notice_once_and_the_latest_when_it_is_late() {
        let mut notices = Notices::new();
        let mut seen = 0;
        assert_eq!(notices.next(&mut seen), None);
        notices.push(Notice::CheckDoor);
        notices.push(Notice::Probed);
        assert_eq!(notices.next(&mut seen), Some(Notice::CheckDoor));
        assert_eq!(notices.next(&mut seen), Some(Notice::Probed));
        assert_eq!(notices.next(&mut seen), None);
        for _ in 0..20 {
            notices.push(Notice::Sleeping);
        }
        let mut late = 0;
        while notices.next(&mut seen).is_some() {
            late += 1;
        }
        assert_eq!(late, KEPT);
    }
}
