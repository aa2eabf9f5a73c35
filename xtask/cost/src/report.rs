//! The profile as JSON.

use std::fmt::{self, Write};

use crate::{
    profile::{Amount, Profile, Task},
    table::MODEL,
};

/// Writes everything that the profile hold.
pub(crate) fn write(profile: &Profile) -> Result<String, fmt::Error> {
    let mut out = String::new();
    let Amount {
        instructions,
        cycles,
    } = profile.total;
    writeln!(out, "{{\"model\": {},", quote(MODEL))?;
    writeln!(
        out,
        "\"instructions\": {instructions}, \"cycles\": {cycles},"
    )?;
    writeln!(out, "\"unexplained\": {},", profile.unexplained)?;
    if let Some((from, to)) = profile.first_unexplained {
        writeln!(out, "\"first_unexplained\": [{from}, {to}],")?;
    }
    writeln!(out, "\"unknown\": [{}],", list(unknown(profile)))?;
    writeln!(
        out,
        "\"tasks\": [\n{}\n],",
        lines(profile.tasks.iter().map(|task| describe(profile, task)))
    )?;
    writeln!(out, "\"functions\": [\n{}\n],", lines(functions(profile)))?;
    writeln!(out, "\"sites\": [\n{}\n]}}", lines(sites(profile)))?;
    Ok(out)
}

/// Executed instructions that the decoder does not know.
fn unknown(profile: &Profile) -> impl Iterator<Item = String> {
    profile
        .sites
        .iter()
        .filter(|site| site.decoded.is_none() && !site.by_task.is_empty())
        .map(|site| {
            let [first, second] = site.code;
            quote(&format!("{:08x}: {first:04x} {second:04x}", site.address))
        })
}

fn describe(profile: &Profile, task: &Task) -> String {
    let functions = &profile.program.functions;
    let name = match profile.program.function_at(task.handler) {
        Some(function) if task.handler != 0 => functions[function].name.as_str(),
        _ => "thread",
    };
    let min = task.min.unwrap_or_default();
    let histogram = task
        .histogram
        .iter()
        .map(|(cycles, count)| format!("[{cycles}, {count}]"));
    format!(
        "{{\"name\": {}, \"activations\": {}, \"instructions\": {}, \"cycles\": {}, \
         \"span_cycles\": {}, \"min_instructions\": {}, \"min_cycles\": {}, \
         \"max_instructions\": {}, \"max_cycles\": {}, \"max_span_cycles\": {}, \
         \"peripheral_reads\": {}, \"peripheral_writes\": {}, \"histogram\": [{}]}}",
        quote(name),
        task.activations,
        task.total.instructions,
        task.total.cycles,
        task.span_cycles,
        min.instructions,
        min.cycles,
        task.max.instructions,
        task.max.cycles,
        task.max_span_cycles,
        task.peripheral_reads,
        task.peripheral_writes,
        list(histogram),
    )
}

/// Every function that was executed: its own cost, and that of its calls.
fn functions(profile: &Profile) -> impl Iterator<Item = String> {
    let mut own = vec![Amount::default(); profile.program.functions.len()];
    for site in &profile.sites {
        if let Some(function) = site.function {
            for amount in &site.by_task {
                own[function].instructions += amount.instructions;
                own[function].cycles += amount.cycles;
            }
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
            format!(
                "{{\"name\": {}, \"instructions\": {}, \"cycles\": {}, \"calls\": {}, \
                 \"calls_instructions\": {}, \"calls_cycles\": {}}}",
                quote(&function.name),
                own.instructions,
                own.cycles,
                calls.count,
                calls.total.instructions,
                calls.total.cycles,
            )
        })
}

/// Task, address, executions and cycles of every instruction, by address.
fn sites(profile: &Profile) -> impl Iterator<Item = String> {
    let mut rows: Vec<(u32, usize, Amount)> = profile
        .sites
        .iter()
        .flat_map(|site| {
            let by_task = site.by_task.iter().enumerate();
            by_task.map(|(task, &amount)| (site.address, task, amount))
        })
        .filter(|(_, _, amount)| amount.instructions != 0)
        .collect();
    rows.sort_unstable_by_key(|&(address, task, _)| (address, task));
    rows.into_iter().map(|(address, task, amount)| {
        let Amount {
            instructions,
            cycles,
        } = amount;
        format!("[{task}, {address}, {instructions}, {cycles}]")
    })
}

fn list(items: impl Iterator<Item = String>) -> String {
    items.collect::<Vec<_>>().join(", ")
}

fn lines(items: impl Iterator<Item = String>) -> String {
    items.collect::<Vec<_>>().join(",\n")
}

/// A JSON string.
fn quote(text: &str) -> String {
    let mut out = String::from('"');
    for letter in text.chars() {
        match letter {
            '"' | '\\' => out.extend(['\\', letter]),
            ' '.. => out.push(letter),
            _ => out.push('?'),
        }
    }
    out.push('"');
    out
}
