//! `cargo xtask conformance`: what Grbl was recorded to do, against the virtual machine.

mod answers;
mod check;
mod compare;
mod deviation;
mod exchange;
mod golden;
mod print;

use std::{
    fmt::Write as _,
    fs,
    num::NonZero,
    path::Path,
    process::ExitCode,
    sync::atomic::{AtomicUsize, Ordering},
    thread::{self, ScopedJoinHandle},
};

use anyhow::{Context, Result, ensure};
use common::options::{self, Conformance as Options, Verb};
use serde::Serialize;
use simulation::play;

use self::{
    check::Table,
    compare::{Difference, Verdict},
    deviation::Deviation,
    exchange::Exchange,
    golden::Case,
};

/// Something recorded.
#[derive(Debug)]
enum Recording {
    Program(Case),
    Check(Table),
    Exchange(Box<Exchange>),
}

/// One comparison.
#[derive(Debug, Serialize)]
struct Outcome {
    /// The folder or the file of the recording.
    category: String,
    /// The program, or the name of the exchange.
    program: String,
    /// The settings that the recording was made with.
    #[serde(skip_serializing_if = "String::is_empty")]
    settings: String,
    /// Lines compared; 1 for what is compared as a whole.
    rows: usize,
    /// How it came out.
    verdict: Verdict,
    /// Motion time here, s.
    #[serde(skip_serializing_if = "Option::is_none")]
    motion_time_s: Option<f64>,
    /// Motion time of the recording, s.
    #[serde(skip_serializing_if = "Option::is_none")]
    recorded_motion_time_s: Option<f64>,
    /// What differs.
    differences: Vec<Difference>,
}

fn main() -> ExitCode {
    common::main(|| match options::read() {
        Verb::Conformance(options) => run(&options),
        other => other.refuse(),
    })
}

fn run(options: &Options) -> Result<ExitCode> {
    if options.document {
        print!("{}", document()?);
        return Ok(ExitCode::SUCCESS);
    }
    let dir = options.dir.as_deref();
    let recordings = match dir {
        Some(dir) => load(dir, &options.category)?,
        None => exchanges(answers::load(&options.category)?),
    };
    let place = dir.unwrap_or(Path::new("tests/conformance"));
    ensure!(
        !recordings.is_empty(),
        "there is nothing to compare in {}: a folder of recordings holds \
         golden/CATEGORY/NAME.grbl.json, golden/CATEGORY/NAME.check.csv or suites/grbl_….json",
        place.display()
    );
    let outcomes = replay_all(place, &recordings)?;
    print::all(&outcomes, options.all);
    if let Some(path) = &options.json {
        let text = serde_json::to_string(&outcomes)? + "\n";
        fs::write(path, text).with_context(|| format!("cannot write {}", path.display()))?;
    }
    let differs = |outcome: &Outcome| outcome.verdict == Verdict::Differs;
    Ok(ExitCode::from(u8::from(outcomes.iter().any(differs))))
}

/// Everything that is recorded in the folder and asked for.
fn load(dir: &Path, categories: &[String]) -> Result<Vec<Recording>> {
    let mut recordings = Vec::new();
    if dir.join("golden").is_dir() {
        let cases = golden::load(dir, categories)?;
        recordings.extend(cases.into_iter().map(Recording::Program));
        if categories.is_empty() || categories.iter().any(|name| name == CHECK) {
            recordings.extend(check::load(dir)?.into_iter().map(Recording::Check));
        }
    }
    recordings.extend(exchanges(exchange::load(dir, categories)?));
    Ok(recordings)
}

fn exchanges(exchanges: Vec<Exchange>) -> Vec<Recording> {
    let exchanges = exchanges.into_iter().map(Box::new);
    exchanges.map(Recording::Exchange).collect()
}

/// What is compared, and every deviation with its rule, as a document.
fn document() -> Result<String> {
    let mut text = HEAD.to_owned();
    for deviation in Deviation::ALL {
        let row = deviation.row();
        writeln!(text, "| {} | {} | {} |", row.id, row.text, row.rule)?;
    }
    Ok(text)
}

/// The document up to the table's rows.
const HEAD: &str = "\
# Compared with Grbl

```sh
cargo xtask conformance                              # what is in the repository
cargo xtask conformance DIR                          # everything that is in the folder
cargo xtask conformance DIR --category transcripts   # one part; repeatable
cargo xtask conformance DIR --all --json out.json    # every difference, also those by design
```

`tests/conformance/` has short programs and what Grbl 1.1h answers to each line, by topic:
`tests/conformance/src/answers.rs` describes their form. `cargo xtask test` replays them. `DIR` holds
recordings of whole programs and sessions; they are not part of this repository, and no test needs them.
Everything is replayed on the virtual machine, which is the firmware's own code, over its serial line at
115 200 baud and on a virtual clock. The exit status is 1 when a difference has no name.

