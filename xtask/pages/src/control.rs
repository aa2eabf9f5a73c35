//! The control page: one file with everything in it.

use std::{fs, path::Path};

use anyhow::{Context as _, Result};
use common::tools;

use crate::{
    pack::packed,
    page::{filled, script_safe},
};

/// What a browser may do with the page: run what is in it, also in a thread of its own, and speak with who serves it
/// and with the controllers that the operator names. Only a WebSocket leaves the page.
const POLICY: &str = "default-src 'none'; script-src 'unsafe-inline' 'wasm-unsafe-eval' blob:; \
    style-src 'unsafe-inline'; worker-src blob:; img-src data:; connect-src 'self' ws: wss:; base-uri 'none'; \
    form-action 'none'";
/// The name of its file, beside the simulator's page.
pub const FILE: &str = "control.html";

const FRAME: &str = include_str!("control/control.html");
/// The look of the pages, of which the page's own follows.
const STYLES: [&str; 2] = [
    include_str!("web/page/web.css"),
    include_str!("control/control.css"),
];
/// What begins in a worker.
const WORKER: &str = include_str!("control/worker.js");
const SCRIPT: &str = include_str!("control/start.js");

/// The code of the page, as `wasm-bindgen` writes it.
pub struct Code {
    /// WebAssembly.
    pub wasm: Vec<u8>,
    /// The script that loads it.
    pub glue: String,
}

/// Builds the code.
pub fn built() -> Result<Code> {
    let [wasm, glue] = tools::control()?;
    let read =
        |file: &Path| fs::read(file).with_context(|| format!("cannot read {}", file.display()));
    let glue = String::from_utf8(read(&glue)?).context("wasm-bindgen writes no text")?;
    Ok(Code {
        wasm: read(&wasm)?,
        glue,
    })
}

/// Returns the page for a folder of files: it connects to machines by itself.
pub fn write(code: &Code) -> String {
    let links = "  <nav><a href=\"index.html\">A job before it is cut</a></nav>\n";
    let parts = [
        ("POLICY", POLICY.into()),
        ("STYLE", STYLES.concat()),
        ("LINKS", links.into()),
        ("WASM", packed(&code.wasm)),
        ("GLUE", script_safe(&code.glue)),
        ("WORKER", WORKER.into()),
        ("SCRIPT", SCRIPT.into()),
    ];
    filled(FRAME, &parts)
}

/// A file that is served: its path, its type and its content.
pub type File = (&'static str, &'static str, Vec<u8>);

/// What becomes the page of a job within the served page: in a sandbox, in which alone scripts may stand in a page.
pub const VIEW: &str = "/view.html";
/// What a browser may do with it, wherever it is opened: it is nobody's page, and asks nobody for anything.
pub const VIEW_POLICY: &str = "sandbox allow-scripts; default-src 'none'; script-src 'unsafe-inline'; \
    style-src 'unsafe-inline'; img-src data:; base-uri 'none'; form-action 'none'; frame-ancestors 'self'";

/// The files of the page that the local program serves, which has the machine. Nothing in it is inline, so that a
/// browser can be told to run files of the server alone.
pub fn served(code: Code) -> Vec<File> {
    const SERVED: &str = include_str!("control/served.html");
    const SCRIPT: &str = include_str!("control/served.js");
    const SHELL: &str = include_str!("control/view.html");
    const JAVASCRIPT: &str = "text/javascript; charset=utf-8";
    vec![
        ("/", "text/html; charset=utf-8", SERVED.into()),
        (
            "/page.css",
            "text/css; charset=utf-8",
            STYLES.concat().into(),
        ),
        (
            "/worker.js",
            JAVASCRIPT,
            [code.glue.as_str(), WORKER].concat().into(),
        ),
        ("/glue.js", JAVASCRIPT, code.glue.into()),
        ("/page.js", JAVASCRIPT, SCRIPT.into()),
        ("/page.wasm", "application/wasm", code.wasm),
        (VIEW, "text/html; charset=utf-8", SHELL.into()),
    ]
}

#[cfg(test)]
mod tests {
    use super::*;

    fn code() -> Code {
        Code {
            wasm: b"\0asm".to_vec(),
            glue: "let wasm_bindgen = '</script>';".into(),
        }
    }

    #[test]
    fn the_page_names_no_address_and_leaves_by_a_websocket_alone() {
        let page = write(&code());
        for part in ["http:", "https:", "url(", "import(", "@import", "src="] {
            assert!(!page.contains(part), "{part}");
        }
        assert!(page.contains("default-src 'none'") && !page.contains("{{"));
        assert!(page.contains("<a href=\"index.html\">"));
    }

    #[test]
    fn no_script_ends_early() {
        let page = write(&code());
        let begun = page.matches("<script").count();
        assert_eq!((begun, page.matches("</script>").count()), (4, 4));
    }

    #[test]
    fn the_served_page_asks_for_its_own_files_and_has_nothing_inline() {
        let files = served(code());
        let page = String::from_utf8_lossy(&files[0].2).into_owned();
        let named = page
            .split(['"', '\''])
            .filter(|word| word.starts_with("page.") || word.starts_with("glue."));
        for name in named {
            assert!(files.iter().any(|(path, ..)| path[1..] == *name), "{name}");
        }
        assert_eq!(
            page.matches("<script").count(),
            page.matches("<script src=").count()
        );
        assert!(!page.contains("<style") && !page.contains(" style="));
    }
}
