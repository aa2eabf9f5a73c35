//! A machine at the end of a serial line, with a sender, an operator, and rules for what it does.

mod power;

use std::{
    collections::{BTreeSet, VecDeque},
    mem::take,
};

use leadscrew::{
    axis::{Axes, X, Y},
    gcode::CompensationMode,
    model::{
        Levels, Outputs, Spindle, State,
        queues::{RECEIVED_RING, SENT_RING},
    },
    protocol::MESSAGE_BYTES,
    settings::{StepRate, Stored, ToolTable},
    sim::{Edge, Simulator, WINDOW},
    units::{TICKS_PER_MS, TICKS_PER_SECOND},
};

use crate::{
    action::Action,
    answers, outputs,
    reports::ReportRules,
    rules::MotionRules,
    setup::{Kind, Setup, TRAVEL_MM},
};

const SECOND: u64 = TICKS_PER_SECOND as u64;
const MILLISECOND: u64 = TICKS_PER_MS as u64;
/// One byte at 115 200 baud.
const BYTE_TICKS: u64 = SECOND * 10 / 115_200;
/// The byte with which an operator begins lines of his own in a change of the tool.
const OPERATOR_LINES: u8 = 0xa3;
/// The byte that opens the safety door.
const DOOR: u8 = 0x84;
/// Alarms that leave spindle and coolant on, as in Grbl, unless `$777` is set.
const PROBE_ALARMS: [&str; 2] = ["ALARM:4", "ALARM:5"];
/// The alarm of a move out of the travel.
const SOFT_LIMIT: &str = "ALARM:2";
/// From a `?` to the first byte of its report: 5 ms, and what waits to be sent before it, with a message for which the
/// queue has no room yet.
const PROMPT_TICKS: u64 = 5 * MILLISECOND + (SENT_RING + MESSAGE_BYTES) as u64 * BYTE_TICKS;
/// How long something may run on in a break: 40 ms behind the report that waits at its beginning.
const MAX_BREAK_RESPONSE_TICKS: u64 = PROMPT_TICKS + 42 * MILLISECOND;
/// How long something may stay on in a state in which it must be off.
const OFF_TICKS: u64 = 10 * MILLISECOND;
/// What a line may take until the operator helps.
const TIMEOUT_TICKS: u64 = 20 * SECOND;
/// What a program of slow moves and dwells may take.
const LONGEST_PROGRAM_TICKS: u64 = 4 * 3600 * SECOND;
/// Looks in which nothing happens, after which all lines of a host are done, whose answers nobody counts.
const QUIET_POLLS: u32 = 20;
/// What a machine takes to stand and to answer after a reset.
const RESET_TICKS: u64 = 10 * SECOND;

/// A fault of the harness itself: what the rules must notice.
#[derive(Debug, Clone, Copy, PartialEq, Eq)]
#[cfg_attr(not(test), expect(dead_code, reason = "the tests make them"))]
pub(crate) enum Fault {
    /// The motor of Y sees no pulse of a rapid.
    StepLost,
    /// An answer that does not arrive.
    AnswerLost,
    /// A report that comes late.
    ReportLate,
    /// A record that is not in the flash after the power failed.
    RecordLost,
    /// The motors of `CoreXY` are wired to each other's outputs.
    MotorsSwapped,
    /// A byte that does not arrive, and the receiver has seen nothing of it.
    LossUnseen,
    /// A break at which the pin stays high.
    BreakUnseen,
    /// A laser that stays on in a hold.
    BeamInHold,
    /// A laser that is on in rapids.
    BeamInRapid,
    /// A spindle that an open door does not stop.
    SpindleBehindDoor,
    /// A coolant pump that does not start.
    CoolantStays,
    /// Work offsets that are not told.
    OffsetUntold,
    /// A probe that changes a step away from where it is told to.
    ProbeMoved,
    /// An answer that no sender knows.
    AnswerGarbled,
    /// A second motor that loses a step.
    SecondStepLost,
    /// Every line is taken for a jog.
    AllAreJogs,
    /// A hold that does not arrive where the spindle starts again behind the door.
    HoldBehindDoorLost,
    /// Motion that ends a little beside the path.
    PathLeft,
}

