//! The step rate that a firmware is proven for, in its image: `static PROVEN` of `src/board/proven.rs`.

use std::{fs, ops::Range, path::Path, sync::OnceLock};

use anyhow::{Context, Result, bail, ensure};
use leadscrew::{axis::AXES, settings::StepRate};
use object::{Object, ObjectSection, ObjectSymbol};
use schedule::{Report, Rule};
use serde_json::Value;

use crate::{
    boards::{self, Board},
    cargo,
    machine::BAUD,
    schedule::analyse,
};

/// The symbol of the two words, the mark and the rate in Hz.
const SYMBOL: &str = "PROVEN";
/// The mark.
const MARK: [u8; 4] = *b"PROV";
/// The report of the analysis, made by `cargo xtask schedule`.
pub(crate) const REPORT: &str = "docs/schedule.json";

/// Flaws that are told where the proof is only a step on the way.
const TOLD: usize = 3;

/// The step rate that is proven of an image by analysing it.
pub(crate) fn prove(elf: &Path, board: &Board) -> Result<u32> {
    rate(&analyse(elf, &board.name, None, Some(BAUD))?)
}

/// The rate that a report proves. That it is lower than the project asks for does not make it wrong.
fn rate(report: &Report) -> Result<u32> {
    let asks = |rule| matches!(rule, Rule::DeadlineMissed | Rule::Requirement);
    let rate = report.proven_step_rate_hz.get(&BAUD.to_string());
    let rate = rate.map_or(0, |rate| whole(*rate));
    let wrong: Vec<_> = report
        .flaws
        .iter()
        .filter(|flaw| rate == 0 || !asks(flaw.rule))
        .collect();
    if !wrong.is_empty() {
        let told = wrong.iter().take(TOLD).map(|flaw| {
            let place = flaw.place.frames.first();
            let place = place.map_or(String::new(), |place| format!(", {place}"));
            format!("\n- {}{place}", flaw.what)
        });
        let more = match wrong.len().saturating_sub(TOLD) {
            0 => String::new(),
            more => format!("\n- and {more} more"),
        };
        bail!(
            "the timing of the firmware cannot be proven{}{more}\n`cargo xtask schedule` tells everything",
            told.collect::<String>()
        );
    }
    ensure!(
        rate > 0,
        "the timing of the firmware is proven for no step rate"
    );
    Ok(rate)
}

/// What an image says that it is proven for.
pub(crate) fn read(elf: &Path) -> Result<StepRate> {
    let image = fs::read(elf).with_context(|| format!("cannot read {}", elf.display()))?;
    let place = place(&image).with_context(|| format!("{}", elf.display()))?;
    let word = image[place].first_chunk().context("half a word")?;
    Ok(StepRate::of_image(u32::from_le_bytes(*word)))
}

/// Writes what is proven into an image.
pub(crate) fn write(image: &mut [u8], hz: u32) -> Result<()> {
    let place = place(image)?;
    image[place].copy_from_slice(&hz.to_le_bytes());
    Ok(())
}

/// Where in the file the rate is.
fn place(image: &[u8]) -> Result<Range<usize>> {
    let file = object::File::parse(image).context("this is no ELF file")?;
    let symbol = file.symbols().find(|symbol| symbol.name() == Ok(SYMBOL));
    let symbol = symbol.with_context(|| format!("the image has no symbol {SYMBOL}"))?;
    let section = symbol.section_index().context("it is in no section")?;
    let section = file.section_by_index(section)?;
    let (offset, _) = section.file_range().context("it is not in the file")?;
    let start = (offset + symbol.address() - section.address()) as usize;
    let mark = image.get(start..start + MARK.len());
    ensure!(
        mark == Some(&MARK),
        "the image has another mark at {SYMBOL}: it is not one of this version"
    );
    let rate = start + MARK.len()..start + 2 * MARK.len();
    ensure!(rate.end <= image.len(), "the image ends within {SYMBOL}");
    Ok(rate)
}

/// What the firmware of the emulated board is proven for as the committed report says: for what
/// runs without an image, the simulator and the documents. A report is of one number of axes; with
/// others nothing is proven.
pub(crate) fn committed() -> StepRate {
    static COMMITTED: OnceLock<StepRate> = OnceLock::new();
    let read = || -> Result<u32> {
        let text = fs::read_to_string(cargo::root().join(REPORT))?;
        let (board, _) = boards::emulated()?;
        of_report(&text, &board.name)
    };
    *COMMITTED.get_or_init(|| read().map_or(StepRate::Unproven, StepRate::of_image))
}

/// The rate in a report, if it is one of the board with as many axes.
fn of_report(text: &str, board: &str) -> Result<u32> {
    let report: Value = serde_json::from_str(text)?;
    ensure!(report["board"] == board, "it is of another board");
    ensure!(report["axes"] == AXES, "it is of another number of axes");
    let rate = report["proven_step_rate_hz"][BAUD.to_string()].as_u64();
    Ok(whole(rate.context("it has no rate")? as u32))
}

