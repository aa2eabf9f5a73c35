//! The picture of a measurement: how long tasks waited and took, and the bounds.
//!
//! Both scales are logarithmic: a single late activation has to be seen among a million.

use std::path::Path;

use anyhow::{Result, ensure};
use plotters::prelude::*;
use simulation::chart::{
    Area, Drawn, FAINT_INK, GRID, HEAD, INK, LABELS_BELOW, MARGIN, PX, SPEED, WIDTH, draw_head,
    font, pixels, save, stroke,
};

use super::outcome::{Measured, Outcome, Quantity};

/// Height of a task's row.
const ROW: i32 = 156;
/// Width of the names of the tasks.
const NAMES: i32 = 150;
/// Room for the counts.
const COUNTS: i32 = 46;
const EXECUTION: RGBColor = RGBColor(34, 139, 94);
const BOUND: RGBColor = RGBColor(205, 66, 70);
/// The drawn distribution of each task, and its colour.
const COLUMNS: [(&str, RGBColor); 2] = [("latency", SPEED), ("execution", EXECUTION)];

/// Draws a picture.
pub(crate) fn draw(path: &Path, outcome: &Outcome) -> Result<()> {
    let tasks: Vec<_> = outcome
        .tasks
        .iter()
        .filter(|measured| measured.quantities().next().is_some())
        .collect();
    ensure!(
        !tasks.is_empty(),
        "there is nothing to draw: no task has run"
    );
    let rows: Vec<_> = (1..)
        .map(|row| row * ROW)
        .zip(&tasks)
        .map(|(end, _)| end)
        .collect();
    let height = HEAD + MARGIN + rows.last().unwrap_or(&0);
    save(path, (WIDTH, height), |root| {
        let unit = outcome.clock.unit.name();
        let subtitle = format!(
            "{unit} from release to start (left), and taken by the task itself (right); \
             the bounds are cycles"
        );
        let body = draw_head(root, &outcome.subject, &subtitle)?;
        let scales = COLUMNS.map(|(name, _)| {
            let each = tasks.iter().filter_map(|measured| quantity(measured, name));
            scale(each)
        });
        let row_ends: Vec<_> = rows.iter().map(|end| end * PX).collect();
        for (row, measured) in body
            .split_by_breakpoints([0; 0], row_ends)
            .iter()
            .zip(&tasks)
        {
            let (names, charts) = row.split_horizontally(NAMES * PX);
            draw_name(&names, measured)?;
            let half = (WIDTH - NAMES) / 2;
            let (left, right) = charts.split_horizontally(half * PX);
            for ((area, column), scale) in [left, right].iter().zip(COLUMNS).zip(scales) {
                draw_panel(area, quantity(measured, column.0), column.1, scale)?;
            }
        }
        Ok(())
    })
}

fn quantity<'a>(measured: &'a Measured, name: &str) -> Option<Quantity<'a>> {
    measured.quantities().find(|quantity| quantity.name == name)
}

/// A scale that everything in a column fits into.
fn scale<'a>(quantities: impl Iterator<Item = Quantity<'a>>) -> (f64, f64) {
    let (mut low, mut high) = (f64::INFINITY, 1.0_f64);
    for quantity in quantities {
        let summary = quantity.values.summary();
        let bound = quantity.comparison.map_or(0, |comparison| comparison.bound);
        low = low.min(summary.min.max(1) as f64);
        high = high.max(summary.max.max(bound) as f64);
    }
    (low.min(high) * 0.7, high * 1.6)
}

/// The task's name and its number of activations.
fn draw_name(area: &Area, measured: &Measured) -> Drawn<()> {
    let style = font(17).style(FontStyle::Bold).color(&INK);
    let at = |y| ((MARGIN + 4) * PX, y * PX);
    area.draw(&Text::new(measured.task.name.clone(), at(12), style))?;
    let small = font(13).color(&FAINT_INK);
    let lines = [
        format!("{} activations", measured.task.activations),
        format!("{} recorded", measured.task.recorded),
    ];
    for (line, y) in lines.into_iter().zip([36, 54]) {
        area.draw(&Text::new(line, at(y), small.clone()))?;
    }
    Ok(())
}

