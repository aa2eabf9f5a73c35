//! What is known of the program before it runs, and of the job while it does.

use std::{collections::BTreeMap, ops::Deref, rc::Rc};

use grbl_client::{Line, MachineAnswers};
use simulation::{
    progress::{JobClock, JobReport, Progress},
    resume::Entry,
};

use super::{Model, Program};
use crate::checker::{CheckReply, CheckRequest, Findings, Subject};

/// What is asked of a machine before a check; what is not its own is refused, and is no answer then.
pub(crate) const QUESTIONS: [&str; 5] = ["$I", "$+", "$#", "$TT", "$G"];
/// Those of which the answers are asked for again each time.
const CHANGING_QUESTIONS: [&str; 3] = ["$#", "$TT", "$G"];
/// Answers of a machine that is not idle, or locked.
const NOT_NOW: [&str; 2] = ["error:8", "error:9"];
/// How far two offsets may differ that are the same, in the unit of reports: they are differences of rounded numbers.
const ROUNDED: f64 = 0.002;

/// What a check depends on, beside the program.
#[derive(Debug, Clone, Default, PartialEq)]
pub struct CheckBasis {
    is_there: bool,
    /// The work zero, as machine position.
    offset: Vec<f64>,
    /// The modes that stay from one program to the next.
    modes: Vec<String>,
    settings: BTreeMap<u16, String>,
}

impl CheckBasis {
    /// Of a machine as it is now.
    pub(crate) fn of(model: &Model) -> Self {
        let positions = model.machine.machine.iter().zip(&model.machine.work);
        let stays = |word: &&String| {
            let number = word.strip_prefix('G').and_then(|it| it.parse().ok());
            number.is_some_and(|number: f64| {
                (17.0..22.0).contains(&number)
                    || (54.0..65.0).contains(&number)
                    || (90.0..98.0).contains(&number)
            })
        };
        Self {
            is_there: model.is_there(),
            offset: positions.map(|(machine, work)| machine - work).collect(),
            modes: model.machine.modes.iter().filter(stays).cloned().collect(),
            settings: model.settings.clone(),
        }
    }

    /// Whether a check that was made on one counts on the other.
    pub(crate) fn is_same(&self, other: &Self) -> bool {
        let mut offsets = self.offset.iter().zip(&other.offset);
        let is_near = offsets.all(|(one, other)| (one - other).abs() < ROUNDED);
        let parts = |it: &Self| (it.is_there, it.offset.len());
        is_near
            && parts(self) == parts(other)
            && self.modes == other.modes
            && self.settings == other.settings
    }
}

/// What is known of the program.
#[derive(Debug, Clone, Default, PartialEq)]
pub enum Check {
    /// Nothing.
    #[default]
    None,
    /// It is being checked.
    Running {
        /// The part that is done, 0 to 1.
        part: f64,
    },
    /// What it will do.
    Done(Rc<Checked>),
    /// Why it could not be checked, as a sentence.
    Failed(String),
}

/// What a program will do.
#[derive(Debug)]
pub struct Checked {
    /// The program, as it was checked: of another one nothing here is true.
    pub program: Rc<Program>,
    /// The machine; nothing where the virtual machine was taken.
    pub machine: Option<MachineAnswers>,
    /// The page that shows the path; empty where the program does not come to its end.
    pub view: Rc<str>,
    basis: CheckBasis,
    findings: Findings,
}

impl PartialEq for Checked {
    /// A check is the same as itself alone: it has much to compare.
    fn eq(&self, other: &Self) -> bool {
        std::ptr::eq(self, other)
    }
}

impl Deref for Checked {
    type Target = Findings;

    fn deref(&self) -> &Findings {
        &self.findings
    }
}

/// What the checker is to find.
#[derive(Debug, Clone, Copy, PartialEq, Eq)]
pub enum Purpose {
    /// What the program will do.
    Check,
    /// Where it may begin: at a line, counted from 1, or before.
    Enter(usize),
    /// In which line the job was stopped.
    FindStop,
}

/// What the checker was asked for.
#[derive(Debug, Clone, PartialEq)]
pub struct PendingCheck {
    purpose: Purpose,
    program: Rc<Program>,
    machine: Option<MachineAnswers>,
    basis: CheckBasis,
}

/// A job that the page has started.
#[derive(Debug, Clone, PartialEq)]
pub(super) struct Started {
    /// Its program.
    program: Rc<Program>,
    /// The machine before its first line; nothing where the program was not checked.
    began: Option<MachineAnswers>,
}

