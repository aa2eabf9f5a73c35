//! The check: what the program will do, before it does it.

use std::rc::Rc;

use common::text::{duration, separated};
use gloo_timers::callback::Timeout;
use simulation::{RefusalRow, rehearsal::Range};
use yew::prelude::*;

use crate::{
    areas::{
        entry::StartAtLine,
        setup::{RetractedMove, lift_line},
        view::ViewArea,
    },
    checker::{AxisExtent, Findings},
    context::{PageContext, use_page_context},
    link::ToChecker,
    model::{Action, Check, CheckBasis, Checked, Model, Program, Purpose},
};

/// How long nothing may have changed before a check begins by itself, ms.
const QUIET_MS: u32 = 800;
/// What lies outside by less is rounding, mm.
const LEAST_MM: f64 = 0.001;
/// How fast the outline is shown, mm/min.
const OUTLINE_FEED: f64 = 2000.0;

/// How far an axis is moved beyond its travel below and above, mm or degrees: of a machine that was not homed the size
/// alone counts.
fn outside(axis: &AxisExtent, is_homed: bool) -> Option<Range> {
    let [low, high] = axis.certain;
    let [lowest, highest] = axis.travel?;
    let beyond = if is_homed {
        [lowest - low, high - highest].map(|beyond| beyond.max(0.0))
    } else {
        [0.0, (high - low - (highest - lowest)).max(0.0)]
    };
    beyond.iter().any(|it| *it > LEAST_MM).then_some(beyond)
}

/// What lies outside the travel, a sentence for each axis.
fn outside_words(findings: &Findings, is_homed: bool) -> Vec<String> {
    let axes = findings.extents_mm.iter();
    let words = axes.filter_map(|axis| {
        let letter = axis.letter;
        let [below, above] = outside(axis, is_homed)?;
        if !is_homed {
            return Some(format!("{letter} needs {above:.3} mm more than its travel"));
        }
        let ends = [(below, "below the lower"), (above, "above the upper")];
        let ends = ends.iter().filter(|(beyond, _)| *beyond > LEAST_MM);
        let ends: Vec<_> = ends
            .map(|(beyond, end)| format!("{beyond:.3} mm {end} end of its travel"))
            .collect();
        Some(format!("{letter} goes {}", ends.join(" and ")))
    });
    words.collect()
}

/// Lines, in words.
fn lines_words(count: usize) -> String {
    match count {
        1 => "1 line is refused".into(),
        count => format!("{} lines are refused", separated(count as u64)),
    }
}

/// What stands between the operator and a job that does what it should: refusals, an alarm, too little travel.
pub(crate) fn stands_between(model: &Model) -> Vec<String> {
    let Some(checked) = model.valid_check() else {
        return Vec::new();
    };
    let count = checked.refused_count;
    let refused = (count > 0).then(|| {
        let words = lines_words(count);
        format!("{words}, and the job stops at the first of them")
    });
    let outside = outside_words(checked, model.machine.homed.is_some());
    let alarm = checked.alarm.clone();
    refused.into_iter().chain(alarm).chain(outside).collect()
}

/// Whether the job may not be started yet: something stands between, or the machine is being asked.
pub(crate) fn is_barred(model: &Model) -> bool {
    let is_asked = model.plan.asked.is_some();
    is_asked || !model.plan.is_permitted && !stands_between(model).is_empty()
}

/// Whether the program was checked, in a sentence.
fn standing(model: &Model) -> Option<&'static str> {
    model.program.as_ref()?;
    match (&model.check, model.checked(), model.valid_check()) {
        (Check::Running { .. }, ..) => Some("The program is being checked."),
        (.., Some(_)) => None,
        (_, Some(_), _) => {
            Some("Since the check the zero, the modes or the settings have changed: check again.")
        }
        _ => Some("The program is not checked."),
    }
}

