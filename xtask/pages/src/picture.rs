//! A picture of a job that moves: the path as it is cut, coloured by its speed, and the speed over time.
//!
//! It moves by itself wherever a browser shows it, and has no script. Where nothing moves, all is drawn.

use std::fmt::Write as _;

use common::text::duration;
use leadscrew::axis::{LETTERS, LINEAR};
use simulation::chart::thinned;
use simulation::{Job, Waypoint};

const WIDTH: f64 = 960.0;
const HEIGHT: f64 = 540.0;
/// Left, top, right and bottom of the path, and of the curve.
const PATH: [f64; 4] = [40.0, 70.0, 920.0, 420.0];
const CURVE_FRAME: [f64; 4] = [40.0, 450.0, 920.0, 520.0];
/// One looks from a corner, down: cosine and sine of the angle about the vertical, and above the horizon.
const TURN: [f64; 2] = [0.8, -0.6];
const TILT: [f64; 2] = [0.6, 0.8];
/// Colours from standstill to the fastest feed, as in the page.
const GRADIENT: [&str; 5] = ["#3155c4", "#1c9fb5", "#4fb548", "#e9b52c", "#d6402b"];
const RAPID: u64 = 1;
const FEED: u64 = 2;
/// How long the job takes in the picture, at least and at most, and what comes behind it, s.
const PLAYED_S: (f64, f64) = (4.0, 12.0);
const REST_S: f64 = 2.0;
/// How far a point may be off, pixels, and a second of the picture in pixels.
const OFF: f64 = 0.3;
const SECOND: f64 = 30.0;
/// Most points and runs: a picture stays small.
const POINTS: usize = 3000;
const RUNS: usize = 300;

