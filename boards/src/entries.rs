//! A file as a list of keys with their values, each with the line it is in.

use std::{
    collections::BTreeMap,
    error, fmt, fs,
    path::{Path, PathBuf},
    sync::Arc,
};

use toml::de::{DeTable, DeValue};

/// A place in a file.
#[derive(Debug, Clone, PartialEq, Eq)]
pub struct Place {
    file: Arc<Path>,
    line: usize,
}

/// What is wrong in a file, and where.
#[derive(Debug, Clone, PartialEq, Eq)]
pub struct Fault {
    place: Place,
    message: String,
}

impl Place {
    /// Returns the place of a file as a whole.
    pub fn of_file(file: &Path) -> Self {
        Self::of_line(&Arc::from(file), 1)
    }

    /// Returns the place of a line, counted from 1.
    pub fn of_line(file: &Arc<Path>, line: usize) -> Self {
        let file = file.clone();
        Self { file, line }
    }

    /// Returns whether the place is in the same file as another one.
    pub(crate) fn is_beside(&self, other: &Self) -> bool {
        self.file == other.file
    }

    /// Returns a fault at this place.
    pub fn fault(&self, message: impl Into<String>) -> Fault {
        Fault {
            place: self.clone(),
            message: message.into(),
        }
    }
}

impl Fault {
    /// Returns a fault of a file as a whole.
    pub(crate) fn of_file(file: &Path, message: impl Into<String>) -> Self {
        Place::of_file(file).fault(message)
    }
}

impl Fault {
    /// Returns the fault with more words.
    #[must_use]
    pub(crate) fn and(mut self, words: &str) -> Self {
        self.message.push_str(words);
        self
    }
}

impl fmt::Display for Fault {
    fn fmt(&self, to: &mut fmt::Formatter<'_>) -> fmt::Result {
        let Place { file, line } = &self.place;
        write!(to, "{}:{line}: {}", file.display(), self.message)
    }
}

impl error::Error for Fault {}

/// A value of a file.
#[derive(Debug, Clone, PartialEq, Eq)]
pub(crate) enum Value {
    /// A text.
    Text(String),
    /// A number.
    Number(u32),
    /// A truth value.
    Truth(bool),
    /// A list of texts.
    Texts(Vec<String>),
}

/// A value with its place.
#[derive(Debug, Clone, PartialEq, Eq)]
pub(crate) struct Entry {
    pub(crate) value: Value,
    pub(crate) place: Place,
}

impl Entry {
    /// Returns the text.
    pub(crate) fn text(&self) -> Result<&str, Fault> {
        match &self.value {
            Value::Text(text) => Ok(text),
            _ => Err(self.place.fault("a text is wanted here, in quotes")),
        }
    }

    /// Returns the number.
    pub(crate) fn number(&self) -> Result<u32, Fault> {
        match self.value {
            Value::Number(number) => Ok(number),
            _ => Err(self.place.fault("a whole number is wanted here")),
        }
    }

    /// Returns the truth value.
    pub(crate) fn truth(&self) -> Result<bool, Fault> {
        match self.value {
            Value::Truth(truth) => Ok(truth),
            _ => Err(self.place.fault("`true` or `false` is wanted here")),
        }
    }

    /// Returns the list.
    pub(crate) fn texts(&self) -> Result<&[String], Fault> {
        match &self.value {
            Value::Texts(texts) => Ok(texts),
            _ => Err(self.place.fault("a list of texts is wanted here: [\"…\"]")),
        }
    }
}

/// The keys of a file, those of tables with dots: `axes.X.step`.
#[derive(Debug, Clone, Default)]
pub(crate) struct Entries(BTreeMap<String, Entry>);

