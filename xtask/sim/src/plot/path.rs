//! The tool path, coloured by what happens along it, in one scale for all directions.

use std::{borrow::Cow, ops::Range};

use chart::{
    Area, Drawn, FAINT_INK, LABELS_BELOW, LABELS_LEFT, MARGIN, PX, chart, font, pixels, stroke,
};
use leadscrew::axis::{LETTERS, X, Y, Z};
use plotters::prelude::*;

use super::PATH_WIDTH;
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
/// Path colours from none to the most of something that ought not to be.
const ERROR_COLOURS: [(f64, f64, f64); 5] = [
    (150.0, 190.0, 216.0),
    (120.0, 184.0, 160.0),
    (232.0, 196.0, 74.0),
    (232.0, 126.0, 52.0),
    (176.0, 24.0, 48.0),
];
/// Steps of the colour scale.
const LEVELS: u16 = 24;

/// What colours a path.
pub(super) struct Colouring<'a> {
    /// A value for each sample of the motion.
    values: Cow<'a, [f64]>,
    /// The value at the end of the colours.
    most: f64,
    colours: &'static [(f64, f64, f64); 5],
    /// Whether the least value is drawn on top.
    is_least_on_top: bool,
    /// What the values are, in up to two lines.
    legend: String,
}

impl<'a> Colouring<'a> {
    /// By the speed; slow moves, which cut, lie on top of fast ones.
    pub(super) fn of_speed(curves: &'a Curves) -> Self {
        let most = curves.fastest();
        Self {
            values: Cow::Borrowed(&curves.speed),
            most,
            colours: &SPEED_COLOURS,
            is_least_on_top: true,
            legend: format!("0 to {:.0} mm/min along the path", most * 60.0),
        }
    }

    /// By the distance from the programmed path, mm.
    pub(super) fn of_deviation(values: Vec<f64>, most: f64, legend: String) -> Self {
        Self {
            most: most.max(1e-6),
            values: Cow::Owned(values),
            colours: &ERROR_COLOURS,
            is_least_on_top: false,
            legend,
        }
    }

    /// The step of the colour scale at a sample.
    fn level(&self, index: usize) -> u16 {
        let last = self.values.len().saturating_sub(1);
        let value = self.values.get(index.min(last)).copied().unwrap_or(0.0);
        level_of(value / self.most)
    }

    /// The colour of a step of the scale.
    fn colour(&self, level: u16) -> RGBColor {
        colour(self.colours, f64::from(level) / f64::from(LEVELS - 1))
    }
}

/// The tool path from above, and from the front where Z moves; one scale for all directions.
pub(super) fn draw(area: &Area, motion: &Motion, colouring: &Colouring) -> Drawn<()> {
    let (x, y, z) = (
        extent(&motion.mm[X]),
        extent(&motion.mm[Y]),
        extent(&motion.mm[Z]),
    );
    let (_, height) = pixels(area);
    let (area, scale_area) = area.split_vertically((height - 52) * PX);
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
        draw_plane(&above, motion, colouring, (X, x.clone()), (Y, y))?;
        draw_plane(&below, motion, colouring, (X, x), (Z, z))?;
    } else {
        let mm_per_pixel = (length(&x) / across).max(length(&y) / whole) * room;
        let x = widened(&x, across * mm_per_pixel);
        let y = widened(&y, whole * mm_per_pixel);
        draw_plane(&area, motion, colouring, (X, x), (Y, y))?;
    }
    draw_scale(&scale_area, colouring)
}

/// The path seen along one direction.
fn draw_plane(
    area: &Area,
    motion: &Motion,
    colouring: &Colouring,
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
    let level = |index: usize| colouring.level(index);
    let mut strokes = Vec::new();
    let mut start = 0;
    for index in 1..points.len() {
        if index + 1 == points.len() || level(index) != level(start) {
            let stroke = simplified(&points[start..=index], pixel * 0.15);
            strokes.push((level(start), stroke));
            start = index;
        }
    }
    strokes.sort_by_key(|(level, _)| *level);
    if colouring.is_least_on_top {
        strokes.reverse();
    }
    chart.draw_series(strokes.into_iter().map(|(level, points)| {
        PathElement::new(points, colouring.colour(level).stroke_width(stroke(2)))
    }))?;
    Ok(())
}

/// The step of the colour scale for a share of the most.
fn level_of(share: f64) -> u16 {
    ((share * f64::from(LEVELS)) as u16).min(LEVELS - 1)
}

/// The colour for a share of the most.
fn colour(colours: &[(f64, f64, f64); 5], share: f64) -> RGBColor {
    let place = share.clamp(0.0, 1.0) * (colours.len() - 1) as f64;
    let index = (place as usize).min(colours.len() - 2);
    let (from, to) = (colours[index], colours[index + 1]);
    let mix = |from: f64, to: f64| (from + (to - from) * (place - index as f64)).round() as u8;
    RGBColor(mix(from.0, to.0), mix(from.1, to.1), mix(from.2, to.2))
}

/// The legend of the path's colours.
fn draw_scale(area: &Area, colouring: &Colouring) -> Drawn<()> {
    let (left, top) = ((MARGIN + LABELS_LEFT) * PX, 12 * PX);
    let (width, height) = (220 * PX, 10 * PX);
    for step in 0..LEVELS {
        let from = width * i32::from(step) / i32::from(LEVELS);
        let to = width * i32::from(step + 1) / i32::from(LEVELS) + PX / 2;
        area.draw(&Rectangle::new(
            [(left + from, top), (left + to, top + height)],
            colouring.colour(step).filled(),
        ))?;
    }
    let font = font(14).color(&FAINT_INK);
    for (line, text) in (0..).zip(colouring.legend.lines()) {
        let at = (left + width + 12 * PX, top + (17 * line - 3) * PX);
        area.draw(&Text::new(text.to_owned(), at, font.clone()))?;
    }
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
