//! Probing: what is probed, how, and the motion before it begins.

use grbl_client::client::{Command, Probing, Target};
use serde::{Deserialize, Serialize};
use web_sys::{HtmlInputElement, HtmlSelectElement};
use yew::prelude::*;

use crate::{
    areas::field::Field,
    context::use_page_context,
    model::{Action, Model},
    storage,
};

/// Under which name the form is kept.
const KEPT: &str = "probing";

/// What can be probed, with the name of each in the form.
const TARGETS: [(&str, &str); 8] = [
    ("top", "Z: workpiece or plate"),
    ("corner-top", "Corner outside, with Z"),
    ("corner", "Corner outside"),
    ("inside", "Corner inside"),
    ("hole", "Centre of a hole"),
    ("boss", "Centre of a boss"),
    ("reference", "Reference tool"),
    ("tool", "Tool length"),
];
/// The lengths of the form and the feed.
const FIELDS: [(&str, &str); 7] = [
    ("diameter", "Tool diameter, mm"),
    ("plate", "Plate thickness, mm"),
    ("search", "Search, mm"),
    ("retract", "Retract, mm"),
    ("beside", "To beside it, mm"),
    ("depth", "Depth of sides, mm"),
    ("feed", "Feed, mm/min"),
];

/// The form.
#[derive(Debug, Clone, PartialEq, Serialize, Deserialize)]
struct ProbingForm {
    target: String,
    /// On which side of the corner the workpiece is, of X and of Y.
    side: [i8; 2],
    values: [f64; 7],
}

impl Default for ProbingForm {
    fn default() -> Self {
        Self {
            target: TARGETS[0].0.into(),
            side: [1, 1],
            values: [3.0, 0.0, 10.0, 2.0, 15.0, 5.0, 100.0],
        }
    }
}

impl ProbingForm {
    /// What the client is asked for.
    fn probing(&self, reference_mm: Option<f64>) -> Probing {
        let side = self.side;
        let target = match self.target.as_str() {
            "corner-top" => Target::CornerOutside {
                side,
                with_top: true,
            },
            "corner" => Target::CornerOutside {
                side,
                with_top: false,
            },
            "inside" => Target::CornerInside {
                side: side.map(|side| -side),
            },
            "hole" => Target::Hole,
            "boss" => Target::Boss,
            "reference" => Target::ToolLength { reference_mm: None },
            "tool" => Target::ToolLength { reference_mm },
            _ => Target::Top,
        };
        let [diameter, plate, search, retract, beside, depth, feed] = self.values;
        Probing {
            target,
            diameter,
            plate,
            search,
            retract,
            beside,
            depth,
            feed,
        }
    }

    /// Whether a field counts for what is probed.
    fn counts(&self, field: &str) -> bool {
        let is = |targets: &[&str]| targets.contains(&self.target.as_str());
        match field {
            "diameter" => !is(&["top", "reference", "tool"]),
            "plate" => is(&["top", "corner-top"]),
            "beside" | "depth" => is(&["corner-top", "corner", "boss"]),
            "side" => is(&["corner-top", "corner", "inside"]),
            _ => true,
        }
    }
}

/// What stands between the operator and the cycle.
fn obstacle(model: &Model, form: &ProbingForm) -> Option<String> {
    let text = if !model.is_there() {
        "connect to a machine first"
    } else if model.is_watching() {
        "another page controls the machine: take control first"
    } else if model.state_name() != "Idle" || model.is_job_running() {
        "the machine has to be idle first"
    } else if model.machine.accessories.contains(['S', 'C']) {
        "the spindle turns: stop it first"
    } else if model.machine.pins.contains('P') {
        "the probe is closed already: move it off the contact, or look at its wires"
    } else if !model.is_probe_checked {
        "touch the tool with the plate once, by hand: the page has not seen the probe close and open yet"
    } else if form.target == "tool" && model.machine.reference_mm.is_none() {
        "measure the reference tool first"
    } else {
        return form.probing(model.machine.reference_mm).fault();
    };
    Some(text.into())
}