/// What is to be read beside the button that starts the job, and the consent to what stands between.
#[component]
pub fn BeforeRun() -> Html {
    let context = use_page_context();
    let model = &*context.model;
    let between = stands_between(model);
    let permit = {
        let context = context.clone();
        Callback::from(move |event: Event| {
            let input = event.target_unchecked_into::<web_sys::HtmlInputElement>();
            context.model.dispatch(Action::Permit(input.checked()));
        })
    };
    html! {
        <>
            if let Some(text) = standing(model) { <p class="hint" id="standing">{ text }</p> }
            if !between.is_empty() {
                <ul id="between" class="bad">{ for between.iter().map(|text| html! { <li>{ text }</li> }) }</ul>
                <label><input id="permit" type="checkbox" checked={model.plan.is_permitted} onchange={permit} />
                    { " run all the same" }</label>
            }
        </>
    }
}

/// Begins a check: of an idle machine, or of the virtual one where there is none.
fn begin(context: &PageContext, purpose: Purpose) {
    context.model.dispatch(Action::Ask(purpose));
    if context.model.is_there() {
        for question in context.model.questions() {
            context.line(question);
        }
    }
}

/// Hands what is known to the checker.
#[hook]
fn use_checker(context: &PageContext) {
    let checker = {
        let dispatcher = context.model.dispatcher();
        let start = context.start.clone();
        use_memo((), move |()| {
            let replies =
                Callback::from(move |reply| dispatcher.dispatch(Action::CheckReply(reply)));
            ToChecker::new(&start.module, &start.worker_address, replies)
        })
    };
    let context = context.clone();
    use_effect(move || {
        if let Some((pending_check, request)) = context.model.pending_check() {
            context
                .model
                .dispatch(Action::BeginCheck(Box::new(pending_check)));
            checker.request(&request);
        }
    });
}

/// Begins a check by itself: of a program that has been opened, and again when the machine is another one.
#[hook]
fn use_automatic_check(context: &PageContext) {
    let model = &context.model;
    let basis = CheckBasis::of(model);
    let is_wanted = model.may_ask() && !model.is_checking() && model.valid_check().is_none();
    let program = model.program.clone().filter(|_| is_wanted);
    let tried = use_mut_ref(|| None::<(Rc<Program>, CheckBasis)>);
    let latest = use_mut_ref(|| context.clone());
    *latest.borrow_mut() = context.clone();
    use_effect_with((program, basis), move |(program, basis)| {
        let is_known = tried.borrow().as_ref().is_some_and(|(known, at)| {
            program.as_ref().is_some_and(|it| Rc::ptr_eq(it, known)) && at.is_same(basis)
        });
        let wanted = program.clone().filter(|_| !is_known);
        let timer = wanted.map(|program| {
            let basis = basis.clone();
            Timeout::new(QUIET_MS, move || {
                let context = latest.borrow().clone();
                if context.model.may_ask() && !context.model.is_checking() {
                    *tried.borrow_mut() = Some((program, basis));
                    begin(&context, Purpose::Check);
                }
            })
        });
        move || drop(timer)
    });
}

/// The check.
#[component]
pub fn CheckArea() -> Html {
    let context = use_page_context();
    use_checker(&context);
    use_automatic_check(&context);
    let model = &*context.model;
    let may_check =
        model.program.is_some() && !model.is_checking() && (model.may_ask() || !model.is_there());
    let check = {
        let context = context.clone();
        Callback::from(move |_: MouseEvent| begin(&context, Purpose::Check))
    };
    let find = {
        let context = context.clone();
        Callback::from(move |line: usize| begin(&context, Purpose::Enter(line)))
    };
    html! {
        <section class="check" aria-label="Check">
            <h2>{ "Check" }</h2>
            <button id="check" type="button" disabled={!may_check} onclick={check}>{ "Check" }</button>
            { shown(&context) }
            <StartAtLine on_find={find} />
        </section>
    }
}

