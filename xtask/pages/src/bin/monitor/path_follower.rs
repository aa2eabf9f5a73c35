//! The path of a job that is known in advance, and where on it the machine is.
//!
//! Pure. A place alone does not tell the time: a path may cross itself, and come by the same places many
//! times. So the next time is sought near the last one, and elsewhere only when the machine is not there.

use serde::Serialize;
use simulation::Waypoint;
use simulation::chart::nearest;

use crate::track::AXES;

/// A machine that is so near to the path is on it, mm: reports have three decimals, and the path that is
/// kept is within a step and 10 µm.
const NEAR_MM: f64 = 0.1;
/// How much farther away a piece may be that is a second nearer in time, mm.
const SECOND_MM: f64 = 0.002;
/// How far back and ahead of the last time it is sought at once, s.
const SEARCH_BACK_S: f64 = 0.3;
const SEARCH_AHEAD_S: f64 = 2.0;
/// How long a machine may be beside the path before it is sought anywhere, s.
const LOST_S: f64 = 1.0;
/// A machine at rest that is so near to the end is there, s.
const END_S: f64 = 0.1;
/// In what time a new rate is learned, s.
const LEARNED_S: f64 = 0.5;

/// What counts of a point of the path.
#[derive(Debug, Clone, Copy, PartialEq)]
struct Point {
    time_s: f64,
    place: [f64; AXES],
    speed: f64,
    line: u64,
}

/// How far a job is.
#[derive(Debug, Clone, Copy, Default, PartialEq, Serialize)]
pub(crate) struct Progress {
    /// The time of the job, s.
    pub(crate) time_s: f64,
    /// What is left of it, s.
    pub(crate) left_s: f64,
    pub(crate) line: u64,
    /// Whether the machine is on the path, and not beside it.
    pub(crate) is_on_path: bool,
}

/// The path, and how far the machine is.
#[derive(Debug, Default)]
pub(crate) struct PathFollower {
    points: Vec<Point>,
    /// The time of the job at which the machine was last, s; none before it is on the path.
    at_s: Option<f64>,
    /// When that was, and when it was last sought everywhere, s since the beginning.
    reported_s: f64,
    searched_s: f64,
    seen: Option<[f64; AXES]>,
    /// How fast the job has been, as a part of what is planned: overrides change it.
    rate: f64,
    is_on_path: bool,
    /// The machine has come to rest at the end: the next motion begins anew.
    is_done: bool,
}

impl PathFollower {
    /// One along the points of a job.
    pub(crate) fn new(points: &[Waypoint]) -> Self {
        let points = points.iter().map(|point| Point {
            time_s: point.time_s,
            place: std::array::from_fn(|axis| point.place[axis]),
            speed: point.speed,
            line: point.line,
        });
        Self {
            points: points.collect(),
            searched_s: f64::NEG_INFINITY,
            rate: 1.0,
            ..Self::default()
        }
    }

    /// Takes a machine position, mm, at a time since the beginning, s, in a state as reports name it.
    pub(crate) fn follow(&mut self, place: [f64; AXES], now_s: f64, state: &str) -> Progress {
        let state = state.split(':').next().unwrap_or_default();
        let (is_at_rest, is_elsewhere) =
            (state == "Idle", matches!(state, "Jog" | "Home" | "Alarm"));
        if self.is_done && !is_at_rest && !is_elsewhere {
            (self.is_done, self.at_s) = (false, None);
        }
        if self.seen == Some(place) && self.at_s.is_some() {
            self.stand(now_s, state);
        } else if !is_elsewhere && !self.is_done {
            self.seek(place, now_s, is_at_rest);
        }
        // The last report may be of a step before the end.
        if is_at_rest && self.at_s.is_some_and(|at| at + END_S >= self.end_s()) {
            (self.is_done, self.at_s) = (true, Some(self.end_s()));
        }
        self.progress()
    }

    /// The time of the job at which the machine was last, s.
    pub(crate) fn at_s(&self) -> Option<f64> {
        self.at_s
    }

