//! The tasks and resources of an RTIC application, from its source.
//!
//! RTIC 2.4: a hardware task has the vector that it binds; each priority of software tasks has one
//! dispatcher, taken from the end of the list, the highest priority first. A resource's ceiling is
//! the highest priority of the tasks that share it; a resource that is only shared by reference is
//! never locked.

use std::collections::{BTreeMap, BTreeSet};

use crate::Place;
use proc_macro2::{Delimiter, TokenStream, TokenTree};
use syn::{Attribute, Item, ItemFn, Meta};

/// A task.
#[derive(Debug, Clone, Default, PartialEq, Eq)]
pub struct AppTask {
    /// Name of its function.
    pub name: String,
    /// Its vector.
    pub vector: String,
    /// Its priority; 0: idle.
    pub priority: u8,
    /// Resources that it may lock.
    pub locks: Vec<String>,
    /// Resources that it shares by reference.
    pub references: Vec<String>,
    /// A software task.
    pub is_async: bool,
    /// The line of its function.
    pub line: u32,
}

impl AppTask {
    /// Where it is in the source.
    pub fn place(&self) -> Place {
        Place {
            address: 0,
            frames: vec![format!("{} (src/app.rs:{})", self.name, self.line)],
        }
    }
}

/// An application.
#[derive(Debug, Clone, Default, PartialEq, Eq)]
pub struct App {
    /// Its tasks.
    pub tasks: Vec<AppTask>,
    /// Vectors that it lends to software tasks.
    pub dispatchers: Vec<String>,
    /// Names of tasks that programs with other features have.
    pub others: Vec<String>,
}

impl App {
    /// Reads the application of a program with some features.
    ///
    /// # Errors
    ///
    /// Tells what is not understood.
    pub fn parse(source: &str, features: &[String]) -> Result<Self, String> {
        let file = syn::parse_file(source).map_err(|error| error.to_string())?;
        let mut app = None;
        for item in file.items {
            let Item::Mod(module) = item else { continue };
            let Some(attribute) = named(&module.attrs, "app") else {
                continue;
            };
            let mut new = Self {
                dispatchers: arguments(attribute)
                    .remove("dispatchers")
                    .map_or_else(Vec::new, idents),
                ..Self::default()
            };
            for item in module.content.into_iter().flat_map(|(_, items)| items) {
                let Item::Fn(function) = item else { continue };
                let Some(task) = task(&function)? else {
                    continue;
                };
                if is_compiled(&function.attrs, features)? {
                    new.tasks.push(task);
                } else {
                    new.others.push(task.name);
                }
            }
            app = Some(new);
        }
        let mut app = app.ok_or("there is no module with the attribute `#[rtic::app]`")?;
        app.assign_dispatchers()?;
        Ok(app)
    }

    fn assign_dispatchers(&mut self) -> Result<(), String> {
        let software = self.tasks.iter().filter(|task| task.is_async);
        let levels: BTreeSet<u8> = software.map(|task| task.priority).collect();
        let vectors = levels.iter().rev().zip(self.dispatchers.iter().rev());
        let vectors: BTreeMap<u8, String> = vectors.map(|(at, name)| (*at, name.clone())).collect();
        for task in self.tasks.iter_mut().filter(|task| task.is_async) {
            let vector = vectors.get(&task.priority);
            let vector = vector.ok_or_else(|| format!("no dispatcher for `{}`", task.name))?;
            task.vector.clone_from(vector);
        }
        Ok(())
    }

    /// The ceiling of each resource that is locked.
    pub fn ceilings(&self) -> BTreeMap<&str, u8> {
        let mut ceilings = BTreeMap::new();
        for task in &self.tasks {
            for resource in &task.locks {
                let ceiling = ceilings.entry(resource.as_str()).or_default();
                *ceiling = task.priority.max(*ceiling);
            }
        }
        ceilings
    }

    /// The vectors of the tasks, each with its priority.
    pub fn vectors(&self) -> BTreeMap<&str, u8> {
        let tasks = self.tasks.iter().filter(|task| task.priority > 0);
        tasks
            .map(|task| (task.vector.as_str(), task.priority))
            .collect()
    }
}