impl Entries {
    /// Reads a file, with what it takes from the file it is `like`.
    pub(crate) fn read(path: &Path) -> Result<Self, Fault> {
        let mut chain = vec![path.to_path_buf()];
        let mut nearest = Self::read_one(path)?;
        let mut model = nearest.0.remove("like");
        let mut files = vec![nearest];
        while let Some(like) = model {
            let next = beside(path, like.text()?);
            if chain.contains(&next) {
                return Err(like.place.fault("a board cannot be like itself"));
            }
            if !next.is_file() {
                let message = format!("there is no board {:?} beside this file", like.text()?);
                return Err(like.place.fault(message));
            }
            let mut inherited = Self::read_one(&next)?;
            model = inherited.0.remove("like");
            files.push(inherited);
            chain.push(next);
        }
        let mut all = Self::default();
        for nearer in files.iter().rev() {
            all.drop_void(nearer);
            all.replace_with(nearer);
        }
        Ok(all)
    }

    /// Drops what is void with a nearer file: that there is no EEPROM where that file has one, and what had been taken
    /// away with it; the file for a bootloader that is not there.
    fn drop_void(&mut self, nearer: &Self) {
        for (key, _) in nearer.iter() {
            if let Some((axes, _)) = key.split_once("eeprom.")
                && self.take(&format!("{axes}eeprom")).is_some()
            {
                self.take_all(&format!("{axes}eeprom."));
            }
        }
        let kib = nearer.get("bootloader.kib");
        if kib.is_some_and(|entry| entry.value == Value::Number(0)) {
            self.take("bootloader.file");
            self.take("bootloader.uf2");
        }
    }

    fn read_one(path: &Path) -> Result<Self, Fault> {
        let text = fs::read_to_string(path)
            .map_err(|error| Fault::of_file(path, format!("cannot be read: {error}")))?;
        let file: Arc<Path> = Arc::from(path);
        let place = |offset: usize| Place {
            file: file.clone(),
            line: 1 + text[..offset].matches('\n').count(),
        };
        let table = DeTable::parse(&text).map_err(|error| {
            let offset = error.span().map_or(0, |span| span.start);
            place(offset).fault(error.message().to_owned())
        })?;
        let mut entries = Self::default();
        entries.add("", table.get_ref(), &place)?;
        entries.refuse_misplaced()?;
        Ok(entries)
    }

    /// Refuses keys of no table in a table: a line below a `[table]` belongs to it, which is easily forgotten.
    fn refuse_misplaced(&self) -> Result<(), Fault> {
        for (key, entry) in self.iter() {
            let mut segments = key.split('.').skip(1);
            if let Some(above) = segments.find(|segment| TOP.contains(segment)) {
                let message =
                    format!("`{above}` belongs above the first [table], here it is `{key}`");
                return Err(entry.place.fault(message));
            }
        }
        Ok(())
    }

    fn add(
        &mut self,
        prefix: &str,
        table: &DeTable<'_>,
        place: &dyn Fn(usize) -> Place,
    ) -> Result<(), Fault> {
        for (key, value) in table {
            let name = format!("{prefix}{}", key.get_ref());
            let place_of_key = place(key.span().start);
            if let Some(table) = value.get_ref().as_table() {
                self.add(&format!("{name}."), table, place)?;
                continue;
            }
            let value = read_value(value.get_ref()).ok_or_else(|| {
                let message = format!(
                    "`{name}` cannot be {}: there are texts, whole numbers from 0 to {}, lists of texts, true and false",
                    described(value.get_ref()),
                    u32::MAX
                );
                place_of_key.fault(message)
            })?;
            let place = place_of_key;
            self.0.insert(name, Entry { value, place });
        }
        Ok(())
    }

    /// Takes the entry of a key.
    pub(crate) fn take(&mut self, key: &str) -> Option<Entry> {
        self.0.remove(key)
    }

    /// Takes all entries whose keys begin with a prefix, without it.
    pub(crate) fn take_all(&mut self, prefix: &str) -> Self {
        let (taken, left) = std::mem::take(&mut self.0)
            .into_iter()
            .partition(|(key, _)| key.starts_with(prefix));
        self.0 = left;
        let taken: BTreeMap<String, Entry> = taken;
        let short = |(key, entry): (String, Entry)| (key[prefix.len()..].to_owned(), entry);
        Self(taken.into_iter().map(short).collect())
    }