    /// The places where the path bends between two times, s, that a machine on it has passed since the first; none where
    /// it has been found elsewhere.
    pub(crate) fn bends(&self, from_s: f64, to_s: f64) -> impl Iterator<Item = [f64; AXES]> {
        let to_s = if to_s > from_s + SEARCH_AHEAD_S {
            from_s
        } else {
            to_s
        };
        let first = self.points.partition_point(|point| point.time_s <= from_s);
        let passed = self.points[first..].iter();
        passed
            .take_while(move |point| point.time_s < to_s)
            .map(|point| point.place)
    }

    /// The machine has not moved: the time goes on only where the job stands still, too.
    fn stand(&mut self, now_s: f64, state: &str) {
        let Some(at) = self.at_s else {
            return;
        };
        if state == "Run" && self.is_on_path {
            let since = (now_s - self.reported_s).max(0.0);
            self.at_s = Some((at + since).min(self.still_until(at)));
        }
        self.reported_s = now_s;
    }

    /// Until when the job stands where it is at a time, s.
    fn still_until(&self, at_s: f64) -> f64 {
        let first = self
            .points
            .partition_point(|point| point.time_s <= at_s + 1e-6);
        let pieces = self.points.windows(2).skip(first.saturating_sub(1));
        let still = pieces.take_while(|piece| piece[0].place == piece[1].place);
        still.last().map_or(at_s, |piece| piece[1].time_s.max(at_s))
    }

    fn seek(&mut self, place: [f64; AXES], now_s: f64, is_at_rest: bool) {
        let since = (now_s - self.reported_s).clamp(0.0, LOST_S);
        let found = match self.at_s {
            Some(at) => {
                let range = at - SEARCH_BACK_S..self.still_until(at) + SEARCH_AHEAD_S;
                self.nearest(place, range, at + self.rate * since)
            }
            None => self.nearest(place, 0.0..SEARCH_AHEAD_S, 0.0),
        };
        if let (Some(at), Some(found)) = (self.at_s, found)
            && since > 0.0
        {
            let rate = ((found - at) / since).clamp(0.0, 2.0);
            self.rate += (rate - self.rate) * since.min(LEARNED_S) / LEARNED_S;
        }
        let is_lost = now_s - self.reported_s.max(self.searched_s) > LOST_S || self.at_s.is_none();
        let found = found.or_else(|| {
            // What stands is not sought: it may have been put anywhere.
            let may_seek = is_lost && !is_at_rest && now_s - self.searched_s > LOST_S;
            let from = self.at_s.unwrap_or(0.0);
            may_seek.then(|| {
                self.searched_s = now_s;
                let ahead = self.nearest(place, from..f64::INFINITY, from);
                ahead.or_else(|| self.nearest(place, 0.0..from, 0.0))
            })?
        });
        self.is_on_path = found.is_some();
        if let Some(time) = found {
            (self.at_s, self.reported_s, self.seen) = (Some(time), now_s, Some(place));
        }
    }

    /// The time in a range at which the path is near a place, and near an expected time.
    fn nearest(
        &self,
        place: [f64; AXES],
        range: std::ops::Range<f64>,
        expected_s: f64,
    ) -> Option<f64> {
        let first = self
            .points
            .partition_point(|point| point.time_s < range.start);
        let pieces = self.points.windows(2).skip(first.saturating_sub(1));
        let mut best: Option<(f64, f64)> = None;
        for piece in pieces.take_while(|piece| piece[0].time_s <= range.end) {
            let (distance, off) = nearest(place, piece[0].place, piece[1].place);
            if off > NEAR_MM {
                continue;
            }
            let (from, to) = (piece[0].time_s, piece[1].time_s);
            let time = if piece[0].place == piece[1].place {
                // It stands, or turns.
                expected_s.clamp(from, to)
            } else {
                from + (to - from) * part_of_time(piece[0].speed, piece[1].speed, distance)
            };
            let score = off + SECOND_MM * (time - expected_s).abs();
            if best.is_none_or(|(least, _)| score < least) {
                best = Some((score, time));
            }
        }
        best.map(|(_, time)| time)
    }

    fn end_s(&self) -> f64 {
        self.points.last().map_or(0.0, |point| point.time_s)
    }

