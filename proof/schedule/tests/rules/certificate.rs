//! The certificate of a program is accepted by the checker, and every falsified one is refused.

use std::{fs, path::Path};

use common::install::Unavailable;
use schedule::confirm;
use serde_json::{Value, json};

use super::project::Project;

/// The answer of the checker; `None`, and a word why, where it cannot be had.
fn answer(elf: &Path, certificate: &Value) -> Option<Result<String, String>> {
    let path = elf.with_extension("certificate.json");
    fs::write(&path, certificate.to_string()).unwrap();
    match confirm(elf, &path) {
        Ok(answer) => Some(answer),
        Err(error) if error.is::<Unavailable>() => {
            println!("skipped: {error}");
            None
        }
        Err(error) => panic!("{error:?}"),
    }
}

/// Subtracts one from a number of a certificate.
fn one_less(number: &mut Value) {
    *number = json!(number.as_i64().unwrap() - 1);
}

fn values(value: &mut Value) -> &mut Vec<Value> {
    value.as_array_mut().unwrap()
}

/// The function with a loop.
fn looped(certificate: &mut Value) -> &mut Value {
    let functions = certificate["functions"].as_object_mut().unwrap();
    let has_loop = |function: &&mut Value| function["loops"] != json!([]);
    functions.values_mut().find(has_loop).unwrap()
}

/// The only row whose name is this.
fn row<'a>(certificate: &'a mut Value, name: &str) -> &'a mut Value {
    let mut rows = values(&mut certificate["rows"]).iter_mut();
    rows.find(|row| row["name"] == name).unwrap()
}

/// The window of the least urgent row.
fn window(certificate: &mut Value) -> &mut Value {
    values(&mut certificate["windows"]).last_mut().unwrap()
}

/// A view with the dual values of a function.
fn view(certificate: &mut Value) -> &mut Value {
    let view = values(&mut certificate["views"]).last_mut().unwrap();
    let functions = view["functions"].as_object_mut().unwrap();
    functions.values_mut().next().unwrap()
}

/// A falsification, and what the checker says of it among others.
type Falsified = (&'static str, fn(&mut Value), &'static str);

const FALSIFIED: [Falsified; 18] = [
    (
        "a bound one less",
        |it| looped(it)["loops"][0]["most"] = json!(63),
        "dual value",
    ),
    (
        "a loop left out",
        |it| values(&mut looped(it)["loops"]).clear(),
        "a cycle without a bound",
    ),
    (
        "a path left out",
        |it| {
            let blocks = values(&mut looped(it)["blocks"]).iter_mut();
            let mut edges = blocks.map(|block| values(&mut block[5]));
            edges.find(|edges| edges.len() == 2).unwrap().pop();
        },
        "goes to",
    ),
    (
        "a block cut short",
        |it| looped(it)["blocks"][0][1] = json!(looped(it)["blocks"][0][0].as_u64().unwrap() + 2),
        "",
    ),
    (
        "a function that does not return",
        |it| looped(it)["blocks"][0][4] = json!(true),
        "a trap",
    ),
    (
        "a dual value one less",
        |it| one_less(&mut view(it)["rests"][0]),
        "dual value",
    ),
    (
        "a path one less",
        |it| one_less(&mut view(it)["path"]),
        "the longest path",
    ),
    (
        "a function left out",
        |it| it["views"][0]["functions"] = json!({}),
        "KeyError",
    ),
    (
        "a view left out",
        |it| drop(values(&mut it["views"]).pop()),
        "no view",
    ),
    (
        "an instruction cheaper than in the manual",
        |it| one_less(&mut it["classes"]["load"]),
        "fewer cycles",
    ),
    (
        "a slower bus",
        |it| it["classes"]["ahb"] = json!(9),
        "dual value",
    ),
    (
        "a window short",
        |it| one_less(&mut window(it)["response"]),
        "the response time",
    ),
    (
        "a window that pays less",
        |it| one_less(&mut window(it)["once"]),
        "once",
    ),
    (
        "a cheaper task",
        |it| one_less(&mut window(it)["others"][0]["cost"]),
        "the streams differ",
    ),
    (
        "a task left out",
        |it| drop(values(&mut window(it)["others"]).pop()),
        "the streams differ",
    ),
    (
        "a window left out",
        |it| drop(values(&mut it["windows"]).pop()),
        "a window is missing",
    ),
    (
        "a task that is less urgent",
        |it| row(it, "receive")["priority"] = json!(0),
        "receive",
    ),
    (
        "a deadline before the end",
        |it| row(it, "work")["deadline"] = json!(10),
        "may be missed",
    ),
];

#[test]
fn a_certificate_is_accepted_and_a_falsified_one_is_refused() {
    let project = or_skip!(Project::new("certified"));
    let elf = project.build();
    let certificate: Value = serde_json::from_str(&project.certify(&elf)).unwrap();
    let accepted = or_skip!(answer(&elf, &certificate)).unwrap();
    assert!(accepted.starts_with("accepted: 3 rows"), "{accepted}");
    for (what, falsify, why) in FALSIFIED {
        let mut certificate = certificate.clone();
        falsify(&mut certificate);
        let refused = answer(&elf, &certificate).unwrap();
        let refused = refused.expect_err(what);
        let is_refused = refused.starts_with("refused: ") && refused.contains(why);
        assert!(is_refused, "{what}: {refused}");
    }
}

#[test]
fn the_certificate_of_another_program_is_refused() {
    let project = or_skip!(Project::new("certified-first"));
    let elf = project.build();
    let mut certificate: Value = serde_json::from_str(&project.certify(&elf)).unwrap();
    let items = "sum = sum.rotate_right(3);\n            left -= 1;";
    let other = Project::new("certified-second").unwrap();
    let other = other.replacing("left -= 1;", items);
    let other_elf = other.build();
    let refused = or_skip!(answer(&other_elf, &certificate)).unwrap_err();
    assert!(refused.contains("of another ELF file"), "{refused}");
    // Not even with the hash of that program.
    certificate["elf_sha256"] = json!(other.analyse(&other_elf).elf_sha256);
    let refused = answer(&other_elf, &certificate).unwrap().unwrap_err();
    assert!(refused.starts_with("refused: "), "{refused}");
}
