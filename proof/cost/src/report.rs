//! The profile as JSON.

use serde_json::{Value, json};

use crate::{
    profile::{Amount, Profile, Task},
    table::MODEL,
};

/// Returns everything that the profile holds.
pub(crate) fn report(profile: &Profile) -> Value {
    let tasks = profile.tasks.iter();
    let tasks: Vec<_> = tasks.map(|task| describe(profile, task)).collect();
    json!({
        "model": MODEL,
        "instructions": profile.total.instructions,
        "cycles": profile.total.cycles,
        "unexplained": profile.unexplained,
        "first_unexplained": profile.first_unexplained,
        "unknown": unknown(profile),
        "tasks": tasks,
        "functions": functions(profile),
        "sites": sites(profile),
    })
}

/// Executed instructions that the decoder does not know.
fn unknown(profile: &Profile) -> Vec<String> {
    let sites = profile.sites.iter();
    sites
        .filter(|site| site.decoded.is_none() && !site.by_task.is_empty())
        .map(|site| {
            let [first, second] = site.code;
            format!("{:08x}: {first:04x} {second:04x}", site.address)
        })
        .collect()
}

fn describe(profile: &Profile, task: &Task) -> Value {
    let name = match profile.program.function_at(task.handler) {
        Some(function) if task.handler != 0 => profile.program.functions[function].name.as_str(),
        _ => "thread",
    };
    let min = task.min.unwrap_or_default();
    json!({
        "name": name,
        "activations": task.activations,
        "instructions": task.total.instructions,
        "cycles": task.total.cycles,
        "span_cycles": task.span_cycles,
        "min_instructions": min.instructions,
        "min_cycles": min.cycles,
        "max_instructions": task.max.instructions,
        "max_cycles": task.max.cycles,
        "max_span_cycles": task.max_span_cycles,
        "peripheral_reads": task.peripheral_reads,
        "peripheral_writes": task.peripheral_writes,
        "histogram": task.histogram.iter().collect::<Vec<_>>(),
    })
}

/// Every function that was executed: its own cost, and that of its calls.
fn functions(profile: &Profile) -> Vec<Value> {
    let mut own = vec![Amount::default(); profile.program.functions.len()];
    for site in &profile.sites {
        if let Some(function) = site.function {
            site.by_task
                .iter()
                .for_each(|amount| own[function].add(*amount));
        }
    }
    let executed = profile
        .program
        .functions
        .iter()
        .zip(own)
        .zip(&profile.calls);
    executed
        .filter(|((_, own), _)| own.instructions != 0)
        .map(|((function, own), calls)| {
            json!({
                "name": function.name,
                "instructions": own.instructions,
                "cycles": own.cycles,
                "calls": calls.count,
                "calls_instructions": calls.total.instructions,
                "calls_cycles": calls.total.cycles,
            })
        })
        .collect()
}

/// Task, address, executions and cycles of every instruction, by address.
fn sites(profile: &Profile) -> Vec<(usize, u32, u64, u64)> {
    let mut rows: Vec<_> = profile
        .sites
        .iter()
        .flat_map(|site| {
            let by_task = site.by_task.iter().enumerate();
            by_task.map(|(task, spent)| (task, site.address, spent.instructions, spent.cycles))
        })
        .filter(|(_, _, instructions, _)| *instructions != 0)
        .collect();
    rows.sort_unstable_by_key(|&(task, address, ..)| (address, task));
    rows
}
