//! The forms of what tools write as JSON, from the types that they write: their fields, and the comments there.

use std::{collections::BTreeMap, fmt::Write as _, fs, path::Path};

use anyhow::{Context, Result, ensure};
use common::cargo;
use quote::ToTokens as _;
use syn::{Attribute, Expr, Fields, GenericArgument, Item, Lit, Meta, PathArguments, Type};

/// What writes JSON: the command, the folder of its types, and the type at the root.
const OUTPUTS: [(&str, &str, &str); 5] = [
    ("sim FILE --json OUT", "xtask/simulation/src", "Measured"),
    (
        "sim --session IN --out OUT",
        "xtask/simulation/src",
        "Results",
    ),
    ("schedule --json OUT", "proof/schedule/src", "Report"),
    ("bring-up", "proof/target/src/bring_up", "Report"),
    ("conformance --json OUT", "tests/conformance/src", "Outcome"),
];

/// A type that is written: what it is, and its keys or its values.
struct JsonType {
    text: String,
    rows: Vec<JsonKey>,
}

/// A key of an object, or one of the values of an enumeration.
struct JsonKey {
    /// None where the keys of another form stand in its place.
    key: Option<String>,
    is_optional: bool,
    written: Option<Type>,
    text: String,
}

/// The document.
pub(crate) fn document() -> Result<String> {
    let mut text = String::from(
        "# Forms of JSON\n\n\
         Made by `cargo xtask docs` from the types that the tools write. A key with a question mark is left out where there\n\
         is nothing to say. Names of units stand at the end of a key: `_s` seconds, `_mm` millimetres, `_hz` hertz.\n",
    );
    for (command, folder, root) in OUTPUTS {
        let mut forms = BTreeMap::new();
        read_folder(&cargo::root().join(folder), &mut forms)?;
        write!(text, "\n## `cargo xtask {command}`\n")?;
        let mut names = vec![root.to_owned()];
        let mut next = 0;
        while let Some(name) = names.get(next).cloned() {
            let form = forms
                .get(&name)
                .with_context(|| format!("{folder} writes no {name}"))?;
            let title = if next == 0 {
                String::new()
            } else {
                format!("`{name}`: ")
            };
            writeln!(text, "\n{title}{}", form.text)?;
            if !form.rows.is_empty() {
                text.push_str("\n| key | value | what |\n|---|---|---|\n");
            }
            write_rows(&mut text, form, &forms, &mut names)?;
            next += 1;
        }
    }
    Ok(text)
}

/// Writes the rows of a form, and adds the forms that they name.
fn write_rows(
    text: &mut String,
    form: &JsonType,
    forms: &BTreeMap<String, JsonType>,
    names: &mut Vec<String>,
) -> Result<()> {
    for row in &form.rows {
        let Some(key) = &row.key else {
            let inner = row.written.as_ref().and_then(name_of);
            if let Some(inner) = inner.and_then(|name| forms.get(&name)) {
                write_rows(text, inner, forms, names)?;
            }
            continue;
        };
        ensure!(
            !row.text.is_empty(),
            "`{key}` of \"{}\" has no comment",
            form.text
        );
        let written = row.written.as_ref();
        let value = written.map_or_else(String::new, |it| value(it, forms, names));
        // What is null is left out.
        let (mark, value) = if row.is_optional {
            (" ?", value.trim_end_matches(" or null"))
        } else {
            ("", value.as_str())
        };
        writeln!(text, "| `{key}`{mark} | {value} | {} |", row.text)?;
    }
    Ok(())
}

/// Names a value as readers of JSON do, and adds the form that it names.
fn value(of: &Type, forms: &BTreeMap<String, JsonType>, names: &mut Vec<String>) -> String {
    match of {
        Type::Reference(it) => value(&it.elem, forms, names),
        Type::Array(it) => format!("list of {}", value(&it.elem, forms, names)),
        Type::Slice(it) => format!("list of {}", value(&it.elem, forms, names)),
        Type::Tuple(it) => {
            let parts: Vec<_> = it.elems.iter().map(|it| value(it, forms, names)).collect();
            format!("[{}]", parts.join(", "))
        }
        _ => {
            let name = name_of(of).unwrap_or_default();
            let inner: Vec<_> = arguments(of);
            match (name.as_str(), inner.as_slice()) {
                ("bool", _) => "true or false".into(),
                ("f32" | "f64", _) => "number".into(),
                ("String" | "str" | "Cow" | "char", _) => "text".into(),
                ("Option", [it]) => format!("{} or null", value(it, forms, names)),
                ("Box", [it]) => value(it, forms, names),
                ("Vec" | "BTreeSet", [it]) => format!("list of {}", value(it, forms, names)),
                ("BTreeMap" | "HashMap", [_, it]) => {
                    format!("object of {}", value(it, forms, names))
                }
                (number, _) if number.starts_with(['u', 'i']) => "whole number".into(),
                ("Value", _) => "any".into(),
                (form, _) => {
                    if forms.contains_key(form) && !names.iter().any(|known| known == form) {
                        names.push(form.into());
                    }
                    format!("`{form}`")
                }
            }
        }
    }
}

/// The last name of a path.
fn name_of(of: &Type) -> Option<String> {
    let Type::Path(path) = of else { return None };
    Some(path.path.segments.last()?.ident.to_string())
}

/// The arguments of a generic type.
fn arguments(of: &Type) -> Vec<Type> {
    let Type::Path(path) = of else {
        return Vec::new();
    };
    let Some(PathArguments::AngleBracketed(found)) =
        path.path.segments.last().map(|it| it.arguments.clone())
    else {
        return Vec::new();
    };
    let types = found
        .args
        .into_iter()
        .filter_map(|argument| match argument {
            GenericArgument::Type(it) => Some(it),
            _ => None,
        });
    types.collect()
}

