//! What a program will do: it runs in advance on a virtual machine that stands as the machine does, in a worker of its
//! own, so that the client of the machine never waits for it.

use anyhow::{Context as _, Result, ensure};
use grbl_client::{MachineAnswers, meaning};
use leadscrew::{axis::LETTERS, sim::Simulator, units::Nm};
use pages::page;
use serde::{Deserialize, Serialize};
use simulation::{
    RefusalRow, Refusals, SwitchPositions,
    forecast::Forecast,
    line_times::LineTimes,
    machine_answers::{self, UNLIMITED_BAUD},
    playing,
    program::{Program, encoding_warning},
    rehearsal::{Range, Rehearsal, Rehearsed},
    resume::{self, Entry, Plunge},
    sender::{Response, shown},
};
use wasm_bindgen::{JsCast as _, JsValue, prelude::Closure};
use web_sys::{DedicatedWorkerGlobalScope, MessageEvent};

use crate::wire::VirtualMachine;

/// Changes of the virtual machine after which it is told how far it is.
const CHANGES_BETWEEN_REPORTS: u32 = 100_000;
/// Causes of refusals, and refused lines, that are shown: a file that is no program has one in each line.
const MOST_CAUSES: usize = 100;
const MOST_REFUSED: usize = 1000;

/// A program, and the machine that it is for.
#[derive(Debug, Clone, Default, PartialEq, Serialize, Deserialize)]
pub struct Subject {
    /// The name of the program.
    pub name: String,
    /// Its text.
    pub text: String,
    /// What the machine has answered; nothing for the virtual machine as it is when it is switched on.
    pub machine: Option<MachineAnswers>,
}

/// What the page asks for.
#[derive(Debug, Clone, PartialEq, Serialize, Deserialize)]
pub enum CheckRequest {
    /// What a program will do.
    Check(Subject),
    /// Where a program may begin in its middle.
    Enter {
        /// The program, and the machine as it is now.
        subject: Subject,
        /// The machine as it was before the job, where it is the continuation of one.
        began: Option<MachineAnswers>,
        /// The line that is wanted, counted from 1.
        line: usize,
        /// The operator has measured a tool, and is to do so again: the machine waits for its change.
        reports_tool: bool,
    },
    /// In which line a job was stopped.
    FindStop {
        /// The program, and the machine as it was before the job.
        subject: Subject,
        /// The lines that the machine had answered.
        answered: usize,
        /// The machine position at which it was stopped, in the unit of reports, where it is known.
        place: Option<Vec<f64>>,
    },
}

/// What is replied.
#[derive(Debug, Clone, PartialEq, Serialize, Deserialize)]
pub enum CheckReply {
    /// The part of the check that is done, 0 to 1.
    Part(f64),
    /// What a program will do.
    Findings(Box<Findings>),
    /// Where a program may begin.
    Entry(Entry),
    /// The line in which a job was stopped, counted from 1.
    StoppedIn(usize),
    /// Why there is no reply, as a sentence.
    Failed(String),
}

/// A line that is refused.
#[derive(Debug, Clone, PartialEq, Eq, Serialize, Deserialize)]
pub struct RefusedLine {
    /// Its number, counted from 1.
    pub line: usize,
    /// What it is.
    pub text: String,
    /// Why it is refused, and what to do.
    pub why: String,
}

/// How far a program moves an axis, mm or degrees.
#[derive(Debug, Clone, PartialEq, Serialize, Deserialize)]
pub struct AxisExtent {
    /// Its letter.
    pub letter: char,
    /// In machine coordinates.
    pub machine: Range,
    /// In the work coordinates in which the machine stands before the program.
    pub work: Range,
    /// As `machine`, up to the first line that probes: what follows depends on its contact.
    pub certain: Range,
    /// The travel in machine coordinates; nothing for an axis without ends.
    pub travel: Option<Range>,
}

