//! What the machine says: to whom its answers belong.
//!
//! After an alarm, the failure of a job or a new connection, answers to lines of before may still come. None of them
//! counts until the machine has answered a question that was asked at rest, and has said nothing since.

use std::mem;

use super::{BEYOND_TRAVEL, Client, Event, Origin, QueuedLine};
use crate::{Line, Response, meaning, realtime, sender::Received};

/// The question: machines answer it in any state, with a line of its own.
const QUESTION: &str = "$G";
/// What a machine says that answers nothing until it is reset.
const RESET_NEEDED: &str = "Reset to continue";
/// Reports in which nothing else may come behind its answer.
const SETTLED: u32 = 2;
/// Reports after which it is asked again.
const PATIENCE: u32 = 20;

/// Whether it is known to which lines answers belong.
#[derive(Debug, Clone, Copy, Default, PartialEq)]
pub(super) enum AnswerSync {
    /// It is not.
    #[default]
    Unknown,
    /// The question was asked, so many reports ago.
    Asked(u32),
    /// The line that answers it has come, but not its `ok`.
    Answered,
    /// It was answered, so many reports ago.
    Settling(u32),
    /// It is: no answer to anything else is due.
    Known,
    /// The machine answers nothing until it is reset.
    Mute,
}

impl Client {
    /// Does not know any more to which lines answers belong: those that wait for one get none.
    pub(super) fn lose_answers(&mut self) {
        if self.answers != AnswerSync::Mute {
            self.answers = AnswerSync::Unknown;
        }
        self.sender = crate::Sender::default();
        for asked in mem::take(&mut self.in_flight) {
            self.answer(asked, "");
        }
    }

    /// Finds out to which lines answers belong, at rest.
    pub(super) fn settle_answers(&mut self) {
        let is_at_rest = self.is_quiet() && self.state.is_there;
        if self.answers == AnswerSync::Unknown && self.job.is_none() && is_at_rest {
            self.answers = AnswerSync::Asked(0);
            self.output.extend(QUESTION.as_bytes());
            self.output.push(b'\n');
            self.note(Event::Line {
                is_sent: true,
                text: QUESTION.into(),
            });
        }
    }

    /// Whether the machine does nothing, and carries out lines.
    pub(super) fn is_quiet(&self) -> bool {
        let name = self.status.report.state_name();
        matches!(name, "Idle" | "Alarm" | "Check" | "Tool")
    }

    /// Takes a line while it is not known to which lines answers belong. Returns whether it is nobody's answer.
    fn settle(&mut self, line: &Line<'_>) -> bool {
        use AnswerSync::{Answered, Asked, Known, Mute, Settling, Unknown};
        self.answers = match (self.answers, line) {
            (Known, _) => return false,
            (_, Line::Welcome) => Known,
            (Mute, _) => Mute,
            (Asked(_), Line::Answer("GC", _)) => Answered,
            (Answered, Line::Response(_)) => Settling(0),
            // It is of a line of before: the answer was, too.
            (Settling(_), Line::Response(_)) | (Asked(PATIENCE..), Line::Report(_)) => Unknown,
            (Asked(reports), Line::Report(_)) => Asked(reports + 1),
            (Settling(SETTLED..), Line::Report(_)) => {
                self.are_modes_old = false;
                Known
            }
            (Settling(reports), Line::Report(_)) => Settling(reports + 1),
            (answers, _) => answers,
        };
        matches!(line, Line::Response(_))
    }

    pub(super) fn receive_line(&mut self, text: &str) {
        self.note(Event::Line {
            is_sent: false,
            text: text.into(),
        });
        let line = Line::read(text);
        if line == Line::Message(RESET_NEEDED) {
            self.answers = AnswerSync::Mute;
        }
        let is_surplus = self.job.is_none() && self.settle(&line);
        match &line {
            Line::Report(report) => {
                self.status.take(report.clone());
                self.receive_report();
            }
            Line::Alarm(number) => self.receive_alarm(number),
            Line::Setting(..) => self.take_setting(text),
            Line::Answer("GC", words) => self.take_modes(words),
            _ => {}
        }
        if self.job.is_some() {
            self.receive_of_job(text);
        } else if line == Line::Welcome {
            self.forget();
            // It may have been switched off.
            self.state.reference_mm = None;
            self.are_modes_old = true;
        } else if !is_surplus {
            self.receive_of_operator(text);
        }
        if line == Line::Welcome {
            self.forget_homing();
        }
    }

