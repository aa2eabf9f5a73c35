//! The rehearsal of a board: its firmware from power-up on, and when something is wrong.

use std::{
    collections::BTreeMap,
    path::{Path, PathBuf},
    sync::Arc,
};

use anyhow::{Context as _, Result, ensure};
use board_data::{Board, Input};
use rigless::image::Image;

mod states;
mod usb;

use crate::{
    bench::{Bench, Link},
    bootloader::State,
    chip::{FittedParts, memory},
    loader,
    plant::{Closes, name_of_axis},
    program::Lines,
    script::{Act, Cut, PowerUp, Wanted},
};

/// A program, the settings that it runs with, and the simulator's step events.
#[derive(Debug)]
pub(crate) struct Job {
    pub(crate) program: PathBuf,
    pub(crate) settings: Vec<String>,
    pub(crate) events: PathBuf,
}

impl Job {
    /// Reads `PROGRAM,EVENTS` or `PROGRAM,EVENTS,$22=1,...`.
    pub(crate) fn read(text: &str) -> Result<Self> {
        let mut words = text.split(',').map(str::to_owned);
        let mut next = || words.next().context("a job is PROGRAM,EVENTS");
        Ok(Self {
            program: next()?.into(),
            events: next()?.into(),
            settings: words.collect(),
        })
    }
}

/// How much of a rehearsal is played.
#[derive(Debug, Clone, Copy, Default, PartialEq, Eq)]
pub(crate) enum Extent {
    /// That it starts, and moves.
    Start,
    /// What matters most.
    Short,
    /// Everything.
    #[default]
    Whole,
}

/// What bootloaders leave; the first is all of it.
const STATES: [(&str, State); 7] = [
    ("everything that a bootloader may leave", State::ALL),
    (
        "the ROM's bootloader",
        State {
            has_pll: true,
            ..State::NONE
        },
    ),
    (
        "PRIGROUP 3",
        State {
            priority_group: 3,
            ..State::NONE
        },
    ),
    (
        "PRIGROUP 5",
        State {
            priority_group: 5,
            ..State::NONE
        },
    ),
    (
        "SysTick running",
        State {
            has_ticks: true,
            ..State::NONE
        },
    ),
    (
        "all interrupts enabled",
        State {
            has_interrupts: true,
            ..State::NONE
        },
    ),
    // The backup domain keeps it through the resets of others.
    (
        "LSE running",
        State {
            has_lse: true,
            ..State::NONE
        },
    ),
];
/// `DEV_ID` of chips: RM0090 38.6.1, RM0390 33.6.1.
const CHIPS: [u64; 2] = [0x413, 0x421];
/// A crystal that the board does not have is one of these, MHz.
const OTHER_CRYSTALS_MHZ: [u32; 2] = [12, 8];
/// Cuts of the supply, each with the values of a setting that may be there afterwards.
const CUTS: [(Cut, &[&str]); 6] = [
    (Cut::After(1), &["$121=10.000"]),
    (Cut::After(2), &["$121=10.000"]),
    (Cut::Half, &["$121=10.000"]),
    (Cut::Before(2), &["$121=10.000", "$121=300.000"]),
    (Cut::Before(1), &["$121=10.000", "$121=300.000"]),
    (Cut::Before(0), &["$121=300.000"]),
];
/// Steps of a mm, and the travel of an axis, `$100` and `$130`, without settings.
pub(crate) const STEPS_PER_MM: f64 = 250.0;
const TRAVEL_MM: f64 = 200.0;
/// Steps of a fifth of a mm.
const START_STEPS: usize = 50;
/// How far the lower switches are beyond the travel, and the probe's plate above the lower end of Z: the simulator's.
const BEYOND_MM: f64 = 1.0;
const PLATE_MM: f64 = 10.0;
/// Longer than a record takes in an EEPROM, ms: 5 ms for each page, with six axes too.
const STORING_MS: u64 = 400;
/// More time than the firmware takes for a line from a reset on, ms.
const SILENCE_MS: u64 = 100;
/// By then the drivers are off: more than the default of `$1`, 25 ms.
const DRIVERS_OFF_MS: u64 = 50;
/// Ctrl-X.
const RESET: &[u8] = &[0x18];
/// What a machine that moves nothing must not do.
const MOVE_ALL_THE_SAME: &[u8] = b"$X\nG91G1X1F600\n";
/// The internal oscillator, MHz.
const HSI_MHZ: u64 = 16;