/// What is on its way to the machine.
#[derive(Debug, Clone, Copy)]
enum WireByte {
    Byte(u8),
    /// What is left of a byte.
    Damaged,
}

/// The machine and what is known of it.
pub(crate) struct Bench {
    setup: Setup,
    step_rate: StepRate,
    simulator: Box<Simulator>,
    motion: MotionRules,
    reports: ReportRules,
    /// Bytes on their way to the machine; realtime bytes overtake.
    line: VecDeque<WireByte>,
    urgent: VecDeque<u8>,
    next_in: u64,
    next_out: u64,
    received: Vec<u8>,
    /// What the machine has received that a comment may keep.
    sent_text: Vec<u8>,
    /// Lines that the machine has received since its last reset, and the answers since its last welcome.
    received_lines: u64,
    answers: u64,
    /// Errors and alarms since power-up.
    refusals: u32,
    /// The received lines that have lost bytes, whether the incoming line has lost bytes, and the number of lost bytes.
    lossy_lines: BTreeSet<u64>,
    has_lost: bool,
    lost: u32,
    /// The received lines that are jogs, and whether the incoming line is a jog.
    jogs: BTreeSet<u64>,
    is_jog: bool,
    resets: u32,
    /// Welcomes that may still be on their way, and answers from before each. Two resets may have one.
    welcomes: u32,
    /// When no welcome is on its way any more.
    silent_at: u64,
    /// When the oldest `?` without a report was received.
    asked: Option<u64>,
    /// The contacts that are closed.
    closed: Levels,
    /// Physical steps before the last loss of power, and the difference to the machine's own count.
    moved: Axes<i32>,
    offset: Axes<i32>,
    /// How far second motors are ahead of the first.
    second_offset: Axes<i32>,
    /// The machine may have homed since the offset was taken.
    may_have_homed: bool,
    /// The last byte that has come was the end of a line.
    is_line_ended: bool,
    /// The line that is coming has a `$`.
    is_statement: bool,
    /// Since when something is on that must be off.
    on_since: Option<u64>,
    /// The operator has begun lines of his own in a change of the tool, which come before those that wait.
    has_operator_lines: bool,
    /// The contact of the probe is closed.
    is_probe_closed: bool,
    /// The last alarm since the welcome is that of a probing move, and whether such an alarm leaves on what is on.
    is_alarm_of_probe: bool,
    leaves_on: bool,
    /// Since when a hold keeps spindle and coolant off behind the door.
    held_behind_door_since: Option<u64>,
    /// What may be stored, from the last instant at which all was, to now.
    may_be_stored: Vec<(Stored, ToolTable)>,
    /// Changes have waited since that instant: they may have been stored in another order.
    has_postponed: bool,
    /// The line in whose write the power fails.
    writing: Option<String>,
    fault: Option<Fault>,
    /// Time that has passed before the last loss of power, ticks.
    before: u64,
}

impl Bench {
    pub(crate) fn new(setup: Setup, step_rate: StepRate, fault: Option<Fault>) -> Self {
        let simulator = setup.build(step_rate);
        let mut bench = Self {
            setup,
            step_rate,
            motion: MotionRules::new(&simulator, setup),
            reports: ReportRules::default(),
            simulator,
            line: VecDeque::new(),
            urgent: VecDeque::new(),
            next_in: 0,
            next_out: 0,
            received: Vec::new(),
            sent_text: Vec::new(),
            received_lines: 0,
            answers: 0,
            refusals: 0,
            lossy_lines: BTreeSet::new(),
            has_lost: false,
            lost: 0,
            jogs: BTreeSet::new(),
            is_jog: false,
            resets: 0,
            welcomes: 1,
            silent_at: SECOND,
            asked: None,
            closed: Levels::NONE,
            moved: Axes::all(0),
            offset: Axes::all(0),
            second_offset: Axes::all(0),
            may_have_homed: false,
            is_line_ended: true,
            is_statement: false,
            on_since: None,
            has_operator_lines: false,
            is_probe_closed: false,
            is_alarm_of_probe: false,
            leaves_on: true,
            held_behind_door_since: None,
            may_be_stored: Vec::new(),
            has_postponed: false,
            writing: None,
            fault,
            before: 0,
        };
        bench.simulator.settle();
        bench.note_stored();
        bench.run(SECOND / 10);
        if setup.kind != Kind::Laser {
            bench.send("$H");
            assert!(bench.reaches_standstill(60 * SECOND), "homing has no end");
            bench.take_offset();
        }
        bench
    }

