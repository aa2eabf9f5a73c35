//! Searching a text, and going to a line.

use web_sys::HtmlInputElement;
use yew::prelude::*;

use super::{
    surface::Surface,
    text::{Place, width_utf16},
};

/// What is to be found where.
#[derive(PartialEq, Properties)]
pub(super) struct FindProperties {
    pub(super) surface: Surface,
    /// How often the text is found.
    pub(super) count: Option<usize>,
    /// Which one is shown, from 0.
    pub(super) at: Option<usize>,
}

/// How often a text is found, in words.
fn count_words(count: Option<usize>, at: Option<usize>) -> String {
    match (count, at) {
        (None, _) => String::new(),
        (Some(0), _) => "not found".into(),
        (Some(count), Some(at)) => format!("{} of {count}", at + 1),
        (Some(count), None) => format!("{count} found"),
    }
}

/// The fields above a text.
#[component]
pub(super) fn FindBar(props: &FindProperties) -> Html {
    let surface = &props.surface;
    let is_found = props.count.is_some_and(|count| count > 0);
    let typed = {
        let surface = surface.clone();
        Callback::from(move |event: InputEvent| {
            surface.find(&event.target_unchecked_into::<HtmlInputElement>().value());
        })
    };
    let key = {
        let surface = surface.clone();
        Callback::from(move |event: KeyboardEvent| match event.key().as_str() {
            "Enter" => {
                event.prevent_default();
                surface.find_next(event.shift_key());
            }
            "Escape" => {
                event.prevent_default();
                surface.focus();
            }
            _ => {}
        })
    };
    let step = |is_back: bool| {
        let surface = surface.clone();
        Callback::from(move |_: MouseEvent| surface.find_next(is_back))
    };
    let go = {
        let surface = surface.clone();
        Callback::from(move |event: Event| {
            let line = event
                .target_unchecked_into::<HtmlInputElement>()
                .value_as_number();
            if line >= 1.0 {
                surface.go_to_line(line as usize);
            }
        })
    };
    html! {
        <div class="find" role="search">
            <label>{ "Find " }<input id="find" autocomplete="off" spellcheck="false" oninput={typed}
                onkeydown={key} /></label>
            <button type="button" disabled={!is_found} onclick={step(true)} aria-label="Find the one before">{ "↑" }</button>
            <button type="button" disabled={!is_found} onclick={step(false)} aria-label="Find the next one">{ "↓" }</button>
            <output>{ count_words(props.count, props.at) }</output>
            <label>{ "Line " }<input id="go-to" type="number" min="1" step="1" onchange={go} /></label>
        </div>
    }
}

impl Surface {
    /// Searches the text anew where it has changed.
    fn search(&self) {
        let editing = &mut *self.editing.borrow_mut();
        if editing.search.revision != editing.text.revision {
            editing.search.places = editing.text.find(&editing.search.wanted);
            editing.search.revision = editing.text.revision;
            editing.search.at = None;
        }
    }

    /// Searches a text, and shows the first place at the caret or behind.
    pub(super) fn find(&self, wanted: &str) {
        {
            let editing = &mut *self.editing.borrow_mut();
            editing.search.wanted = wanted.into();
            editing.search.places = editing.text.find(wanted);
            editing.search.revision = editing.text.revision;
            editing.search.at = None;
        }
        let caret = self.selection()[0];
        self.show_found(|places| places.iter().position(|place| *place >= caret).or(Some(0)));
    }

    /// Shows the next place, or the one before; behind the last is the first.
    pub(super) fn find_next(&self, is_back: bool) {
        self.search();
        let caret = self.selection()[0];
        self.show_found(|places| {
            if is_back {
                let before = places.iter().rposition(|place| *place < caret);
                before.or(places.len().checked_sub(1))
            } else {
                places.iter().position(|place| *place > caret).or(Some(0))
            }
        });
    }

    fn show_found(&self, choose: impl Fn(&[Place]) -> Option<usize>) {
        let (start, width) = {
            let search = &mut self.editing.borrow_mut().search;
            search.at = choose(&search.places).filter(|at| *at < search.places.len());
            let start = search.at.and_then(|at| search.places.get(at)).copied();
            (start, width_utf16(&search.wanted))
        };
        if let Some(start) = start {
            let column = start.column + width;
            self.show([start, Place { column, ..start }]);
        } else {
            self.refresh.force_update();
        }
    }

    /// What is searched, and the place that is shown.
    pub(super) fn wanted(&self) -> (String, Option<Place>) {
        let search = &self.editing.borrow().search;
        let place = search.at.and_then(|at| search.places.get(at));
        (search.wanted.clone(), place.copied())
    }

    /// How often the text is found, where one is searched.
    pub(super) fn found_count(&self) -> Option<usize> {
        let search = &self.editing.borrow().search;
        (!search.wanted.is_empty()).then_some(search.places.len())
    }

    /// Which place is shown.
    pub(super) fn found_at(&self) -> Option<usize> {
        self.editing.borrow().search.at
    }
}

#[cfg(test)]
mod tests {
    use super::*;

    #[test]
    fn what_is_found_is_counted_in_words() {
        assert_eq!(count_words(None, None), "");
        assert_eq!(count_words(Some(0), None), "not found");
        assert_eq!(count_words(Some(3), None), "3 found");
        assert_eq!(count_words(Some(3), Some(2)), "3 of 3");
    }
}
