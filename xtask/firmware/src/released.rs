//! `cargo xtask flash --from`: a file of a release, with everything that a release tells of it compared.
//!
//! The sums tell what is damaged or was mixed with another release; the ELF file of the image tells for which board it was
//! made; and each other file must have the bytes of the ELF file, where the board's file wants a program.

use std::{
    collections::BTreeMap,
    fs,
    path::{Component, Path, PathBuf},
};

use anyhow::{Context, Result, bail, ensure};
use common::cargo;
use formats::read;
use serde::Deserialize;

use crate::{
    boards::{Board, compile, image::parts, layout, seal},
    flash::Image,
    image,
    release::{
        self, BoardEntry, ELF, FORMAT, FlashMethod, INDEX, Index, ReleasedFile, ReleasedImage, SUMS,
    },
};

/// What every index has.
#[derive(Deserialize)]
struct IndexFormat {
    format: u32,
}

/// A release in a folder.
pub struct Released {
    folder: PathBuf,
    /// The digest of each file, by its path within the folder.
    sums: BTreeMap<String, String>,
    index: Index,
}

impl Released {
    /// Opens the folder of a release.
    pub fn open(folder: &Path) -> Result<Self> {
        let shown = folder.display();
        let sums = fs::read_to_string(folder.join(SUMS))
            .with_context(|| format!("{shown} is no release: it has no {SUMS}"))?;
        let sums = sums.lines().map(|line| {
            let (sum, name) = line.split_once("  ")?;
            Some((name.to_owned(), sum.to_owned()))
        });
        let sums: Option<BTreeMap<_, _>> = sums.collect();
        let sums = sums.with_context(|| format!("{SUMS} of {shown} is no list of sums"))?;
        let mut names = sums.keys();
        if let Some(name) = names.find(|name| !is_within(name)) {
            bail!("{SUMS} of {shown} names {name:?}, which leads out of the release");
        }
        let mut released = Self {
            folder: folder.to_owned(),
            sums,
            index: Index::default(),
        };
        let index = released.read(INDEX)?;
        let IndexFormat { format } =
            serde_json::from_slice(&index).context("the index is no index")?;
        ensure!(
            format == FORMAT,
            "the index has format {format}, and these sources read {FORMAT}: take those of the release"
        );
        released.index = serde_json::from_slice(&index).context("the index is no index")?;
        Ok(released)
    }

    /// The index.
    pub fn index(&self) -> &Index {
        &self.index
    }

    /// Refuses a release of which any file is not what sums and index say.
    pub fn check(&self) -> Result<()> {
        for name in self.sums.keys() {
            self.read(name)?;
        }
        for (name, listed) in self.index.files() {
            ensure!(
                *listed == ReleasedFile::of(&listed.name, &self.read(&name)?),
                "the index has another digest of {name}: it is of another release"
            );
        }
        Ok(())
    }

    /// Copies all files to a folder, as they are.
    pub fn copy(&self, folder: &Path) -> Result<()> {
        let write = |name: &str, bytes: &[u8]| {
            let to = folder.join(name);
            let made = fs::create_dir_all(to.parent().unwrap_or(folder));
            let written = made.and_then(|()| fs::write(&to, bytes));
            written.with_context(|| format!("cannot write {}", to.display()))
        };
        for name in self.sums.keys() {
            write(name, &self.read(name)?)?;
        }
        write(SUMS, &fs::read(self.folder.join(SUMS))?)
    }

    /// The name of the only board.
    pub fn only_board(&self) -> Result<&str> {
        match &self.index.boards[..] {
            [only] => Ok(&only.name),
            _ => bail!(
                "the release has several boards: --board names one of\n{}",
                self.names()
            ),
        }
    }

    /// The file of a board for a method, when it is what it is said to be.
    pub fn file(&self, board: &Board, method: &FlashMethod) -> Result<PathBuf> {
        let elf = self.elf(board)?;
        let elf = compile::read(&elf)?;
        let path = self.path(board, &method.file);
        let file = path.display().to_string();
        let refused = || format!("{file} is not written");
        let bytes = self.listed(board, &method.file).with_context(refused)?;
        compare(board, &method.file, &bytes, &elf).with_context(refused)?;
        Ok(path)
    }

    /// The ELF file of a board's image.
    pub fn elf(&self, board: &Board) -> Result<PathBuf> {
        let path = self.path(board, ELF);
        let refused = || format!("{} is not written", path.display());
        let check = || -> Result<()> {
            let released = self.image(board)?;
            let bytes = self.listed(board, ELF)?;
            layout::check(board, &bytes)?;
            if let Err(error) = layout::check_board(board, &bytes) {
                bail!(
                    "{error}, or the board's file has changed since: the release is of the sources {}",
                    self.index.commit
                );
            }
            seal::check(&bytes)?;
            let rate = image::read(&path)?;
            ensure!(
                rate == released.step_rate_hz,
                "the image says that {rate} steps/s are proven, and the index {}",
                released.step_rate_hz
            );
            Ok(())
        };
        check().with_context(refused)?;
        Ok(path)
    }