/// Where a program may begin.
#[derive(Debug, Clone, PartialEq)]
pub struct FoundEntry {
    /// The program.
    pub program: Rc<Program>,
    /// The line that was wanted, counted from 1.
    pub wanted: usize,
    /// The place.
    pub entry: Entry,
    basis: CheckBasis,
}

/// The program before it runs, and the job.
#[derive(Debug, Clone, Default, PartialEq)]
pub struct Plan {
    /// For what the machine is being asked.
    pub(crate) asked: Option<Purpose>,
    pending_check: Option<PendingCheck>,
    /// The job is to begin, and has not yet.
    pub(super) is_beginning: bool,
    /// The operator runs the program all the same.
    pub is_permitted: bool,
    started: Option<Started>,
    /// Where the job was stopped, in the unit of reports.
    stopped_at: Option<Vec<f64>>,
    /// The job has been stopped, and its line is not known yet.
    pub(crate) is_stop_unknown: bool,
    /// The lines before a change of the tool in which the operator may have measured one: a reset clears the offset.
    measured: Option<usize>,
    /// The line in which it was stopped, counted from 1.
    pub stopped_in: Option<usize>,
    /// Where the program may begin in its middle, or why nowhere.
    entry: Option<Result<Rc<FoundEntry>, String>>,
    clock: Option<JobClock>,
}

impl Plan {
    /// The program is another one.
    pub(super) fn forget_program(&mut self) {
        self.entry = None;
        self.stopped_in = None;
    }

    /// What stays when another line to a machine is opened.
    pub(super) fn kept(self) -> Self {
        Self {
            started: self.started,
            measured: self.measured,
            stopped_in: self.stopped_in,
            ..Self::default()
        }
    }
}

/// Whether two programs are the same one, and neither has been edited.
fn is_same(one: &Rc<Program>, other: &Rc<Program>) -> bool {
    Rc::ptr_eq(one, other)
}

impl Model {
    /// What the program that is open will do, if that is known, whatever has changed at the machine since.
    pub fn checked(&self) -> Option<&Rc<Checked>> {
        match (&self.check, &self.program) {
            (Check::Done(checked), Some(program)) if is_same(&checked.program, program) => {
                Some(checked)
            }
            _ => None,
        }
    }

    /// What the program will do at the machine as it is now.
    pub fn valid_check(&self) -> Option<&Rc<Checked>> {
        let is_valid = |checked: &&Rc<Checked>| checked.basis.is_same(&CheckBasis::of(self));
        self.checked().filter(is_valid)
    }

    /// Whether the machine is where it says, and can be asked.
    pub fn may_ask(&self) -> bool {
        let is_free = !self.is_job_running() && !self.plan.is_beginning;
        self.takes_lines() && self.state_name() == "Idle" && is_free
    }

    /// Whether the machine or the checker is at work for the page.
    pub fn is_checking(&self) -> bool {
        self.plan.asked.is_some() || self.plan.pending_check.is_some()
    }

    /// Where the program may begin at the machine as it is now, or why nowhere.
    pub fn entry(&self) -> Option<Result<&Rc<FoundEntry>, &str>> {
        match self.plan.entry.as_ref()? {
            Ok(found) => found
                .basis
                .is_same(&CheckBasis::of(self))
                .then_some(Ok(found)),
            Err(reason) => Some(Err(reason)),
        }
    }

    /// How far the job is, by the times of its check.
    pub fn progress(&self) -> Option<&Progress> {
        self.plan.clock.as_ref().map(|clock| &clock.progress)
    }

    /// The line that is carried out, counted from 1: as the machine says it, or by the times of the check.
    pub fn executed_line(&self) -> Option<usize> {
        let job = self.machine.job.as_ref().filter(|job| job.is_running)?;
        let line = if job.executed > 0 {
            job.executed
        } else {
            self.progress()?.line
        };
        Some((line + 1).min(job.lines))
    }

    /// The machine is asked for a purpose: what it has answered before may be old.
    pub(super) fn ask(&mut self, purpose: Purpose) {
        for question in CHANGING_QUESTIONS {
            self.answers.remove(question);
        }
        if purpose == Purpose::Check {
            self.check = Check::Running { part: 0.0 };
            self.plan.is_permitted = false;
        } else {
            self.plan.entry = None;
        }
        self.plan.pending_check = None;
        self.plan.asked = Some(purpose);
    }

