//! What the page knows, in one place: the state of the machine, the lines, and what follows from both.

use std::{
    collections::{BTreeMap, VecDeque},
    rc::Rc,
};

use grbl_client::{
    Line,
    client::{Event, State},
};
use yew::Reducible;

mod plan;

use crate::{
    checker::CheckReply,
    worker::{Control, Reply, TimeFactor},
};
pub(crate) use plan::QUESTIONS as JOB_QUESTIONS;
pub use plan::{Check, CheckBasis, Checked, FoundEntry, PendingCheck, Plan, Purpose};

/// The questions whose answers are kept, beside those that come before a job, and how those begin that describe a setting.
const QUESTIONS: [&str; 3] = ["$EG", "$ES", "$I+"];
const DESCRIPTION_QUESTION: &str = "$SED=";
/// How many lines the console keeps.
const MOST_LINES: usize = 1000;

/// Whether there is a line to a machine.
#[derive(Debug, Clone, PartialEq, Eq)]
pub enum Connection {
    /// There is none: why, or nothing where the page closed it.
    Closed(String),
    /// The page has asked for one.
    Opening,
    /// There is one.
    Open,
}

impl Default for Connection {
    fn default() -> Self {
        Self::Closed(String::new())
    }
}

/// Who has written a line of the console.
#[derive(Debug, Clone, Copy, PartialEq, Eq)]
pub enum LineSource {
    /// The page's side.
    Operator,
    /// The machine.
    Machine,
    /// The client or the page: what the operator is to read.
    Note,
}

/// A line of the console.
#[derive(Debug, Clone, PartialEq, Eq)]
pub struct LogEntry {
    /// Its number, by which the page finds it again.
    pub number: u64,
    /// When: ms since midnight.
    pub time_ms: u32,
    /// Who.
    pub source: LineSource,
    /// What.
    pub text: String,
}

/// A program that is open.
#[derive(Debug, Clone, Default, PartialEq, Eq)]
pub struct Program {
    /// The name of its file.
    pub name: String,
    /// Its text, as it is now.
    pub text: String,
}

/// A line of the program that is to be seen, also where it was before and is out of sight.
#[derive(Debug, Clone, Copy, PartialEq, Eq)]
pub struct LineToShow {
    /// Counted from 1.
    pub line: usize,
    /// The number of the request.
    pub request: u32,
}

/// What the page knows.
#[derive(Debug, Clone, Default, PartialEq)]
pub struct Model {
    /// The program that is open.
    pub program: Option<Rc<Program>>,
    /// The line of it that is to be seen.
    pub go_to: Option<LineToShow>,
    /// What it will do.
    pub check: Check,
    /// What else is known before it runs and while it does.
    pub plan: Plan,
    /// It was edited on the page.
    pub is_edited: bool,
    /// A program that was edited, and in whose place another one was opened.
    pub replaced: Option<Rc<Program>>,
    /// Whether there is a line to a machine.
    pub connection: Connection,
    /// The machine, as its client knows it.
    pub machine: State,
    /// How fast it goes.
    pub time_factor: TimeFactor,
    /// Who controls the machine, where the local program has it.
    pub control: Option<Control>,
    /// The console.
    pub log: VecDeque<LogEntry>,
    /// Status reports are in it.
    pub shows_reports: bool,
    /// What the operator is to read now.
    pub note: String,
    /// What the machine has said when it was switched on, since the line is open.
    pub welcome: String,
    /// The probe has been seen closed, and open after that; or the operator says so.
    pub is_probe_checked: bool,
    /// What the machine has answered to questions such as `$#`, by the question.
    pub answers: BTreeMap<String, Rc<Vec<String>>>,
    /// The settings, as they are written, as far as they are known.
    pub settings: BTreeMap<u16, String>,
    /// Lines that are not answered, by their numbers.
    pub(crate) unanswered: BTreeMap<u32, String>,
    /// The probe has been seen closed.
    pub(crate) was_probe_closed: bool,
    pub(crate) entries: u64,
}

