//! How much time is left, as the step rate grows; and where the processor's time goes.

use std::fmt::Write as _;

use schedule::Report;

use super::{
    grouped,
    svg::{At, Picture, Scale, number, round_up},
    timeline::colour,
};

const WIDTH: f64 = 1000.0;
const HEIGHT: f64 = 400.0;
const LEFT: f64 = 70.0;
const RIGHT: f64 = 160.0;
const BOTTOM: f64 = 52.0;
const TOP: f64 = 26.0;
/// Least distance of two names at the right, pixels.
const NAME: f64 = 17.0;

/// Share of its deadline that a task has left, by step rate.
pub(super) fn slack(report: &Report) -> String {
    let Some(last) = report.curve.last() else {
        return String::new();
    };
    let tick = round_up(f64::from(last.step_rate_hz) / 1000.0 / 10.0);
    let across = Scale {
        values: (
            0.0,
            (f64::from(last.step_rate_hz) / 1000.0 / tick).ceil() * tick,
        ),
        pixels: (LEFT, WIDTH - RIGHT),
    };
    let up = Scale {
        values: (0.0, 100.0),
        pixels: (HEIGHT - BOTTOM, TOP),
    };
    let mut picture = Picture::default();
    axes(&mut picture, across, up);
    limits(&mut picture, report, across);
    let mut names = Vec::new();
    for (index, task) in report.tasks.iter().enumerate() {
        let points = points(report, &task.name);
        if let Some(&(rate, percent)) = points.last() {
            let (x, y) = (across.at(rate), up.at(percent.max(0.0)));
            names.push((y, x, task.name.as_str(), index));
            let class = format!("curve {}", colour(index));
            picture.path(&class, &path(&points, across, up));
        }
    }
    label(&mut picture, names);
    picture.finish(WIDTH, HEIGHT, "Slack of each task against the step rate")
}

/// Step rate in kHz and slack in percent of the deadline, to where the deadline is missed.
fn points(report: &Report, task: &str) -> Vec<(f64, f64)> {
    let mut points = Vec::new();
    for point in &report.curve {
        let (Some(Some(slack)), Some(deadline)) =
            (point.slack_us.get(task), point.deadline_us.get(task))
        else {
            break;
        };
        let percent = slack / deadline * 100.0;
        points.push((f64::from(point.step_rate_hz) / 1000.0, percent));
        if percent < 0.0 {
            break;
        }
    }
    points
}

fn path(points: &[(f64, f64)], across: Scale, up: Scale) -> String {
    let mut path = String::new();
    for (index, (rate, percent)) in points.iter().enumerate() {
        let letter = if index == 0 { 'M' } else { 'L' };
        let at = (At(across.at(*rate)), At(up.at(percent.max(0.0))));
        let _ = write!(path, "{letter}{} {}", at.0, at.1);
    }
    path
}

fn axes(picture: &mut Picture, across: Scale, up: Scale) {
    let (left, right) = across.pixels;
    for tick in up.ticks(5.0) {
        let y = up.at(tick);
        let class = if tick == 0.0 { "zero" } else { "grid" };
        picture.line(class, (left, y), (right, y));
        picture.text("tick end", left - 8.0, y + 4.0, &format!("{tick:.0} %"));
    }
    for tick in across.ticks(10.0) {
        let x = across.at(tick);
        picture.text("tick middle", x, HEIGHT - BOTTOM + 18.0, &number(tick));
    }
    let middle = f64::midpoint(left, right);
    picture.text(
        "axis middle",
        middle,
        HEIGHT - 10.0,
        "step pulses of all axes together, kHz",
    );
    picture.text("axis", 8.0, 14.0, "slack, share of the deadline");
}

/// The proven limit, and the rate of the table.
fn limits(picture: &mut Picture, report: &Report, across: Scale) {
    let (top, bottom) = (TOP, HEIGHT - BOTTOM);
    let Some(&proven) = report.proven_step_rate_hz.get(&report.baud.to_string()) else {
        return;
    };
    let x = across.at(f64::from(proven) / 1000.0);
    picture.rectangle(
        "beyond",
        x,
        top,
        (across.pixels.1 - x).max(0.0),
        bottom - top,
    );
    picture.line("limit", (x, top - 8.0), (x, bottom));
    let text = format!("proven to {} kHz", number(f64::from(proven) / 1000.0));
    picture.text("limit-text end", x - 7.0, top - 2.0, &text);
    let table = across.at(f64::from(report.step_rate_hz) / 1000.0);
    if report.step_rate_hz != proven {
        picture.line("table-rate", (table, top + 6.0), (table, bottom));
    }
}

