//! The machine's settings: by groups, with name, unit and range as the machine tells them; compared with a file.

use std::collections::BTreeMap;

use grbl_client::{
    Line,
    catalogue::{Catalogue, Description, Kind},
};
use wasm_bindgen_futures::{JsFuture, spawn_local};
use web_sys::{HtmlInputElement, HtmlSelectElement};
use yew::prelude::*;

use crate::{
    areas::field::Field,
    context::{PageContext, use_page_context},
    model::Model,
    storage,
};

/// The questions, the list of values last: `$$` where the machine does not know `$+`.
const QUESTIONS: [&str; 4] = ["$EG", "$ES", "$$", "$+"];
/// The name of a saved file.
const FILE: &str = "settings.txt";

type Values = BTreeMap<u16, String>;

/// What is known of the settings of a machine.
fn catalogue(model: &Model) -> Catalogue {
    let lines = ["$EG", "$ES"]
        .iter()
        .filter_map(|question| model.answers.get(*question));
    let lines: Vec<_> = lines
        .flat_map(|lines| lines.iter().map(String::as_str))
        .collect();
    let catalogue = Catalogue::read(lines);
    if catalogue.settings.is_empty() {
        Catalogue::of_grbl()
    } else {
        catalogue
    }
}

/// How a machine is asked to describe a setting, where it says that it can.
fn description_question(model: &Model, number: u16) -> Option<String> {
    let can = model.answers.get("$I+").is_some_and(|lines| {
        let mut options = lines.iter().filter_map(|line| match Line::read(line) {
            Line::Answer("NEWOPT", options) => Some(options),
            _ => None,
        });
        options.any(|options| options.split(',').any(|option| option == "SED"))
    });
    can.then(|| format!("$SED={number}"))
}

/// What a machine has said of a setting.
fn described(model: &Model, number: u16) -> Option<String> {
    let lines = model.answers.get(&format!("$SED={number}"))?;
    lines.iter().find_map(|line| match Line::read(line) {
        Line::Answer("SETTINGDESCR", text) => Some(text.split_once('|')?.1.replace("\\n", "\n")),
        _ => None,
    })
}

/// The values in a file of `$n=value` lines.
fn values(text: &str) -> Values {
    let settings = text
        .lines()
        .filter_map(|line| match Line::read(line.trim()) {
            Line::Setting(number, value) => Some((number, value.trim().to_owned())),
            _ => None,
        });
    settings.collect()
}

/// The settings of a file that the machine has otherwise: number, its value, and that of the file.
fn differences<'a>(machine: &'a Values, file: &'a Values) -> Vec<(u16, &'a str, &'a str)> {
    let is_equal = |left: &str, right: &str| match (left.parse::<f64>(), right.parse::<f64>()) {
        (Ok(left), Ok(right)) => (left - right).abs() <= 1e-6 * left.abs().max(1.0),
        _ => left == right,
    };
    let both = file.iter().filter_map(|(number, wanted)| {
        let has = machine.get(number)?;
        (!is_equal(has, wanted)).then_some((*number, has.as_str(), wanted.as_str()))
    });
    both.collect()
}

/// The file of values.
fn text(values: &Values) -> String {
    let lines = values
        .iter()
        .map(|(number, value)| format!("${number}={value}"));
    let lines: Vec<_> = lines.chain([String::new()]).collect();
    lines.join("\n")
}

/// A setting that can be changed.
#[derive(PartialEq, Properties)]
struct RowProperties {
    description: Description,
    value: AttrValue,
    before: Option<AttrValue>,
    is_off: bool,
    onset: Callback<(u16, String)>,
    /// What the machine has said of it, and how it is asked, where it can be.
    help: Option<AttrValue>,
    question: Option<AttrValue>,
    on_ask: Callback<AttrValue>,
}

/// The values from which some kinds are summed up.
fn summands(kind: &Kind) -> Vec<String> {
    match kind {
        Kind::Bits(names) => {
            let names = names.iter().enumerate().filter(|(_, name)| *name != "N/A");
            let bit = |bit: usize| 1_u32.checked_shl(bit as u32).unwrap_or(0);
            names
                .map(|(place, name)| format!("{} {name}", bit(place)))
                .collect()
        }
        Kind::Axes => ["1 X", "2 Y", "4 Z", "8 A", "16 B", "32 C"]
            .map(str::to_owned)
            .to_vec(),
        _ => Vec::new(),
    }
}

/// What helps to set a value, in a fold: the machine is asked when it is opened.
fn help(props: &RowProperties) -> Html {
    let summands = summands(&props.description.kind);
    if summands.is_empty() && props.question.is_none() {
        return Html::default();
    }
    let question = props
        .question
        .clone()
        .filter(|_| props.help.is_none() && !props.is_off);
    let on_ask = props.on_ask.clone();
    let toggle = move |_: Event| {
        if let Some(question) = &question {
            on_ask.emit(question.clone());
        }
    };
    let name = format!("Help for ${}", props.description.number);
    html! {
        <details ontoggle={toggle}><summary aria-label={name}>{ "Help" }</summary>
            if let Some(help) = &props.help { <p>{ help }</p> }
            if !summands.is_empty() { <p>{ "The sum of: " }{ summands.join(", ") }</p> }
        </details>
    }
}

