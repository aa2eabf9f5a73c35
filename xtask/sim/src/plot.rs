//! The picture of a run: tool path, speed and acceleration, drawn from the step trace.

mod path;
mod quality;

use std::ops::Range;

use anyhow::Result;
use chart::{
    Area, Chart, Drawn, FAINT_INK, HEAD, INK, MARGIN, PX, SPEED, WIDTH, chart, draw_head, font,
    pixels, render, stroke,
};
use leadscrew::axis::{AXES, LETTERS};
use plotters::prelude::*;

use crate::{
    curves::{Curves, thinned},
    quality::Traces,
    trace::Motion,
};
use path::Colouring;

const HEIGHT: i32 = 720;
/// Width of the part that shows the path.
const PATH_WIDTH: i32 = 640;
/// Colours of the axes' accelerations.
const AXIS_COLOURS: [RGBColor; 6] = [
    RGBColor(205, 66, 70),
    RGBColor(34, 139, 94),
    RGBColor(72, 92, 176),
    RGBColor(201, 132, 20),
    RGBColor(132, 76, 158),
    RGBColor(20, 140, 152),
];
/// What is drawn.
pub(crate) struct Picture<'a> {
    /// The program's name.
    pub(crate) title: &'a str,
    /// One line below it.
    pub(crate) subtitle: &'a str,
    /// The motion.
    pub(crate) motion: &'a Motion,
    /// Highest acceleration of each axis, mm/s².
    pub(crate) limits_mm_s2: [f64; AXES],
    /// Highest jerk of each axis, mm/s³; `None` without a limit.
    pub(crate) limits_mm_s3: [Option<f64>; AXES],
    /// What was measured, if it was: jerk and distance from the path are drawn too.
    pub(crate) traces: Option<&'a Traces>,
}

/// Draws a picture.
pub(crate) fn draw(picture: &Picture) -> Result<String> {
    match picture.traces {
        None => render((WIDTH, HEIGHT), |root| paint(root, picture)),
        Some(traces) => render((WIDTH, quality::HEIGHT), |root| {
            quality::paint(root, picture, traces)
        }),
    }
}

fn paint(root: &Area, picture: &Picture) -> Drawn<()> {
    let curves = Curves::of(picture.motion);
    let body = draw_head(root, picture.title, picture.subtitle)?;
    let (left, right) = body.split_horizontally(PATH_WIDTH * PX);
    path::draw(&left, picture.motion, &Colouring::of_speed(&curves))?;
    let (upper, lower) = right.split_vertically((HEIGHT - HEAD) / 2 * PX);
    draw_speed(&upper, picture.motion, &curves)?;
    draw_acceleration(&lower, picture, &curves)
}

fn draw_speed(area: &Area, motion: &Motion, curves: &Curves) -> Drawn<()> {
    let top = curves.fastest() * 60.0 * 1.12;
    let labels = [
        "time, s".to_owned(),
        "speed along the path, mm/min".to_owned(),
    ];
    let mut chart = chart(area, time_range(motion), 0.0..top, &labels)?;
    let line = thinned(&curves.speed, motion.spacing_s, 60.0);
    chart.draw_series(AreaSeries::new(line.iter().copied(), 0.0, SPEED.mix(0.13)))?;
    chart.draw_series(LineSeries::new(line, SPEED.stroke_width(stroke(2))))?;
    Ok(())
}

fn draw_acceleration(area: &Area, picture: &Picture, curves: &Curves) -> Drawn<()> {
    let motion = picture.motion;
    let axes = || curves.accelerations.iter().map(|(axis, _)| *axis);
    let mut limits: Vec<_> = axes().map(|axis| picture.limits_mm_s2[axis]).collect();
    limits.sort_by(f64::total_cmp);
    limits.dedup();
    let top = limits.last().copied().unwrap_or(1.0) * 1.3;
    let labels = ["time, s".to_owned(), "acceleration, mm/s²".to_owned()];
    let mut chart = chart(area, time_range(motion), -top..top, &labels)?;
    draw_limits(&mut chart, motion, &limits)?;
    for (axis, values) in &curves.accelerations {
        let style = AXIS_COLOURS[*axis].mix(0.85).stroke_width(stroke(2));
        let points = thinned(values, motion.spacing_s, 1.0);
        let clipped = points
            .into_iter()
            .map(|(time, value)| (time, value.clamp(-top, top)));
        chart.draw_series(LineSeries::new(clipped, style))?;
    }
    draw_legend(area, axes().collect())
}

