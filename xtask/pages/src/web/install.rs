//! The page of a release: which file a board takes and how; a browser that reaches the board writes it.

use std::{ffi::OsStr, fmt::Write as _, fs, path::Path};

use anyhow::{Context, Result, ensure};
use common::{BAUD, text::separated};
use firmware::{
    release::{self, BoardEntry, FlashMethod, Index, ReleasedImage},
    released::Released,
};

use crate::page::{escaped, filled};

/// The page's file, and the folder of the release beside it.
pub const FILE: &str = "install.html";
const FOLDER: &str = "release";
/// What every release has.
const MARK: &str = "index.json";

/// What a browser may do with the page: run what is in it, and ask for the files beside it.
const POLICY: &str = "default-src 'none'; script-src 'unsafe-inline'; style-src 'unsafe-inline'; img-src data:; \
    connect-src 'self'; base-uri 'none'; form-action 'none'";

const FRAME: &str = include_str!("page/install.html");
const STYLES: [&str; 2] = [
    include_str!("page/web.css"),
    include_str!("page/install.css"),
];
const SCRIPTS: [&str; 2] = [
    include_str!("page/dfuse.js"),
    include_str!("page/install.js"),
];
/// Who may open the bootloader in a chip's ROM under Linux, as `docs/platforms.md` has it.
const RULE: &str = r#"SUBSYSTEM=="usb", ATTR{idVendor}=="0483", ATTR{idProduct}=="df11", MODE="0660", TAG+="uaccess""#;
/// The method that the page itself has.
const DFU: &str = "DFU";

/// Copies a release beside the page in a folder, where it does not lie there already; every file is compared with
/// its sum before.
pub fn copy(from: &Path, folder: &Path) -> Result<Released> {
    let released = Released::open(from)?;
    released.check()?;
    let to = folder.join(FOLDER);
    if to.exists() {
        if fs::canonicalize(&to)? == fs::canonicalize(from)? {
            return Ok(released);
        }
        // The release of another time; nothing else is removed.
        ensure!(
            to.join(MARK).is_file(),
            "{} is in the way: it is no release",
            to.display()
        );
        fs::remove_dir_all(&to).with_context(|| format!("cannot remove {}", to.display()))?;
    }
    released.copy(&to)?;
    Ok(released)
}

/// Returns the page of a release that lies beside it.
pub fn write(index: &Index) -> String {
    let rows: String = index.boards.iter().map(row).collect();
    let boards: String = index.boards.iter().map(section).collect();
    let parts = [
        ("POLICY", POLICY.into()),
        ("STYLE", STYLES.concat()),
        ("VERSION", escaped(&index.version)),
        ("COMMIT", escaped(&index.commit)),
        ("UNTRIED", release::UNTRIED.into()),
        ("ROWS", rows),
        ("BOARDS", boards),
        ("RULE", escaped(RULE)),
        ("SCRIPT", SCRIPTS.concat()),
    ];
    filled(FRAME, &parts)
}

/// A sentence, with code between backticks, as HTML.
fn marked(text: &str) -> String {
    let parts = text.split('`').enumerate();
    let parts = parts.map(|(number, part)| match number % 2 {
        0 => escaped(part),
        _ => format!("<code>{}</code>", escaped(part)),
    });
    parts.collect()
}

fn capital(text: &str) -> String {
    let mut letters = text.chars();
    letters.next().map_or_else(String::new, |first| {
        format!("{}{}", first.to_uppercase(), letters.as_str())
    })
}

fn rate(hz: u32) -> String {
    format!("{} steps/s", separated(hz.into()))
}

/// Where the sender is, and how fast a UART is.
fn sender(board: &BoardEntry) -> String {
    if board.sender == "USB" {
        return "USB".into();
    }
    format!(
        "{}, {} baud",
        escaped(&board.sender),
        separated(BAUD.into())
    )
}

/// What else a user wants to know, as a sentence between tags.
fn note(board: &BoardEntry, before: &str, after: &str) -> String {
    if board.about.is_empty() {
        return String::new();
    }
    format!("{before}{}.{after}", escaped(&capital(&board.about)))
}

