//! The picture as a file, in the look of all pictures.

use std::{io::Write as _, ops::Range};

use anyhow::{Context, Result};
use plotters::prelude::*;
use simulation::chart::{
    Area, Drawn, FAINT_INK, HEAD, LABELS_BELOW, LABELS_LEFT, MARGIN, PX, SPEED, WIDTH, chart,
    draw_head, pixels, simplified, stroke, widened,
};
use simulation::output::Output;

use crate::picture::{Picture, Point};

/// Height of what is below the head.
const BODY: i32 = 656;
/// Width of the part that shows the path.
const PATH_WIDTH: i32 = 640;
/// Room around the path.
const ROOM: f64 = 1.1;
/// What is nearer to a line is left out of it, pixels.
const TOLERANCE: f64 = 0.1;
/// Radius of the last point, pixels.
const DOT: i32 = 5;

/// Draws the picture into a file.
pub(crate) fn save(mut output: Output, picture: &Picture) -> Result<()> {
    let text = simulation::chart::render((WIDTH, HEAD + BODY), |root| {
        let body = draw_head(root, &picture.title, &extents(picture))?;
        let (left, right) = body.split_horizontally(PATH_WIDTH * PX);
        draw_path(&left, picture)?;
        draw_speed(&right, picture.speeds())
    })?;
    output
        .write_all(text.as_bytes())
        .context("cannot write the picture")?;
    output.finish()
}

/// The extents of the path in words: `X -800 to 800 mm, Y …`.
pub(crate) fn extents(picture: &Picture) -> String {
    let (now, unit) = (picture.now(), picture.unit);
    let axes = ["X", "Y"].iter().enumerate().map(|(axis, letter)| {
        let (low, high) = (now.extents.low[axis], now.extents.high[axis]);
        // As many digits as there are, and no minus before nothing.
        let digits = |value: f64| (value * 1000.0).round() / 1000.0 + 0.0;
        format!("{letter} {} to {} {unit}", digits(low), digits(high))
    });
    axes.collect::<Vec<_>>().join(", ")
}

fn draw_path(area: &Area, picture: &Picture) -> Drawn<()> {
    let (width, height) = pixels(area);
    let extents = &picture.now().extents;
    let ranges = [0, 1].map(|axis| extents.low[axis]..extents.high[axis]);
    let length = |range: &Range<f64>| range.end - range.start;
    let across = f64::from(width - LABELS_LEFT - 2 * MARGIN);
    let up = f64::from(height - LABELS_BELOW - MARGIN);
    let pixel = (length(&ranges[0]) / across).max(length(&ranges[1]) / up) * ROOM;
    let pixel = if pixel > 0.0 { pixel } else { 1.0 / across };
    let labels = ["X", "Y"].map(|letter| format!("{letter}, {}", picture.unit));
    let [x, y] = &ranges;
    let mut chart = chart(
        area,
        widened(x, across * pixel),
        widened(y, up * pixel),
        &labels,
    )?;
    let above: Vec<_> = picture.path().iter().map(|[x, y, _]| (*x, *y)).collect();
    let line = simplified(&above, [pixel; 2], TOLERANCE);
    let last = line.last().copied();
    chart.draw_series([PathElement::new(line, SPEED.stroke_width(stroke(2)))])?;
    chart.draw_series(last.map(|at| Circle::new(at, DOT * PX, SPEED.filled())))?;
    Ok(())
}

fn draw_speed(area: &Area, speeds: &[Point]) -> Drawn<()> {
    let (above, _) = area.split_vertically(BODY / 2 * PX);
    let duration = speeds.last().map_or(1.0, |(time, _)| time.max(1.0));
    let greatest = speeds.iter().map(|(_, speed)| *speed).fold(1.0, f64::max);
    let labels = ["time, s".to_owned(), "speed, mm/min".to_owned()];
    let mut chart = chart(&above, 0.0..duration, 0.0..greatest * ROOM, &labels)?;
    let line = speeds.to_vec();
    chart.draw_series([PathElement::new(line, FAINT_INK.stroke_width(stroke(1)))])?;
    Ok(())
}

#[cfg(test)]
mod tests {
    use super::*;

    #[test]
    fn a_picture_has_its_extents_and_axes() {
        let mut picture = Picture::default();
        picture.title = "pico.nc".into();
        picture.measure_in("step");
        for index in 0..=8 {
            let angle = f64::from(index) * std::f64::consts::FRAC_PI_4;
            picture.move_to([800.0 * angle.cos(), -0.0001, 0.0]);
        }
        let folder = tempfile::tempdir().unwrap();
        let path = folder.path().join("out.svg");
        let output = || Output::create(&path).unwrap();
        save(output(), &picture).unwrap();
        let text = std::fs::read_to_string(&path).unwrap();
        for part in [
            "pico.nc",
            "X -800 to 800 step, Y 0 to 0 step",
            "X, step",
            "time, s",
            "<circle",
        ] {
            assert!(text.contains(part), "{part}");
        }
        save(output(), &Picture::default()).unwrap();
    }
}
