//! The analysis from the ELF file to the report.

use std::{
    collections::{BTreeMap, BTreeSet},
    fmt::Write as _,
    fs,
    path::Path,
};

use crate::{
    Annotations, App, Cache, Clock, Config, Curve, Flaw, Image, Model, Place, Program, Report,
    Rule, Stream, Task, UndeadlinedWait, Window, believed,
    calibration::Measured,
    certificate, code_in_ram,
    crosscheck::Crosscheck,
    errata, figures, findings, guarded_stores,
    model::OUTSTANDING_TRANSFER,
    modes, pin_edge_jitter, races,
    registers::Registers,
    releases::Releases,
    requirements,
    response::{self, Blocking, Flash, Response},
    rta::Demand,
    sections::{self, Held},
    startup,
    system::{Row, System, misconfigured},
    tasks_without_deadline, unanalysed_code, worst_path,
};

/// Steps of the proven step rate, Hz.
const RATE_STEP: u32 = 100;
/// No proof is tried above this, Hz.
const HIGHEST_RATE: u32 = 600_000;
/// Points of the curve.
const CURVE_POINTS: u32 = 24;

/// The input of an analysis.
#[derive(Debug, Clone)]
pub struct Input<'a> {
    /// The program.
    pub elf: &'a Path,
    /// The project: where `schedule.toml` and `src` are.
    pub root: &'a Path,
    /// Name of the board.
    pub board: &'a str,
    /// The features that the program has for it.
    pub features: &'a [String],
    /// Its clocks.
    pub clock: Clock,
    /// Axes that the program is built for.
    pub axes: u8,
    /// Step rate of the table; without it, that of `schedule.toml`.
    pub step_rate_hz: Option<u32>,
    /// Baud rate of the table; without it, that of `schedule.toml`.
    pub baud: Option<u32>,
    /// The measurements of a board.
    pub measured: Option<Measured>,
}

/// Analyses a program.
///
/// # Errors
///
/// Only when a file cannot be read or understood; all else is a flaw of the report.
pub fn analyse(input: &Input<'_>) -> Result<Report, String> {
    Ok(run(input, false)?.0)
}

/// Analyses a program, and makes the certificate of the proof, as JSON, if every deadline is met.
///
/// # Errors
///
/// As [`analyse`].
pub fn certify(input: &Input<'_>) -> Result<(Report, Option<String>), String> {
    run(input, true)
}

fn run(input: &Input<'_>, certifies: bool) -> Result<(Report, Option<String>), String> {
    let sources = Sources::read(input)?;
    let (app, config) = (&sources.app, &sources.config);
    let program = Program::new(&sources.image, &sources.annotations);
    let mut model = Model::new(&input.clock);
    let (figures, mut flaws) = figures::of(&sources.text, config, input.root);
    if let Some(measured) = &input.measured {
        for class in model.calibrate(&measured.cycles) {
            let what = format!("{}: there is no class `{class}`", measured.file);
            flaws.push(misconfigured(what, "Run `cargo xtask calibrate` again."));
        }
    }
    let system = System::new(
        &program,
        app,
        config,
        (input.clock, model),
        input.axes,
        &mut flaws,
    );
    let elf = fs::read(input.elf).map_err(|error| format!("{}: {error}", input.elf.display()))?;
    let mut report = Report {
        board: input.board.to_owned(),
        elf_sha256: hexadecimal(&hmac_sha256::Hash::hash(&elf)),
        calibrated: input.measured.is_some(),
        calibration: input
            .measured
            .as_ref()
            .map(|measured| measured.file.clone()),
        axes: input.axes,
        clock_hz: input.clock.hclk_hz,
        timer_hz: input.clock.timer_hz,
        step_rate_hz: input.step_rate_hz.unwrap_or(config.table.step_rate_hz),
        baud: input.baud.unwrap_or(config.program.baud),
        assumptions: config.table.assumptions.clone(),
        constants: config.program.constants.clone(),
        figures,
        flaws,
        ..Report::default()
    };
    let analysis = Analysis::new(&system, &mut report)?;
    analysis.report(&mut report)?;
    report.flaws.sort();
    report.flaws.dedup();
    let is_certified = certifies && report.flaws.iter().all(|flaw| flaw.rule.is_wish());
    let certificate = is_certified
        .then(|| certificate::of(&system, &analysis.blocking, &report, &analysis.named));
    let certificate = certificate.transpose()?.map(|it| format!("{it}\n"));
    Ok((report, certificate))
}

/// The files that an analysis reads.
pub(crate) struct Sources {
    /// The text of `config`.
    pub(crate) text: String,
    pub(crate) config: Config,
    pub(crate) app: App,
    pub(crate) image: Image,
    pub(crate) annotations: Annotations,
}

