//! Jogs as long as a key is held: short ones in a row, so that few of them wait in the machine when nobody
//! cancels them any more.

use std::fmt::Write as _;

use leadscrew::axis::LETTERS;

/// The time of motion of one of them, s.
const BLOCK_S: f64 = 0.05;
/// The time of motion that waits in the machine beside that in which it can stop, s.
const LOOKAHEAD_S: f64 = 0.1;
/// The acceleration of a machine that has not told it, mm/s².
const ACCELERATION: f64 = 250.0;
/// The least length of one of them, mm, however slow it is.
const SHORTEST_MM: f64 = 0.01;
/// What is left before the end of the travel is not moved, mm.
const LEAST_MM: f64 = 0.01;

/// A jog of a held key.
#[derive(Debug)]
pub(super) struct Jog {
    along: Vec<i8>,
    feed: f64,
    /// The share of an axis of the distance, with all axes the same.
    share: f64,
    /// Where it began, and how far the answered jogs lead.
    start: Vec<f64>,
    sent_mm: f64,
    unanswered_mm: Vec<f64>,
    /// How far the next one leads, mm.
    block_mm: f64,
    /// When it was last asked for, ms.
    held_ms: u64,
}

/// A jog line: distances of axes at a feed in mm/min, from where the machine is then.
pub(super) fn line(by: &[f64], feed: f64) -> String {
    let mut line = "$J=G91G21".to_owned();
    for (by, letter) in by.iter().zip(LETTERS).filter(|(by, _)| **by != 0.0) {
        // Writing to a string never fails.
        let _ = write!(line, "{}{by:.3}", char::from(letter));
    }
    let _ = write!(line, "F{:.0}", feed.max(1.0));
    line
}

impl Jog {
    /// A jog from a position: along axes as fast as was asked for, mm/min, or as their rates allow.
    pub(super) fn new(
        (along, asked_feed): (Vec<i8>, f64),
        rates: &[Option<f64>],
        start: Vec<f64>,
        now_ms: u64,
    ) -> Self {
        let moved = along.iter().filter(|along| **along != 0);
        let share = (moved.count().max(1) as f64).sqrt().recip();
        let used = along.iter().zip(rates).filter(|(along, _)| **along != 0);
        let rates = used.filter_map(|(_, rate)| Some(rate.as_ref()? / share));
        let feed = rates.fold(asked_feed, f64::min);
        Self {
            block_mm: (feed / 60.0 * BLOCK_S).max(SHORTEST_MM),
            along,
            feed,
            share,
            start,
            sent_mm: 0.0,
            unanswered_mm: Vec::new(),
            held_ms: now_ms,
        }
    }

    /// The key is still held.
    pub(super) fn hold(&mut self, now_ms: u64) {
        self.held_ms = now_ms;
    }

    /// Since when nothing has told that the key is held, ms.
    pub(super) fn silence_ms(&self, now_ms: u64) -> u64 {
        now_ms.saturating_sub(self.held_ms)
    }

    /// The next line, if the machine at a position has few enough: accelerations are of each axis, mm/s².
    pub(super) fn next(
        &mut self,
        position: &[f64],
        accelerations: &[Option<f64>],
    ) -> Option<String> {
        let axes = self.along.iter().zip(position).zip(&self.start);
        let moved_mm =
            axes.map(|((along, at), start)| f64::from(*along) * (at - start) * self.share);
        let moved_mm: f64 = moved_mm.sum();
        let used = self.along.iter().zip(accelerations);
        let used = used.filter(|(along, _)| **along != 0);
        let acceleration = used.filter_map(|(_, it)| it.filter(|it| *it > 0.0));
        let acceleration = acceleration.reduce(f64::min).unwrap_or(ACCELERATION);
        let speed = self.feed / 60.0;
        let most_mm = speed * (LOOKAHEAD_S + speed / (2.0 * acceleration));
        let is_far = self.sent_mm - moved_mm + self.block_mm > most_mm.max(self.block_mm);
        if is_far || self.block_mm < LEAST_MM {
            return None;
        }
        let by: Vec<_> = { self.along.iter() }
            .map(|along| f64::from(*along) * self.block_mm * self.share)
            .collect();
        self.sent_mm += self.block_mm;
        self.unanswered_mm.push(self.block_mm);
        Some(line(&by, self.feed))
    }

    /// Takes the answer to the oldest line. One that leads beyond the travel is tried again half as long.
    pub(super) fn answer(&mut self, is_beyond_travel: bool) {
        if self.unanswered_mm.is_empty() {
            return;
        }
        let block_mm = self.unanswered_mm.remove(0);
        if is_beyond_travel {
            self.sent_mm -= block_mm;
            self.block_mm = self.block_mm.min(block_mm / 2.0);
        }
    }
}

#[cfg(test)]
mod tests {
    use super::*;

    #[test]
    fn a_held_key_has_little_motion_wait() {
        let mut jog = Jog::new((vec![0, -1], 3000.0), &[], vec![5.0, 7.0], 0);
        let at = |y: f64| [5.0, y];
        let accelerations = [None, Some(500.0)];
        let mut lines = Vec::new();
        while let Some(line) = jog.next(&at(7.0), &accelerations) {
            lines.push(line);
        }
        // 50 mm/s for 0.1 s, and 2.5 mm in which it can stop.
        assert_eq!(lines, vec!["$J=G91G21Y-2.500F3000"; 3]);
        assert_eq!(jog.next(&at(4.6), &accelerations), None);
        assert!(jog.next(&at(4.4), &accelerations).is_some());
        jog.hold(40);
        assert_eq!(jog.silence_ms(100), 60);
    }

    #[test]
    fn the_last_jogs_before_the_end_of_the_travel_are_shorter() {
        let mut jog = Jog::new((vec![1, 1], 6000.0), &[Some(600.0), None], vec![0.0; 2], 0);
        let mut lines = Vec::new();
        // 0.2 mm are left.
        let mut at = 0.0;
        while let Some(line) = jog.next(&[at; 2], &[]) {
            let (_, by) = line.split_once('X').unwrap();
            let by: f64 = by.split_once('Y').unwrap().0.parse().unwrap();
            let is_beyond = at + by > 0.2;
            at += if is_beyond { 0.0 } else { by };
            jog.answer(is_beyond);
            lines.push(line);
        }
        assert!(at > 0.18 && lines.len() < 12, "{at} {lines:?}");
        // Together they are as fast as the slower one alone.
        assert!(lines[0].ends_with("F849"), "{lines:?}");
    }
}
