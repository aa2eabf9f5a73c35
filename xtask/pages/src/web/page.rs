//! The page: one file with everything in it, and nothing that is fetched.

use firmware::release::Index;

use super::install;
use crate::{
    control,
    pack::packed,
    page::{escaped, filled},
};

/// What a browser may do with the page: run what is in it, also in a thread of its own, show a job in a frame
/// of its own, and ask nobody for anything.
const POLICY: &str = "default-src 'none'; script-src 'unsafe-inline' 'wasm-unsafe-eval' blob:; \
    style-src 'unsafe-inline'; worker-src blob:; frame-src blob:; img-src data:; connect-src 'none'; \
    base-uri 'none'; form-action 'none'";

const FRAME: &str = include_str!("page/web.html");
const STYLE: &str = include_str!("page/web.css");
/// What runs in the thread for jobs.
const WORKER: &str = include_str!("page/worker.js");
const SCRIPT: &str = include_str!("page/web.js");

/// Returns the page with the code of the machine, which is proven for a step rate; 0: for none. The page of a release
/// that lies beside it is named.
pub fn write(wasm: &[u8], rate_hz: u32, release: Option<&Index>) -> String {
    let control = control::FILE;
    let control = format!("  <nav><a href=\"{control}\">Control a machine</a></nav>\n");
    let release = release.map(|index| {
        let version = escaped(&index.version);
        let file = install::FILE;
        format!("  <nav><a href=\"{file}\">Firmware {version} for your board</a></nav>\n")
    });
    let parts = [
        ("POLICY", POLICY.into()),
        ("STYLE", STYLE.into()),
        ("LINKS", control + &release.unwrap_or_default()),
        ("WASM", packed(wasm)),
        ("WORKER", WORKER.into()),
        ("RATE", rate_hz.to_string()),
        ("SCRIPT", SCRIPT.into()),
    ];
    filled(FRAME, &parts)
}

#[cfg(test)]
mod tests {
    use super::*;

    #[test]
    fn the_page_names_no_address_and_forbids_every_request() {
        let page = write(b"\0asm", 190_000, None);
        for part in [
            "http:",
            "https:",
            "://",
            "url(",
            "import(",
            "@import",
            "fetch(",
            "src=",
            "XMLHttpRequest",
            "WebSocket",
        ] {
            assert!(!page.contains(part), "{part}");
        }
        assert!(page.contains("default-src 'none'") && page.contains("connect-src 'none'"));
        assert!(!page.contains("{{"));
    }

    #[test]
    fn the_page_of_a_release_is_named_where_there_is_one() {
        let index = Index::new("abc".into(), Vec::new());
        let named = write(b"", 0, Some(&index));
        assert!(named.contains("<a href=\"install.html\">Firmware "));
        assert!(!write(b"", 0, None).contains("install.html"));
    }

    #[test]
    fn no_script_ends_early() {
        let page = write(b"\0asm", 190_000, None);
        assert_eq!(page.matches("<script").count(), 3);
        assert_eq!(page.matches("</script>").count(), 3);
        assert!(page.contains("data-rate=\"190000\""));
    }
}
