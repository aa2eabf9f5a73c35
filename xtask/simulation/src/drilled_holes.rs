//! The holes of a program's canned cycles.

use leadscrew::{
    axis::{Axes, LINEAR},
    gcode::{Cycle, interpreter::Interpreter},
    model::{Command, FeedRate},
    units::Nm,
};

/// Most holes that are kept; more are counted.
const KEPT: usize = 1 << 16;

/// A hole.
#[derive(Debug, Clone, Copy, PartialEq)]
pub struct Hole {
    /// What drills it.
    pub cycle: Cycle,
    /// Where its first feed begins, mm in machine coordinates.
    pub top: [f64; LINEAR],
    /// Its bottom.
    pub bottom: [f64; LINEAR],
}

/// The holes of a program.
#[derive(Debug, Clone, Default, PartialEq)]
pub struct Holes {
    /// In the order in which they are drilled.
    pub holes: Vec<Hole>,
    /// How many each cycle has drilled, in the order of the first of each.
    pub counts: Vec<(Cycle, u64)>,
}

impl Holes {
    /// Returns the axes along which there are holes.
    pub fn depth_axes(&self) -> impl Iterator<Item = usize> {
        let is_deep = |hole: &Hole, axis: usize| hole.top[axis] != hole.bottom[axis];
        (0..LINEAR).filter(move |axis| self.holes.iter().any(|hole| is_deep(hole, *axis)))
    }

    /// Adds the next hole.
    pub fn push(&mut self, hole: Hole) {
        let mut counts = self.counts.iter_mut();
        match counts.find(|(cycle, _)| *cycle == hole.cycle) {
            Some((_, count)) => *count += 1,
            None => self.counts.push((hole.cycle, 1)),
        }
        if self.holes.len() < KEPT {
            self.holes.push(hole);
        }
    }
}

/// Returns the holes of a line in a cycle: the places where its feed moves reach their greatest depth.
pub fn holes_of_line(
    interpreter: &Interpreter,
    cycle: Cycle,
    mut from: Axes<Nm>,
    commands: &[Command],
) -> Vec<Hole> {
    let depth_axis = interpreter.modal().plane.axes().2;
    // Under rotation no machine axis may be the depth.
    let level =
        |machine: &Axes<Nm>| machine[depth_axis] - interpreter.work_offset(machine)[depth_axis];
    let moves = commands.iter().filter_map(|command| match command {
        Command::Line {
            target, feed_rate, ..
        } => {
            let feed_move = (from, target.position, *feed_rate);
            from = target.position;
            Some(feed_move)
        }
        _ => None,
    });
    let feeds = moves.filter(|(_, _, feed_rate)| *feed_rate != FeedRate::Rapid);
    let feeds: Vec<_> = feeds.map(|(from, to, _)| (from, to)).collect();
    let bottom = feeds.iter().map(|(_, to)| level(to)).min();
    let mut top = None;
    let mut holes = Vec::new();
    for (from, to) in &feeds {
        let top_of_hole = *top.get_or_insert(*from);
        if Some(level(to)) == bottom {
            holes.push(Hole {
                cycle,
                top: millimetres(&top_of_hole),
                bottom: millimetres(to),
            });
        }
        // A feed move upwards is the end of a hole, as is its bottom.
        if Some(level(to)) == bottom || level(to) > level(from) {
            top = None;
        }
    }
    holes
}

fn millimetres(position: &Axes<Nm>) -> [f64; LINEAR] {
    std::array::from_fn(|axis| position[axis].0 as f64 * 1e-6)
}

#[cfg(test)]
mod tests {
    use leadscrew::{gcode::MotionMode, settings::Settings};

    use super::*;
    use crate::program_reader::ProgramReader;

    fn found(lines: &[&str]) -> Holes {
        let mut reader = ProgramReader::new(&Settings::default());
        let mut found = Holes::default();
        for line in lines {
            let from = reader.interpreter().position();
            let commands = reader.line(line.as_bytes());
            if let MotionMode::Cycle(cycle) = reader.interpreter().modal().motion {
                let holes = holes_of_line(reader.interpreter(), cycle, from, &commands);
                for hole in holes {
                    found.push(hole);
                }
            }
        }
        found
    }

    fn hole(cycle: Cycle, [x, y]: [f64; 2], top: f64, bottom: f64) -> Hole {
        Hole {
            cycle,
            top: [x, y, top],
            bottom: [x, y, bottom],
        }
    }

    #[test]
    fn every_cycle_makes_one_hole_at_each_place() {
        for (words, cycle) in [
            ("G73 Q1", Cycle::G73),
            ("G74 M4 S9", Cycle::G74),
            ("G81", Cycle::G81),
            ("G82 P0", Cycle::G82),
            ("G83 Q1", Cycle::G83),
            ("G84 M3 S9", Cycle::G84),
            ("G85", Cycle::G85),
            ("G86 P0 M3 S9", Cycle::G86),
            ("G88 P0 M3 S9", Cycle::G88),
            ("G89 P0", Cycle::G89),
        ] {
            let line = format!("{words} X4 Y5 Z-3 R2");
            let found = found(&["G0 Z10 F100", &line, "X6"]);
            let expected = [[4.0, 5.0], [6.0, 5.0]].map(|at| hole(cycle, at, 2.0, -3.0));
            assert_eq!(found.holes, expected, "{line}");
            assert_eq!(found.counts, [(cycle, 2)]);
        }
    }

    #[test]
    fn repeats_are_holes() {
        let found = found(&[
            "G10 L2 P1 R90",
            "G0 Z10 F100",
            "G91 G99 G83 X5 Z-3 R-8 Q1 L2",
            "G80",
        ]);
        let expected = [5.0, 10.0].map(|y| hole(Cycle::G83, [0.0, y], 2.0, -1.0));
        assert_eq!(found.holes, expected);
    }

    #[test]
    fn holes_lie_along_the_axis_of_their_plane() {
        let found = found(&["F100 G18", "G81 X1 Z2 Y-3 R-1"]);
        assert_eq!(found.holes[0].top, [1.0, -1.0, 2.0]);
        assert_eq!(found.holes[0].bottom, [1.0, -3.0, 2.0]);
    }
}
