//! The priorities of the firmware's tasks: those of `src/app.rs`.

use anyhow::{Result, anyhow};
use common::cargo;
use schedule::App;

/// Where the tasks are.
const APP_SOURCE: &str = "src/app.rs";

/// Returns the vectors of the tasks, each with its priority as RTIC has it.
pub(super) fn of_tasks() -> Result<Vec<(String, u8)>> {
    let source = firmware::boards::compile::read(&cargo::root().join(APP_SOURCE))?;
    let source = String::from_utf8(source)?;
    let app = App::parse(&source, &[]).map_err(|error| anyhow!("{APP_SOURCE}: {error}"))?;
    let vectors = app.vectors().into_iter();
    Ok(vectors
        .map(|(vector, priority)| (vector.to_owned(), priority))
        .collect())
}

#[cfg(test)]
mod tests {
    use std::fs;

    use super::*;

    /// Priorities that files of the board repeat, as RTIC does not know these vectors: the constant, and the
    /// vector of the task.
    const REPEATED: [(&str, &str, &str, &str); 3] = [
        (
            "src/board/inputs.rs",
            "const PRIORITY: u8 = ",
            ";",
            "TIM1_UP_TIM10",
        ),
        (
            "src/board/power_up.rs",
            "const SERIAL_PRIORITY: u8 = ",
            ";",
            "USART1",
        ),
        (
            "src/board/flash.rs",
            "const MASK_ALL_TASKS: u8 = nvic_priority(",
            ");",
            "SysTick",
        ),
    ];

    #[test]
    fn the_board_s_files_give_their_vectors_the_priorities_of_the_tasks() {
        let tasks = of_tasks().unwrap();
        for (file, start, end, vector) in REPEATED {
            let text = fs::read_to_string(cargo::root().join(file)).unwrap();
            let (_, rest) = text.split_once(start).expect(file);
            let (number, _) = rest.split_once(end).unwrap();
            let task = tasks.iter().find(|(name, _)| name == vector).unwrap();
            assert_eq!(number, task.1.to_string(), "{file}, {vector}");
        }
        let highest = tasks.iter().map(|(_, priority)| priority).max();
        let step = tasks.iter().find(|(name, _)| name == "SysTick").unwrap();
        assert_eq!(highest, Some(&step.1), "an erase masks up to step");
    }
}
