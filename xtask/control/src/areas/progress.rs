//! How far the job is by the times of its check: the line that is carried out, what is left, when it ends.

use common::text::duration;
use gloo_timers::callback::Interval;
use simulation::progress::Progress;
use yew::prelude::*;

use crate::{app::time_ms, context::use_page_context, model::Action, worker::TimeFactor};

/// How often the clock goes on, ms.
const TICK_MS: u32 = 250;
/// A day, ms.
const DAY_MS: u32 = 24 * 3600 * 1000;

/// How far the job is, in words, at a time of day in ms.
fn words(
    progress: &Progress,
    lines: usize,
    TimeFactor(time_factor): TimeFactor,
    now_ms: u32,
) -> String {
    let line = (progress.line + 1).min(lines);
    // Whole seconds, also below a minute.
    let left = match progress.left_s.round() {
        seconds if seconds < 60.0 => format!("{seconds} s"),
        seconds => duration(seconds),
    };
    let left_ms = progress.left_s * 1000.0 / f64::from(time_factor);
    let end_ms = (f64::from(now_ms) + left_ms) as u64 % u64::from(DAY_MS);
    let (hours, minutes) = (end_ms / 3_600_000, end_ms / 60_000 % 60);
    let about = if progress.is_estimated { "about " } else { "" };
    format!("line {line} of {lines}, {about}{left} left, ends {about}at {hours:02}:{minutes:02}")
}

/// How far the job is.
#[component]
pub fn JobProgress() -> Html {
    let context = use_page_context();
    let dispatcher = context.model.dispatcher();
    let is_running = context.model.is_job_running();
    use_effect_with(is_running, move |is_running| {
        let timer = is_running.then(|| {
            let mut before_ms = js_sys::Date::now();
            Interval::new(TICK_MS, move || {
                let now_ms = js_sys::Date::now();
                let passed_s = (now_ms - std::mem::replace(&mut before_ms, now_ms)) / 1000.0;
                dispatcher.dispatch(Action::Tick(passed_s.max(0.0)));
            })
        });
        move || drop(timer)
    });
    let lines = context
        .model
        .machine
        .job
        .as_ref()
        .map_or(0, |job| job.lines);
    let progress = context.model.progress().filter(|_| is_running);
    html! {
        if let Some(progress) = progress {
            <p id="left">{ words(progress, lines, context.model.time_factor, time_ms()) }</p>
        }
    }
}

#[cfg(test)]
mod tests {
    use super::*;

    #[test]
    fn the_end_is_a_time_of_day() {
        let progress = |line, left_s, is_estimated| Progress {
            line,
            left_s,
            is_estimated,
        };
        let late_ms = DAY_MS - 60_000;
        for (progress, time_factor, now_ms, expected) in [
            (
                progress(2, 12.4, false),
                1,
                0,
                "line 3 of 6, 12 s left, ends at 00:00",
            ),
            (
                progress(6, 725.0, true),
                1,
                late_ms,
                "line 6 of 6, about 12 min 5 s left, ends about at 00:11",
            ),
            (
                progress(5, 1200.0, false),
                20,
                0,
                "line 6 of 6, 20 min 0 s left, ends at 00:01",
            ),
        ] {
            assert_eq!(
                words(&progress, 6, TimeFactor(time_factor), now_ms),
                expected
            );
        }
    }
}
