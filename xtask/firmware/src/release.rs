//! `cargo xtask release`: the firmware of every board, proven, in the files that its owners' tools and bootloaders take.
//!
//! ```text
//!  OUT/index.json                       what there is, for programs
//!  OUT/SHA256SUMS                       for `sha256sum --check`
//!  OUT/LICENSES.txt                     of everything that is in an image
//!  OUT/BOARD/3-axes/leadscrew.elf ...   the images, each with its proof
//! ```

use std::{
    fmt::Write as _,
    fs,
    path::{Path, PathBuf},
    process::Command,
};

use anyhow::{Context, Result, ensure};
use common::{cargo, text::separated, tools};
use hmac_sha256::Hash;
use serde::{Deserialize, Serialize};

use crate::{
    boards::{Board, compile, image::parts, layout},
    licenses,
};

/// The form of the index.
pub(crate) const FORMAT: u32 = 1;
/// The names of files.
pub(crate) const INDEX: &str = "index.json";
pub(crate) const SUMS: &str = "SHA256SUMS";
pub(crate) const IMAGE: &str = "image.json";
const CERTIFICATE: &str = "certificate.json";
const LICENSES: &str = "LICENSES.txt";
/// The files of an image.
pub(crate) const ELF: &str = "leadscrew.elf";
const HEX: &str = "leadscrew.hex";
const BIN: &str = "leadscrew.bin";
const UF2: &str = "leadscrew.uf2";
const DFU: &str = "leadscrew.dfu";
/// The method of the bootloader in the chip's ROM.
pub const BY_DFU: &str = "DFU";
/// The other speed of a UART for which a rate is proven: the fastest that senders have.
const FAST_BAUD: &str = "1000000";

/// What an owner has to know of all boards.
pub const UNTRIED: &str = "No board has run this firmware";

/// What there is.
#[derive(Debug, Default, Serialize, Deserialize)]
pub struct Index {
    format: u32,
    /// Of the firmware.
    pub version: String,
    /// Of the sources; behind it `-dirty` where they were changed.
    pub commit: String,
    /// The boards, by name.
    pub boards: Vec<BoardEntry>,
}

/// A board, and its images.
#[derive(Debug, Serialize, Deserialize)]
pub struct BoardEntry {
    /// The name of its file.
    pub name: String,
    /// What its maker calls it.
    pub title: String,
    /// What else a user wants to know of it.
    pub about: String,
    /// The part: `STM32F411CE`.
    pub chip: String,
    /// The flashes by which the chip's own bootloader may describe it: see [`Board::flashes_kib`].
    pub flashes_kib: Vec<Vec<u32>>,
    /// Its crystal, MHz.
    pub crystal_mhz: u32,
    /// Where the sender is: `USB`, or `UART1`.
    pub sender: String,
    /// How the images come into the flash, the easiest first.
    pub flashing: Vec<FlashMethod>,
    /// With three axes, four and so on.
    pub images: Vec<ReleasedImage>,
}

/// A method to write an image into the flash.
#[derive(Debug, Serialize, Deserialize)]
pub struct FlashMethod {
    /// By what: `SD card`, `DFU` and so on.
    pub kind: String,
    /// The name of the file that it takes.
    pub file: String,
    /// What to do, one after the other, in sentences.
    pub steps: Vec<String>,
}

/// An image.
#[derive(Debug, PartialEq, Eq, Serialize, Deserialize)]
pub struct ReleasedImage {
    /// The number of axes.
    pub axes: u8,
    /// Where its vectors are.
    pub start: u32,
    /// The proven step rate of all axes together, steps/s, over USB or at 115 200 baud.
    pub step_rate_hz: u32,
    /// The same of a UART at 1 000 000 baud.
    pub step_rate_at_1_mbaud_hz: Option<u32>,
    /// Whether the settings outlive a file that is flat, as `.bin` is: they do not lie within it.
    pub settings_outlive_bin: bool,
    /// The names of its files, beside `image.json`.
    pub files: Vec<ReleasedFile>,
}