/// Reads the types in a folder that are written.
fn read_folder(folder: &Path, forms: &mut BTreeMap<String, JsonType>) -> Result<()> {
    for entry in fs::read_dir(folder)? {
        let path = entry?.path();
        if path.is_dir() {
            read_folder(&path, forms)?;
        } else if path.extension().is_some_and(|extension| extension == "rs") {
            let file = syn::parse_file(&fs::read_to_string(&path)?)
                .with_context(|| format!("cannot read {}", path.display()))?;
            forms.extend(file.items.iter().filter_map(form_of));
            forms.extend(
                file.items
                    .iter()
                    .filter_map(|it| form_of_own_code(it, &file.items)),
            );
        }
    }
    Ok(())
}

/// The form of an item that is written.
fn form_of(item: &Item) -> Option<(String, JsonType)> {
    let (name, attributes) = match item {
        Item::Struct(it) => (it.ident.to_string(), &it.attrs),
        Item::Enum(it) => (it.ident.to_string(), &it.attrs),
        _ => return None,
    };
    let is_written = attributes.iter().any(|it| {
        it.path().is_ident("derive") && it.to_token_stream().to_string().contains("Serialize")
    });
    let rows = match item {
        // Written as what is in it.
        Item::Struct(it) if matches!(it.fields, Fields::Unnamed(_)) => Vec::new(),
        Item::Struct(it) => rows_of(&it.fields),
        Item::Enum(it) => {
            let case = text_of(attributes, "rename_all");
            let row = |variant: &syn::Variant| JsonKey {
                key: Some(in_case(&variant.ident.to_string(), case.as_deref())),
                is_optional: false,
                written: None,
                text: comment(&variant.attrs),
            };
            it.variants.iter().map(row).collect()
        }
        _ => Vec::new(),
    };
    let text = comment(attributes);
    is_written.then_some((name, JsonType { text, rows }))
}

/// The form of a type that code of its own writes: its comment says how.
fn form_of_own_code(item: &Item, all: &[Item]) -> Option<(String, JsonType)> {
    let Item::Impl(written) = item else {
        return None;
    };
    let (_, of, _) = written.trait_.as_ref()?;
    let name = name_of(&written.self_ty)
        .filter(|_| of.segments.last().is_some_and(|it| it.ident == "Serialize"))?;
    let text = all.iter().find_map(|it| match it {
        Item::Struct(it) if it.ident == name => Some(comment(&it.attrs)),
        Item::Enum(it) if it.ident == name => Some(comment(&it.attrs)),
        _ => None,
    })?;
    let rows = Vec::new();
    Some((name, JsonType { text, rows }))
}

fn rows_of(fields: &Fields) -> Vec<JsonKey> {
    let is_written = |field: &&syn::Field| !has(&field.attrs, "skip");
    let row = |field: &syn::Field| {
        let name = field
            .ident
            .as_ref()
            .map_or_else(String::new, ToString::to_string);
        JsonKey {
            key: (!has(&field.attrs, "flatten"))
                .then(|| text_of(&field.attrs, "rename").unwrap_or(name)),
            is_optional: has(&field.attrs, "skip_serializing_if"),
            written: Some(field.ty.clone()),
            text: comment(&field.attrs),
        }
    };
    fields.iter().filter(is_written).map(row).collect()
}

/// Whether an attribute of serde has a word.
fn has(attributes: &[Attribute], word: &str) -> bool {
    let mut found = false;
    for attribute in attributes.iter().filter(|it| it.path().is_ident("serde")) {
        let _ = attribute.parse_nested_meta(|meta| {
            found |= meta.path.is_ident(word);
            if meta.input.peek(syn::Token![=]) {
                let _: Expr = meta.value()?.parse()?;
            }
            Ok(())
        });
    }
    found
}

/// The name of a variant in the case that serde writes.
fn in_case(name: &str, case: Option<&str>) -> String {
    match case {
        Some("snake_case") => {
            let mut written = String::new();
            for letter in name.chars() {
                if letter.is_uppercase() && !written.is_empty() {
                    written.push('_');
                }
                written.extend(letter.to_lowercase());
            }
            written
        }
        Some("lowercase") => name.to_lowercase(),
        _ => name.to_owned(),
    }
}

/// The text of a word of an attribute of serde.
fn text_of(attributes: &[Attribute], word: &str) -> Option<String> {
    let mut found = None;
    for attribute in attributes.iter().filter(|it| it.path().is_ident("serde")) {
        let _ = attribute.parse_nested_meta(|meta| {
            if meta.input.peek(syn::Token![=]) {
                let value: Lit = meta.value()?.parse()?;
                if let (true, Lit::Str(text)) = (meta.path.is_ident(word), value) {
                    found = Some(text.value());
                }
            }
            Ok(())
        });
    }
    found
}

/// The comment of an item, in one line.
fn comment(attributes: &[Attribute]) -> String {
    let lines = attributes.iter().filter_map(|attribute| {
        let Meta::NameValue(it) = &attribute.meta else {
            return None;
        };
        let Expr::Lit(literal) = &it.value else {
            return None;
        };
        match (&literal.lit, it.path.is_ident("doc")) {
            (Lit::Str(text), true) => Some(text.value().trim().to_owned()),
            _ => None,
        }
    });
    lines
        .collect::<Vec<_>>()
        .join(" ")
        .trim_end_matches('.')
        .replace('|', "\\|")
}
