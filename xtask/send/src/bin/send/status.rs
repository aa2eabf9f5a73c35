//! What a machine reports of itself: `<Run|MPos:1.000,0.000,0.000|FS:500,8000>`.

/// A status report, with what earlier ones have had and it has not.
#[derive(Debug, Clone, PartialEq)]
pub(crate) struct Status {
    /// The state as it is named: `Hold:0`.
    pub(crate) state: String,
    machine: Option<Vec<f64>>,
    work: Option<Vec<f64>>,
    offset: Option<Vec<f64>>,
    /// Feed, and the spindle's speed, as they are shown.
    pub(crate) speeds: String,
    /// Overrides of feed, rapids and spindle, %.
    pub(crate) overrides: [u32; 3],
}

impl Default for Status {
    fn default() -> Self {
        Self {
            state: String::new(),
            machine: None,
            work: None,
            offset: None,
            speeds: String::new(),
            overrides: [100; 3],
        }
    }
}

impl Status {
    /// Takes a line. Returns whether it was a report.
    pub(crate) fn read(&mut self, line: &str) -> bool {
        let report = line
            .strip_prefix('<')
            .and_then(|text| text.strip_suffix('>'));
        let Some(report) = report else {
            return false;
        };
        let mut fields = report.split('|');
        self.state = fields.next().unwrap_or_default().into();
        (self.machine, self.work) = (None, None);
        for field in fields {
            let (name, value) = field.split_once(':').unwrap_or((field, ""));
            match name {
                "MPos" => self.machine = numbers(value),
                "WPos" => self.work = numbers(value),
                "WCO" => self.offset = numbers(value),
                "FS" | "F" => self.speeds = value.into(),
                "Ov" => {
                    let values = value.split(',').map(|text| text.parse().unwrap_or(100));
                    for (at, value) in self.overrides.iter_mut().zip(values) {
                        *at = value;
                    }
                }
                _ => {}
            }
        }
        true
    }

    /// The machine position, in the unit of the reports, once it can be told.
    pub(crate) fn machine_position(&self) -> Option<Vec<f64>> {
        self.machine.clone().or_else(|| self.add_offset(1.0))
    }

    /// The work position, once it can be told.
    pub(crate) fn work_position(&self) -> Option<Vec<f64>> {
        self.work.clone().or_else(|| self.add_offset(-1.0))
    }

    fn add_offset(&self, sign: f64) -> Option<Vec<f64>> {
        let from = self.machine.as_ref().or(self.work.as_ref())?;
        let offset = self.offset.as_ref()?;
        let sum = from
            .iter()
            .zip(offset)
            .map(|(value, offset)| value + sign * offset);
        Some(sum.collect())
    }

    /// Whether the machine waits in a hold or with the door open, at rest.
    pub(crate) fn is_held(&self) -> bool {
        matches!(
            self.state.as_str(),
            "Hold:0" | "Hold" | "Door:0" | "Door:1" | "Door" | "Tool"
        )
    }

    /// Whether nothing moves.
    pub(crate) fn is_at_rest(&self) -> bool {
        self.is_held() || matches!(self.state.as_str(), "Idle" | "Alarm" | "Check" | "Sleep")
    }
}

/// Reads numbers between commas.
pub(crate) fn numbers(text: &str) -> Option<Vec<f64>> {
    text.split(',')
        .map(|text| text.trim().parse().ok())
        .collect()
}

#[cfg(test)]
mod tests {
    use super::*;

    #[test]
    fn both_positions_are_known_whichever_the_reports_have() {
        for (first, second) in [
            (
                "<Idle|MPos:5.000,1.000,0.000|FS:0,0|WCO:2.000,0.000,0.000>",
                "<Run|MPos:6.000,1.000,0.000|FS:500,0>",
            ),
            (
                "<Idle|WPos:3.000,1.000,0.000|FS:0,0|WCO:2.000,0.000,0.000>",
                "<Run|WPos:4.000,1.000,0.000|FS:500,0>",
            ),
        ] {
            let mut status = Status::default();
            assert!(status.read(first) && status.read(second));
            assert_eq!(status.machine_position().unwrap(), [6.0, 1.0, 0.0]);
            assert_eq!(status.work_position().unwrap(), [4.0, 1.0, 0.0]);
            assert_eq!(
                (status.state.as_str(), status.speeds.as_str()),
                ("Run", "500,0")
            );
        }
    }

    #[test]
    fn only_a_report_is_taken() {
        let mut status = Status::default();
        assert!(!status.read("ok") && !status.read("<Idle|MPos:1"));
        assert_eq!(status, Status::default());
        assert!(status.read("<Hold:0|WPos:0.000,0.000,0.000|FS:0,0|Ov:110,25,100>"));
        assert_eq!(status.machine_position(), None);
        assert_eq!(status.overrides, [110, 25, 100]);
    }

    #[test]
    fn a_hold_that_still_brakes_is_not_at_rest() {
        for (state, is_held, is_at_rest) in [
            ("Hold:1", false, false),
            ("Hold:0", true, true),
            ("Door:2", false, false),
            ("Idle", false, true),
            ("Run", false, false),
        ] {
            let status = Status {
                state: state.into(),
                ..Status::default()
            };
            assert_eq!(
                (status.is_held(), status.is_at_rest()),
                (is_held, is_at_rest),
                "{state}"
            );
        }
    }
}
