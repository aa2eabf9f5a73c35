//! The editor of a program.
//!
//! A browser lays all the lines of a field out again at each key: some seconds for 200 000. The field has the lines
//! around what is seen alone, as long as there are many; what is seen is drawn below it, with colours.

mod colours;
mod drawn;
mod find;
mod keys;
mod surface;
mod text;

use std::{collections::BTreeSet, rc::Rc};

use yew::prelude::*;

use crate::model::{LineToShow, Program};
use drawn::{code, gutter};
use find::FindBar;
use surface::Surface;

/// What the editor is to show.
#[derive(PartialEq, Properties)]
pub struct EditorProperties {
    /// The program.
    pub program: Rc<Program>,
    /// The lines that the machine would refuse, from 1.
    pub refused: Rc<BTreeSet<usize>>,
    /// The line in execution, from 1.
    pub executed: Option<usize>,
    /// Nothing is edited.
    pub is_locked: bool,
    /// A line to go to, at each new request.
    #[prop_or_default]
    pub go_to: Option<LineToShow>,
    /// Has the text when it has changed: a moment after the last key, and when the field is left.
    pub on_change: Callback<String>,
}

/// The refused lines in words.
fn refused_words(refused: &BTreeSet<usize>) -> String {
    const MOST: usize = 10;
    let numbers: Vec<_> = refused.iter().take(MOST).map(usize::to_string).collect();
    let more = if refused.len() > MOST {
        " and more"
    } else {
        ""
    };
    match refused.len() {
        0 => String::new(),
        1 => format!("Line {} is refused.", numbers[0]),
        count => format!("{count} lines are refused: {}{more}.", numbers.join(", ")),
    }
}

/// Has the surface follow what it is to show.
#[hook]
fn use_contents(surface: &Surface, props: &EditorProperties) {
    let shown = surface.clone();
    use_effect_with(props.program.clone(), move |program| {
        shown.load(&program.text);
    });
    let shown = surface.clone();
    use_effect_with(props.executed, move |executed| shown.follow(*executed));
    let shown = surface.clone();
    use_effect_with(props.go_to, move |go_to| {
        if let Some(LineToShow { line, .. }) = go_to {
            shown.go_to_line(*line);
        }
    });
    let released = surface.clone();
    use_effect_with((), move |()| {
        let listeners = released.release_listeners();
        move || drop(listeners)
    });
    let placed = surface.clone();
    use_effect(move || placed.place());
}

/// The editor.
#[component]
pub fn Editor(props: &EditorProperties) -> Html {
    let refresh = use_force_update();
    let (scroller, field, sheet) = (use_node_ref(), use_node_ref(), use_node_ref());
    let editing = use_mut_ref(surface::Editing::default);
    let surface = Surface {
        refresh,
        scroller: scroller.clone(),
        field: field.clone(),
        sheet: sheet.clone(),
        editing,
        executed: props.executed,
        is_locked: props.is_locked,
        on_change: props.on_change.clone(),
    };
    use_contents(&surface, props);
    let on = |act: fn(&Surface)| {
        let surface = surface.clone();
        move || act(&surface)
    };
    let (input, leave, scroll, press) = (
        on(Surface::take_input),
        on(Surface::emit),
        on(Surface::take_scroll),
        on(Surface::press),
    );
    let (keys, pasting) = (surface.clone(), surface.clone());
    let drawn = surface.drawn_lines();
    html! {
        <div class="editor">
            <FindBar surface={surface.clone()} count={surface.found_count()} at={surface.found_at()} />
            <div class="text" ref={scroller} onscroll={move |_: Event| scroll()}>
                <div class="sheet" ref={sheet}>
                    <div class="gutter" aria-hidden="true">{ gutter(&drawn, &props.refused, props.executed) }</div>
                    <div class="code">
                        { code(&surface, &drawn, &props.refused, props.executed) }
                        <textarea id="text" ref={field} aria-label="Lines of the program" spellcheck="false"
                            autocomplete="off" autocapitalize="off" wrap="off" readonly={props.is_locked}
                            aria-describedby="refused-lines"
                            oninput={move |_: InputEvent| input()} onblur={move |_: FocusEvent| leave()}
                            onpointerdown={move |_: PointerEvent| press()}
                            onkeydown={move |event: KeyboardEvent| keys.key_down(&event)}
                            onpaste={move |event: Event| pasting.paste(&event)} />
                    </div>
                </div>
            </div>
            <p id="refused-lines" class="hint">{ refused_words(&props.refused) }{ surface.note() }</p>
        </div>
    }
}

#[cfg(test)]
mod tests {
    use super::*;

    #[test]
    fn refused_lines_are_in_words() {
        let words = |lines: &[usize]| refused_words(&lines.iter().copied().collect());
        assert_eq!(words(&[]), "");
        assert_eq!(words(&[7]), "Line 7 is refused.");
        assert_eq!(words(&[2, 1]), "2 lines are refused: 1, 2.");
        let many: Vec<_> = (1..=20).collect();
        assert!(words(&many).ends_with("9, 10 and more."));
    }
}