    fn progress(&self) -> Progress {
        let time_s = self.at_s.unwrap_or(0.0);
        let next_index = self.points.partition_point(|point| point.time_s <= time_s);
        let point = self.points.get(next_index.saturating_sub(1));
        Progress {
            time_s,
            left_s: (self.end_s() - time_s).max(0.0),
            line: point.map_or(0, |point| point.line),
            is_on_path: self.is_on_path,
        }
    }
}

/// At which part of its time a part of a piece's way has been made: the speed changes evenly.
fn part_of_time(from: f64, to: f64, distance: f64) -> f64 {
    let sum = from + to;
    if sum <= 0.0 {
        return distance;
    }
    // way · sum = 2 · from · time + (to - from) · time²
    let root = (from * from + (to - from) * sum * distance).max(0.0).sqrt();
    if from + root > 0.0 {
        distance * sum / (from + root)
    } else {
        0.0
    }
}

#[cfg(test)]
mod tests {
    use super::*;

    /// A path through places, at a speed of 10 mm/s, each piece of the next line.
    fn path_follower(places: &[[f64; AXES]]) -> PathFollower {
        let mut time_s = 0.0;
        let mut before = places[0];
        let points = places.iter().zip(1..).map(|(place, line)| {
            time_s += nearest(*place, before, before).1 / 10.0;
            before = *place;
            let mut all = [0.0; leadscrew::axis::AXES];
            all[..AXES].copy_from_slice(place);
            Waypoint {
                time_s,
                place: all,
                speed: 600.0,
                line,
                kind: 2,
            }
        });
        PathFollower::new(&points.collect::<Vec<_>>())
    }

    /// Lets a machine follow a path as fast as is planned, times a factor, and checks the time it is told.
    fn run(path_follower: &mut PathFollower, start_s: f64, factor: f64) {
        let end = path_follower.end_s();
        let points = path_follower.points.clone();
        for tick in 0.. {
            let time = f64::from(tick) * 0.05;
            let now = time / factor;
            if time > end {
                break;
            }
            let next_index = points.partition_point(|point| point.time_s <= time).max(1);
            let (from, to) = (
                points[next_index - 1],
                points[next_index.min(points.len() - 1)],
            );
            let part = (time - from.time_s) / (to.time_s - from.time_s).max(1e-9);
            let place = std::array::from_fn(|axis| {
                from.place[axis] + (to.place[axis] - from.place[axis]) * part
            });
            let followed = path_follower.follow(place, start_s + now, "Run");
            assert!(followed.is_on_path, "{time}");
            assert!(
                (followed.time_s - time).abs() < 0.06,
                "{time}: {followed:?}"
            );
            assert!(
                (followed.left_s - (end - time)).abs() < 0.06,
                "{time}: {followed:?}"
            );
        }
    }

    #[test]
    fn a_path_that_comes_by_the_same_places_is_followed_in_its_order() {
        // Down and up again over the same square, thrice, with a way back through itself.
        let square = [[0.0; 3], [9.0, 0.0, 0.0], [9.0, 9.0, 0.0], [0.0, 9.0, 0.0]];
        let back = [[0.0; 3], [20.0, 0.0, 0.0], [0.0; 3]];
        let all: Vec<_> = square.iter().chain(&back).copied().collect();
        let places = [all.clone(), all.clone(), all].concat();
        for factor in [0.5, 1.0, 2.0] {
            run(&mut path_follower(&places), 5.0, factor);
        }
    }

    #[test]
    fn a_dwell_is_a_part_of_the_time() {
        let mut path_follower =
            path_follower(&[[0.0; 3], [10.0, 0.0, 0.0], [10.0, 0.0, 0.0], [0.0; 3]]);
        for (point, time_s) in path_follower.points.iter_mut().zip([0.0, 1.0, 6.0, 7.0]) {
            point.time_s = time_s;
        }
        path_follower.follow([0.0; 3], 0.0, "Run");
        path_follower.follow([10.0, 0.0, 0.0], 1.0, "Run");
        let followed = path_follower.follow([10.0, 0.0, 0.0], 3.0, "Run");
        assert!((followed.time_s - 3.0).abs() < 1e-6, "{followed:?}");
        assert!((path_follower.follow([10.0, 0.0, 0.0], 4.0, "Hold:0").time_s - 3.0).abs() < 1e-6);
        assert!((path_follower.follow([10.0, 0.0, 0.0], 99.0, "Run").time_s - 6.0).abs() < 1e-6);
        let followed = path_follower.follow([5.0, 0.0, 0.0], 99.5, "Run");
        assert!((followed.time_s - 6.5).abs() < 1e-6, "{followed:?}");
    }

