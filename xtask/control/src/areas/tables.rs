//! Work systems and tools as the machine has them: `$#` and `$TT`.

use grbl_client::{Line, numbers};
use leadscrew::axis::LETTERS;
use yew::prelude::*;

use crate::{areas::field::Field, context::use_page_context, model::Model};

/// The work systems by their names, with `P` of G10.
const SYSTEMS: [(&str, u8); 9] = [
    ("G54", 1),
    ("G55", 2),
    ("G56", 3),
    ("G57", 4),
    ("G58", 5),
    ("G59", 6),
    ("G59.1", 7),
    ("G59.2", 8),
    ("G59.3", 9),
];

/// A number that was typed.
fn finite(text: &str) -> Option<f64> {
    text.parse().ok().filter(|value: &f64| value.is_finite())
}

/// A tool of the table.
#[derive(Debug, PartialEq)]
struct Tool {
    number: u32,
    /// The length along Z, mm.
    length: f64,
    /// The diameter, mm.
    diameter: f64,
}

/// The coordinates of what `$#` has under a name.
fn place(lines: &[String], name: &str) -> Option<Vec<f64>> {
    lines.iter().find_map(|line| match Line::read(line) {
        Line::Answer(found, values) if found == name => numbers(values.split(':').next()?),
        _ => None,
    })
}

/// What a unit of reports and one of lines is, mm.
fn units_mm(model: &Model) -> (f64, f64) {
    let unit = |is_inch: bool| if is_inch { 25.4 } else { 1.0 };
    let lines = model.machine.modes.iter().any(|mode| mode == "G20");
    (unit(model.machine.reports_inches), unit(lines))
}

/// Reads a line of `$TT`: `T1 P1 X0 Y0 Z10.16 D3.048`.
fn tool(line: &str) -> Option<Tool> {
    let word = |letter: char| -> Option<f64> {
        let mut words = line.split_whitespace();
        words.find_map(|word| word.strip_prefix(letter)?.parse().ok())
    };
    Some(Tool {
        number: word('T')? as u32,
        length: word('Z').unwrap_or_default(),
        diameter: word('D').unwrap_or_default(),
    })
}

fn answer(model: &Model, question: &str) -> Vec<String> {
    let lines = model.answers.get(question);
    lines.map_or_else(Vec::new, |lines| lines.to_vec())
}

