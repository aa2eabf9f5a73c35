//! What is known of a machine before a job: its settings, offsets, tools, modes and position.
//!
//! It is kept as the machine has said it, so that a job can be continued by another run of the tool.

use anyhow::{Result, bail, ensure};
pub use grbl_client::MachineAnswers;
use grbl_client::{Report, answer::step_rate};
use leadscrew::{
    axis::{AXES, LETTERS},
    model::{Levels, State, WorkCoordinates},
    settings::Settings,
    sim::{Closes, Edge, Simulator, Stream, StreamEnd, Switch, Watcher},
};

use crate::{
    playing, sender,
    settings::{Dump, combine},
};

/// A baud rate at which the line takes no time.
pub const UNLIMITED_BAUD: u32 = 10_000_000;

/// The settings. Those of which another firmware has other limits are left as they are by default.
pub fn settings(answers: &MachineAnswers) -> Settings {
    let rate = answers.version.iter().find_map(|line| step_rate(line));
    let start = Settings::new(rate.unwrap_or_default());
    let entries = Dump::read(&answers.settings.join("\n")).entries;
    match combine(&start, &entries) {
        Ok(combined) => combined.settings,
        Err(refused) => {
            let is_refused = |number| refused.iter().any(|one| one.entry.number == number);
            let others: Vec<_> = entries
                .iter()
                .filter(|entry| !is_refused(entry.number))
                .cloned()
                .collect();
            combine(&start, &others).map_or(start, |combined| combined.settings)
        }
    }
}

/// Lines that make another machine stand as this one.
fn set_up(answers: &MachineAnswers) -> Vec<String> {
    let is_in_inches = settings(answers).report_inches;
    let unit = if is_in_inches { "G20" } else { "G21" };
    let mut lines = vec![format!("{unit} G90 G94")];
    // By moves without `G53`, which ends before a switch, as long as all offsets are 0.
    for reference in ["G28", "G30"] {
        if let Some((values, _)) = answers
            .parameter(reference)
            .filter(|(values, _)| is_not_zero(values))
        {
            lines.push(format!("G0{}", words(values)));
            lines.push(format!("{reference}.1"));
        }
    }
    let position: Vec<_> = answers
        .position
        .iter()
        .map(|value| format!("{value:.4}"))
        .collect();
    lines.push(format!("G0{}", words(&position.join(","))));
    for (number, system) in (1..).zip(WorkCoordinates::ALL) {
        if let Some((values, angle)) = answers.parameter(system.word()) {
            let angle = angle.map_or(String::new(), |angle| format!(" R{angle}"));
            lines.push(format!("G10 L2 P{number}{}{angle}", words(values)));
        }
    }
    for tool in &answers.tools {
        if let Some((number, others)) = tool.strip_prefix('T').and_then(|tool| tool.split_once(' '))
        {
            // The pocket is no word of the statement.
            let others = others.split(' ').filter(|word| !word.starts_with('P'));
            lines.push(format!(
                "$TT{number}={}",
                others.collect::<Vec<_>>().join(" ")
            ));
        }
    }
    match answers.parameter("TLO") {
        Some((length, _)) if length.contains(',') => {
            lines.push(format!("G43.1{}", words(length)));
        }
        Some((length, _)) if is_not_zero(length) => lines.push(format!("G43.1 Z{length}")),
        _ => {}
    }
    if let Some((values, _)) = answers
        .parameter("G92")
        .filter(|(values, _)| is_not_zero(values))
    {
        lines.push(format!("G52{}", words(values)));
    }
    let feed = mode_words(answers, |letter, _| letter == 'F');
    lines.push(format!("{unit} {feed}"));
    lines.push(mode_words(answers, stays));
    lines
}

/// The words of `$G` that are wanted, by letter and number.
fn mode_words(answers: &MachineAnswers, is_wanted: impl Fn(char, f64) -> bool) -> String {
    let inside = answers
        .modes
        .trim_start_matches("[GC:")
        .trim_end_matches(']');
    let wanted = inside.split(' ').filter(|word| {
        let mut characters = word.chars();
        let letter = characters.next().unwrap_or_default();
        is_wanted(letter, characters.as_str().parse().unwrap_or_default())
    });
    wanted.collect::<Vec<_>>().join(" ")
}

