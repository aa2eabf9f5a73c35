//! The accounting of a serial line, in whichever protocol.

use grbl_client::Report;

/// The books of a serial line: they are told all that passes, in its order.
pub(crate) trait Account: Send {
    /// The sender has written bytes.
    fn sent(&mut self, bytes: &[u8]);
    /// The machine has written bytes.
    fn received(&mut self, bytes: &[u8]);
    /// The line is closed: what has not been answered never will be.
    fn close(&mut self);
    /// Whether nothing is owed: no answer, no report, no welcome.
    fn is_quiet(&self) -> bool;
    /// How far sender and machine are, in words: that changes as long as they go on.
    fn progress(&self) -> String;
    /// The newest status report.
    fn report(&self) -> &str;
    /// What is wrong.
    fn faults(&self) -> &[String];
    /// What has been counted, in words.
    fn summary(&self) -> String;

    /// The machine position in the newest report, mm.
    fn position(&self) -> Option<Vec<f64>> {
        Report::read(self.report())?.machine_position()
    }
}

/// Takes the bytes of what may be a whole line now; its text without its end, once that has come.
pub(crate) fn whole_line(begun: &mut Vec<u8>, byte: u8) -> Option<Result<String, String>> {
    if byte != b'\n' {
        begun.push(byte);
        return None;
    }
    let line = std::mem::take(begun);
    let text = String::from_utf8_lossy(&line).into_owned();
    let stripped = text.strip_suffix('\r').map(str::to_owned);
    Some(stripped.ok_or_else(|| format!("no carriage return ends {text:?}")))
}