/// The check, as far as it is.
fn shown(context: &PageContext) -> Html {
    let model = &*context.model;
    match (&model.check, model.checked()) {
        (Check::Running { part }, _) => html! {
            <progress max="1" value={part.to_string()} aria-label="Part of the check"></progress>
        },
        (Check::Failed(reason), _) => html! { <p id="check-failed" role="alert">{ reason }</p> },
        (_, Some(checked)) => html! { <Outcome checked={Rc::clone(checked)} /> },
        (_, None) => html! {
            <p class="hint">{ "The program runs in advance on a virtual machine that stands as yours does: with its \
                settings, zeros, tools and position." }</p>
        },
    }
}

/// The path of a program that was checked.
#[component]
pub fn CheckedView() -> Html {
    let context = use_page_context();
    let model = &*context.model;
    let checked = model.checked().filter(|checked| !checked.view.is_empty());
    html! {
        if let Some(checked) = checked {
            <ViewArea page={Rc::clone(&checked.view)} executed={model.executed_line()} />
        }
    }
}

/// What the check has found.
#[derive(Clone, PartialEq, Properties)]
struct OutcomeProperties {
    checked: Rc<Checked>,
}

#[component]
fn Outcome(properties: &OutcomeProperties) -> Html {
    let context = use_page_context();
    let model = &*context.model;
    let checked = &*properties.checked;
    let is_homed = model.machine.homed.is_some();
    let outside = outside_words(checked, is_homed);
    let tools = tool_words(&checked.tools);
    let is_valid = model.valid_check().is_some();
    html! {
        <div id="checked">
            if checked.machine.is_none() {
                <p class="hint">{ "No machine was connected: this is the virtual machine with its own settings." }</p>
            }
            if let Some(alarm) = &checked.alarm { <p class="bad" role="alert">{ alarm }</p> }
            { for checked.warnings.iter().map(|text| html! { <p class="hint">{ text }</p> }) }
            if let Some(time_s) = checked.time_s {
                <p id="check-time"><strong>{ duration(time_s) }</strong>{ format!(": {}", checked.times) }</p>
            }
            <p id="check-tools">{ tools }</p>
            { refusals(&context, checked) }
            { extents(checked, is_homed) }
            { for outside.iter().map(|text| html! { <p class="bad">{ text }</p> }) }
            if !is_homed && !checked.extents_mm.is_empty() {
                <p class="hint">{ "The machine was not homed, so where it stands is not known: the sizes alone are \
                    compared." }</p>
            }
            if !checked.cut_mm.is_empty() && checked.machine.is_some() {
                <RetractedMove name="Outline" lines={outline_lines(model, checked)} may_go={model.may_jog() && is_valid} />
            }
        </div>
    }
}

/// The tools, each with its first line.
fn tool_words(tools: &[(u8, u64)]) -> String {
    let named = tools.iter().filter(|(tool, _)| *tool > 0);
    let words: Vec<_> = named
        .map(|(tool, line)| format!("T{tool} from line {line}"))
        .collect();
    if words.is_empty() {
        "No tool is named: the one in the spindle is used.".into()
    } else {
        format!("Tools: {}", words.join(", "))
    }
}

/// The lines that are refused, by cause.
fn refusals(context: &PageContext, checked: &Checked) -> Html {
    if checked.causes.is_empty() {
        let lines = separated(checked.lines as u64);
        return html! { <p id="accepted">{ format!("No line is refused, of {lines}.") }</p> };
    }
    let rows = checked.causes.iter().map(|cause| {
        let RefusalRow { count, what, why, answer, first } = cause;
        let (context, line) = (context.clone(), *first as usize);
        let go = Callback::from(move |_: MouseEvent| context.go_to(line));
        html! {
            <tr><td>{ separated(*count) }</td><td>{ what }</td><td>{ why }</td><td>{ answer }</td>
                <td><button type="button" onclick={go} aria-label={format!("Go to line {first}")}>{ *first }</button></td></tr>
        }
    });
    html! {
        <>
            <p class="bad">{ format!("{}:", lines_words(checked.refused_count)) }</p>
            <table id="refusals" tabindex="0" aria-label="Refused lines"><thead><tr><th scope="col">{ "Lines" }</th><th scope="col">{ "What" }</th>
                <th scope="col">{ "Why, and what to do" }</th><th scope="col">{ "Answer" }</th>
                <th scope="col">{ "First" }</th></tr></thead><tbody>{ for rows }</tbody></table>
        </>
    }
}

