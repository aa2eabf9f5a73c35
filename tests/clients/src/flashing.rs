//! The page of a release in a browser, whose `navigator.usb` is a model of the bootloader in a chip's ROM.

use std::{
    fs,
    net::TcpListener,
    path::{Path, PathBuf},
    thread,
};

use anyhow::{Context, Result};
use common::check::Verdict;
use dfuse_model::{Chip, Device, FLASH, Faults, serve};
use firmware::{
    boards::{self, Board},
    release::{self, BoardEntry, Index, ReleasedImage},
};
use pages::web::{install, page};
use serde_json::{Value, json};

use super::browser;

/// What looks at the page.
const SCRIPT: &str = "install_page.js";
/// What the flash has before: no firmware of ours.
const BEFORE: u8 = 0xa5;
/// The bytes of vectors, and of code over two sectors: the last block of a transfer has a single byte.
const VECTOR_BYTES: usize = 0x1c4;
const CODE_BYTES: usize = 10 * 2048 + 1;
/// Where a `DfuSe` file has its first part.
const FIRST_PART: usize = 285;
/// The boards of the release: flashed by each method, and by DFU with and without a bootloader before the program.
const BOARDS: [&str; 6] = [
    "blackpill-f411",
    "btt-octopus-1.1-f429",
    "btt-octopus-1.1-f446",
    "btt-skr-2",
    "flexi-hal",
    "nucleo-f446re",
];
/// After how many transfers the cable is pulled out: in each stage of an installation.
const UNPLUGGED_AFTER: [u64; 8] = [0, 3, 12, 19, 24, 60, 150, 230];

/// Bytes of an image, with their addresses.
type Parts = Vec<(u32, Vec<u8>)>;

fn borrowed(parts: &Parts) -> Vec<formats::Part<'_>> {
    parts.iter().map(|(at, bytes)| (*at, &bytes[..])).collect()
}

/// An image of a board in the places that its firmware has, of bytes that are no program.
fn parts(board: &Board, axes: usize) -> Parts {
    let memory = board.memory(axes);
    let code = { memory.code_start }.unwrap_or(memory.flash_start + VECTOR_BYTES as u32);
    let bytes = |length: usize| (0..length).map(|at| (at * 7 + at / 251 + axes) as u8);
    vec![
        (memory.flash_start, bytes(VECTOR_BYTES).collect()),
        (code, bytes(CODE_BYTES).collect()),
    ]
}

/// Makes a release in a folder.
fn released(out: &Path) -> Result<()> {
    let entries = BOARDS.iter().map(|name| {
        let board = boards::named(name)?;
        let images = (3..=board.most_axes()).map(|axes| {
            let memory = board.memory(axes);
            let image = ReleasedImage {
                axes: axes as u8,
                start: memory.flash_start,
                step_rate_hz: 200_000 - 1000 * axes as u32,
                step_rate_at_1_mbaud_hz: (!board.has_usb()).then_some(150_000),
                settings_outlive_bin: memory.code_start.is_none(),
                files: Vec::new(),
            };
            let parts = parts(&board, axes);
            let files = release::files_of(&board, memory.flash_start, &borrowed(&parts));
            image.write(name, files, out)
        });
        Ok(BoardEntry::new(&board, images.collect::<Result<_>>()?))
    });
    let index = Index::new("0123456789abcdef".into(), entries.collect::<Result<_>>()?);
    index.write(out, "the licences\n")
}

/// The flash of a chip after an image was installed: whole sectors are erased, and no other changes.
fn installed(chip: Chip, parts: &Parts) -> Vec<u8> {
    let mut flash = Vec::new();
    for bytes in chip.sectors() {
        let start = FLASH + flash.len() as u32;
        let end = start + bytes;
        let is_touched = |(at, part): &(u32, Vec<u8>)| *at < end && at + part.len() as u32 > start;
        let fill = if parts.iter().any(is_touched) {
            0xff
        } else {
            BEFORE
        };
        flash.resize(flash.len() + bytes as usize, fill);
    }
    for (at, part) in parts {
        let at = (at - FLASH) as usize;
        flash[at..at + part.len()].copy_from_slice(part);
    }
    flash
}

/// Serves a device until the program ends; returns where.
fn served(chip: Chip, faults: Faults) -> Result<String> {
    let mut device = Device::new(chip);
    device.flash_mut().fill(BEFORE);
    device.faults = faults;
    let listener = TcpListener::bind("127.0.0.1:0")?;
    let address = format!("http://{}", listener.local_addr()?);
    thread::spawn(move || serve(&mut device, &listener));
    Ok(address)
}

/// What the script tries, in a folder.
struct Cases {
    folder: PathBuf,
    cases: Vec<Value>,
}