impl Sources {
    /// Reads them.
    ///
    /// # Errors
    ///
    /// When a file cannot be read or understood.
    pub(crate) fn read(input: &Input<'_>) -> Result<Self, String> {
        let read = |name: &str| {
            let path = input.root.join(name);
            fs::read_to_string(&path).map_err(|error| format!("{}: {error}", path.display()))
        };
        let text = read("schedule.toml")?;
        let image = Image::load(input.elf)?;
        let app = App::parse(&read("src/app.rs")?, input.features)
            .map_err(|error| format!("src/app.rs: {error}"))?;
        Ok(Self {
            config: Config::parse(&text)?
                .of_features(input.features)
                .without_tasks(&app.others)
                .of_program(&image, &input.clock)?,
            text,
            app,
            image,
            annotations: Annotations::read(input.root)?,
        })
    }
}

fn hexadecimal(bytes: &[u8]) -> String {
    bytes.iter().fold(String::new(), |mut text, byte| {
        // Writing to a string never fails.
        let _ = write!(text, "{byte:02x}");
        text
    })
}

/// Checks what the code does beside taking time: vectors, registers, releases, memory, initialisation.
fn check_code(system: &System<'_>, sections: &[Held], report: &mut Report) {
    let (program, config) = (system.program, system.config);
    let flaws = &mut report.flaws;
    flaws.extend(Crosscheck { system, sections }.flaws());
    flaws.extend(Registers { system }.flaws());
    let (graph, wrong) = Releases { system }.flaws();
    report.releases = graph;
    flaws.extend(wrong);
    flaws.extend(unanalysed_code::flaws(program, config));
    flaws.extend(modes::flaws(system));
    flaws.extend(code_in_ram::flaws(program, config));
    flaws.extend(errata::flaws(program, system.app, config));
    flaws.extend(guarded_stores::flaws(program, config));
    flaws.extend(races::flaws(program, system.app, config, sections));
    flaws.extend(startup::flaws(program, config));
}

/// What does not change with the step rate, and the numbers of the table's point.
struct Analysis<'a> {
    system: &'a System<'a>,
    blocking: Vec<Blocking>,
    named: BTreeMap<String, u64>,
    /// Whether every row with a deadline has a bound.
    is_bounded: bool,
}

impl<'a> Analysis<'a> {
    /// Looks at the code: sections, contradictions, flaws.
    fn new(system: &'a System<'a>, report: &mut Report) -> Result<Self, String> {
        let point = system.point(report.step_rate_hz, report.baud);
        let named = system.config.numbers(&system.clock, point)?;
        let any = crate::wcet::Wcets::new(
            system.program.functions(),
            &system.model,
            &named,
            BTreeSet::new(),
        );
        let held = sections::find(&any);
        let contexts = findings::contexts(system);
        let (found, flaws) = findings::of_sections(system, &held, &contexts);
        report.sections = found;
        report.flaws.extend(flaws);
        report.flaws.extend(findings::lowered_masks(system));
        check_code(system, &held, report);
        tasks_without_deadline::report_loops(system, &named, report);
        let mut is_bounded = true;
        for (index, row) in system.rows.iter().enumerate() {
            if row.times.is_some() {
                let flaws = findings::of_row(system, row, &named);
                let has_bound = system.cost(index, &named).is_some();
                if !has_bound && flaws.is_empty() {
                    let what = format!("`{}` has no bound", row.name);
                    report
                        .flaws
                        .push(misconfigured(what, "See that it ends in this mode."));
                }
                is_bounded &= has_bound;
                report.flaws.extend(flaws);
            } else {
                report.flaws.extend(holds_up(system, row));
            }
        }
        Ok(Self {
            system,
            blocking: response::blocking(system, &held, &contexts),
            named,
            is_bounded,
        })
    }

    fn report(&self, report: &mut Report) -> Result<(), String> {
        let point = self.system.point(report.step_rate_hz, report.baud);
        let responses = if self.is_bounded {
            response::all(self.system, &self.blocking, point)?
        } else {
            vec![None; self.system.rows.len()]
        };
        let rows = self.system.rows.iter().enumerate();
        let tasks = rows.map(|(index, row)| self.task(index, row, responses[index].as_ref()));
        report.tasks = tasks.collect();
        self.loops(report);
        report.utilisation = response::utilisation(self.system, &responses);
        let prices = responses
            .iter()
            .flatten()
            .filter_map(|it| it.substitution_cost);
        let costs = prices.reduce(f64::max);
        report.substitution = response::substituted_runs(self.system, point, costs.unwrap_or(0.0))?;
        if report.utilisation > 1.0 {
            report.flaws.push(overload(report.utilisation));
        }
        for (row, response) in self.system.rows.iter().zip(&responses) {
            report
                .flaws
                .extend(response.as_ref().and_then(|it| self.missed(row, it)));
        }
        let flaws = findings::of_stacks(self.system, report);
        report.flaws.extend(flaws);
        self.edges(report);
        if self.is_bounded {
            let mut bauds = BTreeSet::from([report.baud]);
            if report.baud > 0 {
                bauds.extend([115_200, 250_000, 500_000, 1_000_000]);
            }
            let required = self.system.config.require.step_rate_hz.keys();
            bauds.extend(required.filter_map(|baud| baud.parse::<u32>().ok()));
            for baud in bauds {
                let rate = self.proven(baud, Flash::Cached)?;
                report.proven_step_rate_hz.insert(baud.to_string(), rate);
                let rate = self.proven(baud, Flash::Uncached)?;
                report.uncached_step_rate_hz.insert(baud.to_string(), rate);
            }
            report.undeadlined_waits = self.waits(report)?;
            self.curve(report)?;
        }
        let (required, flaws) = requirements::of(self.system.config, report, self.is_bounded);
        report.requirements = required;
        report.flaws.extend(flaws);
        Ok(())
    }

