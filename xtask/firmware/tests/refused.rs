//! A firmware that would not start is written nowhere: `build` and `size` say which bytes are in the wrong place.
#![cfg(unix)]

mod fake;

use fake::{elf, folder, tool};

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
        (
            "board",
            "btt-skr-pro-1.2",
            0x0800_8000,
            RAM_END,
            0x100,
            "it was built for another board, or for another number of axes",
        ),
    ] {
        let folder = folder(name);
        let elf = elf(&folder, address, stack, bytes);
        for verb in [&["build", "--unproven"][..], &["build"], &["size"]] {
            let output = tool(&folder, &elf, &[verb, &["--board", board]].concat());
            let message = String::from_utf8_lossy(&output.stderr);
            assert!(message.contains(reason), "{name}, {verb:?}: {message}");
            assert!(!output.status.success(), "{name}, {verb:?}");
            assert!(!folder.join("firmware").exists(), "{name}, {verb:?}");
        }
    }
}
