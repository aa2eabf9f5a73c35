//! The schedule at the critical instant: a row for each task, time to scale.

use std::fmt::Write as _;

use schedule::{Report, Task};

use super::svg::{At, Picture, Scale, number, round_up};
use crate::{
    instant::{Instant, Runner},
    text::{micros, shown_us},
};

const WIDTH: f64 = 1000.0;
const ROW: f64 = 46.0;
/// Where the bars are, within a row.
const BAR: (f64, f64) = (14.0, 20.0);
/// Room for the names, and for the figures.
const SIDES: (f64, f64) = (128.0, 150.0);
/// Where words before and after the rows are.
const BEFORE: f64 = SIDES.0 - 12.0;
const AFTER: f64 = WIDTH - SIDES.1 + 12.0;
const TOP: f64 = 10.0;
/// Narrower waits are not worth a line of their own.
const LEAST_WAIT: f64 = 1.0;

/// The first microseconds: until all tasks but the least urgent have answered.
pub(super) fn beginning(report: &Report, instant: &Instant) -> String {
    let least = instant.players.iter().map(|player| player.priority).min();
    let others = report
        .tasks
        .iter()
        .filter(|task| Some(task.priority) != least);
    let last = others
        .filter_map(|task| task.response_cycles)
        .max()
        .unwrap_or(0);
    let end = whole_ticks(micros(report, last as f64));
    draw(
        report,
        instant,
        end,
        "The first microseconds of the critical instant",
    )
}

/// Until the least urgent task has answered.
pub(super) fn whole(report: &Report, instant: &Instant) -> String {
    let last = report
        .tasks
        .iter()
        .filter_map(|task| task.response_cycles)
        .max();
    let end = whole_ticks(micros(report, last.unwrap_or(0) as f64));
    let label = "The critical instant until every task has answered";
    draw(report, instant, end, label)
}

/// A little more than some microseconds: ticks of a round length.
fn whole_ticks(us: f64) -> f64 {
    let tick = round_up(us * 1.02 / 10.0);
    ((us * 1.02 / tick).ceil() * tick).max(10.0)
}

/// A picture of a stretch of time.
struct Stretch<'a> {
    report: &'a Report,
    instant: &'a Instant,
    /// Microseconds to pixels.
    scale: Scale,
    picture: Picture,
}

fn draw(report: &Report, instant: &Instant, end_us: f64, label: &str) -> String {
    let rows = instant.players.len() + usize::from(instant.blocker.is_some());
    let bottom = TOP + rows as f64 * ROW;
    let mut stretch = Stretch {
        report,
        instant,
        scale: Scale {
            values: (0.0, end_us),
            pixels: (SIDES.0, WIDTH - SIDES.1),
        },
        picture: Picture::default(),
    };
    stretch.grid(bottom);
    for player in 0..instant.players.len() {
        stretch.row(player);
    }
    stretch.blocker_row(rows);
    stretch.picture.finish(WIDTH, bottom + 42.0, label)
}

