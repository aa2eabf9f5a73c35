//! A session, and a machine that executes every entry.

use grbl_client::Report;
use heapless::spsc::Queue;
use leadscrew::{
    axis::AXES,
    machine::Snapshot,
    model::{
        Alarm, Levels, Notice, Override, Overrides, Probing, Release, Requests, State, TOOL_CHANGE,
    },
    path::{Block, Entry, MoveKind, Work},
    protocol::{Bytes, Progress, Session, realtime},
    settings::{Change, Settings, StoreError, Stored},
};

use super::{machine::is_answer, support::assigned};

pub(crate) const WELCOME: [&str; 2] = ["", "Grbl 1.1h ['$' for help]"];
pub(crate) const UNLOCK: &str = "[MSG:'$H'|'$X' to unlock]";

/// A session with its queues and a machine that finishes each entry at once, unless it withholds.
pub(crate) struct Bench {
    pub(crate) session: Session,
    pub(crate) requests: Requests,
    pub(crate) received: Bytes<1024>,
    pub(crate) sent: Bytes<512>,
    pub(crate) entries: Queue<Entry, 4>,
    pub(crate) machine: Snapshot,
    /// Waiting for cycle start after `M0`.
    is_paused: bool,
    /// The same after `M6`.
    waits_for_tool: bool,
    /// The machine takes no entries: as if the planner were full of blocks.
    pub(crate) withholds: bool,
    /// The sender reads nothing.
    pub(crate) is_unread: bool,
    /// The flash refuses to store.
    pub(crate) flash_fails: bool,
    /// A reset comes while the flash stores.
    pub(crate) resets_in_store: bool,
    /// What homing fails with.
    pub(crate) homing_fails: Option<Alarm>,
    /// How a probing move ends; with its alarm where it is one.
    pub(crate) probe_ends: Result<[i32; 3], Option<Alarm>>,
    output: Vec<u8>,
    pub(crate) done: Vec<Work>,
    pub(crate) changes: Vec<Change>,
}

impl Bench {
    /// Switched on, the welcome read.
    pub(crate) fn new() -> Self {
        Self::set(&[])
    }

    /// Switched on with settings, and unlocked.
    pub(crate) fn set(assignments: &[&str]) -> Self {
        let mut bench = Self::booting(assigned(assignments));
        assert_eq!(bench.serve()[..2], WELCOME);
        bench.machine.state = State::Idle;
        bench
    }

    pub(crate) fn booting(settings: Settings) -> Self {
        let stored = Stored {
            settings,
            ..Stored::default()
        };
        Self::booting_with(&stored, false)
    }

    pub(crate) fn booting_with(stored: &Stored, is_first_boot: bool) -> Self {
        let state = if stored.settings.is_homing_on() {
            State::Alarm
        } else {
            State::Idle
        };
        Self {
            session: Session::new(stored, is_first_boot),
            requests: Requests::new(),
            received: Bytes::new(),
            sent: Bytes::new(),
            entries: Queue::new(),
            machine: Snapshot {
                state,
                blocks_free: 100,
                is_at_rest: true,
                ..Snapshot::default()
            },
            is_paused: false,
            waits_for_tool: false,
            withholds: false,
            is_unread: false,
            flash_fails: false,
            resets_in_store: false,
            homing_fails: None,
            probe_ends: Err(None),
            output: Vec::new(),
            done: Vec::new(),
            changes: Vec::new(),
        }
    }

    /// What `prepare` does.
    fn prepare(&mut self) {
        if self.machine.reset_count != self.requests.reset_count() {
            self.reset();
        }
        for byte in self.requests.take_overrides().into_iter().flatten() {
            if byte == TOOL_CHANGE && std::mem::take(&mut self.waits_for_tool) {
                self.is_paused = false;
                self.machine.finished = self.machine.finished.wrapping_add(1);
                self.machine.state = State::Tool;
                self.machine.tool_marks.begin = self.requests.tool_mark();
                self.machine.tool_marks.changes += 1;
            }
            let Some(command) = Override::from_byte(byte) else {
                continue;
            };
            self.machine.overrides = self.machine.overrides.after(command);
            self.machine.accessory_changes = self.machine.accessory_changes.wrapping_add(1);
        }
        let machine = &mut self.machine;
        if self.requests.take_hold() && matches!(machine.state, State::Idle | State::Run) {
            machine.state = State::HoldComplete;
        }
        let starts = self.requests.take_start();
        if starts && machine.state == State::Tool {
            machine.state = State::Idle;
            machine.tool_marks.end = self.requests.start_mark();
        } else if starts && machine.state == State::HoldComplete {
            machine.state = State::Idle;
            self.waits_for_tool = false;
            let paused = u32::from(std::mem::take(&mut self.is_paused));
            machine.finished = machine.finished.wrapping_add(paused);
        }
        while self.machine.state != State::HoldComplete && !self.withholds {
            let Some(entry) = self.entries.dequeue() else {
                break;
            };
            self.machine.finished = self.machine.finished.wrapping_add(1);
            if entry.cancellation_count
                == self
                    .machine
                    .reset_count
                    .wrapping_add(self.machine.cancelled_motions)
            {
                self.execute(&entry.work);
                self.done.push(entry.work);
            }
        }
    }

