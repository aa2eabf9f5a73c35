//! Random tools beside random contours, and the programs for them.

use std::{f64::consts::PI, fmt};

use leadscrew::axis::{X, Y, Z};
use proptest::{collection::vec, prelude::*};

use super::{
    STEP_MM,
    geometry::{Piece, Point, TANGENT, ToolPath, left, minus, plus, tool_path, turn, unit},
};

/// What a corner that counts as tangent may take from a contour.
const GRAZED_MM: f64 = 0.3 * STEP_MM;
/// Room beside what the tool has to pass without touching it, of its radius and in mm.
const ROOM: (f64, f64) = (0.02, 0.05);
/// Samples along a radius with which a way is checked while it grows, and before it is executed.
const SAMPLES: f64 = 10.0;
pub(super) const FINE_SAMPLES: f64 = 60.0;

/// One element of a contour, by numbers from 0 to 1.
#[derive(Debug, Clone)]
struct Element {
    /// Line, arc to the left, arc to the right.
    kind: u8,
    size: f64,
    sweep: f64,
    /// None, nearly none, into the material, around it.
    corner: u8,
    angle: f64,
}

fn element() -> impl Strategy<Value = Element> {
    let unit = || 0.0..1.0_f64;
    (0..3_u8, unit(), unit(), 0..6_u8, unit()).prop_map(|(kind, size, sweep, corner, angle)| {
        Element {
            kind,
            size,
            sweep,
            corner,
            angle,
        }
    })
}

/// How a program is written.
#[derive(Debug, Clone, Copy)]
pub(super) struct Form {
    /// Coordinates have all six decimals, and not only as many as are usual.
    pub(super) is_fine: bool,
    /// In inches.
    pub(super) is_inch: bool,
    /// In G18 instead of G17.
    pub(super) is_zx: bool,
    /// Up and down along the contour.
    pub(super) has_depths: bool,
    /// Arcs by `R`, where that is exact: with fine coordinates, and not near half a turn.
    pub(super) has_radii: bool,
    /// Lines are rapids where no outer corner is before them: there a rapid goes straight.
    pub(super) has_rapids: bool,
}

impl Form {
    fn unit_mm(self) -> f64 {
        if self.is_inch { 25.4 } else { 1.0 }
    }

    fn decimals(self) -> u8 {
        match (self.is_fine, self.is_inch) {
            (true, _) => 6,
            (false, true) => 5,
            (false, false) => 3,
        }
    }

    /// A point as the program has it.
    pub(super) fn rounded(self, point: Point) -> Point {
        let per_mm = 10.0_f64.powi(self.decimals().into()) / self.unit_mm();
        point.map(|mm| (mm * per_mm).round() / per_mm)
    }

    /// The plane's axes.
    pub(super) fn axes(self) -> [usize; 2] {
        if self.is_zx { [Z, X] } else { [X, Y] }
    }

    /// A word of a length.
    fn word(self, letter: &str, mm: f64) -> String {
        format!(
            " {letter}{:.*}",
            self.decimals().into(),
            mm / self.unit_mm()
        )
    }

    pub(super) fn text(self, piece: &Piece, is_rapid: bool) -> String {
        let letters = if self.is_zx {
            ["Z", "X", "K", "I"]
        } else {
            ["X", "Y", "I", "J"]
        };
        let [x, y] = piece.end();
        let end = self.word(letters[0], x) + &self.word(letters[1], y);
        match *piece {
            Piece::Line { .. } => format!("G{}{end}", u8::from(!is_rapid)),
            Piece::Arc {
                centre,
                radius,
                sweep,
                ..
            } => {
                let code = if sweep > 0.0 { "G3" } else { "G2" };
                let is_half = (sweep.abs() - PI).abs() < 0.2;
                let [i, j] = minus(centre, self.rounded(piece.start()));
                let circle = if self.has_radii && self.is_fine && !is_half {
                    self.word("R", radius.copysign(PI - sweep.abs()))
                } else {
                    self.word(letters[2], i) + &self.word(letters[3], j)
                };
                format!("{code}{end}{circle}")
            }
        }
    }
}

/// A tool beside a contour.
#[derive(Clone)]
pub(super) struct Job {
    pub(super) form: Form,
    pub(super) radius: f64,
    /// 1: the tool is on the left of the contour; -1: on the right.
    pub(super) side: f64,
    pub(super) entry: Piece,
    pub(super) contour: Vec<Piece>,
}

/// A tool, and where its contour begins.
#[derive(Debug, Clone)]
struct Start {
    form: Form,
    radius: f64,
    side: f64,
    heading: f64,
    by_arc: bool,
    size: f64,
    angle: f64,
}

