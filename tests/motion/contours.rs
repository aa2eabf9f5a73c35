//! Cutter compensation on random contours: no step is nearer to a contour than the cutter's radius.
//!
//! The contours, the way beside them and the distances are computed by [`geometry`], which uses nothing
//! of the firmware.

mod geometry;

use std::{f64::consts::PI, fmt};

use leadscrew::{
    axis::{X, Y, Z},
    settings::Settings,
    sim::{Edge, Simulator, Stream, StreamEnd, Watcher},
};
use proptest::{collection::vec, prelude::*};

use crate::support::{cases, with};
use geometry::{Piece, Point, TANGENT, Way, left, length, minus, plus, turn, unit, way};

const STEPS_PER_MM: f64 = 80.0;
const STEP_MM: f64 = 1.0 / STEPS_PER_MM;
/// How far the steps may be from a point where a move ends: rounded on two axes.
const AT_END_MM: f64 = 1.5 * STEP_MM;
/// How much nearer to a contour than its radius a step may be.
const NEARER_MM: f64 = 2.0 * STEP_MM;
/// What a corner that counts as tangent may take from a contour.
const GRAZED_MM: f64 = 0.3 * STEP_MM;
/// Room beside what the tool has to pass without touching it, of its radius and in mm.
const ROOM: (f64, f64) = (0.02, 0.05);
/// Samples along a radius with which a way is checked while it grows, and before it is executed.
const SAMPLES: f64 = 10.0;
const FINE_SAMPLES: f64 = 60.0;

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
struct Form {
    /// Coordinates have all six decimals, and not only as many as are usual.
    is_fine: bool,
    /// In inches.
    is_inch: bool,
    /// In G18 instead of G17.
    is_zx: bool,
    /// Up and down along the contour.
    has_depths: bool,
    /// Arcs by `R`, where that is exact: with fine coordinates, and not near half a turn.
    has_radii: bool,
    /// Lines are rapids where no outer corner is before them: there a rapid goes straight.
    has_rapids: bool,
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
    fn rounded(self, point: Point) -> Point {
        let per_mm = 10.0_f64.powi(self.decimals().into()) / self.unit_mm();
        point.map(|mm| (mm * per_mm).round() / per_mm)
    }

