//! A firmware that would not start is written nowhere: `build` and `size` say which bytes are in the wrong place.
#![cfg(unix)]

use std::{
    fs,
    os::unix::fs::PermissionsExt as _,
    path::{Path, PathBuf},
    process::Command,
};

/// A Cargo that builds nothing and leaves a file where a firmware would be.
const CARGO: &str = "#!/bin/sh
while [ $# -gt 0 ]; do
  case \"$1\" in
    --target) target=$2 ;;
    --target-dir) folder=$2 ;;
  esac
  shift
done
mkdir -p \"$folder/$target/release\"
cp \"$FALSE_ELF\" \"$folder/$target/release/leadscrew\"
";

/// An ELF file with one segment of a program that begins with two vectors: its address, and its bytes.
fn elf(folder: &Path, address: u32, stack: u32, bytes: u32) -> PathBuf {
    let mut file = b"\x7fELF\x01\x01\x01\0\0\0\0\0\0\0\0\0".to_vec();
    let header = [0x0028_0002, 1, 0, 52, 0, 0, 0x0020_0034, 0x0028_0001, 0];
    let segment = [1, 84, address, address, bytes, bytes, 7, 4];
    let vectors = [stack, address + 9];
    for word in header.iter().chain(&segment).chain(&vectors) {
        file.extend(u32::to_le_bytes(*word));
    }
    file.resize(84 + bytes as usize, 0xbf);
    let path = folder.join("false.elf");
    fs::write(&path, file).expect("the folder is writable");
    path
}

#[test]
fn a_firmware_in_the_wrong_place_is_refused_by_build_and_size() {
    const RAM_END: u32 = 0x2002_0000;
    for (name, board, address, stack, bytes, reason) in [
        (
            "settings",
            "nucleo-f446re",
            0x0800_0000,
            RAM_END,
            0x5000,
            "4 096 bytes of the program, 0x08004000 to 0x08004fff, lie in sector 1, which holds settings",
        ),
        (
            "bootloader",
            "btt-skr-2",
            0x0800_0000,
            RAM_END,
            0x9000,
            "32 768 bytes of the program, 0x08000000 to 0x08007fff, lie in the bootloader",
        ),
        (
            "end",
            "btt-skr-2",
            0x080f_ff00,
            RAM_END,
            0x200,
            "256 bytes of the program, 0x08100000 to 0x081000ff, lie outside of the flash",
        ),
        (
            "chip",
            "btt-skr-2",
            0x0800_8000,
            0x2003_0000,
            0x100,
            "the stack begins at 0x20030000, which is not in the RAM of the STM32F407VG",
        ),
    ] {
        let folder = Path::new(env!("CARGO_TARGET_TMPDIR")).join(name);
        fs::create_dir_all(&folder).expect("the target folder is writable");
        let cargo = folder.join("cargo");
        fs::write(&cargo, CARGO).expect("the folder is writable");
        let executable = fs::Permissions::from_mode(0o755);
        fs::set_permissions(&cargo, executable).expect("the file is there");
        let elf = elf(&folder, address, stack, bytes);
        for verb in [&["build", "--unproven"][..], &["build"], &["size"]] {
            let mut command = Command::new(env!("CARGO_BIN_EXE_firmware"));
            command.args(verb).args(["--board", board]);
            command.env("CARGO", &cargo).env("FALSE_ELF", &elf);
            let output = command.env("CARGO_TARGET_DIR", &folder).output();
            let output = output.expect("the tool has been built");
            let told = String::from_utf8_lossy(&output.stderr);
            assert!(told.contains(reason), "{name}, {verb:?}: {told}");
            assert!(!output.status.success(), "{name}, {verb:?}");
            assert!(!folder.join("firmware").exists(), "{name}, {verb:?}");
        }
    }
}