/// The images that a board is rehearsed with: the firmware from its ELF file or as taken by a bootloader, the data
/// written by the chip's maker, and the bootloaders.
pub(crate) fn images(bench: &Bench, elf: &Path, file: Option<&Path>) -> Result<Vec<Image>> {
    let vectors = bench.vectors();
    let mut images = match file {
        None => vec![Image::read(elf, None)?],
        Some(file) => as_loaded(bench, file)?,
    };
    let has = |number: &usize| {
        bench
            .program
            .word(u64::from(vectors) + 64 + 4 * *number as u64)
            .is_some()
    };
    let interrupts = (0..crate::bootloader::MOST_INTERRUPTS)
        .take_while(has)
        .count();
    let states = STATES.map(|(_, state)| state);
    let crystal_mhz = bench.board.crystal_mhz;
    let bootloaders = crate::bootloader::image(&states, vectors, crystal_mhz, interrupts as u32)?;
    let made = memory::made(&bench.board)?;
    images.extend([made, bootloaders]);
    Ok(images)
}

/// What a loader writes of a file: every byte of the program, and nothing else but what erased flash has.
fn as_loaded(bench: &Bench, file: &Path) -> Result<Vec<Image>> {
    let parts = loader::read(file, &bench.board, bench.vectors())?;
    let mut loaded = BTreeMap::new();
    for (address, bytes) in &parts {
        loaded.extend((u64::from(*address)..).zip(bytes.iter().copied()));
    }
    for (address, content) in &bench.program.segments {
        for (at, byte) in (*address..).zip(content) {
            let is_same = loaded.remove(&at) == Some(*byte);
            ensure!(
                is_same,
                "{} differs from the program at {at:#x}",
                file.display()
            );
        }
    }
    let more = loaded.iter().find(|(_, byte)| **byte != 0xff);
    ensure!(
        more.is_none(),
        "{} has more than the program: {more:x?}",
        file.display()
    );
    let images = parts
        .into_iter()
        .map(|(address, bytes)| Ok(Image::new(file, bytes, Some(address.into()))?));
    images.collect()
}

/// Rehearses a board; returns whether nothing is wrong.
pub(crate) fn play(
    bench: &Arc<Bench>,
    lines: &Lines,
    jobs: &[Job],
    extent: Extent,
) -> Result<bool> {
    let mut outcome = bench.play(script(bench, extent)?, true)?;
    if !jobs.is_empty() {
        let of_jobs = bench.play(job_script(bench, jobs)?, false)?;
        outcome.parts.extend(of_jobs.parts);
        for (fault, (cases, by)) in of_jobs.faults {
            let known = outcome.faults.entry(fault).or_insert((Vec::new(), by));
            known.0.extend(cases);
        }
    }
    for part in &outcome.parts {
        println!("  {part}");
    }
    for (fault, (cases, by)) in &outcome.faults {
        println!("  FAULT: {fault}");
        if let Some(by) = by {
            println!("    by {}", lines.describe(*by));
        }
        if !cases.is_empty() {
            println!("    in {}", cases.join("; "));
        }
    }
    Ok(outcome.faults.is_empty())
}

/// A start from the first state of bootloaders, and that of a new board.
fn starts(bench: &Bench) -> Vec<Act> {
    let right = PowerUp::of(&bench.board);
    let power_up = PowerUp {
        bootloader: Some(0),
        ..right
    };
    let mut script = vec![Act::Part("a start"), Act::Case("a new board".into(), right)];
    script.extend(start(bench.axes));
    script.push(Act::Case(STATES[0].0.into(), power_up));
    script.extend(start(bench.axes));
    script
}