    /// How far the bounds of the loops of each row are known.
    fn loops(&self, report: &mut Report) {
        report
            .flaws
            .extend(believed::flaws(self.system, &self.named));
        let program = self.system.program;
        report.believed = believed::comments(program.functions().values(), &self.named);
        for (row, task) in self.system.rows.iter().zip(&mut report.tasks) {
            let functions = self.system.wcets(row, &self.named).reached(row.root);
            task.loops = believed::count(functions, &self.named);
        }
    }

    fn task(&self, index: usize, row: &Row, response: Option<&Response>) -> Task {
        let cost = row
            .times
            .as_ref()
            .and_then(|_| self.system.cost(index, &self.named));
        let cache = match response {
            Some(response) if response.via == "uncached" => Cache::Uncached,
            _ => Cache::Warm,
        };
        let mut task = Task {
            name: row.name.clone(),
            vector: row.task.vector.clone(),
            priority: row.task.priority,
            wcet: cost.as_ref().map(|cost| cost.wcet),
            icache_lines: cost.as_ref().map_or(0, |cost| cost.lines.len()),
            uses_float: self.system.uses_float(row),
            exclusive_with: System::exclusive_with(row),
            kind_of: row.kind_of.map(|of| self.system.rows[of].name.clone()),
            regime: self.system.regime(index).map(str::to_owned),
            worst_path: worst_path::of(self.system, row, &self.named, cache),
            ..Task::default()
        };
        if let (Some(times), Some(it)) = (&row.times, response) {
            let sustained = it.arrival.sustained;
            task.period_cycles = Some(sustained.map_or(it.arrival.period, |(rate, _)| 1.0 / rate));
            task.period_source = times.period.to_string();
            task.spacing_cycles = sustained.map(|_| it.arrival.period);
            task.burst = sustained.map_or(0.0, |(_, burst)| burst);
            task.wcet_cycles = Some(it.cycles);
            it.via.clone_into(&mut task.via);
            task.share = it.share;
            task.blocking_cycles = it.blocking;
            task.blocking_source.clone_from(&it.blocking_source);
            task.response_cycles = it.response;
            task.window = it.response.map(|_| window(&it.demand));
            task.deadline_cycles = Some(it.deadline);
            task.slack_us = it
                .response
                .map(|response| self.us(it.deadline - response as f64));
        }
        task
    }

    /// How long tasks without deadlines wait: at the rate of the table, at all required rates and
    /// at all proven rates.
    fn waits(&self, report: &Report) -> Result<Vec<UndeadlinedWait>, String> {
        let required = requirements::points(self.system.config, report.axes);
        let proven = report.proven_step_rate_hz.iter();
        let proven = proven.filter(|(_, rate)| **rate > 0);
        let proven = proven.filter_map(|(baud, rate)| Some((*rate, baud.parse().ok()?)));
        let points: BTreeSet<(u32, u32)> = [(report.step_rate_hz, report.baud)]
            .into_iter()
            .chain(required)
            .chain(proven)
            .collect();
        let second = self.system.clock.hclk_hz;
        let waits = points.into_iter().map(|(step_rate_hz, baud)| {
            let point = self.system.point(step_rate_hz, baud);
            let cycles = response::undeadlined_wait(self.system, &self.blocking, point, second)?;
            Ok(UndeadlinedWait {
                step_rate_hz,
                baud,
                cycles,
            })
        });
        waits.collect()
    }

    fn us(&self, cycles: f64) -> f64 {
        cycles * 1e6 / self.system.clock.hclk_hz as f64
    }

