//! Cutter compensation on random contours: no step is nearer to a contour than the cutter's radius.
//!
//! The contours, their offset curves and the distances are computed by [`geometry`], which uses nothing
//! of the firmware.

mod geometry;
mod job;
mod misfit;

use leadscrew::{axis::Axes, settings::Settings, sim::Simulator};
use proptest::prelude::*;

use crate::support::{Recording, cases, stream, with};
use geometry::{Piece, Point, ToolPath, length, minus};
use job::{Form, wide_contours};
use misfit::MISFITS;

const STEPS_PER_MM: f64 = 80.0;
const STEP_MM: f64 = 1.0 / STEPS_PER_MM;
/// How far the steps may be from a point where a move ends: rounded on two axes.
const AT_END_MM: f64 = 1.5 * STEP_MM;
/// How much nearer to a contour than its radius a step may be.
const NEARER_MM: f64 = 2.0 * STEP_MM;

/// What the machine did.
struct Executed {
    /// The position after each step, steps.
    points: Vec<[i32; 2]>,
    answers: Vec<String>,
}

impl Executed {
    fn point(&self, index: usize) -> Point {
        self.points[index].map(|steps| f64::from(steps) * STEP_MM)
    }

    fn end(&self) -> Point {
        self.points
            .len()
            .checked_sub(1)
            .map_or([0.0; 2], |last| self.point(last))
    }
}

fn settings() -> Settings {
    with(&[STEPS_PER_MM], &[40_000.0], &[20_000.0])
}

/// Runs lines on the whole machine.
fn execute(form: Form, lines: &[String]) -> Executed {
    let program = lines.join("\n");
    let Recording {
        positions, answers, ..
    } = stream(Simulator::new(&settings()), &program, 1_000_000);
    let point = |(_, steps): (u64, Axes<i32>)| form.axes().map(|axis| steps[axis]);
    Executed {
        points: positions.into_iter().map(point).collect(),
        answers,
    }
}

/// No step is nearer to pieces of a contour than the tool's radius.
fn check_distances(
    executed: &Executed,
    contour: &[Piece],
    radius: f64,
) -> Result<(), TestCaseError> {
    let least = radius - NEARER_MM;
    for piece in contour {
        let mut index = 0;
        while index < executed.points.len() {
            let distance = piece.distance(executed.point(index));
            prop_assert!(
                distance >= least,
                "step {index} at {:?} is {distance} from {piece:?}, not {radius}",
                executed.point(index)
            );
            // An event is not longer than a step of both axes.
            index += ((distance - least) / STEP_MM / 2.0_f64.sqrt()) as usize + 1;
        }
    }
    Ok(())
}

/// Every move of a way has ended where it should, one after the other.
fn check_ends(executed: &Executed, tool_path: &ToolPath) -> Result<(), TestCaseError> {
    let mut index = 0;
    for (path, _) in tool_path {
        let end = path.end();
        let mut nearest = f64::INFINITY;
        while index < executed.points.len() {
            let distance = length(minus(executed.point(index), end));
            nearest = nearest.min(distance);
            if distance <= AT_END_MM {
                break;
            }
            index += ((distance - AT_END_MM) / STEP_MM / 2.0_f64.sqrt()) as usize + 1;
        }
        prop_assert!(
            index < executed.points.len(),
            "{nearest} mm from the end of {path:?}"
        );
    }
    Ok(())
}

#[test]
fn path_control_rounds_the_tool_path() {
    let form = Form {
        is_fine: false,
        is_inch: false,
        is_zx: false,
        has_depths: false,
        has_radii: false,
        has_rapids: false,
    };
    let executed = |control: &str, path: &[&str]| {
        let begin = ["F6000", control, "G0X0Y-10"];
        let lines: Vec<_> = begin.iter().chain(path).map(ToString::to_string).collect();
        let executed = execute(form, &lines);
        assert!(
            executed.answers.iter().all(|answer| answer == "ok"),
            "{lines:?}"
        );
        executed.points
    };
    // Into a corner, around one, and out.
    let contour = ["G42.1D2", "G1X0Y0", "Y20", "X20", "Y30", "G40", "G1X40Y40"];
    let tool_path = ["G1X1Y0", "Y19", "X20", "G3X21Y20J1", "G1Y30", "X40Y40"];
    let rounded = executed("G64P0.2", &contour);
    assert_eq!(rounded, executed("G64P0.2", &tool_path));
    assert_eq!(executed("G61", &contour), executed("G61", &tool_path));
    assert_ne!(rounded, executed("G61", &tool_path), "no corner is rounded");
}

proptest! {
    #![proptest_config(cases(2000))]

    #[test]
    fn a_compensated_tool_is_nowhere_nearer_to_a_contour_than_its_radius(job in wide_contours()) {
        let tool_path = job.tool_path().unwrap();
        let mut lines = job.program();
        let exit = job.exit();
        lines.extend(["G40".into(), job.form.text(&exit, false)]);
        let executed = execute(job.form, &lines);
        prop_assert!(executed.answers.iter().all(|answer| answer == "ok"), "{:?} {:#?}", executed.answers, lines);
        check_distances(&executed, &job.contour, job.radius)?;
        check_ends(&executed, &tool_path)?;
        prop_assert!(length(minus(executed.end(), exit.end())) <= AT_END_MM);
    }
}

proptest! {
    #![proptest_config(cases(500))]

    #[test]
    fn where_the_tool_does_not_fit_the_line_is_refused_and_the_tool_stays_before_the_corner(
        job in wide_contours(),
        misfit in prop::sample::select(&MISFITS[..]),
        size in 0.0..1.0_f64,
        angle in 0.0..1.0_f64,
    ) {
        let mut job = job;
        let tool_path = job.tool_path().unwrap();
        let contour = job.contour.clone();
        let stands = misfit.add(&mut job, &tool_path, size, angle);
        prop_assume!(stands.is_some());
        let stands = stands.unwrap();
        let lines = job.program();
        let executed = execute(job.form, &lines);
        let mut expected = vec!["ok"; lines.len() - 1];
        expected.push("error:92");
        prop_assert_eq!(&executed.answers, &expected, "{:#?}", lines);
        let distance = length(minus(executed.end(), stands));
        prop_assert!(distance <= AT_END_MM, "{} mm from {:?}", distance, stands);
        if job.contour.len() >= contour.len() {
            check_distances(&executed, &contour, job.radius)?;
        }
    }
}
