//! The picture of a run: tool path, speed and acceleration, drawn from the step trace.

use std::{fs, ops::Range, path::Path};

use anyhow::{Context, Result, anyhow};
use leadscrew::axis::{AXES, LETTERS, X, Y, Z};
use plotters::{
    coord::{Shift, types::RangedCoordf64},
    prelude::*,
};

use crate::{
    curves::{Curves, moves, simplified, thinned},
    trace::Motion,
};

type Area<'a> = DrawingArea<SVGBackend<'a>, Shift>;
type Chart<'a, 'b> = ChartContext<'a, SVGBackend<'b>, Cartesian2d<RangedCoordf64, RangedCoordf64>>;

/// Units of the drawing in one pixel: coordinates are whole numbers, and curves need finer ones.
const PX: i32 = 8;
const WIDTH: i32 = 1280;
const HEIGHT: i32 = 720;
/// Height of the title.
const HEAD: i32 = 64;
/// Width of the part that shows the path.
const PATH_WIDTH: i32 = 640;
/// Room for axis labels.
const LABELS_LEFT: i32 = 62;
const LABELS_BELOW: i32 = 44;
const MARGIN: i32 = 18;

const INK: RGBColor = RGBColor(38, 50, 66);
const FAINT_INK: RGBColor = RGBColor(106, 119, 137);
const GRID: RGBColor = RGBColor(229, 233, 239);
const PAPER: RGBColor = RGBColor(253, 253, 254);
const SPEED: RGBColor = RGBColor(24, 99, 173);
/// Colours of the axes' accelerations.
const AXIS_COLOURS: [RGBColor; 6] = [
    RGBColor(205, 66, 70),
    RGBColor(34, 139, 94),
    RGBColor(72, 92, 176),
    RGBColor(201, 132, 20),
    RGBColor(132, 76, 158),
    RGBColor(20, 140, 152),
];
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
}

/// Draws a picture.
pub(crate) fn draw(path: &Path, picture: &Picture) -> Result<()> {
    paint(path, picture)
        .map_err(|error| anyhow!("{error}"))
        .with_context(|| format!("cannot draw {}", path.display()))
}

type Drawn<T> = Result<T, Box<dyn std::error::Error>>;

fn paint(path: &Path, picture: &Picture) -> Drawn<()> {
    let curves = Curves::of(picture.motion);
    let mut text = String::new();
    let size = ((WIDTH * PX) as u32, (HEIGHT * PX) as u32);
    let root = SVGBackend::with_string(&mut text, size).into_drawing_area();
    root.fill(&PAPER)?;
    let (head, body) = root.split_vertically(HEAD * PX);
    let title = font(24).style(FontStyle::Bold);
    head.draw(&Text::new(
        picture.title.to_owned(),
        ((MARGIN + 4) * PX, 14 * PX),
        title.color(&INK),
    ))?;
    let small = font(15).color(&FAINT_INK);
    head.draw(&Text::new(
        picture.subtitle.to_owned(),
        ((MARGIN + 4) * PX, 43 * PX),
        small,
    ))?;
    let (left, right) = body.split_horizontally(PATH_WIDTH * PX);
    draw_path(&left, picture.motion, &curves)?;
    let (upper, lower) = right.split_vertically((HEIGHT - HEAD) / 2 * PX);
    draw_speed(&upper, picture.motion, &curves)?;
    draw_acceleration(&lower, picture, &curves)?;
    root.present()?;
    drop((root, head, body, left, right, upper, lower));
    // As large on the screen as meant, with the finer units kept in the view box.
    let fine = format!(r#"width="{}" height="{}""#, size.0, size.1);
    let meant = format!(
        r#"width="{WIDTH}" height="{HEIGHT}" stroke-linecap="round" stroke-linejoin="round""#
    );
    fs::write(path, text.replacen(&fine, &meant, 1))?;
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

/// The tool path from above, and from the front where Z moves; one scale for all directions.
fn draw_path(area: &Area, motion: &Motion, curves: &Curves) -> Drawn<()> {
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
    for limit in limits.into_iter().flat_map(|limit| [limit, -limit]) {
        let ends = [(0.0, limit), (motion.duration_s(), limit)];
        let style = FAINT_INK.mix(0.5).stroke_width(stroke(1));
        chart.draw_series(DashedLineSeries::new(ends, 3 * PX, 4 * PX, style))?;
    }
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

/// A font of so many pixels.
fn font(size: i32) -> FontDesc<'static> {
    ("sans-serif", size * PX).into_font()
}

/// The width of a line of so many pixels.
fn stroke(width: i32) -> u32 {
    (width * PX) as u32
}

/// The size of an area, pixels.
fn pixels(area: &Area) -> (i32, i32) {
    let (width, height) = area.dim_in_pixel();
    (width.cast_signed() / PX, height.cast_signed() / PX)
}

fn time_range(motion: &Motion) -> Range<f64> {
    0.0..motion.duration_s().max(0.001)
}

/// A chart with a thin grid and labelled axes.
fn chart<'a, 'b>(
    area: &Area<'b>,
    across: Range<f64>,
    up: Range<f64>,
    labels: &[String; 2],
) -> Drawn<Chart<'a, 'b>> {
    let digits = |range: &Range<f64>| {
        let step = (range.end - range.start) / 8.0;
        if step >= 1.0 {
            0
        } else {
            (-step.log10()).ceil().clamp(0.0, 4.0) as usize
        }
    };
    let (x_digits, y_digits) = (digits(&across), digits(&up));
    let mut chart = ChartBuilder::on(area)
        .margin_left(MARGIN * PX)
        .margin_right(MARGIN * PX)
        .margin_top(MARGIN * PX)
        .margin_bottom(6 * PX)
        .x_label_area_size(LABELS_BELOW * PX)
        .y_label_area_size(LABELS_LEFT * PX)
        .build_cartesian_2d(across, up)?;
    let (_, height) = pixels(area);
    chart
        .configure_mesh()
        .set_all_tick_mark_size(5 * PX)
        .bold_line_style(GRID.stroke_width(stroke(1)))
        .light_line_style(TRANSPARENT)
        .axis_style(FAINT_INK.mix(0.6).stroke_width(stroke(1)))
        .label_style(font(13).color(&INK))
        .axis_desc_style(font(14).color(&FAINT_INK))
        .x_labels(9)
        .y_labels((height as usize / 50).clamp(3, 10))
        .x_desc(&labels[0])
        .y_desc(&labels[1])
        .x_label_formatter(&|value| format!("{value:.x_digits$}"))
        .y_label_formatter(&|value| format!("{value:.y_digits$}"))
        .draw()?;
    Ok(chart)
}

#[cfg(test)]
mod tests {
    use std::{env, fs, process};

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
        let path = env::temp_dir().join(format!("leadscrew-plot-{}.svg", process::id()));
        let motion = drawing();
        let picture = Picture {
            title: "flower.nc",
            subtitle: "a test",
            motion: &motion,
            limits_mm_s2: [300.0; AXES],
        };
        draw(&path, &picture).unwrap();
        let text = fs::read_to_string(&path).unwrap();
        if env::var_os("KEEP_PLOT").is_none() {
            fs::remove_file(&path).unwrap();
        }
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
        let path = env::temp_dir().join(format!("leadscrew-empty-{}.svg", process::id()));
        let motion = Samples::default().finish([250.0; AXES]);
        let picture = Picture {
            title: "",
            subtitle: "",
            motion: &motion,
            limits_mm_s2: [10.0; AXES],
        };
        draw(&path, &picture).unwrap();
        fs::remove_file(&path).unwrap();
    }
}
