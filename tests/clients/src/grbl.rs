//! The accounting of a serial line with Grbl's protocol: which answer belongs to which line.
//!
//! Pure: the input is the traffic of the sender and the machine, in its order. The rules are those of Grbl's protocol
//! and of no sender. Every line gets exactly one answer, in order, and the list of a `$` line comes right before the
//! answer. `?` gets one report. Only messages, alarms and the welcome come unasked. Read with Grbl's notes on its
//! interface.

use std::collections::VecDeque;

use grbl_client::{Report, realtime};
use leadscrew::model::WorkCoordinates;

use super::account::{Account, whole_line};

/// Stands for the lines that list the position of the probe.
const PROBED: &str = "PRB";
/// Faults that are kept; the first ones tell what happened.
const FAULTS: usize = 20;
/// The mark in a line that is to be refused, before the number of the error.
const EXPECTED: &str = "(error:";

/// What has been counted.
#[derive(Debug, Clone, Default, PartialEq, Eq)]
struct Counts {
    /// Lines sent to the machine.
    lines: u64,
    /// Answers from the machine.
    answers: u64,
    /// Of these, refusals.
    refusals: u64,
    /// Lines that a reset has voided.
    voided: u64,
    /// Realtime bytes other than `?`.
    realtime: u64,
    /// `?` sent.
    queries: u64,
    /// Status reports received.
    reports: u64,
    /// Resets asked for.
    resets: u64,
    /// Welcome lines.
    welcomes: u64,
    /// Alarms.
    alarms: u64,
    /// Bytes in flight, at most.
    most_in_flight: usize,
}

/// A line that has not been answered.
#[derive(Debug)]
struct Pending {
    text: String,
    bytes: usize,
    /// A reset came or was asked for since: whether it reached the machine is unknown.
    is_uncertain: bool,
    /// Lines of a list that came for it.
    listed: usize,
}

/// The books of one serial line.
#[derive(Debug, Default)]
pub(crate) struct Grbl {
    counts: Counts,
    faults: Vec<String>,
    /// The newest status report.
    report: String,
    sent: Vec<u8>,
    received: Vec<u8>,
    pending: VecDeque<Pending>,
    /// Answers that were taken for those of uncertain lines since the last welcome. Where a reset has
    /// swallowed such a line, they are those of lines behind it.
    doubtful: usize,
    /// Lines sent after the newest `0x18`, before its welcome.
    after_reset: usize,
    is_reset_asked: bool,
    /// The machine has told that it is locked, and has not been unlocked since.
    is_locked: bool,
    open_queries: u64,
    /// `?` was sent since the newest report.
    is_report_due: bool,
    /// State words seen in reports.
    states: Vec<String>,
    /// The machine waits in a change of the tool: new lines come before the lines that it keeps.
    is_changing_tool: bool,
    /// How many of the first pending lines were sent then.
    ahead: usize,
}

impl Grbl {
    fn line_sent(&mut self) {
        let bytes = self.sent.len() + 1;
        let text = String::from_utf8_lossy(&self.sent).into_owned();
        self.sent.clear();
        self.counts.lines += 1;
        let at = if self.is_changing_tool {
            self.ahead.min(self.pending.len())
        } else {
            self.pending.len()
        };
        self.ahead += usize::from(self.is_changing_tool);
        let line = Pending {
            text,
            bytes,
            is_uncertain: self.is_reset_asked,
            listed: 0,
        };
        self.pending.insert(at, line);
        if self.is_reset_asked {
            self.after_reset += 1;
        }
        // What was sent before a reset is not in flight any more.
        let newest = self.pending.iter().rev();
        let count = if self.is_reset_asked {
            self.after_reset
        } else {
            self.pending.len()
        };
        let in_flight = newest.take(count).map(|line| line.bytes).sum();
        self.counts.most_in_flight = self.counts.most_in_flight.max(in_flight);
    }

    fn reset_asked(&mut self) {
        self.counts.resets += 1;
        self.is_reset_asked = true;
        self.after_reset = 0;
        // What had been sent of a line is gone.
        self.sent.clear();
    }

