//! The picture of a run: the tool path, and beside it what there is over time, as strips.

mod marks;
mod path;
mod strip;

use anyhow::Result;
use leadscrew::axis::{AXES, LETTERS, LINEAR};
use plotters::prelude::*;
use simulation::chart::{Area, DASHED, Drawn, HEAD, PX, SPEED, WIDTH, draw_head, render};

use crate::{
    marks::Marks,
    quality::{self, Traces},
    samples::Motion,
    series::Series,
};
use path::Colouring;
use strip::{Curve, Mark, Strip};

/// Least height of what is below the head.
const BODY: i32 = 656;
/// Width of the part that shows the path.
const PATH_WIDTH: i32 = 640;
/// How far beyond a limit a strip reaches.
const ROOM: f64 = 1.3;
/// Colours of the axes.
const AXIS_COLOURS: [RGBColor; 6] = [
    RGBColor(205, 66, 70),
    RGBColor(34, 139, 94),
    RGBColor(72, 92, 176),
    RGBColor(201, 132, 20),
    RGBColor(132, 76, 158),
    RGBColor(20, 140, 152),
];
const RAPID: RGBColor = RGBColor(160, 169, 182);
const POWER: RGBColor = RGBColor(201, 92, 30);

/// What is drawn.
pub(crate) struct Picture<'a> {
    /// The program's name.
    pub(crate) title: &'a str,
    /// One line below it.
    pub(crate) subtitle: &'a str,
    pub(crate) motion: &'a Motion,
    /// Drawn into the path.
    pub(crate) marks: &'a Marks,
    /// Highest acceleration of each axis, mm/s² or degrees/s².
    pub(crate) limits_mm_s2: [f64; AXES],
    /// Highest jerk of each axis, mm/s³ or degrees/s³; `None` without a limit.
    pub(crate) limits_mm_s3: [Option<f64>; AXES],
    /// Whether the power is that of a laser.
    pub(crate) is_laser: bool,
    /// What was measured, if it was: jerk and distance from the path are drawn too.
    pub(crate) traces: Option<&'a Traces>,
}

/// Draws a picture.
pub(crate) fn draw(picture: &Picture) -> Result<String> {
    let strips = strips(picture);
    let wanted = strips.iter().map(|strip| strip.height).sum::<i32>() + strip::TIMES;
    let height = wanted.max(BODY);
    render((WIDTH, HEAD + height), |root| {
        let body = draw_head(root, picture.title, picture.subtitle)?;
        let (left, right) = body.split_horizontally(PATH_WIDTH * PX);
        let colouring = match picture.traces {
            None => Colouring::of_speed(picture.motion),
            Some(traces) => Colouring::of_deviation(picture.motion, traces),
        };
        path::draw(&left, picture.motion, picture.marks, &colouring)?;
        draw_strips(
            &right,
            picture.motion,
            &strips,
            f64::from(height - strip::TIMES),
        )
    })
}

/// Draws strips below each other, as high as there is room for.
fn draw_strips(area: &Area, motion: &Motion, strips: &[Strip], room: f64) -> Drawn<()> {
    let wanted: i32 = strips.iter().map(|strip| strip.height).sum();
    let mut remainder = area.clone();
    for (index, strip) in strips.iter().enumerate() {
        let height = f64::from(strip.height) * room / f64::from(wanted.max(1));
        let is_last = index + 1 == strips.len();
        let height = height as i32 + if is_last { strip::TIMES } else { 0 };
        let (above, below) = remainder.split_vertically(height * PX);
        strip.draw(&above, motion.duration_s.max(0.001), is_last)?;
        remainder = below;
    }
    Ok(())
}

