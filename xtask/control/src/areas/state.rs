//! The machine as it is: position, state, alarm, pins, feed and speed, overrides, modes.

use grbl_client::{
    client::State,
    realtime,
    words::{self, accessory_words, mode_words, pin_words, with_set},
};
use leadscrew::axis::LETTERS;
use yew::prelude::*;

use crate::{context::use_page_context, model::Model};

/// The state in words.
pub(crate) fn state_words(model: &Model) -> &'static str {
    if !model.is_there() {
        return "No machine";
    }
    words::state_words(&model.machine.state)
}

/// The colour of a state: a class of the style.
pub(crate) fn state_class(model: &Model) -> &'static str {
    if !model.is_there() {
        return "gone";
    }
    match model.state_name() {
        "Idle" => "idle",
        "Run" => "run",
        "Hold" | "Door" | "Tool" => "hold",
        "Jog" | "Home" => "jog",
        "Alarm" => "alarm",
        "Check" => "check",
        "Sleep" => "sleep",
        _ => "other",
    }
}

/// A coordinate; one that rounds to nothing has no sign.
pub(crate) fn coordinate(value: f64) -> String {
    let text = format!("{value:.3}");
    if text == "-0.000" {
        "0.000".into()
    } else {
        text
    }
}

/// An override with its value, and the texts and bytes of its buttons.
type Override = (&'static str, u16, [(&'static str, u8); 3]);

fn overrides(state: &State) -> [Override; 3] {
    let [feed, rapids, spindle] = state.overrides;
    let kept = |minus, reset, plus| [("−10 %", minus), ("100 %", reset), ("+10 %", plus)];
    let feed_buttons = kept(
        realtime::FEED_MINUS_10,
        realtime::FEED_RESET,
        realtime::FEED_PLUS_10,
    );
    let rapid_buttons = [
        ("25 %", realtime::RAPIDS_QUARTER),
        ("50 %", realtime::RAPIDS_HALF),
        ("100 %", realtime::RAPIDS_FULL),
    ];
    let spindle_buttons = kept(
        realtime::SPINDLE_MINUS_10,
        realtime::SPINDLE_RESET,
        realtime::SPINDLE_PLUS_10,
    );
    [
        ("Feed", feed, feed_buttons),
        ("Rapids", rapids, rapid_buttons),
        ("Spindle", spindle, spindle_buttons),
    ]
}

/// The machine as it is.
#[component]
pub fn StateArea() -> Html {
    let context = use_page_context();
    let model = &*context.model;
    let state = &model.machine;
    let unit = if model.machine.reports_inches {
        "in"
    } else {
        "mm"
    };
    let axes = state.work.iter().zip(&state.machine).zip(LETTERS);
    let rows = axes.map(|((work, machine), letter)| {
        let letter = char::from(letter).to_string();
        html! {
            <tr data-axis={letter.clone()}>
                <th scope="row">{ letter }</th>
                <td class="work">{ coordinate(*work) }</td>
                <td class="machine">{ coordinate(*machine) }</td>
            </tr>
        }
    });
    html! {
        <section class="state" aria-label="Machine">
            <h2 id="state" class={state_class(model)} aria-live="polite">{ state_words(model) }</h2>
            if let Some((number, text)) = &state.alarm {
                <p id="alarm" role="alert">{ format!("Alarm {number}: {text}") }</p>
            }
            if !model.note.is_empty() { <p id="note" role="alert">{ &model.note }</p> }
            <table class="readout">
                <thead><tr>
                    <th scope="col">{ "Axis" }</th>
                    <th scope="col">{ format!("Work, {unit}") }</th>
                    <th scope="col">{ format!("Machine, {unit}") }</th>
                </tr></thead>
                <tbody>{ for rows }</tbody>
            </table>
            { values(state, unit) }
            <Overrides />
            <Accessories />
        </section>
    }
}