/// A virtual machine that stands as this one, with all contacts open. It has limit switches if the job homes it: where
/// the machine, once homed, has them.
pub fn simulator(answers: &MachineAnswers, homes: bool) -> Result<Box<Simulator>> {
    ensure!(
        answers.position.len() == AXES,
        "the machine has {} axes, and this tool {AXES}: see --axes",
        answers.position.len()
    );
    let settings = Settings {
        limit_invert: false,
        probe_invert: false,
        ..settings(answers)
    };
    let mut simulator = homed(&settings).unwrap_or_else(|| unlocked(&settings));
    if !homes {
        simulator.dismount();
    }
    let text = set_up(answers).join("\n") + "\n";
    let mut refusal = Refusal::default();
    let end = stream(&mut simulator, &text, &mut refusal);
    if let Some(line) = refusal.0 {
        let text = text.lines().nth(line as usize - 1).unwrap_or_default();
        bail!("the virtual machine refuses {text}");
    }
    ensure!(
        end == StreamEnd::Complete && simulator.snapshot().state == State::Idle,
        "the virtual machine cannot be where the machine is"
    );
    Ok(simulator)
}

fn stream(simulator: &mut Simulator, text: &str, watcher: &mut impl Watcher) -> StreamEnd {
    Stream::new(simulator, text.bytes(), UNLIMITED_BAUD)
        .with_statements_at_rest()
        .run(watcher)
}

/// A virtual machine that is not homed.
fn unlocked(settings: &Settings) -> Box<Simulator> {
    let mut simulator = Box::new(Simulator::new(settings));
    playing::unlock(&mut simulator);
    simulator
}

/// A virtual machine that has been homed from where homing ends; `None` where it cannot be.
fn homed(settings: &Settings) -> Option<Box<Simulator>> {
    if !settings.is_homing_on() {
        return None;
    }
    let mut simulator = Box::new(Simulator::new(settings));
    for axis in 0..AXES {
        let scale = settings.steps_per_mm[axis].millionths() as f64 * 1e-6;
        let steps = (f64::from(settings.homing_pull_off_mm) * scale).round() as i32;
        let _ = simulator.mount(Switch {
            axis,
            closes: if settings.homes_downwards(axis) {
                Closes::DownFrom(-steps)
            } else {
                Closes::From(steps)
            },
            input: Levels::limits(1 << axis),
        });
    }
    let mut refusal = Refusal::default();
    let end = stream(&mut simulator, "$H\n", &mut refusal);
    let is_homed = end == StreamEnd::Complete && refusal.0.is_none();
    (is_homed && simulator.snapshot().state == State::Idle).then_some(simulator)
}

/// Whether a line homes axes.
pub fn homes(line: &[u8]) -> bool {
    sender::code(line).starts_with(b"$H")
}

/// Whether a line may probe.
pub fn probes(line: &[u8]) -> bool {
    let code = sender::code(line);
    sender::g_numbers(&code).any(|number| (38.0..39.0).contains(&number))
}

/// A line for a virtual machine on which no probe makes contact: each probing move goes to its end, which is no alarm.
pub fn without_contact(line: &[u8]) -> Vec<u8> {
    let mut replaced = line.to_vec();
    let (mut is_comment, mut word) = (false, Vec::new());
    for byte in &mut replaced {
        match *byte {
            b';' if !is_comment => break,
            b'(' => is_comment = true,
            b')' => is_comment = false,
            _ if is_comment || *byte <= b' ' => {}
            b'G' | b'g' => word = vec![b'G'],
            b'0' if word == b"G" => {}
            b'2' | b'4' | b'5' if word == b"G38." => *byte = b'3',
            _ => word.push(*byte),
        }
    }
    replaced
}