fn script(bench: &Bench, extent: Extent) -> Result<Vec<Act>> {
    if extent == Extent::Start {
        return Ok(starts(bench));
    }
    let is_short = extent == Extent::Short;
    let wiring = bench.wiring()?;
    let has_limit = wiring.inputs.iter().any(|it| it.0 == Input::Limit(0));
    let right = PowerUp::of(&bench.board);
    let mut script = vec![
        Act::Part("as flashed"),
        Act::Case("a new board".into(), right),
    ];
    script.extend(everyday(bench, has_limit));
    for (name, pin) in [
        ("spindle", wiring.spindle),
        ("flood", wiring.flood),
        ("mist", wiring.mist),
    ] {
        script.extend(pin.map(|_| Act::Want(Wanted::Active(name))));
    }
    if bench.board.memory(bench.axes).journal.is_some() {
        let power_up = PowerUp {
            is_used: true,
            ..right
        };
        script.push(Act::Case("a flash that has been used".into(), power_up));
        script.extend(start(bench.axes));
        script.push(Act::Want(Wanted::Erased(2)));
    }
    script.extend(states::script(wiring, right));
    script.extend(usb::script(bench.link(), right, is_short));
    script.push(Act::Part("states of bootloaders"));
    for (number, (name, _)) in STATES.into_iter().enumerate() {
        if number == 0 || !is_short {
            let power_up = PowerUp {
                bootloader: Some(number),
                ..right
            };
            script.push(Act::Case(name.into(), power_up));
            script.extend(start(bench.axes));
        }
    }
    script.extend(hand_overs(&bench.board, right));
    script.extend(wrong_crystals(bench, right));
    script.extend(wrong_chips(bench, right, is_short));
    script.extend(power_cuts(right, is_short));
    if wiring.eeprom.is_some() {
        let power_up = PowerUp {
            has_eeprom: false,
            ..right
        };
        script.extend([
            Act::Part("a missing EEPROM"),
            Act::Case("no EEPROM".into(), power_up),
        ]);
        script.extend(start(bench.axes));
        script.push(Act::Refused("$120=300"));
    }
    script.extend(faults_in_motion(bench, right)?);
    Ok(script)
}

/// `$DFU` and `$UF2`, also where a bootloader has run before; only at rest.
fn hand_overs(board: &Board, right: PowerUp) -> Vec<Act> {
    let mut script = vec![Act::Part("other bootloaders")];
    for (has_it, statement, wanted) in [
        (
            board.has_usb_bootloader(),
            "$DFU",
            [Wanted::HandedOver(1), Wanted::Resets(&["Core"])],
        ),
        (
            board.uf2_family.is_some(),
            "$UF2",
            [Wanted::HandedOver(0), Wanted::Uf2Mark],
        ),
    ] {
        for bootloader in [None, Some(0)] {
            let power_up = PowerUp {
                bootloader,
                ..right
            };
            let behind = if bootloader.is_some() {
                " behind another bootloader"
            } else {
                ""
            };
            script.extend([
                Act::Case(format!("{statement}{behind}"), power_up),
                Act::Await("Grbl "),
            ]);
            if !has_it {
                script.push(Act::Refused(statement));
                script.push(Act::Want(Wanted::Lines("error:3".into(), 1)));
                continue;
            }
            script.extend([
                Act::line("M3S1000"),
                Act::Bytes(b"G91G1X1F600\n"),
                Act::State("Run"),
                Act::Refused(statement),
                Act::Want(Wanted::Lines("error:8".into(), 1)),
                Act::State("Idle"),
                Act::line(statement),
                Act::Await("Grbl "),
                Act::Want(Wanted::Inactive("spindle")),
            ]);
            script.extend(wanted.clone().map(Act::Want));
            script.extend([Act::Want(Wanted::No("ALARM:")), Act::line("G91G1X1F600")]);
        }
    }
    script
}

/// What every start must be able to: all axes move by exact steps.
fn start(axes: usize) -> Vec<Act> {
    let words = (0..axes).map(|axis| format!("{}0.2", name_of_axis(axis)));
    vec![
        Act::Await("Grbl 1.1h"),
        Act::Compare,
        Act::State("Idle"),
        Act::line("G21G91"),
        Act::Line(format!("G1{}F600", words.collect::<String>())),
        Act::State("Idle"),
        Act::Want(Wanted::Moved(START_STEPS)),
        Act::Want(Wanted::Resets(&[])),
    ]
}

