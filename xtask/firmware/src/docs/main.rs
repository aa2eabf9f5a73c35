//! `cargo xtask docs`: the documents that are made from the code's tables.

mod json;
mod pages;
mod tables;

use std::{fmt::Write as _, fs, path::Path, process::ExitCode};

use anyhow::{Context, Result, bail};
use common::options::{self, Docs as Options, Verb};
use common::{BAUD, cargo, text::separated, tools, ui};
use leadscrew::{
    axis::AXES,
    gcode::{
        LineError,
        codes::{CODES, CodeGroup},
    },
    model::Alarm,
    protocol::{Condition, Dollar, STATEMENTS},
    settings::{DataType, Kind, Setting, Settings, StepRate, Value, assign},
};
use simulation::{meaning, proven};

/// Where a document lies, and what makes it.
type Document = (&'static str, fn() -> Result<String>);

/// Every document that this program makes.
const DOCUMENTS: [Document; 5] = [
    ("docs/gcodes.md", codes_table),
    ("docs/settings.md", settings_table),
    ("docs/errors.md", errors_table),
    ("docs/statements.md", statements_table),
    ("docs/json.md", json::document),
];
/// The document that another tool makes, and compares in a test of its own.
const CONFORMANCE: Document = ("docs/conformance.md", conformance_table);

fn conformance_table() -> Result<String> {
    let text = tools::output(tools::CONFORMANCE, ["--document"])?;
    Ok(text + "\n")
}

fn main() -> ExitCode {
    common::main(|| match options::read() {
        Verb::Docs(options) => run(&options),
        other => other.refuse(),
    })
}

fn run(options: &Options) -> Result<ExitCode> {
    if AXES != 3 {
        bail!("the documents are those of three axes: leave `--axes` away");
    }
    if options.check {
        check()?;
        return Ok(ExitCode::SUCCESS);
    }
    for (path, make) in DOCUMENTS.into_iter().chain([CONFORMANCE]) {
        write(path, make()?)?;
    }
    for (path, page) in pages::all()? {
        write(&path, page)?;
    }
    for table in &tables::TABLES {
        write(table.path, table.document()?)?;
    }
    Ok(ExitCode::SUCCESS)
}

fn write(path: &str, text: String) -> Result<()> {
    fs::write(cargo::root().join(path), text).with_context(|| format!("cannot write {path}"))?;
    ui::status("Written", path);
    Ok(())
}

/// Fails when a document is not what the code says.
fn check() -> Result<()> {
    if AXES != 3 {
        ui::status("Skipped", "the documents are those of three axes");
        return Ok(());
    }
    for (path, make) in DOCUMENTS {
        compare(path, &make()?)?;
    }
    for (path, page) in pages::all()? {
        compare(&path, &page)?;
    }
    for table in &tables::TABLES {
        compare(table.path, &table.document()?)?;
    }
    check_deviations()
}

fn compare(path: &str, text: &str) -> Result<()> {
    let found = fs::read_to_string(cargo::root().join(path)).unwrap_or_default();
    if found != text {
        bail!("{path} is out of date: run `cargo xtask docs`");
    }
    Ok(())
}

/// Fails when a deviation from Grbl names no test, or one that there is not.
fn check_deviations() -> Result<()> {
    const PATH: &str = "docs/grbl-compatibility.md";
    let text = fs::read_to_string(cargo::root().join(PATH))
        .with_context(|| format!("cannot read {PATH}"))?;
    let mut sources = String::new();
    for folder in ["tests", "src", "xtask"] {
        read_sources(&cargo::root().join(folder), &mut sources)?;
    }
    let rows: Vec<_> = text
        .lines()
        .filter(|line| line.starts_with("| D"))
        .collect();
    if rows.is_empty() {
        bail!("{PATH} has no deviations");
    }
    for row in rows {
        let cells: Vec<_> = row.trim_matches('|').split('|').map(str::trim).collect();
        let named = cells.last().copied().unwrap_or_default();
        for test in named.split(", ") {
            let name = test.trim_matches('`');
            if name.is_empty() || !sources.contains(&format!("fn {name}(")) {
                bail!("{PATH}: there is no test {test} ({})", cells[0]);
            }
        }
    }
    Ok(())
}

/// Appends every source file in a folder.
fn read_sources(folder: &Path, sources: &mut String) -> Result<()> {
    for entry in fs::read_dir(folder)? {
        let path = entry?.path();
        if path.is_dir() {
            read_sources(&path, sources)?;
        } else if path.extension().is_some_and(|extension| extension == "rs") {
            sources.push_str(&fs::read_to_string(&path)?);
        }
    }
    Ok(())
}

fn settings_table() -> Result<String> {
    let mut text = String::from(
        "# Settings\n\n\
         Made from the code by `cargo xtask docs`. `$n=value` changes one, at rest or in alarm; `$$` lists\n\
         those of Grbl 1.1, `$+` all, `$ES` describes them to programs, `$RST=$` brings the defaults back.\n\
         A value that is not allowed is answered with an error, and nothing changes. Tools read what `$$`\n\
         or `$+` has listed from a file: `--settings FILE`, and `cargo xtask settings`, which saves, compares\n\
         and loads those of a machine ([from Grbl](from-grbl.md#copy-your-settings)). Where flash or EEPROM has lost them, the\n\
         machine says so and is locked ([safety](safety.md#when-what-is-stored-is-damaged)).\n\n\
         | setting | what | unit | values | default |\n|---|---|---|---|---|\n",
    );
    let defaults = Settings::default();
    for setting in Setting::all() {
        let row = setting.row;
        let axis = setting
            .letter()
            .map_or(String::new(), |letter| format!(", {}", char::from(letter)));
        writeln!(
            text,
            "| `${}` | {}{axis} | {} | {} | {} |",
            setting.number(),
            row.name,
            row.unit,
            values(&setting),
            shown(setting.value(&defaults), row.kind.decimals()),
        )?;
    }
    text.push_str(ARC_MACHINE);
    text.push_str(&step_rates());
    text.push_str(SPINDLE);
    text.push_str(JERK);
    text.push_str(BACKLASH);
    text.push_str(CORE_XY);
    Ok(text)
}

/// Where the settings of the Pico arc machine are.
const ARC_MACHINE: &str = "\n`$790` and `$794` are there on boards for [motors without drivers](pico.md#motors-without-drivers) and in the simulator\n\
    only; `$791` can be 1 there only.\n";

/// How long motion waits for a spindle.
const SPINDLE: &str = "\n## The spindle\n\n\
    A spindle needs time before it cuts. `$394` is the time for which nothing moves after `M3` or `M4` has switched it on or\n\
    reversed it, in seconds: 0 or 0.5 to 20, as in grblHAL. When it begins the sender reads `[MSG:Waiting for spindle]`. Lines\n\
    are read meanwhile; hold, door, reset and `?` work as ever, and the time goes on in a hold. Another `S` of a spindle that\n\
    turns wants no time, nor does `M3 S0`, which starts nothing. Startup lines wait as well, and so do the operator's lines in\n\
    a change of the tool, cycles that switch the spindle on again, and `M106` where it drives that output (`$783=1`). A dwell\n\
    after `M3` comes on top: leave one of them out. Only the tap of `G74` and `G84` comes out of its hole at once.\n\n\
    `$392` is the same where the spindle comes back: after the door, and after a stop in a hold (0x9E), also where 0x9E has\n\
    switched it on before the hold ends. The longer of `$392` and `$394` counts. `$393` is the coolant's time after the door.\n\
    Nothing waits in laser mode, nor in check mode.\n\n\
    `M3` in a program that has no `S` turns no spindle whose speed comes from the PWM output. The first feed move then says\n\
    `[MSG:Spindle speed is 0]`, once up to `M2`, `M30` or a reset; nothing stops. A spindle on a relay turns all the same: with\n\
    `$775=1` there is no such message, and `M3` without `S` wants the time of `$394`.\n\n\
    The speed of a spindle that turns changes where the moves after an `S` begin, and these do not stop for it. An `S` that no\n\
    move follows counts at rest, before a dwell and whatever comes next. `$776=1` is for drives that want a standstill: the\n\
    machine stops before each change of speed, as Grbl does. It does in any case where the spindle starts, stops or is reversed:\n\
    at `S0` and an `S` after it, too.\n";

/// What limits of jerk do.
const JERK: &str = "\n## Limits of jerk\n\n\
    `$800` and on limit how fast the acceleration of an axis changes. With 0 on every axis, acceleration is\n\
    there at once. With a limit it takes a time: 500 mm/s² at 10 000 mm/s³ take 50 ms, and a ramp takes\n\
    that much longer at most. That is quieter, and leaves no ringing on a machine whose frame swings.\n\n\
    As soon as one axis has a limit, all motion but homing and parking changes its acceleration evenly, within\n\
    the same time for all axes: the longest of `$120` / `$800`, `$121` / `$801` and so on, in whole\n\
    milliseconds, 5 at least. If that is more than 120 ms, the acceleration is lowered\n\
    instead. Corners are passed as `$11` has it. A feed hold takes that time longer, too.\n\
    [motion-planning.md](motion-planning.md#limits-of-jerk) says how it works.\n\n\
    Arcs are passed as the short lines would be that replace them: as fast as `$120` and on allow. They take no\n\
    longer than these lines, but make a jerk beside `$800`, as corners do: on a radius r, up to √(a³/r) for an\n\
    acceleration of a, 16 000 mm/s³ at 500 mm/s² and 0.5 mm, and up to three times that while the speed changes. Where an\n\
    arc begins or ends, the acceleration changes at once, by a at most, by 2a between two arcs. `cargo xtask sim FILE\n\
    --quality` has both figures of a program, and names an axis whose jerk is more than these and `$800` together allow, by\n\
    5 % or more. With `$11=0`, arcs are so slow that they keep `$800`, and every corner is a stop.\n";

/// What backlash is, and what its settings do.
const BACKLASH: &str = "\n## Backlash\n\n\
    A screw turns a little before its nut follows when it turns back: the axis stands meanwhile, and circles get flats. `$160`\n\
    to `$165` are how far, of X, Y, Z, A, B and C, in mm or degrees, up to 10, as grblHAL has them; 0, as it comes, does nothing.\n\
    Before an axis moves in the other direction, the machine stops, its motor makes these steps as fast as `$110` and `$120` let\n\
    it, and then the move goes on. No axis moves meanwhile, and a laser is dark, under `M3` too. Positions are those of the axes:\n\
    status reports, `[PRB:`, soft limits and work coordinates have no such step in them.\n\n\
    **Measure it.** Leave it at 0 and put a dial gauge against the table, along the axis. Jog it towards the gauge by 1 mm, and\n\
    set the dial to zero. Jog 1 mm farther, then 1 mm back: what the dial is short of zero is the backlash. Do it at both ends and in the\n\
    middle of the travel, and set the smallest of these: `$160=0.08`. Measure again: with the setting the dial comes back to zero.\n\
    More than there is makes the axis jump at each reversal.\n\n\
    **What it does.** Lines, arcs, helices, cycles, jogs and probing moves are exact to a step. An arc stops where such an axis\n\
    reverses, at its quadrants; under `G64`, corners at which one reverses are not rounded. Homing takes the switch's\n\
    place with the backlash taken up, and ends `$27` from it. A feed hold, a jog that is cancelled, and a reset may come in\n\
    between; parking brings Z back to where it was.\n\n\
    **What it does not do.** It moves a table that stands by friction; a cutter that pulls at the table, as in a\n\
    climb cut, pulls it through the play all the same. It takes time at each reversal, and 3 ms beside that. The machine cannot know\n\
    the direction in which an axis moved last before it was switched on: it counts as moved as by the pull-off of homing (`$23`), as in\n\
    grblHAL. Home first, or move each axis once as far as its backlash in that direction. Limits of jerk do not count in these moves. The\n\
    belts of CoreXY have none: with `$795=1`, `$160` and `$161` are `error:52`. An arc that needs it does not follow `$790`.\n";

/// What `CoreXY` is, and what its settings count for.
const CORE_XY: &str = "\n## CoreXY\n\n\
    `$795=1` is for a machine whose X and Y hang on two belts: the motor at X's outputs makes the steps of X + Y, that at\n\
    Y's outputs those of X - Y, as with Grbl's `COREXY`. Grbl and grblHAL choose that when they are compiled and have no\n\
    setting for it. If the machine mirrors or swaps X and Y, turn a motor around with `$3`, or swap the motors' plugs.\n\n\
    What is a motor's counts for the motors: `$2`, `$3`, and `$110`, `$120`, `$800` of X for the first one, `$111`, `$121`, `$801`\n\
    for the second one. Along X or Y both turn, and the slower one decides; along a diagonal one turns alone, and the tool is\n\
    √2 times slower than it turns. Both have the resolution of `$100`; `$101` follows it. What is an axis' counts for the axes:\n\
    `$130` and `$131`, soft limits, `$23`, homing and its switches, jogs, probing and all positions that are reported.\n\n\
    Lines and arcs in the plane of X and Y, helices included, are as exact as on other machines. An arc of `G18` or `G19` becomes\n\
    chords that stay within `$12` of it. A homed axis is at its place to a step. A machine whose `$795` changes stands at\n\
    another position: home it.\n";

/// What resolution and speed must not be together, and where that is from.
fn step_rates() -> String {
    let proven = match proven::committed() {
        StepRate::Proven(hz) => format!(
            "The firmware of the Netduino Plus 2 with {AXES} axes is proven for {} steps per second \
             ([{}]({})).",
            separated(hz.into()),
            proven::REPORT,
            proven::REPORT.trim_start_matches("docs/"),
        ),
        StepRate::Unproven => "No rate is proven yet.".into(),
    };
    format!(
        "\n## The step rate\n\n\
         A resolution times a largest speed, `$100` × `$110` / 60 and so on, is how many steps a second an axis\n\
         may be asked for. `cargo xtask build` analyses each image that it has built for the highest rate,\n\
         all axes together, at which every task meets its deadline at {BAUD} baud, and writes it into the\n\
         image, in whole thousands. {proven} `$I` shows the rate of the\n\
         firmware that runs. An image of which nothing is proven says so and keeps to {} steps per second.\n\n\
         More for an axis than that, or than the step pulse `$0` leaves room for, is `error:12`. A move of\n\
         several axes that together would make more is made more slowly. So is every move where settings\n\
         that were stored earlier, or by another firmware, ask for more.\n",
        separated(StepRate::UNPROVEN_HZ.into()),
    )
}

/// `$781`: the values depend on the number of axes.
const EXTRUDER_AXIS: u16 = 781;

/// The values that a setting can have.
fn values(setting: &Setting) -> String {
    let kind = &setting.row.kind;
    match (kind.data_type(), kind.range()) {
        (DataType::Integer, _) if matches!(kind, Kind::Byte { .. }) => accepted_bytes(setting),
        (DataType::Bits, _) if kind.format().contains("N/A") => accepted_bytes(setting),
        (DataType::Boolean, _) => "0 or 1".into(),
        (DataType::Bits, _) => {
            let bits = kind.format().split(',').enumerate();
            let bits: Vec<_> = bits
                .map(|(bit, name)| format!("{} {name}", 1 << bit))
                .collect();
            format!("sum of {}", bits.join(", ").to_lowercase())
        }
        (DataType::AxisMask, _) => "sum of 1 X, 2 Y, 4 Z, 8 A, 16 B, 32 C".into(),
        (_, Some(range)) => {
            let decimals = range.decimals;
            format!("{:.decimals$} to {:.decimals$}", range.least, range.most)
        }
        (_, None) => String::new(),
    }
}

/// The values of a byte that a machine with default settings accepts, in words.
fn accepted_bytes(setting: &Setting) -> String {
    if setting.number() == EXTRUDER_AXIS {
        return "0, or 4 to the number of axes".into();
    }
    let is_accepted = |value: &u8| {
        let statement = format!("{}={value}", setting.number());
        assign(&mut Settings::default(), statement.as_bytes()).is_ok()
    };
    let accepted: Vec<u8> = (0..=u8::MAX).filter(is_accepted).collect();
    match *accepted.as_slice() {
        [] => String::new(),
        [only] => only.to_string(),
        [least, .., most] if accepted.len() > 2 && accepted.iter().copied().eq(least..=most) => {
            format!("{least} to {most}")
        }
        [ref others @ .., last] => {
            let others: Vec<_> = others.iter().map(u8::to_string).collect();
            format!("{} or {last}", others.join(", "))
        }
    }
}

fn shown(value: Value, decimals: usize) -> String {
    match value {
        Value::Whole(whole) => whole.to_string(),
        Value::Number(number) => format!("{number:.decimals$}"),
        Value::Millionths(millionths) => format!("{:.3}", millionths as f64 / 1.0e6),
    }
}

fn codes_table() -> Result<String> {
    let mut text = String::from(
        "# G-codes\n\n\
         Made from the table in `src/gcode/codes.rs` by `cargo xtask docs`; every line in it is executed by a \
         test.\n\n\
         A line may have one code of each modal group. \"axes\" are words like `X10`; words in brackets may be\n\
         left out. Under \"refused\" are lines with the error that they get ([what they mean](errors.md)). Words\n\
         without a code: `F` feed, `S` spindle speed, `T` tool, `N` line number. `%` alone in a line, `O1234` and\n\
         `:1234` do nothing.\n",
    );
    for group in CodeGroup::ALL {
        let name = group.name();
        write!(
            text,
            "\n## {name}\n\n| code | what it does | words | example | refused |\n|---|---|---|---|---|\n"
        )?;
        for row in CODES.iter().filter(|row| row.group == group) {
            let example = row.example.join("`, `");
            let refused = row.refused.iter();
            let refused = refused.map(|(line, error)| format!("`{line}` {}", error.number()));
            let refused = refused.collect::<Vec<_>>().join(", ");
            writeln!(
                text,
                "| `{}` | {} | {} | `{example}` | {refused} |",
                row.code, row.text, row.words
            )?;
        }
    }
    text.push_str(LIMITS);
    Ok(text)
}

/// The ends of what numbers can say: `tests/machine/numbers.rs` walks them.
const LIMITS: &str = "\n## What is limited\n\n\
    A number is done as it is written, or its line is refused and changes nothing. Nine decimals of a number\n\
    count.\n\n\
    | number | from, to | beyond | within |\n|---|---|---|---|\n\
    | `F` per minute, of programs and jogs | 1 to 10 000 000 mm, or degrees where only axes turn; 0 is none | 39; 0 22 in a feed move | the axes' largest speeds and the proven step rate limit the move; with an override it is not slower than 1 mm/min |\n\
    | `F` in `G93` | 1 / 71582 (49 days) to 10 000 000 per minute | 39; 0 22 | the same limits |\n\
    | `S` | 0 to 10 000 000 | 39 | above `$30` full power, below `$31` that of `$31`, as in Grbl |\n\
    | coordinates, `I` `J` `K`, `R` of arcs and cycles | 2^29 steps of the axis on either side, at most 9 000 km | 33, 34 | rounded to 1 nm, or a millionth of a degree |\n\
    | `P` of `G4` and cycles | 0 to 4 294 967 s | 39 | rounded to 1 ms; what is above 0 is 1 ms at least |\n\
    | `P` of `G2` and `G3` | 1 to 65 535 | 39; with a fraction 23 | |\n\
    | `P` `Q` of `G64` | 1 nm to 4.29 m, or 0 | 39 | |\n\
    | `Q` of `G73` and `G83` | one step of the axis, and more | 19, 39 | |\n\
    | `L` of cycles | 1 to 255 | 19, 39; with a fraction 23 | |\n\
    | `L` and `P` of `G10` | the codes and systems above; a tool of `P` as `T` | 20, 29, 38; with a fraction 23 | |\n\
    | `R` of `G10 L2` | below 10^12 degrees | 39 | rounded to a millionth of a degree; whole turns do not count |\n\
    | `T` `H` `D`, `Q` of `M61` | 0 to 255 | 38; with a fraction 23 | `D` of `G41.1` and `G42.1` is a length: 1 nm and more, or 0 |\n\
    | `N` | 0 to 10 000 000 | 27 | a fraction is read, as in LinuxCNC, and not reported |\n\
    | `P` of `M50` and `M51` | 0, or any other | 4 below 0 | |\n\
    | the number of a `G` or `M` | two decimals | 20, 23 | |\n\n\
    Overrides go from 10 to 200 % and keep to these ends, as in Grbl. `$`-settings have the values that\n\
    [settings.md](settings.md) lists, and no other: a fraction of a whole one, more than 1 where there is on or off, and\n\
    what is above 0 and below a millionth are `error:52`. `$$` shows three decimals, as Grbl does; all that was set\n\
    counts, for the resolution to a millionth of a step per mm. Bits of axes that are not there, in `$2`, `$3`, `$23` and\n\
    `$788`, are kept and shown, as in Grbl, and do nothing. `$4`, `$5` and `$6` are on, and shown as 1, with any of the\n\
    bits that grblHAL has for the axes. Travels, `$27`, `$56` and `$58` are at most what their axis\n\
    can count. Negative numbers where only positive ones mean something are error 4.\n";

fn errors_table() -> Result<String> {
    let mut text = String::from(
        "# Errors and alarms\n\n\
         Made from the code by `cargo xtask docs`; `$EE` and `$EA` send the same to programs.\n\n\
         ## `error:N`\n\n\
         The line had no effect at all.\n\n| N | what | what to do |\n|---|---|---|\n",
    );
    for error in LineError::ALL {
        let remedy = meaning::remedy_of_error(error);
        writeln!(text, "| {} | {} | {remedy} |", error.number(), error.text())?;
    }
    text.push_str("\n## `ALARM:N`\n\n| N | what | what to do |\n|---|---|---|\n");
    for alarm in Alarm::ALL {
        let remedy = meaning::remedy_of_alarm(alarm);
        writeln!(text, "| {} | {} | {remedy} |", alarm.number(), alarm.text())?;
    }
    Ok(text)
}

fn statements_table() -> Result<String> {
    const STATES: [(Condition, &str); 5] = [
        (Condition::Idle, "at rest"),
        (Condition::Run, "in motion"),
        (Condition::Jog, "in a jog"),
        (Condition::Check, "in check mode"),
        (Condition::Alarm, "locked"),
    ];
    let mut text = String::from(
        "# `$` statements\n\n\
         Made from the table in `src/protocol/dollar.rs` by `cargo xtask docs`, with what the firmware answers in each state:\n\
         ✓, or the number of the error ([what they mean](errors.md)). Homing is on, and the door closed. The settings of\n\
         `$n=value` have [a page of their own](settings.md), the tools [another](tool-lengths.md).\n\n| statement | what it does |",
    );
    for (_, name) in STATES {
        write!(text, " {name} |")?;
    }
    writeln!(text, "\n|---|---|{}", "---|".repeat(STATES.len()))?;
    let settings = Settings {
        homing: 1,
        ..Settings::default()
    };
    // What ends check mode is what begins it.
    for row in STATEMENTS
        .iter()
        .filter(|row| row.condition != Condition::Check)
    {
        let forms: Vec<_> = row
            .form
            .split(", ")
            .map(|form| format!("`{form}`"))
            .collect();
        write!(text, "| {} | {} |", forms.join(", "), row.text)?;
        for (condition, _) in STATES {
            match Dollar::read(row.example.as_bytes(), condition, &settings, false) {
                Ok(_) => text.push_str(" ✓ |"),
                Err(error) => write!(text, " {} |", error.number())?,
            }
        }
        text.push('\n');
    }
    Ok(text)
}
