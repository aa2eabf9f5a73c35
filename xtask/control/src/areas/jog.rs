//! Jogging: by a step at each press, or as long as a button or a key is held.
//!
//! What is held is asked for again and again; the client ends the motion where nothing asks any more. Release, loss of
//! the focus and a page that is hidden end it at once.

use std::{cell::RefCell, rc::Rc};

use gloo_events::EventListener;
use gloo_timers::callback::Interval;
use grbl_client::client::Command;
use leadscrew::axis::LETTERS;
use wasm_bindgen::JsCast as _;
use web_sys::{HtmlInputElement, Node};
use yew::prelude::*;

use crate::context::{PageContext, use_page_context};

/// How often a held button asks, ms.
const REPEAT_MS: u32 = 80;
/// The distances of a press, mm or degrees; 0 is as long as it is held.
const STEPS: [f64; 5] = [0.0, 0.01, 0.1, 1.0, 10.0];
/// The feeds of the slider, mm/min: from the first to the last by an equal ratio.
const FEEDS: [f64; 2] = [10.0, 10_000.0];
/// The positions of the slider.
const POSITIONS: u32 = 60;

/// The feed at a position of the slider, mm/min, with two figures.
fn feed_at(position: u32) -> f64 {
    let [least, most] = FEEDS;
    let share = f64::from(position.min(POSITIONS)) / f64::from(POSITIONS);
    let feed = least * (most / least).powf(share);
    let unit = 10_f64.powf(feed.log10().floor() - 1.0);
    (feed / unit).round() * unit
}

/// The axis and the direction of a key of the keyboard.
fn along_key(key: &str) -> Option<(usize, i8)> {
    Some(match key {
        "ArrowRight" => (0, 1),
        "ArrowLeft" => (0, -1),
        "ArrowUp" => (1, 1),
        "ArrowDown" => (1, -1),
        "PageUp" => (2, 1),
        "PageDown" => (2, -1),
        _ => return None,
    })
}

/// Directions of all axes: one of them, or two for a corner of the pad.
fn along(axes: usize, moved: &[(usize, i8)]) -> Vec<i8> {
    let mut along = vec![0; axes];
    for (axis, direction) in moved {
        if let Some(one) = along.get_mut(*axis) {
            *one = *direction;
        }
    }
    along
}

/// A press: asks once, or again and again until it is dropped.
#[derive(Default)]
struct Held {
    asking: Option<Interval>,
    /// The key that is held.
    key: String,
    /// The presses until now.
    presses: u32,
}

/// The pad's way to the machine.
#[derive(Clone)]
struct Pad {
    context: PageContext,
    held: Rc<RefCell<Held>>,
    step: f64,
    feed: f64,
}

impl Pad {
    /// A button or a key goes down.
    fn press(&self, moved: &[(usize, i8)], key: &str) {
        if !self.context.model.may_jog() {
            return;
        }
        self.release();
        let along = along(self.context.model.machine.machine.len(), moved);
        let (feed, context) = (self.feed, self.context.clone());
        if self.step > 0.0 {
            let by = along.iter().map(|along| f64::from(*along) * self.step);
            context.send(Command::Step {
                by: by.collect(),
                feed,
            });
            return;
        }
        let press = self.held.borrow().presses + 1;
        let ask = move || {
            context.send(Command::Move {
                press,
                along: along.clone(),
                feed,
            });
        };
        ask();
        *self.held.borrow_mut() = Held {
            asking: Some(Interval::new(REPEAT_MS, ask)),
            key: key.into(),
            presses: press,
        };
    }

    /// What is held is let go.
    fn release(&self) {
        if self.held.borrow_mut().asking.take().is_some() {
            self.context.send(Command::Halt);
        }
    }

