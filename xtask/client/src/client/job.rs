//! The client's part in a job: its start, the keys of its operator, and how far it is.

use super::{Client, Command, Event, JobState, Program, REST_REPORTS, Start};
use crate::{
    Transmission, realtime,
    sender::sendable,
    transmission::{Key, Phase},
};

impl Client {
    /// Takes one of the bytes that machines obey at once.
    pub(super) fn realtime(&mut self, byte: u8) {
        if !matches!(byte, b'?' | b'!' | b'~' | realtime::RESET | 0x80..) {
            return;
        }
        if matches!(byte, realtime::HOLD | realtime::JOG_CANCEL) {
            // What it stops does not begin again by itself.
            self.halt();
        }
        let key = match byte {
            // Cycle start would begin the job amid what the operator does in a change of the tool.
            realtime::RESUME if self.takes_lines_amid_job() && !self.is_held() => {
                return self.leave_change();
            }
            realtime::HOLD => Key::Hold,
            realtime::RESUME => Key::Resume,
            byte => Key::Realtime(byte),
        };
        let is_of_job = !self.takes_lines_amid_job();
        match &mut self.job {
            Some(job) if is_of_job && job.phase == Phase::Running => job.press(key),
            _ => self.output.push(byte),
        }
    }

    /// Goes on with the job after a change of the tool, at rest.
    fn leave_change(&mut self) {
        let is_at_rest = self.status.report.state_name() == "Tool" && self.reports >= REST_REPORTS;
        if is_at_rest && self.is_silent() {
            self.key(Key::Resume);
        } else {
            let text = "the job goes on from rest alone: wait for the end of the motion".into();
            self.note(Event::Note { text });
        }
    }

    /// Whether the machine is held on its way.
    fn is_held(&self) -> bool {
        let report = &self.status.report;
        report.is_held() && report.state_name() != "Tool"
    }

    pub(super) fn key(&mut self, key: Key) {
        if let Some(job) = &mut self.job {
            job.press(key);
        }
    }

    /// Stops a probing cycle, or the job.
    pub(super) fn stop(&mut self) {
        if self.cycle.is_none() {
            self.key(Key::Stop);
        } else if self.job.is_some() {
            self.end_cycle(
                "the probing cycle was stopped: resume ends its move, and stop ends the job",
            );
            self.realtime(realtime::HOLD);
        } else {
            self.end_cycle("the probing cycle was stopped");
            self.stopping = Some(0);
            self.output.push(realtime::HOLD);
        }
    }

    pub(super) fn take_program(&mut self, name: String, text: &str) {
        if self.job.is_some() {
            return;
        }
        self.program = Program {
            name,
            lines: { text.trim_start_matches('\u{feff}').lines() }
                .flat_map(|line| line.split('\r'))
                .map(|line| sendable(line.as_bytes()))
                .collect(),
        };
        self.state.job = Some(JobState {
            name: self.program.name.clone(),
            lines: self.program.lines.len(),
            ..JobState::default()
        });
    }

    /// Begins the job, where nothing else is under way.
    pub(super) fn start(&mut self, start: Start) {
        let lines = self.program.lines.len();
        let is_idle = self.status.report.state_name() == "Idle" && self.state.is_there;
        let fault = if !is_idle || !self.is_free_but_for_questions() || lines == 0 {
            Some("the job begins at rest alone: the machine has to be idle".into())
        } else if start.line >= lines {
            let line = start.line.saturating_add(1);
            Some(format!("there is no line {line}: the program has {lines}"))
        } else {
            None
        };
        match fault {
            Some(text) => self.note(Event::Note { text }),
            None => self.start_asked = Some(start),
        }
    }

    /// Sends the job, once nothing else will be answered.
    pub(super) fn begin_job(&mut self) {
        if !self.is_answered() {
            return;
        }
        let Some(Start { line, approach }) = self.start_asked.take() else {
            return;
        };
        if self.status.report.state_name() != "Idle" || !self.state.is_there {
            let text = "the job was not begun: the machine is not idle any more".into();
            self.note(Event::Note { text });
            return;
        }
        let mut job = Transmission::new(&approach, &self.program.lines, line, false);
        job.status.clone_from(&self.status);
        job.has_keyboard = false;
        self.job = Some(job);
    }

    /// Whether a job is in a change of the tool in which the machine takes the operator's lines.
    pub(super) fn takes_lines_amid_job(&self) -> bool {
        { self.job.as_ref() }.is_some_and(|job| job.manual_lines.takes_lines())
    }

    /// Why a job, or what has been asked for before, does not let a command be carried out.
    pub(super) fn obstacle_of_job(&self, command: &Command) -> Option<&'static str> {
        let is_motion = command.may_move();
        let is_start = matches!(command, Command::Program { .. } | Command::Start { .. });
        if self.start_asked.is_some() && (is_motion || is_start) {
            Some("the job begins: nothing else is sent")
        } else if is_motion && self.job.is_some() && !self.takes_lines_amid_job() {
            Some("the job is under way: other lines are taken in a change of the tool alone")
        } else {
            None
        }
    }

    pub(super) fn show_job(&mut self) {
        let Some(job) = &mut self.job else { return };
        for text in job.take_notes() {
            self.events.push(Event::Note { text });
        }
        let outcome = match &job.phase {
            Phase::Running => String::new(),
            Phase::Stopping(reason) | Phase::Resetting(reason) | Phase::Failed(reason) => {
                reason.clone()
            }
            Phase::Done => "done".into(),
        };
        let is_done = job.phase == Phase::Done;
        let is_running = !is_done && !matches!(job.phase, Phase::Failed(_));
        self.state.job = Some(JobState {
            name: self.program.name.clone(),
            lines: self.program.lines.len(),
            first: job.first,
            answered: job.answered(),
            executed: if job.undone > job.first {
                job.undone
            } else {
                0
            },
            is_running,
            is_held: is_running && job.status.report.is_held(),
            waits: job.waits().map(str::to_owned),
            takes_lines: is_running && job.manual_lines.takes_lines(),
            outcome,
        });
        if is_running {
            return;
        }
        self.job = None;
        self.forget();
        self.are_modes_old = true;
        if !is_done {
            self.lose_answers();
        }
    }
}