/// What changes it.
#[derive(Debug, Clone, PartialEq)]
pub enum Action {
    /// The client has replied, at a time in ms since midnight.
    Reply(Reply, u32),
    /// The page has asked for a line to a machine.
    Opening,
    /// The virtual machine goes so fast.
    TimeFactor(TimeFactor),
    /// The page has sent a line with a number.
    Sent(u32, String),
    /// Status reports are to be in the console, or not.
    ShowReports(bool),
    /// The console is emptied.
    Clear,
    /// A program is opened.
    Open(Rc<Program>),
    /// The program that is open has changed.
    Edit(Rc<Program>),
    /// The operator says whether the probe was checked.
    TrustProbe(bool),
    /// The machine is asked what the checker has to know.
    Ask(Purpose),
    /// The checker has been asked.
    BeginCheck(Box<PendingCheck>),
    /// The checker replies.
    CheckReply(CheckReply),
    /// The program is run all the same, or not.
    Permit(bool),
    /// The program is sent from a line on, counted from 0.
    Begin(usize),
    /// A line of the program is to be seen, counted from 1.
    GoTo(usize),
    /// Some time has passed, s.
    Tick(f64),
}

impl Reducible for Model {
    type Action = Action;

    fn reduce(self: Rc<Self>, action: Action) -> Rc<Self> {
        let mut model = Rc::unwrap_or_clone(self);
        model.act(action);
        Rc::new(model)
    }
}

impl Model {
    /// Whether another page controls the machine of the local program.
    pub fn is_watching(&self) -> bool {
        self.control
            .as_ref()
            .is_some_and(|control| !control.is_mine)
    }

    /// Whether a machine answers.
    pub fn is_there(&self) -> bool {
        self.connection == Connection::Open && self.machine.is_there
    }

    /// Whether this page may have the machine do something.
    pub fn may_operate(&self) -> bool {
        self.is_there() && !self.is_watching()
    }

    /// The state without its number: `Hold`.
    pub fn state_name(&self) -> &str {
        self.machine.state.split(':').next().unwrap_or_default()
    }

    /// Whether a job is under way.
    pub fn is_job_running(&self) -> bool {
        self.machine.job.as_ref().is_some_and(|job| job.is_running)
    }

    /// Whether the machine takes lines of the operator: it is there and at rest, and no job is under way.
    pub fn takes_lines(&self) -> bool {
        self.may_operate()
            && matches!(self.state_name(), "Idle" | "Tool" | "Check")
            && (!self.is_job_running() || self.takes_lines_amid_job())
    }

    /// Whether a job is in a change of the tool in which the machine takes lines.
    fn takes_lines_amid_job(&self) -> bool {
        self.machine.job.as_ref().is_some_and(|job| job.takes_lines)
    }

    /// Whether the machine may be jogged.
    pub fn may_jog(&self) -> bool {
        self.may_operate()
            && (!self.is_job_running() || self.takes_lines_amid_job())
            && matches!(self.state_name(), "Idle" | "Jog" | "Tool")
    }

    fn act(&mut self, action: Action) {
        match action {
            Action::Reply(reply, time_ms) => self.reply(reply, time_ms),
            Action::Opening => {
                *self = Self {
                    log: std::mem::take(&mut self.log),
                    program: self.program.take(),
                    check: std::mem::take(&mut self.check),
                    plan: std::mem::take(&mut self.plan).kept(),
                    is_edited: self.is_edited,
                    replaced: self.replaced.take(),
                    shows_reports: self.shows_reports,
                    entries: self.entries,
                    connection: Connection::Opening,
                    ..Self::default()
                }
            }
            Action::TimeFactor(factor) => self.time_factor = factor,
            Action::Sent(number, text) => {
                // What is asked before a job is no act of the operator.
                if !JOB_QUESTIONS.contains(&text.as_str()) {
                    self.note.clear();
                }
                self.unanswered.insert(number, text);
            }
            Action::ShowReports(shows) => self.shows_reports = shows,
            Action::Clear => self.log.clear(),
            Action::Open(program) => self.open(program),
            Action::Edit(program) => {
                self.change_program(program);
                self.is_edited = true;
            }
            Action::TrustProbe(is_checked) => self.is_probe_checked = is_checked,
            Action::Ask(purpose) => self.ask(purpose),
            Action::BeginCheck(pending_check) => self.begin_check(*pending_check),
            Action::CheckReply(reply) => self.take_check(reply),
            Action::Permit(is_permitted) => self.plan.is_permitted = is_permitted,
            Action::Begin(line) => self.begin_job(line),
            Action::GoTo(line) => {
                let request = self.go_to.map_or(0, |before| before.request + 1);
                self.go_to = Some(LineToShow { line, request });
            }
            Action::Tick(passed_s) => self.tick(passed_s),
        }
    }