    /// The image of a board with as many axes as were asked for.
    fn image(&self, board: &Board) -> Result<&ReleasedImage> {
        let axes = cargo::axes();
        let entry = self.entry(board)?;
        let images = &entry.images;
        let image = images.iter().find(|image| image.axes == axes);
        let image = image.with_context(|| {
            let known = images.iter().map(|image| image.axes.to_string());
            let known: Vec<_> = known.collect();
            format!(
                "it has no image with {axes} axes, but with {}",
                known.join(", ")
            )
        })?;
        let start = board.chosen_memory().flash_start;
        ensure!(
            image.start == start,
            "its image begins at {:#010x}, and a program of this board at {start:#010x}",
            image.start
        );
        let beside = format!("{}/{}", release::folder(&board.name, axes), release::IMAGE);
        let beside: ReleasedImage = serde_json::from_slice(&self.read(&beside)?)?;
        ensure!(
            beside == *image,
            "{} says something else than the index",
            release::IMAGE
        );
        Ok(image)
    }

    /// What the index says of a board, whose chip and crystal it must have.
    fn entry(&self, board: &Board) -> Result<&BoardEntry> {
        let mut boards = self.index.boards.iter();
        let entry = boards.find(|entry| entry.name == board.name);
        let missing = || format!("it has no board {}, but\n{}", board.name, self.names());
        let entry = entry.with_context(missing)?;
        ensure!(
            entry.chip == format!("STM32{}", board.part_name)
                && entry.crystal_mhz == board.crystal_mhz,
            "its image is for an {} with {} MHz, and this board has an STM32{} with {} MHz",
            entry.chip,
            entry.crystal_mhz,
            board.part_name,
            board.crystal_mhz
        );
        Ok(entry)
    }

    fn names(&self) -> String {
        let names = self.index.boards.iter().map(|it| format!("  {}", it.name));
        names.collect::<Vec<_>>().join("\n")
    }

    fn path(&self, board: &Board, name: &str) -> PathBuf {
        let folder = release::folder(&board.name, cargo::axes());
        self.folder.join(folder).join(name)
    }

    /// A file of a board's image, as the index lists it.
    fn listed(&self, board: &Board, name: &str) -> Result<Vec<u8>> {
        let files = &self.image(board)?.files;
        let listed = files.iter().find(|file| file.name == name);
        let listed = listed.context("the index does not list it")?;
        let folder = release::folder(&board.name, cargo::axes());
        let bytes = self.read(&format!("{folder}/{name}"))?;
        ensure!(
            *listed == ReleasedFile::of(name, &bytes),
            "the index has another digest: it is of another release"
        );
        Ok(bytes)
    }

    /// A file whose digest is that of the sums.
    fn read(&self, name: &str) -> Result<Vec<u8>> {
        let path = self.folder.join(name);
        let sum = self.sums.get(name);
        let sum = sum.with_context(|| format!("{SUMS} does not list {name}"))?;
        // Neither a link, which may lead anywhere, nor what has no end.
        let is_file = fs::symlink_metadata(&path).map(|it| it.is_file());
        let is_file = is_file.with_context(|| format!("cannot read {}", path.display()))?;
        ensure!(is_file, "{} is no file", path.display());
        let bytes = fs::read(&path).with_context(|| format!("cannot read {}", path.display()))?;
        ensure!(
            *sum == release::sha256(&bytes),
            "{name} is damaged, or of another release: {SUMS} has another digest"
        );
        Ok(bytes)
    }
}

/// Whether the name of a file stays within its folder.
fn is_within(name: &str) -> bool {
    let mut parts = Path::new(name).components();
    !name.is_empty() && parts.all(|part| matches!(part, Component::Normal(_)))
}

/// Compares a file for a method with the ELF file of its image, and with the memory of the board.
fn compare(board: &Board, name: &str, bytes: &[u8], elf: &[u8]) -> Result<()> {
    let elf = parts(elf)?;
    let start = board.chosen_memory().flash_start;
    let wanted = formats::flat(&elf, start);
    let kind = Path::new(name).extension().unwrap_or_default();
    let found = match &*kind.to_string_lossy() {
        // As it is, to the last byte.
        "bin" => bytes.to_vec(),
        "hex" => flash(&Image::of_parts(board, read::hex(bytes)?)?, &wanted),
        "dfu" => flash(&Image::of_dfu(board, bytes)?, &wanted),
        "uf2" => {
            let family = board.uf2_family.context("the board takes no UF2")?;
            flash(&Image::of_parts(board, read::uf2(bytes, family)?)?, &wanted)
        }
        _ => bail!("its name has no known ending"),
    };
    let mut pairs = found.iter().zip(&wanted);
    if let Some(at) = pairs.position(|(found, wanted)| found != wanted) {
        bail!(
            "it has another byte than {ELF} at {:#010x}",
            start + at as u32
        );
    }
    ensure!(
        found.len() == wanted.len(),
        "it has {} bytes from {start:#010x} on, and {ELF} has {}",
        found.len(),
        wanted.len()
    );
    Ok(())
}

/// The flash from the vectors on, without what a file fills up its last page with.
fn flash(image: &Image, wanted: &[u8]) -> Vec<u8> {
    let parts: Vec<_> = { image.parts().iter() }
        .map(|(at, bytes)| (*at, &bytes[..]))
        .collect();
    let mut flash = formats::flat(&parts, image.start());
    while flash.len() > wanted.len() && flash.last() == Some(&formats::ERASED) {
        flash.pop();
    }
    flash
}