| files in `DIR` | category | compared |
|---|---|---|
| `golden/CATEGORY/NAME.grbl.json` | their folder | programs executed: each answer, messages, final steps, steps per axis, motion time, and what `$G`, `$#` and `?` say in the end |
| `golden/CATEGORY/NAME.check.csv` | `check` | programs in check mode: answer, position, F, S, T, modes and messages after each line |
| `suites/grbl_error_cases.json` | `error_cases` | single lines: everything received, and the end |
| `suites/grbl_transcripts.json` | `transcripts` | sessions: everything received and when, pins and switches, outputs, and the end |

Texts and their order are exact, positions at rest too. Times may differ by 50 ms, positions in motion by
30 ms of travel, speeds by 1 %, in ramps by 10 %; a state by what the machine was 50 ms before or after.
Beside the recording, each report is held against the machine: it must show where the axes are, and must
be sent within 5 ms of its `?`.

`cargo xtask sim --session IN --out OUT` replays the same sessions without comparing, and writes them
back with what was received.

## Deviations

What differs on purpose. Each is found by its cause in the exchange; the tool counts what each explains
and names where. [grbl-compatibility.md](grbl-compatibility.md) gives the reasons.

| name | what Leadscrew does | what may differ |
|---|---|---|
";

/// The category of the tables.
const CHECK: &str = "check";

/// Runs everything, on every core.
fn replay_all(dir: &Path, recordings: &[Recording]) -> Result<Vec<Outcome>> {
    let workers = thread::available_parallelism().map_or(1, NonZero::get);
    let next = AtomicUsize::new(0);
    let work = || {
        let mut outcomes = Vec::new();
        loop {
            let index = next.fetch_add(1, Ordering::Relaxed);
            let Some(recording) = recordings.get(index) else {
                break Ok(outcomes);
            };
            outcomes.push((index, replay(dir, recording)?));
        }
    };
    let outcomes: Result<Vec<Vec<_>>> = thread::scope(|scope| {
        let workers: Vec<_> = (0..workers).map(|_| scope.spawn(work)).collect();
        let done = workers.into_iter().map(ScopedJoinHandle::join);
        done.map(|done| done.expect("no worker panics")).collect()
    });
    let mut outcomes: Vec<_> = outcomes?.into_iter().flatten().collect();
    outcomes.sort_by_key(|(index, _)| *index);
    Ok(outcomes.into_iter().map(|(_, outcome)| outcome).collect())
}

fn replay(dir: &Path, recording: &Recording) -> Result<Outcome> {
    match recording {
        Recording::Program(case) => replay_program(dir, case)
            .with_context(|| format!("{} with settings {}", case.program, case.settings_name)),
        Recording::Check(table) => {
            let (rows, differences) = check::replay(table)?;
            Ok(Outcome::of(CHECK, &table.name, rows, differences))
        }
        Recording::Exchange(exchange) => {
            let differences = exchange
                .replay()
                .with_context(|| format!("exchange {}", exchange.name))?;
            Ok(Outcome::of(
                &exchange.category,
                &exchange.name,
                1,
                differences,
            ))
        }
    }
}

impl Outcome {
    fn of(category: &str, program: &str, rows: usize, differences: Vec<Difference>) -> Self {
        Self {
            category: category.into(),
            program: program.into(),
            settings: String::new(),
            rows,
            verdict: Verdict::of(&differences),
            motion_time_s: None,
            recorded_motion_time_s: None,
            differences,
        }
    }
}

fn replay_program(dir: &Path, case: &Case) -> Result<Outcome> {
    let path = dir.join(&case.program);
    let settings = case.settings()?;
    let played = play::play_recorded(&path, &settings, &case.switches(&settings))?;
    let traits = golden::Traits::of(&path, &settings)?;
    let differences = compare::compare(&case.run, &played, &traits);
    let figures = played.figures;
    Ok(Outcome {
        settings: case.settings_name.clone(),
        motion_time_s: Some(figures.motion_time_s),
        recorded_motion_time_s: Some(case.run.motion_time_s),
        ..Outcome::of(&case.category, &case.program, 1, differences)
    })
}

#[cfg(test)]
mod tests {
    use common::cargo;
    use leadscrew::axis::AXES;

    use super::*;

    #[test]
    fn the_machine_answers_what_grbl_does_but_where_a_deviation_says_so() {
        // Reports show as many axes as there are.
        if AXES != 3 {
            return;
        }
        let recordings = exchanges(answers::load(&[]).unwrap());
        let outcomes = replay_all(Path::new("tests/conformance"), &recordings).unwrap();
        assert!(outcomes.len() > 300, "{}", outcomes.len());
        let differing: Vec<_> = outcomes
            .iter()
            .filter(|outcome| outcome.verdict == Verdict::Differs)
            .map(|outcome| serde_json::to_string(outcome).unwrap())
            .collect();
        assert!(differing.is_empty(), "{differing:#?}");
    }

    #[test]
    fn the_document_is_what_the_tool_prints() {
        let page = cargo::root().join("docs/conformance.md");
        let page = fs::read_to_string(page).unwrap();
        assert!(page == document().unwrap(), "run `cargo xtask docs`");
    }
}
