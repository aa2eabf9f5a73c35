//! Boards: `boards/*.toml`.

use std::{
    collections::BTreeMap,
    env,
    ffi::OsStr,
    fs, iter,
    path::{Path, PathBuf},
};

use crate::{
    Chip, FOLDER, Fault, Input, MemoryLayout, Part, Pin, Wiring,
    entries::{Entries, Entry, Place, TOP},
    wiring::{AXES, WiringReader},
};

/// The most axes that a machine has.
pub const MOST_AXES: usize = AXES.len();
/// The fewest.
const FEWEST_AXES: usize = 3;
/// The feature of a firmware that drives motors by phases.
pub const PHASES: &str = "phases";
/// The feature of a firmware that knows second motors.
const SECOND_MOTORS: &str = "second-motors";
/// The feature of a firmware whose settings are in an EEPROM.
pub const EEPROM: &str = "eeprom";
/// The same for one of 4 KiB.
pub const SMALL_EEPROM: &str = "eeprom-4";
/// The feature of a firmware whose sender is at the USB socket.
pub const USB: &str = "usb";
/// Bytes of a board's name: what the longest line of `M115` leaves.
const MAX_TITLE_BYTES: usize = 40;

/// A board, of which everything has been checked.
#[derive(Debug, Clone)]
pub struct Board {
    /// Its name: that of its file.
    pub name: String,
    /// Its file.
    pub file: PathBuf,
    /// What its maker calls it.
    pub title: String,
    /// What else a user wants to know of it, a sentence.
    pub about: String,
    /// Where its facts are from.
    pub sources: Vec<String>,
    /// Its chip.
    pub chip: Chip,
    /// The name of its part: `F405RG`.
    pub part_name: String,
    /// Its part.
    pub part: Part,
    /// Its crystal, MHz, ...
    pub crystal_mhz: u32,
    /// ... or a clock signal of that frequency.
    pub is_crystal_bypassed: bool,
    /// The QEMU machine that emulates it.
    pub qemu: Option<String>,
    /// KiB of a bootloader before the program.
    pub bootloader_kib: u32,
    /// The name of the file that the bootloader looks for on the SD card.
    pub bootloader_file: Option<String>,
    /// The family of chips in the UF2 files that the bootloader takes.
    pub uf2_family: Option<u32>,
    /// Whether the chip's own bootloader can be started and reached over USB (DFU).
    pub has_dfu: bool,
    /// The name of the drive to which a debug probe on the board writes.
    pub drive: Option<String>,
    /// What is printed beside pins on the board.
    pub labels: BTreeMap<Pin, String>,
    /// What differs with three axes, four and so on.
    variants: Vec<Variant>,
}

/// A board with one number of axes.
#[derive(Debug, Clone)]
struct Variant {
    wiring: Wiring,
    memory: MemoryLayout,
}

impl Board {
    /// Returns the boards of a project's folder, by name.
    pub fn all(root: &Path) -> Result<Vec<Self>, Fault> {
        let folder = root.join(FOLDER);
        let listing = fs::read_dir(&folder)
            .map_err(|error| Fault::of_file(&folder, format!("cannot be read: {error}")))?;
        let mut files: Vec<_> = listing.flatten().map(|entry| entry.path()).collect();
        files.retain(|file| file.extension().is_some_and(|kind| kind == "toml"));
        files.retain(|file| file.file_name().is_some_and(|name| name != "Cargo.toml"));
        files.sort();
        files.iter().map(|file| Self::read(file, root)).collect()
    }

    /// Returns the path of the board of a name, or of a file.
    pub fn path(name: &str, root: &Path) -> PathBuf {
        let is_file = Path::new(name).extension() == Some(OsStr::new("toml"));
        if is_file {
            env::current_dir().unwrap_or_default().join(name)
        } else {
            root.join(FOLDER).join(format!("{name}.toml"))
        }
    }

