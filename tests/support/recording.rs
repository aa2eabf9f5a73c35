//! What the machine steps and sends while a program is streamed to it.

use leadscrew::{
    axis::Axes,
    sim::{Edge, PlayedSegment, Simulator, StepStatistics, Stream, StreamEnd, Watcher},
};

use super::add_steps;

/// Everything that an observer of a stream is shown.
#[derive(Default)]
pub(crate) struct Recording {
    pub(crate) edges: Vec<Edge>,
    /// Time and position after each edge that begins steps.
    pub(crate) positions: Vec<(u64, Axes<i32>)>,
    /// Each segment, with the number of positions before it.
    pub(crate) segments: Vec<(usize, PlayedSegment)>,
    pub(crate) answers: Vec<String>,
    /// Each message, with the numbers of positions and of answers before it.
    pub(crate) messages: Vec<(String, usize, u64)>,
    steps: Axes<i32>,
}

impl Watcher for Recording {
    fn edge(&mut self, edge: &Edge) {
        self.edges.push(*edge);
        if edge.raise != 0 {
            add_steps(&mut self.steps, edge);
            self.positions.push((edge.ticks, self.steps));
        }
    }

    fn segment(&mut self, segment: &PlayedSegment) {
        self.segments.push((self.positions.len(), *segment));
    }

    fn answer(&mut self, _line: u64, answer: &[u8]) {
        self.answers.push(String::from_utf8_lossy(answer).into());
    }

    fn message(&mut self, _: &Simulator, answers: u64, message: &[u8]) {
        let message = String::from_utf8_lossy(message).into();
        self.messages.push((message, self.positions.len(), answers));
    }
}

/// Streams a program to the end.
pub(crate) fn stream(simulator: Simulator, program: &str, baud: u32) -> Recording {
    let mut simulator = Box::new(simulator);
    let mut recording = Recording::default();
    let end = Stream::new(&mut *simulator, program.bytes(), baud).run(&mut recording);
    assert_eq!(end, StreamEnd::Complete, "{program}");
    assert_eq!(simulator.late(), 0);
    recording
}

/// What the steps of some edges amount to.
pub(crate) fn statistics(edges: &[Edge]) -> StepStatistics {
    let mut statistics = StepStatistics::new();
    for edge in edges {
        statistics.add(edge);
    }
    statistics
}