/// What a program will do.
#[derive(Debug, Clone, Default, PartialEq, Serialize, Deserialize)]
pub struct Findings {
    /// Its lines.
    pub lines: usize,
    /// The lines that will be refused: the first ones of many.
    pub refused: Vec<RefusedLine>,
    /// How many there are.
    pub refused_count: usize,
    /// Why, the most frequent cause first.
    pub causes: Vec<RefusalRow>,
    /// The line and the alarm in which it will end.
    pub alarm: Option<String>,
    /// The axes that it moves.
    pub extents_mm: Vec<AxisExtent>,
    /// Lowest and highest machine position of X, Y and Z in moves at feed rate, mm; nothing without any.
    pub cut_mm: Vec<Range>,
    /// The tools in the spindle, 0 for none, each with its first line.
    pub tools: Vec<(u8, u64)>,
    /// How long it takes, s, where it comes to its end.
    pub time_s: Option<f64>,
    /// What the time goes into, in words.
    pub times: String,
    /// When its lines are carried out; empty where it does not come to its end.
    pub line_times: LineTimes,
    /// What else there is to say.
    pub warnings: Vec<String>,
    /// The page that shows the path; empty where it does not come to its end.
    pub view: String,
}

/// The lines of a program as they are sent, and what there is to say of its text.
fn lines_of(subject: &Subject) -> Result<(Vec<Vec<u8>>, Option<String>)> {
    let text = subject.text.clone().into_bytes();
    let mut program = Program::from_bytes(subject.name.clone(), text);
    let mut lines = Vec::new();
    while let Some(line) = program.next_line()? {
        lines.push(line);
    }
    ensure!(!lines.is_empty(), "{} is empty", subject.name);
    Ok((lines, program.foreign_line().map(encoding_warning)))
}

/// The machine of a program, or the virtual one.
fn machine_of(subject: &Subject) -> MachineAnswers {
    subject.machine.clone().unwrap_or_else(|| {
        let settings = VirtualMachine::settings();
        let mut simulator = Box::new(Simulator::new(&settings));
        SwitchPositions::of(&settings).mount_on(&mut simulator);
        playing::unlock(&mut simulator);
        machine_answers::of_virtual_machine(&mut simulator)
    })
}

/// Runs a program in advance, and tells which part is done.
///
/// # Errors
/// There is no program, or the virtual machine cannot be as the machine is.
pub fn check(subject: &Subject, mut tell: impl FnMut(f64)) -> Result<Findings> {
    let (lines, warning) = lines_of(subject)?;
    let answers = machine_of(subject);
    let mut rehearsal = Rehearsal::begin(&subject.name, &lines, &answers)?;
    let forecast = Forecast::of(&answers, &lines, UNLIMITED_BAUD, |answered| {
        tell(answered as f64 / lines.len() as f64 / 2.0);
        Ok(())
    });
    while !rehearsal.pump(CHANGES_BETWEEN_REPORTS) {
        tell(0.5 + rehearsal.part() / 2.0);
    }
    let rehearsed = rehearsal.finish();
    let mut findings = Findings {
        lines: lines.len(),
        warnings: warning.into_iter().collect(),
        ..Findings::default()
    };
    let mut refused = Vec::new();
    match forecast {
        Ok(forecast) => {
            let errors = forecast.refused.iter();
            refused.extend(errors.map(|refused| (refused.line, refused.error)));
            if let Some(line) = forecast.times.probing {
                findings.warnings.push(format!(
                    "Line {} probes, and where it makes contact is unknown: the time is an estimate, and what follows is \
                     shown without contact.",
                    line + 1
                ));
            }
            findings.time_s = Some(forecast.times.total_s);
            findings.line_times = forecast.times.rounded();
        }
        Err(error) => {
            findings.alarm = Some(format!("{error:#}"));
            let figures = rehearsed.as_ref().ok().map(|it| &it.figures);
            let answers = figures
                .into_iter()
                .flat_map(|figures| figures.responses.iter());
            refused.extend(answers.filter_map(|(line, response)| match response {
                Response::Error(number) => Some((line as usize, number)),
                Response::Ok => None,
            }));
        }
    }
    findings.set_refused(&lines, &refused);
    match rehearsed {
        Ok(rehearsed) => findings.set_rehearsed(&rehearsed, &answers),
        Err(error) => {
            findings.alarm.get_or_insert_with(|| format!("{error:#}"));
        }
    }
    Ok(findings)
}

