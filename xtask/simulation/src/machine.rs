//! The virtual machine behind its serial line, for whoever talks to it byte by byte.

mod pin;
mod signals;

pub use crate::SwitchPositions;
pub use pin::Pin;
pub use signals::Event;

use std::collections::VecDeque;

use common::BAUD;
use leadscrew::{
    machine::Snapshot,
    model::{State, queues::RECEIVED_RING, timing::TICK_MS},
    protocol::Session,
    sim::{Edge, Flash, Simulator, Switch},
    units::{TICKS_PER_MS, TICKS_PER_SECOND},
};

use self::signals::Signals;

/// Time of one byte on it with start and stop bit, ticks.
const BYTE_TICKS: u64 = TICKS_PER_SECOND as u64 * 10 / BAUD as u64;

/// A machine on a virtual clock, and the bytes on their way to it and from it.
pub struct Machine {
    simulator: Box<Simulator>,
    /// `None` is a byte of which the machine sees that it is lost.
    to_machine: VecDeque<Option<u8>>,
    /// The sender has begun a line, and not ended it.
    is_line_begun: bool,
    from_machine: Vec<(f64, u8)>,
    next_in: u64,
    next_out: u64,
    switches: Vec<Switch>,
    signals: Signals,
}

impl Machine {
    /// A machine that has just been switched on, amid switches.
    pub fn amid(simulator: Simulator, switches: Vec<Switch>) -> Self {
        let mut machine = Self {
            simulator: Box::new(simulator),
            to_machine: VecDeque::new(),
            is_line_begun: false,
            from_machine: Vec::new(),
            next_in: 0,
            next_out: 0,
            switches,
            signals: Signals::default(),
        };
        for switch in &machine.switches {
            // More than fit, and axes that do not exist, close nothing.
            let _ = machine.simulator.mount(*switch);
        }
        machine.simulator.settle();
        machine.note();
        machine
    }

    /// Notes what the outputs and the switches do.
    fn note(&mut self) {
        let position = self.simulator.physical_position();
        let switches = self.switches.iter();
        let closed = switches.map(|switch| switch.is_closed_at(position[switch.axis]));
        let now_s = self.simulator.now() as f64 / f64::from(TICKS_PER_SECOND);
        self.signals.note(now_s, *self.simulator.outputs(), closed);
    }

    /// Opens or closes a contact.
    pub fn press(&mut self, pin: Pin, closed: bool) {
        self.simulator.set_pin(pin.level(), closed);
        self.simulator.settle();
        self.note();
    }

    /// What the outputs and the switches have done, with times from power-up.
    pub fn signals(&self) -> &[Event] {
        self.signals.events()
    }

    /// Returns the machine as a task reads it now.
    pub fn snapshot(&self) -> Snapshot {
        self.simulator.snapshot()
    }

    /// The conversation as the machine has it.
    pub fn session(&self) -> &Session {
        self.simulator.session()
    }

    /// The flash in which it stores.
    pub fn flash(&mut self) -> &mut Flash {
        self.simulator.flash()
    }

    /// When something happens next without a byte from outside, s since power-up.
    pub fn due_s(&self) -> Option<f64> {
        let due = self.due()?.max(self.simulator.now());
        Some(due as f64 / f64::from(TICKS_PER_SECOND))
    }

    /// The virtual machine itself.
    pub fn simulator(&self) -> &Simulator {
        &self.simulator
    }

    /// Time since power-up, s.
    pub fn now_s(&self) -> f64 {
        self.simulator.now() as f64 / f64::from(TICKS_PER_SECOND)
    }

    /// Puts bytes on the line, behind those that are still on it.
    pub fn send(&mut self, bytes: &[u8]) {
        if self.to_machine.is_empty() {
            self.next_in = self.next_in.max(self.simulator.now() + BYTE_TICKS);
        }
        for byte in bytes {
            match byte {
                // A reset drops it.
                b'\n' | b'\r' | 0x18 => self.is_line_begun = false,
                b'?' | b'!' | b'~' | 0x80.. => {}
                _ => self.is_line_begun = true,
            }
        }
        self.to_machine.extend(bytes.iter().copied().map(Some));
    }

