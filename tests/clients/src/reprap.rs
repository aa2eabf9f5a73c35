//! The accounting of a serial line on which a RepRap machine is driven.
//!
//! Pure, as [`Grbl`](super::grbl::Grbl). Each line that is not blank gets exactly one answer, beginning with `ok`.
//! Only a damaged line is requested again.

use super::account::{Account, whole_line};

/// Beginnings of the messages of a RepRap machine besides `ok`.
const KNOWN_MESSAGES: [&str; 12] = [
    "Error:",
    "Resend:",
    "echo:",
    "start",
    "wait",
    "X:",
    "FIRMWARE_NAME:",
    "Cap:",
    "//",
    "<",
    "[MSG:",
    "Grbl ",
];

/// The books of one serial line.
#[derive(Debug, Default)]
pub(crate) struct RepRap {
    /// Lines are damaged on their way, after they have been written here.
    is_damaged: bool,
    faults: Vec<String>,
    sent: Vec<u8>,
    received: Vec<u8>,
    report: String,
    lines: u64,
    answers: u64,
    resends: u64,
    errors: u64,
}

impl RepRap {
    pub(crate) fn new(is_damaged: bool) -> Self {
        Self {
            is_damaged,
            ..Self::default()
        }
    }

    fn line_sent(&mut self) {
        let line = std::mem::take(&mut self.sent);
        let text = String::from_utf8_lossy(&line);
        let words = text.split(';').next().unwrap_or_default();
        self.lines += u64::from(!words.trim().is_empty());
    }

    fn line_received(&mut self, text: &str) {
        if text.starts_with("ok") {
            self.answers += 1;
            if self.answers > self.lines && !self.is_damaged {
                self.faults.push(format!("{text:?} answers nothing"));
            }
        } else if text.starts_with("Resend:") {
            self.resends += 1;
        } else if text.starts_with("Error:") {
            self.errors += 1;
            if !self.is_damaged {
                self.faults.push(format!("a line is refused: {text}"));
            }
        } else if text.starts_with('<') {
            self.report = text.into();
        } else if !text.is_empty() && !KNOWN_MESSAGES.iter().any(|begin| text.starts_with(begin)) {
            self.faults
                .push(format!("nothing that a RepRap machine says: {text:?}"));
        }
    }
}

impl Account for RepRap {
    fn sent(&mut self, bytes: &[u8]) {
        for byte in bytes {
            match byte {
                b'\n' | b'\r' => self.line_sent(),
                // Behind a line end it asks for a report.
                b'?' if self.sent.is_empty() => {}
                byte => self.sent.push(*byte),
            }
        }
    }

    fn received(&mut self, bytes: &[u8]) {
        for byte in bytes {
            match whole_line(&mut self.received, *byte) {
                Some(Ok(text)) => self.line_received(&text),
                Some(Err(fault)) => self.faults.push(fault),
                None => {}
            }
        }
    }

    fn close(&mut self) {
        let Self {
            lines,
            answers,
            resends,
            ..
        } = *self;
        if !self.is_damaged && answers != lines {
            self.faults
                .push(format!("{answers} answers to {lines} lines"));
        }
        if !self.is_damaged && resends > 0 {
            self.faults.push(format!(
                "{resends} lines are asked for again, and none was damaged"
            ));
        }
        if self.is_damaged && resends == 0 {
            self.faults.push("no line was asked for again".into());
        }
    }

    fn is_quiet(&self) -> bool {
        self.is_damaged || self.answers == self.lines
    }

    fn progress(&self) -> String {
        let Self {
            lines,
            answers,
            resends,
            ..
        } = self;
        format!(
            "{lines} lines, {answers} answers, {resends} resends; {}",
            self.report
        )
    }

    fn report(&self) -> &str {
        &self.report
    }

    fn faults(&self) -> &[String] {
        &self.faults
    }

    fn summary(&self) -> String {
        let Self {
            lines,
            answers,
            resends,
            errors,
            ..
        } = self;
        format!("{lines} lines, {answers} answers, {errors} refused, {resends} asked for again")
    }
}

#[cfg(test)]
mod tests {
    use super::*;

    /// The faults of an exchange: `>` what is sent, `<` a line received.
    fn faults(is_damaged: bool, exchange: &[&str]) -> usize {
        let mut account = RepRap::new(is_damaged);
        for step in exchange {
            match step.split_at(1) {
                (">", sent) => account.sent(sent.as_bytes()),
                (_, received) => account.received(format!("{received}\r\n").as_bytes()),
            }
        }
        account.close();
        account.faults.len()
    }

    #[test]
    fn each_line_that_is_not_blank_has_one_answer() {
        assert_eq!(
            faults(false, &[">M105\n\n; words\r\n?", "<ok T:0.0 /0.0"]),
            0
        );
        assert_eq!(
            faults(false, &[">G28\n", "<echo:busy: processing", "<ok"]),
            0
        );
        assert_eq!(faults(false, &[">G28\n"]), 1);
        assert_eq!(faults(false, &[">G28\n", "<ok", "<ok"]), 2);
        assert_eq!(faults(false, &[">G28\n", "<ok", "<error:9"]), 1);
    }

    #[test]
    fn lines_are_asked_for_again_where_lines_are_damaged_and_only_there() {
        let exchange = [
            ">N1 G28*18\n",
            "<Error:checksum mismatch, Last Line: 0",
            "<Resend: 1",
            "<ok",
        ];
        assert_eq!(faults(true, &exchange), 0);
        assert_eq!(faults(false, &exchange), 2);
        assert_eq!(faults(true, &[">G28\n", "<ok"]), 1);
    }
}
