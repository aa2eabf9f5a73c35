//! A file of a release that is not what the release says, is written nowhere, and the reason is told.
#![cfg(unix)]
#![allow(
    clippy::semicolon_if_nothing_returned,
    reason = "each change of a table is an expression"
)]

mod fake;

use std::{
    collections::BTreeMap,
    fs,
    path::{Path, PathBuf},
    process::Command,
    sync::Mutex,
};

use firmware::{
    boards::{self, Board, image::parts},
    flash, image, release,
    released::Released,
};
use hmac_sha256::Hash;
use serde_json::Value;

/// The rate of the images, steps/s, and the end of the RAM of their chips.
const RATE: u32 = 30_000;
const RAM_END: u32 = 0x2002_0000;
const PROGRAM_BYTES: u32 = 0x400;
/// Boards of which each has another file beside the hex file.
const SD_CARD_BOARD: &str = "btt-skr-2";
const UF2: &str = "flexi-hal";
const DFU: &str = "blackpill-f411";
/// One with the chip and the bootloader of the first.
const OTHER: &str = "btt-skr-pro-1.2";

/// What of the release is made anew after a falsification, as somebody would who means it.
#[derive(Debug, Clone, Copy, PartialEq, Eq)]
enum Renewed {
    Nothing,
    /// The digests of the sums.
    Sums,
    /// Those of the index, too.
    All,
}

/// A release with one board, and what changes it.
struct Release {
    folder: PathBuf,
    board: Board,
}

/// The release of a board with a rate, which is made once.
fn template(name: &str, rate: u32) -> PathBuf {
    static MADE: Mutex<BTreeMap<(String, u32), PathBuf>> = Mutex::new(BTreeMap::new());
    let mut made = MADE.lock().unwrap();
    let entry = made.entry((name.to_owned(), rate));
    entry.or_insert_with(|| make(name, rate)).clone()
}

fn make(name: &str, rate: u32) -> PathBuf {
    let folder = fake::folder(&format!("template-{name}-{rate}"));
    let board = boards::named(name).unwrap();
    let memory = board.chosen_memory();
    let stack = RAM_END.min(0x2000_0000 + memory.ram_bytes);
    release::release(std::slice::from_ref(&board), &folder, None, || {
        for axes in 3..=board.most_axes() {
            let fingerprint = board_data::fingerprint(&board, axes);
            let mut elf = fake::elf_of(fingerprint, memory.flash_start, stack, PROGRAM_BYTES);
            image::write(&mut elf, rate)?;
            release::write_image(&board, axes as u8, &folder, elf, (rate, None), Vec::new())?;
        }
        Ok(true)
    })
    .unwrap();
    folder
}

fn copy_folder(from: &Path, to: &Path) {
    fs::create_dir_all(to).unwrap();
    for entry in fs::read_dir(from).unwrap() {
        let entry = entry.unwrap();
        let to = to.join(entry.file_name());
        if entry.path().is_dir() {
            copy_folder(&entry.path(), &to);
        } else {
            fs::copy(entry.path(), to).unwrap();
        }
    }
}

impl Release {
    fn new(folder: &str, name: &str, rate: u32) -> Self {
        let folder = fake::folder(folder);
        copy_folder(&template(name, rate), &folder);
        let board = boards::named(name).unwrap();
        Self { folder, board }
    }

    fn path(&self, name: &str) -> PathBuf {
        self.folder.join(&self.board.name).join("3-axes").join(name)
    }

    fn read(&self, name: &str) -> Vec<u8> {
        fs::read(self.path(name)).unwrap()
    }

    fn change(&self, name: &str, change: impl FnOnce(&mut Vec<u8>)) {
        let mut bytes = self.read(name);
        change(&mut bytes);
        fs::write(self.path(name), bytes).unwrap();
    }