    /// Time of the machine, s.
    pub(crate) fn seconds(&self) -> f64 {
        (self.before + self.simulator.now()) as f64 / SECOND as f64
    }

    /// Lets something happen.
    pub(crate) fn act(&mut self, action: &Action) {
        match action {
            Action::Line(text) => self.send(text),
            Action::Lines(text, times) => (0..*times).for_each(|_| self.send(text)),
            Action::Reports(times, ms) => {
                for _ in 0..*times {
                    self.urgent.push_back(b'?');
                    self.run(u64::from(*ms) * MILLISECOND);
                }
            }
            Action::DamagedLine { text, byte, bit } => {
                self.send_damaged(text, *byte, |byte| WireByte::Byte(byte ^ 1 << bit));
            }
            Action::LossyLine { text, byte } => {
                self.send_damaged(text, *byte, |_| WireByte::Damaged);
            }
            Action::Break(ms) => self.make_break(u64::from(*ms) * MILLISECOND),
            // Text in a full queue would be lost.
            Action::Byte(byte)
                if self.setup.fills_queue
                    && !matches!(byte, 0x18 | b'?' | b'!' | b'~' | 0x80..=0xa3) =>
            {
                self.line.push_back(WireByte::Byte(*byte));
            }
            Action::Byte(byte) => self.urgent.push_back(*byte),
            Action::Close(contact) => self.hold(self.closed | contact.input()),
            Action::Open(contact) => self.hold(self.closed & !contact.input()),
            Action::Pass(ms) => {
                self.run(u64::from(*ms) * MILLISECOND);
                let is_answered = self.welcomes == 0 && self.answers == self.received_lines;
                if is_answered && self.stands_in_silence() {
                    self.check_outputs_at_rest();
                }
            }
            Action::HoldBehindDoor(ms) => {
                for byte in [DOOR, b'~', b'!'] {
                    self.urgent.push_back(byte);
                    self.run(u64::from(*ms) * MILLISECOND);
                }
            }
            Action::PowerFails => self.fail_power(),
            Action::PowerFailsInWrite { text, words, seed } => {
                let is_at_rest = self.reaches_standstill(TIMEOUT_TICKS);
                if is_at_rest {
                    self.simulator.flash().cut_after(*words, *seed);
                    self.writing = Some(text.clone());
                    self.send(text);
                    self.run(SECOND / 2);
                }
                // Otherwise it has failed in the write.
                if !is_at_rest || self.writing.take().is_some() {
                    self.fail_power();
                }
            }
        }
    }

    /// The operator brings the machine to rest, whatever it does, and looks whether all is right.
    pub(crate) fn finish(&mut self) {
        self.hold(Levels::NONE);
        self.recover();
        self.check_position();
        self.check_answers();
        self.reset();
        if self.state() == State::Alarm {
            self.send(if self.setup.is_reprap { "M999" } else { "$X" });
            assert!(
                self.reaches_standstill(RESET_TICKS),
                "the machine stays locked"
            );
        }
        self.send("G90 G94 G21 G53 G1 X-3 Y-2 Z-4 F3000");
        assert!(
            self.reaches_standstill(3600 * SECOND),
            "a move has no end in {:?}",
            self.state()
        );
        self.check_position();
        self.urgent.push_back(b'?');
        self.run(SECOND / 2);
        self.check_answers();
        self.motion.check_end();
        assert_eq!(
            (self.simulator.late(), self.simulator.lost()),
            (0, self.lost),
            "late events, lost bytes"
        );
    }

    /// Lets the machine work until it has room for a line, and presses cycle start where it is held.
    pub(crate) fn await_room(&mut self, line: &str) {
        self.work_until(|bench| bench.line.len() + bench.counted_waiting() + line.len() < WINDOW);
    }

    /// The same until it has come to the end of what was sent. Nothing has been refused, and all is right.
    pub(crate) fn end_program(&mut self) {
        self.work_until(|bench| bench.reaches_standstill(SECOND / 10));
        assert_eq!((self.state(), self.refusals), (State::Idle, 0), "refusals");
        self.check_position();
        self.check_answers();
    }

