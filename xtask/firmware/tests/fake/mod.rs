//! Programs in the place of Cargo and of Python, and a firmware that no compiler has made.
#![allow(dead_code, reason = "no test uses all of it")]

use std::{
    env, fs,
    path::{Path, PathBuf},
    process::{Command, Output},
};

/// A Cargo that builds nothing and leaves a file where a firmware, or a tool, would be.
const CARGO: &str = "#!/bin/sh
while [ $# -gt 0 ]; do
  case \"$1\" in
    --target) target=$2 ;;
    --target-dir) folder=$2 ;;
    --package) tool=$2 ;;
  esac
  shift
done
mkdir -p \"$folder/debug\" \"$folder/$target/release\"
case \"$tool\" in
  firmware) ln -sf \"$FIRMWARE_TOOL\" \"$folder/debug/firmware\" ;;
  schedule) ln -sf \"$0-proof\" \"$folder/debug/schedule\" ;;
  *) cp \"$FALSE_ELF-${LEADSCREW_AXES:-3}\" \"$folder/$target/release/leadscrew\" ;;
esac
";

/// A proof that gives each firmware the same rate.
const PROOF: &str = "#!/bin/sh
echo 30000
";

/// The bytes of the vectors, by their section.
const VECTOR_BYTES: u32 = 0x80;
/// Where, in the program, the words of its CRC are, and behind them those of its rate.
const CHECK_OFFSET: u32 = 0x80;

/// The board that such firmware is for.
pub(crate) const BOARD: &str = "btt-skr-2";

/// Writes ELF files with one segment of a program that begins with two vectors: its address, and its bytes; one for each
/// number of axes of [`BOARD`].
pub(crate) fn elf(folder: &Path, address: u32, stack: u32, bytes: u32) -> PathBuf {
    let path = folder.join("false.elf");
    let board = firmware::boards::named(BOARD).expect("the project has the board");
    for axes in 3..=board.most_axes() {
        let fingerprint = board_data::fingerprint(&board, axes);
        let file = elf_of(fingerprint, address, stack, bytes);
        let path = format!("{}-{axes}", path.display());
        fs::write(path, file).expect("the folder is writable");
    }
    path
}

/// Names of sections and symbols, and the table of symbols, as an ELF file has them. All of the program counts as its
/// vectors.
fn symbols(fingerprint: u32, address: u32, bytes: u32) -> (Vec<u8>, Vec<u32>) {
    const ABSOLUTE: u32 = 0xfff1;
    let symbols = [
        ("IMAGE_CHECK", address + CHECK_OFFSET, 2),
        ("PROVEN", address + CHECK_OFFSET + 8, 2),
        ("_board_fingerprint", fingerprint, ABSOLUTE),
        ("__vector_table", address, ABSOLUTE),
        ("_vectors_end", address + bytes, ABSOLUTE),
    ];
    let empty = [
        "__stext",
        "__etext",
        "__srodata",
        "__erodata",
        "__sidata",
        "__sdata",
        "__edata",
    ];
    let mut names = b"\0.vector_table\0.text\0".to_vec();
    let mut table = vec![0; 4];
    for (name, value, section) in (symbols.into_iter()).chain(empty.map(|name| (name, 0, ABSOLUTE)))
    {
        table.extend([names.len() as u32, value, 8, section << 16 | 0x11]);
        names.extend(name.bytes().chain([0]));
    }
    names.resize(names.len().next_multiple_of(4), 0);
    (names, table)
}

/// The same for a board's fingerprint. A section and symbols tell the place of the CRC.
pub(crate) fn elf_of(fingerprint: u32, address: u32, stack: u32, bytes: u32) -> Vec<u8> {
    const PROGRAM_AT: u32 = 84;
    let (names, table) = symbols(fingerprint, address, bytes);
    let names_at = PROGRAM_AT + bytes;
    let table_at = names_at + names.len() as u32;
    let table_bytes = 4 * table.len() as u32;
    let header = [
        0x0028_0002,
        1,
        0,
        52,
        table_at + table_bytes,
        0,
        0x0020_0034,
        0x0028_0001,
        0x0003_0005,
    ];
    let segment = [1, PROGRAM_AT, address, address, bytes, bytes, 7, 4];
    let mut file = b"\x7fELF\x01\x01\x01\0\0\0\0\0\0\0\0\0".to_vec();
    let words = |file: &mut Vec<u8>, words: &[u32]| {
        file.extend(words.iter().flat_map(|word| word.to_le_bytes()));
    };
    words(&mut file, &header);
    words(&mut file, &segment);
    words(&mut file, &[stack, address + 9]);
    file.resize((PROGRAM_AT + CHECK_OFFSET) as usize, 0xbf);
    file.extend(b"CRC?    PROV    ");
    file.resize(names_at as usize, 0xbf);
    file.extend(&names);
    words(&mut file, &table);
    let check = address + CHECK_OFFSET;
    let text = [PROGRAM_AT + CHECK_OFFSET, bytes - CHECK_OFFSET];
    for section in [
        [0; 10],
        [1, 1, 2, address, PROGRAM_AT, VECTOR_BYTES, 0, 0, 4, 0],
        [15, 1, 2, check, text[0], text[1], 0, 0, 4, 0],
        [0, 3, 0, 0, names_at, names.len() as u32, 0, 0, 1, 0],
        [0, 2, 0, 0, table_at, table_bytes, 3, 1, 4, 16],
    ] {
        words(&mut file, &section);
    }
    file
}

/// A program that is a script. Another process writes it: one that is open for writing cannot be started, and a test
/// beside this one may be starting something, with all that is open.
pub(crate) fn program(folder: &Path, name: &str, script: &str) -> PathBuf {
    let (text, path) = (folder.join("script"), folder.join(name));
    fs::write(&text, script).expect("the folder is writable");
    let mut install = Command::new("install");
    let status = install.args(["-m", "755"]).arg(text).arg(&path).status();
    assert!(
        status.is_ok_and(|status| status.success()),
        "{}",
        path.display()
    );
    path
}

/// An empty folder below that of build results.
pub(crate) fn folder(name: &str) -> PathBuf {
    let folder = Path::new(env!("CARGO_TARGET_TMPDIR")).join(name);
    let _ = fs::remove_dir_all(&folder);
    fs::create_dir_all(&folder).expect("the target folder is writable");
    folder
}

/// Runs the tool with this Cargo, and with the programs of a folder before all others.
pub(crate) fn tool(folder: &Path, elf: &Path, arguments: &[&str]) -> Output {
    let tool = env!("CARGO_BIN_EXE_firmware");
    let path = env::var_os("PATH").unwrap_or_default();
    let folders = [folder.to_owned()]
        .into_iter()
        .chain(env::split_paths(&path));
    let path = env::join_paths(folders).expect("the folder's name has no colon");
    program(folder, "cargo-proof", PROOF);
    let mut command = Command::new(tool);
    command.args(arguments).env("PATH", path);
    command.env("CARGO", program(folder, "cargo", CARGO));
    command.env("CARGO_TARGET_DIR", folder);
    command.env("FALSE_ELF", elf).env("FIRMWARE_TOOL", tool);
    command.output().expect("the tool has been built")
}
