//! The certificate of a proof: what a program that shares no code with this one checks against the ELF file.
//!
//! It has the graph of each function that a task with a deadline reaches, the loops with their bounds and where those
//! are from, the dual values of the longest paths in each view of the instruction cache that a response time uses, and
//! the demand of each busy window with what it is made of. `proof/check.py` is the checker, and says what it takes from
//! the certificate without a check.

use std::{
    collections::{BTreeMap, BTreeSet},
    iter,
};

use serde_json::{Map, Value, json};

use crate::{
    Cache, Function, Loop, Point, Report, Stream,
    loops::in_runs,
    persistence::Share,
    response::{self, Blocking, Flash, HOPELESS, Response},
    row_demand::RowDemand,
    rta::{Arrival, Load},
    substitution::Substitution,
    system::{Row, System},
    wcet::Wcets,
};

/// The layout of a certificate; a checker refuses any other.
const FORMAT: u32 = 1;

/// Values of named bounds.
type Numbers = BTreeMap<String, u64>;
/// The rows whose lines stay in the cache: warm and cold ones.
type Resident = (Vec<usize>, Vec<usize>);

/// Returns the certificate of the report's step rate and baud rate.
///
/// # Errors
///
/// Tells which formula is wrong, or which row has no bound.
pub(crate) fn of(
    system: &System<'_>,
    sections: &[Blocking],
    report: &Report,
    named: &Numbers,
) -> Result<Value, String> {
    let point = system.point(report.step_rate_hz, report.baud);
    let windows = response::windows(system, sections, point, (HOPELESS, Flash::Certified))?;
    let mut demands = BTreeMap::new();
    for row in 0..system.rows.len() {
        let demand = RowDemand::new(system, row, named, point)?;
        demands.extend(demand.map(|demand| (row, demand)));
    }
    let views = Views::of(system, &demands, named, &windows)?;
    let all_rows = system.rows.iter();
    let varied: BTreeSet<String> = all_rows
        .flat_map(|row| system.wcets(row, named).varied)
        .collect();
    let functions = system.program.functions_at(&views.reached);
    let functions: Map<String, Value> = functions
        .map(|function| {
            (
                hexadecimal(function.address),
                graph(function, named, &varied),
            )
        })
        .collect();
    let limited = system.limited.iter();
    let limited: Map<String, Value> = limited
        .map(|(address, name)| (hexadecimal(*address), json!(name)))
        .collect();
    let windows = windows.iter().map(|(row, window)| {
        let streams = |loads: &[Load]| loads.iter().map(Stream::from).collect::<Vec<_>>();
        json!({
            "row": row,
            "derivation": window.derivation,
            "own": streams(&window.demand.own),
            "others": streams(&window.demand.others),
            "once": window.demand.once,
            "response": window.response,
        })
    });
    Ok(json!({
        "format": FORMAT,
        "elf_sha256": report.elf_sha256,
        "board": report.board,
        "axes": report.axes,
        "clock_hz": report.clock_hz,
        "step_rate_hz": report.step_rate_hz,
        "baud": report.baud,
        "classes": system.model.classes(),
        "prefetch": system.model.prefetch,
        "numbers": named,
        "limited": limited,
        "functions": functions,
        "rows": rows(system, &demands, point)?,
        "substitution": substitution(system, point)?,
        "views": views.views,
        "windows": windows.collect::<Vec<_>>(),
    }))
}

fn hexadecimal(address: u32) -> String {
    format!("{address:#010x}")
}

/// The graph of a function, with what is known of its accesses and loops.
fn graph(function: &Function, named: &Numbers, varied: &BTreeSet<String>) -> Value {
    let blocks = function.blocks.iter().map(|block| {
        let successors = block.successors.iter();
        let successors: Vec<_> = successors.map(|edge| (edge.to, edge.is_taken)).collect();
        json!([
            block.start(),
            block.end(),
            block.call,
            block.ends,
            block.traps,
            successors
        ])
    });
    let mut loops: Vec<&Loop> = function.loops.iter().collect();
    loops.sort_by_key(|looped| looped.blocks.len());
    let loops = loops.into_iter().map(|looped| {
        let total = looped.total.as_ref();
        let bound = looped.bound.as_ref();
        json!({
            "head": looped.head,
            "blocks": looped.blocks,
            "most": bound.filter(|_| total.is_none()).map(|bound| {
                // What the analysis counts may be less than what a name says.
                match looped.most(named, varied) {
                    Some(most) if bound.count.value(named) != Some(most) => json!(most),
                    _ => json!(bound.count),
                }
            }),
            "total": total.map(|total| &total.bound.count),
            "in_runs": in_runs(function, looped),
            "origin": total.map(|total| &total.bound.origin).or(bound.map(|bound| &bound.origin)),
        })
    });
    json!({
        "name": function.name,
        "blocks": blocks.collect::<Vec<_>>(),
        "regions": function.regions,
        "loops": loops.collect::<Vec<_>>(),
    })
}

impl From<&Load> for Stream {
    fn from(load: &Load) -> Self {
        Self {
            cost: load.cost,
            ..Self::from(&load.arrival)
        }
    }
}

impl From<&Arrival> for Stream {
    fn from(arrival: &Arrival) -> Self {
        Self {
            period: arrival.period,
            group: arrival.group,
            rate: arrival.sustained.map(|(rate, _)| rate),
            burst: arrival.sustained.map_or(0.0, |(_, burst)| burst),
            jitter: arrival.jitter,
            cost: 0,
        }
    }
}

