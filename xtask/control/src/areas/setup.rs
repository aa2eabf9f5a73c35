//! Setting up: homing, unlocking, zeros, and the way back to them.

use grbl_client::realtime;
use leadscrew::axis::LETTERS;
use yew::prelude::*;

use crate::{
    areas::state::coordinate,
    context::{PageContext, use_page_context},
    model::Model,
};

/// How fast the machine goes to zero, mm/min: as fast as its axes can, since a jog is no faster than they are.
const FEED: f64 = 10_000.0;

/// The zero of some axes in the present work system, where the machine is now.
pub(crate) fn zero_line(axes: impl IntoIterator<Item = usize>) -> String {
    let words = { axes.into_iter() }
        .filter_map(|axis| LETTERS.get(axis))
        .map(|letter| format!("{}0", char::from(*letter)));
    format!("G10L20P0{}", words.collect::<String>())
}

/// The unit of the reports as a word, and the feed in it.
fn unit_and_feed(model: &Model) -> (&'static str, f64) {
    if model.machine.reports_inches {
        ("G20", FEED / 25.4)
    } else {
        ("G21", FEED)
    }
}

/// The line that brings Z to where homing has left it, where that is known and above. A jog changes no mode and ends with
/// a jog's cancel.
pub(crate) fn lift_line(model: &Model) -> Option<String> {
    let top = model.machine.homed.as_ref()?.get(2)?;
    let now = model.machine.machine.get(2)?;
    let (unit, feed) = unit_and_feed(model);
    (top > now).then(|| format!("$J=G53G90{unit}Z{top:.3}F{feed:.0}"))
}

/// The lines that lead to the zero of X and Y: Z goes up first. They are jogs.
fn lines_to_zero(model: &Model) -> Vec<String> {
    let (unit, feed) = unit_and_feed(model);
    let line = format!("$J=G90{unit}X0Y0F{feed:.0}");
    lift_line(model).into_iter().chain([line]).collect()
}

/// How fast Z goes to zero, mm/min: it may come down near the workpiece.
const Z_FEED: f64 = 500.0;

/// What a button does that leads Z to the zero of the work system, and the line that does so; nothing where Z is there.
fn z_to_zero(model: &Model) -> Option<(String, String)> {
    let (unit, word, feed) = if model.machine.reports_inches {
        ("in", "G20", Z_FEED / 25.4)
    } else {
        ("mm", "G21", Z_FEED)
    };
    let z = *model.machine.work.get(2)?;
    let distance = coordinate(z.abs());
    let verb = match z {
        _ if distance == "0.000" => return None,
        z if z > 0.0 => "Lower",
        _ => "Raise",
    };
    let line = format!("$J=G90{word}Z0F{feed:.0}");
    Some((format!("{verb} Z by {distance} {unit} to zero"), line))
}

/// A button that sends a line.
fn line_button(context: &PageContext, text: &str, name: &str, line: String, is_on: bool) -> Html {
    let context = context.clone();
    let press = Callback::from(move |_: MouseEvent| context.line(&line));
    html! {
        <button type="button" disabled={!is_on} onclick={press} aria-label={name.to_owned()}>{ text.to_owned() }</button>
    }
}

/// Setting up.
#[component]
pub fn SetupArea() -> Html {
    let context = use_page_context();
    let model = &*context.model;
    let axes = model.machine.machine.len();
    let is_locked = model.may_operate() && model.state_name() == "Alarm";
    let may_home = is_locked || (model.takes_lines() && model.state_name() == "Idle");
    let reset = {
        let context = context.clone();
        Callback::from(move |_: MouseEvent| context.byte(realtime::RESET))
    };
    let letters = LETTERS.iter().take(axes).map(|letter| char::from(*letter));
    let home_axes = letters.clone().map(|letter| {
        let name = format!("Home {letter}");
        line_button(
            &context,
            &letter.to_string(),
            &name,
            format!("$H{letter}"),
            may_home,
        )
    });
    let zero_axes = letters.enumerate().map(|(axis, letter)| {
        let name = format!("Zero {letter}");
        line_button(
            &context,
            &letter.to_string(),
            &name,
            zero_line([axis]),
            model.takes_lines(),
        )
    });
    html! {
        <section class="setup" aria-label="Set-up">
            <h2>{ "Set-up" }</h2>
            <div role="group" aria-label="Home">
                { line_button(&context, "Home", "Home all axes", "$H".into(), may_home) }{ for home_axes }
            </div>
            <div role="group" aria-label="Zero">
                { line_button(&context, "Zero", "Zero all axes", zero_line(0..axes), model.takes_lines()) }{ for zero_axes }
            </div>
            <div role="group" aria-label="Locks">
                { line_button(&context, "Unlock", "Unlock", "$X".into(), is_locked) }
                <button type="button" disabled={!model.may_operate()} onclick={reset}>{ "Reset" }</button>
            </div>
            <RetractedMove name="Go to zero" lines={lines_to_zero(model)} may_go={model.may_jog()} />
            <div role="group" aria-label="Z to zero">{ z_button(&context) }</div>
        </section>
    }
}