/// The motion in words: how far the tool may come to each side.
fn extents(places: &[[f64; 3]]) -> String {
    let parts = ["X", "Y", "Z"]
        .iter()
        .enumerate()
        .filter_map(|(axis, letter)| {
            let values = places.iter().map(|place| place[axis]);
            let (low, high) = values.fold((0.0_f64, 0.0_f64), |(low, high), value| {
                (low.min(value), high.max(value))
            });
            (low < high).then(|| format!("{letter} {low:+.1} to {high:+.1}"))
        });
    format!("{} mm from here", parts.collect::<Vec<_>>().join(", "))
}

/// The motion as a picture: X and Y from above, or X and Z where Y stands.
fn picture(places: &[[f64; 3]]) -> Html {
    let stands = |axis: usize| places.iter().all(|place| place[axis] == 0.0);
    let up = if stands(1) { 2 } else { 1 };
    let most = places
        .iter()
        .flatten()
        .fold(1.0_f64, |most, value| most.max(value.abs()));
    let point = |place: &[f64; 3]| {
        format!(
            "{:.1},{:.1}",
            50.0 + 45.0 * place[0] / most,
            50.0 - 45.0 * place[up] / most
        )
    };
    let points: Vec<_> = places.iter().map(point).collect();
    html! {
        <svg viewBox="0 0 100 100" role="img" aria-label={format!("The motion, {}", extents(places))}>
            <polyline points={points.join(" ")} />
            <circle cx="50" cy="50" r="3" />
        </svg>
    }
}

/// Probing.
#[component]
pub fn ProbeArea() -> Html {
    let context = use_page_context();
    let form = use_state(|| storage::load::<ProbingForm>(KEPT).unwrap_or_default());
    let change = {
        let form = form.clone();
        move |changed: ProbingForm| {
            storage::keep(KEPT, &changed);
            form.set(changed);
        }
    };
    let choose = {
        let (form, change) = (form.clone(), change.clone());
        Callback::from(move |event: Event| {
            let target = event.target_unchecked_into::<HtmlSelectElement>().value();
            change(ProbingForm {
                target,
                ..(*form).clone()
            });
        })
    };
    let options = TARGETS.map(|(name, text)| {
        html! { <option value={name} selected={form.target == name}>{ text }</option> }
    });
    let shown = FIELDS
        .iter()
        .enumerate()
        .filter(|(_, (name, _))| form.counts(name));
    let fields = shown.map(|(index, (name, text))| {
        let (form_now, change) = (form.clone(), change.clone());
        let typed = Callback::from(move |value: String| {
            let mut changed = (*form_now).clone();
            changed.values[index] = value.parse().unwrap_or(f64::NAN);
            change(changed);
        });
        html! {
            <label>{ *text }<Field id={format!("probe-{name}")} kind="number" min="0" step="any"
                value={form.values[index].to_string()} on_change={typed} /></label>
        }
    });
    let sides = [(1, 1), (-1, 1), (1, -1), (-1, -1)].map(|(x, y)| {
        let (form_now, change) = (form.clone(), change.clone());
        let turn = Callback::from(move |_: Event| change(ProbingForm { side: [x, y], ..(*form_now).clone() }));
        let name = format!("{}, {}", if y > 0 { "front" } else { "back" }, if x > 0 { "left" } else { "right" });
        html! {
            <label><input type="radio" name="corner" checked={form.side == [x, y]} onchange={turn} />{ name }</label>
        }
    });
    let obstacle = obstacle(&context.model, &form);
    let probing = form.probing(context.model.machine.reference_mm);
    let places = probing.places();
    let begin = {
        let context = context.clone();
        Callback::from(move |_: MouseEvent| context.send(Command::Probe { probing }))
    };
    let stop = {
        let context = context.clone();
        Callback::from(move |_: MouseEvent| context.send(Command::Stop))
    };
    let is_probing = context.model.machine.is_probing;
    html! {
        <section class="probe" aria-label="Probe">
            <h2>{ "Probe" }</h2>
            <label>{ "What " }<select id="probe-target" onchange={choose}>{ for options }</select></label>
            <div class="fields">{ for fields }</div>
            if form.counts("side") {
                <fieldset><legend>{ "Which corner of the workpiece" }</legend>{ for sides }</fieldset>
            }
            { picture(&places) }
            <p class="hint">{ "At most " }{ extents(&places) }{ ", each contact twice" }</p>
            <ProbeCheck />
            <button id="probe" type="button" disabled={obstacle.is_some() || is_probing} onclick={begin}>
                { "Probe" }</button>
            <button id="probe-stop" type="button" disabled={!is_probing} onclick={stop}>{ "Stop" }</button>
            if let Some(obstacle) = obstacle.filter(|_| !is_probing) { <p class="hint">{ obstacle }</p> }
        </section>
    }
}