    /// Reads a board's file.
    pub fn read(file: &Path, root: &Path) -> Result<Self, Fault> {
        let chips = Chip::all(&root.join(FOLDER).join("chips"))?;
        let mut entries = Entries::read(file)?;
        let place = Place::of_file(file);
        let chip_entry = entries.take("chip");
        let chip_entry = chip_entry.ok_or_else(|| missing(&place, "chip"))?;
        let (chip, part_name, part) = chosen_part(&chips, &chip_entry)?;
        let title = entries.take("name");
        let title = title.ok_or_else(|| missing(&place, "name"))?;
        let about = entries.take("about");
        let sources = entries.take("sources");
        let (crystal_mhz, is_crystal_bypassed) = crystal(&mut entries, chip, &place)?;
        let qemu = entries.take("qemu");
        let bootloader = Bootloader::read(&mut entries, &place)?;
        let dfu = entries.take("dfu");
        let drive = entries.take("drive");
        let labels = labels(&mut entries, part)?;
        let wirings = wirings(&mut entries, chip, part, &place)?;
        if let Some(entry) = &qemu {
            refuse_unemulated(entry, &wirings)?;
        }
        let variants = wirings.into_iter().map(|wiring| {
            let memory = bootloader.memory(chip, part, &wiring)?;
            Ok(Variant { wiring, memory })
        });
        let variants = variants.collect::<Result<_, Fault>>()?;
        let others = [
            "name",
            "bootloader.kib",
            "bootloader.file",
            "bootloader.uf2",
        ];
        entries.refuse_rest(&[&TOP[..], &others].concat())?;
        Ok(Self {
            name: file
                .file_stem()
                .unwrap_or_default()
                .to_string_lossy()
                .into(),
            file: file.to_owned(),
            title: checked_title(&title)?,
            about: text(about.as_ref())?.unwrap_or_default(),
            sources: match sources {
                Some(entry) => entry.texts()?.to_vec(),
                None => Vec::new(),
            },
            chip: chip.clone(),
            part_name,
            part: part.clone(),
            crystal_mhz,
            is_crystal_bypassed,
            qemu: text(qemu.as_ref())?,
            bootloader_kib: bootloader.kib,
            bootloader_file: bootloader.file,
            uf2_family: bootloader.uf2_family,
            has_dfu: dfu.map_or(Ok(false), |entry| entry.truth())?,
            drive: text(drive.as_ref())?,
            labels,
            variants,
        })
    }

    /// Returns the most axes that the board has pins for.
    pub fn most_axes(&self) -> usize {
        FEWEST_AXES + self.variants.len() - 1
    }

    /// Returns the wiring with a number of axes.
    pub fn wiring(&self, axes: usize) -> Option<&Wiring> {
        let variant = self.variants.get(axes.checked_sub(FEWEST_AXES)?)?;
        Some(&variant.wiring)
    }

    /// Returns where program and settings are with a number of axes, or with the nearest number that the board has
    /// pins for.
    pub fn memory(&self, axes: usize) -> MemoryLayout {
        self.variant(axes).memory
    }

    /// Returns whether motors are driven by phases, instead of by step and direction.
    pub fn has_phases(&self) -> bool {
        let mut variants = self.variants.iter();
        variants.any(|variant| !variant.wiring.phases.is_empty())
    }

    /// Returns whether the sender is at the USB socket, instead of at a UART.
    pub fn has_usb(&self) -> bool {
        self.variants[0].wiring.has_usb
    }

    /// Returns whether the chip's own bootloader can be started by `$DFU`, and reached over USB.
    pub fn has_usb_bootloader(&self) -> bool {
        self.has_dfu || self.has_usb()
    }

    /// Returns where the sender is: `USB`, or `UART1`.
    pub fn sender(&self) -> String {
        let wiring = &self.variants[0].wiring;
        if wiring.has_usb {
            "USB".into()
        } else {
            format!("UART{}", wiring.serial.usart)
        }
    }