    /// Takes a program in place of another one, of which no line is the same any more.
    fn change_program(&mut self, program: Rc<Program>) -> Option<Rc<Program>> {
        self.plan.forget_program();
        self.program.replace(program)
    }

    /// Opens a program; what was edited before can be opened again.
    fn open(&mut self, program: Rc<Program>) {
        let before = self.change_program(program);
        if std::mem::take(&mut self.is_edited) {
            self.replaced = before;
        }
        if self.replaced == self.program {
            self.replaced = None;
            self.is_edited = true;
        }
    }

    fn reply(&mut self, reply: Reply, time_ms: u32) {
        match reply {
            Reply::Connected => self.connection = Connection::Open,
            Reply::Disconnected(reason) => {
                let is_repeated = { self.log.back() }.is_some_and(|entry| entry.text == reason);
                if !reason.is_empty() && !is_repeated {
                    self.push(time_ms, LineSource::Note, reason.clone());
                }
                self.connection = Connection::Closed(reason);
                self.machine.is_there = false;
                self.machine.homed = None;
                self.plan.is_beginning = false;
                if self.plan.asked.is_some() {
                    self.fail_check("the machine is gone".into());
                }
                self.unanswered.clear();
                self.forget_machine();
            }
            Reply::Control(control) => self.control = Some(control),
            Reply::Events(events) => {
                for event in events {
                    self.event(event, time_ms);
                }
            }
        }
    }

    fn event(&mut self, event: Event, time_ms: u32) {
        match event {
            Event::State(state) => self.take_state(*state),
            Event::Line { is_sent, text } => self.take_line(is_sent, text, time_ms),
            Event::Answer {
                number,
                lines,
                response,
            } => self.take_answer(number, lines, &response),
            Event::Note { text } => {
                // A start that is refused says so.
                self.plan.is_beginning = false;
                self.push(time_ms, LineSource::Note, text.clone());
                self.note = text;
            }
        }
    }

    fn take_state(&mut self, state: State) {
        let was_running = self.is_job_running();
        self.machine = state;
        self.watch_job(was_running);
        let is_closed = self.machine.pins.contains('P');
        self.is_probe_checked |= self.was_probe_closed && !is_closed;
        self.was_probe_closed |= is_closed;
    }

    fn take_line(&mut self, is_sent: bool, text: String, time_ms: u32) {
        let source = if is_sent {
            LineSource::Operator
        } else {
            LineSource::Machine
        };
        let is_report = match Line::read(&text) {
            Line::Report(_) => true,
            Line::Welcome if !is_sent => {
                self.welcome.clone_from(&text);
                false
            }
            Line::Setting(number, value) if !is_sent => {
                self.take_setting(number, value);
                false
            }
            _ => false,
        };
        if !is_report || self.shows_reports {
            self.push(time_ms, source, text);
        }
    }

    fn take_setting(&mut self, number: u16, value: &str) {
        self.settings.insert(number, value.trim().into());
    }

