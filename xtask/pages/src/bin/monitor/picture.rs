//! What the picture shows, in bounded memory: path, speed over time, and where the machine is now.

use std::{
    collections::VecDeque,
    sync::{Condvar, Mutex, MutexGuard, PoisonError},
    time::Duration,
};

use grbl_client::words::state_words;
use serde::Serialize;
use simulation::chart::thinned;

use crate::{
    path_follower::Progress,
    track::{AXES, Report},
    values::NamedValue,
};

/// Points of the path that are kept at most.
const MAX_POINTS: usize = 20_000;
/// Pixels of the larger side of a picture: what is nearer than a part of one cannot be seen.
const PIXELS: f64 = 2000.0;
/// Speeds that are kept at most.
const MAX_SPEEDS: usize = 4000;
/// Positions from which the direction is taken: single steps of two axes alternate.
const HEADING_POINTS: usize = 8;

/// Messages of the machine that are kept.
const MAX_MESSAGES: usize = 20;

/// A point of the path, in its unit.
pub(crate) type Place = [f64; AXES];
/// A point of a curve over time.
pub(crate) type Point = (f64, f64);

/// Least and greatest coordinates.
#[derive(Debug, Clone, Copy, Default, PartialEq, Serialize)]
pub(crate) struct Extents {
    pub(crate) low: [f64; AXES],
    pub(crate) high: [f64; AXES],
}

/// What there is of this moment.
#[derive(Debug, Clone, Default, Serialize)]
pub(crate) struct Now {
    /// The last position of the path.
    pub(crate) at: Option<[f64; AXES]>,
    /// The direction of the motion, radians, counter-clockwise from X.
    pub(crate) heading: Option<f64>,
    pub(crate) extents: Extents,
    /// The machine and the work position, mm; nothing before the first report.
    pub(crate) machine_mm: Option<[f64; AXES]>,
    pub(crate) work_mm: Option<[f64; AXES]>,
    pub(crate) state: String,
    /// The same in words.
    pub(crate) words: &'static str,
    /// What else the last report has.
    pub(crate) values: Vec<NamedValue>,
    /// What the machine has said beside, the newest last.
    pub(crate) messages: VecDeque<String>,
    pub(crate) speed_mm_min: f64,
    /// Time since the beginning, s.
    pub(crate) time_s: f64,
    /// Lines of the program that are answered.
    pub(crate) lines: u64,
    /// How far the job is that is known in advance.
    pub(crate) job: Option<Progress>,
    /// The last alarm: its line, what it means and what to do.
    pub(crate) alarm: Option<String>,
    /// The line that was refused last, with the same.
    pub(crate) refusal: Option<String>,
}

/// How far a job is that is known in advance.
#[derive(Debug)]
pub(crate) struct ExecutedPath {
    pub(crate) progress: Progress,
    /// Where its path bends that the machine has passed since.
    pub(crate) bends: Vec<Place>,
}

/// The picture.
#[derive(Debug, Default)]
pub(crate) struct Picture {
    /// The machine, and the program.
    pub(crate) title: String,
    /// The unit of the path.
    pub(crate) unit: &'static str,
    path: Vec<Place>,
    /// Time in s and speed in mm/min.
    speeds: Vec<Point>,
    now: Now,
    recent: VecDeque<[f64; AXES]>,
    /// How often points have been left out, so that their numbers have changed.
    generation: u64,
    /// Number of changes.
    version: u64,
    /// Nothing more is to come.
    is_over: bool,
    /// Pages that have not been told that.
    pub(crate) pages: usize,
}

/// How much of a picture a page has.
#[derive(Debug, Default)]
pub(crate) struct Shown {
    generation: Option<u64>,
    points: usize,
    speeds: usize,
    version: u64,
}

/// A change of a picture, or all of it.
#[derive(Debug, Serialize)]
pub(crate) struct Change<'a> {
    /// All: what the page has is void.
    is_all: bool,
    title: &'a str,
    unit: &'a str,
    path: &'a [Place],
    speeds: &'a [Point],
    now: &'a Now,
    is_over: bool,
}

