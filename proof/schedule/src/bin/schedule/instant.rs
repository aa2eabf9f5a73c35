//! The critical instant, played: every task released at once, as often again as it ever can be.
//!
//! A simulation of fixed-priority scheduling with preemption, on the tasks of a report. It begins
//! after the longest time for which less urgent code may hold tasks up. The result is one possible
//! schedule; the response times of the report bound all schedules, so no task may end later here
//! than its response time.

use schedule::{Report, Task};

/// Releases that are played at most for each task: some milliseconds of the densest.
const MOST_RELEASES: u64 = 20_000;

/// A task, as the simulation needs it. Times are cycles.
#[derive(Debug, Clone)]
pub(super) struct Player {
    /// Its index in the report.
    pub(super) task: usize,
    /// A higher number is more urgent.
    pub(super) priority: u8,
    /// Execution time.
    pub(super) cost: f64,
    /// Shortest time between releases of a burst.
    spacing: f64,
    /// Shortest time between releases in the long run.
    period: f64,
    /// Releases that may come before their period.
    burst: f64,
}

impl Player {
    /// The task at `index`, when it has a deadline and a bound.
    ///
    /// Its execution time is the WCET with a warm cache: the cost of misses depends on the other
    /// tasks, and is only in the response times.
    fn of(task: &Task, index: usize) -> Option<Self> {
        let period = task.period_cycles?;
        task.deadline_cycles?;
        let wcet = task.wcet?;
        Some(Self {
            task: index,
            priority: task.priority,
            cost: wcet.warm as f64,
            spacing: task.spacing_cycles.unwrap_or(period),
            period,
            burst: task.burst,
        })
    }

    /// When release number `number`, from 0, comes at the earliest.
    pub(super) fn release(&self, number: u64) -> f64 {
        let number = number as f64;
        (number * self.spacing).max((number - self.burst) * self.period)
    }
}

/// Less urgent code that holds tasks up when the instant comes.
#[derive(Debug, Clone, PartialEq)]
pub(super) struct Blocker {
    /// Where it begins.
    pub(super) place: String,
    /// Tasks up to this priority wait for it.
    pub(super) ceiling: u8,
    /// Its length.
    pub(super) length: f64,
}

/// The running task of a slice of time.
#[derive(Debug, Clone, Copy, PartialEq, Eq)]
pub(super) enum Runner {
    /// The less urgent code.
    Blocker,
    /// The player with this index.
    Player(usize),
}

/// A stretch of time in which one thing runs.
#[derive(Debug, Clone, Copy, PartialEq)]
pub(super) struct Slice {
    pub(super) runner: Runner,
    pub(super) start: f64,
    pub(super) end: f64,
}

/// One release of a player, and its end.
#[derive(Debug, Clone, Copy, PartialEq)]
pub(super) struct Job {
    pub(super) player: usize,
    pub(super) release: f64,
    /// `None`: after the end of the simulation.
    pub(super) finish: Option<f64>,
}

/// The schedule.
#[derive(Debug, Clone, Default)]
pub(super) struct Instant {
    pub(super) players: Vec<Player>,
    pub(super) blocker: Option<Blocker>,
    pub(super) slices: Vec<Slice>,
    pub(super) jobs: Vec<Job>,
}

impl Instant {
    /// Plays the critical instant of the most urgent task until each task has answered once.
    pub(super) fn of_the_most_urgent(report: &Report) -> Self {
        let priorities = players(report).into_iter().map(|player| player.priority);
        Self::of(report, priorities.max().unwrap_or(0))
    }

    /// The same for the least urgent task.
    pub(super) fn of_the_least_urgent(report: &Report) -> Self {
        let priorities = players(report).into_iter().map(|player| player.priority);
        Self::of(report, priorities.min().unwrap_or(0))
    }

    /// Begins with the section that holds up tasks of this priority longest.
    fn of(report: &Report, priority: u8) -> Self {
        let players = players(report);
        let blocker = blocker(report, &players, priority);
        let responses = report.tasks.iter().filter_map(|task| task.response_cycles);
        let end = responses.max().unwrap_or(0) as f64;
        play(players, blocker, end)
    }

    /// When the first release of a player is done.
    pub(super) fn first_finish(&self, player: usize) -> Option<f64> {
        let mut jobs = self.jobs.iter();
        jobs.find(|job| job.player == player)?.finish
    }

    /// The first task that ends later than its response time: the report is wrong.
    pub(super) fn contradiction(&self, report: &Report) -> Option<String> {
        self.players.iter().enumerate().find_map(|(index, player)| {
            let task = &report.tasks[player.task];
            let response = task.response_cycles?;
            let finish = self.first_finish(index);
            let is_within = finish.is_some_and(|finish| finish <= response as f64 + 0.5);
            (!is_within).then(|| {
                let ends = finish.map_or("not in that time".into(), |at| format!("at {at:.0}"));
                format!(
                    "the response time of `{}` is given as {response} cycles, but at the critical \
                     instant it ends {ends}",
                    task.name
                )
            })
        })
    }
}