    fn reset(&mut self) {
        let machine = &mut self.machine;
        machine.reset_count = self.requests.reset_count();
        machine.reset_in_motion =
            matches!(machine.state, State::Run | State::Jog | State::HoldSlowing);
        machine.state = match machine.state {
            State::Run | State::Jog | State::HoldSlowing | State::Alarm | State::Sleep => {
                State::Alarm
            }
            _ => State::Idle,
        };
        machine.is_at_rest = true;
        machine.is_critical = false;
        machine.overrides = Overrides::NONE;
        let paused = u32::from(std::mem::take(&mut self.is_paused));
        machine.finished = machine.finished.wrapping_add(paused);
        self.waits_for_tool = false;
    }

    fn execute(&mut self, work: &Work) {
        let machine = &mut self.machine;
        match work {
            Work::Unlock => machine.state = State::Idle,
            Work::Pause | Work::ToolPause => {
                self.waits_for_tool = matches!(work, Work::ToolPause);
                machine.state = State::HoldComplete;
                machine.finished = machine.finished.wrapping_sub(1);
                self.is_paused = true;
            }
            Work::Check => machine.state = State::Check,
            Work::Sleep => {
                machine.state = State::Sleep;
                machine.notices.push(Notice::Sleeping);
            }
            Work::Fault(alarm) => {
                machine.state = State::Alarm;
                machine.is_critical = *alarm == Alarm::SoftLimit;
                machine.notices.push(Notice::Alarm(*alarm));
            }
            Work::EndOverrides => {
                machine.overrides = Overrides::NONE;
                machine.accessory_changes = machine.accessory_changes.wrapping_add(1);
            }
            Work::Home(_) => {
                if let Some(alarm) = self.homing_fails {
                    machine.state = State::Alarm;
                    machine.notices.push(Notice::Alarm(alarm));
                } else {
                    machine.state = State::Idle;
                    machine.steps.0[..3].copy_from_slice(&[-250, -250, -250]);
                }
            }
            Work::Probe(block, probing) => self.probe(block, *probing),
            Work::Move(block) => self.travel(block),
            Work::Spindle(spindle, rpm) | Work::ReverseTap(spindle, rpm) => {
                machine.spindle = *spindle;
                machine.spindle_rpm = *rpm;
                machine.accessory_changes = machine.accessory_changes.wrapping_add(1);
            }
            Work::Speed(rpm) => machine.spindle_rpm = *rpm,
            Work::Coolant(coolant) => {
                machine.coolant = *coolant;
                machine.accessory_changes = machine.accessory_changes.wrapping_add(1);
            }
            Work::Dwell(_)
            | Work::TakeUp(_)
            | Work::Drivers(_)
            | Work::Overrides(_)
            | Work::Configure(_) => {}
        }
    }

    fn travel(&mut self, block: &Block) {
        let steps = self.machine.steps.zip(block.delta, |at, delta| {
            at + ((delta + (1 << 31)) >> 32) as i32
        });
        self.machine.steps = steps;
    }

    fn probe(&mut self, block: &Block, probing: Probing) {
        assert_eq!(block.kind, MoveKind::Fixed);
        if self.probe_ends == Err(Some(Alarm::ProbeState)) {
            self.machine.state = State::Alarm;
            self.machine.notices.push(Notice::Alarm(Alarm::ProbeState));
            return;
        }
        if let Ok(steps) = self.probe_ends {
            self.machine.steps.0[..3].copy_from_slice(&steps);
        } else {
            self.travel(block);
        }
        let machine = &mut self.machine;
        machine.probed.success = self.probe_ends.is_ok();
        machine.probed.steps = machine.steps;
        let is_error = matches!(
            probing,
            Probing::Probe {
                may_miss: false,
                ..
            }
        );
        if self.probe_ends.is_err() && is_error {
            machine.state = State::Alarm;
            machine.notices.push(Notice::Alarm(Alarm::ProbeContact));
        }
        machine.notices.push(Notice::Probed);
    }