    fn work_until(&mut self, mut is_done: impl FnMut(&mut Self) -> bool) {
        let limit = self.simulator.now() + LONGEST_PROGRAM_TICKS;
        while !is_done(self) {
            if self.state().is_suspended() {
                self.urgent.push_back(b'~');
            }
            self.run(SECOND / 10);
            assert!(self.simulator.now() < limit, "a program has no end");
        }
    }

    /// Presses cycle start as often as it helps, and at last resets.
    fn recover(&mut self) {
        for _ in 0..8 {
            if self.reaches_standstill(TIMEOUT_TICKS) {
                return;
            }
            self.urgent.push_back(b'~');
        }
        self.reset();
        assert!(
            self.reaches_standstill(RESET_TICKS),
            "a reset leads to no rest, but to {:?}",
            self.state()
        );
    }

    fn reset(&mut self) {
        // A sender forgets what it has not sent.
        self.line.clear();
        self.urgent.push_back(0x18);
        self.run(SECOND);
    }

    fn state(&self) -> State {
        self.simulator.snapshot().state
    }

    fn send(&mut self, text: &str) {
        self.wait_for_room(text.len() + 1);
        let bytes = text.bytes().chain([b'\n']);
        self.line.extend(bytes.map(WireByte::Byte));
    }

    /// Sends a line of which one byte becomes something else on its way.
    fn send_damaged(&mut self, text: &str, byte: usize, damage: impl Fn(u8) -> WireByte) {
        self.send(text);
        let length = text.len() + 1;
        let place = self.line.len() - length + byte % length;
        if let Some(WireByte::Byte(byte)) = self.line.get(place).copied() {
            self.line[place] = damage(byte);
        }
    }

    /// The line is low: the receiver sees a byte without a stop bit, and then nothing. What runs is held.
    fn make_break(&mut self, ticks: u64) {
        let end = self.simulator.now() + ticks;
        self.simulator
            .pull_line(self.fault != Some(Fault::BreakUnseen));
        self.receive(WireByte::Damaged, self.simulator.now());
        let mut runs_since = None;
        while self.simulator.now() < end {
            self.next_in = end;
            self.run(MILLISECOND);
            let now = self.simulator.now();
            if self.state() != State::Run {
                runs_since = None;
                continue;
            }
            let ticks = now - *runs_since.get_or_insert(now);
            assert!(ticks <= MAX_BREAK_RESPONSE_TICKS, "a break holds nothing");
        }
        self.simulator.pull_line(false);
    }

    /// Waits until the machine has room for a line. Where it takes none, the operator helps.
    fn wait_for_room(&mut self, length: usize) {
        let limit = self.simulator.now() + TIMEOUT_TICKS;
        while self.line.len() + self.counted_waiting() + length > WINDOW {
            self.run(SECOND / 100);
            if self.simulator.now() > limit {
                self.recover_for_line();
                return;
            }
        }
    }

    fn recover_for_line(&mut self) {
        self.hold(Levels::NONE);
        self.recover();
    }

    /// Bytes that wait in the machine.
    fn waiting(&self) -> usize {
        RECEIVED_RING - 1 - self.simulator.received_free()
    }

    /// Those that the sender counts. One that fills the queue sends each byte for which there is room.
    fn counted_waiting(&self) -> usize {
        if self.setup.fills_queue {
            0
        } else {
            self.waiting()
        }
    }

    /// Whether the sender sends the next byte of its lines.
    fn can_send(&self) -> bool {
        let is_full = self.setup.fills_queue && self.simulator.received_free() == 0;
        self.welcomes == 0 && !self.line.is_empty() && !is_full
    }