#[component]
fn Row(props: &RowProperties) -> Html {
    let fault = use_state(|| None::<String>);
    let Description {
        number,
        name,
        unit,
        kind,
        ..
    } = &props.description;
    let set = {
        let (description, onset, fault) = (
            props.description.clone(),
            props.onset.clone(),
            fault.clone(),
        );
        move |value: String| {
            let wrong = description.fault(&value);
            let wrong = wrong.map(|reason| format!("{value}: {reason}"));
            if wrong.is_none() {
                onset.emit((description.number, value));
            }
            fault.set(wrong);
        }
    };
    let id = format!("setting-{number}");
    let field = match kind {
        Kind::Flag | Kind::Choice(_) => {
            let names = match kind {
                Kind::Choice(names) => names.clone(),
                _ => vec!["off".into(), "on".into()],
            };
            let options = names.iter().enumerate().map(|(value, name)| {
                let is_chosen = props.value.parse() == Ok(value);
                html! { <option value={value.to_string()} selected={is_chosen}>{ name.clone() }</option> }
            });
            let changed = Callback::from(move |event: Event| {
                set(event.target_unchecked_into::<HtmlSelectElement>().value());
            });
            html! { <select {id} disabled={props.is_off} onchange={changed}>{ for options }</select> }
        }
        Kind::Bits(_) | Kind::Axes | Kind::Number | Kind::Text => {
            html! { <Field {id} is_off={props.is_off} value={props.value.clone()} on_change={Callback::from(set)} /> }
        }
    };
    let range = match (props.description.least, props.description.most) {
        (Some(least), Some(most)) => format!("{least} to {most}"),
        (Some(least), None) => format!("from {least}"),
        _ => String::new(),
    };
    let range = match kind {
        Kind::Bits(_) | Kind::Axes => String::new(),
        _ => range,
    };
    html! {
        <tr class={classes!(props.before.is_some().then_some("changed"))}>
            <th scope="row">{ format!("${number}") }</th>
            <td><label for={format!("setting-{number}")}>{ name }</label><small>{ range }</small>
                if let Some(before) = &props.before { <small>{ format!("was {before}") }</small> }
                if let Some(fault) = &*fault { <small role="alert">{ fault }</small> }
                { help(props) }</td>
            <td>{ field }{ " " }{ unit }</td>
        </tr>
    }
}

/// Asks the machine for everything.
fn ask(context: &PageContext) {
    for question in QUESTIONS {
        context.line(question);
    }
}

/// The settings.
#[component]
pub fn SettingsArea() -> Html {
    let context = use_page_context();
    // The values at the first look, and those of a file.
    let before = use_state(Values::new);
    let file = use_state(|| None::<(String, Values)>);
    let model = &*context.model;
    let may_ask = model.takes_lines() && model.state_name() == "Idle";
    let load = {
        let (context, before) = (context.clone(), before.clone());
        Callback::from(move |_: MouseEvent| {
            before.set(Values::new());
            ask(&context);
        })
    };
    let onset = {
        let (context, before) = (context.clone(), before.clone());
        Callback::from(move |(number, value): (u16, String)| {
            let mut kept = (*before).clone();
            if let Some(value) = context.model.settings.get(&number) {
                kept.entry(number).or_insert_with(|| value.clone());
            }
            before.set(kept);
            context.line(&format!("${number}={value}"));
        })
    };
    let on_ask = {
        let context = context.clone();
        Callback::from(move |question: AttrValue| context.line(&question))
    };
    let catalogue = catalogue(model);
    let groups = catalogue.by_group().map(|(name, settings)| {
        let rows = settings.into_iter().filter_map(|description| {
            let value = model.settings.get(&description.number)?.clone();
            let before = before.get(&description.number).filter(|before| **before != value);
            let before = before.cloned().map(AttrValue::from);
            let key = description.number;
            let (description, onset, is_off) = (description.clone(), onset.clone(), !may_ask);
            let help = described(model, key).map(AttrValue::from);
            let question = description_question(model, key).map(AttrValue::from);
            Some(html! { <Row {key} {description} value={value} {before} {is_off} {onset} {help} {question}
                on_ask={on_ask.clone()} /> })
        });
        let rows: Vec<_> = rows.collect();
        if rows.is_empty() {
            return Html::default();
        }
        html! { <details><summary>{ name.to_owned() }</summary><table>{ for rows }</table></details> }
    });
    let save = {
        let settings = model.settings.clone();
        Callback::from(move |_: MouseEvent| storage::save_file(FILE, &text(&settings)))
    };
    let open = {
        let file = file.clone();
        Callback::from(move |event: Event| {
            let input = event.target_unchecked_into::<HtmlInputElement>();
            let Some(chosen) = input.files().and_then(|files| files.get(0)) else {
                return;
            };
            let file = file.clone();
            spawn_local(async move {
                let text = JsFuture::from(chosen.text()).await.ok();
                let text = text.and_then(|text| text.as_string()).unwrap_or_default();
                file.set(Some((chosen.name(), values(&text))));
            });
            input.set_value("");
        })
    };
    html! {
        <section class="settings" aria-label="Settings">
            <h2>{ "Settings" }</h2>
            <button id="read-settings" type="button" disabled={!may_ask} onclick={load}>{ "Read" }</button>
            <button type="button" disabled={model.settings.is_empty()} onclick={save}>{ "Save as file" }</button>
            <label>{ "Compare with a file " }<input type="file" disabled={model.settings.is_empty()} onchange={open} />
                </label>
            if let Some((name, wanted)) = &*file { { compared(&context, name, wanted, may_ask) } }
            { for groups }
        </section>
    }
}

