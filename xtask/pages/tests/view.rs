//! `cargo xtask view` as a user starts it.
#![cfg(unix)]

use std::{
    fs,
    io::Write as _,
    os::unix::fs::PermissionsExt as _,
    path::Path,
    process::{Command, Output, Stdio},
    thread,
};

use tempfile::TempDir;

/// A folder with a program in it.
fn folder(program: &str) -> TempDir {
    let folder = tempfile::tempdir().expect("a folder can be made");
    fs::write(folder.path().join("part <1>.nc"), program).expect("it can be written");
    folder
}

fn view(folder: &Path, arguments: &[&str]) -> Output {
    Command::new(env!("CARGO_BIN_EXE_view"))
        .arg("view")
        .arg("part <1>.nc")
        .args(arguments)
        .current_dir(folder)
        .env("BROWSER", folder.join("browser"))
        .output()
        .expect("it starts")
}

fn printed(output: &Output) -> String {
    let both = [&output.stdout, &output.stderr];
    both.map(|text| String::from_utf8_lossy(text)).concat()
}

#[test]
fn the_page_goes_where_it_is_asked_for() {
    let folder = folder("G0X1\nG1X5F100\n");
    let output = view(folder.path(), &["--set", "$110=700", "-o", "page.html"]);
    assert!(output.status.success(), "{output:?}");
    let text = printed(&output);
    assert!(
        text.contains("page.html") && text.contains("cutting"),
        "{text}"
    );
    assert!(!text.contains("Opening"), "{text}");
    let page = fs::read_to_string(folder.path().join("page.html")).expect("the page is there");
    assert!(page.starts_with("<!doctype html>") && page.ends_with("</html>\n"));
    assert!(page.contains("<title>part &lt;1&gt;.nc</title>"));
}

#[test]
fn refused_lines_and_alarms_are_reported_by_the_status_and_have_a_page() {
    for program in ["G0X1\nG999\n", "$X\nG38.2Z-1F100\n"] {
        let folder = folder(program);
        let output = view(folder.path(), &["-o", "page.html"]);
        assert_eq!(output.status.code(), Some(1), "{output:?}");
        assert!(folder.path().join("page.html").exists());
    }
}

#[test]
fn what_is_wrong_leaves_no_page() {
    let folder = folder("G0X1\n");
    for (arguments, reason) in [
        (&["--set", "$110=fast", "-o", "page.html"][..], "$110=fast"),
        (
            &["--settings", "none.settings", "-o", "page.html"],
            "none.settings",
        ),
        (&["-o", "none/page.html"], "cannot create none/page.html"),
    ] {
        let output = view(folder.path(), arguments);
        assert!(
            !output.status.success() && printed(&output).contains(reason),
            "{output:?}"
        );
        assert!(!folder.path().join("page.html").exists());
    }
}

#[test]
fn ctrl_c_removes_every_temporary_file() {
    for named in [true, false] {
        let folder = tempfile::tempdir().expect("a folder can be made");
        let options: &[&str] = if named { &["-o", "page.html"] } else { &[] };
        let mut process = Command::new(env!("CARGO_BIN_EXE_view"))
            .arg("view")
            .arg("-")
            .args(options)
            .current_dir(folder.path())
            .env("TMPDIR", folder.path())
            .stdin(Stdio::piped())
            .spawn()
            .expect("it starts");
        let entries = || fs::read_dir(folder.path()).expect("it is there").count();
        // The program is not complete yet: the page waits for it.
        while entries() == 0 {
            thread::yield_now();
        }
        let mut program = process.stdin.take().expect("it is a pipe");
        program.write_all(b"G0X1\n").expect("it is read");
        let id = process.id().to_string();
        let killed = Command::new("kill").args(["-INT", &id]).status();
        assert!(killed.expect("it starts").success());
        let status = process.wait().expect("it ends");
        assert_eq!(status.code(), Some(130));
        assert_eq!(entries(), 0, "{named}");
    }
}

#[test]
fn the_browser_gets_a_page_that_has_no_name() {
    let folder = folder("G0X1\n");
    let [browser, pipe] = ["browser", "pipe"].map(|name| folder.path().join(name));
    let script = format!("#!/bin/sh\necho \"$1\" > '{}'\n", pipe.display());
    fs::write(&browser, script).expect("it can be written");
    fs::set_permissions(&browser, fs::Permissions::from_mode(0o755)).expect("it is ours");
    let made = Command::new("mkfifo")
        .arg(&pipe)
        .status()
        .expect("mkfifo starts");
    assert!(made.success());
    let output = view(folder.path(), &[]);
    assert!(
        output.status.success() && printed(&output).contains("Opening"),
        "{output:?}"
    );
    let opened = fs::read_to_string(&pipe).expect("the browser tells");
    let page = Path::new(opened.trim());
    assert!(
        fs::read_to_string(page).is_ok_and(|text| text.starts_with("<!doctype html>")),
        "{opened}"
    );
    fs::remove_dir_all(page.parent().expect("it lies in a folder")).expect("the folder is ours");
    let quiet = view(folder.path(), &["--no-open"]);
    let text = printed(&quiet);
    assert!(
        quiet.status.success() && !text.contains("Opening"),
        "{text}"
    );
    let path = text
        .split_once("points: ")
        .expect("it says where the page is")
        .1
        .trim();
    let folder = Path::new(path).parent().expect("it lies in a folder");
    fs::remove_dir_all(folder).expect("the folder is ours");
}

#[test]
fn the_picture_of_the_readme_is_what_its_command_draws() {
    if leadscrew::axis::AXES > 3 {
        return;
    }
    let root = Path::new(concat!(env!("CARGO_MANIFEST_DIR"), "/../.."));
    let folder = tempfile::tempdir().expect("a folder can be made");
    let picture = folder.path().join("view.svg");
    let output = Command::new(env!("CARGO_BIN_EXE_view"))
        .arg("view")
        .args([
            "examples/plate.nc",
            "--settings",
            "examples/mill.settings",
            "--picture",
        ])
        .arg(&picture)
        .current_dir(root)
        .output()
        .expect("it starts");
    assert!(output.status.success(), "{output:?}");
    let [drawn, shown] = [picture, root.join("docs/view.svg")]
        .map(|path| fs::read_to_string(path).expect("the picture is there"));
    assert!(
        drawn == shown,
        "draw docs/view.svg again, by the command of docs/view.md"
    );
    assert!(shown.len() < 300_000, "{} bytes", shown.len());
}
