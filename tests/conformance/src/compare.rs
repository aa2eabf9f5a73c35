//! What counts as equal to a recording, and which deviations are by design.

use serde::Serialize;

use super::{
    deviation::{Deviation, of_answers, of_message, of_operator_message},
    exchange::{Report, differs_in_tool, is_rounded_otherwise, is_tie, tools},
    golden::{Run, Traits},
};
use simulation::{figures::Figures, play::Played, sender};

/// Longest time between two steps of Grbl: 16 bits of its timer at 16 MHz, and eight interrupts.
const GRBL_LONGEST_PERIOD_S: f64 = 65_536.0 * 8.0 / 16.0e6;
/// Grbl's time in a program of straight lines that ours may need.
const SLOWEST: f64 = 1.02;
/// Above it the recorded time depends on the sender.
const LOW_PLANNER: f64 = 0.02;

/// One difference.
#[derive(Debug, Clone, PartialEq, Serialize)]
pub(super) struct Difference {
    /// What differs.
    pub(super) what: &'static str,
    /// How, for the reader.
    pub(super) text: String,
    /// Why it may: a deliberate deviation.
    pub(super) by_design: Option<Deviation>,
}

/// How a comparison came out.
#[derive(Debug, Clone, Copy, PartialEq, Eq, Serialize)]
#[serde(rename_all = "snake_case")]
pub(super) enum Verdict {
    /// No difference.
    Agrees,
    /// Only deliberate deviations.
    ByDesign,
    /// Something else.
    Differs,
}

impl Verdict {
    pub(super) fn of(differences: &[Difference]) -> Self {
        if differences.is_empty() {
            Self::Agrees
        } else if differences.iter().all(|found| found.by_design.is_some()) {
            Self::ByDesign
        } else {
            Self::Differs
        }
    }
}

/// Every difference between a recording and a run.
pub(super) fn compare(run: &Run, played: &Played, traits: &Traits) -> Vec<Difference> {
    let figures = &played.figures;
    let mut found = Vec::new();
    compare_responses(run, figures, traits, &mut found);
    compare_messages(run, figures, &traits.lines, &mut found);
    let follows = follows_from_answers(&found);
    let answers = found.len();
    compare_steps(run, figures, traits, &mut found);
    compare_time(run, figures, traits, &mut found);
    compare_end(run, played, &mut found);
    for difference in &mut found[answers..] {
        difference.by_design = difference.by_design.or(follows);
    }
    found
}

/// What excuses the consequences of different answers: the differences themselves are all by design.
pub(super) fn follows_from_answers(answers: &[Difference]) -> Option<Deviation> {
    let changes_state = answers.iter().any(|found| {
        found
            .by_design
            .is_some_and(|deviation| deviation.row().has_consequences)
    });
    changes_state.then_some(Deviation::Follows)
}

/// A line without blanks and comments.
pub(super) fn code(line: &str) -> String {
    String::from_utf8_lossy(&sender::code(line.as_bytes())).into_owned()
}

fn compare_responses(run: &Run, figures: &Figures, traits: &Traits, found: &mut Vec<Difference>) {
    let recorded = run
        .responses
        .iter()
        .flat_map(|(text, count)| (0..*count).map(move |_| text.as_str()));
    let mut ours = figures.responses.iter();
    for (number, expected) in (1_u64..).zip(recorded) {
        let response = ours.next().map(|(_, response)| response.to_string());
        let response = response.as_deref().unwrap_or("no answer");
        if response == expected {
            continue;
        }
        let line = traits
            .lines
            .get(number as usize - 1)
            .map_or("", String::as_str);
        found.push(Difference {
            what: "answer",
            text: format!("line {number} `{line}`: {response}, Grbl {expected}"),
            by_design: of_answers(&code(line), response, expected),
        });
    }
    let surplus = ours.count();
    if surplus > 0 && run.complete {
        found.push(Difference {
            what: "answer",
            text: format!("{surplus} answers more than Grbl's"),
            by_design: None,
        });
    }
}

