//! The worst path of each task, as lines of its source.

use std::{fmt::Write as _, fs, path::Path};

use schedule::{Line, Report, Task};

use super::{grouped, svg::escaped, timeline::colour};
use crate::text::wcet;

/// Lines shown of each path; the rest is added up.
const SHOWN: usize = 16;

/// All paths; the first is open.
pub(super) fn all(report: &Report, root: &Path) -> String {
    let mut text = String::new();
    let tasks = report.tasks.iter().enumerate();
    let with_paths = tasks.filter(|(_, task)| !task.worst_path.is_empty());
    for (place, (index, task)) in with_paths.enumerate() {
        text += &one(task, &colour(index), place == 0, root);
    }
    text
}

fn one(task: &Task, colour: &str, is_open: bool, root: &Path) -> String {
    let open = if is_open { " open" } else { "" };
    let cycles = wcet(task).map_or(String::new(), |cycles| {
        format!("{} cycles {}", grouped(cycles), escaped(&task.via))
    });
    let mut text = format!(
        "<details{open}><summary><b class=\"ink {colour}\">{}</b> <span class=\"note\">{cycles}, \
         {} lines of the cache</span></summary>\n<div class=\"scroll\"><table class=\"path\">\n\
         <tr><th>cycles</th><th></th><th>runs</th><th>line</th></tr>\n",
        escaped(&task.name),
        task.icache_lines,
    );
    let most = task
        .worst_path
        .iter()
        .map(|line| line.cycles)
        .max()
        .unwrap_or(1)
        .max(1);
    for line in task.worst_path.iter().take(SHOWN) {
        row(&mut text, line, most, colour, root);
    }
    let others = task.worst_path.iter().skip(SHOWN);
    let count = others.clone().count();
    let mut remainder = |cycles: u64, what: &str| {
        let cycles = grouped(cycles);
        let _ = writeln!(
            text,
            "<tr class=\"rest\"><td>{cycles}</td><td></td><td></td><td>{what}</td></tr>"
        );
    };
    if count > 0 {
        let cycles = others.map(|line| line.cycles).sum();
        remainder(cycles, &format!("{count} more lines"));
    }
    let listed: u64 = task.worst_path.iter().map(|line| line.cycles).sum();
    if let Some(cycles) = wcet(task).and_then(|all| all.checked_sub(listed)) {
        remainder(
            cycles,
            "entry and exit of the exception, misses of the flash cache, code without lines of its own",
        );
    }
    text.push_str("</table></div></details>\n");
    text
}

fn row(text: &mut String, line: &Line, most: u64, colour: &str, root: &Path) {
    let percent = line.cycles as f64 / most as f64 * 100.0;
    // Code of no line has the number 0.
    let number = match line.line {
        0 => String::new(),
        number => format!(":{number}"),
    };
    let source = source(line, root).map_or(String::new(), |source| {
        format!("<code>{}</code>", escaped(&source))
    });
    let _ = writeln!(
        text,
        "<tr><td>{}</td><td class=\"bar\"><i class=\"fill {colour}\" style=\"width:{percent:.1}%\"></i></td>\
         <td>{}</td><td>{source}<span class=\"note\">{}{} in {}</span></td></tr>",
        grouped(line.cycles),
        grouped(line.count),
        escaped(&line.file),
        number,
        escaped(&line.function),
    );
}

/// The line itself, when it is one of the project.
fn source(line: &Line, root: &Path) -> Option<String> {
    if Path::new(&line.file).is_absolute() {
        return None;
    }
    let text = fs::read_to_string(root.join(&line.file)).ok()?;
    let index = usize::try_from(line.line).ok()?.checked_sub(1)?;
    let found = text.lines().nth(index)?.trim();
    (!found.is_empty()).then(|| found.to_owned())
}
