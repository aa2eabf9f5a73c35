//! Response times of tasks with fixed priorities.
//!
//! Tasks preempt those of lower priority and run one after another at the same; lower priorities
//! hold a task up for one critical section at most (stack resource policy: T. Baker 1991). Response
//! times by M. Joseph and P. Pandya 1986, over all jobs of the busy window (J. Lehoczky 1990).

/// What a quotient in floating point may be above the true one: far less than a cycle's worth.
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
}

impl Arrival {
    /// Most releases in a window of so many cycles.
    pub(crate) fn count(&self, window: u64) -> u64 {
        let window = window as f64;
        let spaced = self.group as f64 * (window / self.period - ROUNDING).ceil();
        let count = match self.sustained {
            Some((rate, burst)) => spaced.min((rate * window + burst - ROUNDING).ceil()),
            None => spaced,
        };
        count as u64
    }

    /// Most releases in so many stretches of a window that take so many cycles together.
    pub(crate) fn count_in_parts(&self, cycles: u64, parts: u64) -> u64 {
        let (cycles, parts) = (cycles as f64, parts as f64);
        let spaced = self.group as f64 * ((cycles / self.period).floor() + parts);
        let count = match self.sustained {
            Some((rate, burst)) => spaced.min((rate * cycles + burst * parts).ceil()),
            None => spaced,
        };
        count as u64
    }

    /// How long after its first release the job with this number is released at the earliest.
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
    /// What one run costs, with what it costs the task that it preempts.
    pub(crate) cost: u64,
}

/// Longest time from a release of a task to its end, or `None` when there is none below `limit`.
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

/// How many jobs of each stream of a task have arrived when the last stream has had so many.
pub(crate) fn arrived(streams: impl Iterator<Item = Arrival>, jobs: u64) -> Vec<u64> {
    let streams: Vec<Arrival> = streams.collect();
    let time = streams
        .last()
        .map_or(0.0, |last| last.release(jobs.saturating_sub(1)));
    let count = |(index, arrival): (usize, &Arrival)| {
        if index + 1 == streams.len() {
            jobs
        } else {
            arrival.count(time as u64 + 1).max(1)
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
        let release = arrival.release(job);
        let latest = limit.saturating_add(release.ceil() as u64);
        window = fixed_point(window, latest, |window| demand(window, job + 1))?;
        let response = window as f64 - release;
        worst = worst.max(response.max(0.0).ceil() as u64);
        if worst > limit {
            return None;
        }
        if window as f64 <= arrival.release(job + 1) {
            return Some(worst);
        }
    }
    None
}

/// The smallest window that is as long as what happens in it.
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
        };
        assert_eq!(arrival.count(250), 1);
        assert_eq!(arrival.count(251), 2);
        // 2 * (100 kHz * 1 ms + 3 axes)
        assert_eq!(arrival.count(168_000), 206);
    }

    #[test]
    fn parts_of_a_window_may_each_begin_with_a_release() {
        let arrival = Arrival {
            period: 100.0,
            group: 1,
            sustained: None,
        };
        assert_eq!(arrival.count_in_parts(0, 3), 3);
        assert_eq!(arrival.count_in_parts(250, 3), 5);
        let sustained = Arrival {
            sustained: Some((0.001, 1.0)),
            ..arrival
        };
        assert_eq!(sustained.count_in_parts(250, 3), 4);
    }

    #[test]
    fn the_streams_of_a_task_count_up_to_the_last_ones_job() {
        let every = |period: f64| Arrival {
            period,
            group: 1,
            sustained: None,
        };
        // Runs each 100 cycles, pieces each 30: with the fifth piece, at 120, two runs are there.
        let counts = |jobs| arrived([every(100.0), every(30.0)].into_iter(), jobs);
        assert_eq!(counts(1), [1, 1]);
        assert_eq!(counts(4), [1, 4]);
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

    /// What a processor does that runs the highest priority first, in steps of one cycle, until it
    /// is idle: the longest response of each task whose jobs are released so far apart.
    fn simulate(tasks: &[(u64, u64)], offsets: &[u64], horizon: u64) -> Vec<u64> {
        let mut jobs: Vec<Vec<(u64, u64)>> = vec![Vec::new(); tasks.len()];
        let mut worst = vec![0; tasks.len()];
        for now in 0..horizon {
            for (index, (period, cost)) in tasks.iter().enumerate() {
                if now >= offsets[index] && (now - offsets[index]).is_multiple_of(*period) {
                    jobs[index].push((now, *cost));
                }
            }
            let Some(index) = jobs.iter().position(|jobs| !jobs.is_empty()) else {
                continue;
            };
            jobs[index][0].1 -= 1;
            if jobs[index][0].1 == 0 {
                let (released, _) = jobs[index].remove(0);
                worst[index] = worst[index].max(now + 1 - released);
            }
        }
        worst
    }

    proptest! {
        #[test]
        fn no_simulated_response_is_longer_than_the_computed_one(
            tasks in proptest::collection::vec((4_u64..40, 1_u64..8, 0_u64..40), 1..5),
        ) {
            let sizes: Vec<_> = tasks.iter().map(|(period, cost, _)| (*period, *cost)).collect();
            let offsets: Vec<_> = tasks.iter().map(|(.., offset)| *offset).collect();
            let loads: Vec<_> = sizes.iter().map(|(period, cost)| load(*period as f64, *cost)).collect();
            let synchronous = simulate(&sizes, &vec![0; sizes.len()], 4000);
            let shifted = simulate(&sizes, &offsets, 4000);
            for index in 0..loads.len() {
                let used: f64 = loads[..=index].iter().map(|load| load.cost as f64 * load.arrival.rate()).sum();
                let Some(bound) = response(&loads[index..=index], &loads[..index], 0, 100_000) else {
                    prop_assert!(used > 0.99);
                    continue;
                };
                prop_assert!(shifted[index] <= bound && synchronous[index] <= bound);
                // At the critical instant the bound is reached, if the window is over by then.
                prop_assert!(used > 0.9 || synchronous[index] == bound);
            }
        }
    }
}