    /// Takes all entries whose keys begin with a prefix.
    pub(crate) fn take_group(&mut self, prefix: &str) -> Self {
        let short = self.take_all(prefix).0.into_iter();
        Self(
            short
                .map(|(key, entry)| (format!("{prefix}{key}"), entry))
                .collect(),
        )
    }

    /// Returns the entry of a key.
    pub(crate) fn get(&self, key: &str) -> Option<&Entry> {
        self.0.get(key)
    }

    /// Puts other entries over those of the same keys.
    pub(crate) fn replace_with(&mut self, others: &Self) {
        let others = others.0.iter();
        self.0
            .extend(others.map(|(key, entry)| (key.clone(), entry.clone())));
    }

    /// Returns the entries.
    pub(crate) fn iter(&self) -> impl Iterator<Item = (&str, &Entry)> {
        self.0.iter().map(|(key, entry)| (key.as_str(), entry))
    }

    /// Returns the place of the first entry whose key begins with a prefix.
    pub(crate) fn place_of(&self, prefix: &str) -> Option<&Place> {
        let mut entries = self.iter();
        let (_, entry) = entries.find(|(key, _)| key.starts_with(prefix))?;
        Some(&entry.place)
    }

    /// Refuses what is left: keys that nobody has asked for. Told are the known ones of the same table.
    pub(crate) fn refuse_rest(&self, known: &[&str]) -> Result<(), Fault> {
        let Some((key, entry)) = self.iter().next() else {
            return Ok(());
        };
        let table = key.rfind('.').map_or("", |dot| &key[..=dot]);
        let of_table = known.iter().filter_map(|known| known.strip_prefix(table));
        let of_table: Vec<_> = of_table.collect();
        let message = match of_table.as_slice() {
            [] => format!("`{key}` is not known; tables are {}", TABLES.join(", ")),
            of_table => format!(
                "`{key}` is not known; known there are {}",
                of_table.join(", ")
            ),
        };
        Err(entry.place.fault(message))
    }
}

/// The tables.
const TABLES: [&str; 8] = [
    "serial",
    "axes",
    "outputs",
    "inputs",
    "eeprom",
    "at_boot",
    "labels",
    "with_4_axes and more",
];
/// Keys that stand above the tables, but for `name`.
pub(crate) const TOP: [&str; 13] = [
    "about",
    "like",
    "sources",
    "chip",
    "crystal_mhz",
    "crystal_bypassed",
    "qemu",
    "link",
    "bootloader",
    "dfu",
    "drive",
    "debug_pins",
    "polled",
];

/// Returns the path of a board beside a file.
fn beside(path: &Path, name: &str) -> PathBuf {
    path.with_file_name(format!("{name}.toml"))
}

/// What a value is that cannot be read, with its article.
fn described(value: &DeValue<'_>) -> String {
    match value {
        DeValue::Integer(number) => number.as_str().to_owned(),
        DeValue::Array(_) => "a list of anything else".to_owned(),
        _ => format!("a {}", value.type_str()),
    }
}

fn read_value(value: &DeValue<'_>) -> Option<Value> {
    if let Some(text) = value.as_str() {
        return Some(Value::Text(text.to_owned()));
    }
    if let Some(truth) = value.as_bool() {
        return Some(Value::Truth(truth));
    }
    if let Some(number) = value.as_integer() {
        let number = u32::from_str_radix(number.as_str(), number.radix());
        return number.ok().map(Value::Number);
    }
    let texts = value.as_array()?.iter();
    let texts = texts.map(|text| text.get_ref().as_str().map(str::to_owned));
    texts.collect::<Option<Vec<_>>>().map(Value::Texts)
}