    /// The plane's axes.
    fn axes(self) -> [usize; 2] {
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

    fn text(self, piece: &Piece, is_rapid: bool) -> String {
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
struct Job {
    form: Form,
    radius: f64,
    /// 1: the tool is on the left of the contour; -1: on the right.
    side: f64,
    entry: Piece,
    contour: Vec<Piece>,
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
    fn end(&self, heading: f64) -> (Point, Point) {
        match self.contour.last() {
            Some(last) => (self.form.rounded(last.end()), last.direction(1.0)),
            None => (self.form.rounded(self.entry.end()), unit(heading)),
        }
    }

    /// Adds a line in a direction; returns its end and its direction there.
    fn add_line(&mut self, (start, direction): (Point, Point), length: f64) -> (Point, Point) {
        let end = self.form.rounded(plus(start, direction, length));
        self.contour.push(Piece::Line { start, end });
        self.end(0.0)
    }

    /// Adds an arc that begins in a direction, to the left with a positive sweep; returns its end and its
    /// direction there.
    fn add_arc(
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

    /// The greatest angle of a corner at which the tool goes on without a move between: where it comes to
    /// an arc around the tool, of which the radius is given, what this takes from the contour grows as
    /// R·r·β²/2 / (R - r).
    fn nearly_tangent(&self, around: Option<f64>) -> f64 {
        let taken = |radius: f64| {
            let room = radius - self.radius;
            (2.0 * GRAZED_MM * room / radius / self.radius).sqrt()
        };
        around.map_or(TANGENT, taken).min(TANGENT)
    }

    /// The way of the tool, where all of it fits.
    fn way(&self) -> Option<Way> {
        way(&self.entry, &self.contour, self.side, self.radius)
    }

    /// Where the tool goes after `G40`: away from the contour.
    fn exit(&self) -> Piece {
        let last = self.contour.last().copied().unwrap_or(self.entry);
        let (end, direction) = (last.end(), last.direction(1.0));
        let aside = plus([0.0; 2], left(direction), self.side);
        let start = plus(end, aside, self.radius);
        let away = plus(start, aside, 1.0 + 0.5 * self.radius);
        Piece::Line {
            start,
            end: self.form.rounded(plus(away, direction, 1.0)),
        }
    }

    /// Whether nothing along a way is narrower than the tool but the corners that it is in.
    fn is_wide(&self, way: &Way, samples: f64) -> bool {
        let last = self.contour.len() - 1;
        let moves = way.iter().copied().chain([(self.exit(), [last, last])]);
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
    fn program(&self) -> Vec<String> {
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

/// What the machine did.
struct Executed {
    axes: [usize; 2],
    /// The position after each step, steps.
    points: Vec<[i32; 2]>,
    answers: Vec<String>,
}

impl Watcher for Executed {
    fn edge(&mut self, edge: &Edge) {
        let steps = |axis: usize| match (edge.raise >> axis & 1, edge.directions >> axis & 1) {
            (0, _) => 0,
            (_, 0) => 1,
            _ => -1,
        };
        if edge.raise != 0 {
            let [x, y] = self.points.last().copied().unwrap_or_default();
            let [first, second] = self.axes.map(steps);
            self.points.push([x + first, y + second]);
        }
    }

    fn answer(&mut self, _: u64, answer: &[u8]) {
        self.answers.push(String::from_utf8_lossy(answer).into());
    }

    fn message(&mut self, _: u64, _: &[u8]) {}
}

impl Executed {
    fn point(&self, index: usize) -> Point {
        self.points[index].map(|steps| f64::from(steps) * STEP_MM)
    }

    fn end(&self) -> Point {
        self.points
            .len()
            .checked_sub(1)
            .map_or([0.0; 2], |last| self.point(last))
    }
}

fn settings() -> Settings {
    with(&[STEPS_PER_MM], &[40_000.0], &[20_000.0])
}

/// Runs lines on the whole machine.
fn execute(form: Form, lines: &[String]) -> Executed {
    let program = lines.join("\n");
    let mut simulator = Box::new(Simulator::new(&settings()));
    let mut executed = Executed {
        axes: form.axes(),
        points: Vec::new(),
        answers: Vec::new(),
    };
    let end = Stream::new(&mut *simulator, program.bytes(), 1_000_000).run(&mut executed);
    assert_eq!(end, StreamEnd::Complete, "{lines:#?}");
    executed
}

/// No step is nearer to pieces of a contour than the tool's radius.
fn check_distances(
    executed: &Executed,
    contour: &[Piece],
    radius: f64,
) -> Result<(), TestCaseError> {
    let least = radius - NEARER_MM;
    for piece in contour {
        let mut index = 0;
        while index < executed.points.len() {
            let distance = piece.distance(executed.point(index));
            prop_assert!(
                distance >= least,
                "step {index} at {:?} is {distance} from {piece:?}, not {radius}",
                executed.point(index)
            );
            // An event is not longer than a step of both axes.
            index += ((distance - least) / STEP_MM / 2.0_f64.sqrt()) as usize + 1;
        }
    }
    Ok(())
}

/// Every move of a way has ended where it should, one after the other.
fn check_ends(executed: &Executed, way: &Way) -> Result<(), TestCaseError> {
    let mut index = 0;
    for (path, _) in way {
        let end = path.end();
        let mut nearest = f64::INFINITY;
        while index < executed.points.len() {
            let distance = length(minus(executed.point(index), end));
            nearest = nearest.min(distance);
            if distance <= AT_END_MM {
                break;
            }
            index += ((distance - AT_END_MM) / STEP_MM / 2.0_f64.sqrt()) as usize + 1;
        }
        prop_assert!(
            index < executed.points.len(),
            "{nearest} mm from the end of {path:?}"
        );
    }
    Ok(())
}

/// A job with those of some elements beside which the tool fits, if any.
fn fitting(start: &Start, elements: &[Element]) -> Option<Job> {
    let mut job = Job::new(start);
    for element in elements {
        let mut longer = job.clone();
        longer.add(element, start.heading);
        if longer
            .way()
            .is_some_and(|way| longer.is_wide(&way, SAMPLES))
        {
            job = longer;
        }
    }
    if job.contour.is_empty() {
        return None;
    }
    let way = job.way()?;
    job.is_wide(&way, FINE_SAMPLES).then_some(job)
}

fn wide_contours() -> impl Strategy<Value = Job> {
    (start(), vec(element(), 1..10))
        .prop_filter_map("the tool does not fit", |(start, elements)| {
            fitting(&start, &elements)
        })
}

/// What makes a job one that the tool does not fit.
#[derive(Debug, Clone, Copy)]
enum Misfit {
    /// The entry is not longer than the radius.
    Entry,
    /// An arc around the tool is not larger than it.
    Arc,
    /// A line is shorter than what a corner at its end takes of it.
    Line,
    /// A line is shorter than what a corner at its start takes of it.
    Behind,
    /// A line between two corners is shorter than what both take of it, and longer than what one does.
    Between,
    /// The line behind an arc around the tool passes the way along it.
    Missed,
}

const MISFITS: [Misfit; 6] = [
    Misfit::Entry,
    Misfit::Arc,
    Misfit::Line,
    Misfit::Behind,
    Misfit::Between,
    Misfit::Missed,
];

impl Misfit {
    /// Adds it to a job, by numbers from 0 to 1. Returns where the tool stands before it: where the move
    /// begins that waits. `None` where there is no room for it.
    fn add(self, job: &mut Job, way: &Way, size: f64, angle: f64) -> Option<Point> {
        let radius = job.radius;
        let at = job.end(0.0);
        let side = job.side;
        let turned = |(start, direction): (Point, Point), angle: f64| {
            let direction = unit(direction[1].atan2(direction[0]) + side * angle);
            (start, direction)
        };
        let last = way[way.len() - 1].0;
        Some(match self {
            Self::Entry => {
                job.entry = Piece::Line {
                    start: [0.0; 2],
                    end: job.form.rounded(plus(
                        [0.0; 2],
                        unit(angle),
                        radius * (0.01 + 0.98 * size),
                    )),
                };
                job.contour.clear();
                [0.0; 2]
            }
            Self::Arc => {
                job.add_arc(at, radius * (0.2 + 0.79 * size), side * (0.3 + 2.0 * angle));
                // Where the move before has ended.
                way[way.len() - 2].0.end()
            }
            Self::Line => {
                let angle = 0.3 + 1.8 * angle;
                let taken = radius * (angle / 2.0).tan();
                let corner = job.add_line(at, taken * (0.2 + 0.7 * size));
                job.add_line(turned(corner, angle), 4.0 * radius);
                last.end()
            }
            Self::Behind | Self::Between => {
                // What is before the first corner is long enough.
                let first = 0.3 + 1.8 * angle;
                let [taken, more] = [first, 1.2].map(|angle| radius * (angle / 2.0).tan());
                let before = job.add_line(at, 2.0 * taken + radius);
                if !job.is_wide(&job.way()?, FINE_SAMPLES) {
                    return None;
                }
                let part = 0.1 + 0.8 * size;
                if matches!(self, Self::Behind) {
                    job.add_line(turned(before, first), taken * part);
                    return Some(way[way.len() - 1].0.end());
                }
                let corner = job.add_line(turned(before, first), taken + more * part);
                job.add_line(turned(corner, 1.2), 8.0 * radius);
                plus(
                    plus(before.0, before.1, -taken),
                    left(before.1),
                    side * radius,
                )
            }
            Self::Missed => {
                let corner = job.add_arc(at, 1.1 * radius, side * (0.3 + size));
                job.add_line(turned(corner, 0.8 + angle), 4.0 * radius);
                last.end()
            }
        })
    }
}

#[test]
fn path_control_rounds_the_way_of_the_cutter() {
    let form = Form {
        is_fine: false,
        is_inch: false,
        is_zx: false,
        has_depths: false,
        has_radii: false,
        has_rapids: false,
    };
    let executed = |control: &str, path: &[&str]| {
        let begin = ["F3000", control, "G0X0Y-10"];
        let lines: Vec<_> = begin.iter().chain(path).map(ToString::to_string).collect();
        let executed = execute(form, &lines);
        assert!(
            executed.answers.iter().all(|answer| answer == "ok"),
            "{lines:?}"
        );
        executed.points
    };
    // Into a corner, around one, and out.
    let contour = ["G42.1D2", "G1X0Y0", "Y20", "X20", "Y30", "G40", "G1X40Y40"];
    let way = ["G1X1Y0", "Y19", "X20", "G3X21Y20J1", "G1Y30", "X40Y40"];
    let rounded = executed("G64P0.2", &contour);
    assert_eq!(rounded, executed("G64P0.2", &way));
    assert_eq!(executed("G61", &contour), executed("G61", &way));
    assert_ne!(rounded, executed("G61", &way), "no corner is rounded");
}

proptest! {
    #![proptest_config(cases(2000))]

    #[test]
    fn a_compensated_tool_is_nowhere_nearer_to_a_contour_than_its_radius(job in wide_contours()) {
        let way = job.way().unwrap();
        let mut lines = job.program();
        let exit = job.exit();
        lines.extend(["G40".into(), job.form.text(&exit, false)]);
        let executed = execute(job.form, &lines);
        prop_assert!(executed.answers.iter().all(|answer| answer == "ok"), "{:?} {:#?}", executed.answers, lines);
        check_distances(&executed, &job.contour, job.radius)?;
        check_ends(&executed, &way)?;
        prop_assert!(length(minus(executed.end(), exit.end())) <= AT_END_MM);
    }
}

proptest! {
    #![proptest_config(cases(500))]

    #[test]
    fn where_the_tool_does_not_fit_the_line_is_refused_and_the_tool_stays_before_the_corner(
        job in wide_contours(),
        misfit in prop::sample::select(&MISFITS[..]),
        size in 0.0..1.0_f64,
        angle in 0.0..1.0_f64,
    ) {
        let mut job = job;
        let way = job.way().unwrap();
        let contour = job.contour.clone();
        let stands = misfit.add(&mut job, &way, size, angle);
        prop_assume!(stands.is_some());
        let stands = stands.unwrap();
        let lines = job.program();
        let executed = execute(job.form, &lines);
        let mut expected = vec!["ok"; lines.len() - 1];
        expected.push("error:92");
        prop_assert_eq!(&executed.answers, &expected, "{:#?}", lines);
        let distance = length(minus(executed.end(), stands));
        prop_assert!(distance <= AT_END_MM, "{} mm from {:?}", distance, stands);
        if job.contour.len() >= contour.len() {
            check_distances(&executed, &contour, job.radius)?;
        }
    }
}
