//! Lines of both sides with their times, and a line to type.

use web_sys::HtmlInputElement;
use yew::prelude::*;

use crate::{
    context::use_page_context,
    model::{Action, LineSource, LogEntry},
    storage,
};

/// The lines that are shown; the others are kept.
const SHOWN: usize = 200;
/// The typed lines that are kept.
const MOST_TYPED: usize = 100;

/// What was typed before, and where in it the operator is.
#[derive(Debug, Clone, Default, PartialEq, Eq)]
struct History {
    lines: Vec<String>,
    at: usize,
}

impl History {
    /// Keeps a line; the same twice is kept once.
    fn keep(&mut self, line: &str) {
        if self.lines.last().is_none_or(|last| last != line) {
            self.lines.push(line.into());
        }
        let surplus = self.lines.len().saturating_sub(MOST_TYPED);
        self.lines.drain(..surplus);
        self.at = self.lines.len();
    }

    /// The line before.
    fn back(&mut self) -> Option<String> {
        self.at = self.at.checked_sub(1)?;
        self.lines.get(self.at).cloned()
    }

    /// The line after, and nothing after the last.
    fn forth(&mut self) -> String {
        self.at = (self.at + 1).min(self.lines.len());
        self.lines.get(self.at).cloned().unwrap_or_default()
    }
}

/// Time of day: `12:03:04.125`.
fn time(ms: u32) -> String {
    let (seconds, minutes) = (ms / 1000, ms / 60_000);
    let (hours, minutes, seconds) = (minutes / 60, minutes % 60, seconds % 60);
    format!("{hours:02}:{minutes:02}:{seconds:02}.{:03}", ms % 1000)
}

/// The name of the file with all lines.
const FILE: &str = "console.txt";

fn mark(source: LineSource) -> &'static str {
    match source {
        LineSource::Operator => "→",
        LineSource::Machine => "←",
        LineSource::Note => "•",
    }
}

/// The lines as a text, the oldest first.
fn as_text<'a>(log: impl IntoIterator<Item = &'a LogEntry>) -> String {
    let lines = log.into_iter().map(|entry| {
        let LogEntry {
            time_ms,
            source,
            text,
            ..
        } = entry;
        format!("{} {} {text}\n", time(*time_ms), mark(*source))
    });
    lines.collect()
}

/// A line of the console.
fn row(entry: &LogEntry) -> Html {
    let class = match entry.source {
        LineSource::Operator => "sent",
        LineSource::Machine => "received",
        LineSource::Note => "note",
    };
    html! {
        <li key={entry.number} {class}><time>{ time(entry.time_ms) }</time><i aria-hidden="true">{ mark(entry.source) }</i>
            <code>{ &entry.text }</code></li>
    }
}

/// The console.
#[component]
pub fn ConsoleArea() -> Html {
    let context = use_page_context();
    let text = use_state(String::new);
    let history = use_mut_ref(History::default);
    let model = &*context.model;
    let shown = model.log.len().saturating_sub(SHOWN);
    // The newest is first, where it is seen without scrolling.
    let rows = model.log.iter().skip(shown).rev().map(row);
    let submit = {
        let (context, text, history) = (context.clone(), text.clone(), history.clone());
        Callback::from(move |event: SubmitEvent| {
            event.prevent_default();
            let line = text.trim().to_owned();
            if !line.is_empty() {
                history.borrow_mut().keep(&line);
                context.line(&line);
                text.set(String::new());
            }
        })
    };
    let typed = {
        let text = text.clone();
        Callback::from(move |event: InputEvent| {
            text.set(event.target_unchecked_into::<HtmlInputElement>().value());
        })
    };
    let recalled = {
        let text = text.clone();
        Callback::from(move |event: KeyboardEvent| {
            let line = match event.key().as_str() {
                "ArrowUp" => history.borrow_mut().back(),
                "ArrowDown" => Some(history.borrow_mut().forth()),
                _ => return,
            };
            event.prevent_default();
            if let Some(line) = line {
                text.set(line);
            }
        })
    };
    let show = {
        let model = context.model.dispatcher();
        Callback::from(move |event: Event| {
            let input = event.target_unchecked_into::<HtmlInputElement>();
            model.dispatch(Action::ShowReports(input.checked()));
        })
    };
    let clear = {
        let model = context.model.dispatcher();
        Callback::from(move |_: MouseEvent| model.dispatch(Action::Clear))
    };
    let help = {
        let context = context.clone();
        // A machine lists its own lines.
        Callback::from(move |_: MouseEvent| context.line("$"))
    };
    let save = {
        let context = context.clone();
        Callback::from(move |_: MouseEvent| storage::save_file(FILE, &as_text(&context.model.log)))
    };
    let may_type = model.may_operate();
    html! {
        <section class="console" aria-label="Console">
            <h2>{ "Console" }</h2>
            <form onsubmit={submit}>
                <label>{ "Line " }<input id="line" autocomplete="off" spellcheck="false" value={(*text).clone()}
                    oninput={typed} onkeydown={recalled} disabled={!may_type} /></label>
                <button disabled={!may_type}>{ "Send" }</button>
                <button type="button" disabled={!may_type} onclick={help}>{ "Help" }</button>
                <label><input type="checkbox" checked={model.shows_reports} onchange={show} />{ " status reports" }</label>
                <button type="button" onclick={clear}>{ "Clear" }</button>
                <button type="button" disabled={model.log.is_empty()} onclick={save}>{ "Save as file" }</button>
            </form>
            <ol id="log" tabindex="0" aria-label="Lines, the newest first">{ for rows }</ol>
        </section>
    }
}

#[cfg(test)]
mod tests {
    use super::*;

    #[test]
    fn typed_lines_come_back() {
        let mut history = History::default();
        assert_eq!(history.back(), None);
        for line in ["$$", "G0X1", "G0X1"] {
            history.keep(line);
        }
        assert_eq!(history.back().unwrap(), "G0X1");
        assert_eq!(history.back().unwrap(), "$$");
        assert_eq!(history.back(), None);
        assert_eq!(history.forth(), "G0X1");
        assert_eq!(history.forth(), "");
        for number in 0..2 * MOST_TYPED {
            history.keep(&number.to_string());
        }
        assert_eq!(history.lines.len(), MOST_TYPED);
        assert_eq!(history.back().unwrap(), "199");
    }

    #[test]
    fn a_saved_console_has_times_and_directions() {
        let entry = |source, text: &str| LogEntry {
            number: 1,
            time_ms: 3_723_004,
            source,
            text: text.into(),
        };
        let log = [
            entry(LineSource::Operator, "$X"),
            entry(LineSource::Machine, "ok"),
        ];
        assert_eq!(as_text(&log), "01:02:03.004 → $X\n01:02:03.004 ← ok\n");
    }

    #[test]
    fn times_are_of_the_day() {
        assert_eq!(time(0), "00:00:00.000");
        assert_eq!(time(86_399_999), "23:59:59.999");
    }
}