impl Picture {
    /// Begins a path in a unit, unless the one there is has the same.
    pub(crate) fn measure_in(&mut self, unit: &'static str) {
        if self.unit != unit {
            self.unit = unit;
            self.recent.clear();
            self.now.at = None;
            if !self.path.is_empty() {
                self.path.clear();
                self.generation += 1;
            }
        }
    }

    /// Adds a position, in the unit of the path.
    pub(crate) fn move_to(&mut self, at: [f64; AXES]) {
        let now = &mut self.now;
        if now.at == Some(at) {
            return;
        }
        let extents = now
            .at
            .map_or(Extents { low: at, high: at }, |_| now.extents);
        now.extents = Extents {
            low: std::array::from_fn(|axis| extents.low[axis].min(at[axis])),
            high: std::array::from_fn(|axis| extents.high[axis].max(at[axis])),
        };
        now.at = Some(at);
        if self.recent.len() == HEADING_POINTS {
            self.recent.pop_front();
        }
        self.recent.push_back(at);
        let from = self.recent.front().copied().unwrap_or(at);
        let (dx, dy) = (at[0] - from[0], at[1] - from[1]);
        if (dx, dy) != (0.0, 0.0) {
            now.heading = Some(dy.atan2(dx));
        }
        self.path.push(at);
        if self.path.len() >= MAX_POINTS {
            self.simplify();
        }
        self.version += 1;
    }

    /// Leaves out what cannot be seen, and more where that is not enough.
    fn simplify(&mut self) {
        let Extents { low, high } = self.now.extents;
        let sizes = (0..AXES).map(|axis| high[axis] - low[axis]);
        let pixel = (sizes.fold(0.0, f64::max) / PIXELS).max(1e-9);
        let mut pixels = 0.25;
        while self.path.len() > MAX_POINTS / 2 {
            self.path = thinned(&self.path, |place| *place, pixels * pixel);
            pixels *= 2.0;
        }
        self.generation += 1;
    }

    /// Adds a status report at a time since the beginning.
    pub(crate) fn report(&mut self, report: &Report, time: Duration) {
        let now = &mut self.now;
        now.time_s = time.as_secs_f64();
        now.machine_mm = Some(report.machine_mm);
        now.work_mm = Some(report.work_mm);
        now.state.clone_from(&report.state);
        now.words = state_words(&report.state);
        now.values.clone_from(&report.values);
        if ["Run", "Jog", "Home"].contains(&report.state.as_str()) {
            now.alarm = None;
        }
        if let Some(speed) = report.speed_mm_min {
            now.speed_mm_min = speed;
            self.speeds.push((now.time_s, speed));
        }
        if self.speeds.len() >= MAX_SPEEDS {
            let greater = |two: &[Point]| two.iter().copied().max_by(|a, b| a.1.total_cmp(&b.1));
            self.speeds = self.speeds.chunks(2).filter_map(greater).collect();
            self.generation += 1;
        }
        self.version += 1;
    }

    /// Takes note of the lines of a program that are answered, and of one that is refused.
    pub(crate) fn count_lines(&mut self, lines: u64, refusal: Option<String>) {
        self.now.lines = lines;
        self.now.refusal = refusal.or(self.now.refusal.take());
        self.version += 1;
    }

    /// Takes note of an alarm. It stays until the machine moves again.
    pub(crate) fn alarm(&mut self, alarm: &str) {
        self.now.alarm = Some(alarm.into());
        // The next report comes too late for a page that this ends.
        self.now.state = "Alarm".into();
        self.now.words = state_words("Alarm");
        self.version += 1;
    }

    /// Adds what the machine has said.
    pub(crate) fn message(&mut self, text: String) {
        if self.now.messages.len() == MAX_MESSAGES {
            self.now.messages.pop_front();
        }
        self.now.messages.push_back(text);
        self.version += 1;
    }

    /// Takes note of how far the job is, and adds what the machine has passed of its path.
    pub(crate) fn follow(&mut self, followed: Option<ExecutedPath>) {
        let Some(ExecutedPath { progress, bends }) = followed else {
            return;
        };
        for at in bends {
            self.move_to(at);
        }
        self.now.job = Some(progress);
        self.version += 1;
    }

    /// Nothing more is to come.
    pub(crate) fn end(&mut self) {
        self.is_over = true;
        self.version += 1;
    }