    /// Writes a file of the image's parts, which are changed.
    fn with_parts(
        &self,
        name: &str,
        format: impl Fn(&[(u32, &[u8])]) -> Vec<u8>,
        change: impl FnOnce(&mut Vec<(u32, Vec<u8>)>),
    ) {
        let elf = self.read("leadscrew.elf");
        let own = parts(&elf).unwrap();
        let mut own: Vec<_> = own
            .iter()
            .map(|(at, bytes)| (*at, bytes.to_vec()))
            .collect();
        change(&mut own);
        let own: Vec<_> = own.iter().map(|(at, bytes)| (*at, &bytes[..])).collect();
        fs::write(self.path(name), format(&own)).unwrap();
    }

    fn hex(&self, change: impl FnOnce(&mut Vec<(u32, Vec<u8>)>)) {
        self.with_parts(
            "leadscrew.hex",
            |own| formats::hex(own).into_bytes(),
            change,
        );
    }

    fn dfu(&self, title: &str, change: impl FnOnce(&mut Vec<(u32, Vec<u8>)>)) {
        self.with_parts("leadscrew.dfu", |own| formats::dfuse(own, title), change);
    }

    fn uf2(&self, family: u32, change: impl FnOnce(&mut Vec<(u32, Vec<u8>)>)) {
        self.with_parts("leadscrew.uf2", |own| formats::uf2(own, family), change);
    }

    /// Changes what the index says of the board.
    fn index(&self, change: impl FnOnce(&mut Value)) {
        let path = self.folder.join("index.json");
        let mut index: Value = serde_json::from_slice(&fs::read(&path).unwrap()).unwrap();
        change(&mut index);
        fs::write(path, index.to_string()).unwrap();
    }

    fn renew(&self, renewed: Renewed) {
        if renewed == Renewed::All {
            self.index(|index| {
                for image in index["boards"][0]["images"].as_array_mut().unwrap() {
                    self.digest(image);
                }
            });
            let path = self.path("image.json");
            let mut image = serde_json::from_slice(&fs::read(&path).unwrap()).unwrap();
            self.digest(&mut image);
            fs::write(path, image.to_string()).unwrap();
        }
        if renewed != Renewed::Nothing {
            let path = self.folder.join("SHA256SUMS");
            let sums = fs::read_to_string(&path).unwrap();
            let sums = sums.lines().map(|line| {
                let (_, name) = line.split_once("  ").unwrap();
                let bytes = fs::read(self.folder.join(name)).unwrap_or_default();
                format!("{}  {name}\n", sha256(&bytes))
            });
            let sums: String = sums.collect();
            fs::write(path, sums).unwrap();
        }
    }

    /// The digests of an image's files.
    fn digest(&self, image: &mut Value) {
        let axes = format!("{}-axes", image["axes"]);
        for file in image["files"].as_array_mut().unwrap() {
            let name = file["name"].as_str().unwrap().to_owned();
            let path = self.folder.join(&self.board.name).join(&axes).join(name);
            let bytes = fs::read(path).unwrap_or_default();
            file["bytes"] = bytes.len().into();
            file["sha256"] = sha256(&bytes).into();
        }
    }

    /// What `flash --from` says of the file for a method.
    fn refusal(&self, kind: &str) -> String {
        let method = flash::by(&self.board, kind).unwrap();
        let file = Released::open(&self.folder).and_then(|it| it.file(&self.board, &method));
        file.map_or_else(|error| format!("{error:#}"), |_| "it is written".into())
    }
}

fn sha256(bytes: &[u8]) -> String {
    let digits = Hash::hash(bytes).map(|byte| format!("{byte:02x}"));
    digits.concat()
}

/// A falsification: the board, by what it is flashed, what is changed, what is made anew, and the reason of the refusal.
type Falsification = (
    &'static str,
    &'static str,
    fn(&Release),
    Renewed,
    &'static str,
);

