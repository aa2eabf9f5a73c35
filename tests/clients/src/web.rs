//! The page of `cargo xtask web`: its code beside that of this computer, and the page in a browser.

mod programs;

use std::{
    env, fs,
    path::{Path, PathBuf},
    process::Command,
    sync::Mutex,
};

use anyhow::{Context, Result, bail, ensure};
use common::{cargo, check::Verdict, document, tools};
use pages::web::measure::{native, under_node};

use super::{
    browser::{self, run_output},
    browser_and_modules, install,
};

/// What looks at the page.
const SCRIPT: &str = "web_page.js";
/// The scripts of the control page: its areas, losses while a key is held, the findings of axe-core, a long job.
const CONTROL_SCRIPT: &str = "control_page.js";
const LOSS_SCRIPT: &str = "control_loss.js";
const AXE_SCRIPT: &str = "control_axe.js";
const LONG_SCRIPT: &str = "control_long.js";
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

/// How the control page reaches a machine at a port.
#[derive(Debug, Clone, Copy, PartialEq, Eq)]
pub(super) enum PageConnection {
    /// `cargo xtask monitor --control` has the machine.
    Served,
    /// Web Serial, which the script has in place of the browser's.
    Serial,
    /// A WebSocket of the machine's own.
    Socket,
}

impl PageConnection {
    /// The name of the check.
    pub(super) fn name(self) -> &'static str {
        match self {
            Self::Served => "the served control page",
            Self::Serial => "the control page by a serial port",
            Self::Socket => "the control page by a WebSocket",
        }
    }

    /// As the script has it.
    pub(super) fn word(self) -> &'static str {
        match self {
            Self::Served => "served",
            Self::Serial => "serial",
            Self::Socket => "socket",
        }
    }
}

/// Node with a browser, and with what a day at the control page needs in its environment.
pub(super) fn with_page(connection: PageConnection) -> Result<Command> {
    let mut node = browser_and_modules()?;
    node.env("CONTROL_CONNECTION", connection.word());
    if connection == PageConnection::Served {
        node.env("MONITOR", tools::command(tools::MONITOR)?.get_program());
        serve_what_is_built(&mut node)?;
    } else {
        let page = made(&install::folder().join(connection.word()))?;
        node.env("CONTROL_PAGE", page.with_file_name(pages::control::FILE));
    }
    Ok(node)
}

/// Builds the page that the program serves: Cargo would have it wait for other builds.
fn serve_what_is_built(node: &mut Command) -> Result<()> {
    tools::control()?;
    node.env_remove("CARGO");
    Ok(())
}

/// Has a browser control the virtual machine.
pub(super) fn control() -> Result<Verdict> {
    of_control_page(CONTROL_SCRIPT)
}

/// Looks for what axe-core finds at the control page.
pub(super) fn axe() -> Result<Verdict> {
    of_control_page(AXE_SCRIPT)
}

/// Has a page send a long job while another one is in front of it.
pub(super) fn long_job() -> Result<Verdict> {
    of_control_page(LONG_SCRIPT)
}

/// The lines in docs/view.md between which the figures of pages are, and the variable of a run that writes them.
const FIGURES: [&str; 2] = [
    "<!-- begin: LEADSCREW_WRITE=1 cargo xtask test --clients \"the first picture\" -->\n",
    "<!-- end of the first picture -->",
];
const WRITE: &str = "LEADSCREW_WRITE";

/// Has a browser show the paths of long jobs.
pub(super) fn first_picture() -> Result<Verdict> {
    let verdict = browser::run_script("first_picture.js", "first-picture", |folder, node| {
        let examples = cargo::root().join("examples");
        node.arg(tools::command(tools::VIEW)?.get_program());
        node.args(["mill.settings", "plate.nc"].map(|file| examples.join(file)));
        let index = made(folder)?;
        node.arg(index.with_file_name(pages::control::FILE))
            .arg(index);
        Ok(())
    })?;
    let figures = install::folder().join("first-picture/figures.md");
    if verdict == Verdict::Passed && env::var_os(WRITE).is_some() {
        let [begin, end] = FIGURES;
        document::write_part("docs/view.md", begin, end, &fs::read_to_string(figures)?)?;
    }
    Ok(verdict)
}

/// Holds a key of the control page while the page goes, or its connection.
pub(super) fn loss() -> Result<Verdict> {
    of_control_page(LOSS_SCRIPT)
}

/// Runs a script with the control page, the tools between it and a machine, and the settings of that.
fn of_control_page(script: &str) -> Result<Verdict> {
    let folder = script.trim_end_matches(".js").replace('_', "-");
    browser::run_script(script, &folder, |folder, node| {
        node.arg(made(folder)?.with_file_name(pages::control::FILE));
        serve_what_is_built(node)?;
        for tool in [tools::MONITOR, tools::SIM] {
            node.arg(tools::command(tool)?.get_program());
        }
        node.arg(install::scripts().join("sim.settings"));
        Ok(())
    })
}
