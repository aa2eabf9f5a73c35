//! The instruction cache of the flash accelerator: 64 lines of 16 bytes, the oldest is replaced.

/// Lines that it holds.
const LINES: usize = 64;
/// No line, no place.
const NONE: u8 = u8::MAX;
/// Addresses have this many lines of flash at most: 2 MiB.
const FLASH_LINES: u32 = 2 * 1024 * 1024 / 16;

/// See the module. Places are linked from the line used last to the one used first.
pub(super) struct Cache {
    /// The place of each line of the flash.
    places: Vec<u8>,
    lines: [u32; LINES],
    newer: [u8; LINES],
    older: [u8; LINES],
    newest: u8,
    oldest: u8,
    used: u8,
}

impl Cache {
    /// An empty cache.
    pub(super) fn new() -> Self {
        Self {
            places: vec![NONE; FLASH_LINES as usize],
            lines: [u32::MAX; LINES],
            newer: [NONE; LINES],
            older: [NONE; LINES],
            newest: NONE,
            oldest: NONE,
            used: 0,
        }
    }

    /// Fetches the line that holds `address`; whether it was there. What is not in flash always is.
    pub(super) fn fetch(&mut self, address: u32) -> bool {
        let line = (address >> 4) % FLASH_LINES;
        if self.newest != NONE && self.lines[usize::from(self.newest)] == line {
            return true;
        }
        let place = self.places[line as usize];
        if place != NONE {
            self.unlink(place);
            self.put_first(place);
            return true;
        }
        let place = if usize::from(self.used) < LINES {
            self.used += 1;
            self.used - 1
        } else {
            let oldest = self.oldest;
            self.unlink(oldest);
            self.places[self.lines[usize::from(oldest)] as usize] = NONE;
            oldest
        };
        self.lines[usize::from(place)] = line;
        self.places[line as usize] = place;
        self.put_first(place);
        false
    }

    fn unlink(&mut self, place: u8) {
        let (newer, older) = (
            self.newer[usize::from(place)],
            self.older[usize::from(place)],
        );
        match newer {
            NONE => self.newest = older,
            _ => self.older[usize::from(newer)] = older,
        }
        match older {
            NONE => self.oldest = newer,
            _ => self.newer[usize::from(older)] = newer,
        }
    }

    fn put_first(&mut self, place: u8) {
        self.newer[usize::from(place)] = NONE;
        self.older[usize::from(place)] = self.newest;
        match self.newest {
            NONE => self.oldest = place,
            newest => self.newer[usize::from(newest)] = place,
        }
        self.newest = place;
    }
}

#[cfg(test)]
mod tests {
    use super::*;

    #[test]
    fn a_line_stays_until_64_others_were_used() {
        let mut cache = Cache::new();
        assert!(!cache.fetch(0x0800_0000));
        assert!(cache.fetch(0x0800_000f));
        for line in 1..64 {
            assert!(!cache.fetch(0x0800_0000 + 16 * line), "{line}");
        }
        assert!(cache.fetch(0x0800_0000));
        assert!(!cache.fetch(0x0800_0000 + 16 * 64));
        // The oldest was line 1, as line 0 has been used since.
        assert!(cache.fetch(0x0800_0000));
        assert!(cache.fetch(0x0800_0020));
        assert!(!cache.fetch(0x0800_0010));
        assert!(!cache.fetch(0x0800_0030));
    }
}
