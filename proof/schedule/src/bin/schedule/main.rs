//! `cargo xtask schedule`: proves from the firmware's machine code that every deadline is met.
//!
//! The analysis is the library `proof/schedule`; this shows what it finds. `docs/scheduling.md`
//! explains the proof.

mod document;
mod instant;
mod marks;
mod mutants;
mod page;
mod project_copy;
#[cfg(test)]
mod sample;
mod text;
mod verdict;

use std::{fs, path::Path, process::ExitCode};

use anstream::{eprintln, println};
use anyhow::{Context, Error, Result, bail, ensure};
use common::options::{self, Schedule as Options, Verb};
use common::{cargo, install::Unavailable, text::row, tools, whole_thousands};
use firmware::boards::{Board, compile};
use owo_colors::OwoColorize;
use schedule::{Clock, Config, Input, Measured, Model, Report, Rule, replay::Summary};

use verdict::Verdict;

fn main() -> ExitCode {
    common::main(|| match options::read() {
        Verb::Schedule(options) => run(&options),
        other => other.refuse(),
    })
}

fn run(options: &Options) -> Result<ExitCode> {
    let mut board = firmware::boards::named(&options.board)?;
    if options.table {
        return table(&board);
    }
    if let Some(count) = options.mutants {
        let are_found = mutants::run(&board, count, options.seed, options.write)?;
        return Ok(exit_code(are_found));
    }
    if let Some(prefix) = &options.marks {
        marks::run(&board, prefix, options.write)?;
        return Ok(ExitCode::SUCCESS);
    }
    // What is followed is what was analysed.
    if options.replay && options.elf.is_none() {
        board = board.in_emulator()?;
    }
    let elf = match &options.elf {
        Some(elf) => elf.to_path_buf(),
        None => compile::firmware(&board)?,
    };
    let (report, confirmed) = analyse(&elf, &board, options)?;
    if options.rate {
        println!("{}", rate(&report)?);
        return Ok(ExitCode::SUCCESS);
    }
    if options.check || options.verdict {
        return check(&report, &elf, options, confirmed);
    }
    print(&report, confirmed);
    if options.loops {
        println!();
        for line in text::uncounted_loops(&report) {
            println!("{line}");
        }
    }
    if let Some(path) = &options.json {
        let json = serde_json::to_string(&report)? + "\n";
        write(path, &json)?;
    }
    if let Some(path) = &options.html {
        write(path, &page::page(&report, cargo::root())?)?;
    }
    if options.write {
        document::write(&report, &elf)?;
    }
    for flaw in &report.flaws {
        eprintln!("{}", text::flaw(flaw));
    }
    let is_confirmed = !options.replay || replay(&board, &elf, &report)?;
    Ok(exit_code(report.flaws.is_empty() && is_confirmed))
}

const fn exit_code(is_good: bool) -> ExitCode {
    if is_good {
        ExitCode::SUCCESS
    } else {
        ExitCode::FAILURE
    }
}

fn write(path: &Path, text: &str) -> Result<()> {
    fs::write(path, text).with_context(|| format!("cannot write {}", path.display()))
}

/// The report on a program, and the answer of the checker to its certificate if that is asked for.
fn analyse(elf: &Path, board: &Board, options: &Options) -> Result<(Report, Option<String>)> {
    let input = Input {
        elf,
        root: cargo::root(),
        board: &board.name,
        features: &board.features(cargo::axes().into()),
        clock: clock(board)?,
        axes: cargo::axes(),
        step_rate_hz: options.step_rate,
        baud: options.baud,
        measured: Measured::on(&board.name, cargo::root()).map_err(Error::msg)?,
    };
    let is_certified = options.certificate.is_some() || options.confirm;
    if !is_certified {
        let report = schedule::analyse(&input).map_err(Error::msg)?;
        return Ok((report, None));
    }
    let (report, certificate) = schedule::certify(&input).map_err(Error::msg)?;
    let confirmed = certificate
        .map(|it| confirmed(&it, elf, options))
        .transpose()?;
    Ok((report, confirmed.flatten()))
}

