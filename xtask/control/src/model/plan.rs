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
const CHANGING: [&str; 3] = ["$#", "$TT", "$G"];
/// Answers of a machine that is not idle, or locked.
const NOT_NOW: [&str; 2] = ["error:8", "error:9"];
/// How far two offsets may differ that are the same, in the unit of reports: they are differences of rounded numbers.
const ROUNDED: f64 = 0.002;

/// What a check depends on, beside the program.
#[derive(Debug, Clone, Default, PartialEq)]
pub struct Basis {
    is_there: bool,
    /// The work zero, as machine position.
    offset: Vec<f64>,
    /// The modes that stay from one program to the next.
    modes: Vec<String>,
    settings: BTreeMap<u16, String>,
}

impl Basis {
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
    basis: Basis,
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
pub struct Inquiry {
    purpose: Purpose,
    program: Rc<Program>,
    machine: Option<MachineAnswers>,
    basis: Basis,
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
    basis: Basis,
}

/// The program before it runs, and the job.
#[derive(Debug, Clone, Default, PartialEq)]
pub struct Plan {
    /// For what the machine is being asked.
    pub(crate) asked: Option<Purpose>,
    inquiry: Option<Inquiry>,
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
        let is_valid = |checked: &&Rc<Checked>| checked.basis.is_same(&Basis::of(self));
        self.checked().filter(is_valid)
    }

    /// Whether the machine is where it says, and can be asked.
    pub fn may_ask(&self) -> bool {
        let is_free = !self.is_job_running() && !self.plan.is_beginning;
        self.takes_lines() && self.state_name() == "Idle" && is_free
    }

    /// Whether the machine or the checker is at work for the page.
    pub fn is_checking(&self) -> bool {
        self.plan.asked.is_some() || self.plan.inquiry.is_some()
    }

