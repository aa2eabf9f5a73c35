//! The page of `cargo xtask web`: its code beside that of this computer, and the page in a browser.

mod programs;

use std::{
    fs,
    path::{Path, PathBuf},
    sync::Mutex,
};

use anyhow::{Context, Result, bail, ensure};
use common::{cargo, check::Verdict, tools};
use pages::web::measure::{native, under_node};

use super::{
    browser::{self, run_output},
    install,
};

/// What looks at the page.
const SCRIPT: &str = "web_page.js";
/// What looks at the control page.
const CONTROL_SCRIPT: &str = "control_page.js";
/// Lines of a job that takes long enough to be cancelled.
const LONG: usize = 100_000;
/// One page is made at a time.
static MAKING: Mutex<()> = Mutex::new(());

/// A program with its settings.
struct Job {
    program: PathBuf,
    settings: Option<PathBuf>,
}

/// Makes the page in a folder, and returns where it is.
fn made(folder: &Path) -> Result<PathBuf> {
    let making = MAKING.lock();
    let folder = folder.join("page");
    let mut command = tools::command(tools::WEB)?;
    run_output(command.arg("--output").arg(&folder)).context("the page cannot be made")?;
    drop(making);
    Ok(folder.join("index.html"))
}

/// The examples with the settings that they are for, and with those of a new machine.
fn examples() -> Result<Vec<Job>> {
    let folder = cargo::root().join("examples");
    let mut jobs = Vec::new();
    for entry in fs::read_dir(&folder)? {
        let program = entry?.path();
        if program.extension().is_none_or(|kind| kind != "nc") {
            continue;
        }
        let own = program.with_extension("settings");
        let settings = if own.exists() {
            own
        } else {
            folder.join("mill.settings")
        };
        jobs.push(Job {
            program: program.clone(),
            settings: Some(settings),
        });
        jobs.push(Job {
            program,
            settings: None,
        });
    }
    ensure!(jobs.len() >= 12, "there are {} examples", jobs.len() / 2);
    Ok(jobs)
}

/// Writes the programs of many kinds.
fn written(folder: &Path) -> Result<Vec<Job>> {
    let programs = programs::all();
    let jobs = programs.into_iter().map(|(name, text, settings)| {
        let [program, list] = ["nc", "settings"].map(|kind| folder.join(name).with_extension(kind));
        fs::write(&program, text)?;
        fs::write(&list, settings)?;
        Ok(Job {
            program,
            settings: Some(list),
        })
    });
    jobs.collect()
}

/// WebAssembly and this computer come to the same.
pub(super) fn jobs() -> Result<Verdict> {
    if !cargo::is_there("node") {
        return Ok(Verdict::Skipped("node is not installed".into()));
    }
    let folder = install::folder().join("web-jobs");
    let _ = fs::remove_dir_all(&folder);
    fs::create_dir_all(&folder)?;
    let index = made(&folder)?;
    let mut jobs = examples()?;
    jobs.extend(written(&folder)?);
    let mut hashes = Vec::new();
    for job in &jobs {
        let (name, settings) = (job.program.display(), job.settings.as_deref());
        let here = native(&job.program, settings).map_err(|error| format!("{error:#}"));
        let there = under_node(&index, &job.program, settings)
            .map(|(summary, page)| {
                (
                    summary["hash"].as_str().unwrap_or_default().to_owned(),
                    page,
                )
            })
            .map_err(|error| format!("{error:#}"));
        let here = here.map(|(hash, page)| (hash, page.into_bytes()));
        if here != there {
            let hash = |outcome: Result<(String, Vec<u8>), String>| outcome.map(|(hash, _)| hash);
            bail!(
                "{name}: {:?} here, {:?} as WebAssembly",
                hash(here),
                hash(there)
            );
        }
        hashes.push(here.map(|(hash, _)| hash));
    }
    // Programs that do nothing would be equal as well.
    hashes.sort_unstable();
    hashes.dedup();
    let different = hashes.len();
    ensure!(
        different + 2 >= jobs.len(),
        "{} jobs have {different} hashes",
        jobs.len()
    );
    Ok(Verdict::Passed)
}

/// Has a browser run jobs in the page.
pub(super) fn page() -> Result<Verdict> {
    browser::run_script(SCRIPT, "web-page", |folder, node| {
        let index = made(folder)?;
        let examples = cargo::root().join("examples");
        let [program, settings] = ["plate.nc", "mill.settings"].map(|name| examples.join(name));
        let (hash, _) = native(&program, Some(&settings))?;
        let long = folder.join("long.nc");
        fs::write(&long, programs::relief(LONG))?;
        node.args([&index, &program, &settings]).arg(hash).arg(long);
        Ok(())
    })
}

/// Has a browser control the virtual machine.
pub(super) fn control() -> Result<Verdict> {
    browser::run_script(CONTROL_SCRIPT, "control-page", |folder, node| {
        node.arg(made(folder)?.with_file_name(pages::control::FILE));
        Ok(())
    })
}
