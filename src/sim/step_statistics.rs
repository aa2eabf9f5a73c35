//! Statistics of the steps of a run, from its pin edges.

use super::Edge;
use crate::axis::{AXES, Axes};

/// Counts and hashes the steps of a run.
#[derive(Debug, Clone, PartialEq, Eq)]
pub struct StepStatistics {
    /// Pulses of each axis, in either direction.
    pub pulses: Axes<u64>,
    /// Net steps of each axis.
    pub steps: Axes<i64>,
    /// Events that begin a pulse.
    pub events: u64,
    /// Time of the first such event, ticks.
    pub first_ticks: Option<u64>,
    /// Time of the last such event, ticks.
    pub last_ticks: u64,
    /// FNV-1a, 64 bits, over each such event: ticks since the one before, step mask, direction mask.
    pub hash: u64,
}

impl StepStatistics {
    /// Returns statistics of no steps.
    #[must_use]
    pub const fn new() -> Self {
        Self {
            pulses: Axes([0; AXES]),
            steps: Axes([0; AXES]),
            events: 0,
            first_ticks: None,
            last_ticks: 0,
            hash: 0xcbf2_9ce4_8422_2325,
        }
    }

    /// Adds an edge.
    pub fn add(&mut self, edge: &Edge) {
        if edge.raise == 0 {
            return;
        }
        for axis in 0..AXES {
            if edge.raise >> axis & 1 != 0 {
                self.pulses[axis] += 1;
                let forward = edge.directions >> axis & 1 == 0;
                self.steps[axis] += if forward { 1 } else { -1 };
            }
        }
        self.events += 1;
        let since = match self.first_ticks {
            None => {
                self.first_ticks = Some(edge.ticks);
                0
            }
            Some(_) => edge.ticks - self.last_ticks,
        };
        self.last_ticks = edge.ticks;
        for word in [since, u64::from(edge.raise), u64::from(edge.directions)] {
            self.hash = (self.hash ^ word).wrapping_mul(0x0000_0100_0000_01b3);
        }
    }

    /// Returns the time from the first to the last step, ticks.
    #[must_use]
    pub fn motion_ticks(&self) -> u64 {
        self.first_ticks
            .map_or(0, |first_ticks| self.last_ticks - first_ticks)
    }
}

impl Default for StepStatistics {
    fn default() -> Self {
        Self::new()
    }
}