/// What makes one of a release.
const OF_THE_RELEASE: &[Falsification] = &[
    (
        SD_CARD_BOARD,
        "SD card",
        |it| it.change("firmware.bin", |bytes| bytes[0x90] ^= 1),
        Renewed::Nothing,
        "firmware.bin is damaged, or of another release",
    ),
    (
        SD_CARD_BOARD,
        "SD card",
        |it| it.change("firmware.bin", |bytes| bytes[0x90] ^= 1),
        Renewed::Sums,
        "the index has another digest",
    ),
    (
        SD_CARD_BOARD,
        "SD card",
        |it| fs::remove_file(it.path("firmware.bin")).unwrap(),
        Renewed::Nothing,
        "cannot read",
    ),
    (
        SD_CARD_BOARD,
        "SD card",
        |it| fs::remove_file(it.folder.join("SHA256SUMS")).unwrap(),
        Renewed::Nothing,
        "is no release: it has no SHA256SUMS",
    ),
    (
        SD_CARD_BOARD,
        "SD card",
        |it| fs::write(it.folder.join("SHA256SUMS"), "").unwrap(),
        Renewed::Nothing,
        "SHA256SUMS does not list index.json",
    ),
    (
        SD_CARD_BOARD,
        "SD card",
        |it| fs::write(it.folder.join("SHA256SUMS"), "sums").unwrap(),
        Renewed::Nothing,
        "is no list of sums",
    ),
    // The index of an older release beside newer files, alone, with its sums, with sums that were made anew.
    (
        SD_CARD_BOARD,
        "SD card",
        |it| older(it, &["index.json"]),
        Renewed::Nothing,
        "index.json is damaged, or of another release",
    ),
    (
        SD_CARD_BOARD,
        "SD card",
        |it| older(it, &["index.json", "SHA256SUMS"]),
        Renewed::Nothing,
        "image.json is damaged, or of another release",
    ),
    (
        SD_CARD_BOARD,
        "SD card",
        |it| older(it, &["index.json"]),
        Renewed::Sums,
        "image.json says something else than the index",
    ),
    (
        SD_CARD_BOARD,
        "SD card",
        |it| older(it, &["index.json"]),
        Renewed::All,
        "image.json says something else than the index",
    ),
    (
        SD_CARD_BOARD,
        "SD card",
        |it| it.index(|index| index["format"] = 2.into()),
        Renewed::Sums,
        "the index has format 2, and these sources read 1",
    ),
    (
        SD_CARD_BOARD,
        "SD card",
        |it| it.index(|index| index["boards"] = "none".into()),
        Renewed::Sums,
        "the index is no index",
    ),
    (
        SD_CARD_BOARD,
        "SD card",
        |it| it.index(|index| index["boards"][0]["name"] = "mill".into()),
        Renewed::Sums,
        "it has no board btt-skr-2, but\n  mill",
    ),
    (
        SD_CARD_BOARD,
        "SD card",
        |it| it.index(|index| index["boards"][0]["chip"] = "STM32F446ZE".into()),
        Renewed::Sums,
        "its image is for an STM32F446ZE with 8 MHz, and this board has an STM32F407VG",
    ),
    (
        SD_CARD_BOARD,
        "SD card",
        |it| it.index(|index| index["boards"][0]["crystal_mhz"] = 25.into()),
        Renewed::Sums,
        "with 25 MHz, and this board has an STM32F407VG with 8 MHz",
    ),
    (
        SD_CARD_BOARD,
        "SD card",
        |it| it.index(|index| index["boards"][0]["images"][0]["axes"] = 6.into()),
        Renewed::Sums,
        "it has no image with 3 axes, but with 6, 4, 5",
    ),
    (
        SD_CARD_BOARD,
        "SD card",
        |it| it.index(|index| index["boards"][0]["images"][0]["start"] = 0x0800_0000.into()),
        Renewed::Sums,
        "its image begins at 0x08000000, and a program of this board at 0x08008000",
    ),
    (
        SD_CARD_BOARD,
        "SD card",
        |it| it.index(|index| index["boards"][0]["images"][0]["files"] = Vec::<u8>::new().into()),
        Renewed::Sums,
        "image.json says something else",
    ),
];