fn start() -> impl Strategy<Value = Start> {
    let unit = || 0.0..1.0_f64;
    let form = any::<[bool; 6]>().prop_map(
        |[is_fine, is_inch, is_zx, has_depths, has_radii, has_rapids]| Form {
            is_fine,
            is_inch,
            is_zx,
            has_depths,
            has_radii,
            has_rapids,
        },
    );
    (
        form,
        unit(),
        any::<bool>(),
        unit(),
        any::<bool>(),
        unit(),
        unit(),
    )
        .prop_map(
            |(form, radius, is_left, heading, by_arc, size, angle)| Start {
                form,
                // 0.25 to 10 mm.
                radius: (0.25 * 40.0_f64.powf(radius) * 1e6).round() * 1e-6,
                side: if is_left { 1.0 } else { -1.0 },
                heading: heading * 2.0 * PI,
                by_arc,
                size,
                angle,
            },
        )
}

impl Job {
    /// The entry from the origin to a contour in some direction, and its first element.
    fn new(start: &Start) -> Self {
        let Start {
            form,
            radius,
            side,
            heading,
            ..
        } = *start;
        let room = radius * (1.3 + 2.0 * start.size);
        let entry = if start.by_arc {
            // About a point beside the start of the contour, and tangent to it.
            let sweep = side * (0.3 + 1.2 * start.angle) * PI;
            let begin = unit(heading - sweep);
            let centre = form.rounded(plus([0.0; 2], left(begin), side * room));
            Piece::arc([0.0; 2], centre, sweep)
        } else {
            let turn = (30.0 + 80.0 * start.angle).to_radians();
            let end = form.rounded(plus([0.0; 2], unit(heading - side * turn), 3.0 * room));
            Piece::Line {
                start: [0.0; 2],
                end,
            }
        };
        Self {
            form,
            radius,
            side,
            entry,
            contour: Vec::new(),
        }
    }

    /// The end of the contour, and its direction.
    pub(super) fn end(&self, heading: f64) -> (Point, Point) {
        match self.contour.last() {
            Some(last) => (self.form.rounded(last.end()), last.direction(1.0)),
            None => (self.form.rounded(self.entry.end()), unit(heading)),
        }
    }

    /// Adds a line in a direction; returns its end and its direction there.
    pub(super) fn add_line(
        &mut self,
        (start, direction): (Point, Point),
        length: f64,
    ) -> (Point, Point) {
        let end = self.form.rounded(plus(start, direction, length));
        self.contour.push(Piece::Line { start, end });
        self.end(0.0)
    }

    /// Adds an arc that begins in a direction, to the left with a positive sweep; returns its end and its
    /// direction there.
    pub(super) fn add_arc(
        &mut self,
        (start, direction): (Point, Point),
        radius: f64,
        sweep: f64,
    ) -> (Point, Point) {
        let centre = self
            .form
            .rounded(plus(start, left(direction), radius * sweep.signum()));
        self.contour.push(Piece::arc(start, centre, sweep));
        self.end(0.0)
    }

    fn add(&mut self, element: &Element, heading: f64) {
        let (end, direction) = self.end(heading);
        let size = element.size * element.size;
        let is_inside = element.kind == if self.side > 0.0 { 1 } else { 2 };
        let radius = if is_inside {
            self.radius * (1.15 + 3.0 * size) + 0.2
        } else {
            self.radius * (0.1 + 3.0 * size) + 0.2
        };
        let angle = match element.corner {
            0 => 0.0,
            1 => (element.angle - 0.5) * 1.8 * self.nearly_tangent(is_inside.then_some(radius)),
            // Into the material, and around it.
            2 | 3 => self.side * (0.06 + 2.0 * element.angle),
            _ => -self.side * (0.06 + 2.7 * element.angle),
        };
        let is_first = self.contour.is_empty();
        let angle = if is_first { 0.0 } else { angle };
        let at = (end, unit(direction[1].atan2(direction[0]) + angle));
        let sweep = 0.2 + 4.5 * element.sweep * element.sweep;
        match element.kind {
            0 => self.add_line(at, self.radius * (0.3 + 5.0 * size) + 0.3),
            1 => self.add_arc(at, radius, sweep),
            _ => self.add_arc(at, radius, -sweep),
        };
    }

    /// The greatest angle of a corner at which the tool goes on without a move between. Where the tool comes to an arc
    /// around it, of the given radius, the part taken from the contour grows as R·r·β²/2 / (R - r).
    fn nearly_tangent(&self, around: Option<f64>) -> f64 {
        let taken = |radius: f64| {
            let room = radius - self.radius;
            (2.0 * GRAZED_MM * room / radius / self.radius).sqrt()
        };
        around.map_or(TANGENT, taken).min(TANGENT)
    }