impl Findings {
    /// Takes the lines, from 1, that are refused with a number.
    fn set_refused(&mut self, lines: &[Vec<u8>], refused: &[(usize, u16)]) {
        let mut all = Refusals::default();
        for (number, error) in refused {
            let line = lines.get(number - 1).map_or(&[][..], Vec::as_slice);
            all.add(*number as u64, line, Response::Error(*error));
            if self.refused.len() < MOST_REFUSED {
                let why = meaning::error_with_remedy(*error);
                self.refused.push(RefusedLine {
                    line: *number,
                    text: shown(line),
                    why: why.unwrap_or_else(|| "an unknown error".into()),
                });
            }
        }
        self.refused_count = refused.len();
        let causes = all.causes().into_iter().take(MOST_CAUSES);
        self.causes = causes.map(RefusalRow::of).collect();
        for cause in &mut self.causes {
            // What a command line can do about it.
            if let Some((reason, _)) = cause.why.split_once(": --") {
                cause.why = reason.into();
            }
        }
    }

    /// Takes the path.
    fn set_rehearsed(&mut self, rehearsed: &Rehearsed, answers: &MachineAnswers) {
        let Rehearsed {
            job,
            figures,
            extents,
            work_offset_mm,
        } = rehearsed;
        let settings = machine_answers::settings(answers);
        let is_moved = |[low, high]: Range| low < high;
        let axes = extents.motion.iter().enumerate();
        self.extents_mm = axes
            .filter(|(_, range)| is_moved(**range))
            .map(|(axis, range)| AxisExtent {
                letter: char::from(LETTERS[axis]),
                machine: *range,
                work: range.map(|end| end - work_offset_mm[axis]),
                certain: extents.certain.get(axis).copied().unwrap_or(*range),
                travel: settings.travel(axis).map(|ends| ends.map(Nm::to_mm_f64)),
            })
            .collect();
        self.cut_mm = extents.cut.iter().take(3).copied().collect();
        self.tools = job.tools();
        self.times = figures.times.text().unwrap_or_default();
        self.view = page::write(job);
    }
}

/// Where a program may begin.
fn enter(
    subject: &Subject,
    began: Option<&MachineAnswers>,
    line: usize,
    plunge: Plunge,
) -> Result<Entry> {
    let (lines, _) = lines_of(subject)?;
    let wanted = line.checked_sub(1).context("the first line is line 1")?;
    let now = machine_of(subject);
    resume::entry_of_answers(&lines, wanted, began, &now, plunge)
}

/// The line in which a job was stopped, counted from 1.
fn find_stop(subject: &Subject, answered: usize, place: Option<&[f64]>) -> Result<usize> {
    let (lines, _) = lines_of(subject)?;
    let began = machine_of(subject);
    let forecast = Forecast::passing(place, &began, &lines, UNLIMITED_BAUD, |_| Ok(()))?;
    Ok(forecast.stopped_in(answered).min(lines.len() - 1) + 1)
}

/// Replies to a request, and tells before which part is done.
pub fn reply(request: &CheckRequest, tell: impl FnMut(f64)) -> CheckReply {
    let reply = match request {
        CheckRequest::Check(subject) => {
            check(subject, tell).map(|findings| CheckReply::Findings(Box::new(findings)))
        }
        CheckRequest::Enter {
            subject,
            began,
            line,
            reports_tool,
        } => {
            let plunge = Plunge {
                reports_tool: *reports_tool,
                ..Plunge::default()
            };
            enter(subject, began.as_ref(), *line, plunge).map(CheckReply::Entry)
        }
        CheckRequest::FindStop {
            subject,
            answered,
            place,
        } => find_stop(subject, *answered, place.as_deref()).map(CheckReply::StoppedIn),
    };
    reply.unwrap_or_else(|error| CheckReply::Failed(format!("{error:#}")))
}

/// Begins in a worker.
pub(crate) fn start() {
    let scope: DedicatedWorkerGlobalScope = js_sys::global().unchecked_into();
    let poster = scope.clone();
    let post = move |reply: &CheckReply| {
        let text = serde_json::to_string(reply).unwrap_or_default();
        // A text can always be copied.
        let _ = poster.post_message(&JsValue::from(text));
    };
    let on_message = Closure::<dyn FnMut(MessageEvent)>::new(move |event: MessageEvent| {
        let text = event.data().as_string().unwrap_or_default();
        if let Ok(request) = serde_json::from_str(&text) {
            let reply = reply(&request, |part| post(&CheckReply::Part(part)));
            post(&reply);
        }
    });
    scope.set_onmessage(Some(on_message.as_ref().unchecked_ref()));
    on_message.forget();
}