/// Names beside the curves' beginnings would hide them: at the right, in the order of their ends.
fn label(picture: &mut Picture, mut rows: Vec<(f64, f64, &str, usize)>) {
    rows.sort_by(|a, b| a.0.total_cmp(&b.0).then(a.3.cmp(&b.3)));
    let count = rows.len() as f64;
    let mut least = TOP + 4.0;
    for (place, (y, x, name, index)) in rows.into_iter().enumerate() {
        let most = HEIGHT - BOTTOM - (count - 1.0 - place as f64) * NAME;
        let row = (y + 4.0).max(least).min(most);
        least = row + NAME;
        let end = WIDTH - RIGHT + 18.0;
        let leader = format!("leader {}", colour(index));
        picture.line(&leader, (x, y), (end - 4.0, row - 4.0));
        picture.text(&format!("label {}", colour(index)), end, row, name);
    }
}

/// One bar: the share of the processor that each task can take at most.
pub(super) fn processor(report: &Report) -> String {
    let tasks = report.tasks.iter().enumerate();
    let shares: Vec<_> = tasks.filter(|(_, task)| task.share > 0.0).collect();
    if shares.is_empty() {
        return String::new();
    }
    let scale = Scale {
        values: (0.0, 1.0),
        pixels: (2.0, WIDTH - 2.0),
    };
    let mut picture = Picture::default();
    picture.rectangle("track", scale.at(0.0), 4.0, WIDTH - 4.0, 26.0);
    let mut x = 0.0;
    for (index, task) in shares {
        let (name, width) = (&task.name, task.share);
        let (from, to) = (scale.at(x), scale.at((x + width).min(1.0)));
        let hint = format!("{name}: {:.1} %", width * 100.0);
        picture.hinted(&hint, |picture| {
            picture.rectangle(
                &format!("run {}", colour(index)),
                from,
                4.0,
                to - from,
                26.0,
            );
        });
        if to - from > 70.0 {
            picture.text(
                "on-bar middle",
                f64::midpoint(from, to),
                22.0,
                &format!("{name} {:.0} %", width * 100.0),
            );
        }
        x += width;
    }
    let idle_share = (1.0 - x).max(0.0);
    let text = format!(
        "{:.0} % left for reading and planning G-code",
        idle_share * 100.0
    );
    if idle_share > 0.3 {
        picture.text("note middle", scale.at(x + idle_share / 2.0), 22.0, &text);
    } else {
        picture.text("note end", WIDTH - 4.0, 48.0, &text);
    }
    let height = if idle_share > 0.3 { 34.0 } else { 54.0 };
    let rate = grouped(report.step_rate_hz.into());
    picture.finish(
        WIDTH,
        height,
        &format!("Share of the processor at {rate} steps a second"),
    )
}

/// The stacks of all levels on top of each other, against the memory there is.
pub(super) fn stack(report: &Report) -> String {
    let most = report
        .stack_available_bytes
        .max(report.stack_worst_bytes)
        .max(1) as f64;
    let scale = Scale {
        values: (0.0, most),
        pixels: (2.0, WIDTH - 2.0),
    };
    let mut picture = Picture::default();
    picture.rectangle("track", 2.0, 24.0, WIDTH - 4.0, 34.0);
    let mut levels: Vec<_> = report.stack.iter().collect();
    levels.sort_by_key(|level| level.priority);
    let mut bytes = 0.0;
    let mut narrow = 0.0;
    for level in levels {
        let (from, to) = (scale.at(bytes), scale.at(bytes + level.bytes as f64));
        let task = report.tasks.iter().position(|task| task.name == level.task);
        let class = task.map_or("run rest".into(), |index| format!("run {}", colour(index)));
        let hint = format!(
            "priority {}, {}: {} bytes",
            level.priority,
            level.task,
            grouped(level.bytes)
        );
        picture.hinted(&hint, |picture| {
            picture.rectangle(&class, from, 24.0, (to - from).max(1.0), 34.0);
        });
        if to - from > 90.0 {
            picture.text("on-bar middle", f64::midpoint(from, to), 45.0, &level.task);
        } else if level.bytes > 0 {
            narrow = to;
        }
        bytes += level.bytes as f64;
    }
    let end = scale.at(bytes.min(most)).max(narrow);
    picture.line("limit", (end, 16.0), (end, 62.0));
    let worst = format!("{} bytes at worst", grouped(report.stack_worst_bytes));
    let anchor = if end > WIDTH / 2.0 {
        "limit-text end"
    } else {
        "limit-text"
    };
    picture.text(
        anchor,
        end + if end > WIDTH / 2.0 { -6.0 } else { 6.0 },
        15.0,
        &worst,
    );
    let room = format!("{} bytes there", grouped(report.stack_available_bytes));
    picture.text("note end", WIDTH - 4.0, 78.0, &room);
    picture.finish(WIDTH, 84.0, "Stack of every priority level")
}
