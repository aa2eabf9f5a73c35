//! Where the cycles go: functions, also those that the compiler dissolved in others, and lines.

use std::{
    cmp::Reverse,
    collections::{BTreeSet, HashMap},
    path::Path,
};

use addr2line::Loader;
use anstream::println;
use anyhow::{Result, anyhow};
use owo_colors::OwoColorize;

use super::{
    figures::Cost,
    report::Report,
    tasks::{STAND_INS, THREAD},
};
use common::cargo;

/// Rows of each table.
const CALLED: usize = 20;
const MODULES: usize = 20;
const FUNCTIONS: usize = 40;
const LINES: usize = 30;
/// Least share of a task's cycles for a row, percent: its own, or with all that is inlined in it.
const LEAST_OWN: f64 = 0.2;
const LEAST_ALL: f64 = 2.0;
/// A task with less than one part in this of all cycles is not broken down.
const NEGLIGIBLE: u64 = 200;

/// The cost of one function or line.
#[derive(Default, Clone, Copy)]
struct Share {
    /// Executions of its most executed instruction: about how often it ran.
    runs: u64,
    /// Its own instructions.
    own_instructions: u64,
    /// Its own cycles.
    own_cycles: u64,
    /// With everything inlined into it; called functions are not in it.
    all_cycles: u64,
}

impl Share {
    fn add(&mut self, runs: u64, cycles: u64) {
        self.own_instructions += runs;
        self.own_cycles += cycles;
        self.runs = self.runs.max(runs);
    }
}

/// Prints what was spent where: by tasks that are handlers, or by the program where there is none.
pub(super) fn print(report: &Report, elf: &Path) -> Result<()> {
    let program = Loader::new(elf).map_err(|error| anyhow!("{error}"))?;
    println!();
    calls(report);
    for (task, owner) in report.tasks.iter().enumerate() {
        let is_whole = report.tasks.len() == 1;
        let name = owner.name.as_str();
        let is_idle = (name == THREAD || STAND_INS.contains(&name)) && !is_whole;
        if is_idle || owner.cycles * NEGLIGIBLE < report.cycles {
            continue;
        }
        println!(
            "\n{} {}",
            "where the cycles go in".bold(),
            owner.name.bold()
        );
        spent(report, &program, task);
    }
    files(report, &program);
    Ok(())
}

/// Prints the files of `src/` that instructions which ran come from, with what was inlined.
fn files(report: &Report, program: &Loader) {
    let mut files = BTreeSet::new();
    for &(_, address, _, _) in &report.sites {
        let Ok(mut found) = program.find_frames(address) else {
            continue;
        };
        while let Ok(Some(frame)) = found.next() {
            let file = frame.location.and_then(|at| at.file).map(shorten);
            files.extend(
                file.filter(|file| file.starts_with("src/"))
                    .map(str::to_owned),
            );
        }
    }
    println!("\n{} {}", "files that ran:".bold(), files.len());
    for file in files {
        println!("  {file}");
    }
}

/// The cost of the functions whose paths begin with one of `prefixes`, with all code inlined into
/// them.
pub(super) fn cost_of(report: &Report, elf: &Path, prefixes: &[&str]) -> Result<Cost> {
    let mut cost = Cost::default();
    for (runs, cycles) in sites_of(report, elf, prefixes)? {
        cost.cycles += cycles as f64;
        cost.instructions += runs as f64;
    }
    Ok(cost)
}

/// How often the instruction of those functions was executed that was executed most.
pub(super) fn rounds_of(report: &Report, elf: &Path, prefixes: &[&str]) -> Result<u64> {
    let sites = sites_of(report, elf, prefixes)?;
    Ok(sites.iter().map(|&(runs, _)| runs).max().unwrap_or(0))
}

/// Executions and cycles of each instruction of the functions whose paths begin like that.
fn sites_of(report: &Report, elf: &Path, prefixes: &[&str]) -> Result<Vec<(u64, u64)>> {
    let program = Loader::new(elf).map_err(|error| anyhow!("{error}"))?;
    let mut sites = Vec::new();
    for &(_, address, runs, cycles) in &report.sites {
        let (stack, _) = frames(&program, address);
        let is_one = |name: &String| prefixes.iter().any(|prefix| name.starts_with(prefix));
        if stack.iter().any(is_one) {
            sites.push((runs, cycles));
        }
    }
    Ok(sites)
}

/// Prints what one task spent where.
fn spent(report: &Report, program: &Loader, task: usize) {
    let mut modules: HashMap<String, Share> = HashMap::new();
    let mut functions: HashMap<String, Share> = HashMap::new();
    let mut lines: HashMap<String, Share> = HashMap::new();
    let mut total = 0;
    for &(owner, address, runs, cycles) in &report.sites {
        if owner != task {
            continue;
        }
        total += cycles;
        let (stack, line) = frames(program, address);
        modules.entry(module(&stack)).or_default().add(runs, cycles);
        lines.entry(line).or_default().add(runs, cycles);
        let mut seen = BTreeSet::new();
        for (depth, name) in stack.into_iter().enumerate() {
            let share = functions.entry(name.clone()).or_default();
            if depth == 0 {
                share.add(runs, cycles);
            }
            if seen.insert(name) {
                share.all_cycles += cycles;
            }
        }
    }
    table("module", modules, total, MODULES);
    println!();
    table("function", functions, total, FUNCTIONS);
    println!();
    table("line", lines, total, LINES);
}