/// The attribute whose path ends so.
fn named<'a>(attributes: &'a [Attribute], name: &str) -> Option<&'a Attribute> {
    attributes.iter().find(|attribute| {
        let last = attribute.path().segments.last();
        last.is_some_and(|last| last.ident == name)
    })
}

/// Whether a program with some features has what these attributes are of: `cfg(feature = "...")`, or `cfg(not(...))` of
/// that.
fn is_compiled(attributes: &[Attribute], features: &[String]) -> Result<bool, String> {
    let Some(attribute) = named(attributes, "cfg") else {
        return Ok(true);
    };
    let Meta::List(list) = &attribute.meta else {
        return Err("`cfg` without a condition".into());
    };
    let text: String = list.tokens.to_string().split_whitespace().collect();
    let inner = text
        .strip_prefix("not(")
        .and_then(|it| it.strip_suffix(')'));
    let feature = inner.unwrap_or(&text).strip_prefix("feature=\"");
    let feature = feature.and_then(|it| it.strip_suffix('"'));
    let feature = feature.ok_or_else(|| format!("`cfg({text})` is no condition of one feature"))?;
    let has = features.iter().any(|own| own == feature);
    Ok(has == inner.is_none())
}

/// The task of a function, if the function is a task.
fn task(function: &ItemFn) -> Result<Option<AppTask>, String> {
    let name = function.sig.ident.to_string();
    let is_idle = named(&function.attrs, "idle").is_some();
    let Some(attribute) = named(&function.attrs, "task").or(named(&function.attrs, "idle")) else {
        return Ok(None);
    };
    let mut arguments = arguments(attribute);
    let priority = match arguments.remove("priority") {
        None => u8::from(!is_idle),
        Some(tokens) => {
            let text: String = tokens.iter().map(ToString::to_string).collect();
            let error = |_| format!("the priority `{text}` of `{name}` is no number");
            text.parse().map_err(error)?
        }
    };
    let binds = arguments.remove("binds").unwrap_or_default();
    let shared = arguments.remove("shared").map_or_else(Vec::new, elements);
    let (references, locks): (Vec<_>, Vec<_>) = shared.into_iter().partition(
        |tokens| matches!(tokens.first(), Some(TokenTree::Punct(punct)) if punct.as_char() == '&'),
    );
    let names =
        |resources: Vec<Vec<TokenTree>>| resources.iter().filter_map(|it| ident(it)).collect();
    Ok(Some(AppTask {
        vector: ident(&binds).unwrap_or_default(),
        priority,
        locks: names(locks),
        references: names(references),
        is_async: function.sig.asyncness.is_some(),
        line: function.sig.ident.span().start().line as u32,
        name,
    }))
}

/// `name = tokens` of an attribute.
fn arguments(attribute: &Attribute) -> BTreeMap<String, Vec<TokenTree>> {
    let Meta::List(list) = &attribute.meta else {
        return BTreeMap::new();
    };
    let arguments = split(list.tokens.clone()).into_iter().map(|tokens| {
        let name = tokens.first().map_or_else(String::new, ToString::to_string);
        (name, tokens.into_iter().skip(2).collect())
    });
    arguments.collect()
}

/// The parts between commas.
fn split(tokens: TokenStream) -> Vec<Vec<TokenTree>> {
    let mut parts = vec![Vec::new()];
    for token in tokens {
        if matches!(&token, TokenTree::Punct(punct) if punct.as_char() == ',') {
            parts.push(Vec::new());
        } else if let Some(part) = parts.last_mut() {
            part.push(token);
        }
    }
    parts.retain(|part| !part.is_empty());
    parts
}

/// The elements of a list in brackets.
fn elements(tokens: Vec<TokenTree>) -> Vec<Vec<TokenTree>> {
    match tokens.into_iter().next() {
        Some(TokenTree::Group(group)) if group.delimiter() == Delimiter::Bracket => {
            split(group.stream())
        }
        _ => Vec::new(),
    }
}

