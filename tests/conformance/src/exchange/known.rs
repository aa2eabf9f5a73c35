//! What a recording tells about Grbl's state at one of its steps.

use leadscrew::{axis::AXES, settings::Settings};

use super::Exchange;

impl Exchange {
    /// Steps per mm at a step: as they were set before it.
    pub(super) fn scale_at(&self, step: usize) -> [f64; AXES] {
        let mut scale = self.scale();
        for step in self.session.steps().take(step) {
            let line = step.line.as_deref().unwrap_or_default();
            if !step.recv.iter().any(|text| text == "ok") {
                continue;
            }
            if line == "$RST=$" || line == "$RST=*" {
                let default = Settings::default().steps_per_mm;
                scale = default.0.map(|scale| scale.millionths() as f64 * 1e-6);
            }
            for (axis, known) in scale.iter_mut().enumerate() {
                let value = line.strip_prefix(&format!("${}=", 100 + axis));
                if let Some(value) = value.and_then(|value| value.parse::<f64>().ok())
                    && value > 0.0
                {
                    *known = value;
                }
            }
        }
        scale
    }

    /// Whether an override of the spindle was sent shortly before a time, which Grbl obeys when the
    /// segments that it has prepared are over.
    pub(super) fn has_spindle_override(&self, time_s: f64) -> bool {
        self.session.steps().any(|step| {
            let since_s = step.t.map_or(f64::INFINITY, |sent_s| time_s - sent_s);
            let is_recent = (-0.01..0.15).contains(&since_s);
            is_recent && step.sends().iter().any(|byte| matches!(byte, 0x99..=0x9d))
        })
    }

    /// Whether a number has more digits than Grbl reads; it takes the others for zeros.
    pub(super) fn has_long_number(&self) -> bool {
        /// The digits that Grbl reads.
        const DIGITS: usize = 8;
        let lines = self.session.steps().filter_map(|step| step.line.as_deref());
        let mut numbers =
            lines.flat_map(|line| line.split(|c: char| !(c.is_ascii_digit() || c == '.')));
        numbers.any(|number| {
            let whole = number.split('.').next().unwrap_or_default();
            whole.len() > DIGITS
        })
    }

    /// The largest step of an axis, mm.
    pub(super) fn step_mm(&self) -> f64 {
        let scale = self.scale().into_iter();
        scale.fold(0.0_f64, |most, scale| most.max(1.0 / scale))
    }

    /// Whether homing had failed before the end of a step, and not succeeded since.
    pub(super) fn has_failed_homing(&self, step: usize) -> bool {
        let mut has_failed = false;
        for step in self.session.steps().take(step.saturating_add(1)) {
            for text in &step.recv {
                match text.as_str() {
                    "ALARM:6" | "ALARM:7" | "ALARM:8" | "ALARM:9" => has_failed = true,
                    _ => {}
                }
            }
            let homes = step
                .line
                .as_deref()
                .is_some_and(|line| line.starts_with("$H"));
            let alarmed = step.recv.iter().any(|text| text.starts_with("ALARM:"));
            if homes && !alarmed && step.recv.last().is_some_and(|text| text == "ok") {
                has_failed = false;
            }
        }
        has_failed
    }

    pub(super) fn is_laser(&self) -> bool {
        self.session.settings().is_ok_and(|settings| settings.laser)
    }
}