fn compare_messages(run: &Run, figures: &Figures, lines: &[String], found: &mut Vec<Difference>) {
    // What the recording host noted about itself is no message of the machine.
    let recorded = run
        .messages
        .iter()
        .filter(|(_, text)| !text.starts_with("(host:"));
    let recorded: Vec<_> = recorded.collect();
    let messages = figures.messages.iter();
    let why = |text: &str| of_message(text).or_else(|| of_operator_message(text, lines));
    let (common, ours): (Vec<_>, Vec<_>) = messages.partition(|(_, text)| why(text).is_some());
    for (answers, text) in common {
        found.push(Difference {
            what: "message",
            text: format!("`{text}` after {answers} answers"),
            by_design: why(text),
        });
    }
    let changes_tool = Some(Deviation::ToolChange);
    let has_tools = found.iter().any(|found| found.by_design == changes_tool);
    let longest = recorded.len().max(ours.len());
    for index in 0..longest {
        let (ours, recorded) = (ours.get(index).copied(), recorded.get(index).copied());
        if ours == recorded {
            continue;
        }
        let text = |message: Option<&(u64, String)>| {
            message.map_or("nothing".into(), |(answers, text)| {
                format!("`{text}` after {answers} answers")
            })
        };
        let is_tool = has_tools
            && matches!((ours, recorded), (Some((answers, ours)), Some((recorded_answers, recorded)))
                if answers == recorded_answers && tools(ours, recorded).is_some());
        found.push(Difference {
            what: "message",
            text: format!("{}, Grbl {}", text(ours), text(recorded)),
            by_design: changes_tool.filter(|_| is_tool),
        });
        if !is_tool {
            return;
        }
    }
}

fn compare_steps(run: &Run, figures: &Figures, traits: &Traits, found: &mut Vec<Difference>) {
    let inexact = traits.arcs > 0 || traits.has_inches;
    for (axis, recorded) in run.final_steps.iter().enumerate() {
        let letter = char::from(b"XYZABC"[axis]);
        let ties = &traits.ties[axis];
        let ours = i64::from(figures.end.steps[axis]);
        let off = ours.abs_diff(*recorded);
        if off > u64::from(inexact) {
            let by_design = off <= u64::from(inexact) + ties.end;
            found.push(Difference {
                what: "final steps",
                text: format!("{letter} {ours}, Grbl {recorded}"),
                by_design: by_design.then_some(Deviation::ExactPositions),
            });
        }
        let (ours, recorded) = (figures.steps_axis[axis], run.steps_axis[axis]);
        let off = ours.abs_diff(recorded);
        // Grbl's chords cut up to one step off each of an arc's extremes.
        let chords = if traits.arcs > 0 {
            (recorded / 1000).max(4 * traits.arcs)
        } else {
            0
        };
        if off > chords {
            // Each such point moves the end of one move and the beginning of the next.
            let by_design = off <= chords + 2 * ties.points + ties.end;
            found.push(Difference {
                what: "steps",
                text: format!("{letter} {ours}, Grbl {recorded}"),
                by_design: by_design.then_some(Deviation::ExactPositions),
            });
        }
    }
}

fn compare_time(run: &Run, figures: &Figures, traits: &Traits, found: &mut Vec<Difference>) {
    let is_comparable = traits.arcs == 0 && run.planner_low_fraction < LOW_PLANNER;
    let (ours, recorded) = (figures.motion_time_s, run.motion_time_s);
    if !is_comparable || ours <= recorded * SLOWEST + 1e-3 {
        return;
    }
    let steps = run.steps_axis.iter().copied().max().unwrap_or(0) as f64;
    let slowest = (steps - 1.0) * GRBL_LONGEST_PERIOD_S;
    let too_slow_for_grbl = (recorded / slowest - 1.0).abs() < 0.01;
    found.push(Difference {
        what: "motion time",
        text: format!(
            "{ours:.3} s, Grbl {recorded:.3} s ({:+.1} %)",
            (ours / recorded - 1.0) * 100.0
        ),
        by_design: too_slow_for_grbl.then_some(Deviation::SlowSteps),
    });
}

/// What `$G`, `$#` and `?` say after the program.
fn compare_end(run: &Run, played: &Played, found: &mut Vec<Difference>) {
    let answers = &played.answers;
    let recorded = run.final_modes.iter().chain(&run.final_params);
    let recorded: Vec<_> = recorded.chain([&run.final_status]).collect();
    for index in 0..recorded.len().max(answers.len()) {
        let ours = answers.get(index).map_or("nothing", String::as_str);
        let theirs = recorded.get(index).map_or("nothing", |text| text.as_str());
        if ours == theirs {
            continue;
        }
        let by_design = if differs_in_tool(ours, theirs) {
            Some(Deviation::ToolIsModal)
        } else if is_same_place(ours, theirs, &played.figures.end.mpos_mm) {
            Some(Deviation::Rounding)
        } else {
            None
        };
        found.push(Difference {
            what: "end",
            text: format!("`{ours}`, Grbl `{theirs}`"),
            by_design,
        });
    }
}

/// Whether two texts differ in nothing but the last digit of numbers that lie half-way between two.
fn is_same_place(ours: &str, theirs: &str, exact_mm: &[f64]) -> bool {
    match (ours.parse::<Report>(), theirs.parse::<Report>()) {
        (Ok(our), Ok(their)) => {
            let fields = our.fields.iter().zip(&their.fields);
            our.state == their.state
                && our.fields.len() == their.fields.len()
                && fields
                    .into_iter()
                    .all(|((name, our), (their_name, their))| {
                        let is_tie = name == "MPos" && is_tie(our, their, exact_mm);
                        name == their_name && (our == their || is_tie)
                    })
        }
        // Offsets are no steps: what lies half-way cannot be told.
        _ => ours.starts_with('[') && is_rounded_otherwise(ours, theirs),
    }
}