    fn line_received(&mut self, text: &str) {
        if text == "ok" || text.starts_with("error:") {
            self.answered(text);
        } else if text.starts_with('<') {
            self.reported(text);
        } else if text.starts_with("Grbl ") {
            self.welcomed(text);
        } else if text.starts_with("ALARM:") {
            self.counts.alarms += 1;
        } else if text == LOCKED_MESSAGE || text == UNLOCKED {
            self.is_locked = text == LOCKED_MESSAGE;
        } else if text.starts_with("[MSG:") || text.starts_with('>') || text.is_empty() {
        } else if let Some(asked) = asked_by(text) {
            self.listed(text, asked);
        } else {
            self.fault(format!("nothing that Grbl says: {text:?}"));
        }
    }

    fn answered(&mut self, answer: &str) {
        self.counts.answers += 1;
        let is_locked = self.is_locked;
        self.skip_answered(|line| line.is_uncertain || may_have(&line.text, answer, is_locked));
        self.ahead = self.ahead.saturating_sub(1);
        let Some(line) = self.pending.pop_front() else {
            return self.fault(format!("{answer} answers nothing"));
        };
        if line.is_uncertain {
            self.doubtful += 1;
        }
        let is_refused = answer != "ok";
        self.counts.refusals += u64::from(is_refused);
        if line.text.trim() == "$H" && answer == "ok" {
            self.is_locked = false;
        }
        if !may_have(&line.text, answer, is_locked) && !line.is_uncertain {
            self.fault(format!(
                "{answer} instead of {} answers {:?}",
                expected(&line.text),
                line.text
            ));
        }
        let least = listed_at_least(&line.text);
        if !is_refused && line.listed < least && !line.is_uncertain {
            self.fault(format!(
                "{:?} lists {} of {least} lines",
                line.text, line.listed
            ));
        }
    }

    /// Skips lines that the machine cannot execute now, if a reset may have discarded them, or if their answer may
    /// have replaced the answer of a discarded line.
    fn skip_answered(&mut self, may_be: impl Fn(&Pending) -> bool) {
        while let Some(line) = self.pending.front()
            && (line.is_uncertain || self.doubtful > 0)
            && !may_be(line)
            && self.pending.iter().any(&may_be)
        {
            if !line.is_uncertain {
                self.doubtful -= 1;
            }
            self.pending.pop_front();
            self.counts.voided += 1;
        }
    }

    fn listed(&mut self, text: &str, asked: &str) {
        self.skip_answered(|line| asks(&line.text, asked));
        match self.pending.front_mut() {
            Some(line) if asks(&line.text, asked) => {
                line.listed += 1;
                // Whatever was swallowed stood before it.
                self.doubtful = 0;
            }
            Some(line) => {
                let fault = format!("{text} comes before the answer to {:?}", line.text);
                self.fault(fault);
            }
            None => self.fault(format!("{text} was not asked for")),
        }
    }

    fn reported(&mut self, text: &str) {
        self.counts.reports += 1;
        if self.open_queries == 0 {
            self.fault(format!("nobody asked for {text}"));
        }
        // Grbl keeps one question: all questions before this report have had their answer.
        self.open_queries = self.open_queries.saturating_sub(1);
        self.is_report_due = false;
        let report = Report::read(text).unwrap_or_default();
        if report.field("MPos").is_none() || report.field("FS").is_none() {
            self.fault(format!("a report without its parts: {text}"));
        }
        self.is_changing_tool = report.state == "Tool";
        if !STATES.contains(&report.state.as_str()) {
            self.fault(format!("no such state: {text}"));
        } else if !self.states.contains(&report.state) {
            self.states.push(report.state);
        }
        self.report = text.into();
    }

    fn welcomed(&mut self, text: &str) {
        self.counts.welcomes += 1;
        (self.is_changing_tool, self.ahead) = (false, 0);
        if text != "Grbl 1.1h ['$' for help]" {
            self.fault(format!("an unknown welcome: {text}"));
        }
        if self.is_reset_asked {
            while self.pending.len() > self.after_reset {
                self.pending.pop_front();
                self.counts.voided += 1;
            }
        }
        for line in &mut self.pending {
            line.is_uncertain = true;
        }
        self.doubtful = 0;
        self.is_reset_asked = false;
        self.after_reset = 0;
    }