    /// Runs until nothing happens any more, every line is answered and nothing moves. Returns false when that takes
    /// longer.
    fn reaches_standstill(&mut self, limit: u64) -> bool {
        let end = self.simulator.now() + limit;
        let (mut unanswered, mut quiet) = (0, 0);
        while self.simulator.now() < end {
            self.run(SECOND / 100);
            if !self.stands_in_silence() {
                quiet = 0;
                continue;
            }
            quiet += 1;
            let is_answered = if self.setup.is_reprap {
                quiet == QUIET_POLLS
            } else {
                self.answers == self.received_lines
            };
            if is_answered {
                self.welcomes = 0;
                self.check_outputs_at_rest();
                return true;
            }
            if self.setup.is_reprap {
                continue;
            }
            let state = self.state();
            let can_answer = state != State::Alarm && self.simulator.due().is_none();
            unanswered += u32::from(can_answer);
            assert!(unanswered < 100, "a line has no answer in {state:?}");
        }
        false
    }

    /// Whether the machine stands, and nothing is on its way to it or from it.
    fn stands_in_silence(&self) -> bool {
        let snapshot = self.simulator.snapshot();
        let is_silent =
            self.line.is_empty() && self.urgent.is_empty() && !self.simulator.has_to_send();
        let stands = snapshot.is_at_rest
            && matches!(snapshot.state, State::Idle | State::Alarm | State::Check);
        is_silent && stands && self.waiting() == 0
    }

    /// At rest, with all lines answered, what is on is what is programmed, or nothing.
    fn check_outputs_at_rest(&self) {
        // A `G28` of a host homes after ALARM:2, and leaves programmed what the alarm has switched off.
        if !self.setup.is_reprap {
            let stays_on = self.is_alarm_of_probe && self.leaves_on;
            outputs::check_at_rest(&self.simulator, self.outputs(), stays_on);
        }
    }

    fn hold(&mut self, contacts: Levels) {
        self.simulator.set_pin(self.closed & !contacts, false);
        self.simulator.set_pin(contacts & !self.closed, true);
        self.closed = contacts;
        if contacts.has(Levels::START) {
            self.held_behind_door_since = None;
        }
        self.simulator.settle();
        self.note_reset();
        self.note_probe();
    }

    /// Notes where the machine is if the contact of the probe has changed.
    fn note_probe(&mut self) {
        let half_steps = self.setup.half_steps_of(self.motion.steps());
        let mut plates = self.setup.plates(&self.moved);
        let is_closed = self.closed.has(Levels::PROBE)
            || plates.any(|plate| plate.is_closed_at(half_steps[plate.axis].div_euclid(2)));
        if std::mem::replace(&mut self.is_probe_closed, is_closed) == is_closed {
            return;
        }
        let mut place = self.setup.mm_of(&self.counted());
        if self.fault == Some(Fault::ProbeMoved) {
            place[X] += 1.0 / f64::from(self.setup.resolution(X));
        }
        self.reports.note_probe_change(place);
    }

    /// What must be off in a state is off, at the end of the segment being played at the latest.
    fn check_state(&mut self) {
        let now = self.simulator.now();
        let state = self.state();
        if state != State::Alarm {
            self.leaves_on = !self
                .simulator
                .session()
                .settings()
                .probing_alarm_switches_off;
        }
        if let Some(since) = self.held_behind_door_since {
            let is_held = matches!(
                state,
                State::DoorAjar | State::DoorClosed | State::DoorRetracting | State::Alarm
            );
            assert!(
                is_held || now - since <= OFF_TICKS,
                "a hold behind the door holds nothing: {state:?}"
            );
        }
        match outputs::on_in_state(&self.simulator, self.outputs()) {
            Some(rule) => {
                let since = *self.on_since.get_or_insert(now);
                assert!(now - since <= OFF_TICKS, "{rule}: {:?}", self.outputs());
            }
            None => self.on_since = None,
        }
    }

    /// The outputs of the machine.
    fn outputs(&self) -> Outputs {
        let mut outputs = *self.simulator.outputs();
        match (self.fault, self.state()) {
            (Some(Fault::BeamInHold), State::HoldComplete) => outputs.duty = Outputs::FULL,
            (Some(Fault::SpindleBehindDoor), State::DoorAjar) => {
                outputs.spindle = Spindle::Clockwise;
            }
            (Some(Fault::CoolantStays), _) => outputs.coolant.flood = false,
            _ => {}
        }
        outputs
    }

