//! The tool path, coloured by what happens along it, in one scale for all directions.

use std::{collections::HashSet, ops::Range};

use leadscrew::axis::{LETTERS, LINEAR, X, Y, Z};
use plotters::prelude::*;
use simulation::chart::{
    Area, Chart, DASHED, Drawn, FAINT_INK, INK, LABELS_BELOW, LABELS_LEFT, MARGIN, PX, chart, font,
    pixels, simplified, stroke, widened,
};

use super::{PATH_WIDTH, marks};
use crate::{
    marks::Marks,
    quality::Traces,
    samples::{Motion, Point},
};

/// Path colours from standstill to the highest speed.
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
/// The colour scale reaches at least to that many times what rounding to steps makes.
const ROUNDING: f64 = 3.0;
/// Height of the legend.
const LEGEND: i32 = 92;
/// Height of one line of it.
const ROW: i32 = 18;
/// Arrows along the path, at most, and the way between two at least, pixels.
const ARROWS: f64 = 24.0;
const ARROW_SPACING_PX: f64 = 90.0;

/// What colours the feed moves of a path.
pub(super) struct Colouring {
    /// A value for each point of the path.
    values: Vec<f64>,
    /// The value at the end of the colours.
    most: f64,
    colours: &'static [(f64, f64, f64); 5],
    /// Whether the least value is drawn on top.
    is_least_on_top: bool,
    /// What the values are, in up to two lines.
    legend: String,
}

impl Colouring {
    /// By the speed; slow moves lie on top of fast ones.
    pub(super) fn of_speed(motion: &Motion) -> Self {
        let most = motion.speeds[0].greatest().max(1e-6);
        Self {
            values: motion.path.iter().map(|point| point.speed).collect(),
            most,
            colours: &SPEED_COLOURS,
            is_least_on_top: true,
            legend: format!("feed moves, 0 to {:.0} mm/min", most * 60.0),
        }
    }

    /// By the greatest distance from the programmed path around each point.
    pub(super) fn of_deviation(motion: &Motion, traces: &Traces) -> Self {
        let at = |point: &Point| traces.deviation.greatest_at(point.seconds).unwrap_or(0.0);
        let greatest = traces.deviation.greatest();
        // What rounding makes keeps its cool colours.
        let most = greatest.max(ROUNDING * traces.floor_mm).max(1e-6);
        Self {
            values: motion.path.iter().map(at).collect(),
            most,
            colours: &ERROR_COLOURS,
            is_least_on_top: false,
            legend: format!(
                "0 to {:.1} µm from the programmed path\n{:.1} µm at most; rounding to steps makes {:.1} µm",
                most * 1000.0,
                greatest * 1000.0,
                traces.floor_mm * 1000.0
            ),
        }
    }

    #[cfg(test)]
    pub(super) fn legend(&self) -> &str {
        &self.legend
    }

    /// The step of the colour scale at a point.
    fn level(&self, index: usize) -> u16 {
        let share = self.values[index] / self.most;
        ((share * f64::from(LEVELS)) as u16).min(LEVELS - 1)
    }

    /// The colour of a step of the scale.
    fn colour(&self, level: u16) -> RGBColor {
        let last = self.colours.len() - 1;
        let place = f64::from(level) / f64::from(LEVELS - 1) * last as f64;
        let index = (place as usize).min(last - 1);
        let (from, to) = (self.colours[index], self.colours[index + 1]);
        let mix = |from: f64, to: f64| (from + (to - from) * (place - index as f64)).round() as u8;
        RGBColor(mix(from.0, to.0), mix(from.1, to.1), mix(from.2, to.2))
    }
}

