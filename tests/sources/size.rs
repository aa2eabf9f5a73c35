//! How much code there is: a folder grows only with its ceiling, which a commit raises and says why.

use super::sources;

/// The most lines of code of a folder: neither blank nor comments nor unit tests.
const CEILINGS: [(&str, usize); 5] = [
    ("boards", 4_400),
    ("proof", 30_640),
    ("src", 41_300),
    ("tests", 50_250),
    ("xtask", 40_600),
];

/// How far a ceiling may be above the present count, so that ceilings are lowered with the code.
const MOST_ROOM: usize = 1_000;

/// The lines of code of a file.
fn code_lines(source: &str) -> usize {
    let mut count = 0;
    let mut lines = source.lines().peekable();
    while let Some(line) = lines.next() {
        let text = line.trim();
        let next = lines.peek().copied().unwrap_or_default();
        if text == "#[cfg(test)]" && next.starts_with("mod ") && next.ends_with('{') {
            // Up to the end of the module.
            let _ = lines.find(|line| *line == "}");
        } else if !text.is_empty() && !text.starts_with("//") {
            count += 1;
        }
    }
    count
}

#[test]
fn no_folder_has_more_code_than_its_ceiling() {
    for (folder, ceiling) in CEILINGS {
        let files = sources(&[folder]);
        let count: usize = files.iter().map(|(_, source)| code_lines(source)).sum();
        assert!(
            count <= ceiling,
            "{folder}/ has {count} lines of code, {ceiling} are allowed: delete what is no longer needed, or raise \
             the number and say why in the commit"
        );
        assert!(
            ceiling - count <= MOST_ROOM,
            "{folder}/ has {count} lines of code: lower its ceiling of {ceiling}"
        );
    }
}

/// Whoever trusts the checker reads it as a whole.
#[test]
fn the_checker_of_certificates_has_at_most_500_lines() {
    let files = sources(&["proof/check.py"]);
    let counts: Vec<_> = files.iter().map(|it| code_lines(&it.1)).collect();
    assert!(matches!(counts[..], [0..=500]), "{counts:?}");
}

#[test]
fn comments_blanks_and_unit_tests_are_no_code() {
    let source = "//! Head.\n\nfn a() {\n    // Why.\n    b();\n}\n\n#[cfg(test)]\nmod tests {\n    use super::*;\n}\n\
                  \nfn b() {}\n";
    assert_eq!(code_lines(source), 4);
    assert_eq!(code_lines("#[cfg(test)]\nmod tests;\n"), 2);
}
