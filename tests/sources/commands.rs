//! Every command of `cargo xtask` that a document shows is there, and has the options that are shown.

use std::{
    collections::{BTreeMap, BTreeSet},
    fmt::Write as _,
    fs,
    path::Path,
};

use super::{links::documents, sources};

/// The options of each command, without `--`.
type Commands = BTreeMap<String, BTreeSet<String>>;

/// Options that the command line has without a declaration of a command.
const EVERYWHERE: [&str; 4] = ["axes", "clock", "help", "version"];

/// The texts in quotes of a piece of source.
fn texts(source: &str) -> Vec<&str> {
    source.split('"').skip(1).step_by(2).collect()
}

/// The names of the commands, each with the first line of its help, in the table of `verb.rs`.
fn verbs(table: &str) -> Vec<(&str, &str)> {
    let (_, table) = table.split_once("const VERBS").expect("there is the table");
    let (table, _) = table.split_once("];").expect("the table has an end");
    texts(table)
        .chunks(2)
        .map(|pair| (pair[0], pair[1]))
        .collect()
}

/// The options that the fields of a struct declare with clap, or that a function adds to a command; a
/// text begins with the one or the other.
fn options(text: &str) -> BTreeSet<String> {
    let mut options = BTreeSet::new();
    let body = text.split("\n}").next().unwrap_or_default();
    for declaration in body.split("#[arg(").skip(1) {
        let Some((arguments, field)) = declaration.split_once(")]") else {
            continue;
        };
        let mut arguments = arguments.split(',').map(str::trim);
        let Some(long) = arguments.find(|argument| argument.starts_with("long")) else {
            continue;
        };
        let named = texts(long).first().map(|name| (*name).to_owned());
        let field = field.trim_start().split(':').next().unwrap_or_default();
        let field = field.split_whitespace().last().unwrap_or_default();
        options.insert(named.unwrap_or_else(|| field.replace('_', "-")));
    }
    let built = body.split(".long(\"").skip(1);
    options.extend(built.filter_map(|name| Some(name.split_once('"')?.0.to_owned())));
    options
}

/// The commands with their options: a command's options are in the struct whose description begins
/// with the first line of its help.
fn commands(table: &str, sources: &[(String, String)]) -> Commands {
    let found = |about: &str| {
        let line = format!("/// {about}\n");
        let mut declared = sources.iter().filter_map(|(_, source)| {
            let (_, rest) = source.split_once(&line)?;
            let derived = rest.split_once("struct Options {");
            Some(
                derived
                    .or_else(|| rest.split_once("fn command() -> Command {"))?
                    .1,
            )
        });
        declared.next()
    };
    verbs(table)
        .into_iter()
        .map(|(name, about)| {
            let text = found(about).unwrap_or_else(|| panic!("no Options describe: {about}"));
            (name.to_owned(), options(text))
        })
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
        .find(|name| !EVERYWHERE.contains(name) && !options.contains(*name))
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
            !is_known && !EVERYWHERE.contains(name)
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
    let root = Path::new(env!("CARGO_MANIFEST_DIR"));
    let table = fs::read_to_string(root.join("xtask/src/verb.rs")).expect("the table can be read");
    let commands = commands(&table, &sources(&["xtask", "proof", "tests"]));
    assert!(commands["sim"].contains("on-target"), "{commands:?}");
    let missing: String = documents(root)
        .iter()
        .map(|document| {
            let text = fs::read_to_string(root.join(document)).expect("documents can be read");
            missing(document, &text, &commands)
        })
        .collect();
    assert!(missing.is_empty(), "\n{missing}");
}

#[test]
fn a_command_or_an_option_that_is_not_there_is_found() {
    let table = "const VERBS: [Verb; 2] = [verb(\"run\", tools::A, \"Run it\"), \
                 Verb { name: \"test\", about: \"Test it\", tool: None }];";
    let run = "/// Run it\n///\n/// Now.\n#[derive(Parser)]\nstruct Options {\n    file: String,\n    \
               /// Where\n    #[arg(\n        long,\n        value_name = \"N\"\n    )]\n    \
               pub(crate) step_rate: u32,\n    #[arg(long = \"as\")]\n    other: bool,\n}\n\
               struct Other {\n    #[arg(long)]\n    not_this: bool,\n}\n";
    let test = "/// Test it\n#[derive(Parser)]\nstruct Options {\n}\n";
    let sources = [run, test].map(|source| (String::new(), source.to_owned()));
    let commands = commands(table, &sources);
    assert_eq!(
        commands["run"],
        ["as", "step-rate"].map(String::from).into()
    );
    assert_eq!(commands["test"], BTreeSet::new());
    let text = "`cargo xtask run FILE --step-rate=5 --as b --axes 4`, `cargo xtask VERB --flag`,\n\
                `cargo\nxtask trial`, `--as` and `--not-this`\n\
                ```sh\ncargo xtask --axes 4 run a --steps 3   # --never\n\
                cargo xtask test --as && ls --all\n```\n\
                | `cargo xtask test`, `cargo xtask run -- --mine` | `--help` |\n";
    assert_eq!(
        missing("a.md", text, &commands),
        "a.md:1: there is no command trial\n\
         a.md:1: no command has an option --not-this\n\
         a.md:5: run has no option --steps\n\
         a.md:6: test has no option --as\n"
    );
}