/// The tool path from above, and from the front where Z moves; one scale for all directions.
pub(super) fn draw(
    area: &Area,
    motion: &Motion,
    marks: &Marks,
    colouring: &Colouring,
) -> Drawn<()> {
    let [x, y, z] = [X, Y, Z].map(|axis| extent(motion, marks, axis));
    let (_, height) = pixels(area);
    let more: i32 = marks::legend(marks).iter().map(|_| ROW).sum();
    let (area, legend) = area.split_vertically((height - LEGEND - more) * PX);
    let length = |range: &Range<f64>| range.end - range.start;
    let (width, height) = pixels(&area);
    let across = f64::from(width - LABELS_LEFT - 2 * MARGIN);
    let whole = f64::from(height - LABELS_BELOW - MARGIN);
    let room = 1.1;
    if motion.moves(Z) {
        let panels = whole - f64::from(LABELS_BELOW + MARGIN);
        // The part for Z is as high as Z needs, within reason.
        let wanted = length(&z) / (length(&y) + length(&z)).max(1e-9);
        let share = wanted.clamp(0.16, 0.6);
        let (up, front) = (panels * (1.0 - share), panels * share);
        let mm_per_pixel = (length(&x) / across)
            .max(length(&y) / up)
            .max(length(&z) / front)
            * room;
        let height = up as i32 + LABELS_BELOW + MARGIN;
        let (above, below) = area.split_vertically(height * PX);
        let x = widened(&x, across * mm_per_pixel);
        let y = widened(&y, up * mm_per_pixel);
        let z = widened(&z, front * mm_per_pixel);
        draw_plane(&above, motion, marks, colouring, (X, x.clone()), (Y, y))?;
        draw_plane(&below, motion, marks, colouring, (X, x), (Z, z))?;
    } else {
        let mm_per_pixel = (length(&x) / across).max(length(&y) / whole) * room;
        let x = widened(&x, across * mm_per_pixel);
        let y = widened(&y, whole * mm_per_pixel);
        draw_plane(&area, motion, marks, colouring, (X, x), (Y, y))?;
    }
    draw_legend(&legend, motion, marks, colouring)
}

/// The path seen along one direction.
fn draw_plane(
    area: &Area,
    motion: &Motion,
    marks: &Marks,
    colouring: &Colouring,
    (first, across): (usize, Range<f64>),
    (second, up): (usize, Range<f64>),
) -> Drawn<()> {
    let pixel = (across.end - across.start) / f64::from(PATH_WIDTH);
    let labels = [first, second].map(|axis| format!("{}, mm", char::from(LETTERS[axis])));
    let mut chart = chart(area, across, up, &labels)?;
    marks::draw_removed(&mut chart, marks, [first, second])?;
    let place = |point: &Point| (point.at[first], point.at[second]);
    let mut strokes = Vec::new();
    let mut start = 0;
    let level = |index: usize| {
        let is_feed = !motion.path[index].is_rapid;
        is_feed.then(|| colouring.level(index))
    };
    for index in 1..motion.path.len() {
        if index + 1 == motion.path.len() || level(index) != level(start) {
            let points: Vec<_> = motion.path[start..=index].iter().map(place).collect();
            strokes.push((level(start), simplified(&points, [pixel; 2], 0.15)));
            start = index;
        }
    }
    // Rapids lie below everything.
    strokes.sort_by_key(|(level, _)| match level {
        Some(level) if colouring.is_least_on_top => u16::MAX - level,
        Some(level) => level + 1,
        None => 0,
    });
    let mut drawn = HashSet::new();
    strokes.retain(|(level, points)| {
        let cells = cells(points, pixel).map(|cell| drawn.insert((*level, cell)));
        // Each has to be asked.
        cells.filter(|is_new| *is_new).count() > 0
    });
    chart.draw_series(strokes.into_iter().map(|(level, points)| {
        let style = match level {
            Some(level) => colouring.colour(level).stroke_width(stroke(2)),
            None => DASHED.stroke_width(stroke(1)),
        };
        PathElement::new(points, style)
    }))?;
    marks::draw(&mut chart, marks, [first, second], pixel)?;
    if second == Y {
        let points: Vec<_> = motion.path.iter().map(place).collect();
        let feeds: Vec<_> = motion.path.iter().map(|point| !point.is_rapid).collect();
        draw_arrows(&mut chart, &points, &feeds, pixel)?;
        draw_ends(&mut chart, &points, pixel)?;
    }
    Ok(())
}

/// The pixels that a line passes.
fn cells(points: &[(f64, f64)], pixel: f64) -> impl Iterator<Item = (i32, i32)> {
    points.windows(2).flat_map(move |pair| {
        let (dx, dy) = (pair[1].0 - pair[0].0, pair[1].1 - pair[0].1);
        let count = (dx.hypot(dy) / pixel).ceil().max(1.0);
        (0..=count as u32).map(move |part| {
            let share = f64::from(part) / count;
            let place =
                |from: f64, length_px: f64| ((from + length_px * share) / pixel).floor() as i32;
            (place(pair[0].0, dx), place(pair[0].1, dy))
        })
    })
}

