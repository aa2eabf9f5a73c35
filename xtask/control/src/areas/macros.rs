//! Macros: named lines, which may ask for values before they run.

use std::collections::BTreeMap;

use serde::{Deserialize, Serialize};
use wasm_bindgen_futures::{JsFuture, spawn_local};
use web_sys::{HtmlInputElement, HtmlTextAreaElement};
use yew::prelude::*;

use crate::{context::use_page_context, storage};

/// Under which name they are kept, and the name of their file.
const KEPT: &str = "macros";
const FILE: &str = "macros.json";

/// A macro.
#[derive(Debug, Clone, Default, PartialEq, Serialize, Deserialize)]
struct Macro {
    name: String,
    /// Its lines; `{depth}` and `{depth=2}` are asked for.
    text: String,
}

/// The values that a text asks for, in order, with what is usual.
fn parameters(text: &str) -> Vec<(String, String)> {
    let mut found: Vec<(String, String)> = Vec::new();
    for part in text.split('{').skip(1) {
        let Some((inside, _)) = part.split_once('}') else {
            continue;
        };
        let (name, usual) = inside.split_once('=').unwrap_or((inside, ""));
        let name = name.trim();
        if !name.is_empty() && found.iter().all(|(known, _)| known != name) {
            found.push((name.into(), usual.trim().into()));
        }
    }
    found
}

/// The lines with values in place of what was asked for; an error where one is missing.
fn filled(text: &str, values: &BTreeMap<String, String>) -> Result<Vec<String>, String> {
    let mut parts = text.split('{');
    let mut filled = parts.next().unwrap_or_default().to_owned();
    for part in parts {
        let Some((inside, rest)) = part.split_once('}') else {
            return Err("a { has no }".into());
        };
        let (name, usual) = inside.split_once('=').unwrap_or((inside, ""));
        let value = values.get(name.trim()).map_or(usual, String::as_str).trim();
        if value.is_empty() || value.contains(['\n', '\r', '{']) {
            return Err(format!("{} needs a value", name.trim()));
        }
        filled.push_str(value);
        filled.push_str(rest);
    }
    let lines = filled
        .lines()
        .map(str::trim)
        .filter(|line| !line.is_empty());
    Ok(lines.map(str::to_owned).collect())
}

/// Macros.
#[component]
pub fn MacroArea() -> Html {
    let context = use_page_context();
    let macros = use_state(|| storage::load::<Vec<Macro>>(KEPT).unwrap_or_default());
    let edited = use_state(Macro::default);
    let asked = use_state(|| None::<(Macro, BTreeMap<String, String>)>);
    let fault = use_state(String::new);
    let keep = {
        let macros = macros.clone();
        move |changed: Vec<Macro>| {
            storage::keep(KEPT, &changed);
            macros.set(changed);
        }
    };
    let may_run = context.model.takes_lines();
    let run = {
        let (context, asked, fault) = (context.clone(), asked.clone(), fault.clone());
        move |which: &Macro, values: &BTreeMap<String, String>| match filled(&which.text, values) {
            Ok(lines) => {
                fault.set(String::new());
                asked.set(None);
                for line in &lines {
                    context.line(line);
                }
            }
            Err(wrong) => fault.set(wrong),
        }
    };
    let rows = macros.iter().enumerate().map(|(index, which)| {
        let press = {
            let (which, run, asked) = (which.clone(), run.clone(), asked.clone());
            Callback::from(move |_: MouseEvent| {
                let wanted: BTreeMap<_, _> = parameters(&which.text).into_iter().collect();
                if wanted.is_empty() {
                    run(&which, &wanted);
                } else {
                    asked.set(Some((which.clone(), wanted)));
                }
            })
        };
        let edit = {
            let (which, edited) = (which.clone(), edited.clone());
            Callback::from(move |_: MouseEvent| edited.set(which.clone()))
        };
        let remove = {
            let (macros, keep) = (macros.clone(), keep.clone());
            Callback::from(move |_: MouseEvent| {
                let mut changed = (*macros).clone();
                changed.remove(index);
                keep(changed);
            })
        };
        html! {
            <li><button type="button" disabled={!may_run} onclick={press}>{ &which.name }</button>
                <button type="button" onclick={edit} aria-label={format!("Edit {}", which.name)}>{ "Edit" }</button>
                <button type="button" onclick={remove} aria-label={format!("Remove {}", which.name)}>{ "Remove" }</button></li>
        }
    });
    let save = {
        let (macros, edited, keep) = (macros.clone(), edited.clone(), keep.clone());
        Callback::from(move |event: SubmitEvent| {
            event.prevent_default();
            if edited.name.trim().is_empty() {
                return;
            }
            let mut changed = (*macros).clone();
            changed.retain(|it| it.name != edited.name);
            changed.push((*edited).clone());
            keep(changed);
            edited.set(Macro::default());
        })
    };
    let named = {
        let edited = edited.clone();
        Callback::from(move |event: InputEvent| {
            let name = event.target_unchecked_into::<HtmlInputElement>().value();
            edited.set(Macro {
                name,
                ..(*edited).clone()
            });
        })
    };
    let written = {
        let edited = edited.clone();
        Callback::from(move |event: InputEvent| {
            let text = event.target_unchecked_into::<HtmlTextAreaElement>().value();
            edited.set(Macro {
                text,
                ..(*edited).clone()
            });
        })
    };
    let export = {
        let macros = macros.clone();
        Callback::from(move |_: MouseEvent| {
            storage::save_file(
                FILE,
                &serde_json::to_string_pretty(&*macros).unwrap_or_default(),
            );
        })
    };
    let import = {
        let (keep, fault) = (keep.clone(), fault.clone());
        Callback::from(move |event: Event| {
            let input = event.target_unchecked_into::<HtmlInputElement>();
            let Some(file) = input.files().and_then(|files| files.get(0)) else {
                return;
            };
            let (keep, fault) = (keep.clone(), fault.clone());
            spawn_local(async move {
                let text = JsFuture::from(file.text())
                    .await
                    .ok()
                    .and_then(|text| text.as_string());
                match serde_json::from_str(&text.unwrap_or_default()) {
                    Ok(read) => keep(read),
                    Err(error) => fault.set(format!("{} has no macros: {error}", file.name())),
                }
            });
            input.set_value("");
        })
    };
    html! {
        <section class="macros" aria-label="Macros">
            <h2>{ "Macros" }</h2>
            <ul>{ for rows }</ul>
            if let Some((which, values)) = &*asked { { questions(which, values, &asked, &run) } }
            if !fault.is_empty() { <p role="alert">{ &*fault }</p> }
            <details><summary>{ "Write one" }</summary>
                <form onsubmit={save}>
                    <label>{ "Name " }<input id="macro-name" value={edited.name.clone()} oninput={named} /></label>
                    <label>{ "Lines; {depth} or {depth=2} is asked for" }<textarea id="macro-text" rows="4"
                        spellcheck="false" value={edited.text.clone()} oninput={written} /></label>
                    <button>{ "Keep" }</button>
                </form>
                <button type="button" disabled={macros.is_empty()} onclick={export}>{ "Save as file" }</button>
                <label>{ "Load a file " }<input type="file" accept=".json" onchange={import} /></label>
            </details>
        </section>
    }
}