/// A board in the table of boards.
fn row(board: &BoardEntry) -> String {
    let rates = board.images.iter().map(|image| {
        let rate = rate(image.step_rate_hz);
        format!("{rate} ({} axes)", image.axes)
    });
    let rates: Vec<_> = rates.collect();
    let methods: Vec<_> = { board.flashing.iter() }
        .map(|method| method.kind.as_str())
        .collect();
    format!(
        "<tr><th scope=\"row\"><a href=\"#{name}\">{title}</a>{about}</th><td data-name=\"chip\">{chip}</td>\
         <td data-name=\"sender\">{sender}</td><td data-name=\"proven\">{rates}</td>\
         <td data-name=\"flashed by\">{methods}</td></tr>\n",
        name = escaped(&board.name),
        title = escaped(&board.title),
        about = note(board, "<small>", "</small>"),
        chip = escaped(&board.chip),
        sender = sender(board),
        rates = rates.join("<br>"),
        methods = escaped(&methods.join(", ")),
    )
}

/// What an owner needs of a board: its notes, its files, and how each is written.
fn section(board: &BoardEntry) -> String {
    let mut text = format!(
        "<section id=\"{}\">\n<h2>{}</h2>\n{}<p>Compare with what is printed on the board: {}, {} MHz.</p>\n",
        escaped(&board.name),
        escaped(&board.title),
        note(board, "<p>", "</p>\n"),
        escaped(&board.chip),
        board.crystal_mhz,
    );
    text += &images(board);
    for method in &board.flashing {
        let _ = writeln!(
            text,
            "<h3>{}: <code>{}</code></h3>",
            escaped(&capital(&method.kind)),
            escaped(&method.file)
        );
        if method.kind == DFU {
            text += &form(board, method);
            text += "<p>Or without this page:</p>\n";
        }
        let _ = writeln!(text, "<ol>{}</ol>", items(&method.steps));
    }
    let _ = writeln!(
        text,
        "<h3>Then</h3>\n<p>Connect your sender at {}. The machine greets it with <code>Grbl 1.1h ['$' for help]</code>, at \
         the latest when the sender resets it; <code>$I</code> shows version and step rate.</p>",
        sender(board)
    );
    text + "<p><a href=\"#boards\">All boards</a></p>\n</section>\n"
}

fn items(steps: &[String]) -> String {
    let mut text = String::new();
    for step in steps {
        let _ = write!(text, "<li>{}</li>", marked(step));
    }
    text
}

/// The images of a board, with the file of each method and all others.
fn images(board: &BoardEntry) -> String {
    let has_fast = { board.images.iter() }.any(|image| image.step_rate_at_1_mbaud_hz.is_some());
    let mut text =
        String::from("<table class=\"images\">\n<thead><tr><td></td><th>proven step rate</th>");
    if has_fast {
        text += "<th>at 1 000 000 baud</th>";
    }
    for method in &board.flashing {
        let _ = write!(text, "<th>{}</th>", escaped(&method.kind));
    }
    text += "<th>others</th></tr></thead>\n<tbody>\n";
    for image in &board.images {
        let _ = write!(
            text,
            "<tr><th scope=\"row\">{} axes</th><td data-name=\"proven\">{}</td>",
            image.axes,
            rate(image.step_rate_hz)
        );
        if has_fast {
            let fast = image
                .step_rate_at_1_mbaud_hz
                .map_or_else(|| "none".into(), rate);
            let _ = write!(text, "<td data-name=\"at 1 000 000 baud\">{fast}</td>");
        }
        for method in &board.flashing {
            let kind = escaped(&method.kind);
            let file = link(board, image, &method.file);
            let _ = write!(text, "<td data-name=\"{kind}\">{file}</td>");
        }
        let is_other = |name: &str| board.flashing.iter().all(|method| method.file != name);
        let others = { image.files.iter() }.filter(|file| is_other(&file.name));
        text += "<td data-name=\"others\">";
        for file in others {
            let _ = write!(text, "<div>{}</div>", link(board, image, &file.name));
        }
        text += "</td></tr>\n";
    }
    text + "</tbody>\n</table>\n"
}