/// Arrows along the feed moves, all over the path but not at the same places of passes that repeat.
fn draw_arrows(chart: &mut Chart, points: &[(f64, f64)], feeds: &[bool], pixel: f64) -> Drawn<()> {
    let spans = || {
        let pairs = points.windows(2).zip(&feeds[feeds.len().min(1)..]);
        let pairs = pairs.filter(|(_, is_feed)| **is_feed);
        pairs.map(|(pair, _)| (pair[1], (pair[1].0 - pair[0].0, pair[1].1 - pair[0].1)))
    };
    let length: f64 = spans().map(|(_, (x, y))| x.hypot(y)).sum();
    let spacing = (length / ARROWS).max(ARROW_SPACING_PX * pixel);
    let mut next = spacing / 2.0;
    let mut uneven = 0.0_f64;
    for ((x, y), (dx, dy)) in spans() {
        let length_px = dx.hypot(dy);
        next -= length_px;
        if next > 0.0 || length_px == 0.0 {
            continue;
        }
        uneven = (uneven + 0.618).fract();
        next += spacing * (0.5 + uneven);
        let (ahead, aside) = (
            (dx / length_px, dy / length_px),
            (-dy / length_px, dx / length_px),
        );
        let corner = |along: f64, across: f64| {
            let (along, across) = (along * pixel, across * pixel);
            (
                x + ahead.0 * along + aside.0 * across,
                y + ahead.1 * along + aside.1 * across,
            )
        };
        let corners = vec![corner(7.0, 0.0), corner(-5.0, 5.0), corner(-5.0, -5.0)];
        chart.draw_series([Polygon::new(corners, INK.mix(0.85))])?;
    }
    Ok(())
}

/// Where the path begins and ends.
fn draw_ends(chart: &mut Chart, points: &[(f64, f64)], pixel: f64) -> Drawn<()> {
    let (Some(start), Some(end)) = (points.first(), points.last()) else {
        return Ok(());
    };
    let is_closed = (end.0 - start.0).hypot(end.1 - start.1) < 12.0 * pixel;
    let (begins, ends) = if is_closed {
        ("start, end", "")
    } else {
        ("start", "end")
    };
    let radius = 5 * PX;
    let style = INK.stroke_width(stroke(2));
    chart.draw_series([Circle::new(*start, radius, INK.filled())])?;
    chart.draw_series([Circle::new(*end, 2 * radius, style)])?;
    for (at, text) in [(start, begins), (end, ends)] {
        let label_at = (at.0 + 13.0 * pixel, at.1 + 19.0 * pixel);
        let style = font(13).color(&INK);
        chart.draw_series([Text::new(text.to_owned(), label_at, style)])?;
    }
    Ok(())
}

/// The legend of the path, and how far each axis goes.
fn draw_legend(area: &Area, motion: &Motion, marks: &Marks, colouring: &Colouring) -> Drawn<()> {
    const WIDE: i32 = 220;
    let (left, top) = ((MARGIN + LABELS_LEFT) * PX, 10 * PX);
    let (width, height) = (WIDE * PX, 10 * PX);
    for step in 0..LEVELS {
        let from = width * i32::from(step) / i32::from(LEVELS);
        let to = width * i32::from(step + 1) / i32::from(LEVELS) + PX / 2;
        area.draw(&Rectangle::new(
            [(left + from, top), (left + to, top + height)],
            colouring.colour(step).filled(),
        ))?;
    }
    let style = font(14).color(&FAINT_INK);
    let texts = colouring.legend.lines().chain(["rapids"]);
    let mut below = top - 3 * PX;
    for text in texts {
        let at = (left + width + 12 * PX, below);
        area.draw(&Text::new(text.to_owned(), at, style.clone()))?;
        below += ROW * PX;
    }
    let line = below - 10 * PX;
    let ends = [(left, line), (left + width, line)];
    area.draw(&PathElement::new(ends, DASHED.stroke_width(stroke(1))))?;
    for (key, text) in marks::legend(marks) {
        key.draw(area, (left, left + width), below + 7 * PX)?;
        let at = (left + width + 12 * PX, below);
        area.draw(&Text::new(text, at, style.clone()))?;
        below += ROW * PX;
    }
    let extents = motion.moving(0..LINEAR).map(|axis| {
        let (least, greatest) = motion.extents[axis];
        let letter = char::from(LETTERS[axis]);
        format!("{letter} {least:.3} to {greatest:.3}")
    });
    let extents = extents.collect::<Vec<_>>().join(", ");
    let text = format!("{extents} mm");
    area.draw(&Text::new(text, (left, below + 4 * PX), style))?;
    Ok(())
}

/// The range of an axis in which something is drawn, at least 1 µm wide.
fn extent(motion: &Motion, marks: &Marks, axis: usize) -> Range<f64> {
    let (least, greatest) = motion.extents[axis];
    let (from, to) = marks.contour.extent(axis).unwrap_or((least, greatest));
    let (least, greatest) = (least.min(from), greatest.max(to));
    if greatest > least {
        least..greatest
    } else {
        least - 1.0..greatest + 1.0
    }
}
