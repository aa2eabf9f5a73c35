//! Debian's dfu-util takes the files for DFU, and refuses damaged ones. Without it, the test says so and ends.

use std::{fs, process::Command};

#[test]
fn dfu_util_finds_the_suffix_of_a_file_and_its_crc() {
    if Command::new("dfu-suffix")
        .arg("--version")
        .output()
        .is_err()
    {
        eprintln!("skipped: there is no dfu-suffix, `apt-get install dfu-util`");
        return;
    }
    let folder = tempfile::tempdir().unwrap();
    let path = folder.path().join("leadscrew.dfu");
    let check = |bytes: &[u8]| {
        fs::write(&path, bytes).unwrap();
        let output = Command::new("dfu-suffix")
            .arg("--check")
            .arg(&path)
            .output();
        let output = output.unwrap();
        let printed = [output.stdout, output.stderr].concat();
        let printed = String::from_utf8_lossy(&printed).into_owned();
        (output.status.success(), printed)
    };
    let file = formats::dfuse(&[(0x0800_0000, &[1, 2, 3, 4][..])], "A board");
    let (is_taken, printed) = check(&file);
    let crc = u32::from_le_bytes(*file.last_chunk().unwrap());
    assert!(is_taken, "{printed}");
    for line in [
        "BCD device:\t0xFFFF",
        "Product ID:\t0xDF11",
        "Vendor ID:\t0x0483",
        "BCD DFU:\t0x011A",
        "Length:\t\t16",
        &format!("CRC:\t\t0x{crc:08X}"),
    ] {
        assert!(printed.contains(line), "{line:?}: {printed}");
    }
    let mut damaged = file.clone();
    damaged[293] ^= 1;
    for wrong in [damaged, file[..file.len() - 1].to_vec()] {
        let (is_taken, printed) = check(&wrong);
        assert!(!is_taken, "{printed}");
    }
}