/// The tables.
#[component]
pub fn TablesArea() -> Html {
    let context = use_page_context();
    let model = &*context.model;
    let may_set = model.takes_lines() && model.state_name() == "Idle";
    let read = {
        let context = context.clone();
        Callback::from(move |_: MouseEvent| {
            for line in ["$#", "$TT"] {
                context.line(line);
            }
        })
    };
    // A line, and the table as it is then.
    let set = {
        let context = context.clone();
        move |line: &str, question: &str| {
            context.line(line);
            context.line(question);
        }
    };
    let (of_reports, of_lines) = units_mm(model);
    // In the unit of the modes, which stays as it is.
    let scale = of_reports / of_lines;
    let lines = answer(model, "$#");
    let systems = SYSTEMS
        .iter()
        .filter_map(|(name, number)| Some((*name, *number, place(&lines, name)?)));
    let systems = systems.map(|(name, number, place)| {
        let cells = place.iter().zip(LETTERS).enumerate().map(|(axis, (value, letter))| {
            let (set, letter) = (set.clone(), char::from(letter));
            let typed = Callback::from(move |value: String| {
                if let Some(value) = finite(&value) {
                    let value = if axis < 3 { value * scale } else { value };
                    set(&format!("G10L2P{number}{letter}{value:.5}"), "$#");
                }
            });
            html! {
                <td><Field kind="number" step="any" is_off={!may_set} aria_label={format!("{name} {letter}")}
                    value={format!("{value:.3}")} on_change={typed} /></td>
            }
        });
        let is_used = model.machine.modes.iter().any(|mode| mode == name);
        let choose = {
            let context = context.clone();
            Callback::from(move |_: MouseEvent| context.line(name))
        };
        html! {
            <tr class={classes!(is_used.then_some("used"))}>
                <th scope="row"><button type="button" disabled={!may_set} aria-pressed={is_used.to_string()}
                    onclick={choose}>{ name }</button></th>{ for cells }</tr>
        }
    });
    let others = ["G28", "G30", "G92", "TLO", "PRB"].iter().filter_map(|name| {
        let place: Vec<_> = place(&lines, name)?.iter().map(|value| format!("{value:.3}")).collect();
        Some(html! { <tr><th scope="row">{ *name }</th><td colspan="6">{ place.join("  ") }</td></tr> })
    });
    let axes = place(&lines, "G54").map_or(0, |place| place.len());
    let head = LETTERS
        .iter()
        .take(axes)
        .map(|letter| html! { <th scope="col">{ char::from(*letter) }</th> });
    let tools = answer(model, "$TT");
    let tools = tools.iter().filter_map(|line| tool(line)).map(|Tool { number, length, diameter }| {
        let cells = [("Z", "length", length), ("R", "diameter", diameter)].map(|(word, name, value)| {
            let set = set.clone();
            let typed = Callback::from(move |value: String| {
                if let Some(value) = finite(&value) {
                    let value = if word == "R" { value / 2.0 } else { value } / of_lines;
                    set(&format!("G10L1P{number}{word}{value:.5}"), "$TT");
                }
            });
            html! {
                <td><Field kind="number" step="any" is_off={!may_set} aria_label={format!("T{number} {name}")}
                    value={format!("{value:.3}")} on_change={typed} /></td>
            }
        });
        html! { <tr><th scope="row">{ format!("T{number}") }</th>{ for cells }</tr> }
    });
    let tools: Vec<_> = tools.collect();
    html! {
        <section class="tables" tabindex="0" aria-label="Work systems and tools">
            <h2>{ "Work systems and tools" }</h2>
            <button id="read-tables" type="button" disabled={!may_set} onclick={read}>{ "Read" }</button>
            if axes > 0 {
                <table><thead><tr><th scope="col">{ "System" }</th>{ for head }</tr></thead>
                    <tbody>{ for systems }{ for others }</tbody></table>
            }
            if !tools.is_empty() {
                <table><thead><tr><th scope="col">{ "Tool" }</th><th scope="col">{ "Length, mm" }</th>
                    <th scope="col">{ "Diameter, mm" }</th></tr></thead><tbody>{ for tools }</tbody></table>
            }
        </section>
    }
}

#[cfg(test)]
mod tests {
    use super::*;

    #[test]
    fn units_are_those_of_reports_and_of_modes() {
        let mut model = Model::default();
        assert_eq!(units_mm(&model), (1.0, 1.0));
        model.machine.modes = vec!["G20".into()];
        assert_eq!(units_mm(&model), (1.0, 25.4));
        model.machine.reports_inches = true;
        assert_eq!(units_mm(&model), (25.4, 25.4));
    }

    #[test]
    fn places_and_tools_are_read() {
        let lines = [
            "[G54:1.000,-2.000,0.000]",
            "[PRB:0.000,0.000,-5.300:1]",
            "[TLO:0.000]",
        ]
        .map(str::to_owned);
        assert_eq!(place(&lines, "G54"), Some(vec![1.0, -2.0, 0.0]));
        assert_eq!(place(&lines, "PRB"), Some(vec![0.0, 0.0, -5.3]));
        assert_eq!(place(&lines, "G55"), None);
        let third = Tool {
            number: 3,
            length: 10.16,
            diameter: 3.048,
        };
        assert_eq!(tool("T3 P3 X0 Y0 Z10.16 D3.048"), Some(third));
        assert_eq!(tool("ok"), None);
    }
}