    /// The sender is gone: a line that it has begun is not the beginning of the next one's first line. It ends here, and
    /// is refused.
    pub fn end_begun_line(&mut self) {
        if self.is_line_begun {
            self.send(b"\n");
            let before_end = self.to_machine.len() - 1;
            self.to_machine.insert(before_end, None);
        }
    }

    /// Bytes that have not arrived yet.
    pub fn on_the_line(&self) -> usize {
        self.to_machine.len()
    }

    /// Takes the bytes that the machine has sent, with the times at which they were complete, s.
    pub fn take_bytes(&mut self) -> Vec<(f64, u8)> {
        std::mem::take(&mut self.from_machine)
    }

    /// Runs for so many seconds.
    pub fn run_for(&mut self, seconds: f64) {
        let ticks = (seconds * f64::from(TICKS_PER_SECOND)).round() as u64;
        self.run_until(self.simulator.now() + ticks, &mut |_| {});
    }

    /// Runs until so many seconds after power-up; `watch` gets what the step pins do.
    pub fn run_until_s(&mut self, seconds: f64, watch: &mut impl FnMut(&Edge)) {
        self.run_until(
            (seconds * f64::from(TICKS_PER_SECOND)).round() as u64,
            watch,
        );
    }

    /// When a pin changes, a wait ends, or a byte is complete on the line; and the clock of a machine that has
    /// one, as in silence time passes for it.
    fn due(&self) -> Option<u64> {
        let has_clock = self.simulator.session().needs_clock();
        let tick = self.simulator.now() + u64::from(TICK_MS * TICKS_PER_MS);
        let out = self.simulator.has_to_send().then_some(self.next_out);
        let input = (!self.to_machine.is_empty()).then_some(self.next_in);
        let events = [self.simulator.due(), out, input, has_clock.then_some(tick)];
        events.into_iter().flatten().min()
    }

    fn run_until(&mut self, end: u64, watch: &mut impl FnMut(&Edge)) {
        loop {
            let now = self.simulator.now();
            if now >= self.next_out
                && let Some(byte) = self.simulator.send()
            {
                self.next_out = now + BYTE_TICKS;
                let complete = self.next_out as f64 / f64::from(TICKS_PER_SECOND);
                self.from_machine.push((complete, byte));
                self.simulator.settle();
            }
            if now >= self.next_in
                && let Some(byte) = self.to_machine.pop_front()
            {
                self.next_in = now + BYTE_TICKS;
                match byte {
                    Some(byte) => self.simulator.receive(byte),
                    None => self.simulator.receive_damaged(),
                }
                self.simulator.settle();
            }
            if now >= end {
                return;
            }
            let next = self.due().map_or(end, |due| due.min(end));
            if let Some(edge) = self.simulator.advance(next.max(now)) {
                watch(&edge);
            }
            self.note();
        }
    }

    /// Whether nothing moves, and nothing will without another byte.
    pub fn stands_still(&self) -> bool {
        let snapshot = self.simulator.snapshot();
        let line_is_quiet = self.to_machine.is_empty() && !self.simulator.has_to_send();
        let reads_lines = !snapshot.is_critical && !snapshot.has_underrun;
        let is_done = snapshot.is_at_rest
            && (!reads_lines || self.simulator.received_free() == RECEIVED_RING - 1);
        line_is_quiet
            && match snapshot.state {
                State::HoldComplete | State::DoorClosed | State::DoorAjar | State::Sleep => true,
                State::Idle | State::Check | State::Alarm | State::Tool => is_done,
                State::Run
                | State::HoldSlowing
                | State::Jog
                | State::Home
                | State::DoorRetracting
                | State::DoorRestoring => false,
            }
    }
}