    fn key_down(&self, event: &KeyboardEvent) {
        // A key that is held with another one, as Cmd, may never be message to be up; one that clicks repeats.
        if event.meta_key() || event.ctrl_key() || event.alt_key() {
            self.release();
            return;
        }
        if event.repeat() && matches!(event.key().as_str(), "Enter" | " ") {
            event.prevent_default();
        }
        let Some(moved) = along_key(&event.key()) else {
            return;
        };
        event.prevent_default();
        if !event.repeat() {
            self.press(&[moved], &event.key());
        }
    }

    /// The focus goes elsewhere; from one button of the pad to another it stays.
    fn lose_focus(&self, event: &FocusEvent, pad: &NodeRef) {
        let next = event.related_target();
        let next = next.and_then(|next| next.dyn_into::<Node>().ok());
        let stays = next.is_some_and(|next| pad.get().is_some_and(|pad| pad.contains(Some(&next))));
        if !stays {
            self.release();
        }
    }

    fn key_up(&self, event: &KeyboardEvent) {
        let is_held = self.held.borrow().key == event.key();
        if is_held {
            self.release();
        }
    }

    /// A button of the pad.
    fn button(&self, text: &str, name: &str, moved: Vec<(usize, i8)>) -> Html {
        let (pressed, clicked) = (self.clone(), self.clone());
        let by_key = moved.clone();
        let press = Callback::from(move |event: PointerEvent| {
            if event.button() == 0 {
                pressed.press(&moved, "");
            }
        });
        // Enter and the space bar click: they move by a step alone.
        let click = Callback::from(move |event: MouseEvent| {
            if event.detail() == 0 && clicked.step > 0.0 {
                clicked.press(&by_key, "");
            }
        });
        let released = self.clone();
        let release = Callback::from(move |_: PointerEvent| released.release());
        html! {
            <button type="button" aria-label={name.to_owned()} disabled={!self.context.model.may_jog()}
                onpointerdown={press} onpointerup={release.clone()} onpointercancel={release.clone()}
                onpointerleave={release} onclick={click}
                oncontextmenu={|event: MouseEvent| event.prevent_default()}>{ text.to_owned() }</button>
        }
    }
}

/// Whatever takes the page away from the operator ends a jog.
fn end_listeners(pad: &Pad) -> Vec<EventListener> {
    let Some(window) = web_sys::window() else {
        return Vec::new();
    };
    let mut listeners = Vec::new();
    for event in ["blur", "pagehide", "pointerup", "pointercancel"] {
        let pad = pad.clone();
        listeners.push(EventListener::new(&window, event, move |_| pad.release()));
    }
    if let Some(document) = window.document() {
        let pad = pad.clone();
        listeners.push(EventListener::new(
            &document,
            "visibilitychange",
            move |_| pad.release(),
        ));
    }
    listeners
}

/// The pad.
#[component]
pub fn JogArea() -> Html {
    let context = use_page_context();
    let step = use_state(|| 1.0);
    let slider = use_state(|| POSITIONS * 2 / 3);
    let held = use_mut_ref(Held::default);
    let feed = feed_at(*slider);
    let pad = Pad {
        context: context.clone(),
        held,
        step: *step,
        feed,
    };
    {
        let pad = pad.clone();
        use_effect_with((), move |()| {
            let listeners = end_listeners(&pad);
            move || {
                pad.release();
                drop(listeners);
            }
        });
    }
    {
        // An alarm, a lost line, a hold: what is held then does not begin again by itself.
        let pad = pad.clone();
        use_effect_with(context.model.may_jog(), move |may_jog| {
            if !may_jog {
                pad.release();
            }
        });
    }
    let area = use_node_ref();
    let node = area.clone();
    let (down, up, blurred) = (pad.clone(), pad.clone(), pad.clone());
    let step_value = *step;
    let choose_step = move |value: f64| {
        let step = step.clone();
        Callback::from(move |_: Event| step.set(value))
    };
    let slide = Callback::from(move |event: InputEvent| {
        let input = event.target_unchecked_into::<HtmlInputElement>();
        slider.set(input.value_as_number() as u32);
    });
    let position = POSITIONS.to_string();
    let slid = slider_position(feed).to_string();
    html! {
        <section class="jog" aria-label="Jog">
            <h2>{ "Jog" }</h2>
            <div role="radiogroup" aria-label="Step" class="steps">
                { for STEPS.map(|value| html! {
                    <label><input type="radio" name="step" value={value.to_string()} checked={value == step_value}
                        onchange={choose_step(value)} />{ step_words(value) }</label>
                }) }
            </div>
            <div id="pad" ref={area} class="pad" role="group" tabindex="0"
                aria-label="Jog pad: arrows move X and Y, page up and page down move Z"
                onkeydown={move |event: KeyboardEvent| down.key_down(&event)}
                onkeyup={move |event: KeyboardEvent| up.key_up(&event)}
                onfocusout={move |event: FocusEvent| blurred.lose_focus(&event, &node)}>
                { pad_buttons(&pad) }
            </div>
            <label class="feed">{ format!("Feed {feed:.0} mm/min ") }
                <input id="feed" type="range" min="0" max={position} value={slid} oninput={slide} /></label>
        </section>
    }
}