const STYLE: &str = "<style>
text { font: 15px system-ui, sans-serif } path { fill: none; stroke-linejoin: round }
.page { fill: #fbfbfa } .text { fill: #1d2126; font-weight: bold } .faint { fill: #656d76 } .tool { fill: #1d2126; stroke: #fbfbfa }
.coming { stroke: #c9ced4 } .rapid { stroke: #7d8590 } .curve { stroke: #1863ad } .grid { stroke: #e0e3e7 }
@media (prefers-color-scheme: dark) {
.page { fill: #14171b } .text { fill: #e4e8ec } .faint { fill: #98a1ab } .tool { fill: #f3f5f7; stroke: #14171b }
.coming { stroke: #3a424b } .rapid { stroke: #8e97a1 } .curve { stroke: #5fa8ee } .grid { stroke: #2b3138 }
}
</style>
";

/// A point of the picture.
#[derive(Debug, Clone, Copy, PartialEq)]
struct PicturePoint {
    /// Part of the time of the picture.
    time: f64,
    x: f64,
    y: f64,
}

/// Pieces of the same colour, one behind the other.
#[derive(Debug)]
struct Run {
    /// Rapid, or the number of the colour; nothing for a standstill.
    stroke: Option<Stroke>,
    dots: Vec<PicturePoint>,
}

#[derive(Debug, Clone, Copy, PartialEq)]
enum Stroke {
    Rapid,
    Feed(usize),
}

/// Returns the picture of a job.
pub fn draw(job: &Job) -> String {
    let points = job.waypoints();
    let end_s = points.last().map_or(0.0, |point| point.time_s);
    let played_s = end_s.clamp(PLAYED_S.0, PLAYED_S.1);
    let whole_s = played_s + REST_S;
    let share = if end_s > 0.0 {
        played_s / whole_s / end_s
    } else {
        0.0
    };
    let runs = runs(&points, share, whole_s);
    let mut svg = format!(
        "<svg xmlns=\"http://www.w3.org/2000/svg\" viewBox=\"0 0 {WIDTH} {HEIGHT}\">\n{STYLE}\
         <rect class=\"page\" width=\"{WIDTH}\" height=\"{HEIGHT}\" rx=\"8\"/>\n"
    );
    head(&mut svg, job, &points);
    let moving = runs.iter().filter_map(|run| Some((run.stroke?, &run.dots)));
    for (stroke, dots) in moving.clone() {
        let dash = if stroke == Stroke::Rapid {
            " stroke-dasharray=\"4 4\""
        } else {
            ""
        };
        let _ = writeln!(
            svg,
            "<path class=\"coming\" d=\"{}\"{dash}/>",
            path_data(dots)
        );
    }
    for (stroke, dots) in moving {
        grow(&mut svg, stroke, dots, whole_s);
    }
    curve(&mut svg, &points, share, whole_s, played_s / whole_s);
    let dots: Vec<_> = runs
        .iter()
        .flat_map(|run| run.dots.iter().copied())
        .collect();
    if let Some(last) = dots.last() {
        let _ = writeln!(
            svg,
            "<g transform=\"translate({:.1} {:.1})\"><path class=\"tool\" d=\"M0 0L-8 -20H8Z\"/>{}</g>",
            last.x,
            last.y,
            moved(&dots, whole_s)
        );
    }
    svg + "</svg>\n"
}

/// The name, the size and the parts of the time.
fn head(svg: &mut String, job: &Job, points: &[Waypoint]) {
    let time = |is_wanted: &dyn Fn(u64) -> bool| {
        let pieces = points.windows(2).filter(|piece| is_wanted(piece[0].kind));
        pieces
            .map(|piece| piece[1].time_s - piece[0].time_s)
            .sum::<f64>()
    };
    let parts = [
        format!("{} lines", job.lines),
        duration(time(&|_| true)),
        format!("cutting {}", duration(time(&|kind| kind == FEED))),
        format!("rapids {}", duration(time(&|kind| kind == RAPID))),
    ];
    let name = job.title.replace('&', "&amp;").replace('<', "&lt;");
    let [left, .., right, _] = PATH;
    let _ = writeln!(
        svg,
        "<text class=\"text\" x=\"{left}\" y=\"38\">{name}</text>\n\
         <text class=\"faint\" x=\"{left}\" y=\"59\">{}</text>",
        parts.join(", ")
    );
    let fastest = fastest(points);
    let width = 36.0;
    for (number, colour) in (0..).zip(GRADIENT) {
        let x = right - width * (GRADIENT.len() as f64 - f64::from(number));
        let _ = writeln!(
            svg,
            "<rect x=\"{x}\" y=\"30\" width=\"{width}\" height=\"9\" fill=\"{colour}\"/>"
        );
    }
    let _ = writeln!(
        svg,
        "<text class=\"faint\" x=\"{right}\" y=\"59\" text-anchor=\"end\">feed, up to {fastest:.0} mm/min</text>"
    );
}

/// The fastest feed, mm/min.
fn fastest(points: &[Waypoint]) -> f64 {
    let feeds = points.windows(2).filter(|piece| piece[0].kind == FEED);
    feeds.fold(0.0, |most, piece| {
        piece[0].speed.max(piece[1].speed).max(most)
    })
}

/// The path as it is seen, in runs of one colour, with as few points as it needs.
fn runs(points: &[Waypoint], share: f64, whole_s: f64) -> Vec<Run> {
    let fastest = fastest(points).max(1.0);
    let stroke = |piece: &[Waypoint]| match piece[0].kind {
        0 => None,
        FEED => {
            let part = f64::midpoint(piece[0].speed, piece[1].speed) / fastest;
            Some(Stroke::Feed((part * 4.0).round().clamp(0.0, 4.0) as usize))
        }
        _ => Some(Stroke::Rapid),
    };
    let dots = seen(points, share);
    let mut least_s = 0.0;
    loop {
        let mut runs: Vec<Run> = Vec::new();
        for (piece, dots) in points.windows(2).zip(dots.windows(2)) {
            let stroke = stroke(piece);
            match runs.last_mut() {
                // A short one looks as the one before it.
                Some(run) if run.stroke == stroke || last_s(run, whole_s) < least_s => {
                    run.stroke = if last_s(run, whole_s) < least_s {
                        stroke
                    } else {
                        run.stroke
                    };
                    run.dots.push(dots[1]);
                }
                _ => runs.push(Run {
                    stroke,
                    dots: dots.to_vec(),
                }),
            }
        }
        if runs.len() > RUNS {
            least_s = f64::max(2.0 * least_s, 0.01);
            continue;
        }
        return fewer(runs, whole_s);
    }
}

/// How long a run takes in the picture, s.
fn last_s(run: &Run, whole_s: f64) -> f64 {
    let ends = run.dots.first().zip(run.dots.last());
    ends.map_or(0.0, |(first, last)| (last.time - first.time) * whole_s)
}

/// Leaves out what cannot be seen, and more where that is not enough.
fn fewer(mut runs: Vec<Run>, whole_s: f64) -> Vec<Run> {
    let mut off = OFF;
    loop {
        for run in &mut runs {
            let place = |dot: &PicturePoint| [dot.x, dot.y, dot.time * whole_s * SECOND];
            run.dots = thinned(&run.dots, place, off);
        }
        if runs.iter().map(|run| run.dots.len()).sum::<usize>() <= POINTS || off > WIDTH {
            return runs;
        }
        off *= 2.0;
    }
}

/// The points on the picture: as large as there is room.
fn seen(points: &[Waypoint], share: f64) -> Vec<PicturePoint> {
    let flat: Vec<_> = points.iter().map(projected).collect();
    let bounds = |axis: usize| {
        let values = flat.iter().map(|at| at[axis]);
        values.fold((f64::MAX, f64::MIN), |(low, high), value| {
            (low.min(value), high.max(value))
        })
    };
    let ((left, right), (bottom, top)) = (bounds(0), bounds(1));
    let room = [PATH[2] - PATH[0], PATH[3] - PATH[1]];
    let scale = (room[0] / (right - left).max(1e-3)).min(room[1] / (top - bottom).max(1e-3));
    let middle = [
        f64::midpoint(PATH[0], PATH[2]),
        f64::midpoint(PATH[1], PATH[3]),
    ];
    let dots = points.iter().zip(&flat).map(|(point, at)| PicturePoint {
        time: point.time_s * share,
        x: middle[0] + (at[0] - f64::midpoint(left, right)) * scale,
        y: middle[1] - (at[1] - f64::midpoint(bottom, top)) * scale,
    });
    dots.collect()
}

/// Where a place is seen, right and up, mm: work on a rotary axis turns with it.
fn projected(point: &Waypoint) -> [f64; 2] {
    let [mut x, mut y, mut z] = [point.place[0], point.place[1], point.place[2]];
    for (letter, angle) in LETTERS.iter().zip(point.place).skip(LINEAR) {
        let (sin, cos) = angle.to_radians().sin_cos();
        match letter {
            b'A' => (y, z) = (y * cos + z * sin, z * cos - y * sin),
            b'B' => (z, x) = (z * cos + x * sin, x * cos - z * sin),
            _ => (x, y) = (x * cos + y * sin, y * cos - x * sin),
        }
    }
    let ([cos, sin], [up, level]) = (TURN, TILT);
    [x * cos + y * sin, (y * cos - x * sin) * up + z * level]
}

/// A line through dots.
fn path_data(dots: &[PicturePoint]) -> String {
    let mut text = String::new();
    for (number, dot) in dots.iter().enumerate() {
        let _ = write!(
            text,
            "{}{:.1} {:.1}",
            if number == 0 { "M" } else { "L" },
            dot.x,
            dot.y
        );
    }
    text
}

/// A run that is drawn as the time passes.
fn grow(svg: &mut String, stroke: Stroke, dots: &[PicturePoint], whole_s: f64) {
    let mut length = 0.0;
    let mut before = dots[0];
    let lengths = dots.iter().map(|dot| {
        length += (dot.x - before.x).hypot(dot.y - before.y);
        before = *dot;
        length
    });
    let lengths: Vec<_> = lengths.collect();
    if length < 0.05 {
        return;
    }
    let left = lengths
        .iter()
        .map(|path_data| format!("{:.3}", 1.0 - path_data / length));
    let attributes = match stroke {
        Stroke::Rapid => "class=\"rapid\"".to_owned(),
        Stroke::Feed(colour) => format!("stroke=\"{}\" stroke-width=\"2.4\"", GRADIENT[colour]),
    };
    let _ = writeln!(
        svg,
        "<path {attributes} d=\"{}\" pathLength=\"1\" stroke-dasharray=\"1 2\">{}</path>",
        path_data(dots),
        animate(
            "animate attributeName=\"stroke-dashoffset\"",
            dots,
            left,
            whole_s
        )
    );
}

/// A thing that is at each dot in its time.
fn moved(dots: &[PicturePoint], whole_s: f64) -> String {
    let places = dots.iter().map(|dot| format!("{:.1} {:.1}", dot.x, dot.y));
    let element = "animateTransform attributeName=\"transform\" type=\"translate\"";
    animate(element, dots, places, whole_s)
}

/// Values at the times of dots, with the first one before and the last one behind.
fn animate(
    element: &str,
    dots: &[PicturePoint],
    values: impl Iterator<Item = String>,
    whole_s: f64,
) -> String {
    let mut values: Vec<_> = values.collect();
    let times = dots.iter().map(|dot| format!("{:.5}", dot.time));
    let mut times: Vec<_> = times.collect();
    if let (Some(first), Some(last)) = (values.first().cloned(), values.last().cloned()) {
        values.insert(0, first);
        values.push(last);
        times.insert(0, "0".into());
        times.push("1".into());
    }
    format!(
        "<{element} dur=\"{whole_s:.1}s\" repeatCount=\"indefinite\" keyTimes=\"{}\" values=\"{}\"/>",
        times.join(";"),
        values.join(";")
    )
}

/// The speed over time, and where the time is.
fn curve(svg: &mut String, points: &[Waypoint], share: f64, whole_s: f64, played: f64) {
    let [left, top, right, bottom] = CURVE_FRAME;
    let most = points
        .iter()
        .fold(1.0, |most, point| f64::max(most, point.speed));
    let dot = |point: &Waypoint| PicturePoint {
        time: point.time_s * share,
        x: left + point.time_s * share / played * (right - left),
        y: bottom - point.speed / most * (bottom - top),
    };
    let dots: Vec<_> = points.iter().map(dot).collect();
    let mut off = OFF;
    let mut line = dots.clone();
    while line.len() > POINTS / 2 || off <= OFF {
        line = thinned(&dots, |dot| [dot.x, dot.y], off);
        off *= 2.0;
    }
    let _ = writeln!(
        svg,
        "<path class=\"grid\" d=\"M{left} {bottom}H{right}M{left} {top}H{right}\"/>\n\
         <path class=\"curve\" d=\"{}\"/>\n\
         <text class=\"faint\" x=\"{left}\" y=\"{:.0}\">speed, up to {most:.0} mm/min</text>",
        path_data(&line),
        top - 6.0
    );
    let ends = [0.0, played].map(|time| PicturePoint {
        time,
        x: left + time / played * (right - left),
        y: 0.0,
    });
    let _ = writeln!(
        svg,
        "<g transform=\"translate({right} 0)\"><path class=\"rapid\" d=\"M0 {top}V{bottom}\"/>{}</g>",
        moved(&ends, whole_s)
    );
}

#[cfg(test)]
mod tests {
    use leadscrew::{settings::Settings, sim::Simulator};
    use simulation::Recording;
    use simulation::{play, program::Program};

    use super::*;

    fn picture(text: &str) -> String {
        let settings = Settings::default();
        let mut simulator = Box::new(Simulator::new(&settings));
        let mut recording = Recording::new(simulator.session());
        let program = Program::from_reader("test".into(), std::io::Cursor::new(text.to_owned()));
        let run = play::Run::silent(&mut recording);
        let figures = play::stream(program, &mut simulator, run).expect("it comes to its end");
        draw(&recording.finish(&figures, "a <b> & c.nc", &settings))
    }

    /// The values of an attribute, all of its occurrences.
    fn values<'a>(svg: &'a str, name: &'a str) -> impl Iterator<Item = Vec<&'a str>> {
        let parts = svg.split(name).skip(1);
        parts.map(|part| {
            part.split('"')
                .next()
                .unwrap_or_default()
                .split(';')
                .collect()
        })
    }

    #[test]
    fn everything_moves_in_time_and_nothing_is_fetched() {
        let svg = picture("G0X10\nG1Y5F300\nG4P1\nG2X0Y5I-5F100\nG0Z9\n");
        let times: Vec<_> = values(&svg, "keyTimes=\"").collect();
        assert!(times.len() > 5, "{}", times.len());
        for (times, values) in times.iter().zip(values(&svg, "\" values=\"")) {
            assert_eq!(times.len(), values.len());
            let numbers: Vec<f64> = times
                .iter()
                .map(|time| time.parse().expect("a number"))
                .collect();
            assert!(numbers.is_sorted() && (numbers[0], numbers[numbers.len() - 1]) == (0.0, 1.0));
        }
        assert!(svg.contains("a &lt;b> &amp; c.nc") && svg.contains("prefers-color-scheme: dark"));
        let others = svg.replacen("http://www.w3.org/2000/svg", "", 1);
        for part in ["http", "<script", "href", "url("] {
            assert!(!others.contains(part), "{part}");
        }
        assert!(!svg.contains("NaN") && !svg.contains("inf"));
    }

    #[test]
    fn a_picture_stays_small_whatever_the_job() {
        let mut text = String::from("G91F9000\n");
        for line in 0..3000 {
            let (x, y) = (line % 7 - 3, line % 5 - 2);
            let _ = writeln!(text, "G{}X{x}Y{y}Z{}", line % 2, (line % 3 - 1) * 2);
        }
        let svg = picture(&text);
        assert!(svg.len() < 300_000, "{}", svg.len());
        assert!(svg.matches("<animate ").count() > RUNS / 8);
        // Without any motion it is a picture all the same.
        assert!(picture("M3S100\n").ends_with("</svg>\n"));
    }
}