    #[test]
    fn a_hold_of_any_length_stays_where_it_is() {
        let mut path_follower =
            path_follower(&[[0.0; 3], [10.0, 0.0, 0.0], [0.0; 3], [10.0, 0.0, 0.0]]);
        path_follower.follow([0.0; 3], 0.0, "Run");
        path_follower.follow([5.0, 0.0, 0.0], 0.5, "Run");
        for tick in 0..100 {
            let followed = path_follower.follow([5.0, 0.0, 0.0], 1.0 + f64::from(tick), "Hold:0");
            assert!((followed.time_s - 0.5).abs() < 1e-6, "{followed:?}");
        }
        let followed = path_follower.follow([6.0, 0.0, 0.0], 100.1, "Run");
        assert!(
            (followed.time_s - 0.6).abs() < 1e-6 && followed.line == 1,
            "{followed:?}"
        );
    }

    #[test]
    fn a_machine_off_the_path_is_reported_and_found_again() {
        let mut path_follower = path_follower(&[[0.0; 3], [100.0, 0.0, 0.0], [100.0, 50.0, 0.0]]);
        assert!(path_follower.follow([1.0, 0.0, 0.0], 0.1, "Run").is_on_path);
        let off_path = path_follower.follow([1.0, 0.0, 9.0], 0.2, "Run");
        assert!(!off_path.is_on_path && (off_path.time_s - 0.1).abs() < 1e-6);
        // Somebody jogs over the path.
        assert!((path_follower.follow([100.0, 25.0, 0.0], 9.0, "Jog").time_s - 0.1).abs() < 1e-6);
        // It goes on elsewhere.
        let followed = path_follower.follow([100.0, 25.0, 0.0], 10.0, "Run");
        assert!(
            (followed.time_s - 12.5).abs() < 1e-6 && followed.line == 2,
            "{followed:?}"
        );
    }

    #[test]
    fn a_job_that_is_sent_again_begins_again() {
        let mut path_follower = path_follower(&[[0.0; 3], [10.0, 0.0, 0.0]]);
        run(&mut path_follower, 0.0, 1.0);
        let end = path_follower.follow([10.0, 0.0, 0.0], 2.0, "Idle");
        assert_eq!((end.time_s, end.left_s), (1.0, 0.0));
        assert_eq!(path_follower.follow([0.0; 3], 3.0, "Idle").left_s, 0.0);
        run(&mut path_follower, 10.0, 1.0);
    }

    #[test]
    fn what_a_machine_has_passed_is_the_path_itself() {
        let corner = [10.0, 0.0, 0.0];
        let mut path_follower = path_follower(&[[0.0; 3], corner, [10.0, 10.0, 0.0]]);
        path_follower.follow([8.0, 0.0, 0.0], 0.8, "Run");
        let before = path_follower.at_s().unwrap();
        let now = path_follower.follow([10.0, 2.0, 0.0], 1.2, "Run").time_s;
        assert_eq!(
            path_follower.bends(before, now).collect::<Vec<_>>(),
            [corner]
        );
        assert_eq!(path_follower.bends(now, before).count(), 0);
        assert_eq!(path_follower.bends(0.0, 9.0).count(), 0);
    }

    #[test]
    fn a_ramp_is_followed_by_its_own_law() {
        for (from, to) in [(0.0, 600.0), (600.0, 0.0), (300.0, 600.0), (0.0, 0.0)] {
            for tenth in 0..=10 {
                let time = f64::from(tenth) / 10.0;
                let distance = if from + to > 0.0 {
                    (2.0 * from * time + (to - from) * time * time) / (from + to)
                } else {
                    time
                };
                assert!(
                    (part_of_time(from, to, distance) - time).abs() < 1e-6,
                    "{from} {to} {time}"
                );
            }
        }
    }
}