    fn fault(&mut self, text: String) {
        if self.faults.len() < FAULTS {
            self.faults.push(text);
        }
    }
}

impl Account for Grbl {
    fn sent(&mut self, bytes: &[u8]) {
        for &byte in bytes {
            match byte {
                realtime::REPORT => {
                    self.counts.queries += 1;
                    self.open_queries += 1;
                    self.is_report_due = true;
                }
                realtime::RESET => self.reset_asked(),
                realtime::HOLD | realtime::RESUME | 0x80.. => {
                    self.counts.realtime += 1;
                    self.is_changing_tool &= byte != realtime::RESUME;
                }
                // Each of them ends a line, as for Grbl.
                b'\n' | b'\r' => self.line_sent(),
                byte => self.sent.push(byte),
            }
        }
    }

    fn received(&mut self, bytes: &[u8]) {
        for byte in bytes {
            match whole_line(&mut self.received, *byte) {
                Some(Ok(text)) => self.line_received(&text),
                Some(Err(fault)) => self.fault(fault),
                None => {}
            }
        }
    }

    fn close(&mut self) {
        let uncertain = self.pending.iter().filter(|line| line.is_uncertain).count();
        self.counts.voided += uncertain as u64;
        let lost: Vec<_> = self
            .pending
            .drain(..)
            .filter(|line| !line.is_uncertain)
            .collect();
        let answered = self.doubtful.min(lost.len());
        self.counts.voided += answered as u64;
        for line in &lost[answered..] {
            self.fault(format!("{:?} was not answered", line.text));
        }
        if self.is_reset_asked {
            self.fault("no welcome came after a reset".into());
        }
        if self.is_report_due {
            self.fault("no report came after the last `?`".into());
        }
        if !self.received.is_empty() {
            let text = String::from_utf8_lossy(&self.received).into_owned();
            self.fault(format!("half a line: {text:?}"));
        }
    }

    fn is_quiet(&self) -> bool {
        let certain = self.pending.iter().filter(|line| !line.is_uncertain);
        let waits = certain.count() > self.doubtful;
        !waits && !self.is_reset_asked && !self.is_report_due && self.received.is_empty()
    }

    fn progress(&self) -> String {
        let counts = &self.counts;
        let report = Report::read(&self.report).unwrap_or_default();
        let (state, place) = (&report.state, report.field("MPos").unwrap_or_default());
        format!(
            "{state} at {place}, {} lines, {} answers, {} resets, {} welcomes",
            counts.lines, counts.answers, counts.resets, counts.welcomes
        )
    }

    fn report(&self) -> &str {
        &self.report
    }

    fn faults(&self) -> &[String] {
        &self.faults
    }

    fn summary(&self) -> String {
        let counts = &self.counts;
        format!(
            "{} lines, {} answers, {} voided by {} resets, {} `?`, {} reports, {} other realtime bytes, \
             at most {} bytes in flight",
            counts.lines,
            counts.answers,
            counts.voided,
            counts.resets,
            counts.queries,
            counts.reports,
            counts.realtime,
            counts.most_in_flight
        )
    }
}

/// A machine that must be homed or unlocked says this after its welcome.
const LOCKED_MESSAGE: &str = "[MSG:'$H'|'$X' to unlock]";
/// The answer to `$X`, before its `ok`.
const UNLOCKED: &str = "[MSG:Caution: Unlocked]";

/// Every state word of Grbl 1.1, and `Tool`, of a change of the tool in which lines are taken.
const STATES: [&str; 14] = [
    "Idle", "Run", "Hold:0", "Hold:1", "Jog", "Alarm", "Door:0", "Door:1", "Door:2", "Door:3",
    "Check", "Home", "Sleep", "Tool",
];

/// The `$` line that lists such a line; `None` for what nobody lists.
fn asked_by(text: &str) -> Option<&'static str> {
    let is_tool = text.starts_with('T') && text.contains(" P");
    if is_tool {
        return Some("$TT");
    }
    let Some(inner) = text.strip_prefix('[') else {
        let is_startup_line = text.starts_with("$N");
        let asked = if is_startup_line { "$N" } else { "$$" };
        return text.starts_with('$').then_some(asked);
    };
    match inner.split(':').next().unwrap_or_default() {
        "GC" => Some("$G"),
        "VER" | "OPT" | "NEWOPT" => Some("$I"),
        "HLP" => Some("$"),
        "G28" | "G30" | "G92" | "TLO" | "T" => Some("$#"),
        "PRB" => Some(PROBED),
        word if WorkCoordinates::ALL
            .iter()
            .any(|system| system.word() == word) =>
        {
            Some("$#")
        }
        _ => None,
    }
}