/// Whether the probe is known to work: seen by the page, or said by the operator.
#[component]
fn ProbeCheck() -> Html {
    let context = use_page_context();
    let is_checked = context.model.is_probe_checked;
    let trust = {
        let context = context.clone();
        Callback::from(move |event: Event| {
            let input = event.target_unchecked_into::<HtmlInputElement>();
            context.model.dispatch(Action::TrustProbe(input.checked()));
        })
    };
    let is_closed = context.model.machine.pins.contains('P');
    html! {
        <p class="checked">
            <label><input id="probe-checked" type="checkbox" checked={is_checked}
                disabled={!context.model.may_operate()} onchange={trust} />{ " the probe was checked" }</label>
            if context.model.is_there() { <span class={classes!(is_closed.then_some("closed"))}>
                { if is_closed { "closed now" } else { "open now" } }</span> }
        </p>
    }
}

#[cfg(test)]
mod tests {
    use super::*;
    use crate::model::Connection;

    #[test]
    fn a_cycle_begins_with_an_open_probe_at_an_idle_machine() {
        let mut form = ProbingForm::default();
        let mut model = Model::default();
        let says = |model: &Model, form: &ProbingForm| obstacle(model, form).unwrap_or_default();
        assert!(says(&model, &form).contains("connect"));
        model.connection = Connection::Open;
        model.machine.is_there = true;
        model.machine.state = "Run".into();
        assert!(says(&model, &form).contains("idle"));
        model.machine.state = "Idle".into();
        model.machine.pins = "ZP".into();
        assert!(says(&model, &form).contains("closed already"));
        model.machine.pins = "Z".into();
        assert!(says(&model, &form).contains("touch the tool with the plate"));
        model.is_probe_checked = true;
        assert_eq!(obstacle(&model, &form), None);
        form.values[2] = f64::NAN;
        assert!(says(&model, &form).contains("the search"));
        form = ProbingForm {
            target: "tool".into(),
            ..ProbingForm::default()
        };
        assert!(says(&model, &form).contains("reference tool"));
        model.machine.reference_mm = Some(-12.0);
        assert_eq!(obstacle(&model, &form), None);
    }

    #[test]
    fn the_corner_of_the_form_is_where_the_workpiece_begins() {
        let form = |target: &str| ProbingForm {
            target: target.into(),
            side: [1, -1],
            ..ProbingForm::default()
        };
        let outside = form("corner").probing(None).target;
        assert_eq!(
            outside,
            Target::CornerOutside {
                side: [1, -1],
                with_top: false
            }
        );
        let inside = form("inside").probing(None).target;
        assert_eq!(inside, Target::CornerInside { side: [-1, 1] });
        assert!(form("inside").counts("side") && !form("hole").counts("side"));
    }

    #[test]
    fn the_motion_is_told_by_its_extents() {
        let form = ProbingForm {
            target: "corner".into(),
            ..ProbingForm::default()
        };
        let places = form.probing(None).places();
        assert_eq!(
            extents(&places),
            "X -15.0 to +0.0, Y -15.0 to +0.0, Z -5.0 to +0.0 mm from here"
        );
    }
}