    /// Takes an answer that comes before a job: a machine refuses what it does not have.
    pub(super) fn take_job_answer(&mut self, question: String, lines: Vec<String>, response: &str) {
        let is_busy = NOT_NOW.contains(&response);
        if response.is_empty() || is_busy {
            if self.plan.asked.is_some() {
                let what = if is_busy { "is not idle" } else { "was reset" };
                self.fail_check(format!("the machine {what}, and has not answered"));
            }
            return;
        }
        for line in &lines {
            if let Line::Setting(number, value) = Line::read(line) {
                self.settings.insert(number, value.trim().into());
            }
        }
        self.answers.insert(question, Rc::new(lines));
    }

    /// What the machine has to be asked now.
    pub(crate) fn questions(&self) -> impl Iterator<Item = &'static str> {
        let is_open = |question: &&str| {
            CHANGING_QUESTIONS.contains(question) || !self.answers.contains_key(*question)
        };
        QUESTIONS.into_iter().filter(is_open)
    }

    /// What the machine has answered to all of them.
    fn machine_answers(&self) -> Option<MachineAnswers> {
        let starting = |question: &str, start: char| -> Option<Vec<String>> {
            let lines = self.answers.get(question)?.iter();
            let lines = lines.filter(|line| line.starts_with(start));
            Some(lines.cloned().collect())
        };
        // What the machine does not have, it refuses.
        self.answers.get("$+")?;
        let settings = self.settings.iter();
        let settings: Vec<_> = settings
            .map(|(number, value)| format!("${number}={value}"))
            .collect();
        let position = self.machine.machine.clone();
        let is_known = !settings.is_empty() && !position.is_empty();
        is_known.then_some(MachineAnswers {
            version: starting("$I", '[')?,
            settings,
            parameters: starting("$#", '[')?,
            tools: starting("$TT", 'T')?,
            modes: starting("$G", '[')?.into_iter().next().unwrap_or_default(),
            position,
        })
    }

    /// The next request to the checker, when everything is known for it.
    pub(crate) fn pending_check(&self) -> Option<(PendingCheck, CheckRequest)> {
        let is_virtual = !self.is_there();
        let (purpose, machine) = match self.plan.asked {
            Some(purpose) if is_virtual => (purpose, None),
            Some(purpose) => (purpose, Some(self.machine_answers()?)),
            None if self.plan.is_stop_unknown => {
                let started = self.plan.started.as_ref();
                (Purpose::FindStop, started?.began.clone())
            }
            None => return None,
        };
        let program = Rc::clone(self.program.as_ref()?);
        let subject = Subject {
            name: program.name.clone(),
            text: program.text.clone(),
            machine: machine.clone(),
        };
        let began = self.plan.started.as_ref();
        let began = began.filter(|started| is_same(&started.program, &program));
        let request = match purpose {
            Purpose::Check => CheckRequest::Check(subject),
            Purpose::Enter(line) => CheckRequest::Enter {
                reports_tool: began.is_some() && self.plan.measured.is_some(),
                began: began.and_then(|started| started.began.clone()),
                subject,
                line,
            },
            Purpose::FindStop => CheckRequest::FindStop {
                answered: self.machine.job.as_ref().map_or(0, |job| job.answered),
                // With a measured tool the path is another one.
                place: { self.plan.stopped_at.clone() }.filter(|_| self.plan.measured.is_none()),
                subject,
            },
        };
        let pending_check = PendingCheck {
            purpose,
            program,
            machine,
            basis: CheckBasis::of(self),
        };
        Some((pending_check, request))
    }

    /// The checker has been asked.
    pub(super) fn begin_check(&mut self, pending_check: PendingCheck) {
        self.plan.asked = None;
        self.plan.is_stop_unknown = false;
        self.plan.pending_check = Some(pending_check);
    }

    /// There will be no reply.
    pub(super) fn fail_check(&mut self, reason: String) {
        let asked = self.plan.asked.take();
        let pending_check = self.plan.pending_check.take();
        match asked.or(pending_check.map(|pending_check| pending_check.purpose)) {
            Some(Purpose::Check) => self.check = Check::Failed(reason),
            Some(Purpose::Enter(_)) => self.plan.entry = Some(Err(reason)),
            Some(Purpose::FindStop) | None => {}
        }
    }

    /// Takes what the checker replies.
    pub(super) fn take_check(&mut self, reply: CheckReply) {
        match reply {
            CheckReply::Part(part) => {
                if let Check::Running { part: known } = &mut self.check {
                    *known = part;
                }
            }
            CheckReply::Failed(reason) => self.fail_check(reason),
            CheckReply::Findings(mut findings) => {
                if let Some(pending_check) = self.plan.pending_check.take() {
                    self.check = Check::Done(Rc::new(Checked {
                        program: pending_check.program,
                        machine: pending_check.machine,
                        basis: pending_check.basis,
                        view: std::mem::take(&mut findings.view).into(),
                        findings: *findings,
                    }));
                }
            }
            CheckReply::Entry(entry) => {
                if let Some(PendingCheck {
                    purpose: Purpose::Enter(wanted),
                    program,
                    basis,
                    ..
                }) = self.plan.pending_check.take()
                {
                    let found = FoundEntry {
                        program,
                        wanted,
                        entry,
                        basis,
                    };
                    self.plan.entry = Some(Ok(Rc::new(found)));
                }
            }
            CheckReply::StoppedIn(line) => {
                self.plan.pending_check = None;
                self.stop_in(line - 1);
            }
        }
    }

    /// The program is sent from a line on, counted from 0.
    pub(super) fn begin_job(&mut self, line: usize) {
        let Some(program) = self.program.clone() else {
            return;
        };
        let checked = self.valid_check().cloned();
        let began = checked.and_then(|checked| {
            Some(MachineAnswers {
                position: self.machine.machine.clone(),
                ..checked.machine.clone()?
            })
        });
        let plan = &mut self.plan;
        let before = plan.started.take();
        let is_continued = |started: &Started| line > 0 && is_same(&started.program, &program);
        // A continued job has begun as it did.
        plan.started = before
            .filter(is_continued)
            .or(Some(Started { program, began }));
        plan.is_beginning = true;
        plan.clock = None;
        plan.stopped_at = None;
        plan.measured = None;
        plan.stopped_in = None;
        plan.is_stop_unknown = false;
        plan.entry = None;
    }

    /// Another state of the machine has come; `was_running` is whether a job ran before.
    pub(super) fn watch_job(&mut self, was_running: bool) {
        let Some(job) = &self.machine.job else { return };
        if job.is_running {
            self.plan.is_beginning = false;
        }
        if job.is_running && job.takes_lines {
            self.plan.measured = Some(job.answered);
        }
        let is_stopping = job.is_running && !job.outcome.is_empty();
        if is_stopping && self.state_name() == "Hold" && job.is_held && job.first == 0 {
            self.plan.stopped_at = Some(self.machine.machine.clone());
        }
        if !was_running || job.is_running {
            return;
        }
        let is_done = job.outcome == "done";
        let undone = self
            .line_times()
            .map(|times| times.first_undone(job.answered));
        self.plan.clock = None;
        if !is_done && let Some(undone) = undone {
            // The worker finds the line itself.
            self.stop_in(undone);
            let began = self.plan.started.as_ref();
            self.plan.is_stop_unknown = began.is_some_and(|it| it.began.is_some());
        }
    }

    /// The job was stopped in a line, counted from 0: where a tool was measured, its change comes again.
    fn stop_in(&mut self, line: usize) {
        let line = { self.plan.measured }.map_or(line, |measured| measured.min(line));
        self.plan.stopped_in = Some(line + 1);
    }

    /// When the lines of the job that was started are carried out.
    fn line_times(&self) -> Option<&simulation::line_times::LineTimes> {
        let started = self.plan.started.as_ref()?;
        let checked = self.checked()?;
        let is_known = is_same(&started.program, &checked.program) && checked.time_s.is_some();
        is_known.then_some(&checked.line_times)
    }

    /// Some time has passed, s.
    pub(super) fn tick(&mut self, passed_s: f64) {
        let passed_s = passed_s * f64::from(self.time_factor.0);
        let Some(job) = self.machine.job.as_ref().filter(|job| job.is_running) else {
            self.plan.clock = None;
            return;
        };
        let Some(times) = self.line_times() else {
            return;
        };
        let clock = self.plan.clock.clone();
        let mut clock = clock.unwrap_or_else(|| JobClock::beginning_at(times, job.first));
        let undone = times.first_undone(job.answered).max(job.first);
        let report = JobReport {
            answered: job.answered,
            undone: undone.max(job.executed),
            is_held: job.is_held,
            feed_percent: self.machine.overrides[0],
        };
        clock.tick(times, report, passed_s);
        self.plan.clock = Some(clock);
    }
}

#[cfg(test)]
mod tests;
