//! What drivers ask of pulses: width, low time, direction set-up time, and the spacing of events.

use leadscrew::{
    axis::AXES,
    model::timing::{DIRECTION_SETUP_TICKS, EVENT_SPACING_TICKS, PULSE_LOW_TICKS},
    sim::Edge,
};

/// The pulses up to now.
#[derive(Debug, Clone)]
pub(crate) struct Pulses {
    /// Shortest pulse, ticks.
    pulse_ticks: u64,
    pins: [Pin; AXES],
    before: Option<u64>,
}

impl Pulses {
    pub(crate) fn new(pulse_ticks: u64) -> Self {
        Self {
            pulse_ticks,
            pins: [Pin::default(); AXES],
            before: None,
        }
    }

    /// Panics if the next edge breaks a rule.
    pub(crate) fn check(&mut self, edge: &Edge) {
        if let Some(before) = self.before.replace(edge.ticks) {
            let spacing = edge.ticks - before;
            assert!(
                spacing >= u64::from(EVENT_SPACING_TICKS),
                "spacing {spacing} before {edge:?}"
            );
        }
        for (axis, pin) in self.pins.iter_mut().enumerate() {
            let bit = 1 << axis;
            let is_negative = edge.directions & bit as u8 != 0;
            pin.turn(is_negative, edge);
            if edge.drop & bit != 0 {
                pin.drop(edge, self.pulse_ticks);
            }
            if edge.raise & bit != 0 {
                pin.raise(edge);
            }
        }
    }

    /// Panics if a pulse has no end.
    pub(crate) fn check_end(&self) {
        assert!(
            self.pins.iter().all(|pin| pin.raised.is_none()),
            "a pulse has no end"
        );
    }
}

/// Step and direction of one axis.
#[derive(Debug, Clone, Copy, Default)]
struct Pin {
    raised: Option<u64>,
    dropped: Option<u64>,
    turned: Option<u64>,
    is_negative: bool,
}

impl Pin {
    fn turn(&mut self, is_negative: bool, edge: &Edge) {
        if is_negative != self.is_negative {
            assert!(self.raised.is_none(), "direction in a pulse: {edge:?}");
            self.is_negative = is_negative;
            self.turned = Some(edge.ticks);
        }
    }

    fn drop(&mut self, edge: &Edge, pulse_ticks: u64) {
        let raised = self.raised.take().expect("a pulse ends that is not high");
        let width = edge.ticks - raised;
        assert!(width >= pulse_ticks, "width {width}: {edge:?}");
        self.dropped = Some(edge.ticks);
    }

    fn raise(&mut self, edge: &Edge) {
        assert!(self.raised.is_none(), "a pulse in a pulse: {edge:?}");
        let low = self.dropped.map(|dropped| edge.ticks - dropped);
        assert!(
            low.is_none_or(|low| low >= u64::from(PULSE_LOW_TICKS)),
            "low {low:?}: {edge:?}"
        );
        let set_up = self.turned.map(|turned| edge.ticks - turned);
        assert!(
            set_up.is_none_or(|set_up| set_up >= u64::from(DIRECTION_SETUP_TICKS)),
            "direction set-up {set_up:?}: {edge:?}"
        );
        self.raised = Some(edge.ticks);
    }
}