/// What is beside the position, by names.
fn values(state: &State, unit: &str) -> Html {
    let mut values = vec![
        (
            "Feed",
            with_set(state.feed, &format!("{unit}/min"), &state.modes, 'F'),
        ),
        ("Spindle", with_set(state.spindle, "rpm", &state.modes, 'S')),
        ("Accessories", accessory_words(&state.accessories)),
        ("Inputs", pin_words(&state.pins)),
    ];
    values.extend(mode_words(&state.modes));
    if let Some((blocks, bytes)) = state.room {
        values.push(("Free", format!("{blocks} moves, {bytes} bytes")));
    }
    let values = { values.into_iter() }
        .filter(|(_, value)| !value.is_empty())
        .map(|(name, value)| html! { <div><dt>{ name }</dt><dd>{ value }</dd></div> });
    html! { <dl class="values">{ for values }</dl> }
}

/// The overrides.
#[component]
fn Overrides() -> Html {
    let context = use_page_context();
    let is_off = !context.model.may_operate();
    let rows = overrides(&context.model.machine).map(|(name, value, buttons)| {
        let buttons = buttons.map(|(text, byte)| {
            let context = context.clone();
            let press = Callback::from(move |_: MouseEvent| context.byte(byte));
            html! {
                <button type="button" disabled={is_off} onclick={press}
                    aria-label={format!("{name} {text}")}>{ text }</button>
            }
        });
        html! {
            <div role="group" aria-label={format!("{name} override")} data-override={name}>
                <span>{ name }</span><output>{ format!("{value} %") }</output>{ for buttons }
            </div>
        }
    });
    html! { <div class="overrides">{ for rows }</div> }
}

/// Coolant, and the spindle in a hold.
#[component]
fn Accessories() -> Html {
    let context = use_page_context();
    let model = &*context.model;
    let buttons = [
        (
            "Flood",
            realtime::FLOOD_TOGGLE,
            Some('F'),
            model.may_operate(),
        ),
        (
            "Mist",
            realtime::MIST_TOGGLE,
            Some('M'),
            model.may_operate(),
        ),
        (
            "Spindle off or on",
            realtime::SPINDLE_STOP,
            None,
            may_stop_spindle(model),
        ),
    ];
    let buttons = buttons.map(|(text, byte, letter, is_on)| {
        let pressed = letter.map(|letter| model.machine.accessories.contains(letter).to_string());
        let press = {
            let context = context.clone();
            Callback::from(move |_: MouseEvent| context.byte(byte))
        };
        html! { <button type="button" disabled={!is_on} aria-pressed={pressed} onclick={press}>{ text }</button> }
    });
    html! { <div class="accessories" role="group" aria-label="Coolant, and the spindle in a hold">{ for buttons }</div> }
}

/// The spindle is stopped by hand in a hold alone.
fn may_stop_spindle(model: &Model) -> bool {
    model.may_operate() && model.machine.state == "Hold:0"
}

#[cfg(test)]
mod tests {
    use super::*;
    use crate::model::Connection;

    fn model(state: &str) -> Model {
        let machine = State {
            is_there: true,
            state: state.into(),
            ..State::default()
        };
        Model {
            connection: Connection::Open,
            machine,
            ..Model::default()
        }
    }

    #[test]
    fn each_state_has_words_and_a_colour() {
        for (state, words, class) in [
            ("Idle", "Idle", "idle"),
            ("Hold:1", "Hold: slowing down", "hold"),
            ("Door:0", "Door closed: resume to go on", "hold"),
            ("Alarm", "Alarm: locked", "alarm"),
            ("Home", "Homing", "jog"),
            ("Tool", "Change of the tool", "hold"),
            ("Check", "Check: nothing moves", "check"),
            ("Sleep", "Asleep: reset to wake up", "sleep"),
            ("<b>", "Unknown state", "other"),
        ] {
            let model = model(state);
            assert_eq!((state_words(&model), state_class(&model)), (words, class));
        }
        assert_eq!(state_words(&Model::default()), "No machine");
    }

    #[test]
    fn the_spindle_is_stopped_by_hand_in_a_hold_alone() {
        for (state, may) in [
            ("Hold:0", true),
            ("Hold:1", false),
            ("Run", false),
            ("Idle", false),
        ] {
            assert_eq!(may_stop_spindle(&model(state)), may, "{state}");
        }
    }

    #[test]
    fn a_coordinate_that_rounds_to_nothing_has_no_sign() {
        assert_eq!(coordinate(-0.000_4), "0.000");
        assert_eq!(coordinate(-1.5), "-1.500");
    }
}
