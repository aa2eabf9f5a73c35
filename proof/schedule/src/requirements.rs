//! The requirements of `schedule.toml`, and whether a report meets them.

use crate::{Config, Flaw, Place, Report, Requirement, Rule};

/// The step rates that are required of an image with so many axes, each with its baud rate.
pub(crate) fn points(config: &Config, axes: u8) -> impl Iterator<Item = (u32, u32)> {
    let rates = config.require.step_rate_hz.iter();
    let rates = rates.filter_map(|(baud, rate)| Some((*rate, baud.parse().ok()?)));
    rates.filter(move |_| axes <= config.require.axes)
}

/// All requirements, those of times only where each row has a bound, and a flaw for each that is not met.
pub(crate) fn of(
    config: &Config,
    report: &Report,
    is_bounded: bool,
) -> (Vec<Requirement>, Vec<Flaw>) {
    let rates = points(config, report.axes).map(|point| rate(report, point));
    let waits = points(config, report.axes).filter_map(|point| wait(config, report, point));
    // Without a bound of each row nothing is proven, and the flaw that says so is another.
    let of_times = rates.chain(waits).chain(watchdog(config, report));
    let of_times = of_times.filter(|_| is_bounded);
    let required: Vec<Requirement> = of_times.chain(step_task(config, report)).collect();
    let missed = required.iter().filter(|it| !it.is_met);
    let flaws = missed.map(unmet).collect();
    (required, flaws)
}

fn rate(report: &Report, (required, baud): (u32, u32)) -> Requirement {
    let rates = &report.proven_step_rate_hz;
    let found = rates.get(&baud.to_string()).copied().unwrap_or(0);
    Requirement {
        what: format!("step rate at {baud} baud"),
        unit: "Hz".to_owned(),
        required: required.into(),
        found: found.into(),
        is_met: found >= required,
    }
}

/// How long tasks without deadlines may wait, if that is limited.
fn wait(config: &Config, report: &Report, point: (u32, u32)) -> Option<Requirement> {
    let (step_rate_hz, baud) = point;
    let most = *config.require.undeadlined_wait_us.get(&baud.to_string())?;
    let mut waits = report.undeadlined_waits.iter();
    let wait = waits.find(|it| (it.step_rate_hz, it.baud) == point);
    let found = wait
        .and_then(|it| it.cycles)
        .map_or(f64::INFINITY, |cycles| {
            cycles as f64 * 1e6 / report.clock_hz as f64
        });
    Some(Requirement {
        what: format!("wait without a deadline at {step_rate_hz} Hz and {baud} baud"),
        unit: "µs".to_owned(),
        required: most,
        found: found.round(),
        is_met: found <= most,
    })
}

/// How long tasks with deadlines may keep `idle` from feeding the watchdog, at any of the rates.
fn watchdog(config: &Config, report: &Report) -> Option<Requirement> {
    let most = config.program.watchdog_us?;
    let waits = report.undeadlined_waits.iter().map(|it| {
        it.cycles.map_or(f64::INFINITY, |cycles| {
            cycles as f64 * 1e6 / report.clock_hz as f64
        })
    });
    let found = waits.fold(0.0, f64::max);
    Some(Requirement {
        what: "wait of the watchdog for tasks with deadlines".to_owned(),
        unit: "µs".to_owned(),
        required: most,
        found: found.round(),
        is_met: found > 0.0 && found < most,
    })
}

/// The requirements on the step task: edges, time and lines of the cache.
fn step_task(config: &Config, report: &Report) -> [Requirement; 3] {
    let require = &config.require;
    let jitter = report.step_edge_jitter_us;
    let (most, cycles) = (require.step_wcet_cycles, report.step_wcet_cycles);
    let mut tasks = report.tasks.iter();
    let step = tasks.find(|task| task.name == config.table.step_task);
    let lines = step.map_or(0, |task| task.icache_lines);
    let limit = config.limits.icache_lines;
    // A figure of 0 is none.
    [
        Requirement {
            what: "jitter of a step edge".to_owned(),
            unit: "µs".to_owned(),
            required: require.jitter_us,
            found: jitter,
            is_met: jitter > 0.0 && jitter <= require.jitter_us,
        },
        Requirement {
            what: "step interrupt with a warm cache".to_owned(),
            unit: "cycles".to_owned(),
            required: most as f64,
            found: cycles as f64,
            is_met: cycles > 0 && cycles <= most,
        },
        Requirement {
            what: "instruction cache lines of the step interrupt".to_owned(),
            unit: "lines".to_owned(),
            required: limit as f64,
            found: lines as f64,
            is_met: lines > 0 && lines <= limit,
        },
    ]
}

fn unmet(it: &Requirement) -> Flaw {
    Flaw::new(
        Rule::Requirement,
        format!(
            "{}: {} {} required, {} found",
            it.what, it.required, it.unit, it.found
        ),
        Place::default(),
        "See which task has the least slack, and its worst path.",
    )
}