type Asked = UseStateHandle<Option<(Macro, BTreeMap<String, String>)>>;

/// The values that a macro asks for before it runs.
fn questions(
    which: &Macro,
    values: &BTreeMap<String, String>,
    asked: &Asked,
    run: &(impl Fn(&Macro, &BTreeMap<String, String>) + Clone + 'static),
) -> Html {
    let fields = parameters(&which.text).into_iter().map(|(name, _)| {
        let value = values.get(&name).cloned().unwrap_or_default();
        let typed = {
            let (which, values, asked, name) =
                (which.clone(), values.clone(), asked.clone(), name.clone());
            Callback::from(move |event: InputEvent| {
                let value = event.target_unchecked_into::<HtmlInputElement>().value();
                let mut changed = values.clone();
                changed.insert(name.clone(), value);
                asked.set(Some((which.clone(), changed)));
            })
        };
        html! { <label>{ format!("{name} ") }<input {value} oninput={typed} /></label> }
    });
    let submit = {
        let (which, values, run) = (which.clone(), values.clone(), run.clone());
        Callback::from(move |event: SubmitEvent| {
            event.prevent_default();
            run(&which, &values);
        })
    };
    html! { <form onsubmit={submit}><p>{ format!("{} asks for", which.name) }</p>{ for fields }<button>{ "Run" }</button></form> }
}

#[cfg(test)]
mod tests {
    use super::*;

    #[test]
    fn values_are_asked_for_once_and_filled_in() {
        let text = "G91 G0 Z{lift=5}\nG1 X{way} F{feed=100}\n\n G0 Z-{lift}";
        let asked = parameters(text);
        let names: Vec<_> = asked
            .iter()
            .map(|(name, usual)| (name.as_str(), usual.as_str()))
            .collect();
        assert_eq!(names, [("lift", "5"), ("way", ""), ("feed", "100")]);
        let mut values: BTreeMap<_, _> = asked.into_iter().collect();
        assert_eq!(filled(text, &values), Err("way needs a value".into()));
        values.insert("way".into(), "-3".into());
        let lines = ["G91 G0 Z5", "G1 X-3 F100", "G0 Z-5"]
            .map(str::to_owned)
            .to_vec();
        assert_eq!(filled(text, &values), Ok(lines));
        values.insert("way".into(), "1\nM3".into());
        assert!(filled(text, &values).is_err());
        assert!(filled("G0 {", &values).is_err());
        assert_eq!(parameters("G0 X1"), []);
    }
}