    /// Where the program may begin at the machine as it is now, or why nowhere.
    pub fn entry(&self) -> Option<Result<&Rc<FoundEntry>, &str>> {
        match self.plan.entry.as_ref()? {
            Ok(found) => found.basis.is_same(&Basis::of(self)).then_some(Ok(found)),
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
        for question in CHANGING {
            self.answers.remove(question);
        }
        if purpose == Purpose::Check {
            self.check = Check::Running { part: 0.0 };
            self.plan.is_permitted = false;
        } else {
            self.plan.entry = None;
        }
        self.plan.inquiry = None;
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
        let is_open =
            |question: &&str| CHANGING.contains(question) || !self.answers.contains_key(*question);
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
    pub(crate) fn inquiry(&self) -> Option<(Inquiry, CheckRequest)> {
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
        let inquiry = Inquiry {
            purpose,
            program,
            machine,
            basis: Basis::of(self),
        };
        Some((inquiry, request))
    }

    /// The checker has been asked.
    pub(super) fn begin_inquiry(&mut self, inquiry: Inquiry) {
        self.plan.asked = None;
        self.plan.is_stop_unknown = false;
        self.plan.inquiry = Some(inquiry);
    }

    /// There will be no reply.
    pub(super) fn fail_check(&mut self, reason: String) {
        let asked = self.plan.asked.take();
        let inquiry = self.plan.inquiry.take();
        match asked.or(inquiry.map(|inquiry| inquiry.purpose)) {
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
                if let Some(inquiry) = self.plan.inquiry.take() {
                    self.check = Check::Done(Rc::new(Checked {
                        program: inquiry.program,
                        machine: inquiry.machine,
                        basis: inquiry.basis,
                        view: std::mem::take(&mut findings.view).into(),
                        findings: *findings,
                    }));
                }
            }
            CheckReply::Entry(entry) => {
                if let Some(Inquiry {
                    purpose: Purpose::Enter(wanted),
                    program,
                    basis,
                    ..
                }) = self.plan.inquiry.take()
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
                self.plan.inquiry = None;
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
mod tests {
    use grbl_client::client::{Event, JobState, State};

    use super::*;
    use crate::{
        checker::reply,
        model::{Action, Reply},
    };

    const PROGRAM: &str = "G21 G90\nG1 X10 F600\nX0\nX10\nX0\nG4 P1\n";

    fn state(name: &str, x: f64, job: impl Into<Option<JobState>>) -> Action {
        let state = State {
            is_there: true,
            state: name.into(),
            machine: vec![x, 0.0, 0.0],
            work: vec![x, 0.0, 0.0],
            overrides: [100; 3],
            job: job.into(),
            ..State::default()
        };
        Action::Reply(Reply::Events(vec![Event::State(Box::new(state))]), 0)
    }

    fn job(answered: usize, is_running: bool, outcome: &str) -> JobState {
        JobState {
            name: "a.nc".into(),
            lines: 6,
            answered,
            is_running,
            is_held: is_running && !outcome.is_empty(),
            outcome: outcome.into(),
            ..JobState::default()
        }
    }

    /// An idle machine with a program.
    fn model() -> Model {
        let mut model = Model::default();
        model.act(Action::Reply(Reply::Connected, 0));
        model.act(state("Idle", 0.0, None));
        let program = Program {
            name: "a.nc".into(),
            text: PROGRAM.into(),
        };
        model.act(Action::Open(Rc::new(program)));
        model
    }

    /// Asks the machine, answers as it would, and has the checker reply.
    fn find(model: &mut Model, purpose: Purpose) {
        model.act(Action::Ask(purpose));
        assert!(model.inquiry().is_none(), "nothing is known of the machine");
        let questions: Vec<_> = model.questions().collect();
        for (number, question) in (1..).zip(questions) {
            model.act(Action::Sent(number, question.into()));
            let (lines, response): (&[&str], _) = match question {
                "$+" => (&["$120=500.000", "$110=3000.000", "$130=200.000"], "ok"),
                "$#" => (&["[G54:0.000,0.000,0.000]"], "ok"),
                "$G" => (&["[GC:G0 G54 G17 G21 G90 G94 M5 M9 T0 F0 S0]"], "ok"),
                // As Grbl, which has no table of tools.
                "$TT" => (&[], "error:3"),
                _ => (&["[VER:1.1h.20190830:]"], "ok"),
            };
            let answer = Event::Answer {
                number,
                lines: lines.iter().map(ToString::to_string).collect(),
                response: response.into(),
            };
            model.act(Action::Reply(Reply::Events(vec![answer]), 0));
        }
        answer(model);
    }

    fn answer(model: &mut Model) {
        let (inquiry, request) = model.inquiry().expect("everything is known");
        model.act(Action::Inquire(Box::new(inquiry)));
        assert!(model.is_checking() && model.inquiry().is_none());
        model.act(Action::CheckReply(reply(&request, |_| ())));
        assert!(!model.is_checking());
    }

    #[test]
    fn a_check_counts_as_long_as_program_and_machine_are_the_same() {
        let mut model = model();
        find(&mut model, Purpose::Check);
        assert_eq!(model.note, "");
        let checked = Rc::clone(model.valid_check().expect("it is checked"));
        assert_eq!(checked.extents_mm[0].travel, Some([-200.0, 0.0]));
        // Elsewhere the zero is the same.
        model.act(state("Idle", 3.0, None));
        assert!(model.valid_check().is_some());
        model.machine.work[0] = 0.0;
        assert!(model.valid_check().is_none() && model.checked().is_some());
        model.act(state("Idle", 3.0, None));
        model.settings.insert(110, "1000.000".into());
        assert!(model.valid_check().is_none());
        let edited = Program::clone(model.program.as_ref().unwrap());
        model.act(Action::Open(Rc::new(edited)));
        assert!(model.checked().is_none());
    }

    #[test]
    fn a_machine_that_goes_while_it_is_asked_ends_the_check() {
        let mut model = model();
        model.act(Action::Ask(Purpose::Check));
        model.act(Action::Reply(
            Reply::Disconnected("the cable is out".into()),
            0,
        ));
        assert_eq!(model.check, Check::Failed("the machine is gone".into()));
        assert!(model.inquiry().is_none());
    }

    #[test]
    fn the_time_that_is_left_stands_in_a_hold_and_the_line_is_known() {
        let mut model = model();
        find(&mut model, Purpose::Check);
        model.act(Action::Begin(0));
        model.act(state("Run", 0.0, job(5, true, "")));
        model.act(Action::Tick(0.25));
        let whole_s = model.progress().unwrap().left_s;
        assert!((4.0..6.0).contains(&whole_s), "{whole_s}");
        for _ in 0..6 {
            model.act(Action::Tick(0.25));
        }
        let progress = model.progress().unwrap().clone();
        assert!(
            (whole_s - progress.left_s - 1.5).abs() < 0.01,
            "{progress:?}"
        );
        assert_eq!((progress.line, model.executed_line()), (2, Some(3)));
        let held = JobState {
            is_held: true,
            ..job(5, true, "")
        };
        model.act(state("Hold:0", 4.0, held));
        for _ in 0..100 {
            model.act(Action::Tick(0.25));
        }
        assert_eq!(model.progress(), Some(&progress));
        model.act(state("Idle", 0.0, job(6, false, "done")));
        model.act(Action::Tick(0.25));
        assert_eq!((model.progress(), model.plan.stopped_in), (None, None));
    }

    #[test]
    fn after_a_stop_the_job_goes_on_at_its_line() {
        let mut model = model();
        find(&mut model, Purpose::Check);
        model.act(Action::Begin(0));
        model.act(state("Run", 0.0, job(5, true, "")));
        model.act(state("Hold:0", 4.0, job(5, true, "stopped")));
        model.act(state("Idle", 4.0, job(5, false, "stopped")));
        // The answers alone lead back to a line that is surely not done.
        assert_eq!(model.plan.stopped_in, Some(2));
        answer(&mut model);
        assert_eq!(model.plan.stopped_in, Some(2));
        find(&mut model, Purpose::Enter(2));
        let Some(Ok(found)) = model.entry() else {
            panic!("{:?}", model.plan.entry);
        };
        assert_eq!((found.wanted, found.entry.line), (2, 1));
        // With another zero it is another place.
        model.machine.work[0] += 1.0;
        assert_eq!(model.entry(), None);
        model.machine.work[0] -= 1.0;
        assert!(model.entry().is_some() && model.may_ask());
        model.act(Action::Begin(1));
        assert_eq!((model.plan.stopped_in, model.entry()), (None, None));
        // Until the job has begun, nothing else is sent.
        assert!(!model.may_ask());
        model.act(state("Run", 4.0, job(1, true, "")));
        model.act(state("Idle", 4.0, job(6, false, "done")));
        assert!(model.may_ask());
    }

    #[test]
    fn a_tool_that_was_measured_amid_the_job_is_changed_again() {
        let mut model = model();
        find(&mut model, Purpose::Check);
        model.act(Action::Begin(0));
        let changing = JobState {
            takes_lines: true,
            ..job(1, true, "")
        };
        model.act(state("Tool", 0.0, changing));
        model.act(state("Run", 0.0, job(6, true, "")));
        model.act(state("Idle", 0.0, job(6, false, "stopped")));
        assert_eq!(model.plan.stopped_in, Some(2));
        answer(&mut model);
        assert_eq!(model.plan.stopped_in, Some(2));
        model.act(Action::Ask(Purpose::Enter(2)));
        model.answers.insert("$#".into(), Rc::default());
        model.answers.insert("$TT".into(), Rc::default());
        model.answers.insert("$G".into(), Rc::default());
        let request = model.inquiry().unwrap().1;
        assert!(matches!(
            request,
            CheckRequest::Enter {
                reports_tool: true,
                ..
            }
        ));
    }

    #[test]
    fn a_machine_that_is_not_idle_ends_the_check() {
        let mut model = model();
        model.act(Action::Ask(Purpose::Check));
        model.act(Action::Sent(1, "$+".into()));
        let answer = Event::Answer {
            number: 1,
            lines: Vec::new(),
            response: "error:8".into(),
        };
        model.act(Action::Reply(Reply::Events(vec![answer]), 0));
        assert!(matches!(model.check, Check::Failed(_)) && !model.answers.contains_key("$+"));
    }

    #[test]
    fn a_program_that_was_not_checked_has_no_times() {
        let mut model = model();
        model.act(Action::Begin(0));
        model.act(state("Run", 0.0, job(2, true, "")));
        model.act(Action::Tick(1.0));
        assert_eq!(model.progress(), None);
        model.act(state("Idle", 0.0, job(2, false, "stopped")));
        assert_eq!(model.plan.stopped_in, None);
    }
}