    /// Runs every task until all wait.
    pub(crate) fn settle(&mut self) {
        for _ in 0..100_000 {
            self.prepare();
            let (mut sent, mut read) = self.sent.split();
            let (_, mut received) = self.received.split();
            let (mut entries, _) = self.entries.split();
            let progress = self.session.run(
                &self.machine,
                &self.requests,
                &mut received,
                &mut sent,
                &mut entries,
            );
            let change = self.session.wants_store();
            if let Some(change) = change {
                assert!(self.machine.is_at_rest, "{change:?}");
                self.changes.push(change);
                if std::mem::take(&mut self.resets_in_store) {
                    self.requests.press(Levels::RESET);
                }
                self.session.has_stored(if self.flash_fails {
                    Err(StoreError::Flash)
                } else {
                    Ok(())
                });
            }
            let has_request = self.session.takes_release();
            let mut has_read = false;
            while !self.is_unread {
                let Some(byte) = read.dequeue() else { break };
                self.output.push(byte);
                has_read = true;
            }
            let is_held = self.withholds || self.machine.state == State::HoldComplete;
            let has_entries = !self.entries.is_empty() && !is_held;
            let has_news = has_read || has_entries || has_request || change.is_some();
            if progress == Progress::Waiting && !has_news {
                return;
            }
        }
        panic!("the session never waits");
    }

    /// Hands over bytes, each as the receive interrupt would; false when one found no room.
    pub(crate) fn receive(&mut self, bytes: &[u8]) {
        for &byte in bytes {
            if self.received.free() == 0 {
                self.settle();
            }
            let (mut line, _) = self.received.split();
            if realtime::receive(Ok(byte), line.enqueued(), &self.requests, &mut line)
                == Release::Report
            {
                let free = self.received.free();
                let (mut sent, _) = self.sent.split();
                self.session
                    .report(&self.machine, &self.requests, free, &mut sent);
            }
        }
    }

    /// The lines that have been sent since the last call.
    pub(crate) fn serve(&mut self) -> Vec<String> {
        self.settle();
        let text = String::from_utf8(std::mem::take(&mut self.output)).expect("ASCII");
        assert!(text.is_empty() || text.ends_with("\r\n"), "{text:?}");
        let lines = text.strip_suffix("\r\n").unwrap_or(&text);
        if text.is_empty() {
            Vec::new()
        } else {
            lines.split("\r\n").map(of_three_axes).collect()
        }
    }

    /// The answer to bytes.
    pub(crate) fn answer(&mut self, text: &str) -> Vec<String> {
        self.receive(text.as_bytes());
        self.serve()
    }

    /// The answer to one line.
    pub(crate) fn ask(&mut self, line: &str) -> Vec<String> {
        self.answer(&format!("{line}\n"))
    }

    /// A status report.
    pub(crate) fn report(&mut self) -> Report {
        Report::read(&self.answer("?")[0]).expect("a report")
    }

    /// Closes contacts, and opens all others.
    pub(crate) fn close(&mut self, closed: Levels) {
        self.machine.inputs = closed;
    }

    /// What the machine has done, without settings.
    pub(crate) fn works(&mut self) -> Vec<Work> {
        let done = std::mem::take(&mut self.done);
        let is_work = |work: &Work| !matches!(work, Work::Configure(_));
        done.into_iter().filter(is_work).collect()
    }
}

/// A line without the coordinates of A, B and C, which stay 0 here.
fn of_three_axes(line: &str) -> String {
    let is_number = |c: char| c.is_ascii_digit() || matches!(c, '.' | ',' | '-');
    let fields = line.split_inclusive(|c| !is_number(c)).map(|field| {
        let values: Vec<_> = field.split(',').collect();
        let end = field.trim_start_matches(is_number);
        if values.len() == AXES && values.iter().all(|value| value.contains('.')) {
            let (first, _) = values.split_at(3);
            first.join(",").trim_end_matches(end).to_owned() + end
        } else {
            field.to_owned()
        }
    });
    fields.collect()
}

/// The answers among the lines.
pub(crate) fn answers(lines: &[String]) -> Vec<&str> {
    let lines = lines.iter().map(String::as_str);
    lines.filter(|line| is_answer(line)).collect()
}