#[cfg(test)]
mod tests {
    use leadscrew::axis::AXES;

    use super::*;

    /// A mill that has been homed and stands above its work zero.
    fn subject(text: &str) -> Subject {
        let settings = [
            "$22=1", "$130=200", "$131=200", "$132=100", "$120=500", "$121=500", "$122=500",
        ];
        Subject {
            name: "plate.nc".into(),
            text: text.into(),
            machine: Some(MachineAnswers {
                settings: settings.map(str::to_owned).to_vec(),
                parameters: vec!["[G54:-50.000,-60.000,-40.000]".into()],
                modes: "[GC:G0 G54 G17 G21 G90 G94 M5 M9 T0 F0 S0]".into(),
                position: [-50.0, -60.0, -30.0, 0.0, 0.0, 0.0][..AXES].to_vec(),
                ..MachineAnswers::default()
            }),
        }
    }

    fn findings(text: &str) -> Findings {
        let mut parts = Vec::new();
        let found = check(&subject(text), |part| parts.push(part)).unwrap();
        assert!(parts.iter().all(|part| (0.0..=1.0).contains(part)));
        found
    }

    #[test]
    fn refused_lines_have_their_causes_and_their_places() {
        let found = findings("G21 G90\nG999 (<b>)\nG0 X1\nM106\nG999\n");
        let lines: Vec<_> = found.refused.iter().map(|line| line.line).collect();
        assert_eq!(
            (lines, found.refused_count, found.lines),
            (vec![2, 4, 5], 3, 5)
        );
        assert_eq!(found.refused[0].text, "G999 (<b>)");
        assert!(found.refused[0].why.contains("remove the word"));
        let causes = found
            .causes
            .iter()
            .map(|row| (row.what.as_str(), row.count, row.first));
        assert_eq!(causes.collect::<Vec<_>>(), [("G999", 2, 2), ("M106", 1, 4)]);
        assert_eq!(found.alarm, None);
        // Other than those of a command, the words are for one who has no command line.
        let homing = check(
            &Subject {
                machine: None,
                ..subject("$HQ\n")
            },
            |_| (),
        )
        .unwrap();
        assert!(
            homing.causes.iter().all(|row| !row.why.contains("--")),
            "{homing:?}"
        );
    }

    #[test]
    fn a_program_that_leaves_the_travel_is_measured_to_its_end() {
        let text = "G21 G90\nG1 X60 F3000\nG1 Y-160\nX0 Y0\n";
        let found = findings(text);
        assert_eq!((found.alarm.as_ref(), found.refused_count), (None, 0));
        let [x, y] = &found.extents_mm[..] else {
            panic!("{found:?}")
        };
        assert_eq!((x.letter, y.letter), ('X', 'Y'));
        let near = |range: Range, expected: Range| {
            let is_near = |axis: usize| (range[axis] - expected[axis]).abs() < 0.01;
            assert!(is_near(0) && is_near(1), "{range:?}");
        };
        near(x.machine, [-50.0, 10.0]);
        near(x.work, [0.0, 60.0]);
        near(y.machine, [-220.0, -60.0]);
        near(x.travel.unwrap(), [-200.0, 0.0]);
        // With soft limits the job ends where it leaves, and its path is known all the same.
        let mut limited = subject(text);
        limited
            .machine
            .iter_mut()
            .for_each(|it| it.settings.push("$20=1".into()));
        let found = check(&limited, |_| ()).unwrap();
        let alarm = found.alarm.unwrap();
        assert!(
            alarm.starts_with("line 2 (G1 X60 F3000) would end in ALARM:2"),
            "{alarm}"
        );
        assert_eq!(found.time_s, None);
        near(found.extents_mm[1].machine, [-220.0, -60.0]);
    }

