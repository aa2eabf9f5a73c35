//! The figures to read.

use owo_colors::OwoColorize;

use super::{
    ArcFigures, AxisQuality, Corners, Quality, Smoothness, corners::CornerSpeed, follow::Deviation,
    sweep::Peak,
};
use common::text::{duration, separated};

/// Most corners that are printed one by one.
const PRINTED: usize = 6;

/// The figures, line by line.
pub(crate) fn text(quality: &Quality) -> String {
    let mut lines = vec![
        row("job time", &duration(quality.job_time_s)),
        String::new(),
        heads(quality).dimmed().to_string(),
    ];
    lines.extend(quality.axes.iter().map(of_axis));
    lines.extend([of_path(quality), String::new()]);
    lines.extend(of_limits(quality));
    lines.extend(of_arcs(&quality.arcs));
    if !quality.is_path_known {
        let why = "not known to its end: the machine refused a line, homed or probed";
        lines.push(row("path", why));
    }
    lines.extend(of_deviation(&quality.deviation));
    let feed = &quality.feed;
    let (at_feed, all) = (duration(feed.at_feed_s), duration(feed.feed_s));
    let part = feed.part * 100.0;
    lines.push(row(
        "at the feed",
        &format!("{at_feed} of {all}, {part:.1} %"),
    ));
    lines.extend(of_corners(&quality.corners));
    lines.join("\n")
}

/// A line of the summary.
fn row(name: &str, value: &str) -> String {
    format!("{:>16}  {value}", name.dimmed())
}

/// Whether the limits were kept, or which not.
fn of_limits(quality: &Quality) -> Vec<String> {
    if quality.violations.is_empty() {
        let kept = "kept: in moves, and by the jumps of the speed that corners make";
        return vec![row("limits", kept)];
    }
    let violations = quality.violations.iter();
    violations
        .map(|violation| row("limits", &violation.red().to_string()))
        .collect()
}

/// The jerk of arcs beside the limit, if any.
fn of_arcs(arcs: &ArcFigures) -> Option<String> {
    let (jerk, jump) = (arcs.jerk_mm_s3, arcs.jump_mm_s2);
    (jerk.max(jump) > 0.0).then(|| {
        row(
            "arcs",
            &format!("{jerk:.0} mm/s³ beside the limit, and {jump:.0} mm/s² at once at an end"),
        )
    })
}

fn of_deviation(deviation: &Deviation) -> [String; 3] {
    let (mm, steps, at_s) = (deviation.mm, deviation.steps, deviation.at_s);
    [
        row(
            "path deviation",
            &format!(
                "{:.4} mm (Hausdorff); rounding to steps alone makes {:.4} mm",
                deviation.hausdorff_mm, deviation.floor_mm
            ),
        ),
        row(
            "",
            &format!("{mm:.4} mm or {steps:.2} steps from the steps to the path, at {at_s:.3} s"),
        ),
        row(
            "",
            &format!("{:.4} mm from the path to the steps", deviation.left_out_mm),
        ),
    ]
}

fn heads(quality: &Quality) -> String {
    let has_jerk = quality
        .axes
        .iter()
        .any(|axis| axis.jerk_limit_mm_s3.is_some());
    let jerk_limit = if has_jerk { "  of limit" } else { "" };
    format!(
        "{:>16}  {:>14}  {:>12}  {:>25}  {:>25}\n{:>16}  {:>6}  {:>6}  {:>5} {:>6}  {:>9} {:>8} {:>6}  {:>9} {:>8} {:>6}{}",
        "",
        "interval error",
        "speed jump",
        "peak acceleration",
        "peak jerk",
        "",
        "rms",
        "99.9 %",
        "mm/s",
        "floor",
        "mm/s²",
        "of limit",
        "window",
        "mm/s³",
        "floor",
        "window",
        jerk_limit,
    )
}