    /// Returns the features of the firmware that the board needs with a number of axes, or with the nearest number
    /// that it has pins for: those of its chip, its clock, its motors and its settings.
    pub fn features(&self, axes: usize) -> Vec<String> {
        let wiring = &self.variant(axes).wiring;
        let is_small = wiring.eeprom.is_some_and(|eeprom| eeprom.is_small);
        let special = [
            (!wiring.phases.is_empty(), PHASES),
            (!wiring.second.is_empty(), SECOND_MOTORS),
            (wiring.eeprom.is_some(), EEPROM),
            (is_small, SMALL_EEPROM),
            (wiring.has_usb, USB),
        ];
        let special = special.into_iter().filter(|(is_needed, _)| *is_needed);
        let clock = self.chip.clocks.feature().into_iter();
        let all = clock.chain(special.map(|(_, feature)| feature));
        iter::once(format!("chip-{}", self.chip.hal))
            .chain(all.map(str::to_owned))
            .collect()
    }

    fn variant(&self, axes: usize) -> &Variant {
        &self.variants[axes.clamp(FEWEST_AXES, self.most_axes()) - FEWEST_AXES]
    }
}

/// Reads a text that may be left out.
fn text(entry: Option<&Entry>) -> Result<Option<String>, Fault> {
    { entry.map(Entry::text).transpose() }.map(|text| text.map(str::to_owned))
}

/// Refuses an emulator for a board with something that it lacks.
fn refuse_unemulated(qemu: &Entry, wirings: &[Wiring]) -> Result<(), Fault> {
    let message = if wirings.iter().any(|wiring| !wiring.phases.is_empty()) {
        "the emulator records steps and directions: a board with phases has none"
    } else if wirings.iter().any(|wiring| wiring.eeprom.is_some()) {
        "the emulator has no EEPROM: settings are in flash there"
    } else if wirings.iter().any(|wiring| wiring.has_usb) {
        "the emulator has no USB: link = \"uart\" is what it has"
    } else {
        return Ok(());
    };
    Err(qemu.place.fault(message))
}

/// Returns the part that a text names: what is printed on a chip, `STM32F407VGT6`, begins with it.
fn chosen_part<'a>(
    chips: &'a [Chip],
    entry: &Entry,
) -> Result<(&'a Chip, String, &'a Part), Fault> {
    let text = entry.text()?;
    let printed = text.strip_prefix("STM32").unwrap_or(text);
    let mut parts = chips.iter().flat_map(|chip| {
        let parts = chip.parts.iter();
        parts.map(move |(name, part)| (chip, name, part))
    });
    let found = parts.find(|(_, name, _)| printed.starts_with(*name));
    let (chip, name, part) = found.ok_or_else(|| {
        let known: Vec<_> = chips.iter().flat_map(|chip| chip.parts.keys()).collect();
        let known: Vec<_> = known.iter().map(|name| name.as_str()).collect();
        let message = format!("chip {text:?} is not known; known are {}", known.join(", "));
        entry.place.fault(message)
    })?;
    Ok((chip, name.clone(), part))
}

/// Keys that must be there, and what is wanted of them.
const WANTED: [(&str, &str); 8] = [
    (
        "chip",
        "what is printed on the chip behind STM32, as in chip = \"F407VG\"",
    ),
    (
        "name",
        "what the board is called, as in name = \"My board\"",
    ),
    (
        "crystal_mhz",
        "what is printed on the crystal beside the chip, as in crystal_mhz = 8",
    ),
    (
        "serial.tx",
        "the pin that sends, as in tx = \"A9\" in [serial]",
    ),
    (
        "serial.rx",
        "the pin that receives, as in rx = \"A10\" in [serial]",
    ),
    (
        "eeprom.kib",
        "what the EEPROM holds, as in kib = 16 in [eeprom]: a 24C32 has 4, a 24C64 has 8, a 24C128 has 16",
    ),
    (
        "eeprom.scl",
        "the pin of the EEPROM's clock, as in scl = \"B8\" in [eeprom]",
    ),
    (
        "eeprom.sda",
        "the pin of the EEPROM's data, as in sda = \"B9\" in [eeprom]",
    ),
];

