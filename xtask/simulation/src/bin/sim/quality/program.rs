//! The path of a program, from its lines.

use leadscrew::{
    axis::{AXES, Axes},
    model::{Circle, Command, FeedRate, Target, core_xy},
    units::{Nm, Steps, StepsPerMm},
};
use simulation::{
    junction::{allowed_mm_s, turn_rad},
    program_reader::ProgramReader,
};

use super::{
    MotorScales,
    geometry::{Corner, Piece, Point, millimetres, minus, norm},
};

/// The path of a program.
pub(crate) struct Programmed {
    reader: ProgramReader,
    /// End of the last piece.
    sent: Axes<Nm>,
    steps: Axes<Steps>,
    tangent: Option<Point>,
    curvature: Point,
    length_mm: f64,
    /// The acceleration along each axis, or along the direction in which a motor of `CoreXY` moves the tool, mm/s².
    accelerations: Point,
    is_stop: bool,
}

impl Programmed {
    /// A path that begins at the origin.
    pub(crate) fn new(reader: ProgramReader) -> Self {
        Self {
            accelerations: MotorScales::of(reader.settings()).accelerations,
            reader,
            sent: Axes::all(Nm(0)),
            steps: Axes::all(Steps(0)),
            tangent: None,
            curvature: [0.0; AXES],
            length_mm: 0.0,
            is_stop: false,
        }
    }

    /// Whether the path is unknown from here on: after homing, probing, or check mode.
    pub(crate) fn is_lost(&self) -> bool {
        self.reader.is_lost()
    }

    /// The path of the next line; a refused line has no path.
    pub(crate) fn line(&mut self, line: &[u8]) -> Vec<Piece> {
        let commands = self.reader.line(line);
        let pieces = commands.iter().filter_map(|command| self.piece(command));
        pieces.collect()
    }

    fn piece(&mut self, command: &Command) -> Option<Piece> {
        match command {
            Command::Line {
                target, feed_rate, ..
            } => self.piece_of_move(target, *feed_rate, None),
            Command::Arc {
                target,
                circle,
                feed_rate,
                ..
            } => self.piece_of_move(target, *feed_rate, Some(circle)),
            Command::Dwell { .. }
            | Command::Spindle { .. }
            | Command::ReverseTap { .. }
            | Command::Coolant(_)
            | Command::Overrides(_)
            | Command::Pause
            | Command::ToolPause => {
                self.is_stop = true;
                None
            }
            // Only the machine knows where a probing move ends.
            Command::Probe { .. } | Command::Power(_) | Command::Speed(_) => None,
        }
    }

    /// The piece of a move; a move without a step becomes part of the next move.
    fn piece_of_move(
        &mut self,
        target: &Target,
        feed_rate: FeedRate,
        circle: Option<&Circle>,
    ) -> Option<Piece> {
        let scales = self.reader.settings().steps_per_mm;
        let is_core_xy = self.reader.settings().core_xy;
        let motors = if is_core_xy {
            core_xy::motors_of(target.position)
        } else {
            target.position
        };
        let steps = scales.zip(motors, |scale, nm| scale.steps_at(nm).0);
        let (begin, end) = (millimetres(&self.sent), millimetres(&target.position));
        let mut piece = Piece::new(begin, end, circle);
        if is_core_xy {
            piece = piece.turned();
        }
        if steps == self.steps && (circle.is_none() || self.is_tiny(&piece)) {
            return None;
        }
        piece.feed_mm_s = match feed_rate {
            FeedRate::Rapid => None,
            FeedRate::Feed(mm_min) | FeedRate::Jog(mm_min) => Some(f64::from(mm_min) / 60.0),
            FeedRate::InverseTime(per_min) => Some(piece.length_mm * f64::from(per_min) / 60.0),
        };
        piece.from_mm = self.length_mm;
        piece.corner = self.corner(&piece);
        self.length_mm += piece.length_mm;
        self.tangent = Some(piece.tangent(1.0));
        self.curvature = piece.curvature(1.0);
        self.sent = target.position;
        self.steps = steps;
        self.is_stop = false;
        Some(piece)
    }

    fn is_tiny(&self, piece: &Piece) -> bool {
        let finest = self.reader.settings().steps_per_mm.map(StepsPerMm::to_f32);
        let finest = finest.iter().copied().fold(0.0, f32::max);
        piece.length_mm * f64::from(finest) < 0.5
    }

    fn corner(&self, piece: &Piece) -> Corner {
        let Some(before) = self.tangent else {
            return Corner {
                is_stop: true,
                ..Corner::default()
            };
        };
        let after = piece.tangent(0.0);
        Corner {
            turn_rad: turn_rad(&before, &after),
            change: minus(&after, &before),
            curvature_change: minus(&piece.curvature(0.0), &self.curvature),
            allowed_mm_s: allowed_mm_s(
                &before,
                &after,
                &self.accelerations,
                self.reader.settings().junction_deviation_mm.into(),
            ),
            is_stop: self.is_stop,
            is_regeared: !(0.5..=2.0).contains(&(norm(&after) / norm(&before))),
        }
    }
}

#[cfg(test)]
mod tests {
    use leadscrew::settings::Settings;

    use super::*;

    fn pieces(lines: &[&str]) -> Vec<Piece> {
        let mut programmed = Programmed::new(ProgramReader::new(&Settings::default()));
        let lines = lines.iter();
        lines
            .flat_map(|line| programmed.line(line.as_bytes()))
            .collect()
    }

    #[test]
    fn lines_become_pieces_and_refused_ones_none() {
        let pieces = pieces(&[
            "g1 x10 f600 (right)",
            "G1 Q7",
            "y10",
            "G4 P0",
            "g2 x20 i5 j0",
        ]);
        assert_eq!(pieces.len(), 3);
        assert_eq!(pieces[0].feed_mm_s, Some(10.0));
        assert!((pieces[1].corner.turn_rad.to_degrees() - 90.0).abs() < 1.0e-9);
        assert!((pieces[2].from_mm - 20.0).abs() < 1.0e-12);
        assert!(pieces[2].is_arc() && pieces[2].corner.is_stop);
        // 10 mm/s², 0.01 mm, 90°: a·δ·(√½ / (1 - √½)), where both axes have their full limit.
        let expected = (10.0 * 2.0_f64.sqrt() * 0.01 * 2.414_213_562).sqrt();
        assert!((pieces[1].corner.allowed_mm_s - expected).abs() < 1.0e-6);
    }
}
