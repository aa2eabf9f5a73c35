//! The comparison of measured costs with the table.

use anyhow::{Context, Result, ensure};

use super::samples::Sample;

/// Words in a measured `LDM` or `STM`.
const WORDS: u64 = 4;
/// Instructions of one cycle in a line of the instruction cache.
const LINE: u64 = 4;

/// A class of the table.
#[derive(Debug, Clone, PartialEq, Eq)]
pub(super) struct Row {
    /// Its name.
    pub(super) class: String,
    /// The measured cycles.
    pub(super) measured: u64,
    /// The cycles of the table.
    pub(super) table: u64,
    /// The slowest of what the class stands for.
    pub(super) variant: String,
}

impl Row {
    /// Whether the table says too little.
    pub(super) fn is_above(&self) -> bool {
        self.measured > self.table
    }
}

/// The row of every class that was measured, in the order of the table.
pub(super) fn compare(table: &[(String, u64)], samples: &[Sample]) -> Result<Vec<Row>> {
    let of = |class: &str| {
        let found = table.iter().find(|(name, _)| name == class);
        let found = found.with_context(|| format!("the table has no class {class:?}"));
        found.map(|(_, cycles)| *cycles)
    };
    let mut measured = Vec::new();
    for sample in samples {
        of(&sample.class)?;
        let (load, refill) = (of("load")?, of("refill")?);
        measured.push((cycles(sample, load, refill), sample));
    }
    ensure!(!measured.is_empty(), "nothing was measured");
    let rows = table.iter().filter_map(|(class, table)| {
        let mut of_class = measured.iter().filter(|(_, sample)| sample.class == *class);
        let first = of_class.next()?;
        let slowest = of_class.fold(
            first,
            |most, other| if other.0 > most.0 { other } else { most },
        );
        Some(Row {
            class: class.clone(),
            measured: slowest.0,
            table: *table,
            variant: slowest.1.variant.clone(),
        })
    });
    Ok(rows.collect())
}

/// The cycles of one instruction, as the table counts them: a measured sequence may contain a load
/// or a refill of the pipeline, which the table counts in another class, and whose cost is
/// subtracted.
fn cycles(sample: &Sample, load: u64, refill: u64) -> u64 {
    let each = sample.most.div_ceil(sample.repetitions);
    match sample.class.as_str() {
        "load_word" | "store_word" => each.saturating_sub(1).div_ceil(WORDS),
        "refill" => each.saturating_sub(1),
        "table_jump" => each.saturating_sub(refill),
        "sram" | "ccm" | "ahb" | "apb1" | "apb2" | "usb" | "private" | "flash_data" => {
            each.saturating_sub(load)
        }
        "flash_miss" => each.saturating_sub(LINE),
        _ => each,
    }
}

#[cfg(test)]
mod tests {
    use super::*;

    fn sample(class: &str, variant: &str, repetitions: u64, most: u64) -> Sample {
        Sample {
            class: class.into(),
            variant: variant.into(),
            repetitions,
            least: most / 2,
            most,
        }
    }

    fn table() -> Vec<(String, u64)> {
        [
            ("divide", 12),
            ("load", 2),
            ("load_word", 1),
            ("refill", 3),
            ("table_jump", 2),
            ("apb1", 12),
            ("flash_miss", 5),
        ]
        .map(|(class, cycles)| (class.to_owned(), cycles))
        .to_vec()
    }

    #[test]
    fn the_slowest_of_a_class_counts_rounded_up() {
        let samples = [
            sample("divide", "by-1", 32, 320),
            sample("divide", "by-3", 32, 385),
            sample("divide", "by-7", 32, 384),
        ];
        let rows = compare(&table(), &samples).unwrap();
        assert_eq!(rows.len(), 1);
        assert_eq!((rows[0].measured, rows[0].table), (13, 12));
        assert_eq!(rows[0].variant, "by-3");
        assert!(rows[0].is_above());
    }

    #[test]
    fn what_belongs_to_another_class_is_not_counted() {
        for (class, repetitions, most, expected) in [
            ("load", 32, 64, 2),
            ("load_word", 32, 5 * 32, 1),
            ("load_word", 32, 6 * 32, 2),
            ("refill", 96, 96 * 4, 3),
            ("table_jump", 32, 5 * 32, 2),
            ("apb1", 32, 14 * 32, 12),
            ("apb1", 32, 15 * 32, 13),
            ("flash_miss", 128, 9 * 128, 5),
        ] {
            let samples = [sample(class, "v", repetitions, most)];
            let rows = compare(&table(), &samples).unwrap();
            assert_eq!(rows[0].measured, expected, "{class} {most}");
        }
    }

    #[test]
    fn a_class_that_the_table_does_not_have_is_refused() {
        let error = compare(&table(), &[sample("magic", "v", 1, 1)]).unwrap_err();
        assert!(error.to_string().contains("\"magic\""), "{error}");
        assert!(compare(&table(), &[]).is_err());
    }
}