/// The module of ours that the innermost of its functions belongs to, or else the crate.
fn module(stack: &[String]) -> String {
    let ours = stack.iter().find_map(|name| {
        let (_, path) = name.split_once("leadscrew::")?;
        let mut parts: Vec<&str> = path.split("::").collect();
        parts.pop();
        let is_module = |part: &&&str| part.starts_with(|letter: char| letter.is_lowercase());
        Some(
            parts
                .iter()
                .take_while(is_module)
                .copied()
                .collect::<Vec<_>>()
                .join("::"),
        )
    });
    ours.unwrap_or_else(|| {
        let outermost = stack.last().map_or("?", String::as_str);
        let name = outermost.trim_start_matches('<');
        name.split("::").next().unwrap_or(name).to_owned()
    })
}

/// Prints what calls of the linker's functions cost, with what they call in turn.
fn calls(report: &Report) {
    let mut called: Vec<_> = report.functions.iter().filter(|f| f.calls != 0).collect();
    called.sort_by_key(|function| Reverse(function.calls_cycles));
    let head = format!(
        "{:>12}{:>14}{:>12}{:>12}  called function",
        "calls", "cycles", "cyc./call", "ins./call"
    );
    println!("{}", head.bold());
    for function in called.into_iter().take(CALLED) {
        let per_call = |amount: u64| amount as f64 / function.calls as f64;
        let name = addr2line::demangle_auto(function.name.as_str().into(), None);
        println!(
            "{:>12}{:>14}{:>12.1}{:>12.1}  {}",
            function.calls,
            function.calls_cycles,
            per_call(function.calls_cycles),
            per_call(function.calls_instructions),
            without_hash(&name),
        );
    }
}

/// The functions at `address`, innermost first, and the source line.
fn frames(program: &Loader, address: u64) -> (Vec<String>, String) {
    let mut stack = Vec::new();
    let mut line = String::from("?");
    if let Ok(mut found) = program.find_frames(address) {
        while let Ok(Some(frame)) = found.next() {
            if let (true, Some(at)) = (stack.is_empty(), frame.location) {
                line = format!(
                    "{}:{}",
                    shorten(at.file.unwrap_or("?")),
                    at.line.unwrap_or(0)
                );
            }
            let name = frame.function.map_or_else(
                || "?".to_owned(),
                |function| match function.demangle() {
                    Ok(name) => name.into_owned(),
                    Err(_) => "?".to_owned(),
                },
            );
            stack.push(without_hash(&name).to_owned());
        }
    }
    if stack.is_empty() {
        let name = program.find_symbol(address).unwrap_or("?");
        stack.push(without_hash(&addr2line::demangle_auto(name.into(), None)).to_owned());
    }
    (stack, line)
}

/// `name::h0123456789abcdef` without the hash.
fn without_hash(name: &str) -> &str {
    match name.rsplit_once("::h") {
        Some((name, hash)) if hash.len() == 16 => name,
        _ => name,
    }
}

/// A path from the project, or from the registry.
fn shorten(file: &str) -> &str {
    let root = cargo::root().to_string_lossy();
    let inside = file.strip_prefix(&*root).map(|rest| &rest[1..]);
    let registry = || Some(file.split_once("/registry/src/")?.1.split_once('/')?.1);
    let library = || Some(file.split_once("/library/")?.1);
    inside.or_else(registry).or_else(library).unwrap_or(file)
}

/// The costliest by own cycles, with the costliest containers, in the order of their own cycles.
fn table(what: &str, shares: HashMap<String, Share>, total: u64, rows: usize) {
    let percent = |cycles: u64| cycles as f64 * 100.0 / total.max(1) as f64;
    let mut sorted: Vec<_> = shares.into_iter().collect();
    sorted.retain(|(_, share)| {
        percent(share.own_cycles) >= LEAST_OWN || percent(share.all_cycles) >= LEAST_ALL
    });
    sorted.sort_by(|(a_name, a), (b_name, b)| {
        let key = |share: &Share| (Reverse(share.own_cycles), Reverse(share.all_cycles));
        (key(a), a_name).cmp(&(key(b), b_name))
    });
    let head = format!(
        "{:>7}{:>12}{:>14}{:>14}{:>12}  {what}",
        "own", "inlined in", "cycles", "instructions", "runs"
    );
    println!("{}", head.bold());
    for (name, share) in sorted.iter().take(rows) {
        let all = match share.all_cycles {
            0 => String::new(),
            cycles => format!("{:.1} %", percent(cycles)),
        };
        println!(
            "{:>5.1} %{all:>12}{:>14}{:>14}{:>12}  {name}",
            percent(share.own_cycles),
            share.own_cycles,
            share.own_instructions,
            share.runs,
        );
    }
}

#[cfg(test)]
mod tests {
    use super::*;

    #[test]
    fn a_function_belongs_to_the_innermost_module_of_ours() {
        let stack = |names: &[&str]| {
            names
                .iter()
                .map(|&name| name.to_owned())
                .collect::<Vec<_>>()
        };
        let inlined = [
            "core::cmp::Ord::min",
            "leadscrew::stepper::generator::Generator::step",
            "leadscrew::motion::prepare::Motion::run",
        ];
        assert_eq!(module(&stack(&inlined)), "stepper::generator");
        assert_eq!(module(&stack(&["leadscrew::math::sqrt"])), "math");
        let derived = "<leadscrew::machine::snapshot::Snapshot as core::cmp::PartialEq>::eq";
        assert_eq!(module(&stack(&[derived])), "machine::snapshot");
        assert_eq!(
            module(&stack(&["compiler_builtins::mem::memcpy"])),
            "compiler_builtins"
        );
    }
}