/// A file.
#[derive(Debug, PartialEq, Eq, Serialize, Deserialize)]
pub struct ReleasedFile {
    /// Its name.
    pub name: String,
    /// Its length.
    pub bytes: usize,
    /// The SHA-256 of its bytes, as `sha256sum` writes it.
    pub sha256: String,
}

/// How a board comes into its chip's bootloader.
pub fn to_dfu(board: &Board) -> &'static str {
    match (board.has_dfu, board.has_usb()) {
        (true, true) => {
            "Hold BOOT0 at 3.3 V, by its button or jumper, while you switch the board on at its USB, and let BOOT0 go \
             then; or send `$DFU` to this firmware."
        }
        (true, false) => {
            "Hold BOOT0 at 3.3 V, by its button or jumper, while you switch the board on at its USB, and let BOOT0 go \
             then."
        }
        (false, _) => {
            "For an update alone: send `$DFU` to this firmware, in the sender's console. Nothing else starts the \
             chip's bootloader, so the first time another method is needed."
        }
    }
}

/// What to do for a method, one step after the other.
fn steps(board: &Board, kind: &str, file: &str) -> Vec<String> {
    let steps: &[&str] = match kind {
        "drive" => &[
            "The board's own programmer is a drive at its USB, `{drive}`. Copy `{file}` to it: the programmer writes the \
             file, and the board restarts.",
        ],
        "SD card" => &[
            "Copy `{file}` to the root of a card with FAT32.",
            "Switch the board off, put the card in, and switch it on: the bootloader needs some seconds. \
             BIGTREETECH's renames the file to `FIRMWARE.CUR` when it is written, and others may not; if the board's port \
             does not appear, try a smaller card.",
        ],
        "UF2" => &[
            "Press the reset button twice, quickly, or send `$UF2` to this firmware: the bootloader is a drive at the \
             board's USB.",
            "Copy `{file}` to it: the bootloader writes the file, and the board restarts.",
        ],
        BY_DFU => &[
            to_dfu(board),
            "`cargo xtask flash --board {board} --dfu` builds, proves, writes and starts the firmware of the \
             sources; with `--from` and the folder of a release, it writes `{file}`. Or `dfu-util --alt 0 --download \
             {file}`, or STM32CubeProgrammer with `{hex}`: switch the board off and on afterwards. Linux wants a udev \
             rule, Windows a driver: docs/platforms.md.",
        ],
        _ => &[
            "Connect SWDIO, SWCLK and GND of a debug probe, with the board supplied from one source only; connect under \
             reset where the board's note wants it.",
            "A programmer such as STM32CubeProgrammer writes `{file}`; or `cargo xtask flash --board {board}` builds, \
             proves and writes the firmware of the sources, with `--from` and its folder that of a release.",
        ],
    };
    let drive = board.drive.as_deref().unwrap_or_default();
    let names = [
        ("{file}", file),
        ("{hex}", HEX),
        ("{drive}", drive),
        ("{board}", &board.name),
    ];
    let named = |step: &&str| {
        { names.iter() }.fold((*step).to_owned(), |text, (name, value)| {
            text.replace(name, value)
        })
    };
    steps.iter().map(named).collect()
}

/// The methods of a board, the easiest first.
pub fn flashing(board: &Board) -> Vec<FlashMethod> {
    let method = |kind: &str, file: &str| FlashMethod {
        kind: kind.into(),
        file: file.into(),
        steps: steps(board, kind, file),
    };
    let methods = [
        board.drive.as_ref().map(|_| method("drive", HEX)),
        { board.bootloader_file.as_ref() }.map(|name| method("SD card", name)),
        board.uf2_family.map(|_| method("UF2", UF2)),
        board.has_usb_bootloader().then(|| method(BY_DFU, DFU)),
        Some(method("probe", HEX)),
    ];
    methods.into_iter().flatten().collect()
}

