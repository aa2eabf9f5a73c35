//! A field for a value, which keeps what is being typed whatever the page is shown meanwhile.

use web_sys::HtmlInputElement;
use yew::prelude::*;

/// What a field has.
#[derive(PartialEq, Properties)]
pub struct FieldProperties {
    /// What the page finds it by.
    #[prop_or_default]
    pub id: Option<AttrValue>,
    /// What is read out for a field without a label.
    #[prop_or_default]
    pub aria_label: Option<AttrValue>,
    /// The value, as it is known.
    pub value: AttrValue,
    /// `number`, or anything else that a browser checks.
    #[prop_or("text".into())]
    pub kind: AttrValue,
    /// The least number.
    #[prop_or_default]
    pub min: Option<AttrValue>,
    /// Numbers are multiples of this one; `any` where all are allowed.
    #[prop_or_default]
    pub step: Option<AttrValue>,
    /// It takes nothing.
    #[prop_or_default]
    pub is_off: bool,
    /// Has the text when another value was typed, and the field is left.
    pub on_change: Callback<String>,
}

/// A field.
#[component]
pub fn Field(props: &FieldProperties) -> Html {
    // The framework puts the value into the field each time that the page is drawn, ten times a second where a machine moves.
    let draft = use_state(|| None::<AttrValue>);
    let shown = draft.as_ref().unwrap_or(&props.value).clone();
    let typed = {
        let draft = draft.clone();
        Callback::from(move |event: InputEvent| {
            let input = event.target_unchecked_into::<HtmlInputElement>();
            draft.set(Some(input.value().into()));
        })
    };
    let changed = props
        .on_change
        .reform(|event: Event| event.target_unchecked_into::<HtmlInputElement>().value());
    let left = Callback::from(move |_: FocusEvent| draft.set(None));
    html! {
        <input id={props.id.clone()} aria-label={props.aria_label.clone()} type={props.kind.clone()} min={props.min.clone()}
            step={props.step.clone()} disabled={props.is_off} value={shown} oninput={typed} onchange={changed}
            onblur={left} />
    }
}