/// Where a file of an image is, from the page.
fn address(board: &BoardEntry, image: &ReleasedImage, file: &str) -> String {
    let folder = release::folder(&board.name, image.axes);
    escaped(&format!("{FOLDER}/{folder}/{file}"))
}

fn link(board: &BoardEntry, image: &ReleasedImage, file: &str) -> String {
    let mut text = format!(
        "<a href=\"{}\" download>{}</a>",
        address(board, image, file),
        escaped(file)
    );
    // A flat file covers what lies between vectors and code.
    if Path::new(file).extension() == Some(OsStr::new("bin")) && !image.settings_outlive_bin {
        text += "<small class=\"lost\">erases the settings</small>";
    }
    text
}

/// What writes an image over USB: nothing to see without a script.
fn form(board: &BoardEntry, method: &FlashMethod) -> String {
    let flashes = board.flashes_kib.iter().map(|sectors| {
        let sectors: Vec<_> = sectors.iter().map(u32::to_string).collect();
        sectors.join(",")
    });
    let flashes: Vec<_> = flashes.collect();
    let mut choices = String::new();
    for image in &board.images {
        let Some(file) = image.files.iter().find(|file| file.name == method.file) else {
            continue;
        };
        let _ = write!(
            choices,
            "<option data-file=\"{}\" data-sha256=\"{}\" data-start=\"{}\">{} axes, {}</option>",
            address(board, image, &file.name),
            escaped(&file.sha256),
            image.start,
            image.axes,
            rate(image.step_rate_hz)
        );
    }
    let steps = [
        method.steps.first().map_or("", String::as_str),
        "Press `Install`, and choose `STM32 BOOTLOADER` in the list of the browser.",
    ];
    format!(
        "<form class=\"install\" data-board=\"{title}\" data-chip=\"{chip}\" data-flashes=\"{flashes}\" hidden>\n<h3>Install from this page, in Chrome or Edge</h3>\n<ol>{steps}</ol>\n\
         <p><label>With <select>{choices}</select></label> <button>Install</button></p>\n\
         <progress value=\"0\" max=\"1\" aria-label=\"Progress\" hidden></progress>\n<p role=\"status\"></p>\n</form>\n",
        title = escaped(&board.title),
        chip = escaped(&board.chip),
        flashes = flashes.join(" "),
        steps = items(&steps.map(String::from)),
    )
}

#[cfg(test)]
mod tests {
    use firmware::boards;

    use super::*;

    /// A release of boards with names that HTML would misread: with DFU, with an SD card, and with neither.
    fn released(out: &Path) -> Index {
        let entries = ["blackpill-f411", "fysetc-spider", "nucleo-f446re"].map(|name| {
            let board = boards::named(name).unwrap();
            let images = [4, 5].map(|axes| {
                let memory = board.memory(axes);
                let parts = [(memory.flash_start, &[axes as u8; 8][..])];
                let image = ReleasedImage {
                    axes: axes as u8,
                    start: memory.flash_start,
                    step_rate_hz: 67_000,
                    step_rate_at_1_mbaud_hz: None,
                    settings_outlive_bin: memory.code_start.is_none(),
                    files: Vec::new(),
                };
                let files = release::files_of(&board, memory.flash_start, &parts);
                image.write(name, files, out).unwrap()
            });
            let mut entry = BoardEntry::new(&board, images.into());
            entry.title += " <&\">";
            entry.about = "leave the button alone".into();
            entry
        });
        let index = Index::new("abc".into(), entries.into());
        index.write(out, "MIT").unwrap();
        index
    }

    fn page() -> String {
        write(&released(tempfile::tempdir().unwrap().path()))
    }