/// Returns the fault of a key that is not there.
pub(crate) fn missing(place: &Place, key: &str) -> Fault {
    let wanted = WANTED.iter().find(|(of, _)| *of == key);
    let wanted = wanted.map_or(String::new(), |(_, words)| format!(": {words}"));
    place.fault(format!("`{key}` is missing{wanted}"))
}

/// Returns the name of a board, which `M115` of the RepRap dialect answers with: in ASCII, and without the colon
/// that ends a key there.
fn checked_title(entry: &Entry) -> Result<String, Fault> {
    let title = entry.text()?;
    let is_short = (1..=MAX_TITLE_BYTES).contains(&title.len());
    let is_plain = |byte| matches!(byte, b' '..=b'~') && byte != b':';
    if is_short && title.bytes().all(is_plain) {
        return Ok(title.to_owned());
    }
    let message = format!("a name is up to {MAX_TITLE_BYTES} bytes of ASCII without a colon");
    Err(entry.place.fault(message))
}

fn crystal(entries: &mut Entries, chip: &Chip, file: &Place) -> Result<(u32, bool), Fault> {
    let entry = entries.take("crystal_mhz");
    let entry = entry.ok_or_else(|| missing(file, "crystal_mhz"))?;
    let mhz = entry.number()?;
    // RM0090 7.3.2: the PLL multiplies 1 to 2 MHz; a whole number of MHz gives it 1 MHz.
    if !(4..=26).contains(&mhz) {
        let core_mhz = chip.clocks.core_mhz;
        let message =
            format!("{core_mhz} MHz cannot be made of {mhz} MHz: a crystal has 4 to 26 MHz");
        return Err(entry.place.fault(message));
    }
    let bypassed = entries.take("crystal_bypassed");
    let is_bypassed = bypassed.map_or(Ok(false), |entry| entry.truth())?;
    Ok((mhz, is_bypassed))
}

/// A bootloader before the program, of 0 KiB where there is none.
struct Bootloader {
    kib: u32,
    file: Option<String>,
    uf2_family: Option<u32>,
    place: Place,
}

impl Bootloader {
    fn read(entries: &mut Entries, file: &Place) -> Result<Self, Fault> {
        if let Some(entry) = entries.take("bootloader") {
            let message = "a bootloader is a table, as in bootloader = { kib = 32, file = \"firmware.bin\" }; without one, \
                           bootloader.kib = 0";
            return Err(entry.place.fault(message));
        }
        let kib = entries.take("bootloader.kib");
        let name = entries.take("bootloader.file");
        let uf2 = entries.take("bootloader.uf2");
        let (place, kib) = match kib {
            Some(entry) => (entry.place.clone(), entry.number()?),
            None => (file.clone(), 0),
        };
        if kib == 0
            && let Some(entry) = name.as_ref().or(uf2.as_ref())
        {
            let message = "a file for a bootloader of 0 KiB: `bootloader.kib` is what the bootloader has before the program";
            return Err(entry.place.fault(message));
        }
        Ok(Self {
            kib,
            file: name.map(|entry| file_name(&entry)).transpose()?,
            uf2_family: uf2.map(|entry| entry.number()).transpose()?,
            place,
        })
    }

    /// Returns where program and settings are behind it.
    fn memory(&self, chip: &Chip, part: &Part, wiring: &Wiring) -> Result<MemoryLayout, Fault> {
        let memory = MemoryLayout::of(chip, part, self.kib, wiring.eeprom.is_some());
        memory.map_err(|error| self.place.fault(of_axes(error, wiring.axes())))
    }
}

/// Reads the name of a file that lies beside others.
fn file_name(entry: &Entry) -> Result<String, Fault> {
    let name = entry.text()?;
    if name.is_empty() || name.starts_with('.') || name.contains(['/', '\\', '\0']) {
        let message = "the name of a file is wanted here, as in \"firmware.bin\"";
        return Err(entry.place.fault(message));
    }
    Ok(name.to_owned())
}

