//! What a machine reports, in words: its state, its inputs and outputs, and the modes of `$G`.

/// A state in words, with its number where it has one: `Hold:0`.
#[must_use]
pub fn state_words(state: &str) -> &'static str {
    match state {
        "Idle" => "Idle",
        "Run" => "Running",
        "Hold:0" => "Hold: at rest",
        "Hold:1" | "Hold" => "Hold: slowing down",
        "Jog" => "Jogging",
        "Alarm" => "Alarm: locked",
        "Door:0" => "Door closed: resume to go on",
        "Door:1" => "Door open: at rest",
        "Door:2" => "Door open: slowing down",
        "Door:3" | "Door" => "Door closed: going on",
        "Check" => "Check: nothing moves",
        "Home" => "Homing",
        "Sleep" => "Asleep: reset to wake up",
        "Tool" => "Change of the tool",
        _ => "Unknown state",
    }
}

/// The inputs that are active, in words: of the letters of `Pn`.
#[must_use]
pub fn pin_words(pins: &str) -> String {
    let words = pins.chars().map(|pin| match pin {
        'P' => "probe".to_owned(),
        'D' => "door".into(),
        'H' => "hold button".into(),
        'R' => "reset button".into(),
        'S' => "start button".into(),
        axis => format!("limit {axis}"),
    });
    list(words)
}

/// What is on, in words: of the letters of `A`.
#[must_use]
pub fn accessory_words(accessories: &str) -> String {
    let words = accessories.chars().filter_map(|one| match one {
        'S' => Some("spindle clockwise".to_owned()),
        'C' => Some("spindle counterclockwise".into()),
        'F' => Some("flood".into()),
        'M' => Some("mist".into()),
        _ => None,
    });
    list(words)
}

fn list(words: impl Iterator<Item = String>) -> String {
    let words: Vec<_> = words.collect();
    if words.is_empty() {
        "none".into()
    } else {
        words.join(", ")
    }
}

/// The mode of a group, by its words as they come in `$G`.
fn mode(modes: &[String], is_of_group: impl Fn(&str) -> bool) -> String {
    let word = modes.iter().find(|word| is_of_group(word));
    word.cloned().unwrap_or_default()
}

/// Work system, unit, distances and tool, each nothing where `$G` has not told it.
#[must_use]
pub fn mode_words(modes: &[String]) -> [(&'static str, String); 4] {
    let system = mode(modes, |word| {
        let number = word.strip_prefix('G').and_then(|it| it.parse::<f64>().ok());
        number.is_some_and(|number| (54.0..60.0).contains(&number))
    });
    let unit = match mode(modes, |word| matches!(word, "G20" | "G21")).as_str() {
        "G20" => "inches (G20)".to_owned(),
        "G21" => "mm (G21)".into(),
        _ => String::new(),
    };
    let distances = match mode(modes, |word| matches!(word, "G90" | "G91")).as_str() {
        "G90" => "absolute (G90)".to_owned(),
        "G91" => "relative (G91)".into(),
        _ => String::new(),
    };
    let tool = mode(modes, |word| word.starts_with('T'));
    [
        ("Work system", system),
        ("Unit", unit),
        ("Distances", distances),
        ("Tool", tool),
    ]
}

/// A value as it is, and as it was set by a word of `$G`.
#[must_use]
pub fn with_set(now: f64, unit: &str, modes: &[String], letter: char) -> String {
    let set = mode(modes, |word| word.starts_with(letter));
    match set[set.len().min(1)..].parse::<f64>() {
        Ok(set) => format!("{now:.0} {unit}, set {set:.0}"),
        Err(_) => format!("{now:.0} {unit}"),
    }
}

#[cfg(test)]
mod tests {
    use super::*;

    #[test]
    fn states_inputs_outputs_and_modes_are_words() {
        assert_eq!(state_words("Hold:1"), "Hold: slowing down");
        assert_eq!(state_words("<b>"), "Unknown state");
        assert_eq!(pin_words("PXD"), "probe, limit X, door");
        assert_eq!(accessory_words("SFM"), "spindle clockwise, flood, mist");
        assert_eq!(accessory_words(""), "none");
        let modes = ["G0", "G54", "G17", "G21", "G91", "T3", "F100"].map(str::to_owned);
        let words = mode_words(&modes).map(|(_, word)| word);
        assert_eq!(words, ["G54", "mm (G21)", "relative (G91)", "T3"]);
        assert_eq!(with_set(50.0, "mm/min", &modes, 'F'), "50 mm/min, set 100");
        assert_eq!(with_set(0.0, "rpm", &modes, 'S'), "0 rpm");
    }
}