impl Cases {
    /// Adds an installation of an image at a chip, with what the page says at its end.
    fn add(
        &mut self,
        name: &str,
        (board, axes): (&str, usize),
        chip: &str,
        faults: Faults,
        more: Value,
    ) -> Result<()> {
        let known = boards::named(board)?;
        let chip = Chip::named(chip).context("the model knows the chip")?;
        let image = parts(&known, axes);
        let file = self.folder.join(format!("flash {}", self.cases.len()));
        fs::write(&file, installed(chip, &image))?;
        let mut case = json!({
            "name": name,
            "board": board,
            "axes": axes,
            "device": served(chip, faults)?,
            "installed": file,
            "start": format!("{:#010x}", known.memory(axes).flash_start),
        });
        let fields = case.as_object_mut().context("it is an object")?;
        if let Value::Object(more) = more {
            fields.extend(more);
        }
        self.cases.push(case);
        Ok(())
    }

    /// Adds a file in place of the one of [`BLACKPILL`], with the words of the page; the page may have the sum of the
    /// falsified file.
    fn add_file(&mut self, name: &str, bytes: &[u8], has_sum: bool, says: &str) -> Result<()> {
        let file = self.folder.join(format!("file {}", self.cases.len()));
        fs::write(&file, bytes)?;
        let more = json!({ "file": file, "hasSum": has_sum, "says": says });
        self.add(name, BLACKPILL, "f411", Faults::default(), more)
    }
}

/// The case without a mouse.
const WITH_KEYS: &str = "with keys";
const BLACKPILL: (&str, usize) = ("blackpill-f411", 3);

/// What is installed, at chips without and with faults.
fn add_devices(cases: &mut Cases) -> Result<()> {
    let good = Faults::default();
    let slow = Faults {
        busy_polls: 3,
        ..good
    };
    for (name, image, chip, faults) in [
        ("vectors and code apart", BLACKPILL, "f411", good),
        ("four axes, busy", ("blackpill-f411", 4), "f411", slow),
        (
            "behind a bootloader",
            ("btt-octopus-1.1-f446", 3),
            "f446",
            good,
        ),
        ("1 MiB", ("btt-octopus-1.1-f429", 3), "f429", good),
        ("two banks", ("btt-octopus-1.1-f429", 3), "f429-2m", good),
        ("without BOOT0", ("btt-skr-2", 3), "f407", good),
        (WITH_KEYS, ("blackpill-f411", 4), "f411", good),
    ] {
        let more = json!({ "says": "read back and compared", "isInstalled": true, "keys": name == WITH_KEYS });
        cases.add(name, image, chip, faults, more)?;
    }
    for (name, image, chip) in [
        ("more flash", BLACKPILL, "f407"),
        ("less flash", ("btt-octopus-1.1-f429", 3), "f446"),
    ] {
        let more = json!({ "says": "The chip at USB is another one" });
        cases.add(name, image, chip, good, more)?;
    }
    let is_protected = Faults {
        is_protected: true,
        ..good
    };
    let more = json!({ "says": "The chip is protected against reading" });
    cases.add("protected", BLACKPILL, "f411", is_protected, more)?;
    let no_erase = Faults {
        no_erase: Some(4),
        ..good
    };
    let more = json!({ "says": "error 4, state 10, while the flash was erased", "isBegun": true });
    cases.add("a sector stays", BLACKPILL, "f411", no_erase, more)?;
    let stuck = Faults {
        stuck: Some(FLASH + 0xc000 + 0x900),
        ..good
    };
    let more = json!({ "says": "0x0800c800 is not what was written", "isBegun": true });
    cases.add("a byte stays", BLACKPILL, "f411", stuck, more)?;
    for transfers in UNPLUGGED_AFTER {
        let faults = Faults {
            unplugged_after: Some(transfers),
            ..good
        };
        let chip = Chip::named("f411").context("the model knows the chip")?;
        let again = served(chip, good)?;
        let more = json!({ "says": "The connection to the board broke", "again": again });
        let name = format!("unplugged after {transfers}");
        cases.add(&name, BLACKPILL, "f411", faults, more)?;
    }
    Ok(())
}

/// What the browser and the system refuse.
fn add_refusals(cases: &mut Cases) -> Result<()> {
    for (usb, says) in [
        ("none", "This browser cannot reach a board over USB"),
        ("insecure", "only from a page that came by https"),
        ("NotFoundError", "No board was chosen"),
        ("SecurityError", "does not permit its use"),
        ("open", "(Access denied). See \"No access\" below."),
        ("claim", "Another program uses the board"),
    ] {
        let more = json!({ "usb": usb, "says": says });
        cases.add(usb, BLACKPILL, "f411", Faults::default(), more)?;
    }
    Ok(())
}

/// A file with one bit changed.
fn flipped(file: &[u8], at: usize) -> Vec<u8> {
    let mut bytes = file.to_vec();
    bytes[at] ^= 1;
    bytes
}