    #[test]
    fn tools_time_and_view_are_those_of_the_program() {
        let found = findings("T1 M6\nG1 X10 F600\nT2 M6\nX0\nG4 P1\n");
        assert_eq!(found.tools, [(1, 1), (2, 3)]);
        let time_s = found.time_s.unwrap();
        assert!((3.0..4.0).contains(&time_s), "{time_s}");
        assert!(found.times.contains("cutting"), "{}", found.times);
        assert!(found.view.contains("<title>plate.nc</title>"));
        assert_eq!(found.cut_mm.len(), 3);
    }

    #[test]
    fn a_program_without_a_machine_is_checked_for_the_virtual_one() {
        let subject = Subject {
            machine: None,
            ..subject("G1 X5 F300\n")
        };
        let found = check(&subject, |_| ()).unwrap();
        assert_eq!(found.extents_mm[0].machine[0], 0.0);
        assert_eq!(found.extents_mm[0].travel, Some([-200.0, 0.0]));
        let empty = Subject {
            text: String::new(),
            ..subject
        };
        let failed = reply(&CheckRequest::Check(empty), |_| ());
        assert_eq!(failed, CheckReply::Failed("plate.nc is empty".into()));
    }

    const JOB: &str = "G21 G90 T1 M6\nM3 S1000\nG0 Z5\nG0 X1 Y1\nG1 Z-1 F300\nX20\nY20\nX1\nG0 Z5\nG41.1 D2 G1 X9 Y9\nX20\nG40\n";

    fn entry(line: usize, began: Option<MachineAnswers>) -> CheckReply {
        let subject = subject(JOB);
        reply(
            &CheckRequest::Enter {
                subject,
                began,
                line,
                reports_tool: false,
            },
            |_| (),
        )
    }

    #[test]
    fn a_program_begins_at_a_line_that_can_begin_it() {
        let CheckReply::Entry(found) = entry(7, None) else {
            panic!()
        };
        assert_eq!((found.line, found.tool), (6, 1));
        assert!(found.approach.contains(&"M3 S1000".to_owned()), "{found:?}");
        assert_eq!(found.position[..3], ["X20", "Y1", "Z-1"]);
        // Within a compensated contour nothing begins: it begins before.
        let CheckReply::Entry(found) = entry(11, None) else {
            panic!()
        };
        assert_eq!(found.line, 9);
        let CheckReply::Failed(reason) = entry(99, None) else {
            panic!()
        };
        assert_eq!(reason, "the job has 12 lines");
        // Where the machine stood before it is known, its first lines can begin too.
        assert!(matches!(entry(3, None), CheckReply::Failed(_)));
        let CheckReply::Entry(found) = entry(3, subject(JOB).machine) else {
            panic!()
        };
        assert_eq!(found.line, 2);
    }

    #[test]
    fn the_line_in_which_a_job_was_stopped_is_found_by_its_place() {
        let at = |place| CheckRequest::FindStop {
            subject: subject(JOB),
            answered: 9,
            place,
        };
        let known = Some([-30.0, -50.0, -41.0, 0.0, 0.0, 0.0][..AXES].to_vec());
        assert_eq!(reply(&at(known), |_| ()), CheckReply::StoppedIn(7));
        let CheckReply::StoppedIn(unknown) = reply(&at(None), |_| ()) else {
            panic!()
        };
        assert!(unknown <= 7, "{unknown}");
    }

    #[test]
    fn requests_and_replies_are_json() {
        let request = CheckRequest::Enter {
            subject: subject("G0 X1"),
            began: None,
            line: 3,
            reports_tool: true,
        };
        let text = serde_json::to_string(&request).unwrap();
        assert!(
            text.starts_with(
                r#"{"Enter":{"subject":{"name":"plate.nc","text":"G0 X1","machine":{"#
            ),
            "{text}"
        );
        assert_eq!(
            serde_json::from_str::<CheckRequest>(&text).unwrap(),
            request
        );
        let found = CheckReply::Findings(Box::new(findings("G1 X1 F100\nG999\n")));
        let text = serde_json::to_string(&found).unwrap();
        assert_eq!(serde_json::from_str::<CheckReply>(&text).unwrap(), found);
        assert_eq!(
            serde_json::to_string(&CheckReply::Part(0.5)).unwrap(),
            r#"{"Part":0.5}"#
        );
    }
}