impl Stretch<'_> {
    /// Where a number of cycles lies; what is outside lies at the edge.
    fn at(&self, cycles: f64) -> f64 {
        let us = micros(self.report, cycles).min(self.scale.values.1);
        self.scale.at(us)
    }

    fn shows(&self, cycles: f64) -> bool {
        micros(self.report, cycles) <= self.scale.values.1
    }

    fn grid(&mut self, bottom: f64) {
        for tick in self.scale.ticks(10.0) {
            let x = self.scale.at(tick);
            self.picture.line("grid", (x, TOP), (x, bottom));
            self.picture
                .text("tick middle", x, bottom + 17.0, &number(tick));
        }
        let (left, right) = self.scale.pixels;
        let middle = f64::midpoint(left, right);
        self.picture.text(
            "axis middle",
            middle,
            bottom + 35.0,
            "µs after all tasks are released",
        );
    }

    fn task(&self, player: usize) -> &Task {
        &self.report.tasks[self.instant.players[player].task]
    }

    fn row(&mut self, player: usize) {
        let y = TOP + player as f64 * ROW;
        let task = self.task(player).clone();
        let colour = colour(self.instant.players[player].task);
        self.floor(y);
        let (name, mode) = match task.name.split_once(": ") {
            Some((name, mode)) => (name, format!("{mode}, ")),
            None => (task.name.as_str(), String::new()),
        };
        let priority = format!("{mode}priority {}", task.priority);
        self.words(BEFORE, y, ("name end", name), ("note end", &priority));
        self.waits(player, y, &colour);
        self.bars(Runner::Player(player), y, &colour);
        self.releases(player, y);
        self.marks(&task, y);
        self.answers(&task, y);
    }

    fn floor(&mut self, y: f64) {
        let floor = y + BAR.0 + BAR.1;
        let (left, right) = self.scale.pixels;
        self.picture.line("floor", (left, floor), (right, floor));
    }

    /// Two lines of words beside a row, each with its class.
    fn words(&mut self, x: f64, y: f64, first: (&str, &str), second: (&str, &str)) {
        self.picture.text(first.0, x, y + 25.0, first.1);
        self.picture.text(second.0, x, y + 39.0, second.1);
    }

    /// From a release to its end: the task wants to run.
    fn waits(&mut self, player: usize, y: f64, colour: &str) {
        let class = format!("wait {colour}");
        let instant = self.instant;
        for job in instant.jobs.iter().filter(|job| job.player == player) {
            let (from, to) = (
                self.at(job.release),
                self.at(job.finish.unwrap_or(f64::INFINITY)),
            );
            if to - from > LEAST_WAIT {
                let top = y + BAR.0 + 7.0;
                self.picture
                    .rectangle(&class, from, top, to - from, BAR.1 - 7.0);
            }
        }
    }

    /// The running task.
    fn bars(&mut self, runner: Runner, y: f64, class: &str) {
        let slices = self
            .instant
            .slices
            .iter()
            .filter(|slice| slice.runner == runner);
        let mut path = String::new();
        for slice in slices.filter(|slice| self.shows(slice.start)) {
            let (from, to) = (self.at(slice.start), self.at(slice.end));
            let (x, width) = (At(from), At((to - from).max(0.6)));
            let top = At(y + BAR.0);
            let _ = write!(path, "M{x} {top}h{width}v{}h-{width}z", BAR.1);
        }
        if !path.is_empty() {
            self.picture.path(&format!("run {class}"), &path);
        }
    }

    /// An arrow down for each release, where they are not too dense to be seen.
    fn releases(&mut self, player: usize, y: f64) {
        let jobs = self.instant.jobs.iter().filter(|job| job.player == player);
        let shown: Vec<_> = jobs.filter(|job| self.shows(job.release)).collect();
        let room = self.scale.pixels.1 - self.scale.pixels.0;
        if shown.len() as f64 * 9.0 > room {
            return;
        }
        let mut path = String::new();
        for job in shown {
            let (x, top) = (At(self.at(job.release)), At(y + 2.0));
            let _ = write!(path, "M{x} {top}v9m-3 -4l3 4l3 -4");
        }
        self.picture.path("release", &path);
    }

    /// The response time and the deadline of the first release.
    fn marks(&mut self, task: &Task, y: f64) {
        let floor = y + BAR.0 + BAR.1;
        let deadline = task.deadline_cycles.filter(|at| self.shows(*at));
        if let Some(x) = deadline.map(|at| self.at(at)) {
            let foot = format!("M{} {}l-4.5 8h9z", At(x), At(floor));
            self.picture
                .line("deadline", (x, y + BAR.0 - 3.0), (x, floor));
            self.picture.path("flag", &foot);
        }
        let response = task.response_cycles.map(|at| at as f64);
        if let Some(x) = response.filter(|at| self.shows(*at)).map(|at| self.at(at)) {
            self.picture
                .line("response", (x, y + BAR.0 - 5.0), (x, floor + 4.0));
        }
    }

    /// The figures beside the row.
    fn answers(&mut self, task: &Task, y: f64) {
        let us = |cycles: f64| shown_us(micros(self.report, cycles));
        let response = task
            .response_cycles
            .map_or("unbounded".into(), |at| format!("{} µs", us(at as f64)));
        let deadline = task.deadline_cycles.map_or("none".into(), us);
        let class = if task.slack_us.is_some_and(|slack| slack >= 0.0) {
            "answer"
        } else {
            "answer bad"
        };
        let deadline = format!("deadline {deadline} µs");
        self.words(AFTER, y, (class, &response), ("note", &deadline));
    }

    fn blocker_row(&mut self, rows: usize) {
        let Some(blocker) = &self.instant.blocker else {
            return;
        };
        let y = TOP + (rows - 1) as f64 * ROW;
        let length = shown_us(micros(self.report, blocker.length));
        let names = ("name end", "blocking");
        self.words(BEFORE, y, names, ("note end", "less urgent"));
        let answer = format!("{length} µs");
        self.words(AFTER, y, ("answer", &answer), ("note", "longest hold-up"));
        self.floor(y);
        self.bars(Runner::Blocker, y, "blocker");
    }
}

/// The class of a task's colour.
pub(super) fn colour(task: usize) -> String {
    format!("t{}", task % 8)
}