/// One histogram with its bound.
fn draw_panel(
    area: &Area,
    quantity: Option<Quantity>,
    colour: RGBColor,
    (low, high): (f64, f64),
) -> Drawn<()> {
    let Some(quantity) = quantity else {
        let text = "release not known, or preempted where records were dropped";
        let style = font(13).color(&FAINT_INK);
        area.draw(&Text::new(text, (COUNTS * PX, 52 * PX), style))?;
        return Ok(());
    };
    let classes = quantity.values.classes(4);
    let most = classes.iter().map(|class| class.count).max().unwrap_or(1) as f64;
    let mut chart = ChartBuilder::on(area)
        .margin_right(MARGIN * PX)
        .margin_top(26 * PX)
        .x_label_area_size((LABELS_BELOW - 20) * PX)
        .y_label_area_size(COUNTS * PX)
        .build_cartesian_2d((low..high).log_scale(), (0.7..most * 3.0).log_scale())?;
    chart
        .configure_mesh()
        .set_all_tick_mark_size(4 * PX)
        .bold_line_style(GRID.stroke_width(stroke(1)))
        .light_line_style(TRANSPARENT)
        .axis_style(FAINT_INK.mix(0.6).stroke_width(stroke(1)))
        .label_style(font(12).color(&INK))
        .x_labels(8)
        .y_labels(4)
        .x_label_formatter(&|value: &f64| short(*value))
        .y_label_formatter(&|value: &f64| short(*value))
        .draw()?;
    chart.draw_series(
        classes
            .iter()
            .filter(|class| class.count != 0)
            .map(|class| {
                let from = (class.from as f64).max(low);
                let corners = [(from, 0.7), (class.to as f64, class.count as f64)];
                Rectangle::new(corners, colour.mix(0.75).filled())
            }),
    )?;
    if let Some(comparison) = quantity.comparison {
        let bound = comparison.bound as f64;
        let style = BOUND.stroke_width(stroke(2));
        let line = [(bound, 0.7), (bound, most * 3.0)];
        chart.draw_series(DashedLineSeries::new(line, 5 * PX, 4 * PX, style))?;
    }
    draw_caption(area, &quantity, colour)
}

/// The numbers above a histogram, and its bound at the right.
fn draw_caption(area: &Area, quantity: &Quantity, colour: RGBColor) -> Drawn<()> {
    use plotters::style::text_anchor::{HPos, Pos, VPos};
    let summary = quantity.values.summary();
    let name = font(13).style(FontStyle::Bold).color(&colour);
    area.draw(&Text::new(quantity.name, (COUNTS * PX, 4 * PX), name))?;
    let numbers = format!(
        "min {}, mean {:.1}, p99.9 {}, max {}",
        summary.min, summary.mean, summary.p999, summary.max
    );
    let style = font(13).color(&INK);
    area.draw(&Text::new(numbers, ((COUNTS + 72) * PX, 4 * PX), style))?;
    let Some(comparison) = quantity.comparison else {
        return Ok(());
    };
    let text = match comparison.above {
        Some(_) => format!("bound {}", comparison.bound),
        None => format!("bound {} (not compared)", comparison.bound),
    };
    let (width, _) = pixels(area);
    let style = font(13).color(&BOUND);
    let style = style.pos(Pos::new(HPos::Right, VPos::Top));
    area.draw(&Text::new(text, ((width - MARGIN) * PX, 4 * PX), style))?;
    Ok(())
}

/// A number with few characters.
fn short(value: f64) -> String {
    let value = value.round();
    if value >= 1e6 {
        format!("{}M", value / 1e6)
    } else if value >= 1e4 {
        format!("{}k", value / 1e3)
    } else {
        value.to_string()
    }
}