    pub(crate) fn is_over(&self) -> bool {
        self.is_over
    }

    pub(crate) fn path(&self) -> &[Place] {
        &self.path
    }

    pub(crate) fn speeds(&self) -> &[Point] {
        &self.speeds
    }

    pub(crate) fn now(&self) -> &Now {
        &self.now
    }

    /// Returns whether a page lacks something.
    pub(crate) fn has_change(&self, shown: &Shown) -> bool {
        shown.generation != Some(self.generation) || shown.version != self.version
    }

    /// Returns what a page lacks; nothing where it has everything.
    pub(crate) fn change(&self, shown: &mut Shown) -> Option<Change<'_>> {
        if !self.has_change(shown) {
            return None;
        }
        let is_all = shown.generation != Some(self.generation);
        let (points, speeds) = if is_all {
            (0, 0)
        } else {
            (shown.points, shown.speeds)
        };
        *shown = Shown {
            generation: Some(self.generation),
            points: self.path.len(),
            speeds: self.speeds.len(),
            version: self.version,
        };
        Some(Change {
            is_all,
            title: &self.title,
            unit: self.unit,
            path: &self.path[points..],
            speeds: &self.speeds[speeds..],
            now: &self.now,
            is_over: self.is_over,
        })
    }
}

/// A picture, and who waits for its changes.
#[derive(Debug, Default)]
pub(crate) struct Shared {
    picture: Mutex<Picture>,
    changed: Condvar,
}

impl Shared {
    pub(crate) fn lock(&self) -> MutexGuard<'_, Picture> {
        self.picture.lock().unwrap_or_else(PoisonError::into_inner)
    }

    /// Changes the picture, and tells who waits.
    pub(crate) fn change(&self, change: impl FnOnce(&mut Picture)) {
        change(&mut self.lock());
        self.changed.notify_all();
    }

    /// Waits for a change, at most a while.
    pub(crate) fn wait<'a>(
        &self,
        picture: MutexGuard<'a, Picture>,
        most: Duration,
    ) -> MutexGuard<'a, Picture> {
        let waited = self.changed.wait_timeout(picture, most);
        waited.unwrap_or_else(PoisonError::into_inner).0
    }
}

#[cfg(test)]
mod tests {
    use std::f64::consts::{FRAC_PI_2, TAU};

    use super::*;

    fn report(speed: f64) -> Report {
        Report {
            state: "Run".into(),
            machine_mm: [1.0; AXES],
            rotary: Vec::new(),
            work_mm: [0.0; AXES],
            speed_mm_min: Some(speed),
            values: Vec::new(),
        }
    }

    #[test]
    fn an_hour_keeps_its_look_in_bounded_memory() {
        let mut picture = Picture::default();
        let (mut points, mut speeds, mut generations) = (0, 0, 0);
        let (mut low, mut high) = ([f64::MAX; AXES], [f64::MIN; AXES]);
        // What a page keeps that is there from the beginning.
        let (mut shown, mut kept, mut most_kept) = (Shown::default(), [0; 2], [0; 2]);
        for line in 0..3600 * 60_u32 {
            // A flower of steps, so that no place is visited twice in the same way.
            let angle = f64::from(line) * 0.001;
            let radius = 1000.0 * (angle * 1.01).cos();
            let place = [radius * angle.cos(), radius * angle.sin(), 0.0].map(f64::round);
            picture.move_to(place);
            for axis in 0..AXES {
                low[axis] = place[axis].min(low[axis]);
                high[axis] = place[axis].max(high[axis]);
            }
            if line % 35 == 0 {
                picture.report(
                    &report(f64::from(line % 100)),
                    Duration::from_millis(line.into()),
                );
            }
            (points, speeds) = (
                points.max(picture.path.len()),
                speeds.max(picture.speeds.len()),
            );
            generations = picture.generation;
            // Ten changes a second.
            if line % 35 == 0
                && let Some(change) = picture.change(&mut shown)
            {
                if change.is_all {
                    kept = [0; 2];
                }
                for (kept, new) in kept
                    .iter_mut()
                    .zip([change.path.len(), change.speeds.len()])
                {
                    *kept += new;
                }
                most_kept = [most_kept[0].max(kept[0]), most_kept[1].max(kept[1])];
            }
        }
        assert!(
            most_kept[0] <= MAX_POINTS && most_kept[1] <= MAX_SPEEDS,
            "{most_kept:?}"
        );
        assert!(most_kept[0] > MAX_POINTS / 4, "the page saw nothing");
        assert!(points <= MAX_POINTS && picture.path.capacity() <= 2 * MAX_POINTS);
        assert!(speeds <= MAX_SPEEDS && generations > 3);
        assert_eq!(picture.now.extents, Extents { low, high });
        assert_eq!(picture.path.last().copied(), picture.now.at);
    }

