//! A program that is streamed to the machine, as senders do.

use anyhow::Result;
use common::ui;
use grbl_client::{
    Response, Sender, meaning,
    sender::{Received, shown},
};
use simulation::program::Program;

/// A program on its way.
pub(crate) struct Sending {
    program: Program,
    sender: Sender,
    /// The line that waits for room.
    next: Option<Vec<u8>>,
    is_read: bool,
    /// Lines that were refused.
    pub(crate) refused: u64,
    /// Reports since the last answer that say that the machine is idle.
    idle: u32,
}

/// Reports by which a machine is known to stand still: the first may be older than the last line.
const IDLE_REPORTS: u32 = 2;

impl Sending {
    pub(crate) fn new(program: Program) -> Self {
        Self {
            program,
            sender: Sender::default(),
            next: None,
            is_read: false,
            refused: 0,
            idle: 0,
        }
    }

    /// Sends the lines for which the machine has room.
    pub(crate) fn feed(&mut self, machine: &mut Vec<u8>) -> Result<()> {
        while !self.is_read {
            if self.next.is_none() {
                self.next = self.program.next_line()?;
            }
            let Some(line) = self.next.take() else {
                self.is_read = true;
                break;
            };
            if !self.sender.may_send(&line) {
                self.next = Some(line);
                break;
            }
            machine.extend(&line);
            machine.push(b'\n');
            self.sender.send(line);
        }
        Ok(())
    }

    /// Number and text of the oldest line that is not answered.
    pub(crate) fn oldest(&self) -> Option<(u64, &[u8])> {
        self.sender.oldest()
    }

    /// Takes an answer. Returns how many lines are answered, and a refused line with the reason.
    pub(crate) fn answer(&mut self, text: &str) -> (u64, Option<String>) {
        self.idle = 0;
        let mut refusal = None;
        if let Received::Answer(answered) = self.sender.receive(text)
            && let Response::Error(number) = answered.response
        {
            self.refused += 1;
            let reason = meaning::error_with_remedy(number);
            let text = format!(
                "line {} ({}): {text}{}",
                answered.number,
                shown(&answered.line),
                meaning::after_comma(reason.as_deref())
            );
            ui::warning(&text);
            refusal = Some(text);
        }
        (self.sender.answered(), refusal)
    }

    /// Takes the state of a report.
    pub(crate) fn report(&mut self, state: &str) {
        let is_idle = matches!(state, "Idle" | "Check");
        self.idle = if is_idle { self.idle + 1 } else { 0 };
    }

    /// Returns whether every line is answered and the machine stands still.
    pub(crate) fn is_done(&self) -> bool {
        self.is_read && self.sender.is_done() && self.idle >= IDLE_REPORTS
    }
}

#[cfg(test)]
mod tests {
    use std::io::Cursor;

    use super::*;

    #[test]
    fn lines_go_as_there_is_room_and_the_end_needs_a_machine_at_rest() {
        let lines = "G1 X1.000000 Y2.000000 F100\n".repeat(9) + "G28.1\nG99";
        let mut job = Sending::new(Program::from_reader("test".into(), Cursor::new(lines)));
        let mut machine = Vec::new();
        job.feed(&mut machine).unwrap();
        assert_eq!(String::from_utf8_lossy(&machine).lines().count(), 4);
        for answered in 1..=9 {
            assert_eq!(job.answer("ok"), (answered, None));
            job.feed(&mut machine).unwrap();
        }
        // The line that writes to the flash goes alone.
        assert!(machine.ends_with(b"G28.1\n"));
        job.answer("ok");
        job.feed(&mut machine).unwrap();
        assert!(machine.ends_with(b"G99\n"));
        job.report("Idle");
        job.report("Idle");
        assert!(!job.is_done());
        assert_eq!(job.oldest(), Some((11, &b"G99"[..])));
        let refusal = job.answer("error:20").1.expect("it is refused");
        assert!(
            refusal.starts_with("line 11 (G99): error:20, this command or word is not supported: "),
            "{refusal}"
        );
        job.report("Run");
        job.report("Idle");
        assert!(!job.is_done());
        job.report("Idle");
        assert!(job.is_done() && job.refused == 1);
    }
}
