//! Response times of tasks with fixed priorities.
//!
//! Tasks preempt tasks of lower priority, and run one after another at the same priority; lower
//! priorities hold a task up for one critical section at most (stack resource policy: T. Baker
//! 1991). Response times by M. Joseph and P. Pandya 1986, over all jobs of the busy window (J.
//! Lehoczky 1990).

/// The error of a quotient in floating point: far less than a cycle's worth.
const ROUNDING: f64 = 1e-9;
/// Jobs of one task in a busy window: with more, the processor is all but overloaded.
const MOST_JOBS: u64 = 10_000;

/// How often a task is released.
#[derive(Debug, Clone, Copy, PartialEq)]
pub(crate) struct Arrival {
    /// Shortest time between two groups of releases, cycles, and how many one has.
    pub(crate) period: f64,
    pub(crate) group: u64,
    /// Releases a cycle in the long run, and how many more there may be in any window.
    pub(crate) sustained: Option<(f64, f64)>,
    /// How long after it is due a release may come, cycles (N. Audsley et al. 1993).
    pub(crate) jitter: f64,
}

impl Arrival {
    /// Most releases in a window of so many cycles.
    pub(crate) fn count(&self, window: u64) -> u64 {
        self.due(window as f64 + self.jitter)
    }

    /// Most releases that are due in a time.
    fn due(&self, window: f64) -> u64 {
        let spaced = self.group as f64 * (window / self.period - ROUNDING).ceil();
        let count = match self.sustained {
            Some((rate, burst)) => spaced.min((rate * window + burst - ROUNDING).ceil()),
            None => spaced,
        };
        count as u64
    }

    /// How long after the first one the job with this number is due at the earliest.
    fn release(&self, job: u64) -> f64 {
        let spaced = (job / self.group.max(1)) as f64 * self.period;
        match self.sustained {
            Some((rate, burst)) => spaced.max((job as f64 - burst) / rate),
            None => spaced,
        }
    }

    /// Releases a cycle in the long run.
    pub(crate) fn rate(&self) -> f64 {
        let spaced = self.group as f64 / self.period;
        self.sustained.map_or(spaced, |(rate, _)| spaced.min(rate))
    }
}

/// A task that takes part in a busy window.
#[derive(Debug, Clone, Copy, PartialEq)]
pub(crate) struct Load {
    /// When it is released.
    pub(crate) arrival: Arrival,
    /// The cost of one run, with the delay of the task that the run preempts.
    pub(crate) cost: u64,
}

/// The demand of a busy window: all on which its response time depends.
#[derive(Debug, Clone, Default, PartialEq)]
pub(crate) struct Demand {
    /// The streams of jobs of the task itself; the ends of the last one's count.
    pub(crate) own: Vec<Load>,
    /// The streams of tasks of higher and of the same priority.
    pub(crate) others: Vec<Load>,
    /// The cycles that a window pays once, blocking first of all.
    pub(crate) once: u64,
}

impl Demand {
    /// The response time, if it is below a limit.
    pub(crate) fn response(&self, limit: u64) -> Option<u64> {
        response(&self.own, &self.others, self.once, limit)
    }

    /// The length of the busy window, if below a limit: with all releases in that time.
    pub(crate) fn busy(&self, limit: u64) -> Option<u64> {
        let loads = || self.own.iter().chain(&self.others);
        fixed_point(self.once, limit, |window| {
            let released = loads().map(|load| load.arrival.count(window).max(1) * load.cost);
            self.once + released.sum::<u64>()
        })
    }
}

/// Longest time from when a release of a task is due to its end, or `None` when there is none below `limit`.
///
/// `own`: the streams of jobs of the task; the ends of the last one's count. `others`: those of
/// higher and of the same priority. `once`: what the whole window pays once, blocking first of all.
pub(crate) fn response(own: &[Load], others: &[Load], once: u64, limit: u64) -> Option<u64> {
    worst(&own.last()?.arrival, once, limit, |window, jobs| {
        let counts = arrived(own.iter().map(|load| load.arrival), jobs);
        let own = counts
            .iter()
            .zip(own)
            .map(|(count, load)| count * load.cost);
        let others = others
            .iter()
            .map(|other| other.arrival.count(window).max(1) * other.cost);
        once + own.chain(others).sum::<u64>()
    })
}