    #[test]
    fn a_simplified_path_is_within_a_pixel_of_the_whole_one() {
        let mut picture = Picture::default();
        let place = |index: u32| {
            let angle = f64::from(index) / f64::from(MAX_POINTS as u32) * TAU;
            [800.0 * angle.cos(), 800.0 * angle.sin(), 0.0]
        };
        for index in 0..MAX_POINTS as u32 {
            picture.move_to(place(index));
        }
        assert!(picture.path.len() < 1000, "{}", picture.path.len());
        for index in (0..MAX_POINTS as u32).step_by(37) {
            let [x, y, _] = place(index);
            let near = picture.path.windows(2).map(|two| {
                let ([ax, ay, _], [bx, by, _]) = (two[0], two[1]);
                let (dx, dy) = (bx - ax, by - ay);
                let share = ((x - ax) * dx + (y - ay) * dy) / (dx * dx + dy * dy);
                let share = share.clamp(0.0, 1.0);
                (x - ax - share * dx).hypot(y - ay - share * dy)
            });
            let nearest = near.fold(f64::MAX, f64::min);
            assert!(nearest <= 1600.0 / PIXELS, "{nearest} at {index}");
        }
    }

    #[test]
    fn a_page_gets_all_at_first_and_then_what_is_new() {
        let mut picture = Picture::default();
        let mut shown = Shown::default();
        picture.move_to([1.0, 0.0, 0.0]);
        let all = picture.change(&mut shown).unwrap();
        assert!(all.is_all && all.path.len() == 1);
        assert!(picture.change(&mut shown).is_none());
        picture.move_to([1.0, 1.0, 0.0]);
        picture.move_to([1.0, 1.0, 5.0]);
        picture.report(&report(60.0), Duration::from_secs(1));
        let more = picture.change(&mut shown).unwrap();
        assert!(!more.is_all);
        assert_eq!(
            (more.path, more.speeds),
            (&[[1.0, 1.0, 0.0], [1.0, 1.0, 5.0]][..], &[(1.0, 60.0)][..])
        );
        assert_eq!(more.now.at, Some([1.0, 1.0, 5.0]));
        assert_eq!(more.now.heading, Some(FRAC_PI_2));
        // Another page, or the same one loaded again, has nothing.
        assert_eq!(picture.change(&mut Shown::default()).unwrap().path.len(), 3);
        picture.simplify();
        assert!(picture.change(&mut shown).unwrap().is_all);
        picture.alarm("ALARM:1, why");
        let now = picture.change(&mut shown).unwrap().now;
        assert_eq!(
            (now.state.as_str(), now.alarm.as_deref()),
            ("Alarm", Some("ALARM:1, why"))
        );
        // It is still there when the machine is unlocked, but not when it moves.
        for (state, is_shown) in [("Alarm", true), ("Idle", true), ("Run", false)] {
            let state = state.into();
            picture.report(
                &Report {
                    state,
                    ..report(0.0)
                },
                Duration::from_secs(2),
            );
            assert_eq!(
                picture.now().alarm.is_some(),
                is_shown,
                "{}",
                picture.now().state
            );
        }
        picture.end();
        assert!(picture.change(&mut shown).unwrap().is_over);
    }

    #[test]
    fn the_newest_messages_are_kept() {
        let mut picture = Picture::default();
        for number in 0..=MAX_MESSAGES {
            picture.message(number.to_string());
        }
        let messages = &picture.now().messages;
        assert_eq!((messages.len(), messages[0].as_str()), (MAX_MESSAGES, "1"));
    }
}