/// What there is over time.
fn strips<'a>(picture: &Picture<'a>) -> Vec<Strip<'a>> {
    let motion = picture.motion;
    let mut strips = vec![speed(motion)];
    strips.extend(picture.marks.holes.depth_axes().map(|axis| Strip {
        height: 2 * Strip::default().height,
        ..position(motion, axis)
    }));
    let measured = picture.traces.map(|traces| &traces.accelerations);
    let has_motors = picture.traces.is_some_and(|traces| traces.is_core_xy);
    let of = |axis| (axis, quality::name(axis, has_motors));
    let accelerations: Vec<_> = match measured {
        Some(measured) if has_motors => measured.iter().map(|(n, series)| (*n, series)).collect(),
        _ => {
            let moving = motion.moving(0..AXES);
            let measured = |axis| measured.and_then(|all| of_axis(all, axis));
            let series = |axis| measured(axis).unwrap_or(&motion.accelerations[axis]);
            moving.map(|axis| (axis, series(axis))).collect()
        }
    };
    for (axis, series) in accelerations {
        let limit = Some(picture.limits_mm_s2[axis]);
        strips.push(derivative(
            of(axis),
            ("acceleration", "s²", 1.0),
            series,
            limit,
        ));
    }
    for (axis, series) in picture.traces.iter().flat_map(|traces| &traces.jerks) {
        let limit = picture.limits_mm_s3[*axis];
        strips.push(derivative(of(*axis), ("jerk", "s³", 0.001), series, limit));
    }
    if motion.power.greatest() > 0.0 {
        let what = if picture.is_laser { "laser" } else { "spindle" };
        strips.push(Strip {
            title: format!("{what}, % of full power"),
            curves: vec![Curve::new(POWER, &motion.power, 1.0)],
            range: 0.0..105.0,
            ..Strip::default()
        });
    }
    let rotary = motion.moving(LINEAR..AXES);
    strips.extend(rotary.map(|axis| position(motion, axis)));
    strips
}

fn of_axis(all: &[(usize, Series)], axis: usize) -> Option<&Series> {
    let found = all.iter().find(|(of, _)| *of == axis);
    found.map(|(_, series)| series)
}

/// Where an axis is.
fn position(motion: &Motion, axis: usize) -> Strip<'_> {
    let (least, greatest) = motion.extents[axis];
    let room = (greatest - least) * 0.05;
    let unit = if axis >= LINEAR { "degrees" } else { "mm" };
    Strip {
        title: format!("{}, {unit}", char::from(LETTERS[axis])),
        curves: vec![Curve::new(AXIS_COLOURS[axis], &motion.positions[axis], 1.0)],
        range: least - room..greatest + room,
        ..Strip::default()
    }
}

/// The speed along the path.
fn speed(motion: &Motion) -> Strip<'_> {
    let [feed, rapid] = &motion.speeds;
    let has_linear = motion.moving(0..LINEAR).next().is_some();
    let unit = if has_linear { "mm" } else { "degrees" };
    let fastest = feed.greatest().max(rapid.greatest()).max(1e-3);
    Strip {
        title: format!("speed along the path, {unit}/min"),
        marks: vec![Mark::line(SPEED, "feed"), Mark::line(RAPID, "rapid")],
        curves: vec![
            Curve::new(RAPID, rapid, 60.0),
            Curve::new(SPEED, feed, 60.0),
        ],
        range: 0.0..fastest * 60.0 * 1.08,
        height: 2 * Strip::default().height,
        ..Strip::default()
    }
}

/// An acceleration or jerk of an axis, with its limit.
fn derivative<'a>(
    (axis, name): (usize, String),
    (what, per, scale): (&str, &str, f64),
    series: &'a Series,
    limit: Option<f64>,
) -> Strip<'a> {
    let limit = limit.map(|limit| limit * scale);
    let greatest = (series.greatest() * scale).max(1e-3) * 1.1;
    let top = limit.map_or(greatest, |limit| limit * ROOM);
    let unit = if axis >= LINEAR { "degrees" } else { "mm" };
    let thousand = if scale < 1.0 { "1000 " } else { "" };
    let mark = match limit {
        Some(limit) if greatest > ROOM * limit => {
            Mark::line(DASHED, &format!("limit {limit}; beyond: corners ($11)"))
        }
        Some(limit) => Mark::line(DASHED, &format!("limit {limit}")),
        None => Mark::text("no limit is set"),
    };
    Strip {
        title: format!("{what} of {name}, {thousand}{unit}/{per}"),
        marks: vec![mark],
        curves: vec![Curve::new(AXIS_COLOURS[axis], series, scale)],
        range: -top..top,
        limit,
        ..Strip::default()
    }
}

