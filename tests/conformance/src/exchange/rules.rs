//! Single lines: what they say, and what Grbl does for them.

use leadscrew::gcode::LineError;

use super::{received::ReceivedLine, status::numbers};
use crate::deviation::Deviation;
use simulation::sender;

/// Whether two lines differ because the two machines are in different places or one machine is locked.
pub(super) fn is_consequence(ours: &str, theirs: &str) -> bool {
    let is_lock = |text: &str| ["ok", "error:9", "error:8"].contains(&text);
    let is_list =
        |text: &str| (text.starts_with('[') && !text.starts_with("[MSG")) || text.starts_with('$');
    let is_optional = |text: &str| text.is_empty() || text == "[MSG:Caution: Unlocked]";
    (is_lock(ours) && is_lock(theirs))
        || (is_list(ours) && is_list(theirs))
        || (is_optional(ours) && is_optional(theirs))
}

/// The difference of the coordinates of two messages of one kind, mm, also where they are in inches.
pub(super) fn displacement(ours: &str, theirs: &str) -> Option<Vec<f64>> {
    let read = |text: &str| -> Option<(String, Vec<f64>, f64)> {
        let (name, tail) = text.strip_prefix('[')?.strip_suffix(']')?.split_once(':')?;
        let is_place = name.starts_with('G') && name != "GC" || name == "PRB" || name == "TLO";
        let (tail, result) = tail.split_once(':').unwrap_or((tail, ""));
        let decimals = tail.rsplit_once('.')?.1.len();
        let unit_mm = if decimals == 4 { 25.4 } else { 1.0 };
        is_place.then(|| numbers(tail).map(|at| (format!("{name}{result}"), at, unit_mm)))?
    };
    let (our_name, ours, _) = read(ours)?;
    let (their_name, theirs, unit_mm) = read(theirs)?;
    let is_same = our_name == their_name && ours.len() == theirs.len();
    is_same.then(|| {
        (ours.iter().zip(&theirs))
            .map(|(a, b)| (a - b) * unit_mm)
            .collect()
    })
}

/// `[OPT:…]` with Grbl's letters and more, and larger buffers.
pub(super) fn is_build_options(ours: &str, theirs: &str) -> bool {
    let read = |text: &str| -> Option<(String, u32, u32)> {
        let inner = text.strip_prefix("[OPT:")?.strip_suffix(']')?.to_owned();
        let mut parts = inner.split(',');
        let letters = parts.next()?.to_owned();
        let (blocks, bytes) = (parts.next()?.parse().ok()?, parts.next()?.parse().ok()?);
        parts.next().is_none().then_some((letters, blocks, bytes))
    };
    match (read(ours), read(theirs)) {
        (Some((ours, blocks, bytes)), Some((theirs, their_blocks, their_bytes))) => {
            theirs.chars().all(|letter| ours.contains(letter))
                && blocks >= their_blocks
                && bytes >= their_bytes
        }
        _ => false,
    }
}

/// Two `$G` that differ in nothing but a `T0` of Grbl's.
pub(crate) fn differs_in_tool(ours: &str, theirs: &str) -> bool {
    tools(ours, theirs).is_some_and(|(ours, theirs)| theirs == "T0" && ours != "T0")
}

/// The tools of two `$G` that are otherwise the same.
pub(crate) fn tools(ours: &str, theirs: &str) -> Option<(String, String)> {
    let without_tool = |text: &str| -> Option<(String, String)> {
        let words = text.strip_prefix("[GC:")?.split(' ');
        let (tool, others): (Vec<_>, Vec<_>) = words.partition(|word| word.starts_with('T'));
        Some((others.join(" "), tool.concat()))
    };
    match (without_tool(ours), without_tool(theirs)) {
        (Some((ours, tool)), Some((theirs, their_tool))) => {
            (ours == theirs).then_some((tool, their_tool))
        }
        _ => None,
    }
}

/// Two `$G` that differ in nothing but an `M7` of ours.
pub(super) fn differs_in_mist(ours: &str, theirs: &str) -> bool {
    ours.starts_with("[GC:")
        && (ours.replace(" M7 M8 ", " M8 ") == theirs || ours.replace(" M7 ", " M9 ") == theirs)
        && ours != theirs
}

/// Whether a line moves along an arc: only those have a centre or a radius.
pub(super) fn is_arc(line: &str) -> bool {
    !line.starts_with('$') && line.contains(['I', 'J', 'K', 'R'])
}

/// Whether Grbl writes its EEPROM for a line.
pub(super) fn stores(line: &str) -> bool {
    let g = |wanted: f64| sender::g_numbers(line.as_bytes()).any(|number| number == wanted);
    match line.strip_prefix('$') {
        Some(statement) => statement.contains('=') && !statement.starts_with("J="),
        None => g(10.0) || g(28.1) || g(30.1),
    }
}