/// What a file has otherwise, with a button for each and one for all.
fn compared(context: &PageContext, name: &str, wanted: &Values, may_set: bool) -> Html {
    let differences = differences(&context.model.settings, wanted);
    let set = |lines: Vec<String>| {
        let context = context.clone();
        Callback::from(move |_: MouseEvent| lines.iter().for_each(|line| context.line(line)))
    };
    let line = |number: u16, wanted: &str| format!("${number}={wanted}");
    let all = { differences.iter() }
        .map(|(number, _, wanted)| line(*number, wanted))
        .collect();
    let rows = differences.iter().map(|(number, has, wanted)| {
        let press = set(vec![line(*number, wanted)]);
        html! {
            <tr><th scope="row">{ format!("${number}") }</th><td>{ *has }</td><td>{ *wanted }</td>
                <td><button type="button" disabled={!may_set} onclick={press}
                    aria-label={format!("Take ${number} from the file")}>{ "Take" }</button></td></tr>
        }
    });
    html! {
        <div class="compared">
            <p>{ format!("{} settings of {name} are not those of the machine", differences.len()) }</p>
            <table><thead><tr><th>{ "Setting" }</th><th>{ "Machine" }</th><th>{ "File" }</th><th></th></tr></thead>
                <tbody>{ for rows }</tbody></table>
            <button type="button" disabled={!may_set || differences.is_empty()} onclick={set(all)}>
                { "Take all from the file" }</button>
        </div>
    }
}

#[cfg(test)]
mod tests {
    use std::rc::Rc;

    use super::*;

    #[test]
    fn a_file_is_compared_by_numbers_and_written_as_it_is_read() {
        let machine = values("$0=10\n$110=500.000\n$32=1\nok\n");
        let file = values("; a comment\n$110=500\r\n$32=0\n$999=1\n");
        assert_eq!(differences(&machine, &file), [(32, "1", "0")]);
        assert_eq!(values(&text(&machine)), machine);
    }

    #[test]
    fn a_machine_that_describes_its_settings_is_asked() {
        let mut model = Model::default();
        assert_eq!(description_question(&model, 14), None);
        let mut answer = |question: &str, line: &str| {
            let lines = Rc::new(vec![line.to_owned()]);
            model.answers.insert(question.into(), lines);
        };
        answer("$I+", "[NEWOPT:ENUMS,RT+,SED]");
        answer("$SED=14", "[SETTINGDESCR:14|Inverts pins.\\nOff: high]");
        assert_eq!(description_question(&model, 14), Some("$SED=14".into()));
        assert_eq!(
            described(&model, 14),
            Some("Inverts pins.\nOff: high".into())
        );
        assert_eq!(described(&model, 15), None);
    }

    #[test]
    fn what_a_sum_is_made_of_is_named() {
        let bits = Kind::Bits(["spindle", "N/A", "flood"].map(str::to_owned).to_vec());
        assert_eq!(summands(&bits), ["1 spindle", "4 flood"]);
        assert_eq!(summands(&Kind::Axes)[2], "4 Z");
        assert_eq!(summands(&Kind::Number).len(), 0);
    }

    #[test]
    fn the_machine_tells_of_its_settings_where_it_can() {
        let mut model = Model::default();
        assert_eq!(catalogue(&model), Catalogue::of_grbl());
        let answers = [
            ("$EG", "[SETTINGGROUP:1|0|General]"),
            ("$ES", "[SETTING:0|1|step pulse|µs|5|##0|3|255]"),
        ];
        for (question, line) in answers {
            model
                .answers
                .insert(question.into(), Rc::new(vec![line.into()]));
        }
        let catalogue = catalogue(&model);
        assert_eq!(catalogue.settings.len(), 1);
        assert_eq!(catalogue.by_group().next().unwrap().0, "General");
    }
}