/// The image.
const OF_THE_IMAGE: &[Falsification] = &[
    (
        SD_CARD_BOARD,
        "SD card",
        |it| it.change("leadscrew.elf", |bytes| bytes[84 + 0x200] ^= 1),
        Renewed::All,
        "the image has another CRC",
    ),
    (
        SD_CARD_BOARD,
        "SD card",
        |it| {
            it.change("leadscrew.elf", |bytes| {
                image::write(bytes, 99_000).unwrap()
            })
        },
        Renewed::All,
        "the image says that 99000 steps/s are proven, and the index 30000",
    ),
    (
        SD_CARD_BOARD,
        "SD card",
        |it| it.change("leadscrew.elf", |bytes| bytes[87] = 0x10),
        Renewed::All,
        "the stack begins at 0x10020000",
    ),
    (
        SD_CARD_BOARD,
        "SD card",
        |it| it.change("leadscrew.elf", |bytes| bytes[91] = 0x09),
        Renewed::All,
        "the first instruction would be at 0x09008008",
    ),
    // The folder of another board with the same chip and the same bootloader, copied over this one.
    (
        SD_CARD_BOARD,
        "SD card",
        |it| other_board(it, OTHER),
        Renewed::Nothing,
        "damaged, or of another release",
    ),
    (
        SD_CARD_BOARD,
        "SD card",
        |it| other_board(it, OTHER),
        Renewed::All,
        "it was built for another board, or for another number of axes",
    ),
    (
        SD_CARD_BOARD,
        "SD card",
        |it| other_axes(it),
        Renewed::All,
        "it was built for another board, or for another number of axes",
    ),
];

