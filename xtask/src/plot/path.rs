//! The tool path, coloured by speed, in one scale for all directions.

use std::ops::Range;

use leadscrew::axis::{LETTERS, X, Y, Z};
use plotters::prelude::*;

use super::{
    Area, Drawn, FAINT_INK, HEAD, HEIGHT, LABELS_BELOW, LABELS_LEFT, MARGIN, PATH_WIDTH, PX, chart,
    font, pixels, stroke,
};
use crate::{
    curves::{Curves, moves, simplified},
    trace::Motion,
};

/// Path colours from standstill to the highest speed: rapid moves come out light.
const SPEED_COLOURS: [(f64, f64, f64); 5] = [
    (94.0, 15.0, 82.0),
    (52.0, 47.0, 136.0),
    (25.0, 105.0, 178.0),
    (64.0, 168.0, 199.0),
    (158.0, 211.0, 222.0),
];
/// Steps of the colour scale.
const LEVELS: u16 = 24;

/// The tool path from above, and from the front where Z moves; one scale for all directions.
pub(super) fn draw(area: &Area, motion: &Motion, curves: &Curves) -> Drawn<()> {
    let (x, y, z) = (
        extent(&motion.mm[X]),
        extent(&motion.mm[Y]),
        extent(&motion.mm[Z]),
    );
    let (area, scale_area) = area.split_vertically((HEIGHT - HEAD - 52) * PX);
    let length = |range: &Range<f64>| range.end - range.start;
    let (width, height) = pixels(&area);
    let across = f64::from(width - LABELS_LEFT - 2 * MARGIN);
    let whole = f64::from(height - LABELS_BELOW - MARGIN);
    let room = 1.1;
    if moves(&motion.mm[Z]) {
        let panels = whole - f64::from(LABELS_BELOW + MARGIN);
        // The part for Z is as high as Z needs, within reason.
        let wanted = length(&z) / (length(&y) + length(&z)).max(1e-9);
        let share = wanted.clamp(0.16, 0.6);
        let (up, front) = (panels * (1.0 - share), panels * share);
        let mm_per_pixel = (length(&x) / across)
            .max(length(&y) / up)
            .max(length(&z) / front)
            * room;
        let cut = up as i32 + LABELS_BELOW + MARGIN;
        let (above, below) = area.split_vertically(cut * PX);
        let x = widened(&x, across * mm_per_pixel);
        let y = widened(&y, up * mm_per_pixel);
        let z = widened(&z, front * mm_per_pixel);
        draw_plane(&above, motion, curves, (X, x.clone()), (Y, y))?;
        draw_plane(&below, motion, curves, (X, x), (Z, z))?;
    } else {
        let mm_per_pixel = (length(&x) / across).max(length(&y) / whole) * room;
        let x = widened(&x, across * mm_per_pixel);
        let y = widened(&y, whole * mm_per_pixel);
        draw_plane(&area, motion, curves, (X, x), (Y, y))?;
    }
    draw_scale(&scale_area, curves.fastest())
}

/// The path seen along one direction, coloured by speed.
fn draw_plane(
    area: &Area,
    motion: &Motion,
    curves: &Curves,
    (first, across): (usize, Range<f64>),
    (second, up): (usize, Range<f64>),
) -> Drawn<()> {
    let pixel = (across.end - across.start) / f64::from(PATH_WIDTH);
    let labels = [
        format!("{}, mm", LETTERS[first] as char),
        format!("{}, mm", LETTERS[second] as char),
    ];
    let mut chart = chart(area, across, up, &labels)?;
    let points: Vec<(f64, f64)> = motion.mm[first]
        .iter()
        .copied()
        .zip(motion.mm[second].iter().copied())
        .collect();
    let fastest = curves.fastest();
    let level = |index: usize| level_of(curves.speed[index.min(curves.speed.len() - 1)] / fastest);
    let mut strokes = Vec::new();
    let mut start = 0;
    for index in 1..points.len() {
        if index + 1 == points.len() || level(index) != level(start) {
            let stroke = simplified(&points[start..=index], pixel * 0.15);
            strokes.push((level(start), stroke));
            start = index;
        }
    }
    // Fast moves first, so that slow ones, which cut, lie on top.
    strokes.sort_by_key(|(level, _)| std::cmp::Reverse(*level));
    chart.draw_series(strokes.into_iter().map(|(level, points)| {
        let colour = colour(f64::from(level) / f64::from(LEVELS - 1));
        PathElement::new(points, colour.stroke_width(stroke(2)))
    }))?;
    Ok(())
}

/// The step of the colour scale for a share of the highest speed.
fn level_of(share: f64) -> u16 {
    ((share * f64::from(LEVELS)) as u16).min(LEVELS - 1)
}

/// The colour for a share of the highest speed.
fn colour(share: f64) -> RGBColor {
    let place = share.clamp(0.0, 1.0) * (SPEED_COLOURS.len() - 1) as f64;
    let index = (place as usize).min(SPEED_COLOURS.len() - 2);
    let (from, to) = (SPEED_COLOURS[index], SPEED_COLOURS[index + 1]);
    let mix = |from: f64, to: f64| (from + (to - from) * (place - index as f64)).round() as u8;
    RGBColor(mix(from.0, to.0), mix(from.1, to.1), mix(from.2, to.2))
}

/// The legend of the path's colours.
fn draw_scale(area: &Area, fastest: f64) -> Drawn<()> {
    let (left, top) = ((MARGIN + LABELS_LEFT) * PX, 12 * PX);
    let (width, height) = (220 * PX, 10 * PX);
    for step in 0..LEVELS {
        let from = width * i32::from(step) / i32::from(LEVELS);
        let to = width * i32::from(step + 1) / i32::from(LEVELS) + PX / 2;
        area.draw(&Rectangle::new(
            [(left + from, top), (left + to, top + height)],
            colour(f64::from(step) / f64::from(LEVELS - 1)).filled(),
        ))?;
    }
    let font = font(14).color(&FAINT_INK);
    let text = format!("0 to {:.0} mm/min along the path", fastest * 60.0);
    area.draw(&Text::new(
        text,
        (left + width + 12 * PX, top - 3 * PX),
        font,
    ))?;
    Ok(())
}

/// A range around all values, at least 1 µm wide.
fn extent(values: &[f64]) -> Range<f64> {
    let low = values.iter().copied().fold(f64::INFINITY, f64::min);
    let high = values.iter().copied().fold(f64::NEG_INFINITY, f64::max);
    if low < high {
        low..high
    } else {
        low - 1.0..high + 1.0
    }
}

/// A range of a given length with the same middle.
fn widened(range: &Range<f64>, length: f64) -> Range<f64> {
    let middle = f64::midpoint(range.start, range.end);
    middle - length / 2.0..middle + length / 2.0
}