    /// Runs for a time.
    fn run(&mut self, ticks: u64) {
        let end = self.simulator.now() + ticks;
        while self.simulator.now() < end {
            let now = self.simulator.now();
            if now >= self.next_out
                && let Some(byte) = self.simulator.send()
            {
                self.next_out = now + BYTE_TICKS;
                self.receive_byte(byte, now);
                self.simulator.settle();
            }
            if now >= self.silent_at {
                self.welcomes = 0;
            }
            if now >= self.next_in
                && let Some(byte) = self.next_byte()
            {
                self.next_in = now + BYTE_TICKS;
                self.receive(byte, now);
            }
            if self.simulator.flash().is_off() {
                self.fail_power();
                return;
            }
            let sends = !self.urgent.is_empty() || self.can_send();
            let events = [
                self.simulator.due(),
                self.simulator.has_to_send().then_some(self.next_out),
                sends.then_some(self.next_in),
                (self.welcomes > 0).then_some(self.silent_at),
            ];
            let next = events.into_iter().flatten().fold(end, u64::min);
            let edge = self.simulator.advance(next.max(now));
            self.note_reset();
            if let Some(edge) = edge {
                self.check_edge(&edge);
                continue;
            }
            // Nothing is stored in motion.
            if self.answers != self.received_lines {
                self.note_stored();
            }
            self.check_state();
            let since = self.simulator.now().saturating_sub(PROMPT_TICKS);
            self.reports.note_offset(&self.simulator, since);
        }
    }

    /// The next byte on its way. What a machine receives between a reset and its welcome is lost, as in Grbl:
    /// senders wait.
    fn next_byte(&mut self) -> Option<WireByte> {
        // To a host's machine they are text in a line.
        let is_text = self.setup.is_reprap && !self.is_line_ended && self.can_send();
        let urgent = (!is_text).then(|| self.urgent.pop_front()).flatten();
        urgent
            .map(WireByte::Byte)
            .or_else(|| self.can_send().then(|| self.line.pop_front()).flatten())
    }

    fn check_edge(&mut self, edge: &Edge) {
        let counted = match self.fault {
            Some(Fault::StepLost) if edge.is_rapid => edge.raise & !0b10,
            _ => edge.raise,
        };
        self.motion.check(edge, counted);
        self.note_probe();
        let duty = match self.fault {
            Some(Fault::BeamInRapid) => Outputs::FULL,
            _ => edge.duty,
        };
        outputs::check_edge(&Edge { duty, ..*edge }, &self.simulator);
        if self.setup.has_travel() && !self.may_have_homed {
            let counted = self.counted();
            // Two motors that are half a step off at most put an axis half a step off; others make whole ones.
            for (axis, place) in self.setup.half_steps_of(&counted).into_iter().enumerate() {
                let travel = -2 * TRAVEL_MM * self.setup.resolution(axis) - 1..=1;
                assert!(
                    travel.contains(&place),
                    "axis {axis} leaves its travel: half step {place}"
                );
            }
        }
    }

    /// The machine receives a byte, or what is left of one.
    fn receive(&mut self, sent: WireByte, now: u64) {
        let WireByte::Byte(byte) = sent else {
            self.has_lost = true;
            if self.fault != Some(Fault::LossUnseen) {
                self.lost += 1;
                self.simulator.receive_damaged();
                self.simulator.settle();
            }
            return;
        };
        self.is_line_ended = matches!(byte, b'\n' | b'\r');
        if matches!(byte, b' '..=b'}') && !matches!(byte, b'?' | b'!') {
            self.sent_text.push(byte);
        } else if byte >= 0xc0 {
            // The first byte of a character of UTF-8, which is shown so.
            self.sent_text.push(b'?');
        }
        match byte {
            b'?' if !self.setup.is_reprap => {
                let late = if self.fault == Some(Fault::ReportLate) {
                    SECOND
                } else {
                    0
                };
                self.asked.get_or_insert(now.saturating_sub(late));
            }
            b'\n' | b'\r' => {
                self.is_statement = false;
                self.received_lines += 1;
                if take(&mut self.has_lost) {
                    self.lossy_lines.insert(self.received_lines);
                }
                if take(&mut self.is_jog) || self.fault == Some(Fault::AllAreJogs) {
                    self.jogs.insert(self.received_lines);
                }
            }
            b'$' => self.is_statement = true,
            b'!' if !self.setup.is_reprap && self.state() == State::DoorRestoring => {
                self.held_behind_door_since = Some(now);
                if self.fault == Some(Fault::HoldBehindDoorLost) {
                    return;
                }
            }
            b'~' => self.held_behind_door_since = None,
            // `G28`, which homes for a host.
            b'8' => self.may_have_homed |= self.setup.is_reprap,
            OPERATOR_LINES => self.has_operator_lines = true,
            b'h' | b'H' => self.may_have_homed |= self.is_statement,
            b'j' | b'J' => self.is_jog |= self.is_statement,
            _ => {}
        }
        self.simulator.receive(byte);
        self.simulator.settle();
        self.note_reset();
        if matches!(byte, b'\n' | b'\r') {
            self.note_stored();
        }
    }