#[cfg(test)]
mod tests {
    use super::*;
    use simulation::{
        figures::{Final, Responses},
        sender::Response,
    };

    fn recorded() -> Run {
        serde_json::from_str(
            r#"{"responses": [["ok", 2], ["error:20", 1]], "messages": [[2, "[MSG:Pgm End]"]],
                "steps_axis": [1000, 0, 0], "final_steps": [1000, 0, 0],
                "motion_time_s": 10.0, "planner_low_fraction": 0.0, "complete": true,
                "final_status": "<Idle>", "final_GC": ["[GC:G1 T0 F0]"], "final_params": []}"#,
        )
        .unwrap()
    }

    fn equal() -> Figures {
        let mut responses = Responses::default();
        for response in [Response::Ok, Response::Ok, Response::Error(20)] {
            responses.push(response);
        }
        Figures {
            lines: 3,
            responses,
            messages: vec![(2, "[MSG:Pgm End]".into())],
            end: Final {
                state: "Idle".into(),
                mpos_mm: vec![4.0, 0.0, 0.0],
                steps: vec![1000, 0, 0],
            },
            steps_axis: vec![1000, 0, 0],
            motion_time_s: 10.1,
            ..Figures::default()
        }
    }

    fn lines() -> Traits {
        Traits {
            lines: vec!["G0X4".into(), "M2".into(), "G999".into()],
            ..Traits::default()
        }
    }

    fn compared(figures: &Figures, traits: &Traits) -> Vec<Difference> {
        let played = Played {
            figures: figures.clone(),
            answers: vec!["[GC:G1 T0 F0]".into(), "<Idle>".into()],
        };
        compare(&recorded(), &played, traits)
    }

    fn what(figures: &Figures, traits: &Traits) -> Vec<&'static str> {
        let found = compared(figures, traits);
        found.iter().map(|difference| difference.what).collect()
    }

    #[test]
    fn equal_runs_agree() {
        assert_eq!(compared(&equal(), &lines()), []);
    }

    #[test]
    fn each_kind_of_difference_is_found() {
        let mut figures = equal();
        figures.responses = Responses::default();
        figures.responses.push(Response::Ok);
        assert_eq!(what(&figures, &lines()), ["answer", "answer"]);
        let mut figures = equal();
        figures.messages.clear();
        assert_eq!(what(&figures, &lines()), ["message"]);
        let common = (2, "[MSG:Path deviation: 0.020 mm]".into());
        figures.messages = vec![common, (2, "[MSG:Pgm End]".into())];
        assert_eq!(what(&figures, &lines()), ["message"]);
        let mut figures = equal();
        figures.end.steps[0] = 1001;
        assert_eq!(what(&figures, &lines()), ["final steps"]);
        let mut figures = equal();
        figures.steps_axis[1] = 1;
        assert_eq!(what(&figures, &lines()), ["steps"]);
        let mut figures = equal();
        figures.motion_time_s = 10.3;
        assert_eq!(what(&figures, &lines()), ["motion time"]);
    }

    #[test]
    fn the_end_must_be_the_same_too() {
        let mut played = Played {
            figures: equal(),
            answers: vec!["[GC:G1 T3 F0]".into(), "<Idle>".into()],
        };
        let found = compare(&recorded(), &played, &lines());
        assert_eq!(found[0].by_design, Some(Deviation::ToolIsModal));
        played.answers[1] = "<Alarm>".into();
        let found = compare(&recorded(), &played, &lines());
        assert_eq!(Verdict::of(&found), Verdict::Differs);
    }

    #[test]
    fn arcs_allow_one_step_and_their_own_time() {
        let traits = Traits { arcs: 1, ..lines() };
        let mut figures = equal();
        figures.end.steps[0] = 1001;
        figures.steps_axis[0] = 1003;
        figures.motion_time_s = 20.0;
        assert_eq!(compared(&figures, &traits), []);
        figures.end.steps[0] = 1002;
        assert_eq!(what(&figures, &traits), ["final steps"]);
    }

    #[test]
    fn ties_between_steps_are_named() {
        let mut traits = lines();
        traits.ties[0].points = 1;
        let mut figures = equal();
        figures.steps_axis[0] = 1002;
        let found = compared(&figures, &traits);
        assert_eq!(Verdict::of(&found), Verdict::ByDesign);
        figures.steps_axis[0] = 1003;
        let found = compared(&figures, &traits);
        assert_eq!(Verdict::of(&found), Verdict::Differs);
    }
}