/// What a machine does every day: moves, settings that resets keep, outputs, a hold, a reset in motion, a limit switch.
fn everyday(bench: &Bench, has_limit: bool) -> Vec<Act> {
    let mut script = start(bench.axes);
    script.extend(settings());
    // At USB, nobody listens yet when the startup line is executed.
    let has_uart = bench.link() == Link::Uart;
    script.extend(has_uart.then_some(Act::Await(">G20:ok")));
    script.extend(resets(usize::from(has_uart)));
    script.extend(motions());
    if has_limit {
        script.extend([
            Act::line("$21=1"),
            Act::line("M3S1000"),
            Act::line("G91G1X2F100"),
            Act::Pause(100),
            Act::Press(Input::Limit(0)),
            Act::Await("ALARM:1"),
            Act::State("Alarm"),
            Act::Release(Input::Limit(0)),
            Act::Bytes(RESET),
            Act::Await("Grbl "),
            Act::line("$X"),
            Act::line("$21=0"),
            Act::State("Idle"),
            Act::Pause(DRIVERS_OFF_MS),
            Act::Compare,
        ]);
    }
    script.extend([
        Act::State("Idle"),
        Act::Want(Wanted::Position),
        Act::Want(Wanted::Resets(&["Pin", "Pin"])),
    ]);
    script
}

fn want_lines(beginning: &str, times: usize) -> Act {
    Act::Want(Wanted::Lines(beginning.into(), times))
}

/// Stored values outlive a reset of Grbl and a reset of the chip, which forgets the position.
fn settings() -> Vec<Act> {
    vec![
        Act::line("$I"),
        want_lines("[VER:1.1h", 1),
        Act::line("$120=200"),
        Act::Bytes(RESET),
        Act::Await("Grbl "),
        Act::line("$$"),
        want_lines("$120=200.000", 1),
        Act::line("G90G1X0F600"),
        Act::State("Idle"),
        Act::Want(Wanted::Position),
        Act::line("G10L2P1X5"),
        Act::line("$N0=G20"),
        Act::line("$I=shop 7"),
        Act::Reset,
        Act::Await("Grbl "),
    ]
}

/// What outlives a reset of the chip; then all are restored. A new board has listed its settings, which has been
/// heard so many times.
fn resets(times_listed: usize) -> Vec<Act> {
    vec![
        Act::line("$G"),
        Act::Want(Wanted::OneOf(&["[GC:G0 G54 G17 G20 "])),
        Act::line("$$"),
        want_lines("$120=200.000", 2),
        Act::line("$I"),
        want_lines("[VER:1.1h.20190830:SHOP7]", 1),
        Act::line("$#"),
        want_lines("[G54:5.000,", 1),
        // Everything returns to its default.
        Act::Bytes(b"$RST=*\n"),
        Act::Await("Grbl "),
        Act::Reset,
        Act::Await("Grbl "),
        Act::line("$$"),
        want_lines("$120=10.000", 1 + times_listed),
        Act::line("$#"),
        want_lines("[G54:0.000,", 1),
        Act::State("Idle"),
    ]
}

fn motions() -> Vec<Act> {
    vec![
        Act::line("M3S1000"),
        Act::line("M8"),
        Act::line("M7"),
        Act::line("G4P0.05"),
        Act::Want(Wanted::PwmOn),
        Act::line("M5M9"),
        Act::line("G90G21"),
        Act::line("G1X5F600"),
        Act::Pause(100),
        Act::Bytes(b"!"),
        Act::State("Hold:0"),
        Act::Bytes(b"~"),
        Act::State("Idle"),
        Act::Want(Wanted::OneOf(&["<Idle|MPos:5.000,"])),
        Act::line("G1X0F300"),
        Act::Pause(100),
        Act::Bytes(RESET),
        Act::Await("Grbl "),
        // It brakes.
        Act::Pause(100),
        Act::State("Alarm"),
        Act::Want(Wanted::Position),
        Act::line("$X"),
    ]
}

/// What a firmware says that does not start. At USB, nobody hears it: the core has no clock, or no task serves it.
fn message(bench: &Bench, line: &'static str) -> Act {
    match bench.link() {
        Link::Uart => Act::Await(line),
        Link::Usb => Act::Pause(SILENCE_MS),
    }
}

