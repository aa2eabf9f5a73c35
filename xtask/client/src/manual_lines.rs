//! Lines that the operator types during a change of the tool: jogs, probing, the length of the tool.
//!
//! Pure. The machine executes lines then, and keeps those that the job has sent before; so nothing more of the
//! job is sent until the machine goes on with it.

use crate::{
    Response, meaning,
    realtime::{HOLD, TOOL_CHANGE},
    sender::code,
};

/// Reports after which a machine that has not followed will not.
const REPORTS: u32 = 5;

#[derive(Debug, Clone, Copy, Default, PartialEq)]
enum Stage {
    #[default]
    Off,
    /// The machine has been asked, so many reports ago.
    Asked(u32),
    On,
}

/// What is typed.
#[derive(Debug, Default)]
pub struct ManualLines {
    stage: Stage,
    /// The line that is being typed.
    pub text: Option<String>,
    unanswered: usize,
    /// The operator has pressed cycle start since, so many reports of a change of the tool ago.
    resumed: Option<u32>,
    /// A line has set what a reset takes away again.
    pub has_set: bool,
}

impl ManualLines {
    /// Whether nothing of the job may be sent.
    #[must_use]
    pub fn is_on(&self) -> bool {
        self.stage != Stage::Off
    }

    /// Whether the machine has not followed yet: what is typed now would be taken for keys.
    #[must_use]
    pub fn is_asked(&self) -> bool {
        matches!(self.stage, Stage::Asked(_))
    }

    /// Whether the machine executes lines now: not behind a cycle start.
    #[must_use]
    pub fn takes_lines(&self) -> bool {
        self.stage == Stage::On && self.resumed.is_none()
    }

    /// Sends a line.
    pub fn send(&mut self, line: &str, output: &mut Vec<u8>) {
        self.has_set |= sets(line.as_bytes());
        output.extend(line.as_bytes());
        output.push(b'\n');
        self.unanswered += 1;
        self.resumed = None;
    }

    /// Whether one is not answered yet.
    #[must_use]
    pub fn awaits_answer(&self) -> bool {
        self.unanswered > 0
    }

    /// Asks the machine to execute lines.
    pub fn begin(&mut self, output: &mut Vec<u8>) {
        if self.stage == Stage::Off {
            self.stage = Stage::Asked(0);
            output.push(TOOL_CHANGE);
        } else if self.stage == Stage::On {
            self.text = Some(String::new());
        }
        self.resumed = None;
    }

    /// The operator has pressed cycle start.
    pub fn resume(&mut self) {
        self.resumed = Some(0);
    }

    /// Takes the state of a report. Returns what the operator is to read.
    pub fn report(&mut self, state: &str) -> Option<&'static str> {
        match self.stage {
            Stage::Asked(_) if state == "Tool" => {
                self.stage = Stage::On;
                self.text = Some(String::new());
                Some(
                    "type lines: Enter sends one, Enter alone ends; ! holds; t types again, r goes on with the job",
                )
            }
            Stage::Asked(REPORTS..) => {
                self.stage = Stage::Off;
                Some("the machine takes lines by hand only in a change of the tool")
            }
            Stage::Asked(reports) => {
                self.stage = Stage::Asked(reports + 1);
                None
            }
            Stage::On if self.unanswered == 0 => {
                if self.resumed.is_some() && is_unanswered(state) {
                    self.stage = Stage::Off;
                    self.text = None;
                } else if state == "Tool" {
                    // A machine that moved then has not obeyed.
                    self.resumed = self.resumed.map(|reports| reports + 1);
                    self.resumed.take_if(|reports| *reports > REPORTS);
                }
                None
            }
            Stage::On | Stage::Off => None,
        }
    }

    /// Takes an answer, if it is one to a typed line. Returns what the operator is to read.
    pub fn answer(&mut self, line: &str) -> Option<String> {
        let response = Response::parse(line).filter(|_| self.unanswered > 0)?;
        self.unanswered -= 1;
        Some(match response {
            Response::Error(number) => {
                let why = meaning::error_with_remedy(number);
                format!("{line}{}", meaning::after_comma(why.as_deref()))
            }
            Response::Ok => line.into(),
        })
    }

    /// Takes a key while a line is being typed. Returns whether a line is complete and sent.
    pub fn press(&mut self, key: u8, output: &mut Vec<u8>) -> bool {
        let Some(text) = &mut self.text else {
            return false;
        };
        match key {
            b'\n' | b'\r' if text.is_empty() => self.text = None,
            b'\n' | b'\r' => {
                let line = std::mem::take(text);
                self.send(&line, output);
                return true;
            }
            0x1b => self.text = None,
            0x08 | 0x7f => drop(text.pop()),
            // No line has it, and a jog or a probing move may have to stop at once.
            b'!' => output.push(HOLD),
            // These would be realtime commands, too.
            b'?' | b'~' => {}
            b' '..=b'~' => text.push(key.into()),
            _ => {}
        }
        false
    }
}

