//! Marks on the tool path: holes as rings from above and as their depth from the side, and programmed
//! contours with what the tool cuts beside them.

use std::collections::HashSet;

use leadscrew::model::Plane;
use plotters::prelude::*;
use simulation::chart::{Area, Chart, Drawn, PX, font, stroke};
use simulation::drilled_holes::{Hole, Holes};

use crate::{contour::Stretch, marks::Marks};

/// Colour of the marks, and of what is cut under compensation.
const MARK: RGBColor = RGBColor(176, 40, 110);
const REMOVED_COLOUR: RGBColor = RGBColor(234, 238, 243);
/// Radius of a ring, and half the width of the bars at a hole's ends, pixels.
const RING: i32 = 7;
const HOLE_BAR_PX: f64 = 6.0;
/// Cycles in a line of the legend.
const CYCLES_PER_LINE: usize = 5;

/// What the legend shows beside a text.
pub(super) enum Key {
    Hole,
    Contour,
    Removed,
}

impl Key {
    /// Draws it between two places, around a height.
    pub(super) fn draw(&self, area: &Area, (left, right): (i32, i32), middle: i32) -> Drawn<()> {
        let line = [(left, middle), (right, middle)];
        match self {
            Self::Hole => {
                let style = MARK.stroke_width(stroke(2));
                area.draw(&Circle::new(
                    (right - 8 * PX, middle),
                    RING * PX * 2 / 3,
                    style,
                ))?;
            }
            Self::Contour => area.draw(&PathElement::new(line, MARK.stroke_width(stroke(1))))?,
            Self::Removed => area.draw(&PathElement::new(
                line,
                REMOVED_COLOUR.stroke_width(stroke(10)),
            ))?,
        }
        Ok(())
    }
}

/// What the marks mean, in lines of the legend; none without marks.
pub(super) fn legend(marks: &Marks) -> Vec<(Key, String)> {
    let counts = marks.holes.counts.iter();
    let parts: Vec<_> = counts
        .map(|(cycle, count)| format!("{count} × {}", cycle.word()))
        .collect();
    let lines = parts.chunks(CYCLES_PER_LINE).map(|line| line.join(", "));
    let mut legend: Vec<_> = lines
        .map(|line| (Key::Hole, format!("holes: {line}")))
        .collect();
    if !marks.contour.programmed.is_empty() {
        legend.push((Key::Contour, "programmed contour (G41, G42)".into()));
        let mut diameters: Vec<_> = marks
            .contour
            .removed
            .iter()
            .map(|removed| removed.diameter)
            .collect();
        diameters.dedup();
        let names: Vec<_> = diameters.iter().take(4).map(ToString::to_string).collect();
        let text = format!("cut there by a tool of {} mm", names.join(", "));
        legend.push((Key::Removed, text));
    }
    legend
}

/// Draws what lies below the path: what is cut under compensation, as wide as the tool.
pub(super) fn draw_removed(chart: &mut Chart, marks: &Marks, axes: [usize; 2]) -> Drawn<()> {
    let (width, _) = chart.plotting_area().dim_in_pixel();
    let range = chart.x_range();
    let units_per_mm = f64::from(width) / (range.end - range.start);
    for removed in in_plane(&marks.contour.removed, axes) {
        let width = (removed.diameter * units_per_mm).round() as u32;
        chart.draw_series([PathElement::new(
            places(removed, axes),
            REMOVED_COLOUR.stroke_width(width),
        )])?;
    }
    Ok(())
}

/// Draws what lies on the path in the plane of two axes; the first hole of each cycle has its name.
pub(super) fn draw(chart: &mut Chart, marks: &Marks, axes: [usize; 2], pixel: f64) -> Drawn<()> {
    for programmed in in_plane(&marks.contour.programmed, axes) {
        let style = MARK.stroke_width(stroke(1));
        chart.draw_series([PathElement::new(places(programmed, axes), style)])?;
    }
    draw_holes(chart, &marks.holes, axes, pixel)
}

fn in_plane(all: &[Stretch], [first, second]: [usize; 2]) -> impl Iterator<Item = &Stretch> {
    let is_visible = move |plane: Plane| {
        let (one, other, _) = plane.axes();
        [one.min(other), one.max(other)] == [first, second]
    };
    all.iter().filter(move |stretch| is_visible(stretch.plane))
}

fn places(stretch: &Stretch, [first, second]: [usize; 2]) -> Vec<(f64, f64)> {
    let points = stretch.points.iter();
    points.map(|point| (point[first], point[second])).collect()
}

fn draw_holes(
    chart: &mut Chart,
    holes: &Holes,
    [first, second]: [usize; 2],
    pixel: f64,
) -> Drawn<()> {
    let place = |at: &[f64]| (at[first], at[second]);
    let cell = |(x, y): (f64, f64)| ((x / pixel).round() as i64, (y / pixel).round() as i64);
    let mut drawn = HashSet::new();
    let mut before = None;
    for Hole { cycle, top, bottom } in &holes.holes {
        let [top, bottom] = [top, bottom].map(|end| place(end));
        if drawn.insert([cell(top), cell(bottom)]) {
            draw_hole(chart, top, bottom, pixel)?;
        }
        // What begins or ends there has its name above the ring.
        let above = if cell(top) == cell(bottom) {
            -10.0
        } else {
            19.0
        };
        if before.replace(*cycle) != Some(*cycle) {
            let at = (top.0 - 12.0 * pixel, top.1 + above * pixel);
            let style = font(13).style(FontStyle::Bold).color(&MARK);
            chart.draw_series([Text::new(cycle.word(), at, style)])?;
        }
    }
    Ok(())
}

/// Draws a ring where the ends of a hole lie behind each other, else a bar at each end.
fn draw_hole(chart: &mut Chart, top: (f64, f64), bottom: (f64, f64), pixel: f64) -> Drawn<()> {
    let style = MARK.stroke_width(stroke(2));
    let (dx, dy) = (bottom.0 - top.0, bottom.1 - top.1);
    let length = dx.hypot(dy);
    if length < pixel {
        chart.draw_series([Circle::new(top, RING * PX, style)])?;
        return Ok(());
    }
    let across = (
        -dy / length * HOLE_BAR_PX * pixel,
        dx / length * HOLE_BAR_PX * pixel,
    );
    chart.draw_series([top, bottom].map(|(x, y)| {
        let ends = [(x - across.0, y - across.1), (x + across.0, y + across.1)];
        PathElement::new(ends, style)
    }))?;
    Ok(())
}