/// Writes a certificate where that is asked for, and has it checked where that is: returns what the checker says.
fn confirmed(certificate: &str, elf: &Path, options: &Options) -> Result<Option<String>> {
    if let Some(path) = &options.certificate {
        write(path, certificate)?;
    }
    if !options.confirm {
        return Ok(None);
    }
    let path = elf.with_extension("certificate.json");
    write(&path, certificate)?;
    Ok(Some(match schedule::confirm(elf, &path) {
        Ok(Ok(accepted)) => format!("certificate {accepted}"),
        Ok(Err(refused)) => bail!("the certificate of the proof is {refused}"),
        Err(error) if error.is::<Unavailable>() => format!("certificate not checked: {error}"),
        Err(error) => return Err(error),
    }))
}

/// Prints the verdict, and fails when the firmware is not proven or, where that is asked for, the
/// documents show another report.
fn check(
    report: &Report,
    elf: &Path,
    options: &Options,
    confirmed: Option<String>,
) -> Result<ExitCode> {
    for flaw in &report.flaws {
        eprintln!("{}", text::flaw(flaw));
    }
    ensure!(
        report.flaws.is_empty(),
        "{} with {} axes: {}",
        report.board,
        report.axes,
        text::verdict(report)
    );
    let text = if options.check {
        document::check(report, elf)?
    } else {
        text::verdict(report)
    };
    let confirmed = confirmed.map(|confirmed| format!("; {confirmed}"));
    println!("{text}{}", confirmed.unwrap_or_default());
    Ok(ExitCode::SUCCESS)
}

/// Prints the table of a board, without any calibration.
fn table(board: &Board) -> Result<ExitCode> {
    for (class, cycles) in Model::new(&clock(board)?).classes() {
        println!("{class} {cycles}");
    }
    Ok(ExitCode::SUCCESS)
}

/// The clocks of a board.
fn clock(board: &Board) -> Result<Clock> {
    board.chip.clocks.to_string().parse().map_err(Error::msg)
}

/// The requested analysis of the firmware.
fn config() -> Result<Config> {
    let path = cargo::root().join("schedule.toml");
    let text =
        fs::read_to_string(&path).with_context(|| format!("cannot read {}", path.display()))?;
    Config::parse(&text).map_err(Error::msg)
}

/// Follows a firmware of which `report` was made; whether nothing contradicts it.
fn replay(board: &Board, elf: &Path, report: &Report) -> Result<bool> {
    let out = cargo::target_dir().join("replay.json");
    let _ = fs::remove_file(&out);
    let (rate, baud) = (report.step_rate_hz.to_string(), report.baud.to_string());
    let mut command = tools::command(tools::TARGET)?;
    command.args(["replay", "--board", &board.argument(), "--step-rate", &rate]);
    command.args(["--baud", &baud, "--out"]).arg(&out).arg(elf);
    let played = command.status().context("cannot start the replay")?;
    let text = fs::read_to_string(&out).context("the plugin has left no report")?;
    let summary: Summary = serde_json::from_str(&text).context("the plugin's report is damaged")?;
    let verdict = Verdict::of(report, &summary, &config()?.replay);
    println!();
    verdict::print(&verdict, &summary);
    println!("coverage in {}", out.display().dimmed());
    Ok(verdict.is_passed() && played.success())
}

/// The rate that a report proves. A rate below the required one is no error here.
fn rate(report: &Report) -> Result<u32> {
    /// Most flaws that are printed before a replay.
    const MOST_SHOWN: usize = 3;
    // Another rate may be missed than the one that is proven.
    let asks = |rule: Rule| rule.is_wish() || rule == Rule::DeadlineMissed;
    let rate = report.proven_step_rate_hz.get(&report.baud.to_string());
    let rate = rate.map_or(0, |rate| whole_thousands(*rate));
    let wrong: Vec<_> = report
        .flaws
        .iter()
        .filter(|flaw| rate == 0 || !asks(flaw.rule))
        .collect();
    if !wrong.is_empty() {
        let shown = wrong.iter().take(MOST_SHOWN).map(|flaw| {
            let place = flaw.place.frames.first();
            let place = place.map_or(String::new(), |place| format!(", {place}"));
            format!("\n- {}{place}", flaw.what)
        });
        let more = match wrong.len().saturating_sub(MOST_SHOWN) {
            0 => String::new(),
            more => format!("\n- and {more} more"),
        };
        bail!(
            "the timing of the firmware cannot be proven{}{more}\n`cargo xtask schedule` tells everything",
            shown.collect::<String>()
        );
    }
    ensure!(
        rate > 0,
        "the timing of the firmware is proven for no step rate"
    );
    Ok(rate)
}