/// No crystal and another one.
fn wrong_crystals(bench: &Bench, right: PowerUp) -> Vec<Act> {
    let own_mhz = bench.board.crystal_mhz;
    let other_mhz = OTHER_CRYSTALS_MHZ.into_iter().find(|mhz| *mhz != own_mhz);
    let mut script = vec![Act::Part("crystals")];
    for (name, mhz, reason) in [
        ("no crystal", 0, "[MSG:Crystal does not run"),
        (
            "another crystal",
            other_mhz.unwrap_or(0),
            "[MSG:Crystal of ",
        ),
    ] {
        let crystal_hz = u64::from(mhz) * 1_000_000;
        let fitted = FittedParts {
            crystal_hz,
            ..right.fitted
        };
        script.extend([
            Act::Case(name.into(), PowerUp { fitted, ..right }),
            message(bench, "ALARM:16"),
            message(bench, reason),
            message(bench, "Grbl "),
            Act::Bytes(MOVE_ALL_THE_SAME),
            Act::Pause(100),
            Act::Want(Wanted::CoreMhz(HSI_MHZ)),
            Act::Want(Wanted::NoStep),
        ]);
    }
    script
}

/// Every chip of the board's file, another one, and a firmware that is damaged.
fn wrong_chips(bench: &Bench, right: PowerUp, is_short: bool) -> Vec<Act> {
    let mut script = vec![Act::Part("chips")];
    let own = bench.board.chip.dev_ids.iter().map(|it| u64::from(*it));
    let others = own.clone().skip(1).chain([0]).filter(|_| !is_short);
    for device in others {
        let fitted = FittedParts {
            device,
            ..right.fitted
        };
        script.push(Act::Case(
            format!("DEV_ID {device:#x}"),
            PowerUp { fitted, ..right },
        ));
        script.extend(start(bench.axes));
    }
    let refused = |reason| {
        [
            message(bench, "ALARM:16"),
            message(bench, reason),
            Act::Bytes(MOVE_ALL_THE_SAME),
            Act::Pause(50),
            Act::Want(Wanted::No("Grbl ")),
            Act::Want(Wanted::NoStep),
        ]
    };
    let other = CHIPS
        .into_iter()
        .find(|it| !own.clone().any(|own| own == *it));
    let fitted = FittedParts {
        device: other.unwrap_or_default(),
        ..right.fitted
    };
    script.push(Act::Case(
        "another chip".into(),
        PowerUp { fitted, ..right },
    ));
    script.extend(refused("[MSG:Firmware is for another chip"));
    let damaged = PowerUp {
        is_damaged: true,
        ..right
    };
    script.push(Act::Case("a damaged firmware".into(), damaged));
    script.extend(refused("[MSG:Firmware in flash is damaged"));
    script
}

/// The supply is cut while a setting is stored: the old value is there afterwards, the new one where all was stored, and
/// all others.
fn power_cuts(right: PowerUp, is_short: bool) -> Vec<Act> {
    let begin = |name: String| {
        [
            Act::Case(name, right),
            Act::Await("Grbl "),
            Act::line("$120=200"),
            Act::line("$121=10"),
            Act::Pause(50),
        ]
    };
    let mut script = vec![Act::Part("power cuts")];
    script.extend(begin("no cut".into()));
    script.extend([Act::CountStored, Act::line("$121=300"), Act::Pause(50)]);
    let cuts = if is_short { &CUTS[2..3] } else { &CUTS };
    for (cut, expected) in cuts {
        script.extend(begin(format!("a cut: {cut:?}")));
        script.extend([
            Act::line("$$"),
            Act::Remember,
            Act::CutAfter(*cut),
            // Its answer tells of what is cut.
            Act::Bytes(b"$121=300\n"),
            Act::Pause(STORING_MS),
            Act::Want(Wanted::Cut),
            Act::Case(format!("after a cut: {cut:?}"), right),
            Act::Await("Grbl "),
            Act::line("$$"),
            Act::Want(Wanted::OneOf(expected)),
            Act::Want(Wanted::Remembered("$121=")),
            Act::State("Idle"),
        ]);
    }
    script
}