/// A step in words.
fn step_words(step: f64) -> String {
    if step > 0.0 {
        step.to_string()
    } else {
        "held".into()
    }
}

/// Where the slider is for a feed.
fn slider_position(feed: f64) -> u32 {
    let distance = |position: &u32| (feed_at(*position) - feed).abs();
    let nearest = (0..=POSITIONS).min_by(|a, b| distance(a).total_cmp(&distance(b)));
    nearest.unwrap_or_default()
}

fn pad_buttons(pad: &Pad) -> Html {
    const CORNERS: [(&str, &str, [i8; 2]); 8] = [
        ("↖", "X− Y+", [-1, 1]),
        ("Y+", "Y+", [0, 1]),
        ("↗", "X+ Y+", [1, 1]),
        ("X−", "X−", [-1, 0]),
        ("X+", "X+", [1, 0]),
        ("↙", "X− Y−", [-1, -1]),
        ("Y−", "Y−", [0, -1]),
        ("↘", "X+ Y−", [1, -1]),
    ];
    let plane = CORNERS.map(|(text, name, [x, y])| {
        let button = pad.button(text, name, vec![(0, x), (1, y)]);
        // The middle has no button.
        let gap = (name == "X−").then(|| html! { <span></span> });
        html! { <>{ button }{ gap }</> }
    });
    let axes = pad.context.model.machine.machine.len().max(3);
    let others = (2..axes).zip(LETTERS.iter().skip(2)).map(|(axis, letter)| {
        let letter = char::from(*letter);
        let [plus, minus] = [format!("{letter}+"), format!("{letter}−")];
        html! {
            <div>
                { pad.button(&plus, &plus, vec![(axis, 1)]) }
                { pad.button(&minus, &minus, vec![(axis, -1)]) }
            </div>
        }
    });
    html! { <><div class="plane">{ for plane }</div><div class="others">{ for others }</div></> }
}

#[cfg(test)]
mod tests {
    use super::*;

    #[test]
    fn the_slider_has_round_feeds_from_slow_to_fast() {
        assert_eq!(feed_at(0), 10.0);
        assert_eq!(feed_at(POSITIONS * 2 / 3), 1000.0);
        assert_eq!(feed_at(POSITIONS), 10_000.0);
        assert_eq!(feed_at(1000), 10_000.0);
        for position in 0..=POSITIONS {
            assert_eq!(slider_position(feed_at(position)), position);
        }
    }

    #[test]
    fn keys_and_corners_have_their_axes() {
        let moved = along_key("PageDown").unwrap();
        assert_eq!(along(3, &[moved]), [0, 0, -1]);
        assert_eq!(along(4, &[(0, 1), (1, -1)]), [1, -1, 0, 0]);
        assert_eq!(along(0, &[(2, 1)]), [0; 0]);
        assert_eq!(along_key("a"), None);
    }
}