/// Whether a mode stays from one program to the next: not motion, cycles, compensation, lengths of tools,
/// which are offsets, spindle and coolant.
fn stays(letter: char, number: f64) -> bool {
    match letter {
        'S' | 'T' => true,
        'G' => (17.0..=21.0).contains(&number) || (54.0..70.0).contains(&number) || number >= 90.0,
        _ => false,
    }
}

/// The first line that is refused.
#[derive(Default)]
struct Refusal(Option<u64>);

impl Watcher for Refusal {
    fn edge(&mut self, _: &Edge) {}

    fn answer(&mut self, line: u64, answer: &[u8]) {
        if !answer.starts_with(b"ok") {
            self.0.get_or_insert(line);
        }
    }

    fn message(&mut self, _: &Simulator, _: u64, _: &[u8]) {}
}

/// Values between commas as axis words.
fn words(values: &str) -> String {
    let axes = LETTERS.iter().take(AXES).zip(values.split(','));
    let words = axes.map(|(letter, value)| {
        [" ", str::from_utf8(&[*letter]).unwrap_or_default(), value].concat()
    });
    words.collect()
}

fn is_not_zero(values: &str) -> bool {
    values.split(',').any(|value| value.parse() != Ok(0.0))
}

/// What a virtual machine answers, as [`Machine::answers`](grbl_client::Machine::answers) of one at a line.
pub fn of_virtual_machine(simulator: &mut Simulator) -> MachineAnswers {
    let mut ask = |text: &str| playing::ask(simulator, text.as_bytes());
    let report = ask("?");
    let report = report.first().and_then(|report| Report::read(report));
    MachineAnswers {
        version: ask("$I\n"),
        settings: ask("$+\n"),
        parameters: ask("$#\n"),
        tools: ask("$TT\n"),
        modes: ask("$G\n").into_iter().next().unwrap_or_default(),
        position: report
            .and_then(|it| it.machine_position())
            .unwrap_or_default(),
    }
}

#[cfg(test)]
mod tests {
    use super::*;

    #[test]
    fn a_probing_move_becomes_one_that_may_miss_and_nothing_else_changes() {
        for (line, expected) in [
            ("G38.2 Z-5 F50 (G38.2)", "G38.3 Z-5 F50 (G38.2)"),
            ("n5 g 038 .5x2", "n5 g 038 .3x2"),
            ("G91G38.4Z2;G38.4", "G91G38.3Z2;G38.4"),
            ("G38.3 X238.2", "G38.3 X238.2"),
            ("G1 X38.2 G380.2", "G1 X38.2 G380.2"),
            ("G38 G38.6", "G38 G38.6"),
        ] {
            let replaced = without_contact(line.as_bytes());
            assert_eq!(String::from_utf8(replaced).unwrap(), expected);
        }
    }

    #[test]
    fn another_machine_stands_as_the_one_that_was_asked() {
        for settings in ["", "$13=1\n"] {
            let mut first = Box::new(Simulator::new(&Settings::default()));
            let program = format!(
                "{settings}$110=2000\n$TT3=Z12.5 D6\nG10 L2 P2 X1.25 Y-3 Z0.5 R30\nG1 X7 Y2 F400\nG30.1\nG0 X3.5 Z1\n\
                 G52 X0.5\nG43.1 Z-2.5\nG55 G91 G18 G61.1 T3 S500 F250\n"
            );
            let mut refusal = Refusal::default();
            Stream::new(&mut *first, program.bytes(), UNLIMITED_BAUD)
                .with_statements_at_rest()
                .run(&mut refusal);
            assert_eq!(refusal.0, None);
            let one = of_virtual_machine(&mut first);
            let other = of_virtual_machine(&mut simulator(&one, false).unwrap());
            let modes = one
                .modes
                .replace("[GC:G0", "[GC:")
                .replace("[GC:G1", "[GC:");
            assert_eq!(other.modes.replace("[GC:G0", "[GC:"), modes);
            assert_eq!(
                MachineAnswers {
                    modes: one.modes.clone(),
                    ..other
                },
                one
            );
        }
    }
}
