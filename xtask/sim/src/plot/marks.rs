//! Marks of the holes on the tool path: a ring from above, their depth from the side.

use std::collections::HashSet;

use chart::{Area, Chart, Drawn, PX, font, stroke};
use plotters::prelude::*;

use crate::holes::{Hole, Holes};

/// Colour of the marks.
const HOLE: RGBColor = RGBColor(176, 40, 110);
/// Radius of a ring, and half the width of the bars at a hole's ends, pixels.
const RING: i32 = 7;
const BAR: f64 = 6.0;
/// Cycles in a line of the legend.
const CYCLES_PER_LINE: usize = 5;

/// What the marks mean, in lines of the legend; none without holes.
pub(super) fn legend(holes: &Holes) -> Vec<String> {
    let counts = holes.counts.iter();
    let parts: Vec<_> = counts
        .map(|(cycle, count)| format!("{count} × {}", cycle.word()))
        .collect();
    let lines = parts.chunks(CYCLES_PER_LINE).map(|line| line.join(", "));
    lines.map(|line| format!("holes: {line}")).collect()
}

/// Draws what the legend shows beside its text, which is as high as `middle`.
pub(super) fn draw_key(area: &Area, middle: (i32, i32)) -> Drawn<()> {
    let style = HOLE.stroke_width(stroke(2));
    area.draw(&Circle::new(middle, RING * PX * 2 / 3, style))?;
    Ok(())
}

/// Draws the marks in the plane of two axes; the first hole of each cycle has its name.
pub(super) fn draw(
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
            draw_mark(chart, top, bottom, pixel)?;
        }
        // What begins or ends there has its name above the ring.
        let above = if cell(top) == cell(bottom) {
            -10.0
        } else {
            19.0
        };
        if before.replace(*cycle) != Some(*cycle) {
            let at = (top.0 - 12.0 * pixel, top.1 + above * pixel);
            let style = font(13).style(FontStyle::Bold).color(&HOLE);
            chart.draw_series([Text::new(cycle.word(), at, style)])?;
        }
    }
    Ok(())
}

/// Draws a ring where the ends of a hole lie behind each other, else a bar at each end.
fn draw_mark(chart: &mut Chart, top: (f64, f64), bottom: (f64, f64), pixel: f64) -> Drawn<()> {
    let style = HOLE.stroke_width(stroke(2));
    let (dx, dy) = (bottom.0 - top.0, bottom.1 - top.1);
    let length = dx.hypot(dy);
    if length < pixel {
        chart.draw_series([Circle::new(top, RING * PX, style)])?;
        return Ok(());
    }
    let across = (-dy / length * BAR * pixel, dx / length * BAR * pixel);
    chart.draw_series([top, bottom].map(|(x, y)| {
        let ends = [(x - across.0, y - across.1), (x + across.0, y + across.1)];
        PathElement::new(ends, style)
    }))?;
    Ok(())
}