    /// The way of the tool, where all of it fits.
    pub(super) fn tool_path(&self) -> Option<ToolPath> {
        tool_path(&self.entry, &self.contour, self.side, self.radius)
    }

    /// Where the tool goes after `G40`: away from the contour.
    pub(super) fn exit(&self) -> Piece {
        let last = self.contour.last().copied().unwrap_or(self.entry);
        let (end, direction) = (last.end(), last.direction(1.0));
        let aside = plus([0.0; 2], left(direction), self.side);
        let start = plus(end, aside, self.radius);
        let distant = plus(start, aside, 1.0 + 0.5 * self.radius);
        Piece::Line {
            start,
            end: self.form.rounded(plus(distant, direction, 1.0)),
        }
    }

    /// Whether nothing along a way is narrower than the tool but the corners that it is in.
    pub(super) fn is_wide(&self, tool_path: &ToolPath, samples: f64) -> bool {
        let last = self.contour.len() - 1;
        let moves = tool_path
            .iter()
            .copied()
            .chain([(self.exit(), [last, last])]);
        let fits = |(path, own): (Piece, [usize; 2])| {
            let samples = (path.length() / self.radius * samples).ceil().max(1.0) as u32;
            (0..=samples).all(|sample| {
                let at = path.at(f64::from(sample) / f64::from(samples));
                self.contour.iter().enumerate().all(|(index, piece)| {
                    let is_near = (own[0].saturating_sub(1)..=own[1] + 1).contains(&index);
                    let nearer = if is_near {
                        -self.radius * (1.0 - TANGENT.cos()) - 1e-5
                    } else {
                        self.radius * ROOM.0 + ROOM.1
                    };
                    piece.distance(at) >= self.radius + nearer
                })
            })
        };
        moves.into_iter().all(fits)
    }

    /// Whether the tool goes around the corner of two pieces.
    fn is_convex(&self, before: &Piece, after: &Piece) -> bool {
        turn(before.direction(1.0), after.direction(0.0)) * self.side < -TANGENT
    }

    /// Its program, to the end of the contour.
    pub(super) fn program(&self) -> Vec<String> {
        let code = if self.side > 0.0 { "G41.1" } else { "G42.1" };
        let plane = if self.form.is_zx { 18 } else { 17 };
        let (diameter, unit) = (2.0 * self.radius, self.form.unit_mm());
        let units = 21 - u8::from(self.form.is_inch);
        let mut lines = vec![format!(
            "G{units} G{plane} {code} D{:.8} F{:.3}",
            diameter / unit,
            40_000.0 / unit
        )];
        let depth = if self.form.is_zx { "Y" } else { "Z" };
        let pieces: Vec<_> = [self.entry].iter().chain(&self.contour).copied().collect();
        for (index, piece) in pieces.iter().enumerate() {
            // A move at the corner, and one along the contour.
            if self.form.has_depths && index % 3 == 1 {
                lines.push(format!("G1 {depth}{:.1}", 0.1 * index as f64));
            }
            let is_convex = index > 1 && self.is_convex(&pieces[index - 1], piece);
            let is_rapid = self.form.has_rapids && !is_convex;
            let mut line = self.form.text(piece, is_rapid);
            if self.form.has_depths && index % 3 == 2 {
                line.extend([" ", depth, "0"]);
            }
            lines.push(line);
        }
        lines
    }
}

impl fmt::Debug for Job {
    fn fmt(&self, out: &mut fmt::Formatter<'_>) -> fmt::Result {
        out.write_str(&self.program().join("\n"))
    }
}

/// A job with those of some elements beside which the tool fits, if any.
fn fitting(start: &Start, elements: &[Element]) -> Option<Job> {
    let mut job = Job::new(start);
    for element in elements {
        let mut longer = job.clone();
        longer.add(element, start.heading);
        if longer
            .tool_path()
            .is_some_and(|tool_path| longer.is_wide(&tool_path, SAMPLES))
        {
            job = longer;
        }
    }
    if job.contour.is_empty() {
        return None;
    }
    let tool_path = job.tool_path()?;
    job.is_wide(&tool_path, FINE_SAMPLES).then_some(job)
}

pub(super) fn wide_contours() -> impl Strategy<Value = Job> {
    (start(), vec(element(), 1..10))
        .prop_filter_map("the tool does not fit", |(start, elements)| {
            fitting(&start, &elements)
        })
}
