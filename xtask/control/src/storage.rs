//! What the browser keeps for the page: macros, and what was typed into forms.

use serde::{Serialize, de::DeserializeOwned};
use wasm_bindgen::JsCast as _;
use web_sys::{Blob, BlobPropertyBag, HtmlAnchorElement, Url};

/// What was kept under a name, if it can be read.
pub(crate) fn load<T: DeserializeOwned>(name: &str) -> Option<T> {
    let storage = web_sys::window()?.local_storage().ok()??;
    serde_json::from_str(&storage.get_item(name).ok()??).ok()
}

/// Keeps something under a name, where the browser keeps anything.
pub(crate) fn keep(name: &str, value: &impl Serialize) {
    let storage = web_sys::window().and_then(|window| window.local_storage().ok()?);
    if let (Some(storage), Ok(text)) = (storage, serde_json::to_string(value)) {
        // Without room the page has it as long as it is open.
        let _ = storage.set_item(name, &text);
    }
}

/// Hands a text to the operator as a file.
pub(crate) fn save_file(name: &str, text: &str) {
    let save = || -> Option<()> {
        let parts = js_sys::Array::of1(&text.into());
        let kind = BlobPropertyBag::new();
        kind.set_type("text/plain");
        let blob = Blob::new_with_str_sequence_and_options(&parts, &kind).ok()?;
        let address = Url::create_object_url_with_blob(&blob).ok()?;
        let document = web_sys::window()?.document()?;
        let link: HtmlAnchorElement = document.create_element("a").ok()?.dyn_into().ok()?;
        link.set_href(&address);
        link.set_download(name);
        link.click();
        Url::revoke_object_url(&address).ok()
    };
    let _ = save();
}
