//! Response times of a task whose loops keep their code in the cache.
//!
//! In a visit of such a loop, its lines and those of the tasks that preempt it most often are missed
//! once at most, so these tasks run from a warm cache. Only those of their runs are dear that fall
//! outside of visits, and there is little time for that. What else preempts the loop, an intruder,
//! may push everything out: the visit begins anew.

use crate::{
    Wcet,
    rta::{self, Arrival},
};

/// What one run of a row costs where loops keep their code.
#[derive(Debug, Clone, Copy, Default, PartialEq, Eq)]
pub(crate) struct Kept {
    /// Cycles in all, the loading of its loops' code included.
    pub(crate) all: u64,
    /// Cycles outside of visits.
    pub(crate) outside: u64,
    /// Visits.
    pub(crate) visits: u64,
}

/// What the visits of a row are like.
#[derive(Debug, Clone, Copy, Default, PartialEq, Eq)]
pub(crate) struct Visit {
    /// Lines that one loads at most.
    pub(crate) lines: u64,
    /// Whether there are exclusive stores in any.
    pub(crate) retries: bool,
}

impl Visit {
    /// What holds for both.
    pub(crate) fn worst(self, other: Self) -> Self {
        Self {
            lines: self.lines.max(other.lines),
            retries: self.retries || other.retries,
        }
    }
}

/// A task that preempts.
#[derive(Debug, Clone, Copy)]
pub(crate) struct Guest {
    pub(crate) arrival: Arrival,
    pub(crate) wcet: Wcet,
    /// A run without a cache, with what it costs those that it preempts.
    pub(crate) dear: u64,
}

/// The window of a row whose loops keep their code.
pub(crate) struct Keeping {
    /// What the row itself has to do: the last stream is the one whose ends count.
    pub(crate) own: Vec<(Arrival, Kept)>,
    /// Rows of the same priority.
    pub(crate) equals: Vec<(Arrival, Kept)>,
    /// Tasks whose lines stay in the cache during visits.
    pub(crate) guests: Vec<Guest>,
    /// Tasks that end a visit. Their costs include what they cost those that they preempt.
    pub(crate) intruders: Vec<Guest>,
    /// What loading the lines of a visit costs at most.
    pub(crate) reload: u64,
    /// What a preemption costs a visit besides.
    pub(crate) restart: u64,
    /// What the window pays once.
    pub(crate) once: u64,
    /// All runs of guests are dear, wherever they fall: then the demand is a sum, of so much for each
    /// run and piece.
    pub(crate) is_linear: bool,
}

impl Keeping {
    /// The response time.
    pub(crate) fn response(&self, limit: u64) -> Option<u64> {
        let (arrival, _) = self.own.last()?;
        rta::worst(arrival, self.once, limit, |window, jobs| {
            self.demand(window, jobs)
        })
    }

    fn demand(&self, window: u64, jobs: u64) -> u64 {
        let runs = self.runs(window, jobs);
        let all: u64 = runs.iter().map(|(count, kept)| count * kept.all).sum();
        let intruding = self.intruding(window);
        let guests = self.guests.iter().map(|guest| {
            let warm = guest.wcet.warm + self.restart;
            guest.arrival.count(window).max(1) * warm
        });
        let dear = self.dear(window, jobs);
        self.once + all + intruding + guests.sum::<u64>() + dear
    }

    /// Runs of the row and its equals.
    fn runs(&self, window: u64, jobs: u64) -> Vec<(u64, Kept)> {
        let equals = self.equals.iter();
        let equals = equals.map(|(arrival, kept)| (arrival.count(window).max(1), *kept));
        let arrivals = self.own.iter().map(|(arrival, _)| *arrival);
        let counts = rta::arrived(arrivals, jobs);
        let own = counts.into_iter().zip(self.own.iter().map(|it| it.1));
        own.chain(equals).collect()
    }

    fn intruding(&self, window: u64) -> u64 {
        let intruders = self.intruders.iter();
        let costs = intruders.map(|it| it.arrival.count(window).max(1) * (it.dear + self.reload));
        costs.sum()
    }

    /// What the guests cost above a warm cache: for their runs outside of visits.
    fn dear(&self, window: u64, jobs: u64) -> u64 {
        let runs = self.runs(window, jobs);
        let outside: u64 = runs.iter().map(|(count, kept)| count * kept.outside).sum();
        let visits: u64 = runs.iter().map(|(count, kept)| count * kept.visits).sum();
        let intruders = self.intruders.iter();
        let intrusions: u64 = intruders.map(|it| it.arrival.count(window).max(1)).sum();
        // Visits and intruders divide the time outside into so many parts.
        let parts = visits + intrusions + 1;
        let base = self.once + outside + self.intruding(window);
        let count = |guest: &Guest, time: u64| {
            let all = guest.arrival.count(window).max(1);
            if self.is_linear {
                return all;
            }
            guest.arrival.count_in_parts(time, parts).min(all)
        };
        let time = rta::fixed_point(base, u64::MAX / 2, |time| {
            let guests = self.guests.iter();
            base + guests
                .map(|guest| count(guest, time) * guest.dear)
                .sum::<u64>()
        });
        let time = time.unwrap_or(window);
        let more = self.guests.iter().map(|guest| {
            let warm = guest.wcet.warm + self.restart;
            count(guest, time) * guest.dear.saturating_sub(warm)
        });
        more.sum()
    }
}

#[cfg(test)]
mod tests {
    use super::*;

    const fn every(period: f64) -> Arrival {
        Arrival {
            period,
            group: 1,
            sustained: None,
        }
    }

    fn keeping(kept: Kept) -> Keeping {
        let wcet = Wcet {
            warm: 100,
            cold: 160,
            uncached: 170,
        };
        Keeping {
            own: vec![(every(1e6), kept)],
            equals: Vec::new(),
            guests: vec![Guest {
                arrival: every(1000.0),
                wcet,
                dear: 160 + 37 + 10,
            }],
            intruders: Vec::new(),
            reload: 300,
            restart: 37,
            once: 0,
            is_linear: false,
        }
    }

    #[test]
    fn guests_are_warm_in_a_visit() {
        let kept = Kept {
            all: 20_000,
            outside: 0,
            visits: 1,
        };
        let keeping = keeping(kept);
        // 137 of 1000 cycles are the guest's: 24 runs; two may begin outside, before and behind.
        let expected = 20_000 + 24 * (100 + 37) + 2 * (60 + 10);
        assert_eq!(keeping.response(1_000_000), Some(expected));
    }

    #[test]
    fn without_visits_every_guest_is_dear() {
        let kept = Kept {
            all: 20_000,
            outside: 20_000,
            visits: 0,
        };
        let keeping = keeping(kept);
        // 207 of 1000 cycles are the guest's.
        assert_eq!(keeping.response(1_000_000), Some(20_000 + 26 * 207));
    }

    #[test]
    fn an_intruder_loads_the_loop_again() {
        let kept = Kept {
            all: 20_000,
            outside: 0,
            visits: 1,
        };
        let mut keeping = keeping(kept);
        let before = keeping.response(1_000_000).unwrap();
        keeping.intruders = vec![Guest {
            arrival: every(1e9),
            wcet: Wcet::default(),
            dear: 500,
        }];
        let after = keeping.response(1_000_000).unwrap();
        assert!(after >= before + 500 + 300);
        assert!(after <= before + 500 + 300 + 2 * 207 + 70);
    }
}
