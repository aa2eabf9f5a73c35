//! What a machine says of its settings: `$EG` has the groups, `$ES` the settings, in grblHAL's form.

use leadscrew::settings::Setting;

use crate::Line;

/// How a value is written.
#[derive(Debug, Clone, PartialEq, Eq)]
pub enum Kind {
    /// 0 or 1.
    Flag,
    /// A sum of bits, of which each has a name; `N/A` where it has no meaning.
    Bits(Vec<String>),
    /// One of the numbers from 0 on, of which each has a name.
    Choice(Vec<String>),
    /// A bit for each axis.
    Axes,
    /// A number.
    Number,
    /// Anything else.
    Text,
}

/// A setting.
#[derive(Debug, Clone, PartialEq)]
pub struct Description {
    /// The number behind `$`.
    pub number: u16,
    /// That of its group.
    pub group: u16,
    /// The meaning of the value.
    pub name: String,
    /// The unit of the value; empty without.
    pub unit: String,
    /// How the value is written.
    pub kind: Kind,
    /// The least value.
    pub least: Option<f64>,
    /// The greatest value.
    pub most: Option<f64>,
}

/// The settings of a machine, and their groups.
#[derive(Debug, Clone, Default, PartialEq)]
pub struct Catalogue {
    /// Number and name of each group.
    pub groups: Vec<(u16, String)>,
    /// The settings, in the order of their numbers.
    pub settings: Vec<Description>,
}

impl Description {
    /// Reads a line of `$ES`.
    fn read(line: &str) -> Option<Self> {
        let Line::Answer("SETTING", text) = Line::read(line) else {
            return None;
        };
        let mut fields = text.split('|');
        let mut next = || fields.next().unwrap_or_default();
        let (number, group) = (next().parse().ok()?, next().parse().ok()?);
        let (name, unit, kind, format) = (next(), next(), next(), next());
        let names = || format.split(',').map(str::to_owned).collect();
        Some(Self {
            number,
            group,
            name: name.into(),
            unit: unit.into(),
            kind: match kind {
                "0" => Kind::Flag,
                "1" | "2" => Kind::Bits(names()),
                "3" => Kind::Choice(names()),
                "4" => Kind::Axes,
                "5" | "6" => Kind::Number,
                _ => Kind::Text,
            },
            least: next().parse().ok(),
            most: next().parse().ok(),
        })
    }

    /// What is wrong with a value, in words; the machine may know more.
    #[must_use]
    pub fn fault(&self, value: &str) -> Option<String> {
        if matches!(self.kind, Kind::Text) {
            return None;
        }
        let Ok(number) = value.trim().parse::<f64>() else {
            return Some("a number is needed".into());
        };
        let is_below = self.least.is_some_and(|least| number < least);
        let is_above = self.most.is_some_and(|most| number > most);
        match (self.least, self.most) {
            (Some(least), _) if is_below => Some(format!("at least {least} is needed")),
            (_, Some(most)) if is_above => Some(format!("at most {most} is allowed")),
            _ if !number.is_finite() => Some("a number is needed".into()),
            _ => None,
        }
    }
}

impl Catalogue {
    /// Reads the answers to `$EG` and `$ES`.
    pub fn read<'a>(lines: impl IntoIterator<Item = &'a str>) -> Self {
        let mut catalogue = Self::default();
        for line in lines {
            if let Line::Answer("SETTINGGROUP", text) = Line::read(line) {
                let mut fields = text.split('|');
                let number = fields.next().and_then(|number| number.parse().ok());
                let name = fields.nth(1).map(str::to_owned);
                catalogue.groups.extend(number.zip(name));
            }
            catalogue.settings.extend(Description::read(line));
        }
        catalogue.settings.sort_by_key(|setting| setting.number);
        catalogue
    }

    /// Of a machine that says nothing of its settings, as Grbl 1.1: what the numbers mean here, where they are Grbl's.
    #[must_use]
    pub fn of_grbl() -> Self {
        const LAST: u16 = 132;
        let settings = Setting::all().filter(|setting| setting.number() <= LAST);
        let settings = settings.map(|setting| Description {
            number: setting.number(),
            group: 0,
            name: match setting.letter() {
                Some(letter) => format!("{}-axis {}", char::from(letter), setting.row.name),
                None => setting.row.name.into(),
            },
            unit: setting.row.unit.into(),
            kind: Kind::Number,
            least: None,
            most: None,
        });
        Self {
            groups: vec![(0, "Settings".into())],
            settings: settings.collect(),
        }
    }

    /// The groups that have settings, with these.
    pub fn by_group(&self) -> impl Iterator<Item = (&str, Vec<&Description>)> {
        let groups = self.groups.iter().map(|(number, name)| {
            let settings = self.settings.iter();
            let settings = settings.filter(|setting| setting.group == *number);
            (name.as_str(), settings.collect::<Vec<_>>())
        });
        groups.filter(|(_, settings)| !settings.is_empty())
    }
}

#[cfg(test)]
mod tests {
    use super::*;

    #[test]
    fn answers_of_grblhal_are_read() {
        let catalogue = Catalogue::read([
            "[SETTINGGROUP:1|0|General]",
            "[SETTINGGROUP:9|0|Empty]",
            "[SETTING:110|1|X-axis maximum rate|mm/min|6|#####0.000|0.5|100000]",
            "[SETTING:10|1|status report||1|Machine position,N/A,Buffer state||]",
            "[SETTING:341|1|tool change||3|Pause,Ignore||]",
            "[SETTING:300|1|host|name|7|x(32)|1|32]",
            "[SETTING:x|1|broken]",
            "ok",
        ]);
        let numbers: Vec<_> = { catalogue.settings.iter() }
            .map(|setting| setting.number)
            .collect();
        assert_eq!(numbers, [10, 110, 300, 341]);
        let [report, rate, host, change] = &catalogue.settings[..] else {
            panic!("{catalogue:?}")
        };
        let names = |names: &[&str]| names.iter().map(|name| (*name).to_owned()).collect();
        let bits = Kind::Bits(names(&["Machine position", "N/A", "Buffer state"]));
        assert_eq!(report.kind, bits);
        assert_eq!(change.kind, Kind::Choice(names(&["Pause", "Ignore"])));
        assert_eq!((rate.unit.as_str(), rate.least), ("mm/min", Some(0.5)));
        assert_eq!(host.fault("anything"), None);
        for (value, fault) in [
            ("500", None),
            ("0.1", Some("at least 0.5 is needed")),
            ("1e9", Some("at most 100000 is allowed")),
            ("fast", Some("a number is needed")),
        ] {
            assert_eq!(rate.fault(value).as_deref(), fault, "{value}");
        }
        let groups: Vec<_> = catalogue.by_group().collect();
        assert_eq!(groups.len(), 1);
        assert_eq!((groups[0].0, groups[0].1.len()), ("General", 4));
    }

    #[test]
    fn the_settings_of_grbl_are_known_without() {
        let catalogue = Catalogue::of_grbl();
        let settings: Vec<_> = catalogue.by_group().flat_map(|(_, it)| it).collect();
        let rate = settings.iter().find(|setting| setting.number == 111);
        assert!(rate.is_some_and(|it| it.name.starts_with("Y-axis ")));
        assert!(settings.iter().all(|setting| setting.number <= 132));
    }
}
