//! The tasks and sections to be followed.

use std::collections::{BTreeMap, BTreeSet};

use crate::{Function, Input, Model, Program, analyse::Sources, system::System};

/// The emulated board has no step timer and no watchdog. These handlers stand for the hardware; they preempt
/// tasks, so they are followed too, but nothing is asked of them.
pub const STAND_INS: [&str; 2] = ["TIM2", "TIM3"];

/// A kind of run of a task.
#[derive(Debug, Clone)]
pub struct Kind {
    /// Its name: a row of the report.
    pub name: String,
    /// Functions that are not called in such a run.
    pub excluded: BTreeSet<u32>,
}

/// A task to be followed.
#[derive(Debug, Clone)]
pub struct Root {
    /// Its name.
    pub name: String,
    /// The address of its handler, ...
    pub handler: u32,
    /// ... and of the handlers in other vectors that call this handler.
    pub callers: Vec<u32>,
    /// The functions that it can reach.
    pub reach: BTreeSet<u32>,
    /// Its kinds of runs, at least one.
    pub kinds: Vec<Kind>,
}

/// See the module.
pub struct Plan {
    /// The analysed functions by their address: all that the tasks can reach.
    pub functions: BTreeMap<u32, Function>,
    /// The tasks.
    pub roots: Vec<Root>,
    /// The bounds of loops that have names.
    pub named: BTreeMap<String, u64>,
    /// Functions that are called at most so often in one activation.
    pub limited: BTreeMap<u32, u64>,
    /// The cycle table.
    pub model: Model,
}

impl Plan {
    /// Follows the tasks that have deadlines, with the numbers of the point that is asked for.
    ///
    /// # Errors
    ///
    /// When a file cannot be read or understood.
    pub fn read(input: &Input<'_>) -> Result<Self, String> {
        let sources = Sources::read(input)?;
        let (app, config) = (&sources.app, &sources.config);
        let program = Program::new(&sources.image, &sources.annotations);
        let clock = input.clock;
        let mut model = Model::new(&clock);
        if let Some(measured) = &input.measured {
            model.calibrate(&measured.cycles);
        }
        let system = System::new(
            &program,
            app,
            config,
            (clock, model.clone()),
            input.axes,
            &mut Vec::new(),
        );
        let step_rate_hz = input.step_rate_hz.unwrap_or(config.table.step_rate_hz);
        let baud = input.baud.unwrap_or(config.program.baud);
        let mut named = config.numbers(&clock, system.point(step_rate_hz, baud))?;
        named.entry("axes".to_owned()).or_insert(input.axes.into());
        let mut plan = Self::new(&program, tasks(&system), named, model);
        let limited = system.limited.iter();
        plan.limited = limited
            .filter_map(|(address, name)| Some((*address, *plan.named.get(name)?)))
            .collect();
        Ok(plan)
    }

    /// Follows tasks of a program: name, entries, of which the handler is the last, and kinds of runs of each.
    pub fn new(
        program: &Program<'_>,
        tasks: impl IntoIterator<Item = (String, Vec<u32>, Vec<Kind>)>,
        named: BTreeMap<String, u64>,
        model: Model,
    ) -> Self {
        let roots = tasks.into_iter().map(|(name, mut callers, kinds)| Root {
            name,
            reach: callers
                .iter()
                .flat_map(|entry| program.reach(*entry))
                .collect(),
            handler: callers.pop().unwrap_or_default(),
            callers,
            kinds,
        });
        let roots: Vec<Root> = roots.collect();
        let reached: BTreeSet<u32> = roots.iter().flat_map(|root| &root.reach).copied().collect();
        let functions = program.functions().iter();
        let functions = functions.filter(|(address, _)| reached.contains(address));
        Self {
            functions: functions
                .map(|(address, function)| (*address, function.clone()))
                .collect(),
            roots,
            named,
            limited: BTreeMap::new(),
            model,
        }
    }

    /// Every kind of run, in the order of the tasks.
    pub(super) fn kinds(&self) -> impl Iterator<Item = &Kind> {
        self.roots.iter().flat_map(|root| &root.kinds)
    }
}

/// The tasks to be followed, as [`Plan::new`] wants them.
fn tasks(system: &System<'_>) -> Vec<(String, Vec<u32>, Vec<Kind>)> {
    let mut tasks: Vec<(String, Vec<u32>, Vec<Kind>)> = Vec::new();
    for row in system.rows.iter().filter(|row| row.times.is_some()) {
        let kind = Kind {
            name: row.name.clone(),
            excluded: row.excluded.clone(),
        };
        match tasks.last_mut() {
            Some((_, entries, kinds)) if *entries == row.entries() => kinds.push(kind),
            _ => tasks.push((row.task.name.clone(), row.entries().to_vec(), vec![kind])),
        }
    }
    for name in STAND_INS {
        if let Some(handler) = system.image.symbol(name) {
            let kind = Kind {
                name: name.to_owned(),
                excluded: BTreeSet::new(),
            };
            tasks.push((name.to_owned(), vec![handler], vec![kind]));
        }
    }
    tasks
}