    /// A reset drops the lines that are not answered.
    fn note_reset(&mut self) {
        let resets = self.simulator.requested_resets();
        if resets != self.resets {
            self.welcomes += resets - self.resets;
            self.resets = resets;
            self.silent_at = self.simulator.now() + SECOND;
            self.received_lines = 0;
            self.forget_lines();
            self.asked = None;
            self.held_behind_door_since = None;
        }
    }

    /// The lines that wait are dropped.
    fn forget_lines(&mut self) {
        self.lossy_lines.clear();
        self.has_operator_lines = false;
        self.has_lost = false;
        self.jogs.clear();
        self.is_jog = false;
    }

    /// Something may have been stored.
    fn note_stored(&mut self) {
        let session = self.simulator.session();
        self.has_postponed |= !session.waiting_changes().is_empty();
        let now = (session.stored(), session.tools());
        if self
            .may_be_stored
            .last()
            .map(|(stored, tools)| (stored, tools))
            != Some(now)
        {
            self.may_be_stored.push((now.0.clone(), now.1.clone()));
        }
    }

    fn receive_byte(&mut self, byte: u8, now: u64) {
        self.silent_at = now + SECOND;
        match byte {
            b'\r' => {}
            b'\n' => {
                let text = take(&mut self.received);
                self.receive_line(&String::from_utf8_lossy(&text));
            }
            byte => {
                if byte == b'<'
                    && self.received.is_empty()
                    && let Some(asked) = self.asked.take()
                {
                    let waited = now - asked;
                    assert!(waited <= PROMPT_TICKS, "a `?` waits {waited} ticks");
                }
                self.received.push(byte);
            }
        }
    }

    fn receive_line(&mut self, line: &str) {
        let is_garbled = self.fault == Some(Fault::AnswerGarbled) && line == "error:20";
        let is_known = if self.setup.is_reprap {
            answers::is_known_to_hosts(line)
        } else {
            answers::is_known(line) || answers::is_of_program(line, &self.sent_text)
        };
        assert!(is_known && !is_garbled, "an unknown line: {line}");
        self.learn(line);
        if self.setup.is_reprap {
            self.note_stored();
            self.welcomes = self.welcomes.saturating_sub(u32::from(line == "start"));
            return;
        }
        self.refusals += u32::from(line.starts_with("error:") || line.starts_with("ALARM:"));
        if line.starts_with("Grbl ") {
            self.answers = 0;
            self.welcomes = self.welcomes.saturating_sub(1);
        } else if line == "ok" || line.starts_with("error:") {
            if self.fault == Some(Fault::AnswerLost) && line == "error:20" {
                return;
            }
            self.answers += 1;
            self.note_stored();
            assert!(
                self.welcomes > 0 || self.answers <= self.received_lines,
                "more answers than lines: {line}"
            );
            if self.welcomes == 0
                && !self.has_operator_lines
                && self.lossy_lines.remove(&self.answers)
            {
                // A line with a checksum is asked for again.
                let is_asked_for =
                    self.setup.options.checked_lines && matches!(line, "error:200" | "error:201");
                assert!(
                    line == "error:210" || is_asked_for,
                    "a line that has lost a byte is answered by {line}"
                );
            }
        }
    }

