//! The field with the lines around what is seen, and what the operator does there.

use std::{cell::RefCell, ops::Range, rc::Rc};

use gloo_events::EventListener;
use gloo_timers::callback::Timeout;
use wasm_bindgen::JsCast as _;
use web_sys::{HtmlElement, HtmlTextAreaElement};
use yew::{Callback, NodeRef, functional::UseForceUpdateHandle};

use super::{
    drawn::DrawnLine,
    text::{Place, Text, offset_of, place_at, width_utf16},
};

/// The height of a line, as in the style.
const LINE_PX: i32 = 18;
/// A text of so many lines is in the field as a whole; of a longer one are so many, before and behind what is seen.
pub(super) const MOST_WHOLE_LINES: usize = 1500;
const LINES_AROUND_VIEW: usize = 250;
/// The lines that are drawn before and behind what is seen, so that scrolling never shows a gap.
const OVERSCAN_LINES: usize = 40;
/// With fewer lines before or behind, there are to be others.
const NEAR: usize = 20;
/// How long nothing scrolls before the field is filled anew, ms.
const SETTLE_MS: u32 = 100;

/// What is searched.
#[derive(Default)]
pub(super) struct Search {
    pub(super) wanted: String,
    /// Of the text in which it was searched.
    pub(super) revision: u32,
    pub(super) places: Vec<Place>,
    pub(super) at: Option<usize>,
}

/// A text that is edited.
pub(super) struct Editing {
    pub(super) text: Text,
    /// The lines that are in the field.
    pub(super) window: Range<usize>,
    /// The selection, where its lines are not in the field.
    pub(super) kept: Option<[Place; 2]>,
    pub(super) is_changed: bool,
    pub(super) change: Option<Timeout>,
    pub(super) settling: Option<Timeout>,
    /// The pointer selects.
    pub(super) is_pressed: bool,
    /// Where the page itself has scrolled to.
    pub(super) own_top: i32,
    /// The line in execution is kept in sight.
    pub(super) is_following: bool,
    /// The lines that are drawn.
    pub(super) drawn: Range<usize>,
    pub(super) search: Search,
    pub(super) note: &'static str,
}

impl Default for Editing {
    fn default() -> Self {
        Self {
            text: Text::new(""),
            window: 0..1,
            kept: None,
            is_changed: false,
            change: None,
            settling: None,
            is_pressed: false,
            own_top: 0,
            is_following: true,
            drawn: 0..1,
            search: Search::default(),
            note: "",
        }
    }
}

/// The lines that are to be in the field, of so many, around some of them.
fn window_around(lines: usize, seen: &Range<usize>) -> Range<usize> {
    if lines <= MOST_WHOLE_LINES {
        0..lines
    } else {
        let end = (seen.end + LINES_AROUND_VIEW).min(lines);
        seen.start.saturating_sub(LINES_AROUND_VIEW).min(end - 1)..end
    }
}

/// Whether some lines are near the end of those that are there, and there are more.
pub(super) fn is_at_end(lines: &Range<usize>, there: &Range<usize>, count: usize) -> bool {
    (there.start > 0 && lines.start < there.start + NEAR)
        || (there.end < count && lines.end + NEAR > there.end)
}

/// The editor's way to its elements.
#[derive(Clone)]
pub(super) struct Surface {
    pub(super) refresh: UseForceUpdateHandle,
    pub(super) scroller: NodeRef,
    pub(super) field: NodeRef,
    pub(super) sheet: NodeRef,
    pub(super) editing: Rc<RefCell<Editing>>,
    pub(super) executed: Option<usize>,
    pub(super) is_locked: bool,
    pub(super) on_change: Callback<String>,
}

impl PartialEq for Surface {
    fn eq(&self, other: &Self) -> bool {
        Rc::ptr_eq(&self.editing, &other.editing) && self.is_locked == other.is_locked
    }
}

impl Surface {
    pub(super) fn field(&self) -> Option<HtmlTextAreaElement> {
        self.field.cast()
    }

    /// The lines that are seen.
    pub(super) fn seen(&self) -> Range<usize> {
        let scroller = self.scroller.cast::<HtmlElement>();
        let (top, height) = scroller.map_or((0, 0), |it| (it.scroll_top(), it.client_height()));
        let line = |px: i32| usize::try_from(px.div_euclid(LINE_PX)).unwrap_or_default();
        let lines = self.editing.borrow().text.lines().len();
        line(top).min(lines)..(line(top + height) + 1).min(lines)
    }