/// How far the axes go, beside their travel.
fn extents(checked: &Checked, is_homed: bool) -> Html {
    let range = |range: &Range| format!("{:.3} to {:.3}", range[0], range[1]);
    let rows = checked.extents_mm.iter().map(|axis| {
        let is_outside = outside(axis, is_homed).is_some();
        let travel = axis.travel.as_ref().map_or_else(|| "no ends".into(), range);
        html! {
            <tr class={classes!(is_outside.then_some("bad"))}><th scope="row">{ axis.letter }</th>
                <td>{ range(&axis.work) }</td><td>{ range(&axis.machine) }</td><td>{ travel }</td></tr>
        }
    });
    html! {
        if !checked.extents_mm.is_empty() {
            <table id="extents" tabindex="0" aria-label="Extents"><thead><tr><th scope="col">{ "Axis" }</th><th scope="col">{ "Work, mm" }</th>
                <th scope="col">{ "Machine, mm" }</th><th scope="col">{ "Travel, mm" }</th></tr></thead>
                <tbody>{ for rows }</tbody></table>
        }
    }
}

/// The lines that show the extents of the cut in the air: jogs, which change no mode and end with a jog's cancel.
fn outline_lines(model: &Model, findings: &Findings) -> Vec<String> {
    let [[left, right], [front, back], _] = findings.cut_mm[..] else {
        return Vec::new();
    };
    let corners = [
        [left, front],
        [right, front],
        [right, back],
        [left, back],
        [left, front],
    ];
    let corners = corners.map(|[x, y]| format!("$J=G53G90G21X{x:.3}Y{y:.3}F{OUTLINE_FEED:.0}"));
    lift_line(model).into_iter().chain(corners).collect()
}

#[cfg(test)]
mod tests {
    use super::*;

    fn axis(letter: char, certain: Range) -> AxisExtent {
        AxisExtent {
            letter,
            machine: certain,
            work: certain,
            certain,
            travel: Some([-200.0, 0.0]),
        }
    }

    #[test]
    fn what_lies_outside_is_told_by_axis() {
        let findings = Findings {
            extents_mm: vec![
                axis('X', [-190.0, -10.0]),
                axis('Y', [-210.5, 3.0]),
                axis('Z', [-20.0, 0.0004]),
            ],
            ..Findings::default()
        };
        let expected = "Y goes 10.500 mm below the lower end of its travel and 3.000 mm above the upper end of its travel";
        assert_eq!(outside_words(&findings, true), [expected]);
        // Where it stands is not known.
        let expected = "Y needs 13.500 mm more than its travel";
        assert_eq!(outside_words(&findings, false), [expected]);
        assert_eq!(outside_words(&Findings::default(), true), [""; 0]);
    }

    #[test]
    fn tools_are_named_with_their_lines() {
        assert_eq!(tool_words(&[(0, 1), (2, 3)]), "Tools: T2 from line 3");
        assert!(tool_words(&[(0, 1)]).starts_with("No tool is named"));
    }

    #[test]
    fn the_outline_goes_around_at_the_top() {
        let findings = Findings {
            cut_mm: vec![[-50.0, -40.0], [-60.0, -30.0], [-41.0, -30.0]],
            ..Findings::default()
        };
        let mut model = Model::default();
        model.machine.homed = Some(vec![-1.0, -1.0, -1.0]);
        model.machine.machine = vec![0.0, 0.0, -30.0];
        let lines = outline_lines(&model, &findings);
        assert_eq!(lines[0], "$J=G53G90G21Z-1.000F10000");
        assert_eq!(lines[1], "$J=G53G90G21X-50.000Y-60.000F2000");
        assert_eq!((lines.len(), &lines[1]), (6, &lines[5]));
        assert_eq!(outline_lines(&model, &Findings::default()), [""; 0]);
    }
}