    /// What a line tells of the machine is true.
    fn learn(&mut self, line: &str) {
        if line.starts_with("Grbl ") || line == "start" {
            self.reports.restart();
            self.is_alarm_of_probe = false;
        } else if line.contains("ALARM:") {
            self.check_alarm(line);
            self.is_alarm_of_probe = PROBE_ALARMS.iter().any(|alarm| line.contains(alarm));
        } else if line.starts_with('<') {
            let is_unreported =
                self.fault == Some(Fault::OffsetUntold) && self.reports.knows_offset();
            let line = if is_unreported {
                line.replace("WCO", "WC0")
            } else {
                line.into()
            };
            let is_rotated = self.simulator.session().interpreter().is_rotated();
            self.reports.check_report(&line, is_rotated);
        } else if line.starts_with("[PRB:") {
            self.reports.check_probe(line, !self.may_have_homed);
        }
    }

    /// A jog out of the travel is refused: no jog is an alarm of soft limits.
    fn check_alarm(&self, line: &str) {
        let is_known = self.welcomes == 0 && !self.has_operator_lines && !self.setup.is_reprap;
        let number = self.answers + 1;
        assert!(
            line != SOFT_LIMIT || !is_known || !self.jogs.contains(&number),
            "a jog is an alarm: {line}"
        );
    }

    fn check_answers(&self) {
        if self.setup.is_reprap {
            return;
        }
        assert_eq!(
            self.answers, self.received_lines,
            "answers, and lines since the last reset"
        );
        assert!(self.asked.is_none(), "a `?` has no report");
    }

    /// The difference between the steps of the motors and the machine's own count.
    fn difference(&self) -> Axes<i32> {
        let counted = self.simulator.snapshot().steps;
        Axes::from_fn(|axis| self.motion.steps()[axis] - counted[axis])
    }

    /// The steps of the motors by the machine's own count.
    fn counted(&self) -> Axes<i32> {
        let steps = self.motion.steps();
        Axes::from_fn(|motor| steps[motor] - self.offset[motor])
    }

    /// How far second motors are ahead of the first.
    fn second_difference(&self) -> Axes<i32> {
        let (first, second) = (
            self.simulator.physical_steps(),
            self.simulator.second_steps(),
        );
        Axes::from_fn(|axis| {
            let is_lost = axis == Y && self.fault == Some(Fault::SecondStepLost) && first[Y] < -20;
            let is_ganged = self.setup.ganged >> axis & 1 != 0;
            i32::from(is_ganged) * (second[axis] - first[axis] - i32::from(is_lost))
        })
    }

    fn take_offset(&mut self) {
        self.offset = self.difference();
        self.second_offset = self.second_difference();
        self.may_have_homed = false;
    }

    /// The machine is where it believes to be.
    fn check_position(&mut self) {
        assert_eq!(
            *self.motion.steps(),
            self.simulator.physical_steps(),
            "steps of the motors"
        );
        if self.may_have_homed {
            self.take_offset();
        }
        assert_eq!(
            self.difference(),
            self.offset,
            "the machine has lost its position"
        );
        assert_eq!(
            self.second_difference(),
            self.second_offset,
            "second motors, ahead of the first"
        );
        let session = self.simulator.session();
        let mut end = *self.simulator.exact_position();
        end[X].0 += i64::from(self.fault == Some(Fault::PathLeft));
        assert_eq!(
            *session.path_end(),
            end,
            "the path begins elsewhere than the last motion has ended"
        );
        let interpreter = session.interpreter();
        let is_compensated = interpreter.modal().compensation != CompensationMode::Off;
        // After G40 the tool stays beside the programmed position up to the next move.
        if self.state() != State::Idle || is_compensated || interpreter.is_off_path() {
            return;
        }
        let programmed = interpreter.position();
        let axes = Axes::from_fn(|axis| {
            programmed[axis].0 as f64 * 1.0e-6 * f64::from(self.setup.resolution(axis))
        });
        let mut motors = self.setup.motors_of(axes.0);
        if self.fault == Some(Fault::MotorsSwapped) && self.setup.is_core_xy {
            motors.swap(X, Y);
        }
        let steps = self.simulator.snapshot().steps;
        for (motor, (exact, steps)) in motors.iter().zip(&steps).enumerate() {
            let difference = (exact - f64::from(*steps)).abs();
            assert!(
                difference <= 0.501,
                "motor {motor} is programmed to {exact} steps and stands at {steps}"
            );
        }
    }
}