fn of_axis(axis: &AxisQuality) -> String {
    let error = &axis.interval_error;
    let percent = |part: f64| format!("{:.2} %", part * 100.0);
    let known = |text: String| {
        if error.intervals == 0 {
            "-".to_owned()
        } else {
            text
        }
    };
    format!(
        "{:>16}  {:>6}  {:>6}  {}",
        axis.axis,
        known(percent(error.rms)),
        known(percent(error.p999)),
        of_motion(&axis.smoothness)
    )
}

fn of_path(quality: &Quality) -> String {
    format!(
        "{:>16}  {:>6}  {:>6}  {}",
        "path",
        "",
        "",
        of_motion(&quality.path)
    )
}

fn of_motion(motion: &Smoothness) -> String {
    let (jump, acceleration, jerk) = (
        &motion.speed_jump_mm_s,
        &motion.acceleration_mm_s2,
        &motion.jerk_mm_s3,
    );
    let limit = jerk
        .of_limit
        .map_or(String::new(), |_| format!("  {:>8}", part(jerk)));
    format!(
        "{:>5} {:>6}  {:>9} {:>8} {:>6}  {:>9} {:>8} {:>6}{limit}",
        jump_figure(jump),
        figure(jump, jump.floor, 2),
        figure(acceleration, acceleration.value, 1),
        part(acceleration),
        window(acceleration),
        figure(jerk, jerk.value, 0),
        figure(jerk, jerk.floor, 0),
        window(jerk),
    )
}

fn figure(peak: &Peak, value: f64, digits: usize) -> String {
    if peak.window_s > 0.0 {
        format!("{value:.digits$}")
    } else {
        "-".to_owned()
    }
}

/// A jump below its floor is none.
fn jump_figure(peak: &Peak) -> String {
    if peak.window_s > 0.0 && peak.value < peak.floor {
        "none".to_owned()
    } else {
        figure(peak, peak.value, 2)
    }
}

fn part(peak: &Peak) -> String {
    peak.of_limit
        .map_or("-".to_owned(), |part| format!("{:.1} %", part * 100.0))
}

fn window(peak: &Peak) -> String {
    figure(peak, peak.window_s * 1000.0, 1) + if peak.window_s > 0.0 { " ms" } else { "" }
}

fn of_corners(corners: &Corners) -> Vec<String> {
    let count = separated(corners.count);
    let (Some(slowest), Some(fastest)) = (corners.slowest_mm_s, corners.fastest_mm_s) else {
        return vec![row("corners", &count)];
    };
    let most = corners.most_of_allowed.map_or(String::new(), |part| {
        let percent = part * 100.0;
        format!("; at most {percent:.1} % of what the junction deviation allows")
    });
    let rounded = match corners.rounded {
        0 => String::new(),
        count => format!(", {} of them rounded", separated(count)),
    };
    let speeds = format!("{count}{rounded}, {slowest:.2} to {fastest:.2} mm/s{most}");
    let mut list: Vec<_> = corners.list.iter().collect();
    list.sort_by(|a, b| b.jump_mm_s.total_cmp(&a.jump_mm_s));
    let printed = list.iter().take(PRINTED).map(|corner| of_corner(corner));
    std::iter::once(row("corners", &speeds))
        .chain(printed)
        .collect()
}

fn of_corner(corner: &CornerSpeed) -> String {
    let letters = "XYZABC".chars().zip(&corner.at_mm);
    let at: Vec<_> = letters
        .map(|(letter, mm)| format!("{letter} {mm:.3}"))
        .collect();
    let allowed = if corner.is_rounded {
        String::new()
    } else {
        format!(" of {:.2}", corner.allowed_mm_s)
    };
    let jump = if corner.is_rounded {
        "rounded".to_owned()
    } else {
        format!("a jump of {:.2} mm/s", corner.jump_mm_s)
    };
    let (speed, turn) = (corner.speed_mm_s, corner.turn_degrees);
    let at = at.join(" ");
    row(
        "",
        &format!("{speed:.2}{allowed} mm/s, {turn:.0}° at {at}, {jump}"),
    )
}