    fn take_answer(&mut self, number: u32, lines: Vec<String>, response: &str) {
        let Some(text) = self.unanswered.remove(&number) else {
            return;
        };
        let is_question =
            QUESTIONS.contains(&text.as_str()) || text.starts_with(DESCRIPTION_QUESTION);
        if JOB_QUESTIONS.contains(&text.as_str()) {
            self.take_job_answer(text, lines, response);
        } else if text.starts_with("$I") && response.starts_with("error:") {
            // A machine that does not know the question has nothing to say: that is an answer.
            self.answers.insert(text, Rc::default());
        } else if let Some(error) = response.strip_prefix("error:") {
            let number = error.trim().parse().ok();
            let meaning = number.and_then(grbl_client::meaning::error_with_remedy);
            let meaning = meaning.map_or_else(String::new, |meaning| format!(", {meaning}"));
            self.note = format!("{text}: error {error}{meaning}");
        } else if response != "ok" {
            // The machine was reset.
        } else if text.to_ascii_uppercase().starts_with("$RST") {
            // Settings and places may be others now.
            self.answers.clear();
            self.settings.clear();
        } else if let Line::Setting(number, value) = Line::read(&text) {
            self.take_setting(number, value);
        } else if is_question {
            self.answers.insert(text, Rc::new(lines));
        }
    }

    /// Another machine may answer, or the same one with other firmware or another probe.
    fn forget_machine(&mut self) {
        self.answers
            .retain(|question, _| !question.starts_with("$I") && question != "$+");
        self.welcome.clear();
        self.is_probe_checked = false;
        self.was_probe_closed = false;
    }

    fn push(&mut self, time_ms: u32, source: LineSource, text: String) {
        if self.log.len() == MOST_LINES {
            self.log.pop_front();
        }
        self.entries += 1;
        self.log.push_back(LogEntry {
            number: self.entries,
            time_ms,
            source,
            text,
        });
    }
}

#[cfg(test)]
mod tests {
    use grbl_client::client::JobState;

    use super::*;

    fn after(events: Vec<Event>) -> Model {
        let mut model = Model::default();
        model.act(Action::Reply(Reply::Connected, 0));
        model.act(Action::Sent(1, "$H".into()));
        model.act(Action::Sent(2, "G999".into()));
        model.act(Action::Reply(Reply::Events(events), 5));
        model
    }

    fn state(name: &str, z_mm: f64) -> Event {
        Event::State(Box::new(State {
            is_there: true,
            state: name.into(),
            machine: vec![0.0, 0.0, z_mm],
            ..State::default()
        }))
    }

    fn answer(number: u32, response: &str) -> Event {
        Event::Answer {
            number,
            lines: Vec::new(),
            response: response.into(),
        }
    }

    fn line(text: &str) -> Event {
        Event::Line {
            is_sent: false,
            text: text.into(),
        }
    }

    #[test]
    fn amid_a_job_lines_and_jogs_are_taken_where_the_machine_takes_them() {
        let mut model = after(vec![state("Tool", 0.0)]);
        for takes_lines in [false, true] {
            model.machine.job = Some(JobState {
                is_running: true,
                takes_lines,
                ..JobState::default()
            });
            assert_eq!(
                (model.takes_lines(), model.may_jog()),
                (takes_lines, takes_lines)
            );
        }
    }

    #[test]
    fn a_page_that_watches_moves_nothing() {
        let mut model = after(vec![state("Idle", 0.0)]);
        let mut control = Control {
            is_mine: true,
            is_taken: true,
            machine: "tty".into(),
            is_connected: true,
        };
        model.act(Action::Reply(Reply::Control(control.clone()), 0));
        assert!(model.takes_lines() && model.may_jog());
        control.is_mine = false;
        model.act(Action::Reply(Reply::Control(control), 0));
        assert!(model.is_there() && !model.takes_lines() && !model.may_jog());
    }