/// The core hangs, the crystal stops, the supply falls, each while X moves.
fn faults_in_motion(bench: &Bench, right: PowerUp) -> Result<Vec<Act>> {
    let wiring = bench.wiring()?;
    let mut script = vec![Act::Part("faults in motion")];
    let (has_eeprom, core) = (wiring.eeprom.is_some(), &["Core", "Core"]);
    // Without USB, the machine comes up at once; else it tries again.
    let resets = if bench.link() == Link::Usb { 2 } else { 1 };
    let low_supply = after_low_supply(bench.link(), has_eeprom);
    for (name, fault, then, causes) in [
        ("the core hangs", Act::Hang, after_reset(), &["IWDG"][..]),
        (
            "the crystal stops",
            Act::StopCrystal,
            after_reset(),
            &core[..1],
        ),
        (
            "the supply falls",
            Act::Supply(2600),
            low_supply,
            &core[..resets],
        ),
    ] {
        script.extend([
            Act::Case(name.into(), right),
            Act::Await("Grbl "),
            Act::line("G21G91"),
            Act::line("M3S1000"),
            Act::line("G1X100F600"),
            Act::Pause(300),
            fault,
        ]);
        script.extend(then);
        script.push(Act::Want(Wanted::Resets(causes)));
        // What hangs switches nothing off: the reset does.
        if causes != ["IWDG"] && wiring.spindle.is_some() {
            script.push(Act::Want(Wanted::Inactive("spindle")));
        }
    }
    Ok(script)
}

/// A sender is welcomed, and hears why the machine is locked.
fn after_reset() -> Vec<Act> {
    vec![
        Act::Await("Grbl "),
        Act::State("Alarm"),
        Act::Want(Wanted::Lines("ALARM:200".into(), 1)),
    ]
}

/// With a supply that stays low, no flash is written, and USB has no clock until the supply is good again.
fn after_low_supply(link: Link, has_eeprom: bool) -> Vec<Act> {
    if link == Link::Usb {
        let mut script = vec![Act::Pause(SILENCE_MS / 2), Act::Supply(3300)];
        script.extend(after_reset());
        return script;
    }
    let stored = if has_eeprom { "ok" } else { "error:" };
    vec![
        Act::Await("[MSG:Fault: supply too low"),
        Act::Await("ALARM:16"),
        Act::Await("Grbl "),
        Act::Bytes(b"$120=300\n"),
        Act::Await(stored),
        Act::Supply(3300),
        Act::Bytes(RESET),
        Act::Await("Grbl "),
        Act::State("Alarm"),
    ]
}

/// Whole programs, with the steps of the simulator.
fn job_script(bench: &Bench, jobs: &[Job]) -> Result<Vec<Act>> {
    let mut script = Vec::new();
    let right = PowerUp::of(&bench.board);
    script.push(Act::Part("jobs, with the step edges of the simulator"));
    for job in jobs {
        let text = std::fs::read_to_string(&job.program)
            .with_context(|| format!("cannot read {}", job.program.display()))?;
        let name = job
            .program
            .file_name()
            .unwrap_or_default()
            .to_string_lossy();
        script.push(Act::Case(name.into_owned(), right));
        script.push(Act::Await("Grbl "));
        script.extend(job.settings.iter().map(|line| Act::line(line)));
        let switches = switches(&job.settings, bench.axes);
        script.extend({ switches.into_iter() }.map(|(input, closes)| Act::Mount(input, closes)));
        script.extend([
            Act::Stream(text.lines().map(str::to_owned).collect()),
            Act::State("Idle"),
            Act::Want(Wanted::Steps(job.events.clone())),
            Act::Want(Wanted::Resets(&[])),
        ]);
    }
    Ok(script)
}

/// The simulator's switches and plate, where the travel is as settings say.
pub(crate) fn switches(settings: &[String], axes: usize) -> Vec<(Input, Closes)> {
    let setting = |number: usize| {
        let beginning = format!("${number}=");
        let mut values = { settings.iter() }.filter_map(|line| line.strip_prefix(&beginning));
        values.find_map(|value| value.parse::<f64>().ok())
    };
    let mut switches = Vec::new();
    for axis in 0..axes {
        let scale = setting(100 + axis).unwrap_or(STEPS_PER_MM);
        let half_mm = setting(130 + axis).unwrap_or(TRAVEL_MM) / 2.0;
        let steps = |mm: f64| (mm * scale).round() as i32;
        for limit in [Input::Limit(axis as u8), Input::SecondLimit(axis as u8)] {
            switches.push((limit, Closes::From(steps(half_mm))));
            switches.push((limit, Closes::DownFrom(steps(-half_mm - BEYOND_MM))));
        }
        if axis == 2 {
            let plate = Closes::DownFrom(steps(-half_mm + PLATE_MM));
            switches.push((Input::Probe, plate));
        }
    }
    switches
}