/// The rate that is promised: whole thousands, so that it stays while code changes a little.
pub(crate) const fn whole(hz: u32) -> u32 {
    hz / 1000 * 1000
}

#[cfg(test)]
mod tests {
    use object::{
        Architecture, BinaryFormat, Endianness, SectionKind, SymbolFlags, SymbolKind, SymbolScope,
        write::{Object as Written, Symbol, SymbolSection},
    };
    use schedule::{Flaw, Place};
    use serde_json::json;

    use super::*;

    /// An ELF file with these bytes behind some others, under a name.
    fn image(name: &str, bytes: &[u8]) -> Vec<u8> {
        let mut file = Written::new(BinaryFormat::Elf, Architecture::Arm, Endianness::Little);
        let section = file.add_section(Vec::new(), b".rodata".to_vec(), SectionKind::ReadOnlyData);
        file.append_section_data(section, &[0xaa; 20], 4);
        let value = file.append_section_data(section, bytes, 4);
        file.add_symbol(Symbol {
            name: name.into(),
            value,
            size: bytes.len() as u64,
            kind: SymbolKind::Data,
            scope: SymbolScope::Linkage,
            weak: false,
            section: SymbolSection::Section(section),
            flags: SymbolFlags::None,
        });
        file.write().unwrap()
    }

    #[test]
    fn the_rate_is_written_where_it_is_read_and_nowhere_else() {
        let before = image(SYMBOL, b"PROV\0\0\0\0");
        let mut after = before.clone();
        write(&mut after, 0x0001_2345).unwrap();
        let rate = &after[place(&after).unwrap()];
        assert_eq!(rate, [0x45, 0x23, 0x01, 0x00]);
        let differing = before.iter().zip(&after).filter(|(a, b)| a != b);
        assert_eq!(differing.count(), 3);
        assert_eq!(before.len(), after.len());
    }

    fn report(hz: u32, rules: &[Rule]) -> Report {
        let flaw = |rule: &Rule| Flaw {
            rule: *rule,
            what: format!("{rule:?}"),
            place: Place::default(),
            remedy: String::new(),
        };
        Report {
            proven_step_rate_hz: [(BAUD.to_string(), hz), ("250000".into(), 1)].into(),
            flaws: rules.iter().map(flaw).collect(),
            ..Report::default()
        }
    }

    #[test]
    fn a_rate_is_proven_where_nothing_but_a_wish_is_unmet() {
        assert_eq!(rate(&report(151_900, &[])).unwrap(), 151_000);
        let wishes = [Rule::Requirement, Rule::DeadlineMissed];
        assert_eq!(rate(&report(90_000, &wishes)).unwrap(), 90_000);
        for (hz, rules, reason) in [
            (90_000, &[Rule::UnboundedLoop][..], "UnboundedLoop"),
            (90_000, &[Rule::Requirement, Rule::Recursion], "Recursion"),
            (0, &[Rule::DeadlineMissed], "DeadlineMissed"),
            (999, &[], "for no step rate"),
        ] {
            let error = rate(&report(hz, rules)).unwrap_err().to_string();
            assert!(error.contains(reason), "{error}");
            assert!(hz == 0 || !error.contains("Requirement"), "{error}");
        }
        let many = rate(&report(1_000, &[Rule::ReachablePanic; 7])).unwrap_err();
        assert!(many.to_string().contains("and 4 more"), "{many}");
    }

    #[test]
    fn an_image_without_the_place_is_refused_with_the_reason() {
        for (mut image, reason) in [
            (image("OTHER", b"PROV\0\0\0\0"), "has no symbol PROVEN"),
            (image(SYMBOL, b"DONE\0\0\0\0"), "another mark"),
            (b"no image".to_vec(), "no ELF file"),
        ] {
            let before = image.clone();
            let error = write(&mut image, 1).unwrap_err().to_string();
            assert!(error.contains(reason), "{error}");
            assert_eq!(image, before);
        }
    }

    #[test]
    fn a_report_gives_the_rate_of_its_board_and_axes_in_thousands() {
        let report = |board: &str, axes: usize| {
            let rates = json!({"115200": 187_654, "1000000": 130_000});
            json!({"board": board, "axes": axes, "proven_step_rate_hz": rates}).to_string()
        };
        assert_eq!(of_report(&report("mill", AXES), "mill").unwrap(), 187_000);
        assert!(of_report(&report("lathe", AXES), "mill").is_err());
        assert!(of_report(&report("mill", AXES + 1), "mill").is_err());
        assert!(of_report("{}", "mill").is_err());
    }
}