    #[test]
    fn a_program_that_was_edited_can_be_opened_again() {
        let program = |name: &str| {
            Rc::new(Program {
                name: name.into(),
                text: String::new(),
            })
        };
        let names = |model: &Model| {
            let name = |program: &Option<Rc<Program>>| program.as_ref().map(|it| it.name.clone());
            (
                name(&model.program).unwrap_or_default(),
                name(&model.replaced),
            )
        };
        let mut model = Model::default();
        model.act(Action::Open(program("a.nc")));
        model.act(Action::Open(program("b.nc")));
        assert_eq!(names(&model), ("b.nc".into(), None));
        let edited = program("b.nc");
        model.act(Action::Edit(edited.clone()));
        model.act(Action::Open(program("c.nc")));
        assert_eq!(names(&model), ("c.nc".into(), Some("b.nc".into())));
        model.act(Action::Opening);
        model.act(Action::Open(edited));
        assert_eq!(names(&model), ("b.nc".into(), None));
        // It is still not saved.
        model.act(Action::Open(program("c.nc")));
        assert_eq!(names(&model), ("c.nc".into(), Some("b.nc".into())));
    }

    #[test]
    fn a_probe_is_checked_when_it_was_closed_and_is_open_again() {
        let with = |pins: &str| {
            let machine = State {
                pins: pins.into(),
                ..State::default()
            };
            Event::State(Box::new(machine))
        };
        let is_checked =
            |pins: &[&str]| after(pins.iter().map(|pins| with(pins)).collect()).is_probe_checked;
        assert!(!is_checked(&["", "X", ""]) && !is_checked(&["P"]));
        assert!(is_checked(&["P", "Z"]) && is_checked(&["", "PZ", "", "P"]));
        let mut model = after(vec![with("P"), with("")]);
        model.act(Action::Reply(Reply::Disconnected(String::new()), 1));
        assert!(!model.is_probe_checked);
        model.act(Action::TrustProbe(true));
        assert!(model.is_probe_checked);
    }

    #[test]
    fn a_machine_that_does_not_say_what_it_is_has_answered() {
        let mut model = after(Vec::new());
        for (number, question) in ["$I+", "$I"].into_iter().enumerate() {
            let number = number as u32 + 7;
            model.act(Action::Sent(number, question.into()));
            let events = vec![answer(number, "error:3"), line("Grbl 0.9j ['$' for help]")];
            model.act(Action::Reply(Reply::Events(events), 6));
            assert_eq!(
                model.answers.get(question).map(|lines| lines.len()),
                Some(0)
            );
        }
        assert!(model.note.is_empty() && model.welcome.starts_with("Grbl 0.9j"));
    }

    #[test]
    fn a_line_is_to_be_seen_again_at_each_request() {
        let mut model = Model::default();
        model.act(Action::GoTo(7));
        let first = model.go_to;
        model.act(Action::GoTo(7));
        assert_eq!(model.go_to.map(|it| it.line), Some(7));
        assert_ne!(model.go_to, first);
    }

    #[test]
    fn an_error_is_explained_beside_its_line() {
        let model = after(vec![answer(2, "error:20")]);
        assert!(model.note.starts_with("G999: error 20, "), "{}", model.note);
        assert!(model.note.contains("remove the word"), "{}", model.note);
    }

    #[test]
    fn reports_are_in_the_console_where_they_are_asked_for() {
        let lines = || vec![line("<Idle|MPos:0,0,0|FS:0,0>"), line("ok"), line("$13=1")];
        let mut model = after(lines());
        assert_eq!(model.log.len(), 2);
        assert_eq!(model.settings[&13], "1");
        model.act(Action::ShowReports(true));
        model.act(Action::Reply(Reply::Events(lines()), 6));
        assert_eq!(model.log.len(), 5);
        for _ in 0..MOST_LINES {
            model.act(Action::Reply(Reply::Events(lines()), 7));
        }
        assert_eq!(model.log.len(), MOST_LINES);
    }

    #[test]
    fn a_lost_line_is_told_and_takes_the_machine_away() {
        let mut model = after(vec![state("Idle", 0.0)]);
        assert!(model.takes_lines() && model.may_jog());
        model.act(Action::Reply(
            Reply::Disconnected("the cable is out".into()),
            1,
        ));
        assert!(!model.is_there() && !model.may_jog());
        assert_eq!(model.log.back().unwrap().text, "the cable is out");
        model.act(Action::Opening);
        assert_eq!(model.machine, State::default());
    }
}
