//! A chart over time. Where there is more than one value for a pixel, it is a band from the least to
//! the greatest.

use std::ops::Range;

use plotters::prelude::*;
use simulation::chart::{
    Area, Chart, DASHED, Drawn, FAINT_INK, INK, LABELS_LEFT, MARGIN, PX, chart, font, pixels,
    simplified, stroke,
};

use crate::series::Series;

/// Height of the times below the last strip.
pub(super) const TIMES: i32 = simulation::chart::LABELS_BELOW;
/// What is nearer to a curve is left out of it, pixels.
const TOLERANCE: f64 = 0.1;
/// A curve that goes up and down so often within each column, of a width in pixels, is drawn as a band,
/// where that is wide enough on average, pixels.
const SWINGS: f64 = 1.5;
const COLUMN: f64 = 2.0;
const WIDE: f64 = 8.0;
/// Width of a letter, pixels.
const LETTER: f64 = 7.0;

/// A word of the legend, behind a piece of the line that it names.
pub(super) struct Mark {
    line: Option<RGBColor>,
    text: String,
}

impl Mark {
    pub(super) fn line(colour: RGBColor, text: &str) -> Self {
        Self {
            line: Some(colour),
            text: text.into(),
        }
    }

    pub(super) fn text(text: &str) -> Self {
        Self {
            line: None,
            text: text.into(),
        }
    }
}

/// A quantity over time.
pub(super) struct Curve<'a> {
    colour: RGBColor,
    series: &'a Series,
    /// Units of the strip in one of the series.
    scale: f64,
}

impl<'a> Curve<'a> {
    pub(super) const fn new(colour: RGBColor, series: &'a Series, scale: f64) -> Self {
        Self {
            colour,
            series,
            scale,
        }
    }
}

/// A chart over time.
pub(super) struct Strip<'a> {
    pub(super) title: String,
    pub(super) marks: Vec<Mark>,
    pub(super) curves: Vec<Curve<'a>>,
    /// Values that are shown; others lie at its ends.
    pub(super) range: Range<f64>,
    /// A limit on both sides of 0.
    pub(super) limit: Option<f64>,
    /// Least height, pixels.
    pub(super) height: i32,
}

impl Default for Strip<'_> {
    fn default() -> Self {
        Self {
            title: String::new(),
            marks: Vec::new(),
            curves: Vec::new(),
            range: 0.0..1.0,
            limit: None,
            height: 86,
        }
    }
}

impl Strip<'_> {
    /// Draws it; the last one has the times.
    pub(super) fn draw(&self, area: &Area, duration_s: f64, is_last: bool) -> Drawn<()> {
        let time = if is_last { "time, s" } else { "" };
        let labels = [time.to_owned(), String::new()];
        let mut chart = chart(area, 0.0..duration_s, self.range.clone(), &labels)?;
        for limit in self.limit.iter().flat_map(|limit| [*limit, -*limit]) {
            let ends = [(0.0, limit), (duration_s, limit)];
            chart.draw_series([PathElement::new(ends, DASHED.stroke_width(stroke(1)))])?;
        }
        for curve in &self.curves {
            self.draw_curve(&mut chart, curve, duration_s)?;
        }
        self.draw_title(area)
    }

    fn draw_curve(&self, chart: &mut Chart, curve: &Curve, duration_s: f64) -> Drawn<()> {
        let (width, height) = chart.plotting_area().dim_in_pixel();
        let pixel = [
            duration_s * f64::from(PX) / f64::from(width),
            (self.range.end - self.range.start) * f64::from(PX) / f64::from(height),
        ];
        let shown = |value: f64| (value * curve.scale).clamp(self.range.start, self.range.end);
        let mut runs = curve.series.runs();
        let columns: Vec<_> = runs
            .iter()
            .map(|run| columns(run, COLUMN * pixel[0]))
            .collect();
        let width = |values: &[(f64, f64, f64)]| -> f64 {
            values
                .iter()
                .map(|value| shown(value.2) - shown(value.1))
                .sum()
        };
        let [fine, coarse] = [&runs, &columns].map(|runs| width(&runs.concat()));
        let count = columns.iter().flatten().count() as f64;
        let mut line = stroke(3) / 2;
        if fine > SWINGS * coarse && coarse > WIDE * pixel[1] * count {
            // Its edges would hide it.
            line = stroke(1) / 2;
            runs = columns;
        }
        let style = curve.colour.stroke_width(line);
        for run in runs {
            let edge = |of: &dyn Fn(&(f64, f64, f64)) -> f64| {
                let points = run.iter().map(|value| (value.0, shown(of(value))));
                simplified(&points.collect::<Vec<_>>(), pixel, TOLERANCE)
            };
            let (least, greatest) = (edge(&|value| value.1), edge(&|value| value.2));
            if least != greatest {
                let around = greatest.iter().chain(least.iter().rev()).copied();
                let band = Polygon::new(around.collect::<Vec<_>>(), curve.colour.mix(0.45));
                chart.draw_series([band])?;
                chart.draw_series([PathElement::new(least, style)])?;
            }
            chart.draw_series([PathElement::new(greatest, style)])?;
        }
        Ok(())
    }

    /// Draws what it is, and at the right end what its lines are.
    fn draw_title(&self, area: &Area) -> Drawn<()> {
        let (width, _) = pixels(area);
        let style = font(13).color(&INK);
        let at = ((MARGIN + LABELS_LEFT) * PX, PX);
        area.draw(&Text::new(self.title.clone(), at, style))?;
        let mut right = width - MARGIN;
        for mark in self.marks.iter().rev() {
            right -= (mark.text.chars().count() as f64 * LETTER) as i32;
            let style = font(13).color(&FAINT_INK);
            area.draw(&Text::new(mark.text.clone(), (right * PX, PX), style))?;
            if let Some(colour) = mark.line {
                let ends = [(right - 26, 8), (right - 6, 8)].map(|(x, y)| (x * PX, y * PX));
                area.draw(&PathElement::new(ends, colour.stroke_width(stroke(2))))?;
            }
            right -= 40;
        }
        Ok(())
    }
}

/// The least and the greatest values in each of some columns of a width.
fn columns(run: &[(f64, f64, f64)], width: f64) -> Vec<(f64, f64, f64)> {
    let groups = run.chunk_by(|a, b| (a.0 / width).floor() == (b.0 / width).floor());
    let column = |group: &[(f64, f64, f64)]| {
        let ends = group
            .iter()
            .fold((f64::INFINITY, f64::NEG_INFINITY), |ends, value| {
                (ends.0.min(value.1), ends.1.max(value.2))
            });
        (group[0].0, ends.0, ends.1)
    };
    groups.map(column).collect()
}
