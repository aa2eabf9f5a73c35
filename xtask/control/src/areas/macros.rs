//! Macros: named lines, which may ask for values before they run.

use std::collections::BTreeMap;

use gloo_events::EventListener;
use serde::{Deserialize, Serialize};
use wasm_bindgen::JsCast as _;
use wasm_bindgen_futures::{JsFuture, spawn_local};
use web_sys::{Element, HtmlInputElement, HtmlTextAreaElement};
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
    /// The key that runs it, as browsers name keys; empty without.
    #[serde(default)]
    key: String,
}

/// Where keys have a meaning of their own.
const FIELDS: &str = "input, select, textarea, summary, #pad";

/// A key as it is kept, if a macro may have it: a letter, a digit, a sign, or one of the keys with F that are free.
fn usable_key(key: &str) -> Option<String> {
    let is_sign = key.chars().count() == 1
        && key
            .chars()
            .all(|sign| !sign.is_whitespace() && !sign.is_control());
    let is_free = matches!(key, "F2" | "F3" | "F4" | "F6" | "F7" | "F8" | "F9" | "F10");
    (is_sign || is_free).then(|| key.to_uppercase())
}

/// The macro of a key.
fn of_key<'a>(macros: &'a [Macro], key: &str) -> Option<&'a Macro> {
    let key = usable_key(key)?;
    macros.iter().find(|which| which.key == key)
}

/// The macros with another one, in place of the one that has its name; a key belongs to the last that wants it.
fn with(macros: &[Macro], added: Macro) -> Vec<Macro> {
    let mut changed = macros.to_vec();
    for other in &mut changed {
        if other.key == added.key {
            other.key.clear();
        }
    }
    match changed.iter_mut().find(|other| other.name == added.name) {
        Some(same) => *same = added,
        None => changed.push(added),
    }
    changed
}

/// Has a callback do something at each key that is pressed beside the fields, alone and anew.
#[hook]
fn use_keys(on_key: Callback<String, bool>) {
    let latest = use_mut_ref(|| on_key.clone());
    *latest.borrow_mut() = on_key;
    use_effect_with((), move |()| {
        let document = web_sys::window().and_then(|window| window.document());
        let options = gloo_events::EventListenerOptions::enable_prevent_default();
        let listener = document.map(|document| {
            EventListener::new_with_options(&document, "keydown", options, move |event| {
                let event: &KeyboardEvent = event.unchecked_ref();
                let target = event.target().and_then(|it| it.dyn_into::<Element>().ok());
                let is_in_field =
                    target.is_some_and(|it| it.closest(FIELDS).ok().flatten().is_some());
                let is_with_other =
                    event.ctrl_key() || event.alt_key() || event.meta_key() || event.repeat();
                if !is_in_field && !is_with_other && latest.borrow().emit(event.key()) {
                    event.prevent_default();
                }
            })
        });
        move || drop(listener)
    });
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
    let begin = {
        let (run, asked) = (run.clone(), asked.clone());
        move |which: &Macro| {
            let wanted: BTreeMap<_, _> = parameters(&which.text).into_iter().collect();
            if wanted.is_empty() {
                run(which, &wanted);
            } else {
                asked.set(Some((which.clone(), wanted)));
            }
        }
    };
    let by_key = {
        let (macros, begin) = (macros.clone(), begin.clone());
        Callback::from(move |key: String| {
            let which = of_key(&macros, &key).filter(|_| may_run);
            which.inspect(|which| begin(which)).is_some()
        })
    };
    use_keys(by_key);
    let rows = macros.iter().enumerate().map(|(index, which)| {
        let press = {
            let (which, begin) = (which.clone(), begin.clone());
            Callback::from(move |_: MouseEvent| begin(&which))
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
            <li><button type="button" disabled={!may_run} onclick={press}
                aria-keyshortcuts={(!which.key.is_empty()).then(|| which.key.clone())}>{ &which.name }
                    if !which.key.is_empty() { <kbd>{ &which.key }</kbd> }</button>
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
            keep(with(&macros, (*edited).clone()));
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
    let keyed = {
        let edited = edited.clone();
        Callback::from(move |event: KeyboardEvent| {
            let key = match event.key().as_str() {
                "Backspace" | "Delete" => String::new(),
                key => match usable_key(key) {
                    Some(key) => key,
                    None => return,
                },
            };
            event.prevent_default();
            edited.set(Macro {
                key,
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
                    <label>{ "Key, if it is to have one " }<input id="macro-key" autocomplete="off" readonly=true
                        value={edited.key.clone()} onkeydown={keyed} placeholder="press it" /></label>
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
    fn a_key_belongs_to_one_macro_and_to_the_file() {
        let named = |name: &str, key: &str| Macro {
            name: name.into(),
            key: key.into(),
            ..Macro::default()
        };
        let macros = with(&with(&[], named("lift", "L")), named("park", "L"));
        assert_eq!(macros, [named("lift", ""), named("park", "L")]);
        assert_eq!(
            of_key(&macros, "l").map(|which| which.name.as_str()),
            Some("park")
        );
        assert_eq!(of_key(&macros, "Enter"), None);
        let changed = with(&macros, named("lift", "F2"));
        assert_eq!(changed, [named("lift", "F2"), named("park", "L")]);
        let text = serde_json::to_string(&changed).unwrap();
        assert_eq!(serde_json::from_str::<Vec<Macro>>(&text).unwrap(), changed);
        // A file of older pages has no keys.
        let old = r#"[{"name":"lift","text":""}]"#;
        assert_eq!(
            serde_json::from_str::<Vec<Macro>>(old).unwrap(),
            [named("lift", "")]
        );
    }

    #[test]
    fn keys_with_a_meaning_are_left_alone() {
        for key in [
            "Tab", "Enter", " ", "Escape", "ArrowUp", "PageUp", "F5", "F11", "Shift",
        ] {
            assert_eq!(usable_key(key), None, "{key}");
        }
        assert_eq!(usable_key("a"), Some("A".into()));
        assert_eq!(usable_key("F9"), Some("F9".into()));
    }

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