/// How many lines a `$` line lists before its `ok`.
fn listed_at_least(line: &str) -> usize {
    match line.trim().to_ascii_uppercase().as_str() {
        "$G" | "$" => 1,
        "$I" | "$N" => 2,
        "$#" => 11,
        "$$" | "$+" => 34,
        _ => 0,
    }
}

/// The answer that a line is to have.
fn expected(line: &str) -> String {
    let marked = line.split_once(EXPECTED);
    marked.map_or("ok".into(), |(_, tail)| {
        format!("error:{}", tail.split(')').next().unwrap_or_default())
    })
}

/// Whether a line may have such an answer. Senders stream on until they have read that the machine is
/// locked.
fn may_have(line: &str, answer: &str, is_locked: bool) -> bool {
    answer == expected(line) || is_locked && answer == "error:9" || may_be_refused(line, answer)
}

/// Whether Grbl refuses such a line so in some state, and senders send it all the same.
fn may_be_refused(line: &str, answer: &str) -> bool {
    answer == "error:8" && line.starts_with('$')
}

/// Whether a line asks for what is listed before its answer.
fn asks(line: &str, asked: &str) -> bool {
    let line = line.trim().to_ascii_uppercase();
    // A probing move tells where it ended, `$+` lists all settings, and `$I+` all that the machine is.
    line == asked
        || asked == "$$" && line == "$+"
        || asked == "$I" && line == "$I+"
        || asked == PROBED && (line == "$#" || line.contains("G38"))
}

#[cfg(test)]
mod tests {
    use super::*;

    /// The faults of an exchange: `>` what is sent, `<` a line received.
    fn faults(exchange: &[&str]) -> Vec<String> {
        let mut account = Grbl::default();
        for step in exchange {
            match step.split_at(1) {
                (">", sent) => account.sent(sent.as_bytes()),
                (_, received) => account.received(format!("{received}\r\n").as_bytes()),
            }
        }
        account.close();
        account.faults
    }

    #[test]
    fn a_lawful_exchange_has_no_faults() {
        let exchange = [
            ">G0X1\n?$G\nG9",
            "<ok",
            "<<Idle|MPos:0.000,0.000,0.000|FS:0,0>",
            "<[GC:G0 G54]",
            "<ok",
            ">9 (error:20)\n",
            "<error:20",
            "<[MSG:Pgm End]",
        ];
        assert!(faults(&exchange).is_empty());
    }

    #[test]
    fn progress_is_an_answer_or_another_place_and_no_report_of_the_same() {
        let mut account = Grbl::default();
        let mut after = |sent: &str, received: &str| {
            account.sent(sent.as_bytes());
            account.received(received.as_bytes());
            account.progress()
        };
        let moved = after("?", "<Run|MPos:1.000,0.000,0.000|FS:1,0>\r\n");
        let stuck = after(
            "?",
            "<Run|MPos:1.000,0.000,0.000|FS:1,0|Ov:100,100,100>\r\n",
        );
        assert_eq!(moved, stuck);
        let asked = after("$G\n", "");
        let answered = after("", "ok\r\n");
        let at_rest = after("?", "<Idle|MPos:1.000,0.000,0.000|FS:0,0>\r\n");
        let all = [stuck, asked, answered, at_rest];
        assert!(all.windows(2).all(|pair| pair[0] != pair[1]), "{all:?}");
    }

    #[test]
    fn a_lost_answer_is_a_fault() {
        assert_eq!(faults(&[">G0\nG1\n", "<ok"]).len(), 1);
    }

    #[test]
    fn a_doubled_answer_is_a_fault() {
        assert_eq!(faults(&[">G0\n", "<ok", "<ok"]).len(), 1);
    }