    /// Shows a text, unless it is the one that is edited.
    pub(super) fn load(&self, text: &str) {
        if !self.editing.borrow().text.is(text) {
            let mut editing = self.editing.borrow_mut();
            let (text, wanted) = (Text::new(text), std::mem::take(&mut editing.search.wanted));
            let search = Search {
                places: text.find(&wanted),
                wanted,
                ..Search::default()
            };
            *editing = Editing {
                text,
                search,
                ..Editing::default()
            };
            drop(editing);
            self.scroll_to(0);
            self.fill(&(0..0), None);
        }
    }

    /// The lines that are to be drawn now.
    pub(super) fn drawn_lines(&self) -> Vec<DrawnLine> {
        let seen = self.seen();
        let mut editing = self.editing.borrow_mut();
        let end = (seen.end + OVERSCAN_LINES).min(editing.text.lines().len());
        editing.drawn = seen.start.saturating_sub(OVERSCAN_LINES)..end;
        let lines = editing.text.lines()[editing.drawn.clone()].iter();
        let lines = (editing.drawn.start + 1..).zip(lines);
        lines.map(|(number, text)| (number, text.clone())).collect()
    }

    /// Puts what was drawn where it belongs.
    pub(super) fn place(&self) {
        let editing = self.editing.borrow();
        let Some(sheet) = self.sheet.cast::<HtmlElement>() else {
            return;
        };
        let set = |element: &HtmlElement, name: &str, value: String| {
            // A length can always be set.
            let _ = element.style().set_property(name, &value);
        };
        let px = |lines: usize| format!("{}px", lines * LINE_PX as usize);
        set(&sheet, "height", px(editing.text.lines().len()));
        for name in [".gutter ol", ".code pre"] {
            let element = sheet.query_selector(name).ok().flatten();
            if let Some(element) = element.and_then(|it| it.dyn_into().ok()) {
                set(&element, "top", px(editing.drawn.start));
            }
        }
        if let Some(code) = sheet.query_selector(".code").ok().flatten() {
            let width = format!("{}ch", editing.text.longest() + 2);
            set(code.unchecked_ref(), "min-width", width);
        }
        if let Some(field) = self.field() {
            set(&field, "top", px(editing.window.start));
            set(&field, "height", px(editing.window.len()));
        }
    }

    /// The selection: where it begins, and where it ends.
    pub(super) fn selection(&self) -> [Place; 2] {
        let editing = self.editing.borrow();
        if let Some(kept) = editing.kept {
            return kept;
        }
        let lines = &editing.text.lines()[editing.window.clone()];
        let field = self.field();
        let offset = |offset: Option<u32>| {
            let place = place_at(lines, offset.unwrap_or_default() as usize);
            Place {
                line: place.line + editing.window.start,
                ..place
            }
        };
        let start = field.as_ref().and_then(|it| it.selection_start().ok()?);
        let end = field.and_then(|it| it.selection_end().ok()?);
        [offset(start), offset(end)]
    }

    /// Fills the field with the lines around some that are seen. A selection beyond them is kept until a key comes.
    pub(super) fn fill(&self, seen: &Range<usize>, selection: Option<[Place; 2]>) {
        let mut editing = self.editing.borrow_mut();
        let window = window_around(editing.text.lines().len(), seen);
        let lines = &editing.text.lines()[window.clone()];
        let is_there = |place: &Place| window.contains(&place.line);
        if let Some(field) = self.field() {
            field.set_value(&lines.join("\n"));
            let offset = |place: Place| {
                let line = place.line.saturating_sub(window.start);
                u32::try_from(offset_of(lines, Place { line, ..place })).unwrap_or_default()
            };
            let shown = selection.filter(|places| places.iter().all(is_there));
            let [start, end] = shown.map_or([0, 0], |places| places.map(offset));
            // A field of text has a selection.
            let _ = field.set_selection_range(start, end);
        }
        editing.kept = selection.filter(|places| !places.iter().all(is_there));
        editing.window = window;
        drop(editing);
        self.refresh.force_update();
    }

    /// Whether the field has all lines.
    pub(super) fn is_whole(&self) -> bool {
        let editing = self.editing.borrow();
        editing.window == (0..editing.text.lines().len())
    }

    /// Fills the field anew where what is seen has come to its end.
    fn settle(&self) {
        let seen = self.seen();
        let is_far = {
            let editing = self.editing.borrow();
            is_at_end(&seen, &editing.window, editing.text.lines().len())
        };
        if is_far && !self.editing.borrow().is_pressed {
            self.fill(&seen, Some(self.selection()));
        }
    }

