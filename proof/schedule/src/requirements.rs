//! The requirements of `schedule.toml`, and whether a report meets them.

use crate::{Config, Flaw, Place, Report, Requirement, Rule, link};

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

fn new(what: &str, unit: &str, required: f64, found: f64, is_met: bool) -> Requirement {
    Requirement {
        what: what.to_owned(),
        unit: unit.to_owned(),
        required,
        found,
        is_met,
    }
}

fn rate(report: &Report, (required, baud): (u32, u32)) -> Requirement {
    let rates = &report.proven_step_rate_hz;
    let found = rates.get(&baud.to_string()).copied().unwrap_or(0);
    let what = format!("step rate {}", link("at", baud, |it| it.to_string()));
    new(
        &what,
        "Hz",
        required.into(),
        found.into(),
        found >= required,
    )
}

/// How long tasks without deadlines may wait, if that is limited.
fn wait(config: &Config, report: &Report, point: (u32, u32)) -> Option<Requirement> {
    let (step_rate_hz, baud) = point;
    let most = *config.require.undeadlined_wait_us.get(&baud.to_string())?;
    let mut waits = report.undeadlined_waits.iter();
    let wait = waits.find(|it| (it.step_rate_hz, it.baud) == point);
    let found = wait.map_or(f64::INFINITY, |it| it.us(report.clock_hz));
    let link = link("and", baud, |it| it.to_string());
    let what = format!("wait without a deadline at {step_rate_hz} Hz {link}");
    Some(new(&what, "µs", most, found.round(), found <= most))
}

/// How long tasks with deadlines may keep `idle` from feeding the watchdog, at any of the rates.
fn watchdog(config: &Config, report: &Report) -> Option<Requirement> {
    let most = config.program.watchdog_us?;
    let waits = report.undeadlined_waits.iter();
    let found = waits.fold(0.0, |most, it| f64::max(most, it.us(report.clock_hz)));
    let what = "wait of the watchdog for tasks with deadlines";
    let is_met = found > 0.0 && found < most;
    Some(new(what, "µs", most, found.round(), is_met))
}

/// The requirements on the step task: edges, time and lines of the cache.
fn step_task(config: &Config, report: &Report) -> [Requirement; 3] {
    let require = &config.require;
    let mut tasks = report.tasks.iter();
    let step = tasks.find(|task| task.name == config.table.step_task);
    let lines = step.map_or(0, |task| task.icache_lines);
    let cycles = (require.step_wcet_cycles, report.step_wcet_cycles);
    let limits = [
        (
            "jitter of a step edge",
            "µs",
            require.jitter_us,
            report.step_edge_jitter_us,
        ),
        (
            "step interrupt with a warm cache",
            "cycles",
            cycles.0 as f64,
            cycles.1 as f64,
        ),
        (
            "instruction cache lines of the step interrupt",
            "lines",
            config.limits.icache_lines as f64,
            lines as f64,
        ),
    ];
    // A figure of 0 is none.
    limits
        .map(|(what, unit, most, found)| new(what, unit, most, found, found > 0.0 && found <= most))
}

fn unmet(it: &Requirement) -> Flaw {
    let what = format!(
        "{}: {} {} required, {} found",
        it.what, it.required, it.unit, it.found
    );
    let remedy = "See which task has the least slack, and its worst path.";
    Flaw::new(Rule::Requirement, what, Place::default(), remedy)
}
