//! Traces of the step pins, and the rules that hold for every trace.

use std::ops::Range;

use leadscrew::{
    axis::{AXES, Axes},
    model::timing::{DIRECTION_SETUP_TICKS, EVENT_SPACING_TICKS, PULSE_LOW_TICKS},
    settings::Settings,
    sim::Edge,
    units::{TICKS_PER_SECOND, TICKS_PER_US},
};

use super::Pulses;

pub(crate) const TICKS_PER_S: f64 = TICKS_PER_SECOND as f64;

/// One step of one axis.
#[derive(Debug, Clone, Copy)]
pub(crate) struct Step {
    pub(crate) ticks: u64,
    pub(crate) seconds: f64,
    /// Position after it.
    pub(crate) position: i32,
    /// 1 or -1.
    pub(crate) sign: i32,
    /// `N` word of its block.
    pub(crate) line: u32,
    /// Resets before it, after each of which motion begins from whole steps.
    pub(crate) resets: usize,
}

impl Step {
    /// Whether nothing but the planner's speed lies between two steps: they are of one block, without a reset
    /// between them.
    pub(crate) fn is_of_block(&self, other: &Self) -> bool {
        (self.line, self.resets) == (other.line, other.resets)
    }
}

/// Every edge, and the `N` word of the block it belongs to.
pub(crate) struct Trace {
    pub(crate) edges: Vec<Edge>,
    pub(crate) lines: Vec<u32>,
    /// Time at which the step timer was started.
    pub(crate) starts: Vec<u64>,
    /// Edges before each reset's end.
    pub(crate) resets: Vec<usize>,
    pulse_ticks: u64,
    net: Axes<i32>,
}

impl Trace {
    pub(crate) fn new(settings: &Settings) -> Self {
        Self {
            edges: Vec::new(),
            lines: Vec::new(),
            starts: Vec::new(),
            resets: Vec::new(),
            pulse_ticks: u64::from(settings.step_pulse_us) * u64::from(TICKS_PER_US),
            net: Axes::all(0),
        }
    }

    /// The edges of a machine that does not tell their blocks.
    pub(crate) fn of(settings: &Settings, edges: &[Edge]) -> Self {
        let mut trace = Self::new(settings);
        for edge in edges {
            trace.push(*edge, 0);
        }
        trace
    }

    pub(crate) fn push(&mut self, edge: Edge, line: u32) {
        add_steps(&mut self.net, &edge);
        self.edges.push(edge);
        self.lines.push(line);
    }

    /// Steps forwards minus steps backwards of each axis.
    pub(crate) fn net_steps(&self) -> Axes<i32> {
        self.net
    }

    /// The steps of an axis.
    pub(crate) fn steps(&self, axis: usize) -> Vec<Step> {
        let mut position = 0;
        let mut steps = Vec::new();
        for (index, (edge, line)) in self.edges.iter().zip(&self.lines).enumerate() {
            if edge.raise & 1 << axis != 0 {
                let sign = sign(edge, axis);
                position += sign;
                steps.push(Step {
                    ticks: edge.ticks,
                    seconds: edge.ticks as f64 / TICKS_PER_S,
                    position,
                    sign,
                    line: *line,
                    resets: self.resets.partition_point(|edges| *edges <= index),
                });
            }
        }
        steps
    }

    /// When the axis is late because it, or another axis, had to wait to step back. It waits for the pulse before and
    /// the change of direction, and is late while steps follow at the least distance of pulses.
    pub(crate) fn waits(&self, axis: usize) -> Vec<Range<u64>> {
        const SLOTS: u64 = 4 * EVENT_SPACING_TICKS as u64;
        let closest = self.pulse_ticks + u64::from(PULSE_LOW_TICKS) + SLOTS;
        let turned = self.pulse_ticks + u64::from(DIRECTION_SETUP_TICKS) + SLOTS;
        let is_step = |edge: &&Edge| edge.raise & 1 << axis != 0;
        let mut waits: Vec<Range<u64>> = Vec::new();
        let mut before: Option<&Edge> = None;
        // The last change of any direction.
        let (mut changed, mut directions) = (None, 0);
        for step in &self.edges {
            if step.directions != directions {
                (changed, directions) = (Some(step.ticks), step.directions);
            }
            if !is_step(&step) {
                continue;
            }
            let (from, to) = (before.map_or(0, |edge| edge.ticks), step.ticks);
            let turns = before.is_some_and(|edge| sign(edge, axis) != sign(step, axis));
            let stands_by = changed.is_some_and(|at| at >= from && to - at <= turned);
            before = Some(step);
            match waits.last_mut() {
                _ if turns && to - from <= turned || stands_by => waits.push(from..to),
                Some(wait) if wait.end == from && to - from <= closest => wait.end = to,
                _ => {}
            }
        }
        waits
    }

    /// From the first step to the last, s.
    pub(crate) fn motion_seconds(&self) -> f64 {
        let mut raises = self.edges.iter().filter(|edge| edge.raise != 0);
        let first = raises.next().map_or(0, |edge| edge.ticks);
        let last = raises.next_back().map_or(first, |edge| edge.ticks);
        (last - first) as f64 / TICKS_PER_S
    }

    /// From the start of the step timer to the end of the last segment, s.
    pub(crate) fn whole_seconds(&self) -> f64 {
        let first = self.starts.first().copied().unwrap_or(0);
        let last = self.edges.last().map_or(first, |edge| edge.ticks);
        (last - first) as f64 / TICKS_PER_S
    }

    /// FNV-1a over times, steps and directions.
    pub(crate) fn hash(&self) -> u64 {
        let mut hash = 0xcbf2_9ce4_8422_2325_u64;
        let mut add = |value: u64| {
            for byte in value.to_le_bytes() {
                hash = (hash ^ u64::from(byte)).wrapping_mul(0x0100_0000_01b3);
            }
        };
        for edge in &self.edges {
            add(edge.ticks);
            add(u64::from(edge.raise) << 16 | u64::from(edge.drop) << 8);
            add(u64::from(edge.directions));
        }
        hash
    }

    /// Pulse widths, low times, direction set-up times, spacing of events.
    pub(crate) fn check_pulses(&self) {
        let mut pulses = Pulses::new(self.pulse_ticks);
        for edge in &self.edges {
            pulses.check(edge);
        }
        pulses.check_end();
    }
}

/// Adds the steps that begin with an edge.
pub(crate) fn add_steps(steps: &mut Axes<i32>, edge: &Edge) {
    for axis in (0..AXES).filter(|axis| edge.raise & 1 << axis != 0) {
        steps[axis] += sign(edge, axis);
    }
}

fn sign(edge: &Edge, axis: usize) -> i32 {
    if edge.directions & 1 << axis == 0 {
        1
    } else {
        -1
    }
}