/// The files of an image, for all methods of a board and for other tools, by name.
fn files(board: &Board, image: &[u8]) -> Result<Vec<(String, Vec<u8>)>> {
    layout::check(board, image)?;
    let start = board.chosen_memory().flash_start;
    Ok(files_of(board, start, &parts(image)?))
}

/// The same of an image that begins at an address, by its parts.
pub fn files_of(board: &Board, start: u32, parts: &[formats::Part<'_>]) -> Vec<(String, Vec<u8>)> {
    let flat = formats::flat(parts, start);
    let mut files = vec![
        (HEX.to_owned(), formats::hex(parts).into_bytes()),
        (BIN.to_owned(), flat.clone()),
    ];
    files.extend(board.bootloader_file.clone().map(|name| (name, flat)));
    let uf2 = { board.uf2_family }.map(|family| formats::uf2(parts, family));
    files.extend(uf2.map(|bytes| (UF2.to_owned(), bytes)));
    let dfu = { board.has_usb_bootloader() }.then(|| formats::dfuse(parts, &board.title));
    files.extend(dfu.map(|bytes| (DFU.to_owned(), bytes)));
    files
}

/// Writes the files of a board beside its ELF file, and returns the methods that take them, with their paths.
pub fn write(board: &Board, elf: &Path) -> Result<Vec<(FlashMethod, PathBuf)>> {
    let folder = elf.with_extension("");
    let files = files(board, &compile::read(elf)?);
    for (name, bytes) in files.with_context(|| format!("{}", elf.display()))? {
        compile::replace(&folder.join(name), &bytes)?;
    }
    let methods = flashing(board).into_iter();
    let methods = methods.map(|method| (folder.join(&method.file), method));
    Ok(methods.map(|(path, method)| (method, path)).collect())
}

/// Makes a release of boards in a folder, with each number of axes or one only, by `each`, which has the images of each board and number of axes made there.
pub fn release(
    boards: &[Board],
    out: &Path,
    only: Option<u8>,
    each: impl FnOnce() -> Result<bool>,
) -> Result<Index> {
    fs::create_dir_all(out).with_context(|| format!("cannot make {}", out.display()))?;
    let is_empty = fs::read_dir(out)?.next().is_none();
    ensure!(
        is_empty,
        "{} is not empty: a release is made in an empty folder",
        out.display()
    );
    ensure!(each()?, "not every image is proven");
    let entries = boards.iter().map(|board| {
        let images = board.numbers_of_axes(only).map(|axes| {
            let file = out.join(folder(&board.name, axes)).join(IMAGE);
            let text = fs::read_to_string(&file).with_context(|| format!("{}", file.display()))?;
            Ok(serde_json::from_str(&text)?)
        });
        ensure!(
            board.numbers_of_axes(only).count() > 0,
            "{} has no so many axes",
            board.name
        );
        Ok(BoardEntry::new(board, images.collect::<Result<_>>()?))
    });
    let index = Index::new(commit()?, entries.collect::<Result<_>>()?);
    index.write(out, &licenses::notice()?)?;
    Ok(index)
}

impl Index {
    /// The index of boards by a commit of the sources.
    pub fn new(commit: String, boards: Vec<BoardEntry>) -> Self {
        Self {
            format: FORMAT,
            version: env!("CARGO_PKG_VERSION").into(),
            commit,
            boards,
        }
    }

    /// Writes index, licences and sums beside the images.
    pub fn write(&self, out: &Path, licenses: &str) -> Result<()> {
        write_file(&out.join(INDEX), json(self)?.as_bytes())?;
        write_file(&out.join(LICENSES), licenses.as_bytes())?;
        let mut names: Vec<_> = self.files().map(|(name, _)| name).collect();
        let images = self.boards.iter().flat_map(|board| {
            let images = board.images.iter();
            images.map(|image| format!("{}/{IMAGE}", folder(&board.name, image.axes)))
        });
        names.extend(images);
        names.extend([INDEX.into(), LICENSES.into()]);
        names.sort();
        let sums = names.iter().map(|name| {
            let bytes = fs::read(out.join(name))?;
            Ok(format!("{}  {name}\n", sha256(&bytes)))
        });
        write_file(
            &out.join(SUMS),
            sums.collect::<Result<String>>()?.as_bytes(),
        )
    }

    /// The files of the images, with their paths within the release.
    pub(crate) fn files(&self) -> impl Iterator<Item = (String, &ReleasedFile)> {
        let images = self.boards.iter();
        let images = images.flat_map(|board| board.images.iter().map(move |image| (board, image)));
        images.flat_map(|(board, image)| {
            let folder = folder(&board.name, image.axes);
            let files = image.files.iter();
            files.map(move |file| (format!("{folder}/{}", file.name), file))
        })
    }
}

impl BoardEntry {
    /// What there is of a board.
    pub fn new(board: &Board, images: Vec<ReleasedImage>) -> Self {
        Self {
            name: board.name.clone(),
            title: board.title.clone(),
            about: board.about.clone(),
            chip: format!("STM32{}", board.part_name),
            flashes_kib: board.flashes_kib(),
            crystal_mhz: board.crystal_mhz,
            sender: board.sender(),
            flashing: flashing(board),
            images,
        }
    }
}

/// The folder of an image within a release.
pub fn folder(board: &str, axes: u8) -> String {
    format!("{board}/{axes}-axes")
}

/// Makes the image of a board with as many axes as were asked for, proven, in all formats; returns what it is.
pub fn image(board: &Board, into: &Path, out: &Path) -> Result<ReleasedImage> {
    let axes = cargo::axes();
    let folder = out.join(folder(&board.name, axes));
    fs::create_dir_all(&folder).with_context(|| format!("cannot make {}", folder.display()))?;
    let elf = folder.join(ELF);
    let (bytes, proof) = crate::prove_in(into, board, &[], &elf)?;
    let step_rate_hz = proof?;
    compile::replace(&elf, &bytes)?;
    let schedule = |arguments: &[&str]| {
        let mut all = vec!["--board".into(), board.argument(), "--elf".into()];
        all.push(elf.to_string_lossy().into_owned());
        all.extend(arguments.iter().map(|it| (*it).to_owned()));
        tools::output(tools::SCHEDULE, all)
    };
    let certificate = folder.join(CERTIFICATE);
    let path = certificate.to_string_lossy();
    let rate = step_rate_hz.to_string();
    schedule(&["--rate", "--step-rate", &rate, "--certificate", &path])?;
    let fast = (!board.has_usb()).then(|| schedule(&["--baud", FAST_BAUD, "--rate"]));
    let fast = fast.transpose()?.map(|rate| rate.parse()).transpose()?;
    let certificate = (CERTIFICATE.into(), fs::read(&certificate)?);
    write_image(
        board,
        axes,
        out,
        bytes,
        (step_rate_hz, fast),
        vec![certificate],
    )
}

/// Writes an image with a number of axes into a release, in all formats and with what says what it is. `rates` are the
/// proven ones, at 1 000 000 baud where there is one.
pub fn write_image(
    board: &Board,
    axes: u8,
    out: &Path,
    elf: Vec<u8>,
    rates: (u32, Option<u32>),
    more: Vec<(String, Vec<u8>)>,
) -> Result<ReleasedImage> {
    let memory = board.chosen_memory();
    let mut files = files(board, &elf)?;
    files.push((ELF.into(), elf));
    files.extend(more);
    let image = ReleasedImage {
        axes,
        start: memory.flash_start,
        step_rate_hz: rates.0,
        step_rate_at_1_mbaud_hz: rates.1,
        // They lie within a flat file where the code begins apart from the vectors.
        settings_outlive_bin: memory.code_start.is_none(),
        files: Vec::new(),
    };
    image.write(&board.name, files, out)
}

impl ReleasedFile {
    /// What is said of a file.
    pub(crate) fn of(name: &str, bytes: &[u8]) -> Self {
        Self {
            name: name.into(),
            bytes: bytes.len(),
            sha256: sha256(bytes),
        }
    }
}

impl ReleasedImage {
    /// Writes an image of a board into a release, in files of names; returns it with them.
    pub fn write(
        mut self,
        board: &str,
        mut files: Vec<(String, Vec<u8>)>,
        out: &Path,
    ) -> Result<Self> {
        let folder = out.join(folder(board, self.axes));
        fs::create_dir_all(&folder).with_context(|| format!("cannot make {}", folder.display()))?;
        files.sort();
        for (name, bytes) in files {
            write_file(&folder.join(&name), &bytes)?;
            self.files.push(ReleasedFile::of(&name, &bytes));
        }
        write_file(&folder.join(IMAGE), json(&self)?.as_bytes())?;
        Ok(self)
    }

    /// What was made, in a line.
    pub fn verdict(&self) -> String {
        let rate = separated(self.step_rate_hz.into());
        format!("{rate} steps/s proven, {} files", self.files.len())
    }
}

fn json(value: &impl Serialize) -> Result<String> {
    Ok(format!("{}\n", serde_json::to_string_pretty(value)?))
}

pub(crate) fn sha256(bytes: &[u8]) -> String {
    let mut text = String::new();
    for byte in Hash::hash(bytes) {
        let _ = write!(text, "{byte:02x}");
    }
    text
}

fn write_file(path: &Path, bytes: &[u8]) -> Result<()> {
    fs::write(path, bytes).with_context(|| format!("cannot write {}", path.display()))
}

/// The commit of the sources.
fn commit() -> Result<String> {
    let mut command = Command::new("git");
    let command = command.args([
        "describe",
        "--always",
        "--abbrev=40",
        "--exclude=*",
        "--dirty",
    ]);
    let output = command.current_dir(cargo::root()).output();
    let output = output.context("cannot start git, which knows the commit")?;
    ensure!(output.status.success(), "git knows no commit here");
    Ok(String::from_utf8_lossy(&output.stdout).trim().to_owned())
}

#[cfg(test)]
mod tests {
    use super::*;
    use crate::released::Released;

    #[test]
    fn each_board_is_flashed_by_the_methods_of_its_file_the_easiest_first() {
        for (name, expected) in [
            (
                "nucleo-f446re",
                &["drive leadscrew.hex", "probe leadscrew.hex"][..],
            ),
            (
                "btt-skr-2",
                &[
                    "SD card firmware.bin",
                    "DFU leadscrew.dfu",
                    "probe leadscrew.hex",
                ],
            ),
            (
                "btt-octopus-1.1-f429",
                &[
                    "SD card firmware.bin",
                    "DFU leadscrew.dfu",
                    "probe leadscrew.hex",
                ],
            ),
            (
                "flexi-hal",
                &[
                    "UF2 leadscrew.uf2",
                    "DFU leadscrew.dfu",
                    "probe leadscrew.hex",
                ],
            ),
            (
                "blackpill-f411",
                &["DFU leadscrew.dfu", "probe leadscrew.hex"],
            ),
        ] {
            let flashing = flashing(&crate::boards::named(name).unwrap());
            let flashing: Vec<_> = flashing
                .iter()
                .map(|method| format!("{} {}", method.kind, method.file))
                .collect();
            assert_eq!(flashing, expected, "{name}");
        }
    }

    /// A release of a board with an image of some bytes.
    fn small(out: &Path) -> Index {
        let board = crate::boards::named("blackpill-f411").unwrap();
        let memory = board.memory(3);
        let code = memory.code_start.unwrap();
        let parts = [(memory.flash_start, &[1, 2, 3, 4][..]), (code, &[5; 300])];
        let image = ReleasedImage {
            axes: 3,
            start: memory.flash_start,
            step_rate_hz: 78_000,
            step_rate_at_1_mbaud_hz: None,
            settings_outlive_bin: false,
            files: Vec::new(),
        };
        let files = files_of(&board, memory.flash_start, &parts);
        let image = image.write(&board.name, files, out).unwrap();
        let index = Index::new("abc".into(), vec![BoardEntry::new(&board, vec![image])]);
        index.write(out, "MIT").unwrap();
        index
    }

    #[test]
    fn a_release_is_read_as_it_was_written_and_copied_whole() {
        let [out, copy] = [0, 1].map(|_| tempfile::tempdir().unwrap());
        let written = small(out.path());
        let released = Released::open(out.path()).unwrap();
        assert_eq!(json(released.index()).unwrap(), json(&written).unwrap());
        released.check().unwrap();
        released.copy(copy.path()).unwrap();
        Released::open(copy.path()).unwrap().check().unwrap();
        for name in [
            "SHA256SUMS",
            "LICENSES.txt",
            "blackpill-f411/3-axes/image.json",
            "blackpill-f411/3-axes/leadscrew.dfu",
        ] {
            let [from, to] = [&out, &copy].map(|it| fs::read(it.path().join(name)).unwrap());
            assert_eq!(from, to, "{name}");
        }
    }

    #[test]
    fn a_release_of_which_a_file_has_changed_is_refused() {
        const IN_IMAGE: &str = "blackpill-f411/3-axes/leadscrew.dfu";
        let change = |name: &str, from: &str, to: &str| {
            let out = tempfile::tempdir().unwrap();
            let index = small(out.path());
            let file = out.path().join(name);
            let bytes = fs::read(&file).unwrap();
            let mut at = bytes.windows(from.len());
            let at = at.rposition(|part| part == from.as_bytes()).unwrap();
            let changed = [&bytes[..at], to.as_bytes(), &bytes[at + from.len()..]].concat();
            fs::write(&file, changed).unwrap();
            if name == IN_IMAGE && to == "UFD!" {
                // Its sums are made anew, but not the index.
                index.write(out.path(), "MIT").unwrap();
            }
            let error = Released::open(out.path()).and_then(|released| released.check());
            format!("{:#}", error.unwrap_err())
        };
        for (name, from, to, words) in [
            (IN_IMAGE, "UFD", "UFd", "leadscrew.dfu is damaged"),
            (
                IN_IMAGE,
                "UFD",
                "UFD!",
                "another digest of blackpill-f411/3-axes/leadscrew.dfu",
            ),
            ("LICENSES.txt", "MIT", "GPL", "LICENSES.txt is damaged"),
            ("SHA256SUMS", "image.json", "imago.json", "cannot read"),
        ] {
            let error = change(name, from, to);
            assert!(error.contains(words), "{name}, {to}: {error}");
        }
    }

    #[test]
    fn a_board_has_the_flashes_of_its_part_and_steps_with_its_names() {
        let entry = |name: &str| BoardEntry::new(&crate::boards::named(name).unwrap(), Vec::new());
        let half = [16, 16, 16, 16, 64, 128, 128, 128];
        assert_eq!(entry("blackpill-f411").flashes_kib.concat(), half);
        assert_eq!(entry("btt-octopus-1.1-f446").flashes_kib.concat(), half);
        let whole = [&half[..], &[128; 4]].concat();
        let twice = whole.repeat(2);
        assert_eq!(entry("btt-octopus-1.1-f429").flashes_kib, [whole, twice]);
        for (name, words) in [
            ("nucleo-f446re", "`NODE_F446RE`. Copy `leadscrew.hex` to it"),
            ("btt-skr-2", "Copy `firmware.bin` to the root"),
            ("btt-skr-2", "Nothing else starts the chip's bootloader"),
            (
                "blackpill-f411",
                "--download leadscrew.dfu`, or STM32CubeProgrammer with `leadscrew.hex`",
            ),
            ("blackpill-f411", "flash --board blackpill-f411` builds"),
        ] {
            let flashing = entry(name).flashing;
            let steps: Vec<_> = flashing.iter().flat_map(|method| &method.steps).collect();
            assert!(steps.iter().any(|step| step.contains(words)), "{steps:#?}");
            assert!(
                steps.iter().all(|step| !step.contains(['{', '}'])),
                "{steps:?}"
            );
        }
    }
}