    /// Takes the report that has come.
    fn receive_report(&mut self) {
        self.reports = self.reports.saturating_add(1);
        let report = &self.status.report;
        // The first may be older than the hold.
        if self.stopping.is_some_and(|reports| reports > 0) && report.is_at_rest() {
            self.stopping = None;
            self.output.push(realtime::RESET);
        }
        self.stopping.iter_mut().for_each(|reports| *reports += 1);
        // A jog that was on the line when the others were cancelled begins all the same.
        self.is_cancelling &= self.has_jogs();
        if self.is_cancelling {
            self.output.push(realtime::JOG_CANCEL);
        }
        match self.status.report.state_name() {
            "Alarm" => return self.forget_homing(),
            "Idle" if mem::take(&mut self.has_homed) => {
                self.state.homed = self.status.machine_position();
            }
            _ => {}
        }
        self.state.alarm = None;
    }

    fn receive_alarm(&mut self, number: &str) {
        self.end_cycle("the machine is in alarm, and the probing cycle has ended");
        self.end_press();
        self.reports = 0;
        self.drop_waiting("the machine is in alarm: lines that wait are not sent");
        let text = meaning::alarm_with_remedy(number, None).unwrap_or_default();
        self.state.alarm = Some((number.into(), text));
        if self.job.is_none() {
            self.lose_answers();
        }
    }

    /// The position may be another one than that of homing.
    pub(super) fn forget_homing(&mut self) {
        self.state.homed = None;
        self.has_homed = false;
    }

    fn take_modes(&mut self, words: &str) {
        self.state.modes = words.split(' ').map(str::to_owned).collect();
        if mem::take(&mut self.are_modes_changed) {
            let text = format!("the probing cycle did not come to its end: in force is {words}");
            self.note(Event::Note { text });
        }
    }

    fn receive_of_operator(&mut self, text: &str) {
        match self.sender.receive(text) {
            Received::Answer(answered) => self.answered(answered.response),
            Received::Message => self.keep(text),
            Received::Surplus(_) => {}
        }
    }

    fn receive_of_job(&mut self, text: &str) {
        let Some(job) = &mut self.job else { return };
        let response = Response::parse(text).filter(|_| job.manual_lines.awaits_answer());
        job.receive(text);
        match response {
            Some(response) => self.answered(response),
            None => self.keep(text),
        }
    }

    /// Keeps what comes before an answer.
    fn keep(&mut self, text: &str) {
        if !text.starts_with('<')
            && let Some(asked) = self.in_flight.front_mut()
        {
            asked.lines.push(text.into());
        }
    }

    /// The oldest line is answered.
    fn answered(&mut self, response: Response) {
        let Some(asked) = self.in_flight.pop_front() else {
            return;
        };
        self.reports = 0;
        // A jog that has ended has nobody who waits for its answer.
        if asked.of == Origin::Jog(self.jogs)
            && let Some(jog) = &mut self.jog
        {
            jog.answer(response == BEYOND_TRAVEL);
        }
        self.are_modes_old |= !asked.text.starts_with('$');
        let is_of_page = matches!(asked.of, Origin::Page(_));
        let is_question = asked.text.starts_with('$') && !asked.is_jog();
        if response != Response::Ok && is_of_page && !is_question {
            self.drop_waiting("a line was refused: the lines after it are not sent");
        }
        if response == Response::Ok {
            self.take_setting(&asked.text);
            self.has_homed |= asked.text.eq_ignore_ascii_case("$H");
        }
        self.answer(asked, &response.to_string());
    }

    pub(super) fn answer(&mut self, asked: QueuedLine, response: &str) {
        let QueuedLine { of, text, lines } = asked;
        match of {
            Origin::Page(Some(number)) => {
                let response = response.into();
                self.note(Event::Answer {
                    number,
                    lines,
                    response,
                });
            }
            Origin::Own | Origin::Page(None) if response.starts_with("error") => {
                self.note(Event::Note {
                    text: format!("{text}: {response}"),
                });
            }
            Origin::Cycle => self.take_contact(&lines, response),
            Origin::Own | Origin::Page(None) | Origin::Jog(_) => {}
        }
    }
}
