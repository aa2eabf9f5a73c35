//! Every command of `cargo xtask` that a document shows is there, and has the options that are shown.

use std::{
    collections::{BTreeMap, BTreeSet},
    fmt::Write as _,
    fs,
};

use clap::{Command, CommandFactory as _};
use common::{cargo, options::CommandLine};

/// The options of each command, without `--`; those of its own commands count as its.
type Commands = BTreeMap<String, BTreeSet<String>>;

/// Options that every command has.
const GLOBAL_OPTIONS: [&str; 4] = ["axes", "clock", "help", "version"];

/// The options of a command.
fn options(command: &Command) -> BTreeSet<String> {
    let own = command
        .get_arguments()
        .filter_map(|option| option.get_long());
    let inner = command.get_subcommands().flat_map(options);
    own.map(String::from).chain(inner).collect()
}

/// Every command with its options.
fn commands() -> Commands {
    let line = CommandLine::command();
    let commands = line.get_subcommands();
    commands
        .map(|command| (command.get_name().into(), options(command)))
        .collect()
}

/// The pieces of code in a document, each with the number of its line: lines of blocks, and code
/// within a paragraph, also over two lines.
fn code(text: &str) -> Vec<(usize, String)> {
    let mut found = Vec::new();
    let mut is_block = false;
    let mut paragraph = String::new();
    let mut first = 1;
    for (number, line) in (1..).zip(text.lines().chain([""])) {
        let is_fence = line.trim_start().starts_with("```");
        is_block ^= is_fence;
        if is_block && !is_fence {
            found.push((number, line.to_owned()));
        } else if is_fence || line.is_empty() || line.starts_with('|') {
            let spans = paragraph.split('`').skip(1).step_by(2);
            found.extend(spans.map(|code| (first, code.replace('\n', " "))));
            paragraph.clear();
            first = number + 1;
            let cells = if is_fence { "" } else { line };
            let spans = cells.split('`').skip(1).step_by(2);
            found.extend(spans.map(|code| (number, code.to_owned())));
        } else {
            paragraph.push_str(line);
            paragraph.push('\n');
        }
    }
    found
}

/// An option's name in a word of a command line: `plot` in `--plot=a.svg`.
fn option(word: &str) -> Option<&str> {
    let name = word.strip_prefix("--")?;
    let is_part = |c: char| c.is_ascii_alphanumeric() || c == '-';
    let end = name.find(|c| !is_part(c)).unwrap_or(name.len());
    Some(&name[..end]).filter(|name| !name.is_empty())
}

/// What is wrong with a command line behind `cargo xtask`; nothing for a placeholder.
fn wrong(line: &str, commands: &Commands) -> Option<String> {
    let is_end = |word: &&str| !matches!(*word, "--" | "|" | "&&" | "&" | ";" | "#" | ">" | "<");
    let mut words = line.split_whitespace().take_while(is_end);
    let mut verb = words.next()?;
    if matches!(option(verb), Some("axes" | "clock")) {
        verb = words.nth(1)?;
    }
    let verb = verb.trim_end_matches([',', '.', ';', ':', ')']);
    if option(verb).is_some() || !verb.starts_with(|c: char| c.is_ascii_lowercase()) {
        return None;
    }
    let Some(options) = commands.get(verb) else {
        return Some(format!("there is no command {verb}"));
    };
    words
        .filter_map(option)
        .find(|name| !GLOBAL_OPTIONS.contains(name) && !options.contains(*name))
        .map(|name| format!("{verb} has no option --{name}"))
}

/// The commands and options of a document that do not exist, a line for each. An option alone must be
/// one of some command.
fn missing(document: &str, text: &str, commands: &Commands) -> String {
    let mut missing = String::new();
    for (number, code) in code(text) {
        let lines = code.split("cargo xtask ").skip(1);
        let found = lines.filter_map(|line| wrong(line, commands));
        let alone = option(&code).filter(|name| {
            let is_known = commands.values().any(|options| options.contains(*name));
            !is_known && !GLOBAL_OPTIONS.contains(name)
        });
        let alone = alone.map(|name| format!("no command has an option --{name}"));
        for what in found.chain(alone) {
            let _ = writeln!(missing, "{document}:{number}: {what}");
        }
    }
    missing
}

#[test]
fn every_command_that_a_document_shows_exists() {
    let commands = commands();
    assert!(commands["sim"].contains("on-target"), "{commands:?}");
    let pages = fs::read_dir(cargo::root().join("docs")).expect("there are documents");
    let pages = pages.map(|page| page.expect("it can be read").path());
    let pages = pages.filter(|page| page.extension().is_some_and(|extension| extension == "md"));
    let top = ["README.md", "CHANGELOG.md", "proof/README.md"].map(|name| cargo::root().join(name));
    let missing: String = pages
        .chain(top)
        .map(|page| {
            let text = fs::read_to_string(&page).expect("documents can be read");
            missing(&page.display().to_string(), &text, &commands)
        })
        .collect();
    assert!(missing.is_empty(), "\n{missing}");
}

#[test]
fn a_command_or_an_option_that_is_not_there_is_found() {
    let text = "`cargo xtask run FILE --axes 4`, `cargo xtask VERB --flag`,\n\
                `cargo\nxtask trial`, `--plot` and `--not-this`\n\
                ```sh\ncargo xtask --axes 4 run a --steps 3   # --never\n\
                cargo xtask test --as && ls --all\n```\n\
                | `cargo xtask test`, `cargo xtask run -- --mine` | `--help` |\n";
    assert_eq!(
        missing("a.md", text, &commands()),
        "a.md:1: there is no command trial\n\
         a.md:1: no command has an option --not-this\n\
         a.md:5: run has no option --steps\n\
         a.md:6: test has no option --as\n"
    );
}