/// The report in the terminal.
fn print(report: &Report, confirmed: Option<String>) {
    let mut lines = text::heading(report).into_iter();
    if let Some(first) = lines.next() {
        println!("{}", first.bold());
    }
    for line in lines {
        println!("{line}");
    }
    println!();
    for (index, line) in text::tasks(report).lines().enumerate() {
        if index < 2 {
            println!("{}", line.bold());
        } else {
            println!("{line}");
        }
    }
    println!();
    for (name, value) in text::figures(report) {
        row(name, &value);
    }
    for (tasks, source) in text::blocking(report) {
        row("held up", &format!("{tasks}: {source}"));
    }
    for required in &report.requirements {
        let text = text::requirement(required);
        let text = if required.is_met {
            text
        } else {
            text.red().to_string()
        };
        row("required", &text);
    }
    println!();
    if report.flaws.is_empty() {
        println!("{} {}", "proven".green().bold(), text::verdict(report));
    } else {
        println!("{} {}", "not proven".red().bold(), text::verdict(report));
    }
    if let Some(confirmed) = confirmed {
        println!("{confirmed}");
    }
}

#[cfg(test)]
mod tests {
    use schedule::{Flaw, Place};

    use super::*;

    fn report(hz: u32, rules: &[Rule]) -> Report {
        let flaw = |rule: &Rule| Flaw {
            rule: *rule,
            what: format!("{rule:?}"),
            place: Place::default(),
            remedy: String::new(),
        };
        Report {
            baud: 115_200,
            proven_step_rate_hz: [("115200".into(), hz), ("250000".into(), 1)].into(),
            flaws: rules.iter().map(flaw).collect(),
            ..Report::default()
        }
    }

    #[test]
    fn a_rate_is_proven_where_nothing_but_a_wish_is_unmet() {
        assert_eq!(rate(&report(151_900, &[])).unwrap(), 151_000);
        let wishes = [Rule::Requirement, Rule::DeadlineMissed, Rule::UncountedLoop];
        assert_eq!(rate(&report(90_000, &wishes)).unwrap(), 90_000);
        for (hz, rules, reason) in [
            (90_000, &[Rule::UnboundedLoop][..], "UnboundedLoop"),
            (90_000, &[Rule::Requirement, Rule::Recursion], "Recursion"),
            (0, &[Rule::DeadlineMissed], "DeadlineMissed"),
            (999, &[], "for no step rate"),
        ] {
            let error = rate(&report(hz, rules)).unwrap_err().to_string();
            assert!(error.contains(reason), "{error}");
            assert!(hz == 0 || !error.contains("Requirement"), "{error}");
        }
        let many = rate(&report(1_000, &[Rule::ReachablePanic; 7])).unwrap_err();
        assert!(many.to_string().contains("and 4 more"), "{many}");
    }

    #[test]
    fn each_class_of_the_table_is_measured_on_a_board_and_no_other() {
        let folder = cargo::root().join("tests/calibrate");
        let files = ["instructions", "regions", "exceptions"];
        let source: String = files
            .iter()
            .map(|file| fs::read_to_string(folder.join(file).with_extension("rs")).unwrap())
            .collect();
        let model = Model::new(&"168/5/4/2".parse().unwrap());
        let classes = model.classes();
        for class in classes.keys() {
            assert!(source.contains(&format!("(\"{class}\", ")), "{class}");
        }
        for put in source.split("put(\"").skip(1) {
            let class = put.split('"').next().unwrap();
            assert!(classes.iter().any(|(known, _)| *known == class), "{class}");
        }
    }
}
