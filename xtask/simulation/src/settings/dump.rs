//! Settings in a text: what `$$` lists, and what a terminal or a sender has kept around it.
//!
//! Lists of Grbl 0.9 and 1.1, grblHAL, `FluidNC` and this firmware are read as they are. The welcome line, `ok`,
//! messages, reports and comments are skipped. So are the marks of logs before a line: `<` for a received line, `>`
//! for a sent line.

use leadscrew::settings::Setting;

/// `$n=value`, where there is a setting with this number.
#[derive(Debug, Clone, PartialEq, Eq)]
pub struct Entry {
    /// The number.
    pub number: u16,
    /// The value as it is written, without blanks.
    pub value: String,
    /// The line of the file, counted from 1; none for a setting from the command line.
    pub line: Option<usize>,
}

impl Entry {
    /// The setting with the number.
    pub fn setting(&self) -> Setting {
        Setting::with_number(self.number).expect("an entry is of a setting")
    }

    /// The text of the assignment: `110=5000`.
    pub fn statement(&self) -> String {
        format!("{}={}", self.number, self.value)
    }
}

/// The contents of a text.
#[derive(Debug, Default, PartialEq, Eq)]
pub struct Dump {
    /// The settings, in the order of the lines.
    pub entries: Vec<Entry>,
    /// Names of other machines' settings, `$14` or `$Sta/SSID`, each once.
    pub others: Vec<String>,
    /// Numbers of the lines that cannot be read, and what is wrong with each.
    pub unreadable: Vec<(usize, String)>,
}

/// A line of a text.
#[derive(Debug, PartialEq)]
pub(super) enum Line<'a> {
    /// Nothing that is a setting.
    Nothing,
    /// A setting with its value.
    Setting(u16, String),
    /// A setting that another machine has.
    Other(&'a str),
    /// An error, with the reason.
    Unreadable(String),
}

impl Dump {
    /// Reads a text.
    pub fn read(text: &str) -> Self {
        let text = text.trim_start_matches('\u{feff}').replace("\r\n", "\n");
        let mut dump = Self::default();
        for (line, text) in (1..).zip(text.split(['\n', '\r'])) {
            match Line::read(text) {
                Line::Nothing => {}
                Line::Setting(number, value) => dump.entries.push(Entry {
                    number,
                    value,
                    line: Some(line),
                }),
                Line::Other(name) if dump.others.iter().any(|other| other == name) => {}
                Line::Other(name) => dump.others.push(name.into()),
                Line::Unreadable(reason) => dump.unreadable.push((line, reason)),
            }
        }
        dump
    }

    /// The list of other machines' settings, to read; none without any.
    pub fn left_out(&self) -> Option<String> {
        let names = Self::in_ranges(&self.others).join(", ");
        match self.others.len() {
            0 => None,
            1 => Some(format!(
                "1 setting that this machine does not have: {names}"
            )),
            count => Some(format!(
                "{count} settings that this machine does not have: {names}"
            )),
        }
    }

    /// Names with each row of numbers as one: `$14`, `$33-$36`.
    pub fn in_ranges(names: &[String]) -> Vec<String> {
        let number = |name: &String| name.strip_prefix('$')?.parse::<u32>().ok();
        let mut numbers: Vec<u32> = names.iter().filter_map(number).collect();
        numbers.sort_unstable();
        let rows = numbers.chunk_by(|a, b| a + 1 == *b);
        let rows = rows.flat_map(|row| match row {
            [first, _, .., last] => vec![format!("${first}-${last}")],
            few => few.iter().map(|number| format!("${number}")).collect(),
        });
        let words = names.iter().filter(|name| number(name).is_none()).cloned();
        rows.chain(words).collect()
    }
}

impl<'a> Line<'a> {
    /// Reads a line.
    pub(super) fn read(text: &'a str) -> Self {
        let text = text.trim();
        let text = text.strip_prefix("< ").unwrap_or(text);
        let text = text
            .split([';', '#', '('])
            .next()
            .unwrap_or_default()
            .trim();
        if is_around_settings(text) {
            return Self::Nothing;
        }
        let Some((name, value)) = text.strip_prefix('$').and_then(|text| text.split_once('='))
        else {
            return Self::Unreadable(format!("{text:?} is no setting: write it as $110=5000"));
        };
        let (name, whole) = (name.trim(), &text[..=name.len()]);
        let is_number = !name.is_empty() && name.bytes().all(|byte| byte.is_ascii_digit());
        let setting = name
            .parse()
            .ok()
            .filter(|_| is_number)
            .and_then(Setting::with_number);
        match setting {
            Some(setting) => {
                let value = value.split_whitespace().collect();
                Self::Setting(setting.number(), value)
            }
            None if is_number || is_named(name) => Self::Other(whole.trim_end()),
            None => Self::Unreadable(format!("there is no setting ${name}")),
        }
    }
}

