//! Random tests are quick by default, and as long as `LEADSCREW_CASES` wants them.

use super::sources;

/// The places where random tests try a number of cases that nobody can change.
fn fixed(path: &str, source: &str) -> Vec<String> {
    let lines: Vec<&str> = source.lines().map(str::trim).collect();
    lines
        .iter()
        .enumerate()
        .filter(|(_, line)| **line == "proptest! {")
        .map(|(index, _)| (index + 2, *lines.get(index + 1).unwrap_or(&"")))
        .filter(|(_, next)| !next.starts_with("#![proptest_config(") || !next.contains("cases("))
        .map(|(number, _)| format!("{path}:{number}: #![proptest_config(cases(…))] is missing"))
        .collect()
}

#[test]
fn every_random_test_has_a_number_of_cases_that_can_grow() {
    let all = sources(&["src", "tests", "xtask", "proof"]);
    let fixed: Vec<_> = all
        .iter()
        .flat_map(|(path, text)| fixed(path, text))
        .collect();
    assert!(fixed.is_empty(), "{fixed:#?}");
    let random = |(_, text): &&(String, String)| text.contains("\nproptest! {");
    assert!(all.iter().filter(random).count() > 10);
}

#[test]
fn a_number_of_cases_that_cannot_grow_is_found() {
    let good = "proptest! {\n    #![proptest_config(crate::cases(8))]\n";
    assert!(fixed("a.rs", good).is_empty());
    for bad in [
        "    proptest! {\n        #[test]\n",
        "proptest! {\n    #![proptest_config(ProptestConfig::default())]\n",
    ] {
        assert_eq!(fixed("a.rs", bad).len(), 1, "{bad}");
    }
}