fn labels(entries: &mut Entries, part: &Part) -> Result<BTreeMap<Pin, String>, Fault> {
    let labels = entries.take_all("labels.");
    let labels = labels.iter().map(|(pin, entry)| {
        let pin: Pin = pin
            .parse()
            .map_err(|error: String| entry.place.fault(error))?;
        if !part.has(pin) {
            return Err(entry.place.fault(format!("this part has no pin {pin}")));
        }
        Ok((pin, entry.text()?.to_owned()))
    });
    labels.collect()
}

/// Returns the wiring for each number of axes that the board has pins for.
fn wirings(
    entries: &mut Entries,
    chip: &Chip,
    part: &Part,
    file: &Place,
) -> Result<Vec<Wiring>, Fault> {
    let debug = entries.take("debug_pins");
    let has_debug_pins = debug.map_or(Ok(false), |entry| entry.truth())?;
    let mut polled = Vec::new();
    if let Some(entry) = entries.take("polled") {
        polled = entry.texts()?.to_vec();
        if let Some(unknown) = polled.iter().find(|key| !Input::keys().contains(key)) {
            let message = format!(
                "`{unknown}` is no input; inputs are {}",
                Input::keys().join(", ")
            );
            return Err(entry.place.fault(message));
        }
    }
    let mut functions = Entries::default();
    for prefix in [
        "link", "axes.", "outputs.", "inputs.", "serial.", "eeprom", "at_boot.",
    ] {
        functions.replace_with(&entries.take_group(prefix));
    }
    let mut wirings = Vec::new();
    for axes in FEWEST_AXES..=MOST_AXES {
        functions.replace_with(&entries.take_all(&format!("with_{axes}_axes.")));
        take_eeprom_away(&mut functions, axes, file)?;
        let letter = AXES[axes - 1];
        let has_phases = functions.get("axes.X.phases").is_some();
        let step = if has_phases { "phases" } else { "step" };
        let step = format!("axes.{letter}.{step}");
        let is_none = |entry: &Entry| entry.text().is_ok_and(|text| text == "none");
        if axes > FEWEST_AXES && functions.get(&step).is_none_or(is_none) {
            if functions.get(&step).is_some() {
                // What another file says of this axis and those behind it, which this one is like, is void.
                for (number, letter) in (1..).zip(AXES).skip(axes - 1) {
                    functions.take_all(&format!("axes.{letter}."));
                    entries.take_all(&format!("with_{number}_axes."));
                }
            }
            // No axis is left out silently: A without a step, or B without A.
            let mut behind = AXES[axes - 1..].iter();
            let place = behind.find_map(|letter| functions.place_of(&format!("axes.{letter}")));
            return place.map_or(Ok(wirings), |place| Err(missing(place, &step)));
        }
        let reader = WiringReader::new(functions.clone(), chip, part, has_debug_pins);
        let wiring = reader.read(axes, &polled, file).map_err(|fault| {
            let differs =
                format!(", with {axes} axes: what differs there can stand in [with_{axes}_axes]");
            fault.and(if axes > FEWEST_AXES { &differs } else { "" })
        });
        wirings.push(wiring?);
    }
    Ok(wirings)
}

/// Takes the pins of an EEPROM away where it is `"none"`. There must be one, unless another file says so: what it takes
/// away may be gone by what this file says.
fn take_eeprom_away(functions: &mut Entries, axes: usize, file: &Place) -> Result<(), Fault> {
    let Some(entry) = functions.take("eeprom") else {
        return Ok(());
    };
    if entry.text().ok() != Some("none") {
        let message = "an EEPROM is a table, [eeprom], or \"none\" where the settings are in flash";
        return Err(entry.place.fault(message));
    }
    let taken = functions.take_all("eeprom.");
    if taken.iter().next().is_none() && entry.place.is_beside(file) {
        let message = "there is no EEPROM here that `eeprom = \"none\"` could take away".to_owned();
        return Err(entry.place.fault(of_axes(message, axes)));
    }
    Ok(())
}

/// Returns a message with the number of axes, where it is not the usual one.
fn of_axes(message: String, axes: usize) -> String {
    match axes {
        FEWEST_AXES => message,
        axes => format!("{message}, with {axes} axes"),
    }
}
