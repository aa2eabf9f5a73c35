//! As few vertices as the path needs.
//!
//! Between two vertices the speed changes evenly with time on a straight way, so that a whole ramp of a
//! line is one piece. A vertex stays where the line, the kind or the programmed speed changes, and where
//! the way, the speed or the power would be off without it.

use leadscrew::axis::AXES;

use crate::vertex::Vertex;

/// How far the way may be off beyond a step, mm or degrees.
const NEAR: f64 = 0.004;
/// How far the speed may be off: a part of it, and mm/min.
const SPEED: (f64, f64) = (0.02, 20.0);
/// How far the power may be off, in parts of the full power.
const POWER: f64 = 20.0;
/// Vertices that are looked at together, at least and at most.
const WINDOW: (usize, usize) = (8, 4096);

/// Merges vertices as they come.
pub(crate) struct Merger {
    /// Steps per mm or degree.
    scales: [f64; AXES],
    /// The last vertex that stays.
    anchor: Option<Vertex>,
    /// Those since then.
    window: Vec<Vertex>,
    /// With how many of them it is looked whether they fit.
    due: usize,
}

impl Merger {
    pub(crate) fn new(scales: [f64; AXES]) -> Self {
        Self {
            scales,
            anchor: None,
            window: Vec::new(),
            due: WINDOW.0,
        }
    }

    /// Takes the next vertex; `keep` gets those that stay.
    pub(crate) fn push(&mut self, vertex: Vertex, keep: &mut impl FnMut(&Vertex)) {
        let Some(anchor) = &self.anchor else {
            keep(&vertex);
            self.anchor = Some(vertex);
            return;
        };
        let is_boundary = vertex.span != anchor.span;
        self.window.push(vertex);
        if is_boundary {
            self.flush(keep);
        } else if self.window.len() >= self.due {
            let fit = self.longest();
            if fit == self.window.len() && fit < WINDOW.1 {
                self.due = 2 * fit;
            } else {
                self.keep_first(fit, keep);
            }
        }
    }

    /// Keeps what is needed of the window, and its last vertex.
    pub(crate) fn flush(&mut self, keep: &mut impl FnMut(&Vertex)) {
        while !self.window.is_empty() {
            let fit = self.longest();
            self.keep_first(fit, keep);
        }
    }

    /// Ends the piece at the vertex of a number, from 1.
    fn keep_first(&mut self, number: usize, keep: &mut impl FnMut(&Vertex)) {
        let last = self.window[number - 1];
        keep(&last);
        self.anchor = Some(last);
        self.window.drain(..number);
        self.due = WINDOW.0.max(self.window.len() + 1);
    }

    /// Returns how many vertices one piece replaces, by bisection.
    fn longest(&self) -> usize {
        let (mut fits, mut fails) = (1, self.window.len() + 1);
        if self.fits(self.window.len()) {
            return self.window.len();
        }
        while fails - fits > 1 {
            let middle = usize::midpoint(fits, fails);
            if self.fits(middle) {
                fits = middle;
            } else {
                fails = middle;
            }
        }
        fits
    }

    /// Whether a piece that ends at the vertex of a number, from 1, is near all before it.
    fn fits(&self, number: usize) -> bool {
        let Some(from) = &self.anchor else {
            return true;
        };
        let (passed, to) = (&self.window[..number - 1], &self.window[number - 1]);
        let piece = Piece { from, to };
        passed.iter().all(|vertex| {
            let time = piece.time_of(vertex.us);
            let speed = piece.speed_at(time);
            let speed_off = (f64::from(vertex.speed) - speed).abs();
            let power = piece.power_at(time);
            let power_off = vertex.power.map(|one| (f64::from(one) - power).abs());
            let share = piece.share_at(time);
            let is_near = (0..AXES).all(|axis| {
                let off = f64::from(vertex.steps[axis]) - piece.steps_at(share, axis);
                off.abs() <= NEAR * self.scales[axis] + 1.0
            });
            is_near
                && speed_off <= SPEED.1.max(SPEED.0 * speed)
                && power_off.iter().all(|off| *off <= POWER)
        })
    }
}

/// What the page makes of two vertices.
pub(crate) struct Piece<'a> {
    pub(crate) from: &'a Vertex,
    pub(crate) to: &'a Vertex,
}

impl Piece<'_> {
    /// Which part of its time a time is.
    pub(crate) fn time_of(&self, us: u64) -> f64 {
        let whole = (self.to.us - self.from.us).max(1);
        us.saturating_sub(self.from.us) as f64 / whole as f64
    }

    fn speed_at(&self, time: f64) -> f64 {
        let [from, to] = [self.from.speed, self.to.speed].map(f64::from);
        from + (to - from) * time
    }

    fn power_at(&self, time: f64) -> f64 {
        let [from, to] = [self.from.power[1], self.to.power[0]].map(f64::from);
        from + (to - from) * time
    }

    /// Which part of the way has been made at a part of the time.
    pub(crate) fn share_at(&self, time: f64) -> f64 {
        let [from, to] = [self.from.speed, self.to.speed].map(f64::from);
        if from + to > 0.0 {
            (2.0 * from * time + (to - from) * time * time) / (from + to)
        } else {
            time
        }
    }

    pub(crate) fn steps_at(&self, share: f64, axis: usize) -> f64 {
        let [from, to] = [self.from.steps[axis], self.to.steps[axis]].map(f64::from);
        from + (to - from) * share
    }
}

#[cfg(test)]
mod tests {
    use super::*;

    fn merged(vertices: &[Vertex]) -> Vec<Vertex> {
        let mut merger = Merger::new([100.0; AXES]);
        let mut kept = Vec::new();
        let mut keep = |vertex: &Vertex| kept.push(*vertex);
        for vertex in vertices {
            merger.push(*vertex, &mut keep);
        }
        merger.flush(&mut keep);
        kept
    }

    /// A point on a ramp of 1 mm/s each ms, at 100 steps/mm.
    fn ramp(ms: u32) -> Vertex {
        let steps = 0.05 * f64::from(ms * ms);
        let mut vertex = Vertex {
            us: u64::from(ms) * 1000,
            speed: 60 * ms,
            ..Vertex::default()
        };
        vertex.steps[0] = steps.round() as i32;
        vertex
    }

    #[test]
    fn a_ramp_is_one_piece_however_long_it_is() {
        for ms in [1, 2, 7, 8, 9, 100, 5000] {
            let vertices: Vec<_> = (0..=ms).map(ramp).collect();
            let pieces = merged(&vertices).len() - 1;
            assert_eq!(pieces, vertices.len().div_ceil(WINDOW.1), "{ms}");
        }
    }

    #[test]
    fn what_would_be_seen_stays() {
        let with = |change: fn(&mut Vertex)| {
            let mut vertices: Vec<_> = (0..=100).map(ramp).collect();
            change(&mut vertices[50]);
            merged(&vertices).len()
        };
        assert_eq!(with(|_| {}), 2);
        assert!(with(|vertex| vertex.steps[0] += 3) > 2);
        assert!(with(|vertex| vertex.speed += 200) > 2);
        assert!(with(|vertex| vertex.power = [0, 30]) > 2);
        assert!(with(|vertex| vertex.span.line = 1) > 2);
    }
}