    fn scroll_to(&self, top: i32) {
        if let Some(scroller) = self.scroller.cast::<HtmlElement>() {
            scroller.set_scroll_top(top);
            self.editing.borrow_mut().own_top = scroller.scroll_top();
        }
    }

    /// Scrolls a line into sight, unless it is.
    pub(super) fn bring(&self, line: usize) {
        let seen = self.seen();
        if !(seen.start + 1..seen.end.saturating_sub(2)).contains(&line) {
            let before = seen.len() / 3;
            // The height is that of the text as it is now.
            self.place();
            let top = i32::try_from(line.saturating_sub(before)).unwrap_or(i32::MAX);
            self.scroll_to(top.saturating_mul(LINE_PX));
        }
    }

    /// Selects a part of the text, and shows it.
    pub(super) fn show(&self, selection: [Place; 2]) {
        self.bring(selection[0].line);
        self.fill(&self.seen(), Some(selection));
    }

    /// Shows a line, from 1.
    pub(super) fn go_to_line(&self, number: usize) {
        let last = self.editing.borrow().text.lines().len() - 1;
        let line = number.saturating_sub(1).min(last);
        let column = width_utf16(&self.editing.borrow().text.lines()[line]);
        self.show([Place { line, column: 0 }, Place { line, column }]);
        self.focus();
    }

    /// Gives the text the focus.
    pub(super) fn focus(&self) {
        if let Some(field) = self.field() {
            let options = web_sys::FocusOptions::new();
            options.set_prevent_scroll(true);
            // A field can have it.
            let _ = field.focus_with_options(&options);
        }
    }

    /// Keeps the line in execution in sight, unless the operator has scrolled away from it.
    pub(super) fn follow(&self, executed: Option<usize>) {
        let Some(line) = executed else {
            self.editing.borrow_mut().is_following = true;
            return;
        };
        if self.editing.borrow().is_following {
            self.bring(line - 1);
            self.refresh.force_update();
        }
    }

    /// What is seen has changed.
    pub(super) fn take_scroll(&self) {
        let seen = self.seen();
        let top = { self.scroller.cast::<HtmlElement>() }.map_or(0, |it| it.scroll_top());
        let mut editing = self.editing.borrow_mut();
        if (top - editing.own_top).abs() > 1 {
            editing.own_top = -1;
            editing.is_following = self.executed.is_none_or(|line| seen.contains(&(line - 1)));
        }
        let later = self.clone();
        editing.settling = Some(Timeout::new(SETTLE_MS, move || later.settle()));
        let is_far = is_at_end(&seen, &editing.drawn, editing.text.lines().len());
        drop(editing);
        if is_far {
            self.refresh.force_update();
        }
    }

    /// The pointer begins a selection.
    pub(super) fn press(&self) {
        self.editing.borrow_mut().is_pressed = true;
        self.editing.borrow_mut().kept = None;
    }

    /// Wherever the pointer is released, the selection has ended.
    pub(super) fn release_listeners(&self) -> Vec<EventListener> {
        let Some(window) = web_sys::window() else {
            return Vec::new();
        };
        let listeners = ["pointerup", "pointercancel"].map(|event| {
            let surface = self.clone();
            EventListener::new(&window, event, move |_| {
                let was_pressed = std::mem::take(&mut surface.editing.borrow_mut().is_pressed);
                if was_pressed {
                    surface.settle();
                }
            })
        });
        listeners.into()
    }

    /// What the operator is to read.
    pub(super) fn note(&self) -> &'static str {
        self.editing.borrow().note
    }
}

#[cfg(test)]
mod tests {
    use super::*;

    #[test]
    fn the_field_has_the_whole_of_a_short_text_and_what_is_seen_of_a_long_one() {
        assert_eq!(window_around(1, &(0..1)), 0..1);
        assert_eq!(
            window_around(MOST_WHOLE_LINES, &(5..9)),
            0..MOST_WHOLE_LINES
        );
        assert_eq!(window_around(200_000, &(0..20)), 0..20 + LINES_AROUND_VIEW);
        assert_eq!(
            window_around(200_000, &(1000..1020)),
            1000 - LINES_AROUND_VIEW..1020 + LINES_AROUND_VIEW
        );
        assert_eq!(
            window_around(200_000, &(199_990..200_000)),
            199_990 - LINES_AROUND_VIEW..200_000
        );
        // What was seen of a longer text.
        assert_eq!(window_around(2000, &(5000..5020)), 1999..2000);
    }
}