    #[test]
    fn each_board_has_its_files_and_the_steps_of_its_methods() {
        let page = page();
        for part in [
            "<a href=\"#blackpill-f411\">WeAct BlackPill F411 &lt;&amp;&quot;&gt;</a>",
            "<small>Leave the button alone.</small>",
            "<td data-name=\"flashed by\">SD card, DFU, probe</td>",
            "<a href=\"release/fysetc-spider/5-axes/firmware.bin\" download>firmware.bin</a>",
            "<li>Copy <code>firmware.bin</code> to the root of a card with FAT32.</li>",
            "<code>cargo xtask flash --board fysetc-spider</code> builds",
            "<strong>No board has run this firmware</strong>",
        ] {
            assert!(page.contains(part), "{part}\n{page}");
        }
        assert!(!page.contains("{{") && !page.contains("<&"), "{page}");
    }

    #[test]
    fn only_a_flat_file_over_the_settings_erases_them() {
        let page = page();
        let erases = |file: &str| {
            let link = format!("<a href=\"release/{file}\" download>");
            let (_, after) = page.split_once(&link).unwrap();
            let (cell, _) = after.split_once("</td>").unwrap();
            cell.contains("erases the settings")
        };
        assert!(!erases("fysetc-spider/4-axes/firmware.bin"));
        assert!(erases("fysetc-spider/5-axes/firmware.bin"));
        assert!(!erases("fysetc-spider/5-axes/leadscrew.hex"));
        assert!(!erases("blackpill-f411/4-axes/leadscrew.dfu"));
        assert!(erases("blackpill-f411/4-axes/leadscrew.bin"));
    }

    #[test]
    fn boards_with_dfu_alone_can_be_installed_with_the_sum_of_the_index() {
        let folder = tempfile::tempdir().unwrap();
        let index = released(folder.path());
        let page = write(&index);
        assert_eq!(page.matches("<form ").count(), 2);
        let files = &index.boards[0].images[0].files;
        let file = files.iter().find(|file| file.name == "leadscrew.dfu");
        let option = format!(
            "<option data-file=\"release/blackpill-f411/4-axes/leadscrew.dfu\" data-sha256=\"{}\" \
             data-start=\"134217728\">4 axes",
            file.unwrap().sha256
        );
        assert!(page.contains(&option), "{page}");
        assert!(
            page.contains("data-chip=\"STM32F411CE\" data-flashes=\"16,16,16,16,64,128,128,128\"")
        );
    }

    #[test]
    fn the_page_asks_only_for_what_is_beside_it() {
        let page = page();
        for part in [
            "src=",
            "url(",
            "import(",
            "@import",
            "http:",
            "XMLHttpRequest",
            "WebSocket",
            "eval",
        ] {
            assert!(!page.contains(part), "{part}");
        }
        // A link to a driver, which nobody follows but the user.
        assert_eq!(page.matches("https:").count(), 1);
        assert_eq!(page.matches("fetch(").count(), 1);
        assert!(page.contains("default-src 'none'") && page.contains("connect-src 'self'"));
        assert_eq!(page.matches("<script").count(), 1);
        assert_eq!(page.matches("</script>").count(), 1);
    }

    #[test]
    fn the_rule_for_linux_is_that_of_the_documents() {
        let documents = include_str!("../../../../docs/platforms.md");
        assert!(documents.contains(RULE));
        assert!(page().contains(&escaped(RULE)));
    }

    #[test]
    fn a_release_is_copied_whole_over_an_older_one_and_nothing_else() {
        let [from, to] = [0, 1].map(|_| tempfile::tempdir().unwrap());
        released(from.path());
        let copied = to.path().join(FOLDER);
        fs::create_dir(&copied).unwrap();
        fs::write(copied.join("photos"), "").unwrap();
        let error = copy(from.path(), to.path()).err().unwrap().to_string();
        assert!(
            error.ends_with("is in the way: it is no release"),
            "{error}"
        );
        fs::write(copied.join(MARK), "").unwrap();
        copy(from.path(), to.path()).unwrap();
        assert!(!copied.join("photos").exists());
        let file = "fysetc-spider/5-axes/firmware.bin";
        assert_eq!(fs::read(copied.join(file)).unwrap(), [5; 8]);
        // Where it lies already, it stays.
        copy(&copied, to.path()).unwrap();
        assert!(copied.join(file).is_file());
        fs::write(copied.join("LICENSES.txt"), "").unwrap();
        assert!(copy(&copied, to.path()).is_err());
    }
}
