//! The page: one file with everything in it, and nothing that is fetched.

use simulation::Job;

use crate::pack::packed;

/// What a browser may do with the page: run what is in it, and ask nobody for anything.
const POLICY: &str = "default-src 'none'; script-src 'unsafe-inline'; style-src 'unsafe-inline'; \
    img-src data:; connect-src 'none'; base-uri 'none'; form-action 'none'";

const FRAME: &str = include_str!("page/page.html");
const STYLE: &str = include_str!("page/page.css");
/// In the order in which they need each other.
const SCRIPTS: [&str; 9] = [
    include_str!("page/decode.js"),
    include_str!("page/path.js"),
    include_str!("page/scene.js"),
    include_str!("page/curves.js"),
    include_str!("page/listing.js"),
    include_str!("page/search.js"),
    include_str!("page/tables.js"),
    include_str!("page/view.js"),
    include_str!("page/machine.js"),
];
/// Begins a page that has its job in it, alone or as a part of another one.
const START: [&str; 2] = [include_str!("page/frame.js"), include_str!("page/start.js")];

/// Returns the page of a job.
pub fn write(job: &Job) -> String {
    let facts = serde_json::to_vec(job).expect("names and numbers become JSON");
    let packs = [
        ("facts", &facts),
        ("path", &job.columns),
        ("curves", &job.curves),
        ("program", &job.text),
    ];
    let packs = packs.map(|(name, bytes)| {
        let text = packed(bytes);
        format!("<script type=\"text/plain\" id=\"pack-{name}\">{text}</script>\n")
    });
    let script = format!(
        "{}<script type=\"module\">\n{}{}</script>",
        packs.concat(),
        SCRIPTS.concat(),
        START.concat()
    );
    let parts = [
        ("TITLE", escaped(&job.title)),
        ("POLICY", POLICY.into()),
        ("STYLE", format!("<style>\n{STYLE}</style>")),
        ("ABOVE", String::new()),
        ("SCRIPT", script),
    ];
    filled(FRAME, &parts)
}

/// A page that is served in files, and gets its job and more from where it comes from.
pub struct Served {
    /// The page, which names the others `page.css` and `page.js`.
    pub html: String,
    /// Its style.
    pub style: String,
    /// Its script.
    pub script: String,
}

/// Returns the page with a title, a policy for the browser, and more: what stands beside the program, its
/// style, and the script that begins.
pub fn served(title: &str, policy: &str, above: &str, style: &str, script: &str) -> Served {
    let parts = [
        ("TITLE", escaped(title)),
        ("POLICY", policy.into()),
        (
            "STYLE",
            "<link rel=\"stylesheet\" href=\"page.css\">".into(),
        ),
        ("ABOVE", above.into()),
        ("SCRIPT", "<script src=\"page.js\"></script>".into()),
    ];
    Served {
        html: filled(FRAME, &parts),
        style: [STYLE, style].concat(),
        script: [&SCRIPTS.concat(), script].concat(),
    }
}

/// Returns a page with parts in place of their names: `{{TITLE}}`.
pub fn filled(frame: &str, parts: &[(&str, String)]) -> String {
    let mut page = String::new();
    let mut remainder = frame;
    while let Some((before, after_open)) = remainder.split_once("{{") {
        let (name, after) = after_open.split_once("}}").expect("each name ends");
        let part = parts.iter().find(|(part, _)| *part == name);
        page += before;
        page += &part.expect("each name has a part").1;
        remainder = after;
    }
    page + remainder
}

/// A text that HTML does not take for something else.
pub(crate) fn escaped(text: &str) -> String {
    let text = text.replace('&', "&amp;").replace('<', "&lt;");
    text.replace('>', "&gt;").replace('"', "&quot;")
}

/// A script that ends no element of a page: in a string, `<\/` is the same.
#[cfg(feature = "commands")]
pub(crate) fn script_safe(script: &str) -> String {
    script.replace("</", "<\\/")
}

#[cfg(test)]
mod tests {
    use super::*;

    fn page() -> String {
        let mut job = Job::default();
        job.title = "</title><script>alert('a & b')</script>.nc".into();
        job.text = b"(</script><script>alert(1)</script> http://a.b/)\n".to_vec();
        write(&job)
    }

    #[test]
    fn the_page_names_no_address_and_forbids_every_request() {
        let page = page();
        for part in [
            "http:", "https:", "://", "url(", "import(", "@import", "fetch(", "src=", "href=",
        ] {
            assert!(!page.contains(part), "{part}");
        }
        assert!(page.contains("default-src 'none'") && page.contains("connect-src 'none'"));
        assert!(!page.contains("{{"));
    }

    #[test]
    fn a_title_or_a_program_ends_no_script() {
        let page = page();
        assert!(page.contains("&lt;script&gt;alert('a &amp; b')"));
        assert!(!page.contains("<script>alert"));
        let begun = page.matches("<script").count();
        assert_eq!(begun, 5);
        assert_eq!(page.matches("</script>").count(), begun);
    }
}
