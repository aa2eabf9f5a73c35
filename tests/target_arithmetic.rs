//! Arithmetic on the target's own FPU, bit for bit as on the host.
#![cfg_attr(target_os = "none", no_std, no_main)]

#[cfg(target_os = "none")]
#[path = "support/fingerprints.rs"]
mod fingerprints;
#[cfg(target_os = "none")]
#[path = "support/target.rs"]
mod target;

#[cfg(not(target_os = "none"))]
fn main() {
    println!("skipped on the host: `cargo xtask test` runs it in QEMU");
}

#[cfg(target_os = "none")]
#[defmt_test::tests]
mod tests {
    use defmt::assert_eq;

    use crate::fingerprints::FINGERPRINTS;

    #[test]
    fn arithmetic_has_the_fingerprints_of_the_host() {
        for (name, compute, expected) in FINGERPRINTS {
            assert_eq!(compute(), expected, "{}", name);
        }
    }
}