/// Dashed lines at limits, on both sides of 0.
fn draw_limits(chart: &mut Chart, motion: &Motion, limits: &[f64]) -> Drawn<()> {
    for limit in limits.iter().flat_map(|limit| [*limit, -*limit]) {
        let ends = [(0.0, limit), (motion.duration_s(), limit)];
        let style = FAINT_INK.mix(0.5).stroke_width(stroke(1));
        chart.draw_series(DashedLineSeries::new(ends, 3 * PX, 4 * PX, style))?;
    }
    Ok(())
}

/// Names the colours of the axes, above the right end of a chart.
fn draw_legend(area: &Area, axes: Vec<usize>) -> Drawn<()> {
    let (width, _) = pixels(area);
    for (place, axis) in (0..).zip(axes.into_iter().rev()) {
        let right = (width - MARGIN - 44 * place) * PX;
        let style = AXIS_COLOURS[axis].stroke_width(stroke(3));
        let ends = [(right - 32 * PX, 8 * PX), (right - 14 * PX, 8 * PX)];
        area.draw(&PathElement::new(ends, style))?;
        let name = char::from(LETTERS[axis]).to_string();
        let style = font(14).color(&INK);
        area.draw(&Text::new(name, (right - 9 * PX, PX), style))?;
    }
    Ok(())
}

fn time_range(motion: &Motion) -> Range<f64> {
    0.0..motion.duration_s().max(0.001)
}

#[cfg(test)]
mod tests {
    use super::*;
    use crate::trace::{Row, Samples};

    /// A rounded path in X, Y and Z, as step events.
    fn drawing() -> Motion {
        let scale = [250.0; AXES];
        let mut samples = Samples::default();
        let mut steps = [0; AXES];
        for tick in 0..400_000_u64 {
            let turn = tick as f64 / 400_000.0;
            let angle = std::f64::consts::TAU * (turn - (std::f64::consts::TAU * turn).sin() / 6.4);
            let radius = 30.0 + 8.0 * (5.0 * angle).cos();
            let at = [
                radius * angle.cos() - 38.0,
                radius * angle.sin(),
                3.0 * (2.0 * angle).sin(),
            ];
            let mut next = steps;
            for (axis, mm) in at.iter().enumerate() {
                next[axis] = (mm * scale[axis]).round() as i32;
            }
            if next != steps {
                steps = next;
                samples.push(&Row {
                    time_ns: tick * 10_000,
                    steps,
                });
            }
        }
        samples.finish(scale)
    }

    #[test]
    fn a_picture_names_its_quantities_and_units() {
        let motion = drawing();
        let picture = Picture {
            title: "flower.nc",
            subtitle: "a test",
            motion: &motion,
            limits_mm_s2: [300.0; AXES],
            limits_mm_s3: [None; AXES],
            traces: None,
        };
        let text = draw(&picture).unwrap();
        for label in [
            "flower.nc",
            "X, mm",
            "Y, mm",
            "Z, mm",
            "time, s",
            "mm/min",
            "mm/s²",
        ] {
            assert!(text.contains(label), "{label}");
        }
        assert!(text.len() < 1_000_000, "{} bytes", text.len());
    }

    #[test]
    fn nothing_and_a_point_can_be_drawn() {
        let motion = Samples::default().finish([250.0; AXES]);
        let picture = Picture {
            title: "",
            subtitle: "",
            motion: &motion,
            limits_mm_s2: [10.0; AXES],
            limits_mm_s3: [None; AXES],
            traces: None,
        };
        assert!(draw(&picture).unwrap().contains("</svg>"));
    }
}