#[cfg(test)]
mod tests {
    use leadscrew::{axis::X, model::Outputs, settings::Settings};

    use super::*;
    use crate::{
        samples::Samples,
        trace::{Move, Row},
    };

    /// Turns along a circle of X and Y, each with a rapid in its second half; A moves with X.
    fn circle(turns: u64, duty: u16) -> Motion {
        let mut samples = Samples::new(&Settings::default());
        for tick in 0..turns * 20_000 {
            let angle = tick as f64 / 20_000.0 * std::f64::consts::TAU;
            let back = angle.cos() - 1.0;
            let steps = [back, angle.sin(), 0.0, back, 0.0, 0.0];
            samples.push(&Row {
                time_ns: tick * 400_000,
                steps: std::array::from_fn(|axis| (5000.0 * steps[axis]).round() as i32),
                of: Move {
                    is_rapid: tick % 20_000 > 10_000,
                    duty,
                },
            });
        }
        samples.finish()
    }

    fn drawn(motion: &Motion, limit: f64) -> String {
        let picture = Picture {
            title: "circle.nc",
            subtitle: "a test",
            motion,
            marks: &Marks::default(),
            limits_mm_s2: [limit; AXES],
            limits_mm_s3: [None; AXES],
            is_laser: true,
            traces: None,
        };
        draw(&picture).unwrap()
    }

    #[test]
    fn a_picture_names_its_quantities_units_limits_and_ends() {
        let motion = circle(1, Outputs::FULL / 2);
        let text = drawn(&motion, 30.0);
        for label in [
            "circle.nc",
            "X, mm",
            "Y, mm",
            "time, s",
            "speed along the path, mm/min",
            "acceleration of X, mm/s²",
            "limit 30",
            "feed moves, 0 to",
            "rapids",
            "start, end",
            "laser, % of full power",
            "Y -20.000 to 20.000 mm",
        ] {
            assert!(text.contains(label), "{label}");
        }
        // A rotary axis is not projected: it has degrees of its own.
        assert_eq!(text.contains("A, degrees"), AXES > LINEAR);
        assert!(text.contains("stroke-dasharray") && text.contains("<polygon"));
        assert!(drawn(&motion, 1.0).contains("limit 1; beyond: corners ($11)"));
        assert!(!drawn(&circle(1, 0), 30.0).contains("laser"));
    }

    #[test]
    fn the_colours_reach_to_the_fastest_feed_move() {
        let mut motion = circle(1, 0);
        let legend = |motion: &Motion| Colouring::of_speed(motion).legend().to_owned();
        let before = legend(&motion);
        motion.speeds[1].push(0.0, 1.0, 1000.0);
        assert_eq!(legend(&motion), before);
        motion.speeds[0].push(0.0, 1.0, 1000.0);
        assert_eq!(legend(&motion), "feed moves, 0 to 60000 mm/min");
    }

    #[test]
    fn a_long_job_is_no_larger_than_what_can_be_seen_of_it() {
        let [short, long] = [2, 60].map(|turns| drawn(&circle(turns, 0), 30.0).len());
        assert!(long < 3 * short, "{short} {long} bytes");
    }

    #[test]
    fn a_quantity_that_changes_within_a_pixel_is_a_band() {
        let mut motion = circle(1, 0);
        let bands = |motion: &Motion| drawn(motion, 30.0).matches("<polygon").count();
        motion.accelerations[X] = Series::default();
        let without = bands(&motion);
        for index in 0..200_000_u32 {
            let value = if index % 2 == 0 { 10.0 } else { -10.0 };
            let seconds = f64::from(index) * 0.001;
            motion.accelerations[X].push(seconds, seconds, value);
        }
        assert_eq!(bands(&motion), without + 1);
    }

    #[test]
    fn nothing_and_a_point_can_be_drawn() {
        let mut samples = Samples::new(&Settings::default());
        assert!(drawn(&samples.clone().finish(), 10.0).contains("</svg>"));
        samples.push(&Row {
            time_ns: 0,
            steps: [0; AXES],
            of: Move::default(),
        });
        assert!(drawn(&samples.finish(), 10.0).contains("</svg>"));
    }
}