/// Z to the zero of the work system.
fn z_button(context: &PageContext) -> Html {
    let model = &*context.model;
    match z_to_zero(model) {
        Some((text, line)) => line_button(context, &text, &text, line, model.may_jog()),
        None => html! { <button type="button" disabled=true>{ "Z to zero" }</button> },
    }
}

/// What a move of X and Y is given.
#[derive(Clone, PartialEq, Properties)]
pub(crate) struct RetractedMoveProperties {
    /// Its name.
    pub(crate) name: AttrValue,
    /// Its lines, of which the first raises Z where its top is known.
    pub(crate) lines: Vec<String>,
    /// The machine may move.
    pub(crate) may_go: bool,
}

/// A move of X and Y. Where the top of Z is not known, the operator is asked.
#[component]
pub(crate) fn RetractedMove(properties: &RetractedMoveProperties) -> Html {
    let context = use_page_context();
    let is_asked = use_state(|| false);
    let RetractedMoveProperties {
        name,
        lines,
        may_go,
    } = properties.clone();
    let is_homed = context.model.machine.homed.is_some();
    let go = {
        let is_asked = is_asked.clone();
        Callback::from(move |_: MouseEvent| {
            is_asked.set(false);
            for line in &lines {
                context.line(line);
            }
        })
    };
    let begin = {
        let (is_asked, go) = (is_asked.clone(), go.clone());
        Callback::from(move |event: MouseEvent| {
            if is_homed {
                go.emit(event);
            } else {
                is_asked.set(true);
            }
        })
    };
    let leave = {
        let is_asked = is_asked.clone();
        Callback::from(move |_: MouseEvent| is_asked.set(false))
    };
    html! {
        <div role="group" aria-label={name.clone()}>
            <button type="button" disabled={!may_go} onclick={begin}>{ name }</button>
            if *is_asked && may_go {
                <p role="alert">{ "The machine was not homed, so Z cannot be raised to its top first: X and Y move at the \
                    present height. Is the tool free?" }</p>
                <button type="button" onclick={go}>{ "Move X and Y" }</button>
                <button type="button" onclick={leave}>{ "Do not move" }</button>
            }
        </div>
    }
}

#[cfg(test)]
mod tests {
    use super::*;

    fn at(z_mm: f64, homed: Option<f64>) -> Model {
        let mut model = Model::default();
        model.machine.homed = homed.map(|z_mm| vec![-1.0, -1.0, z_mm]);
        model.machine.machine = vec![5.0, 6.0, z_mm];
        model
    }

    #[test]
    fn zeros_are_of_the_present_work_system() {
        assert_eq!(zero_line([2]), "G10L20P0Z0");
        assert_eq!(zero_line(0..4), "G10L20P0X0Y0Z0A0");
    }

    #[test]
    fn z_to_zero_names_what_it_does() {
        let at = |z_mm: f64| {
            let mut model = Model::default();
            model.machine.work = vec![1.0, 2.0, z_mm];
            z_to_zero(&model)
        };
        let (text, line) = at(12.5).unwrap();
        assert_eq!(text, "Lower Z by 12.500 mm to zero");
        assert_eq!(line, "$J=G90G21Z0F500");
        assert!(at(-3.0).is_some_and(|(text, _)| text == "Raise Z by 3.000 mm to zero"));
        assert_eq!(at(0.000_4), None);
        assert_eq!(z_to_zero(&Model::default()), None);
    }

    #[test]
    fn z_goes_up_first_where_its_top_is_known() {
        let both = ["$J=G53G90G21Z-1.000F10000", "$J=G90G21X0Y0F10000"];
        assert_eq!(lines_to_zero(&at(-30.0, Some(-1.0))), both);
        assert_eq!(lines_to_zero(&at(-1.0, Some(-1.0))), both[1..]);
        assert_eq!(lines_to_zero(&at(-30.0, None)), both[1..]);
        let mut in_inches = at(-2.0, Some(-0.04));
        in_inches.machine.reports_inches = true;
        assert_eq!(lines_to_zero(&in_inches)[0], "$J=G53G90G20Z-0.040F394");
    }
}