/// Each format, with digests that were made anew.
const OF_A_FORMAT: &[Falsification] = &[
    (
        SD_CARD_BOARD,
        "SD card",
        |it| it.change("firmware.bin", |bytes| bytes[0x90] ^= 1),
        Renewed::All,
        "another byte than leadscrew.elf at 0x08008090",
    ),
    (
        SD_CARD_BOARD,
        "SD card",
        |it| it.change("firmware.bin", |bytes| bytes.push(0)),
        Renewed::All,
        "it has 1025 bytes from 0x08008000 on, and leadscrew.elf has 1024",
    ),
    (
        SD_CARD_BOARD,
        "SD card",
        |it| it.change("firmware.bin", |bytes| bytes.truncate(1000)),
        Renewed::All,
        "it has 1000 bytes",
    ),
    (
        SD_CARD_BOARD,
        "SD card",
        |it| {
            it.change("firmware.bin", |bytes| {
                bytes.splice(0..0, [0xff; 0x200]);
            })
        },
        Renewed::All,
        "another byte than leadscrew.elf at 0x08008000",
    ),
    (
        SD_CARD_BOARD,
        "probe",
        |it| it.change("leadscrew.hex", |bytes| bytes[20] ^= 1),
        Renewed::All,
        "record 2 is wrong",
    ),
    (
        SD_CARD_BOARD,
        "probe",
        |it| it.change("leadscrew.hex", |bytes| bytes.truncate(bytes.len() - 12)),
        Renewed::All,
        "the file is cut",
    ),
    (
        SD_CARD_BOARD,
        "probe",
        |it| it.change("leadscrew.hex", |bytes| bytes.extend(b":0100000001FE\n")),
        Renewed::All,
        "stands behind the last one",
    ),
    (
        SD_CARD_BOARD,
        "probe",
        |it| it.hex(|own| own[0].1[0x90] ^= 1),
        Renewed::All,
        "another byte than leadscrew.elf at 0x08008090",
    ),
    (
        SD_CARD_BOARD,
        "probe",
        |it| it.hex(|own| own[0].0 -= 0x8000),
        Renewed::All,
        "lie in the bootloader, which has the first 32 KiB",
    ),
    (
        SD_CARD_BOARD,
        "probe",
        |it| it.hex(|own| own.push((0x080c_0000, vec![0; 16]))),
        Renewed::All,
        "lie in sector 10, which holds settings",
    ),
    (
        SD_CARD_BOARD,
        "probe",
        |it| it.hex(|own| own.push((0x0810_0000, vec![0; 16]))),
        Renewed::All,
        "lie outside of the flash",
    ),
    (
        SD_CARD_BOARD,
        "probe",
        |it| it.hex(|own| own.push((0x0800_8010, vec![0; 16]))),
        Renewed::All,
        "what is at 0x08008010 is loaded twice",
    ),
    (
        SD_CARD_BOARD,
        "probe",
        |it| it.hex(|own| own.push((0x0802_0000, vec![0; 16]))),
        Renewed::All,
        "bytes from 0x08008000 on, and leadscrew.elf has 1024",
    ),
    (
        DFU,
        "DFU",
        |it| it.change("leadscrew.dfu", |bytes| bytes[300] ^= 1),
        Renewed::All,
        "the CRC is wrong",
    ),
    (
        DFU,
        "DFU",
        |it| it.change("leadscrew.dfu", |bytes| bytes.push(b'\n')),
        Renewed::All,
        "there is no suffix",
    ),
    (
        DFU,
        "DFU",
        |it| it.change("leadscrew.dfu", |bytes| bytes.truncate(500)),
        Renewed::All,
        "there is no suffix",
    ),
    (
        DFU,
        "DFU",
        |it| it.dfu("BIGTREETECH SKR 2", |_| {}),
        Renewed::All,
        "it is for a board BIGTREETECH SKR 2, and not for WeAct BlackPill F411",
    ),
    (
        DFU,
        "DFU",
        |it| it.dfu("WeAct BlackPill F411", |own| own[0].1[0x90] ^= 1),
        Renewed::All,
        "another byte than leadscrew.elf at 0x08000090",
    ),
    (
        DFU,
        "DFU",
        |it| it.dfu("WeAct BlackPill F411", |own| own[0].0 += 0x4000),
        Renewed::All,
        "lie in sector 1, which holds settings",
    ),
    (
        DFU,
        "DFU",
        |it| it.dfu("WeAct BlackPill F411", |own| own[0].0 += 0xc000),
        Renewed::All,
        "the program has no vectors at 0x08000000",
    ),
    (
        DFU,
        "DFU",
        |it| {
            it.dfu("WeAct BlackPill F411", |own| {
                own.push((0x1fff_c000, vec![0; 16]))
            })
        },
        Renewed::All,
        "lie outside of the flash",
    ),
    (
        UF2,
        "UF2",
        |it| it.uf2(0x6d0e_49d2, |_| {}),
        Renewed::All,
        "block 0 is of another family",
    ),
    (
        UF2,
        "UF2",
        |it| {
            it.change("leadscrew.uf2", |bytes| {
                bytes.drain(512..1024);
            })
        },
        Renewed::All,
        "a block is missing",
    ),
    (
        UF2,
        "UF2",
        |it| it.change("leadscrew.uf2", |bytes| bytes.push(0)),
        Renewed::All,
        "a block is missing",
    ),
    (
        UF2,
        "UF2",
        |it| it.change("leadscrew.uf2", |bytes| bytes[40] ^= 1),
        Renewed::All,
        "another byte than leadscrew.elf at 0x08010008",
    ),
    (
        UF2,
        "UF2",
        |it| it.uf2(0x5775_5a57, |own| own[0].0 -= 0x1_0000),
        Renewed::All,
        "lie in the bootloader",
    ),
];

/// Copies files of a release that was made before.
fn older(of: &Release, names: &[&str]) {
    let name = format!("{}-older", of.folder.file_name().unwrap().to_string_lossy());
    let older = Release::new(&name, &of.board.name, RATE - 1000);
    for name in names {
        fs::copy(older.folder.join(name), of.folder.join(name)).unwrap();
    }
}

/// Copies the files of another board's image, which has the same names.
fn other_board(of: &Release, name: &str) {
    let folder = format!("{}-other", of.folder.file_name().unwrap().to_string_lossy());
    let other = Release::new(&folder, name, RATE);
    for file in fs::read_dir(other.path("")).unwrap() {
        let file = file.unwrap();
        if file.file_name() != "image.json" {
            fs::copy(file.path(), of.path(&file.file_name().to_string_lossy())).unwrap();
        }
    }
}

/// Copies the ELF file of the image with four axes.
fn other_axes(of: &Release) {
    fs::copy(of.path("../4-axes/leadscrew.elf"), of.path("leadscrew.elf")).unwrap();
}

