//! The picture of what `--quality` measures: speed, acceleration and jerk over time, and the path
//! coloured by its distance from the programmed one.

use chart::{Area, Drawn, FAINT_INK, HEAD, PX, chart, draw_head, font, pixels, stroke};
use plotters::prelude::*;

use super::{
    AXIS_COLOURS, PATH_WIDTH, Picture, draw_legend, draw_limits, draw_speed, path, time_range,
};
use crate::{
    curves::Curves,
    quality::{Series, Traces},
};
use path::Colouring;

/// Height of the picture.
pub(super) const HEIGHT: i32 = 860;
/// The colour scale reaches at least to that many times what rounding to steps makes.
const ROUNDING: f64 = 3.0;
/// How far beyond the highest limit a chart reaches.
const ROOM: f64 = 1.3;

pub(super) fn paint(root: &Area, picture: &Picture, traces: &Traces) -> Drawn<()> {
    let curves = Curves::of(picture.motion);
    let body = draw_head(root, picture.title, picture.subtitle)?;
    let (left, right) = body.split_horizontally(PATH_WIDTH * PX);
    path::draw(&left, picture.motion, &colouring(picture, traces))?;
    let third = (HEIGHT - HEAD) / 3 * PX;
    let (speed, rest) = right.split_vertically(third);
    let (acceleration, jerk) = rest.split_vertically(third);
    draw_speed(&speed, picture.motion, &curves)?;
    let limits = traces
        .accelerations
        .iter()
        .map(|(axis, _)| picture.limits_mm_s2[*axis]);
    draw_axes(
        &acceleration,
        picture,
        &traces.accelerations,
        &Quantity {
            label: "acceleration, mm/s²",
            limits: limits.collect(),
            scale: 1.0,
        },
    )?;
    let limits = traces
        .jerks
        .iter()
        .filter_map(|(axis, _)| picture.limits_mm_s3[*axis]);
    draw_axes(
        &jerk,
        picture,
        &traces.jerks,
        &Quantity {
            label: "jerk, 1000 mm/s³",
            limits: limits.collect(),
            scale: 0.001,
        },
    )
}

/// The path's colours: the greatest distance around each sample.
fn colouring(picture: &Picture, traces: &Traces) -> Colouring<'static> {
    let motion = picture.motion;
    let at = |index: usize| {
        let seconds = index as f64 * motion.spacing_s;
        traces.deviation.greatest_at(seconds).unwrap_or(0.0)
    };
    let values: Vec<_> = (0..motion.len()).map(at).collect();
    let most = values.iter().copied().fold(0.0, f64::max);
    // What rounding makes keeps its cool colours.
    let end = most.max(ROUNDING * traces.floor_mm);
    let legend = format!(
        "0 to {:.1} µm from the programmed path\n{:.1} µm at most; rounding to steps makes {:.1} µm",
        end * 1000.0,
        most * 1000.0,
        traces.floor_mm * 1000.0
    );
    Colouring::of_deviation(values, end, legend)
}

/// What is drawn of each axis.
struct Quantity {
    label: &'static str,
    /// Its limits, where there are any.
    limits: Vec<f64>,
    /// Units of the chart to those of the values.
    scale: f64,
}

fn draw_axes(
    area: &Area,
    picture: &Picture,
    axes: &[(usize, Series)],
    quantity: &Quantity,
) -> Drawn<()> {
    let scale = quantity.scale;
    let mut limits: Vec<_> = quantity.limits.iter().map(|limit| limit * scale).collect();
    limits.sort_by(f64::total_cmp);
    limits.dedup();
    let greatest = axes.iter().map(|(_, series)| series.greatest() * scale);
    let greatest = greatest.fold(1.0e-3, f64::max) * 1.1;
    let top = limits.last().map_or(greatest, |limit| limit * ROOM);
    let labels = ["time, s".to_owned(), quantity.label.to_owned()];
    let mut chart = chart(area, time_range(picture.motion), -top..top, &labels)?;
    draw_limits(&mut chart, picture.motion, &limits)?;
    for (axis, series) in axes {
        let style = AXIS_COLOURS[*axis].mix(0.85).stroke_width(stroke(2));
        for curve in series.curves() {
            let points = curve.into_iter();
            let points = points.map(|(time, value)| (time, (value * scale).clamp(-top, top)));
            chart.draw_series(LineSeries::new(points, style))?;
        }
    }
    if limits.is_empty() {
        let (width, _) = pixels(area);
        let at = ((width / 2 - 60) * PX, PX);
        area.draw(&Text::new(
            "no limit is set",
            at,
            font(13).color(&FAINT_INK),
        ))?;
    }
    draw_legend(area, axes.iter().map(|(axis, _)| *axis).collect())
}