/// Files that are not those of the release, without and with their sums in the page.
fn add_falsified(cases: &mut Cases, right: &[u8]) -> Result<()> {
    let board = boards::named(BLACKPILL.0)?;
    let older = formats::dfuse(&borrowed(&parts(&board, 4)), &board.title);
    let sum = "its SHA-256 is another";
    let cut = &right[..right.len() - 100];
    cases.add_file("a bit", &flipped(right, 5000), false, sum)?;
    cases.add_file("cut", cut, false, sum)?;
    cases.add_file("older", &older, false, sum)?;
    let crc = "its CRC is wrong";
    cases.add_file("a bit, its sum", &flipped(right, 5000), true, crc)?;
    let suffix = "its suffix is missing";
    cases.add_file("cut, its sum", cut, true, suffix)?;
    cases.add_file("short, its sum", &right[..200], true, "it is too short")?;
    let missing =
        json!({ "file": cases.folder.join("no file"), "says": "The file cannot be fetched: 404" });
    cases.add("no file", BLACKPILL, "f411", Faults::default(), missing)
}

/// Files that are whole, but for other boards or other places.
fn add_misplaced(cases: &mut Cases) -> Result<()> {
    let board = boards::named(BLACKPILL.0)?;
    let at = |vectors: u32, code: u32| {
        let mut parts = parts(&board, 3);
        (parts[0].0, parts[1].0) = (vectors, code);
        parts
    };
    let octopus = "BIGTREETECH Octopus 1.1 (F446)";
    for (name, title, parts, says) in [
        (
            "another board",
            octopus,
            parts(&board, 3),
            "for another board: BIGTREETECH Octopus 1.1 (F446)",
        ),
        (
            "another place",
            &board.title,
            at(FLASH + 0x8000, FLASH + 0x1_4000),
            "for another place: 0x08008000 instead of 0x08000000",
        ),
        (
            "beyond the flash",
            &board.title,
            at(FLASH, FLASH + 512 * 1024 - 100),
            "something at 0x0807ff9c that does not belong there",
        ),
        (
            "over itself",
            &board.title,
            at(FLASH, FLASH + 100),
            "something at 0x08000064 that does not belong there",
        ),
    ] {
        let file = formats::dfuse(&borrowed(&parts), title);
        cases.add_file(name, &file, true, says)?;
    }
    Ok(())
}

/// Files whose prefix or suffix has a bit changed; the script makes their CRC anew.
fn add_malformed(cases: &mut Cases, right: &[u8]) -> Result<()> {
    let (second, last) = (FIRST_PART + 8 + VECTOR_BYTES, right.len() - 16);
    for (name, at, says) in [
        ("prefix", 0, "its prefix is wrong"),
        ("version of the prefix", 5, "its prefix is wrong"),
        ("length", 6, "its prefix is wrong"),
        ("target", 11, "its target is wrong"),
        ("length of the target", 277, "its target is wrong"),
        ("number of parts", 281, "a part of it is missing"),
        (
            "length of a part",
            FIRST_PART + 6,
            "a part of it is missing",
        ),
        (
            "a shorter last part",
            second + 4,
            "its parts do not fill it",
        ),
        ("a longer last part", second + 6, "its parts do not fill it"),
        ("vendor", last + 4, "for another bootloader"),
        ("product", last + 2, "for another bootloader"),
        ("version of the suffix", last + 6, "for another bootloader"),
    ] {
        cases.add_file(name, &flipped(right, at), true, says)?;
        let case = cases.cases.last_mut().context("it was added")?;
        case["hasCrc"] = true.into();
    }
    Ok(())
}

/// Has a browser install images from the page.
pub(super) fn page() -> Result<Verdict> {
    browser::run_script(SCRIPT, "install-page", |folder, node| {
        let [release, site] = ["release", "site"].map(|name| folder.join(name));
        fs::create_dir_all(&release)?;
        fs::create_dir_all(&site)?;
        released(&release)?;
        let released = install::copy(&release, &site)?;
        let index = released.index();
        fs::write(site.join(install::FILE), install::write(index))?;
        fs::write(site.join("index.html"), page::write(b"", 0, Some(index)))?;
        let mut cases = Cases {
            folder: folder.clone(),
            cases: Vec::new(),
        };
        add_devices(&mut cases)?;
        add_refusals(&mut cases)?;
        let right = fs::read(release.join(BLACKPILL.0).join("3-axes/leadscrew.dfu"))?;
        add_falsified(&mut cases, &right)?;
        add_misplaced(&mut cases)?;
        add_malformed(&mut cases, &right)?;
        let file = folder.join("cases.json");
        fs::write(&file, Value::from(cases.cases).to_string())?;
        node.arg(site).arg(file);
        Ok(())
    })
}