fn refuses(name: &str, falsifications: &[Falsification]) {
    for (number, (board, kind, falsify, renewed, reason)) in falsifications.iter().enumerate() {
        let release = Release::new(&format!("{name}-{number}"), board, RATE);
        assert_eq!(release.refusal(kind), "it is written", "{number}");
        falsify(&release);
        release.renew(*renewed);
        let refusal = release.refusal(kind);
        assert!(refusal.contains(reason), "{number}: {refusal}");
    }
}

#[test]
fn what_is_no_release_or_mixed_of_two_is_refused() {
    refuses("of-release", OF_THE_RELEASE);
}

#[test]
fn an_image_that_is_damaged_or_of_another_board_is_refused() {
    refuses("of-image", OF_THE_IMAGE);
}

#[test]
fn a_file_that_has_something_else_than_the_image_is_refused() {
    refuses("of-format", OF_A_FORMAT);
}

/// Runs `flash --from` to a folder, with a Cargo that fails.
fn copy(release: &Release, to: &Path, arguments: &[&str]) -> (bool, String) {
    let mut command = Command::new(env!("CARGO_BIN_EXE_firmware"));
    command.args(["flash", "--from"]).arg(&release.folder);
    command.arg("--to").arg(to).args(arguments);
    let output = command.env("CARGO", "false").output().unwrap();
    let printed = [output.stdout, output.stderr].concat();
    let printed = String::from_utf8_lossy(&printed).into_owned();
    (output.status.success(), printed)
}

#[test]
fn the_file_of_a_release_is_copied_without_a_compiler_and_a_false_one_is_not() {
    let release = Release::new("copied", SD_CARD_BOARD, RATE);
    let card = tempfile::tempdir().unwrap();
    for arguments in [&[][..], &["--board", SD_CARD_BOARD]] {
        let (is_copied, printed) = copy(&release, card.path(), arguments);
        assert!(is_copied, "{printed}");
        let copied = card.path().join("firmware.bin");
        assert_eq!(fs::read(&copied).unwrap(), release.read("firmware.bin"));
        fs::remove_file(copied).unwrap();
    }
    let (is_copied, printed) = copy(&release, card.path(), &["--board", OTHER]);
    assert!(
        !is_copied && printed.contains("it has no board btt-skr-pro-1.2"),
        "{printed}"
    );
    release.change("firmware.bin", |bytes| bytes[9] ^= 1);
    let (is_copied, printed) = copy(&release, card.path(), &[]);
    assert!(
        !is_copied && printed.contains("firmware.bin is damaged"),
        "{printed}"
    );
    assert_eq!(fs::read_dir(card.path()).unwrap().count(), 0);
}

#[test]
fn nothing_outside_of_a_release_is_read_or_written() {
    let release = Release::new("outside", SD_CARD_BOARD, RATE);
    let sums = release.folder.join("SHA256SUMS");
    let text = fs::read_to_string(&sums).unwrap();
    for name in ["../out", "/etc/hostname", "board/../../out", "./out", ""] {
        fs::write(&sums, format!("{text}{}  {name}\n", "0".repeat(64))).unwrap();
        let error = Released::open(&release.folder).err().unwrap().to_string();
        assert!(
            error.contains("leads out of the release"),
            "{name}: {error}"
        );
    }
    fs::write(&sums, &text).unwrap();
    let released = Released::open(&release.folder).unwrap();
    released.check().unwrap();
    let folder = tempfile::tempdir().unwrap();
    released.copy(folder.path()).unwrap();
    let copied = Released::open(folder.path()).unwrap();
    copied.check().unwrap();
    // The same bytes by a link, which may lead anywhere.
    let file = folder
        .path()
        .join(SD_CARD_BOARD)
        .join("3-axes/firmware.bin");
    let elsewhere = folder.path().join("elsewhere");
    fs::rename(&file, &elsewhere).unwrap();
    std::os::unix::fs::symlink(&elsewhere, &file).unwrap();
    let error = copied.check().unwrap_err().to_string();
    assert!(error.ends_with("firmware.bin is no file"), "{error}");
}
