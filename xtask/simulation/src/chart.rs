//! The look of all pictures: sizes, colours, the head, and charts with labelled axes.

mod line;

use std::{fs, ops::Range, path::Path};

use anyhow::{Context, Result, anyhow};
use plotters::{
    coord::{Shift, types::RangedCoordf64},
    prelude::*,
};

pub use line::{nearest, simplified, thinned, widened};

/// A part of a picture.
pub type Area<'a> = DrawingArea<SVGBackend<'a>, Shift>;
/// A chart in it.
pub type Chart<'a, 'b> =
    ChartContext<'a, SVGBackend<'b>, Cartesian2d<RangedCoordf64, RangedCoordf64>>;

/// Units of the drawing in one pixel: coordinates are whole numbers, and curves need finer ones.
pub const PX: i32 = 8;
/// Width of a picture.
pub const WIDTH: i32 = 1280;
/// Height of the title.
pub const HEAD: i32 = 64;
/// Room for axis labels.
pub const LABELS_LEFT: i32 = 62;
/// The same below.
pub const LABELS_BELOW: i32 = 44;
/// Room around everything.
pub const MARGIN: i32 = 18;

/// Colour of text.
pub const INK: RGBColor = RGBColor(38, 50, 66);
/// Colour of what matters less.
pub const FAINT_INK: RGBColor = RGBColor(106, 119, 137);
/// Colour of grids.
pub const GRID: RGBColor = RGBColor(229, 233, 239);
/// Colour of the ground.
pub const PAPER: RGBColor = RGBColor(253, 253, 254);
/// Colour of speed.
pub const SPEED: RGBColor = RGBColor(24, 99, 173);
/// Lines of this colour are dashed.
pub const DASHED: RGBColor = RGBColor(139, 150, 165);
/// What drawing gives.
pub type Drawn<T> = Result<T, Box<dyn std::error::Error>>;

/// Writes a file with what is painted on an area of so many pixels.
pub fn save(path: &Path, size: (i32, i32), paint: impl FnOnce(&Area) -> Drawn<()>) -> Result<()> {
    let name = path.display();
    let text = render(size, paint).with_context(|| format!("cannot draw {name}"))?;
    fs::write(path, text).with_context(|| format!("cannot write {name}"))
}

/// Returns what is painted on an area of so many pixels, as SVG.
pub fn render(
    (width, height): (i32, i32),
    paint: impl FnOnce(&Area) -> Drawn<()>,
) -> Result<String> {
    let mut text = String::new();
    let size = ((width * PX) as u32, (height * PX) as u32);
    let root = SVGBackend::with_string(&mut text, size).into_drawing_area();
    root.fill(&PAPER)
        .map_err(Into::into)
        .and_then(|()| paint(&root))
        .and_then(|()| root.present().map_err(Into::into))
        .map_err(|error| anyhow!("{error}"))?;
    drop(root);
    // As large on the screen as meant, with the finer units kept in the view box.
    let fine = format!(r#"width="{}" height="{}""#, size.0, size.1);
    let replacement = format!(
        r#"width="{width}" height="{height}" stroke-linecap="round" stroke-linejoin="round""#
    );
    let text = text.replacen(&fine, &replacement, 1);
    // One line with a pattern instead of one for each dash.
    let RGBColor(red, green, blue) = DASHED;
    let dashed = format!("stroke=\"#{red:02X}{green:02X}{blue:02X}\"");
    let pattern = format!("{dashed} stroke-dasharray=\"{} {}\"", 3 * PX, 4 * PX);
    Ok(text.replace(&dashed, &pattern))
}

/// Draws title and subtitle, and returns the area below them.
pub fn draw_head<'a>(root: &Area<'a>, title: &str, subtitle: &str) -> Drawn<Area<'a>> {
    let (head, body) = root.split_vertically(HEAD * PX);
    let style = font(24).style(FontStyle::Bold);
    let at = |y| ((MARGIN + 4) * PX, y * PX);
    head.draw(&Text::new(title.to_owned(), at(14), style.color(&INK)))?;
    let small = font(15).color(&FAINT_INK);
    head.draw(&Text::new(subtitle.to_owned(), at(43), small))?;
    Ok(body)
}

/// A font of so many pixels.
pub fn font(size: i32) -> FontDesc<'static> {
    ("sans-serif", size * PX).into_font()
}

/// The width of a line of so many pixels.
pub fn stroke(width: i32) -> u32 {
    (width * PX) as u32
}

/// The size of an area, pixels.
pub fn pixels(area: &Area) -> (i32, i32) {
    let (width, height) = area.dim_in_pixel();
    (width.cast_signed() / PX, height.cast_signed() / PX)
}

/// A chart with a thin grid and labelled axes; without a label for the lower axis, it has no numbers.
pub fn chart<'a, 'b>(
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
    let is_labelled = !labels[0].is_empty();
    let below = if is_labelled { LABELS_BELOW } else { 0 };
    let mut chart = ChartBuilder::on(area)
        .margin_left(MARGIN * PX)
        .margin_right(MARGIN * PX)
        .margin_top(MARGIN * PX)
        .margin_bottom(6 * PX)
        .x_label_area_size(below * PX)
        .y_label_area_size(LABELS_LEFT * PX)
        .build_cartesian_2d(across, up)?;
    let (_, height) = pixels(area);
    chart
        .configure_mesh()
        .set_all_tick_mark_size(5 * PX)
        .set_tick_mark_size(
            LabelAreaPosition::Bottom,
            if is_labelled { 5 * PX } else { 0 },
        )
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