    #[test]
    fn a_misplaced_answer_is_a_fault() {
        let exchange = [">G0\nG33 (error:20)\n", "<error:20", "<ok"];
        assert_eq!(faults(&exchange).len(), 2);
        assert_eq!(faults(&[">G0\n$G\n", "<[GC:G0]", "<ok", "<ok"]).len(), 2);
    }

    #[test]
    fn a_change_of_the_tool_takes_lines_before_those_that_it_keeps() {
        let report = |state: &str| format!("<<{state}|MPos:0.000,0.000,0.000|FS:0,0>");
        let in_state = |state: &str| {
            let (hold, tool) = (report("Hold:0"), report(state));
            let change = [">M6\nG0\n?", &hold, ">\u{a3}?", &tool, ">$G\n", "<[GC:G0]"];
            faults(
                &[
                    &change[..],
                    &["<ok", ">~", "<ok", "<ok", ">$G\n", "<[GC:G0]", "<ok"],
                ]
                .concat(),
            )
        };
        assert!(in_state("Tool").is_empty());
        assert_eq!(in_state("Hold:0").len(), 2);
    }

    #[test]
    fn a_report_that_nobody_asked_for_is_a_fault() {
        let report = "<<Run|MPos:0.000,0.000,0.000|FS:0,0>";
        assert_eq!(faults(&[">?", report, report]).len(), 1);
    }

    #[test]
    fn a_reset_voids_what_was_sent_before_it() {
        let welcome = "<Grbl 1.1h ['$' for help]";
        assert!(faults(&[">G0\nG1\n\x18", "<ok", "<ALARM:3", welcome]).is_empty());
        assert!(faults(&[">G0\n\x18G1\n", welcome, "<ok"]).is_empty());
        assert_eq!(faults(&[">G0\n\x18", welcome, "<ok"]).len(), 1);
        assert_eq!(faults(&[">\x18"]).len(), 1);
    }

    #[test]
    fn what_is_streamed_before_a_welcome_is_read_may_be_answered_for_what_was_swallowed() {
        let asked = [">G0\n\x18", ">G1\n", "<Grbl 1.1h ['$' for help]"];
        let locked = ["<[MSG:'$H'|'$X' to unlock]", ">G2\n"];
        // The answer is that of `G2`, if the reset came after `G1`.
        let listed = ["<error:9", ">$G\n", "<[GC:G0]", "<ok"];
        assert!(faults(&[&asked[..], &locked, &listed].concat()).is_empty());
        assert!(faults(&[&asked[..], &locked, &["<error:9"]].concat()).is_empty());
        let both = ["<error:9", "<error:9", ">$G\n", "<[GC:G0]", "<ok"];
        assert!(faults(&[&asked[..], &locked, &both].concat()).is_empty());
        // A list tells where the machine is: from there on an answer that is missing is lost.
        let lost = [&asked[..], &locked, &listed, &[">G3\nG4\n", "<error:9"]].concat();
        assert_eq!(faults(&lost).len(), 1);
        let late = [
            &asked[..],
            &locked,
            &both,
            &[">G3\n$G\n", "<[GC:G0]", "<ok", "<ok"],
        ]
        .concat();
        assert_eq!(faults(&late).len(), 2);
    }

    #[test]
    fn only_a_locked_machine_may_refuse_all_lines() {
        let (refused, unlock) = (
            [">G0\n", "<error:9"],
            [">$X\n", "<[MSG:Caution: Unlocked]", "<ok"],
        );
        let locked = ["<[MSG:'$H'|'$X' to unlock]"];
        assert!(faults(&[&locked[..], &refused].concat()).is_empty());
        let faults = faults(&[&locked[..], &unlock, &refused].concat());
        assert_eq!(faults.len(), 1);
    }

    #[test]
    fn a_carriage_return_ends_a_line_too() {
        assert!(faults(&[">G21\r", "<ok"]).is_empty());
        assert_eq!(faults(&[">G21\r\n", "<ok"]).len(), 1);
    }

    #[test]
    fn bytes_in_flight_are_counted_with_their_line_feeds() {
        let mut account = Grbl::default();
        account.sent(b"G0X1\n?G0\n!");
        assert_eq!(account.counts.most_in_flight, 8);
        assert_eq!(account.counts.realtime, 1);
    }
}