/// Whether a line, without its comment, is one that stands around settings.
fn is_around_settings(text: &str) -> bool {
    let begins = |with: &str| {
        let start = text.get(..with.len());
        start.is_some_and(|start| start.eq_ignore_ascii_case(with))
    };
    text.is_empty()
        || text.starts_with(['[', '<', '>', '%'])
        || ["ok", "$$", "$+"]
            .iter()
            .any(|line| text.eq_ignore_ascii_case(line))
        || begins("grbl")
        || begins("ALARM:")
}

/// Whether a name is one of `FluidNC`'s settings (`Sta/SSID`) or a startup line (`N0`).
fn is_named(name: &str) -> bool {
    let startup = name.strip_prefix('N').unwrap_or_default();
    name.contains('/') || (startup.len() == 1 && startup.bytes().all(|byte| byte.is_ascii_digit()))
}

#[cfg(test)]
mod tests {
    use super::*;

    fn entries(text: &str) -> Vec<String> {
        let dump = Dump::read(text);
        assert_eq!(dump.unreadable, [], "{text}");
        dump.entries.iter().map(Entry::statement).collect()
    }

    #[test]
    fn settings_are_found_as_each_firmware_and_sender_writes_them() {
        for (line, statement) in [
            ("$110=500.000", "110=500.000"),
            ("$3=0 (dir port invert mask:00000000)", "3=0"),
            ("$1 = 25    (Step idle delay, milliseconds)", "1=25"),
            ("  $ 0 = 10.0\t; 0 - Step pulse time", "0=10.0"),
            ("< $0=20.0        (Sets time length per step.)", "0=20.0"),
            ("$12=0.002 # arcs", "12=0.002"),
        ] {
            assert_eq!(entries(line), [statement], "{line}");
        }
    }

    #[test]
    fn what_stands_around_settings_is_skipped() {
        for line in [
            "",
            "   ",
            "ok",
            "%",
            "$$",
            "> $$",
            "; $110=1",
            "(mine)",
            "Grbl 1.1h ['$' for help]",
            "GrblHAL 1.1f ['$' or '$HELP' for help]",
            "Grbl 3.9 [FluidNC v3.9.1 (wifi) '$' for help]",
            "[MSG:'$H'|'$X' to unlock]",
            "[G54:0.000,0.000,0.000]",
            "<Idle|MPos:0.000,0.000,0.000|FS:0,0>",
            "ALARM:1",
        ] {
            assert_eq!(Dump::read(line), Dump::default(), "{line}");
        }
    }

    #[test]
    fn every_line_ending_counts_one_line() {
        let dump = Dump::read("\u{feff}$0=10\r\n\r\n$1=25\r$2=0\nspeed\n");
        let lines: Vec<_> = dump.entries.iter().map(|entry| entry.line).collect();
        assert_eq!(lines, [Some(1), Some(3), Some(4)]);
        assert_eq!(dump.unreadable.len(), 1);
        assert_eq!(dump.unreadable[0].0, 5);
    }

    #[test]
    fn settings_of_other_machines_are_listed_once_and_in_rows() {
        let dump =
            Dump::read("$36=1\n$14=7\n$300=mill\n$34=2\n$14=0\n$35=\n$Sta/SSID=a\n$N0=G20\n");
        assert_eq!(dump.entries, []);
        assert_eq!(
            dump.left_out().unwrap(),
            "7 settings that this machine does not have: $14, $34-$36, $300, $Sta/SSID, $N0"
        );
        assert_eq!(Dump::read("$0=10").left_out(), None);
        let one = Dump::read("$14=1").left_out().unwrap();
        assert_eq!(one, "1 setting that this machine does not have: $14");
    }

    #[test]
    fn a_mistake_is_reported_with_its_line() {
        for (text, reason) in [
            ("$11O=5", "there is no setting $11O"),
            ("$=5", "there is no setting $"),
            ("110=5", "is no setting"),
            ("$110", "is no setting"),
            ("error:8", "is no setting"),
        ] {
            let dump = Dump::read(text);
            assert!(dump.unreadable[0].1.contains(reason), "{text}: {dump:?}");
        }
    }
}