/// Whether a line sets what Grbl stores and makes no sense: no steps, no speed, no acceleration,
/// no travel, or an integer that does not fit.
pub(super) fn is_setting_out_of_range(line: &str) -> bool {
    let Some((number, value)) = line
        .strip_prefix('$')
        .and_then(|statement| statement.split_once('='))
    else {
        return false;
    };
    let (Ok(number), Ok(value)) = (number.parse::<u16>(), value.parse::<f64>()) else {
        return false;
    };
    match number {
        100..=135 | 24 | 25 => !(0.001..=1e6).contains(&value),
        0..=10 | 23 | 26 => value > 255.0,
        _ => value > 1e6,
    }
}

/// Why a `$` statement is refused of which Grbl takes a part.
pub(super) fn of_dollar(line: &str, our: &ReceivedLine) -> Option<Deviation> {
    let is_unknown = our.is_error(LineError::InvalidStatement);
    if is_setting_rounded(line) && (is_unknown || our.is_error(LineError::SettingOutOfRange)) {
        return Some(Deviation::SettingNumbers);
    }
    let exists = line.starts_with("$N0=") || line.starts_with("$N1=");
    (is_unknown && line.starts_with("$N") && !exists).then_some(Deviation::StartupLines)
}

/// Whether a `$` statement gives a setting a number that the setting cannot store as written.
fn is_setting_rounded(line: &str) -> bool {
    let statement = line.strip_prefix('$').map(|it| it.trim_start_matches('N'));
    let Some((number, value)) = statement.and_then(|statement| statement.split_once('=')) else {
        return false;
    };
    if number.contains('.') {
        return true;
    }
    let (Ok(number), Ok(value)) = (number.parse::<u16>(), value.parse::<f64>()) else {
        return false;
    };
    match number {
        13 | 20 | 21 | 32 => value != 0.0 && value != 1.0,
        0..=10 | 22 | 23 | 26 | 30 | 31 => value.fract() != 0.0,
        _ => value > 0.0 && value < 1.0e-6,
    }
}

#[cfg(test)]
mod tests {
    use super::*;

    #[test]
    fn only_numbers_that_a_setting_cannot_have_are_excused() {
        for (line, is_rounded) in [
            ("$32=2", true),
            ("$4=2", false),
            ("$10=2.5", true),
            ("$10=2", false),
            ("$100=2.5", false),
            ("$11=0.0000001", true),
            ("$12.5=1", true),
            ("$N0.5=G21", true),
            ("$N0=G1X1.5", false),
        ] {
            assert_eq!(is_setting_rounded(line), is_rounded, "{line}");
        }
    }

    #[test]
    fn only_larger_buffers_are_excused() {
        assert!(is_build_options("[OPT:VNM,127,1024]", "[OPT:V,15,128]"));
        assert!(!is_build_options("[OPT:VNM,14,1024]", "[OPT:V,15,128]"));
        assert!(!is_build_options("[OPT:N,127,1024]", "[OPT:V,15,128]"));
        assert!(!is_build_options("[OPT:V,127]", "[OPT:V,15,128]"));
    }

    #[test]
    fn only_a_kept_tool_is_excused() {
        assert!(differs_in_tool("[GC:G0 M5 T3 F0]", "[GC:G0 M5 T0 F0]"));
        assert!(!differs_in_tool("[GC:G0 M5 T0 F0]", "[GC:G0 M5 T3 F0]"));
        assert!(!differs_in_tool("[GC:G1 M5 T3 F0]", "[GC:G0 M5 T0 F0]"));
        assert!(!differs_in_tool("ok", "ok"));
    }

    #[test]
    fn only_mist_of_ours_is_excused() {
        assert!(differs_in_mist("[GC:G0 M5 M7 T0]", "[GC:G0 M5 M9 T0]"));
        assert!(differs_in_mist("[GC:G0 M5 M7 M8 T0]", "[GC:G0 M5 M8 T0]"));
        assert!(!differs_in_mist("[GC:G0 M5 M7 M8 T0]", "[GC:G0 M5 M9 T0]"));
        assert!(!differs_in_mist("[GC:G0 M5 M9 T0]", "[GC:G0 M5 M9 T0]"));
        assert!(!differs_in_mist("[GC:G1 M5 M7 T0]", "[GC:G0 M5 M9 T0]"));
    }

    #[test]
    fn only_senseless_settings_are_excused() {
        for line in ["$100=0", "$110=0", "$122=0.0", "$1=256", "$26=300"] {
            assert!(is_setting_out_of_range(line), "{line}");
        }
        for line in ["$100=80", "$1=255", "$30=1000", "$27=0", "$N0=G0", "$11=0"] {
            assert!(!is_setting_out_of_range(line), "{line}");
        }
    }

    #[test]
    fn what_takes_grbl_long_is_known() {
        for line in ["$110=5", "$N0=G20", "$RST=*", "$I=x", "G10L2P1X1", "G28.1"] {
            assert!(stores(line), "{line}");
        }
        for line in ["$J=X1F100", "$$", "G28", "G0X1"] {
            assert!(!stores(line), "{line}");
        }
    }
}
