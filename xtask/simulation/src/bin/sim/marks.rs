//! What a picture shows of a program beside its path: holes, and contours with the tool beside them.

use std::collections::VecDeque;

use leadscrew::{
    axis::Axes,
    gcode::MotionMode,
    model::{Command, Cutter, FeedRate},
    units::Nm,
};
use simulation::{
    drilled_holes::{Hole, Holes, holes_of_line},
    program_reader::ProgramReader,
};

use crate::contour::{Contour, Stretch};

/// What is marked.
#[derive(Debug, Clone, Default, PartialEq)]
pub(crate) struct Marks {
    pub(crate) holes: Holes,
    pub(crate) contour: Contour,
}

/// Finds what is to be marked of a program, in lines that the machine has not refused.
pub(crate) struct MarkFinder {
    reader: ProgramReader,
    /// Where the last command has ended.
    position: Axes<Nm>,
    /// The tool of the last move that was compensated.
    cutter: Cutter,
    /// Of each line that is not answered.
    pending: VecDeque<(Vec<Hole>, Contour)>,
    found: Marks,
}

impl MarkFinder {
    pub(crate) fn new(reader: ProgramReader) -> Self {
        Self {
            position: reader.interpreter().position(),
            reader,
            cutter: Cutter::default(),
            pending: VecDeque::new(),
            found: Marks::default(),
        }
    }

    /// A line is sent.
    pub(crate) fn line(&mut self, line: &[u8]) {
        let was_compensated = self.reader.interpreter().is_off_path();
        let from = self.position;
        let commands = self.reader.line(line);
        let holes = match self.reader.interpreter().modal().motion {
            MotionMode::Cycle(cycle) => {
                holes_of_line(self.reader.interpreter(), cycle, from, &commands)
            }
            _ => Vec::new(),
        };
        let mut contour = Contour::default();
        if let Some(one) = self.reader.programmed() {
            self.cutter = one.cutter;
            let programmed = Stretch::of(&one.cutter, &one.from, &one.to, one.circle.as_ref());
            contour.programmed.extend(programmed);
        }
        for command in &commands {
            let removed = self.go(command);
            contour.removed.extend(removed.filter(|_| was_compensated));
        }
        self.pending.push_back((holes, contour));
    }

    /// Goes on to the end of a command; returns its way, if it is a feed move.
    fn go(&mut self, command: &Command) -> Option<Stretch> {
        let (to, feed_rate, circle) = match command {
            Command::Line {
                target, feed_rate, ..
            } => (target.position, feed_rate, None),
            Command::Arc {
                target,
                feed_rate,
                circle,
                ..
            } => (target.position, feed_rate, Some(circle)),
            _ => return None,
        };
        let from = std::mem::replace(&mut self.position, to);
        let is_feed = *feed_rate != FeedRate::Rapid;
        let stretch = Stretch::of(&self.cutter, &from, &to, circle);
        stretch.filter(|_| is_feed)
    }

    /// The oldest line that has no answer gets it.
    pub(crate) fn answer(&mut self, is_refused: bool) {
        let (holes, contour) = self.pending.pop_front().unwrap_or_default();
        if is_refused {
            return;
        }
        for hole in holes {
            self.found.holes.push(hole);
        }
        self.found.contour.append(contour);
    }

    pub(crate) fn finish(self) -> Marks {
        self.found
    }
}

#[cfg(test)]
pub(crate) fn found(lines: &[(&str, bool)]) -> Marks {
    let settings = leadscrew::settings::Settings::default();
    let mut finder = MarkFinder::new(ProgramReader::new(&settings));
    for (line, is_refused) in lines {
        finder.line(line.as_bytes());
        finder.answer(*is_refused);
    }
    finder.finish()
}

#[cfg(test)]
mod tests {
    use super::*;

    #[test]
    fn the_holes_of_a_refused_line_are_none() {
        let lines = [
            ("F100", false),
            ("G81 X1 Z-3 R2", false),
            ("X5", true),
            ("X6", false),
        ];
        let holes = found(&lines).holes.holes;
        let places: Vec<_> = holes.iter().map(|hole| hole.bottom[0]).collect();
        assert_eq!(places, [1.0, 6.0]);
    }

    #[test]
    fn the_contour_and_its_offset_path_are_found() {
        let lines = [
            "F100",
            "G41.1 D4",
            "G1 X10",
            "Y10",
            "G2 X10 Y10 I-5",
            "G40",
            "G1 X0",
            "X5",
        ];
        let contour = found(&lines.map(|line| (line, false))).contour;
        let [programmed] = &contour.programmed[..] else {
            panic!("{contour:?}")
        };
        assert_eq!(
            programmed.points[..3],
            [[0.0, 0.0, 0.0], [10.0, 0.0, 0.0], [10.0, 10.0, 0.0]]
        );
        // A full circle of 5 mm, and the tool outside of it.
        let (least, greatest) = contour.extent(1).unwrap();
        assert!((least + 2.0).abs() < 0.01 && (greatest - 19.0).abs() < 0.01);
        let [removed] = &contour.removed[..] else {
            panic!("{contour:?}")
        };
        assert_eq!(removed.diameter, 4.0);
        // From the entry to the exit, but no farther.
        assert_eq!(removed.points.first(), Some(&[0.0, 0.0, 0.0]));
        assert_eq!(removed.points.last(), Some(&[0.0, 10.0, 0.0]));
    }
}
