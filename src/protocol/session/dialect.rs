//! The session's end of the dialects that it does not speak itself.

use super::{AfterCommands, LineStage, Ports, Progress, Session};
use crate::{
    gcode::{LineError, PlainPrefix},
    machine::Snapshot,
    path::Work,
    protocol::{
        Dialect,
        dialect::{NextStep, SenderDialect, SessionContext},
        reprap::RepRap,
    },
};

impl Session {
    /// Lends a dialect what it works with.
    fn lend<'a>(&'a mut self, ports: &Ports<'a, '_>) -> (&'a mut RepRap, SessionContext<'a>) {
        let is_done = self.path.is_done(ports.machine);
        let reset_count = self.path.sync.reset_count;
        let has_reset = !matches!(self.stage, LineStage::Starting { .. })
            && ports.machine.reset_count == reset_count
            && ports.requests.reset_count() == reset_count;
        let conversation = SessionContext {
            machine: ports.machine,
            requests: ports.requests,
            settings: &self.persistence.stored.settings,
            interpreter: &mut self.line.interpreter,
            reports: &mut self.reports,
            lines: &mut self.lines,
            input: &mut self.line.input,
            dialect: self.dialect,
            stage: self.stage,
            is_done,
            has_reset,
            has_release_request: &mut self.path.sync.has_release_request,
        };
        (&mut self.host, conversation)
    }

    /// Adopts the dialect once the changing line has been answered, and does the work that cannot wait for the lines
    /// before.
    pub(super) fn attend_dialect(&mut self, ports: &mut Ports<'_, '_>) {
        let dialect = Dialect::of(self.settings());
        let is_between_lines = matches!(
            self.stage,
            LineStage::Starting { .. } | LineStage::Welcoming | LineStage::Reading
        );
        let is_changed = dialect != self.dialect && is_between_lines;
        if is_changed {
            self.dialect = dialect;
            self.lines.reset();
        }
        if is_changed || self.needs_clock() {
            let has_room = ports.entries.ready();
            let (host, mut conversation) = self.lend(ports);
            if let Some(work) = host.attend(&mut conversation, ports.received, has_room) {
                self.path.send_work(work, ports.entries);
            }
        }
    }

    /// Returns the step by a dialect beside Grbl's for the next line, or for the line that has been begun.
    pub(super) fn read_in_dialect(&mut self, ports: &mut Ports<'_, '_>) -> Option<NextStep> {
        let (host, mut conversation) = self.lend(ports);
        host.read_line(&mut conversation, ports.received)
    }

    /// Does what a dialect has made of a line.
    pub(super) fn take_step(&mut self, step: NextStep, ports: &mut Ports<'_, '_>) -> Progress {
        match step {
            NextStep::Wait => {
                self.path.flush_in_time(ports.machine, ports.entries);
                Progress::Waiting
            }
            NextStep::Skip => self.begin_line(),
            NextStep::Execute => {
                self.line.prefix = PlainPrefix::default();
                self.dispatch(ports)
            }
            NextStep::Answer(result) => self.end_line(result),
            NextStep::RefuseLost => self.refuse_with_hold(LineError::BytesLost, ports),
            NextStep::AwaitStandstill => self.await_standstill(),
            NextStep::Home(mask) => self.home(mask, ports),
            NextStep::Reset { is_answered: true } => self.answer_and_reset(),
            NextStep::Reset { is_answered: false } => self.enter(LineStage::Resetting),
            NextStep::List(line) => self.enter(LineStage::ListingInDialect(line)),
            NextStep::Drivers(are_on) => {
                self.path.send_work(Work::Drivers(are_on), ports.entries);
                self.enter(LineStage::Completing(AfterCommands::Answer))
            }
            NextStep::Configure => {
                self.configure(ports);
                self.enter(LineStage::Completing(AfterCommands::Answer))
            }
        }
    }

    /// Returns whether the machine has stopped for a reason that only a reset ends, and lines are refused.
    pub(super) fn is_refusing(&self, machine: &Snapshot) -> bool {
        self.host.rules().answers_when_stopped && (machine.is_critical || machine.has_underrun)
    }

    /// Returns whether the session needs the clock of `interpret`.
    #[must_use]
    pub fn needs_clock(&self) -> bool {
        self.host.rules().next_byte.is_some()
    }

    /// Returns whether there is something to do at the next tick of the clock, whatever else comes.
    /// `received` is the number of bytes received so far, wrapping.
    #[must_use]
    pub fn awaits_tick(&self, received: usize) -> bool {
        let rules = self.host.rules();
        (rules.next_byte).is_some_and(|next| rules.is_timed || next != received)
    }
}
