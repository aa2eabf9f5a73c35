//! Which status report belongs to which `?`.

use super::{
    Exchange, Played,
    reader::{BYTE_S, SAME_S, displacement},
    received::ReceivedLine,
    status::Report,
};

/// One `?`, our report and Grbl's.
#[derive(Debug)]
pub(super) struct Paired {
    /// The step that sent the `?`.
    pub(super) step: usize,
    /// When our report was sent, in our time; untimed recordings: when the step began.
    pub(super) own_s: f64,
    pub(super) ours: Option<ReceivedLine>,
    /// What Grbl sent at once.
    pub(super) theirs: Option<ReceivedLine>,
    /// What Grbl sent much later.
    pub(super) late: Option<ReceivedLine>,
    /// Both stand, in the same place.
    pub(super) stand_in_same_place: bool,
    /// The next `?` comes so soon that one report may be for both.
    pub(super) is_followed: bool,
}

/// Time between two `?` that may get one report, s.
const SOON_S: f64 = 0.02;

/// Finds out which reports belong to which `?`.
pub(super) fn pair(
    exchange: &Exchange,
    played: &Played,
    ours: &[ReceivedLine],
    theirs: &[ReceivedLine],
) -> Vec<Paired> {
    let mut asked: Vec<Paired> = Vec::new();
    for (index, step) in exchange.session.steps().enumerate() {
        let questions = step.sends().into_iter().filter(|byte| *byte == b'?');
        asked.extend(questions.map(|_| Paired {
            step: index,
            own_s: played.began_s[index],
            ours: None,
            theirs: None,
            late: None,
            stand_in_same_place: false,
            is_followed: false,
        }));
    }
    for index in 1..asked.len() {
        let wait_s = asked[index].own_s - asked[index - 1].own_s;
        asked[index - 1].is_followed = wait_s < SOON_S;
    }
    let time_of = |step: usize| exchange.session.steps().nth(step).and_then(|step| step.t);
    for received in ours {
        // Each `?` has its own report, in order.
        let first = asked
            .iter_mut()
            .find(|asked| asked.ours.is_none() && asked.step <= received.step);
        if let Some(asked) = first {
            asked.ours = Some(received.clone());
        }
    }
    let mut from = 0;
    for (number, received) in theirs.iter().enumerate() {
        // Grbl answers all `?` so far at once: the latest gets it, and each report its own.
        let latest = (from..asked.len())
            .rev()
            .find(|index| asked[*index].step <= received.step);
        let Some(latest) = latest else {
            continue;
        };
        let more = theirs[number + 1..]
            .iter()
            .filter(|next| next.step == received.step && asked[latest].step == received.step);
        let last = latest.saturating_sub(more.count()).max(from);
        let asked = &mut asked[last];
        let delay = received
            .time_s
            .zip(time_of(asked.step))
            .map(|(time_s, asked_s)| time_s - asked_s);
        let is_prompt = delay.map_or(received.step == asked.step, |delay| {
            delay <= SAME_S + received.text.len() as f64 * BYTE_S
        });
        if is_prompt {
            asked.theirs = Some(received.clone());
        } else {
            asked.late = Some(received.clone());
        }
        from = last + 1;
    }
    for asked in &mut asked {
        if let Some(time_s) = asked.ours.as_ref().and_then(|received| received.time_s) {
            asked.own_s = played.own_time_s(asked.step, time_s);
        }
        asked.stand_in_same_place = asked.stands_with(played);
    }
    asked
}

impl Paired {
    /// Both reports, read.
    fn read(&self) -> Option<(Report, Report)> {
        let ours = self.ours.as_ref()?.text.parse().ok()?;
        let theirs = self.theirs.as_ref().or(self.late.as_ref())?;
        Some((ours, theirs.text.parse().ok()?))
    }

    fn stands_with(&self, played: &Played) -> bool {
        let Some((ours, theirs)) = self.read() else {
            return false;
        };
        let samples = played.track.between(self.own_s - SAME_S, self.own_s);
        let stands_still = samples
            .windows(2)
            .all(|pair| pair[0].steps == pair[1].steps);
        stands_still
            && theirs.feed_mm_min() == 0.0
            && displacement(&ours, &theirs)
                .is_some_and(|by| by.iter().all(|part| part.abs() <= ours.rounding_mm() * 2.0))
    }
}
