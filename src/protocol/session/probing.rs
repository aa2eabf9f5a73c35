//! What is remembered of probing moves.

use crate::{
    axis::Axes,
    model::{Probed, Probing},
    protocol::{report, text::Text},
    settings::Settings,
    units::Nm,
};

/// The last probing move.
#[derive(Debug, Default)]
pub(super) struct ProbeRecord {
    /// What was reported last.
    pub(super) reported: Probed,
    /// Where the move in execution began.
    pub(super) start: Axes<Nm>,
    /// Whether the move in execution has ended.
    pub(super) has_ended: bool,
}

impl ProbeRecord {
    /// Reports the end of a probing move: whether the probe changed, and where. A miss that is an alarm leaves the position
    /// of the last contact, as in Grbl.
    pub(super) fn report(
        &mut self,
        probed: Probed,
        probing: Option<Probing>,
        text: &mut Text,
        settings: &Settings,
    ) {
        let is_alarmed = matches!(
            probing,
            Some(Probing::Probe {
                may_miss: false,
                ..
            })
        );
        self.reported.success = probed.success;
        if probed.success || !is_alarmed {
            self.reported.steps = probed.steps;
        }
        report::probed(text, &self.reported, settings);
    }
}
