//! What is seen of a text: the numbers of the lines, and the lines with their colours.

use std::collections::BTreeSet;

use yew::prelude::*;

use super::{
    colours::parts,
    surface::Surface,
    text::{Place, occurrences, width_utf16},
};

/// A line that is drawn: its number from 1, and its text.
pub(super) type DrawnLine = (usize, String);

fn classes_of(number: usize, refused: &BTreeSet<usize>, executed: Option<usize>) -> Classes {
    classes!(
        refused.contains(&number).then_some("refused"),
        (executed == Some(number)).then_some("executed"),
    )
}

/// The numbers of lines.
pub(super) fn gutter(
    lines: &[DrawnLine],
    refused: &BTreeSet<usize>,
    executed: Option<usize>,
) -> Html {
    let numbers = lines.iter().map(|(number, _)| {
        let title = refused.contains(number).then_some("the machine refuses this line");
        html! { <li key={*number} class={classes_of(*number, refused, executed)} {title}>{ *number }</li> }
    });
    html! { <ol>{ for numbers }</ol> }
}

/// Lines.
pub(super) fn code(
    surface: &Surface,
    lines: &[DrawnLine],
    refused: &BTreeSet<usize>,
    executed: Option<usize>,
) -> Html {
    let (wanted, current) = surface.wanted();
    let lines = lines.iter().map(|(number, text)| {
        let parts = parts(text)
            .into_iter()
            .map(|(part, text)| match part.class() {
                Some(class) => html! { <span {class}>{ text.to_owned() }</span> },
                None => html! { { text.to_owned() } },
            });
        let current = current.filter(|place| place.line + 1 == *number);
        html! {
            <div key={*number} class={classes_of(*number, refused, executed)}>
                { marks(text, &wanted, current) }{ for parts }
            </div>
        }
    });
    html! { <pre aria-hidden="true">{ for lines }</pre> }
}

/// Marks where a text is found in a line, behind the line.
fn marks(line: &str, wanted: &str, current: Option<Place>) -> Html {
    let mut marks = Vec::new();
    let mut end = 0;
    for at in occurrences(line, wanted) {
        let is_current = current.is_some_and(|place| place.column == width_utf16(&line[..at]));
        let (before, found) = (
            line[end..at].to_owned(),
            line[at..at + wanted.len()].to_owned(),
        );
        end = at + wanted.len();
        marks.push(html! { <>{ before }<mark class={classes!(is_current.then_some("current"))}>{ found }</mark></> });
    }
    if marks.is_empty() {
        Html::default()
    } else {
        html! { <span class="marks">{ for marks }</span> }
    }
}