/// All rows, with the times of those that have a deadline.
fn rows(
    system: &System<'_>,
    demands: &BTreeMap<usize, RowDemand>,
    point: Point,
) -> Result<Vec<Value>, String> {
    let row = |(index, row): (usize, &Row)| {
        let Some(demand) = demands.get(&index) else {
            return Ok(json!({"name": row.name, "priority": row.task.priority}));
        };
        let units = demand.units.as_ref().map(
            |units| json!({"most": units.most, "extra": units.extra, "without": units.without}),
        );
        let related = |is: &dyn Fn(usize) -> bool| {
            let rows = demands.keys().copied();
            rows.filter(|other| is(*other)).collect::<Vec<_>>()
        };
        let arrival = system.arrival(row, point)?;
        Ok(json!({
            "name": row.name,
            "priority": row.task.priority,
            "entries": row.entries(),
            "excluded": row.excluded,
            "kind_of": row.kind_of,
            "deadline": arrival.map(|(_, deadline)| deadline),
            "parts": demand.parts.iter().map(|it| Stream::from(&it.arrival)).collect::<Vec<_>>(),
            "units": units,
            "yields_to": related(&|other| system.yields(index, other)),
            "exclusive_with": related(&|other| system.are_exclusive(index, other)),
            "regime": system.regime(index),
        }))
    };
    system.rows.iter().enumerate().map(row).collect()
}

/// The substitution, with rounding counted as more units in a window.
fn substitution(system: &System<'_>, point: Point) -> Result<Option<Value>, String> {
    let found = Substitution::all(system, point)?;
    let more = found.iter().max_by_key(|it| it.units_and_rounding());
    Ok(more.map(|it| {
        let (units, rounding) = it.units_and_rounding();
        let [with_run, with_unit] = it.with();
        let row = system.rows[it.kind()].kind_of;
        json!({
            "row": row, "kind": it.kind(), "units": units, "rounding": rounding,
            "with_run": with_run, "with_unit": with_unit,
        })
    }))
}

/// The longest paths of rows, each in views of the instruction cache.
struct Views<'a> {
    system: &'a System<'a>,
    named: &'a Numbers,
    demands: &'a BTreeMap<usize, RowDemand>,
    /// Functions that they reach.
    reached: BTreeSet<u32>,
    views: Vec<Value>,
}

impl<'a> Views<'a> {
    /// The views that windows use.
    fn of(
        system: &'a System<'a>,
        demands: &'a BTreeMap<usize, RowDemand>,
        named: &'a Numbers,
        windows: &[(usize, Response)],
    ) -> Result<Self, String> {
        // With the lowest priority of the rows whose windows have these lines.
        let mut residents: BTreeMap<&Resident, u8> = BTreeMap::new();
        for (row, window) in windows {
            if let Some(resident) = &window.derivation.resident {
                let lowest = residents.entry(resident).or_insert(u8::MAX);
                *lowest = (*lowest).min(demands[row].priority);
            }
        }
        let mut new = Self {
            system,
            named,
            demands,
            reached: BTreeSet::new(),
            views: Vec::new(),
        };
        for (&row, demand) in demands {
            new.add(row, Cache::Warm, None)?;
            new.add(row, Cache::Uncached, None)?;
            for (resident, lowest) in &residents {
                let is_resident = resident.0.contains(&row) || resident.1.contains(&row);
                if demand.priority >= *lowest && !is_resident {
                    new.add(row, Cache::Shared, Some(resident))?;
                }
            }
        }
        Ok(new)
    }

    /// Adds a row in a view: with all units of its work, and with none, if their number varies.
    fn add(
        &mut self,
        index: usize,
        cache: Cache,
        resident: Option<&Resident>,
    ) -> Result<(), String> {
        let (row, units) = (&self.system.rows[index], &self.demands[&index].units);
        let without = units.as_ref().map(|units| (&units.without, true));
        for (numbers, is_without) in iter::once((self.named, false)).chain(without) {
            let mut wcets = self.system.wcets(row, numbers);
            if let Some((warm, cold)) = resident {
                let lines = |rows: &[usize]| -> BTreeSet<u32> {
                    let lines = rows.iter().flat_map(|row| &self.demands[row].cost.lines);
                    lines.copied().collect()
                };
                wcets.resident_lines = lines(&[&warm[..], cold].concat());
                let (all, miss) = (wcets.resident_lines.len(), self.system.model.miss());
                wcets.share = Share::new(lines(warm).len(), all, miss).unwrap_or_default();
            }
            let reached = row.entries().iter().flat_map(|entry| wcets.reach(*entry));
            let reached: BTreeSet<u32> = reached.collect();
            let functions = reached.iter().map(|address| {
                let longest = longest(&wcets, *address, cache)?;
                Some((hexadecimal(*address), longest))
            });
            let functions: Option<Map<_, _>> = functions.collect();
            let functions = functions.ok_or_else(|| format!("`{}` has no bound", row.name))?;
            self.views.push(json!({
                "row": index,
                "cache": match cache {
                    Cache::Warm => "warm",
                    Cache::Uncached => "uncached",
                    Cache::Cold | Cache::Loops | Cache::Shared => "shared",
                },
                "is_without": is_without,
                "resident": resident,
                "functions": functions,
            }));
            self.reached.extend(reached);
        }
        Ok(())
    }
}

/// The longest path of a function, its dual values, and the lines that each visit of a persistent loop loads.
fn longest(wcets: &Wcets<'_>, address: u32, cache: Cache) -> Option<Value> {
    let function = wcets.functions.get(&address)?;
    let duals = wcets.duals(address, cache)?;
    let is_shared = cache == Cache::Shared;
    let visits = is_shared.then(|| wcets.persistent_loops(function).lines.clone());
    Some(json!({
        "path": wcets.bound(address, cache)?.path,
        "rests": duals.path,
        "iterations": duals.iterations,
        "visits": visits.unwrap_or_default(),
    }))
}
