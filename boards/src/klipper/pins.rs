//! Pins as a configuration writes them: signs, a chip, and a name or an alias.

use std::collections::BTreeMap;

use crate::{Fault, Pin, Place, SignedPin};

use super::configuration::{Configuration, Value};

/// What a description of a pin means.
#[derive(Debug, Clone, PartialEq, Eq)]
pub(crate) enum Meaning {
    /// A pin of the board's chip.
    Own(SignedPin),
    /// A pin of another chip, or one that a section makes: `probe:z_virtual_endstop`.
    Foreign(String),
}

/// The aliases of `[board_pins]`.
#[derive(Debug, Default)]
pub(crate) struct Aliases(BTreeMap<String, (String, Place)>);

/// What may stand before the name of a pin.
const SIGNS: &str = "^~! \t";
/// The name of the board's chip.
const CHIP: &str = "mcu";

impl Aliases {
    /// Reads the aliases of the board's chip.
    pub(crate) fn of(configuration: &Configuration) -> Result<Self, Fault> {
        let mut aliases = Self::default();
        for section in &configuration.sections {
            let chips = section.value("mcu").map_or(CHIP, Value::text);
            let are_own = chips.split(',').any(|chip| chip.trim() == CHIP);
            if section.kind().0 != "board_pins" || !are_own {
                continue;
            }
            for value in section.values(|key| key == "aliases" || key.starts_with("aliases_")) {
                for line in &value.lines {
                    let given = line.text.split(',').map(str::trim);
                    for alias in given.filter(|alias| !alias.is_empty()) {
                        let (name, pin) = alias.split_once('=').ok_or_else(|| {
                            let message = format!("{alias:?} is no alias: name=pin is wanted");
                            line.place.fault(message)
                        })?;
                        let alias = (pin.trim().to_owned(), line.place.clone());
                        aliases.0.insert(name.trim().to_owned(), alias);
                    }
                }
            }
        }
        Ok(aliases)
    }

    /// Returns what the description of a pin means.
    pub(crate) fn meaning(&self, value: &Value) -> Result<Meaning, Fault> {
        let (text, place) = (value.text(), value.place());
        let name = text.trim_start_matches(|c: char| SIGNS.contains(c));
        let signs: String = text[..text.len() - name.len()].split_whitespace().collect();
        let name = match name.split_once(':') {
            None => name,
            Some((chip, name)) if chip.trim() == CHIP => name.trim(),
            Some(_) => return Ok(Meaning::Foreign(name.to_owned())),
        };
        let signed = format!("{signs}{}", self.pin(name, place)?).parse();
        signed
            .map(Meaning::Own)
            .map_err(|error: String| place.fault(error))
    }

    /// Returns the pin of a name of the chip, or of an alias.
    fn pin(&self, name: &str, place: &Place) -> Result<Pin, Fault> {
        let (of_chip, place) = match self.0.get(name) {
            None => (name, place),
            Some((reserved, _)) if reserved.starts_with('<') => {
                let message = format!("{name} is no pin but reserved: {reserved}");
                return Err(place.fault(message));
            }
            Some((pin, place_of_alias)) => (pin.as_str(), place_of_alias),
        };
        let pin = of_chip.starts_with('P').then(|| of_chip.parse());
        pin.and_then(Result::ok).ok_or_else(|| {
            let message = format!(
                "{of_chip:?} is neither a pin of an STM32, as PA3 is, nor an alias of [board_pins]"
            );
            place.fault(message)
        })
    }
}