/// How many jobs of each stream of a task have arrived when the last stream has had so many, and before
/// it has the next one.
pub(crate) fn arrived(streams: impl Iterator<Item = Arrival>, jobs: u64) -> Vec<u64> {
    let streams: Vec<Arrival> = streams.collect();
    let time = streams.last().map_or(0.0, |last| last.release(jobs));
    let count = |(index, arrival): (usize, &Arrival)| {
        if index + 1 == streams.len() {
            jobs
        } else {
            arrival.due(time).max(1)
        }
    };
    streams.iter().enumerate().map(count).collect()
}

/// The same for any demand: what is to be done in a window of so many cycles that begins with a
/// release, with so many jobs of the task itself. More of either must not demand less.
pub(crate) fn worst(
    arrival: &Arrival,
    start: u64,
    limit: u64,
    demand: impl Fn(u64, u64) -> u64,
) -> Option<u64> {
    let mut worst = 0;
    let mut window = start;
    for job in 0..MOST_JOBS {
        // The first is released as late as it may be, and the others are when they are due.
        let due = arrival.release(job) - arrival.jitter;
        let latest = (limit as f64 + due).max(0.0).ceil() as u64;
        window = fixed_point(window, latest, |window| demand(window, job + 1))?;
        let response = window as f64 - due;
        worst = worst.max(response.max(0.0).ceil() as u64);
        if worst > limit {
            return None;
        }
        if window as f64 <= arrival.release(job + 1) - arrival.jitter {
            return Some(worst);
        }
    }
    None
}

/// The smallest window as long as its own demand.
pub(crate) fn fixed_point(start: u64, limit: u64, demand: impl Fn(u64) -> u64) -> Option<u64> {
    let mut window = start;
    loop {
        let next = demand(window);
        if next <= window {
            return Some(window);
        }
        if next > limit {
            return None;
        }
        window = next;
    }
}

#[cfg(test)]
mod tests {
    use super::*;
    use proptest::prelude::*;

    fn load(period: f64, cost: u64) -> Load {
        Load {
            arrival: Arrival {
                period,
                group: 1,
                sustained: None,
                jitter: 0.0,
            },
            cost,
        }
    }

    #[test]
    fn the_textbook_example_has_its_known_response_times() {
        // Burns and Wellings, Real-Time Systems: (7, 3), (12, 3), (20, 5).
        let tasks = [load(7.0, 3), load(12.0, 3), load(20.0, 5)];
        let responses = [3, 6, 20];
        for (index, expected) in responses.into_iter().enumerate() {
            let found = response(&tasks[index..=index], &tasks[..index], 0, 1000);
            assert_eq!(found, Some(expected));
        }
    }

    #[test]
    fn later_jobs_of_a_window_count() {
        // Lehoczky 1990: the worst job of the second task is not the first: 114, 102, 116, 104, 118.
        let found = response(&[load(100.0, 62)], &[load(70.0, 26)], 0, 1000);
        assert_eq!(found, Some(118));
    }

    #[test]
    fn an_overload_has_no_response_time() {
        assert_eq!(response(&[load(10.0, 6)], &[load(10.0, 5)], 0, 1000), None);
        assert_eq!(
            response(&[load(1000.0, 10)], &[load(5.0, 5)], 0, 1000),
            None
        );
    }

    #[test]
    fn all_that_preempts_comes_on_top() {
        let demand = Demand {
            own: vec![load(1e6, 20_000)],
            others: vec![load(1e6, 20_000), load(1000.0, 137), load(1e9, 500)],
            once: 100,
        };
        // 137 of each 1000 cycles are one task's: 48 runs in 47 176.
        let expected = 100 + 40_000 + 500 + 48 * 137;
        assert_eq!(demand.response(1_000_000), Some(expected));
    }

    #[test]
    fn the_processor_is_busy_until_nothing_is_left_that_was_released() {
        let demand = Demand {
            own: vec![load(100.0, 62)],
            others: vec![load(70.0, 26)],
            once: 0,
        };
        // Lehoczky's tasks: the last of the jobs whose responses are above ends at 694.
        assert_eq!(demand.busy(1000), Some(694));
        assert_eq!(demand.busy(693), None);
        let held = Demand { once: 20, ..demand };
        assert!(held.busy(10_000) > Some(694 + 20));
    }

    #[test]
    fn blocking_counts_once() {
        let found = response(&[load(100.0, 10)], &[load(50.0, 5)], 39, 100);
        assert_eq!(found, Some(39 + 10 + 10));
    }