    fn missed(&self, row: &Row, it: &Response) -> Option<Flaw> {
        if it.is_met() {
            return None;
        }
        let response = it.response.map_or("no bound".to_owned(), |response| {
            format!("{:.1} µs", self.us(response as f64))
        });
        let what = format!(
            "`{}` may miss its deadline: response time {response}, deadline {:.1} µs",
            row.name,
            self.us(it.deadline),
        );
        let remedy = "Shorten the task or those that hold it up: see the worst path.";
        Some(Flaw::new(
            Rule::DeadlineMissed,
            what,
            row.task.place(),
            remedy,
        ))
    }

    /// Cost of the step task, and how far the edges of its pins may move.
    fn edges(&self, report: &mut Report) {
        let name = &self.system.config.table.step_task;
        let mut rows = self.system.rows.iter().enumerate();
        let Some((index, row)) = rows.find(|(_, row)| row.task.name == *name) else {
            let what = format!("there is no task `{name}`");
            let remedy = "Name the task that drives the step pins.";
            report.flaws.push(misconfigured(what, remedy));
            return;
        };
        if let Some(cost) = self.system.cost(index, &self.named) {
            report.step_wcet_cycles = cost.wcet.warm;
        }
        let wcets = self.system.wcets(row, &self.named);
        let holding = self
            .blocking
            .iter()
            .filter(|it| it.holds(row.task.priority));
        let blocking = holding.map(|it| it.cycles).max().unwrap_or(0) + OUTSTANDING_TRANSFER;
        let latencies = pin_edge_jitter::latencies(&wcets, row.root).unwrap_or_default();
        let jitters = latencies
            .iter()
            .map(|it| blocking + it.latest - it.earliest);
        if let Some(jitter) = jitters.max() {
            report.step_edge_jitter_us = self.us(jitter as f64);
        } else {
            let what = format!("`{name}` itself stores nothing to a step pin");
            let remedy = "Write the pins first, to a constant address.";
            let flaw = self
                .system
                .flaw(Rule::Configuration, row.root, what, remedy);
            report.flaws.push(flaw);
        }
    }

    /// The highest step rate at which every deadline is met. Whatever holds at a rate holds at all
    /// lower ones: they release nothing more often, and lengthen no loop.
    fn proven(&self, baud: u32, flash: Flash) -> Result<u32, String> {
        let highest = self.system.config.program.highest_step_rate_hz;
        let highest = highest.unwrap_or(HIGHEST_RATE);
        let (mut low, mut high) = (0, highest / RATE_STEP + 1);
        while high - low > 1 {
            let middle = u32::midpoint(low, high);
            if self.is_met(middle * RATE_STEP, baud, flash)? {
                low = middle;
            } else {
                high = middle;
            }
        }
        Ok(low * RATE_STEP)
    }

    fn is_met(&self, step_rate_hz: u32, baud: u32, flash: Flash) -> Result<bool, String> {
        let point = self.system.point(step_rate_hz, baud);
        response::are_met(self.system, &self.blocking, point, flash)
    }

    fn curve(&self, report: &mut Report) -> Result<(), String> {
        let proven = report
            .proven_step_rate_hz
            .values()
            .max()
            .copied()
            .unwrap_or(0);
        let last = (proven + proven / 5).max(10_000);
        for index in 1..=CURVE_POINTS {
            let step_rate_hz = last / CURVE_POINTS * index;
            let point = self.system.point(step_rate_hz, report.baud);
            let responses = response::all(self.system, &self.blocking, point)?;
            let mut new = Curve {
                step_rate_hz,
                slack_us: BTreeMap::new(),
                deadline_us: BTreeMap::new(),
            };
            for (row, it) in self.system.rows.iter().zip(responses) {
                let Some(it) = it else { continue };
                let slack = it
                    .response
                    .map(|response| self.us(it.deadline - response as f64));
                new.slack_us.insert(row.name.clone(), slack);
                new.deadline_us
                    .insert(row.name.clone(), self.us(it.deadline));
            }
            report.curve.push(new);
        }
        Ok(())
    }
}

/// The demand of a response time, for the report.
fn window(demand: &Demand) -> Window {
    Window {
        own: demand.own.iter().map(Stream::from).collect(),
        others: demand.others.iter().map(Stream::from).collect(),
        once: demand.once,
    }
}

fn overload(utilisation: f64) -> Flaw {
    let what = format!(
        "the tasks may take {:.0} % of the processor",
        utilisation * 100.0
    );
    let remedy = "Shorten the tasks, or let them run less often.";
    Flaw::new(Rule::DeadlineMissed, what, Place::default(), remedy)
}

/// A task without a deadline must not hold up a task with one.
fn holds_up(system: &System<'_>, row: &Row) -> Option<Flaw> {
    let held = system
        .rows
        .iter()
        .find(|other| other.times.is_some() && other.task.priority <= row.task.priority)?;
    let what = format!(
        "`{}` has no deadline, but holds up `{}`",
        row.name, held.name
    );
    let remedy = "Give it a period and a deadline, or a lower priority.";
    Some(misconfigured(what, remedy))
}
