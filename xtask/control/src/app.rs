//! The page as a whole: its link, its state, and where its areas are.

use std::{cell::Cell, rc::Rc};

use wasm_bindgen::JsValue;
use yew::prelude::*;

use crate::{
    areas::{
        check::{CheckArea, CheckedView},
        connection::ConnectionArea,
        console::ConsoleArea,
        job::HoldBar,
        jog::JogArea,
        macros::MacroArea,
        probe::ProbeArea,
        program::ProgramArea,
        settings::SettingsArea,
        setup::SetupArea,
        state::StateArea,
        tables::TablesArea,
    },
    context::PageContext,
    link::Link,
    model::{Action, Model},
    worker::Reply,
};

/// What the page was started with.
#[derive(Clone, PartialEq, Properties)]
pub struct Start {
    /// The compiled code, for workers.
    pub module: JsValue,
    /// The script that loads it in a worker.
    pub worker_address: AttrValue,
    /// The local program serves the page, and has the client.
    pub is_served: bool,
}

/// Shows the page.
pub(crate) fn start(module: JsValue, worker_address: String, is_served: bool) {
    let document = gloo_document();
    let Some(root) = document.and_then(|document| document.get_element_by_id("app")) else {
        return;
    };
    let start = Start {
        module,
        worker_address: worker_address.into(),
        is_served,
    };
    yew::Renderer::<App>::with_root_and_props(root, start).render();
}

fn gloo_document() -> Option<web_sys::Document> {
    web_sys::window()?.document()
}

/// Time of day, ms.
pub(crate) fn time_ms() -> u32 {
    let now = js_sys::Date::new_0();
    let minutes = now.get_hours() * 60 + now.get_minutes();
    (minutes * 60 + now.get_seconds()) * 1000 + now.get_milliseconds()
}

/// The page.
#[component]
pub fn App(start: &Start) -> Html {
    let model = use_reducer(Model::default);
    let dispatcher = model.dispatcher();
    let link = use_memo((), move |()| {
        let replies = Callback::from(move |reply: Reply| {
            dispatcher.dispatch(Action::Reply(reply, time_ms()));
        });
        if start.is_served {
            Link::program(replies)
        } else {
            Link::worker(&start.module, &start.worker_address, replies)
        }
    });
    let lines = use_memo((), |()| Cell::new(0));
    let context = PageContext {
        model,
        link: Rc::clone(&link),
        lines,
        start: start.clone(),
    };
    html! {
        <ContextProvider<PageContext> context={context}>
            <main>
            <div class="top"><ConnectionArea /><HoldBar /></div>
            <div class="areas">
                <StateArea />
                <JogArea />
                <SetupArea />
                <ProgramArea />
                <CheckArea />
                <CheckedView />
                <ProbeArea />
                <TablesArea />
                <MacroArea />
                <SettingsArea />
                <ConsoleArea />
            </div>
            </main>
        </ContextProvider<PageContext>>
    }
}
