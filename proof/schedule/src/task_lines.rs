//! The lines of the source that tasks run.

use std::collections::BTreeMap;

use crate::{Function, Input, Model, Program, analyse::Sources, system::System};

/// The lines of the project that tasks run, by file and number: the highest priority of a task with
/// a deadline that does; `None`: only others.
///
/// # Errors
///
/// When a file cannot be read or understood.
pub fn lines_of_tasks(input: &Input<'_>) -> Result<BTreeMap<(String, u32), Option<u8>>, String> {
    let sources = Sources::read(input)?;
    let program = Program::new(&sources.image, &sources.annotations);
    let clocks = (input.clock, Model::new(&input.clock));
    let (app, config) = (&sources.app, &sources.config);
    let system = System::new(&program, app, config, clocks, input.axes, &mut Vec::new());
    let mut lines: BTreeMap<(String, u32), Option<u8>> = BTreeMap::new();
    for row in &system.rows {
        let priority = row.times.as_ref().map(|_| row.task.priority);
        for instruction in system.functions_of(row).flat_map(Function::instructions) {
            for frame in sources.image.frames(instruction.address).iter() {
                if frame.file.starts_with("src/") {
                    let line = lines.entry((frame.file.to_string(), frame.line));
                    let known = line.or_default();
                    *known = (*known).max(priority);
                }
            }
        }
    }
    Ok(lines)
}
