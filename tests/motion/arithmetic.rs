//! Arithmetic on the host, bit for bit as on the target.

#[path = "../support/fingerprints.rs"]
mod fingerprints;

#[test]
fn arithmetic_has_the_fingerprints_of_the_target() {
    for (name, compute, expected) in fingerprints::FINGERPRINTS {
        let found = compute();
        assert_eq!(found, expected, "{name}: {found:#x}");
    }
}
