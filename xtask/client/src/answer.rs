//! What machines say of themselves in answer to `$` statements.

use leadscrew::settings::StepRate;

use crate::Line;

/// What `[OPT:V,15,128]` says of a machine's queues, where it does: `FluidNC` leaves it out.
#[derive(Debug, Clone, Copy, PartialEq, Eq)]
pub struct Queues {
    /// Moves that can wait.
    pub blocks: usize,
    /// Size of the receive buffer, bytes.
    pub receive: usize,
}

impl Queues {
    /// Reads a line of `$I`.
    #[must_use]
    pub fn read(line: &str) -> Option<Self> {
        let Line::Answer("OPT", options) = Line::read(line) else {
            return None;
        };
        let mut numbers = options.split(',').skip(1).map(str::parse);
        Some(Self {
            blocks: numbers.next()?.ok()?,
            receive: numbers.next()?.ok()?,
        })
    }

    /// Bytes of lines without an answer that the machine has room for: its buffer holds one less than its size.
    /// Lines by hand in a change of the tool need room behind those of a job, which then wait in it.
    #[must_use]
    pub fn window(&self) -> usize {
        self.receive.saturating_sub(1)
    }
}

/// The answers of a machine at rest, as it has given them: all that a job depends on.
#[derive(Debug, Clone, Default, PartialEq)]
#[cfg_attr(feature = "serde", derive(serde::Serialize, serde::Deserialize))]
pub struct MachineAnswers {
    /// Lines of `$I`.
    pub version: Vec<String>,
    /// Lines of `$+`, or of `$$`.
    pub settings: Vec<String>,
    /// Lines of `$#`.
    pub parameters: Vec<String>,
    /// Lines of `$TT`; none from a machine without a tool table.
    pub tools: Vec<String>,
    /// The line of `$G`.
    pub modes: String,
    /// The machine position in the unit of reports.
    pub position: Vec<f64>,
}

impl MachineAnswers {
    /// The values behind a name in `$#`, and what stands behind another colon.
    #[must_use]
    pub fn parameter(&self, name: &str) -> Option<(&str, Option<&str>)> {
        let inside = self
            .parameters
            .iter()
            .find_map(|line| match Line::read(line) {
                Line::Answer(found, rest) if found == name => Some(rest),
                _ => None,
            })?;
        let mut parts = inside.split(':');
        Some((parts.next().unwrap_or_default(), parts.next()))
    }
}

/// The step rate in a line of `$I`: Leadscrew's alone.
#[must_use]
pub fn step_rate(line: &str) -> Option<StepRate> {
    let Line::Message(text) = Line::read(line) else {
        return None;
    };
    match text.strip_prefix("Step rate: ")?.split_once(" Hz, ")? {
        (hz, "proven") => Some(StepRate::Proven(hz.parse().ok()?)),
        (_, "unproven") => Some(StepRate::Unproven),
        _ => None,
    }
}

#[cfg(test)]
mod tests {
    use super::*;

    #[test]
    fn the_window_is_one_less_than_the_receive_buffer() {
        for (line, queues) in [
            ("[OPT:V,15,128]", Some((15, 128, crate::WINDOW))),
            ("[OPT:VNMSL+,999,1024,4,0]", Some((999, 1024, 1023))),
            ("[OPT:MPHS]", None),
            ("[OPT:V,15]", None),
            ("[OPT:V,15,x]", None),
            ("[VER:1.1h.20190830:]", None),
        ] {
            let read = Queues::read(line);
            let read = read.map(|queues| (queues.blocks, queues.receive, queues.window()));
            assert_eq!(read, queues, "{line}");
        }
    }

    #[test]
    fn parameters_are_found_by_their_names() {
        let lines = ["[G54:1.000,2.000,0.000:30]", "[TLO:0.000]"].map(str::to_owned);
        let answers = MachineAnswers {
            parameters: lines.to_vec(),
            ..MachineAnswers::default()
        };
        let found = Some(("1.000,2.000,0.000", Some("30")));
        assert_eq!(answers.parameter("G54"), found);
        assert_eq!(answers.parameter("TLO"), Some(("0.000", None)));
        assert_eq!(answers.parameter("G5"), None);
    }

    #[test]
    fn the_step_rate_is_reported_by_this_firmware_only() {
        for (line, rate) in [
            (
                "[MSG:Step rate: 200000 Hz, proven]",
                Some(StepRate::Proven(200_000)),
            ),
            (
                "[MSG:Step rate: 30000 Hz, unproven]",
                Some(StepRate::Unproven),
            ),
            ("[VER:1.1h.20190830:]", None),
            ("[MSG:Step rate: fast]", None),
        ] {
            assert_eq!(step_rate(line), rate, "{line}");
        }
    }
}
