//! Notices: messages to the sender that answer no line.

use super::Alarm;

/// Notices that are kept. More than can come between two runs of `interpret`: an alarm, the door,
/// sleep, the spindle and a probing move bring one each.
const CAPACITY: usize = 8;

/// A notice.
#[derive(Debug, Clone, Copy, PartialEq, Eq)]
pub enum Notice {
    /// The machine has locked itself.
    Alarm(Alarm),
    /// Cycle start, with nothing to go on with.
    #[cfg(arc_machine)]
    CycleStart,
    /// The safety door has been opened.
    CheckDoor,
    /// The spindle is being switched on again after it was stopped in a hold.
    RestoringSpindle,
    /// A spindle has been switched on, and nothing moves before its time is over.
    SpindleDelay,
    /// The machine sleeps: only a reset wakes it.
    Sleeping,
    /// A probing move has ended: `probed` of the snapshot has the result.
    Probed,
    /// Nothing has moved for a second since [`super::Requests::watch_standstill`].
    Standstill,
}

/// The latest notices and their number so far: each reader keeps its own count.
#[derive(Debug, Clone, Copy, Default, PartialEq)]
pub struct Notices {
    ring: [Option<Notice>; CAPACITY],
    count: u32,
}

impl Notices {
    /// Returns no notices.
    #[must_use]
    pub const fn new() -> Self {
        Self {
            ring: [None; CAPACITY],
            count: 0,
        }
    }

    /// Returns the number of notices so far, wrapping.
    #[must_use]
    pub const fn count(&self) -> u32 {
        self.count
    }

    /// Adds a notice.
    pub fn push(&mut self, notice: Notice) {
        if let Some(slot) = self.ring.get_mut(self.count as usize % CAPACITY) {
            *slot = Some(notice);
        }
        self.count = self.count.wrapping_add(1);
    }

    /// Returns the oldest notice after the first `seen`, the reader's own count, and increments the
    /// count.
    pub fn next(&self, seen: &mut u32) -> Option<Notice> {
        let unseen = self.count.wrapping_sub(*seen);
        if unseen == 0 {
            return None;
        }
        if unseen as usize > CAPACITY {
            *seen = self.count.wrapping_sub(CAPACITY as u32);
        }
        let notice = self.ring.get(*seen as usize % CAPACITY).copied().flatten();
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
        assert_eq!(late, CAPACITY);
    }
}