    #[test]
    fn a_sustained_rate_limits_what_spacing_alone_would_allow() {
        let arrival = Arrival {
            period: 250.0,
            group: 1,
            sustained: Some((2.0 * 100e3 / 168e6, 6.0)),
            jitter: 0.0,
        };
        assert_eq!(arrival.count(250), 1);
        assert_eq!(arrival.count(251), 2);
        // 2 * (100 kHz * 1 ms + 3 axes)
        assert_eq!(arrival.count(168_000), 206);
    }

    #[test]
    fn the_streams_of_a_task_count_up_to_the_last_ones_job() {
        let every = |period: f64| Arrival {
            period,
            group: 1,
            sustained: None,
            jitter: 0.0,
        };
        // Runs each 100 cycles, units each 30: before the fifth unit, at 120, two runs are there.
        let counts = |jobs| arrived([every(100.0), every(30.0)].into_iter(), jobs);
        assert_eq!(counts(1), [1, 1]);
        assert_eq!(counts(3), [1, 3]);
        assert_eq!(counts(4), [2, 4]);
        assert_eq!(counts(5), [2, 5]);
        let loads = [
            Load {
                arrival: every(100.0),
                cost: 20,
            },
            Load {
                arrival: every(30.0),
                cost: 10,
            },
        ];
        // 30 at first, then 40, 50 and 60 at 30, 60 and 90; 90 at 120.
        assert_eq!(response(&loads, &[], 0, 1000), Some(30));
    }

    /// A task of the simulation, in cycles.
    #[derive(Debug, Clone, Copy)]
    struct Simulated {
        period: u64,
        cost: u64,
        jitter: u64,
        /// When the first job is due.
        offset: u64,
    }

    /// A processor with fixed priorities and preemption, simulated in steps of one cycle until it
    /// is idle: returns the longest time of each task from the due time of a job to its end. The
    /// first job of each is released as late as it may be, the others when they are due, but not
    /// before the first.
    fn simulate(tasks: &[Simulated], horizon: u64) -> Vec<u64> {
        let mut jobs: Vec<Vec<(u64, u64)>> = vec![Vec::new(); tasks.len()];
        let mut worst = vec![0; tasks.len()];
        for now in 0..horizon {
            for (jobs, task) in jobs.iter_mut().zip(tasks) {
                let first = task.offset + task.jitter;
                if now < first {
                    continue;
                }
                let is_due = (now - task.offset).is_multiple_of(task.period);
                if now == first {
                    let due = (task.offset..=now).step_by(task.period as usize);
                    jobs.extend(due.map(|due| (due, task.cost)));
                } else if is_due {
                    jobs.push((now, task.cost));
                }
            }
            let Some(index) = jobs.iter().position(|jobs| !jobs.is_empty()) else {
                continue;
            };
            jobs[index][0].1 -= 1;
            if jobs[index][0].1 == 0 {
                let (due, _) = jobs[index].remove(0);
                worst[index] = worst[index].max(now + 1 - due);
            }
        }
        worst
    }

    proptest! {
        #![proptest_config(crate::cases(64))]

        #[test]
        fn no_simulated_response_is_longer_than_the_computed_one(
            tasks in proptest::collection::vec(
                (4_u64..40, 1_u64..8, prop_oneof![Just(0), 0_u64..60], 0_u64..40),
                1..5,
            ),
        ) {
            let tasks = tasks.into_iter().map(|(period, cost, jitter, offset)| {
                Simulated { period, cost, jitter, offset }
            });
            let tasks: Vec<Simulated> = tasks.collect();
            let loads: Vec<_> = tasks.iter()
                .map(|it| {
                    let mut load = load(it.period as f64, it.cost);
                    load.arrival.jitter = it.jitter as f64;
                    load
                })
                .collect();
            // All first jobs at the same time.
            let critical: Vec<_> = tasks.iter()
                .map(|it| Simulated { offset: 60 - it.jitter, ..*it })
                .collect();
            let (critical, shifted) = (simulate(&critical, 4000), simulate(&tasks, 4000));
            for index in 0..loads.len() {
                let used: f64 = loads[..=index].iter().map(|load| load.cost as f64 * load.arrival.rate()).sum();
                let Some(bound) = response(&loads[index..=index], &loads[..index], 0, 100_000) else {
                    prop_assert!(used > 0.99);
                    continue;
                };
                prop_assert!(shifted[index] <= bound && critical[index] <= bound);
                // At the critical instant the bound is reached, if the window is over by then.
                prop_assert!(used > 0.9 || critical[index] == bound);
            }
        }
    }
}