/// Every task that is analysed; the modes of a task, `task: mode`, are tasks of one priority. Rows
/// that exclude the others are left out, since they have a critical instant of their own; of the
/// regimes of a task only the one with the highest load is played.
fn players(report: &Report) -> Vec<Player> {
    let load = |regime: &str| -> f64 {
        let tasks = report.tasks.iter();
        let tasks = tasks.filter(|task| task.regime.as_deref() == Some(regime));
        tasks.map(|task| task.share).sum()
    };
    let regimes = report.tasks.iter().filter_map(|it| it.regime.as_deref());
    let busiest = regimes.max_by(|one, other| load(one).total_cmp(&load(other)));
    let tasks = report.tasks.iter().enumerate();
    let tasks = tasks.filter(|(_, task)| task.exclusive_with.is_empty());
    let tasks = tasks.filter(|(_, it)| it.regime.is_none() || it.regime.as_deref() == busiest);
    let players = tasks.filter_map(|(index, task)| Player::of(task, index));
    players.collect()
}

/// The longest section of code below all players that holds up those of a priority.
fn blocker(report: &Report, players: &[Player], priority: u8) -> Option<Blocker> {
    let least = players.iter().map(|player| player.priority).min()?;
    let sections = report.sections.iter().filter(|section| {
        let reaches = section.ceiling.is_none_or(|ceiling| ceiling >= priority);
        section.exempt.is_none() && section.priority < least && reaches
    });
    let section = sections.max_by_key(|section| (section.cycles, section.ceiling.is_none()))?;
    let ceiling = section.ceiling.unwrap_or(u8::MAX);
    // A task's own figure has the time in it that the processor takes to notice.
    let held = players.iter().filter(|player| player.priority <= ceiling);
    let length = held.map(|player| report.tasks[player.task].blocking_cycles);
    Some(Blocker {
        place: section.place.clone(),
        ceiling,
        length: length.min()? as f64,
    })
}

/// Work that is waiting or being done.
struct Ready {
    job: usize,
    priority: u8,
    left: f64,
}

/// Plays everything that begins before `end`.
pub(super) fn play(players: Vec<Player>, blocker: Option<Blocker>, end: f64) -> Instant {
    let mut instant = Instant {
        jobs: releases(&players, end),
        players,
        blocker,
        slices: Vec::new(),
    };
    let mut next = 0;
    let mut ready: Vec<Ready> = Vec::new();
    let mut held = instant.blocker.as_ref().map_or(0.0, |held| held.length);
    let ceiling = instant.blocker.as_ref().map_or(0, |held| held.ceiling);
    let mut now = 0.0;
    while now < end {
        while let Some(job) = instant.jobs.get(next).filter(|job| job.release <= now) {
            let player = &instant.players[job.player];
            ready.push(Ready {
                job: next,
                priority: player.priority,
                left: player.cost,
            });
            next += 1;
        }
        let until = instant.jobs.get(next).map_or(end, |job| job.release);
        // The most urgent; among equals the one that was released first.
        let first =
            (0..ready.len()).min_by_key(|&at| (u8::MAX - ready[at].priority, ready[at].job));
        let is_held = held > 0.0 && first.is_none_or(|at| ready[at].priority <= ceiling);
        now = if is_held {
            let stop = until.min(now + held);
            held -= stop - now;
            record(&mut instant.slices, Runner::Blocker, now, stop);
            stop
        } else if let Some(at) = first {
            let stop = until.min(now + ready[at].left);
            ready[at].left -= stop - now;
            let job = &mut instant.jobs[ready[at].job];
            record(&mut instant.slices, Runner::Player(job.player), now, stop);
            if ready[at].left <= 1e-6 {
                job.finish = Some(stop);
                ready.swap_remove(at);
            }
            stop
        } else {
            until
        };
    }
    instant
}

/// All releases before `end`, in their order.
fn releases(players: &[Player], end: f64) -> Vec<Job> {
    let mut jobs: Vec<_> = Vec::new();
    for (index, player) in players.iter().enumerate() {
        let times = (0..MOST_RELEASES).map(|number| player.release(number));
        jobs.extend(times.take_while(|time| *time < end).map(|release| Job {
            player: index,
            release,
            finish: None,
        }));
    }
    jobs.sort_by(|a, b| {
        (a.release, a.player)
            .partial_cmp(&(b.release, b.player))
            .expect("finite")
    });
    jobs
}

/// Adds a slice, to the last one where the same goes on.
fn record(slices: &mut Vec<Slice>, runner: Runner, start: f64, end: f64) {
    match slices.last_mut() {
        Some(last) if last.runner == runner && last.end == start => last.end = end,
        _ => slices.push(Slice { runner, start, end }),
    }
}

#[cfg(test)]
mod tests;