/// Whether a machine in this state goes on with the job.
fn is_unanswered(state: &str) -> bool {
    matches!(state, "Run" | "Idle" | "Hold:0")
}

/// Whether a line sets an offset that a reset takes away, or the table of tools: not the origins.
fn sets(line: &[u8]) -> bool {
    let code = code(line);
    let holds = |word: &[u8]| code.windows(word.len()).any(|part| part == word);
    [&b"G43"[..], b"G49", b"G92", b"G52", b"G10L1", b"$TT"]
        .into_iter()
        .any(holds)
}

#[cfg(test)]
mod tests {
    use super::*;

    fn typed(manual_lines: &mut ManualLines, keys: &str) -> String {
        let mut output = Vec::new();
        for key in keys.bytes() {
            manual_lines.press(key, &mut output);
        }
        String::from_utf8(output).unwrap()
    }

    fn begun() -> ManualLines {
        let (mut manual_lines, mut output) = (ManualLines::default(), Vec::new());
        manual_lines.begin(&mut output);
        assert_eq!(output, [TOOL_CHANGE]);
        assert_eq!(manual_lines.report("Hold:0"), None);
        assert!(manual_lines.is_on() && manual_lines.text.is_none());
        assert!(manual_lines.report("Tool").is_some());
        manual_lines
    }

    #[test]
    fn lines_go_out_whole_and_have_their_own_answers() {
        let mut manual_lines = begun();
        assert_eq!(typed(&mut manual_lines, "$J=G91X1"), "");
        assert_eq!(
            typed(&mut manual_lines, "5\u{7f} F?1~00\n"),
            "$J=G91X1 F100\n"
        );
        assert_eq!(manual_lines.answer("[MSG:x]"), None);
        assert_eq!(manual_lines.answer("ok").as_deref(), Some("ok"));
        assert_eq!(manual_lines.answer("ok"), None);
        assert!(!manual_lines.has_set);
        typed(&mut manual_lines, "g43.1 z-2\n");
        assert!(manual_lines.has_set);
        assert!(manual_lines.answer("error:40").unwrap().len() > 10);
        typed(&mut manual_lines, "\n");
        assert_eq!(manual_lines.text, None);
    }

    #[test]
    fn a_feed_hold_is_sent_while_a_line_is_typed() {
        let mut manual_lines = begun();
        assert_eq!(
            typed(&mut manual_lines, "G38.2 Z-5 F50\n!"),
            "G38.2 Z-5 F50\n!"
        );
        assert_eq!(typed(&mut manual_lines, "G0!X1\n"), "!G0X1\n");
    }

    #[test]
    fn the_job_goes_on_when_the_machine_has_left_the_change() {
        let mut manual_lines = begun();
        typed(&mut manual_lines, "G38.2 Z-5 F50\n");
        // It probes: nobody has pressed cycle start.
        manual_lines.report("Run");
        manual_lines.resume();
        manual_lines.report("Run");
        assert!(manual_lines.is_on());
        manual_lines.answer("ok");
        manual_lines.report("Tool");
        manual_lines.report("Jog");
        assert!(manual_lines.is_on());
        manual_lines.report("Run");
        assert!(!manual_lines.is_on() && manual_lines.text.is_none());
    }

    #[test]
    fn a_machine_that_is_in_no_change_is_not_waited_for() {
        let (mut manual_lines, mut output) = (ManualLines::default(), Vec::new());
        manual_lines.begin(&mut output);
        let notes = (0..10).filter_map(|_| manual_lines.report("Hold:0"));
        assert_eq!(notes.count(), 1);
        assert!(!manual_lines.is_on());
    }
}
