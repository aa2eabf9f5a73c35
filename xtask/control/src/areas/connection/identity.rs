//! What a machine is, and whether the page is for it.

use grbl_client::Line;
use yew::prelude::*;

use crate::{context::PageContext, model::Model};

/// What a machine is, as it answers to `$I`: its version with what its owner has added, and its options.
fn identity(model: &Model) -> Vec<String> {
    let answers = ["$I+", "$I"]
        .iter()
        .filter_map(|question| model.answers.get(*question));
    let Some(lines) = answers.into_iter().find(|lines| !lines.is_empty()) else {
        return Vec::new();
    };
    let welcome = model
        .welcome
        .split(" [")
        .next()
        .filter(|welcome| !welcome.is_empty());
    let parts = lines.iter().filter_map(|line| match Line::read(line) {
        Line::Answer("VER", version) => Some(format!("version {}", version.trim_end_matches(':'))),
        Line::Answer("OPT", options) => Some(format!("options {options}")),
        Line::Answer("NEWOPT", options) => Some(format!("and {options}")),
        Line::Answer("FIRMWARE" | "BOARD" | "DRIVER" | "MSG", text) => Some(text.to_owned()),
        _ => None,
    });
    welcome
        .map(str::to_owned)
        .into_iter()
        .chain(parts)
        .collect()
}

/// The number of Grbl in a text: `1.1` of `1.1h.20190830:`.
fn number_of_grbl(text: &str) -> Option<(u32, u32)> {
    let (major, rest) = text.trim().split_once('.')?;
    let minor: String = rest.chars().take_while(char::is_ascii_digit).collect();
    Some((major.parse().ok()?, minor.parse().ok()?))
}

/// What a page for Grbl 1.1 says of an older machine, or of one that is unknown.
fn warning(model: &Model) -> Option<String> {
    const NEEDED: (u32, u32) = (1, 1);
    let has = |question: &str| model.answers.get(question);
    let lines = ["$I+", "$I"].iter().filter_map(|question| has(question));
    let version = lines
        .flat_map(|lines| lines.iter())
        .find_map(|line| match Line::read(line) {
            Line::Answer("VER", version) => number_of_grbl(version),
            _ => None,
        });
    let greeting = { model.welcome.split_whitespace().nth(1) }.and_then(number_of_grbl);
    match version.or(greeting) {
        Some(number) if number < NEEDED => Some(format!(
            "The machine has Grbl {}.{}: this page needs 1.1 or later. Install newer firmware.",
            number.0, number.1
        )),
        _ if version.is_none() && has("$I").is_some() => Some(
            "The machine does not say what it is: this page needs Grbl 1.1, grblHAL, FluidNC or Leadscrew.".into(),
        ),
        _ => None,
    }
}

/// The question what a machine is that has to be asked now: the longer one first, which older machines do not know.
fn open_question(model: &Model) -> Option<&'static str> {
    let may_ask = model.may_operate()
        && !model.is_job_running()
        && matches!(model.state_name(), "Idle" | "Alarm");
    let is_asked = |question: &&str| model.unanswered.values().any(|asked| asked == *question);
    let is_known = |question: &str| model.answers.contains_key(question);
    let is_empty = || {
        model
            .answers
            .get("$I+")
            .is_some_and(|lines| lines.is_empty())
    };
    let question = match (is_known("$I+"), is_known("$I")) {
        (false, _) => Some("$I+"),
        (true, false) if is_empty() => Some("$I"),
        _ => None,
    };
    question.filter(|question| may_ask && !is_asked(question))
}

/// Asks a machine what it is: nothing moves by that.
#[hook]
pub(super) fn use_identity(context: &PageContext) {
    let asking = context.clone();
    use_effect_with(open_question(&context.model), move |question| {
        if let Some(question) = question {
            asking.line(question);
        }
    });
}

/// The machine in a fold, and what is wrong with it.
pub(super) fn about(context: &PageContext) -> Html {
    let model = &*context.model;
    if !model.is_there() {
        return Html::default();
    }
    let identity = identity(model);
    let lines = identity.iter().map(|line| html! { <li>{ line }</li> });
    html! {
        <>
            if let Some(warning) = warning(model) { <p id="too-old" role="alert">{ warning }</p> }
            if !identity.is_empty() {
                <details id="identity"><summary>{ "What it is" }</summary><ul>{ for lines }</ul></details>
            }
        </>
    }
}

#[cfg(test)]
mod tests {
    use std::rc::Rc;

    use super::*;
    use crate::model::Connection;

    fn answering(answers: &[(&str, &[&str])]) -> Model {
        let mut model = Model {
            connection: Connection::Open,
            ..Model::default()
        };
        model.machine.is_there = true;
        model.machine.state = "Alarm".into();
        for (question, lines) in answers {
            let lines = lines.iter().map(|line| (*line).to_owned()).collect();
            model.answers.insert((*question).into(), Rc::new(lines));
        }
        model
    }

    #[test]
    fn a_machine_is_asked_what_it_is_until_it_has_answered() {
        assert_eq!(open_question(&Model::default()), None);
        let mut model = answering(&[]);
        assert_eq!(open_question(&model), Some("$I+"));
        model.unanswered.insert(1, "$I+".into());
        assert_eq!(open_question(&model), None);
        model.machine.state = "Run".into();
        model.unanswered.clear();
        assert_eq!(open_question(&model), None);
        assert_eq!(open_question(&answering(&[("$I+", &[])])), Some("$I"));
        assert_eq!(
            open_question(&answering(&[("$I+", &[]), ("$I", &[])])),
            None
        );
        assert_eq!(
            open_question(&answering(&[("$I+", &["[VER:1.1h:]"])])),
            None
        );
    }

    #[test]
    fn a_machine_that_is_too_old_or_unknown_is_named() {
        let leadscrew =
            answering(&[("$I+", &["[VER:1.1h.20190830:my mill]", "[OPT:VM,100,1024]"])]);
        assert_eq!(warning(&leadscrew), None);
        assert_eq!(
            identity(&leadscrew),
            ["version 1.1h.20190830:my mill", "options VM,100,1024"]
        );
        let unknown = answering(&[("$I+", &[]), ("$I", &[])]);
        assert!(warning(&unknown).is_some_and(|text| text.contains("does not say")));
        let mut old = answering(&[("$I+", &[]), ("$I", &["[0.9j.20160317:]"])]);
        assert!(warning(&old).is_some_and(|text| text.contains("does not say")));
        old.welcome = "Grbl 0.9j ['$' for help]".into();
        assert!(warning(&old).is_some_and(|text| text.contains("Grbl 0.9:")));
        old.welcome = "Grbl 3.7 [FluidNC v3.7.8 (esp32) '$' for help]".into();
        old.answers.insert(
            "$I".into(),
            Rc::new(vec!["[VER:3.7 FluidNC v3.7.8:]".into()]),
        );
        assert_eq!(warning(&old), None);
        assert_eq!(warning(&answering(&[])), None);
    }
}
