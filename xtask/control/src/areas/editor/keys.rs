//! What the operator does in the field: keys, pasted texts, and when a change counts.

use gloo_timers::callback::Timeout;
use wasm_bindgen::JsCast as _;
use web_sys::{ClipboardEvent, HtmlInputElement};
use yew::{Event, KeyboardEvent};

use super::{
    surface::{MOST_WHOLE_LINES, Surface, is_at_end},
    text::{Place, split_at},
};

/// How long no key comes before a change counts, ms.
const CHANGE_MS: u32 = 300;
/// Pasted texts from this length on do not go through the field, bytes.
const LONG_PASTE: usize = 50_000;

impl Surface {
    /// Takes what the field has now.
    pub(super) fn take_input(&self) {
        let Some(field) = self.field() else {
            return;
        };
        let value = field.value();
        let mut editing = self.editing.borrow_mut();
        let (window, before) = (editing.window.clone(), editing.text.lines().len());
        editing.text.replace(window.start, window.len(), &value);
        let after = editing.text.lines().len();
        editing.window = window.start..window.end + after - before;
        let is_grown = after > MOST_WHOLE_LINES && editing.window.len() > 2 * MOST_WHOLE_LINES;
        drop(editing);
        self.change();
        if is_grown {
            self.show(self.selection());
        }
    }

    /// The text has changed: it counts when no key comes for a moment.
    fn change(&self) {
        let later = self.clone();
        let mut editing = self.editing.borrow_mut();
        editing.is_changed = true;
        editing.note = "";
        editing.change = Some(Timeout::new(CHANGE_MS, move || later.emit()));
        drop(editing);
        self.refresh.force_update();
    }

    /// Hands a changed text over.
    pub(super) fn emit(&self) {
        let mut editing = self.editing.borrow_mut();
        editing.change = None;
        if std::mem::take(&mut editing.is_changed) {
            let text = editing.text.whole();
            drop(editing);
            self.on_change.emit(text);
        }
    }

    /// A long text that is pasted does not go through the field.
    pub(super) fn paste(&self, event: &Event) {
        let event: &ClipboardEvent = event.unchecked_ref();
        let text = event
            .clipboard_data()
            .and_then(|it| it.get_data("text").ok());
        let Some(text) = text.filter(|text| text.len() >= LONG_PASTE && !self.is_locked) else {
            return;
        };
        event.prevent_default();
        let [start, end] = self.selection();
        let mut editing = self.editing.borrow_mut();
        let lines = editing.text.lines();
        let (before, after) = (
            split_at(&lines[start.line], start.column).0,
            split_at(&lines[end.line], end.column).1,
        );
        let whole = [before, &text, after].concat();
        editing
            .text
            .replace(start.line, end.line + 1 - start.line, &whole);
        drop(editing);
        self.change();
        self.show([start; 2]);
    }

    /// Takes the last edit back, or makes it again.
    fn undo(&self, is_redo: bool) {
        if self.is_locked {
            return;
        }
        let place = {
            let text = &mut self.editing.borrow_mut().text;
            if is_redo { text.redo() } else { text.undo() }
        };
        if let Some(place) = place {
            self.change();
            self.show([place; 2]);
        }
    }

    /// A key goes down in the text.
    pub(super) fn key_down(&self, event: &KeyboardEvent) {
        let is_command = (event.ctrl_key() || event.meta_key()) && !event.alt_key();
        let key = event.key();
        match (is_command, key.to_ascii_lowercase().as_str()) {
            (_, "shift" | "control" | "alt" | "meta" | "tab") => return,
            (true, "z") => self.undo(event.shift_key()),
            (true, "y") => self.undo(true),
            (true, "f") => focus_find(),
            (true, "a") if !self.is_whole() => {
                self.editing.borrow_mut().note =
                    " So many lines are not selected at once: save them, or open others.";
                self.refresh.force_update();
            }
            (true, "home") if !self.is_whole() => self.move_by(isize::MIN),
            (true, "end") if !self.is_whole() => self.move_by(isize::MAX),
            (false, "pageup") if !event.shift_key() => {
                self.move_by(1 - self.seen().len().cast_signed());
            }
            (false, "pagedown") if !event.shift_key() => {
                self.move_by(self.seen().len().cast_signed() - 1);
            }
            _ => {
                self.come_back();
                return;
            }
        }
        event.prevent_default();
    }

    /// A key acts where the caret is: the field gets the lines around it.
    fn come_back(&self) {
        let selection = self.selection();
        let caret = selection[1].line..selection[1].line + 1;
        let is_near = {
            let editing = self.editing.borrow();
            is_at_end(&caret, &editing.window, editing.text.lines().len())
        };
        if self.editing.borrow().kept.is_some() {
            self.show(selection);
        } else if is_near {
            self.fill(&caret, Some(selection));
        }
    }

    /// Moves the caret by some lines.
    fn move_by(&self, lines: isize) {
        let place = self.selection()[1];
        let last = self.editing.borrow().text.lines().len() - 1;
        let line = place.line.saturating_add_signed(lines).min(last);
        self.show([Place { line, ..place }; 2]);
    }
}

/// Gives the field of the search the focus.
fn focus_find() {
    let document = web_sys::window().and_then(|window| window.document());
    let find = document.and_then(|it| it.get_element_by_id("find"));
    if let Some(find) = find.and_then(|it| it.dyn_into::<HtmlInputElement>().ok()) {
        // A field can have the focus.
        let _ = find.focus();
        find.select();
    }
}