fn idents(tokens: Vec<TokenTree>) -> Vec<String> {
    elements(tokens).iter().filter_map(|it| ident(it)).collect()
}

/// The last identifier: that of a path.
fn ident(tokens: &[TokenTree]) -> Option<String> {
    let mut idents = tokens.iter().rev().filter_map(|token| match token {
        TokenTree::Ident(ident) => Some(ident.to_string()),
        _ => None,
    });
    idents.next()
}

#[cfg(test)]
mod tests {
    use super::*;

    const SOURCE: &str = "
        #[rtic::app(device = pac, dispatchers = [I2C2_EV, pac::I2C3_EV])]
        mod app {
            #[task(binds = SysTick, priority = 5, shared = [&counts], local = [a: u8 = f(1, 2)])]
            fn step(cx: step::Context) {}
            #[task(binds = USART1, shared = [snapshot, &counts], priority = 3)]
            fn receive(cx: receive::Context) {}
            #[task(priority = 1, shared = [snapshot])]
            async fn report(cx: report::Context) -> ! { loop {} }
            #[task(priority = 2)]
            async fn other(cx: other::Context) {}
            #[idle(shared = [snapshot])]
            fn idle(_: idle::Context) -> ! { loop {} }
            fn helper() {}
        }";

    fn app() -> App {
        App::parse(SOURCE, &[]).unwrap()
    }

    #[test]
    fn tasks_are_those_of_a_program_with_its_features() {
        let with = |conditions: [&str; 2], features: &[&str]| {
            let [first, second] = conditions;
            let source = SOURCE
                .replace(
                    "#[task(binds = SysTick",
                    &format!("#[cfg({first})] #[task(binds = SysTick"),
                )
                .replace(
                    "#[task(binds = USART1",
                    &format!("#[cfg({second})] #[task(binds = USART1"),
                );
            let features: Vec<_> = features.iter().map(|it| (*it).to_owned()).collect();
            let app = App::parse(&source, &features)?;
            Ok::<_, String>((app.tasks[0].name.clone(), app.others))
        };
        let conditions = ["not(feature = \"usb\")", "feature = \"usb\""];
        let of = |first: &str, other: &str| Ok((first.to_owned(), vec![other.to_owned()]));
        assert_eq!(with(conditions, &["chip"]), of("step", "receive"));
        assert_eq!(with(conditions, &["chip", "usb"]), of("receive", "step"));
        assert!(with(["target_os = \"none\"", "feature = \"usb\""], &[]).is_err());
    }

    #[test]
    fn tasks_have_their_vectors_and_priorities() {
        let app = app();
        let found = |name: &str| {
            let task = app.tasks.iter().find(|task| task.name == name);
            task.map(|task| (task.vector.as_str(), task.priority))
                .unwrap()
        };
        assert_eq!(found("step"), ("SysTick", 5));
        assert_eq!(found("receive"), ("USART1", 3));
        assert_eq!(found("idle"), ("", 0));
        assert_eq!(app.tasks.len(), 5);
    }

    #[test]
    fn dispatchers_are_taken_from_the_end() {
        let vectors = app().tasks.into_iter().filter(|task| task.is_async);
        let vectors: Vec<_> = vectors.map(|task| (task.name, task.vector)).collect();
        let expected = [("report", "I2C2_EV"), ("other", "I2C3_EV")];
        assert_eq!(vectors, expected.map(|(a, b)| (a.to_owned(), b.to_owned())));
    }

    #[test]
    fn what_is_shared_by_reference_has_no_ceiling() {
        assert_eq!(app().ceilings(), BTreeMap::from([("snapshot", 3)]));
        assert_eq!(app().tasks[1].references, ["counts"]);
    }

    #[test]
    fn too_few_dispatchers_are_reported() {
        let source = SOURCE.replace("I2C2_EV, ", "");
        assert_eq!(
            App::parse(&source, &[]),
            Err("no dispatcher for `report`".to_owned())
        );
        assert!(App::parse("mod app {}", &[]).is_err());
    }
}
