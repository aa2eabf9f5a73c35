//! Tests of reading, scaling and rounding decimal numbers.

use super::*;
use proptest::prelude::*;

fn parsed(text: &str) -> Option<Decimal> {
    Decimal::parse(text.as_bytes()).map(|(number, _)| number)
}

fn number(text: &str) -> Decimal {
    parsed(text).unwrap()
}

#[test]
fn a_number_needs_a_digit() {
    for text in ["", "+", "-", ".", "-.", "--1", "+-1", "E1", "X"] {
        assert_eq!(parsed(text), None, "{text}");
    }
    for text in ["1", "-1", "+1", "1.", ".1", "-.1", "001"] {
        assert!(parsed(text).is_some(), "{text}");
    }
}

#[test]
fn single_precision_is_grbls() {
    // As recorded: 57.6740 mm at 250 steps/mm ends at step 14418, not 14419.
    assert!(number("57.6740").to_grbl_f32() * 250.0 < 14_418.5);
    assert_eq!(number("85.7860").to_grbl_f32(), 857_860.0_f32 * 0.01 * 0.01);
    assert_eq!(number("-0.5").to_grbl_f32(), -5.0_f32 * 0.1);
    assert_eq!(number("12").to_grbl_f32(), 12.0);
}

#[test]
fn a_number_ends_where_its_grammar_ends() {
    for (text, rest) in [
        ("1.2.3", ".3"),
        ("1-2", "-2"),
        ("1E1", "E1"),
        ("5Y", "Y"),
        ("+5.", ""),
        ("1234567890.5.", "."),
    ] {
        assert_eq!(Decimal::parse(text.as_bytes()).unwrap().1, rest.as_bytes());
    }
}

#[test]
fn coordinates_round_half_away_from_zero_at_one_nanometre() {
    for (text, nm) in [
        ("0.0000005", 1),
        ("-0.0000005", -1),
        ("0.00000049999999999999", 0),
        ("12.3456789", 12_345_679),
        ("8000000.000001", 8_000_000_000_001),
        ("-2147.483648", -2_147_483_648),
        ("1.0000000000000000000000000000000000001", 1_000_000),
    ] {
        assert_eq!(number(text).to_millionths(), nm, "{text}");
    }
    for (text, nm) in [
        ("1", 25_400_000),
        ("0.00001", 254),
        ("0.000001", 25),
        ("-0.0000015", -38),
        ("39370.07874015748", 1_000_000_000_000),
    ] {
        assert_eq!(number(text).inches_to_nm(), nm, "{text}");
    }
}

#[test]
fn hundredths_are_whole_or_none() {
    for (text, hundredths) in [
        ("3", Some(300)),
        ("38.2", Some(3820)),
        ("-0.5", Some(-50)),
        ("59.100000000", Some(5910)),
        ("59.100000001", None),
        ("1.001", None),
    ] {
        assert_eq!(number(text).hundredths(), hundredths, "{text}");
    }
    let digits = number(&"9".repeat(250));
    assert_eq!(digits.hundredths(), Some(Decimal::CONVERSION_LIMIT));
}

#[test]
fn a_short_time_is_not_left_out() {
    for (text, thousandths) in [
        ("0", 0),
        ("0.000000001", 1),
        ("0.0004", 1),
        ("0.0014", 1),
        ("0.0016", 2),
        ("-0.0004", 0),
        ("-1", -1000),
    ] {
        let time = number(text).at_least_one(Decimal::to_thousandths);
        assert_eq!(time, thousandths, "{text}");
    }
}

#[test]
fn numbers_that_do_not_fit_saturate() {
    for text in [
        "99999999999999999999",
        "9999999999999999999.5",
        "1000000000000000000000000000000000",
        "9000000000000000000",
    ] {
        assert_eq!(
            number(text).to_millionths(),
            Decimal::CONVERSION_LIMIT,
            "{text}"
        );
        assert_eq!(
            number(text).inches_to_nm(),
            Decimal::CONVERSION_LIMIT,
            "{text}"
        );
        assert!(number(text).trunc() > 1_000_000_000_000, "{text}");
        assert!(number(text).to_f32() > 1.0e17, "{text}");
    }
}

proptest! {
    #![proptest_config(crate::cases(64))]

    #[test]
    fn small_numbers_are_what_the_general_path_makes_of_them(
        text in "[-+]?[0-9]{0,7}\\.?[0-9]{0,6}[XY]?",
    ) {
        let mut small = Scanner::new(text.bytes());
        let mut long = small.clone();
        let Some(decimal) = small.small_decimal() else {
            return Ok(());
        };
        let general = long.long_decimal();
        prop_assert_eq!(general, Some(decimal.into()));
        prop_assert_eq!(small.following.next(), long.following.next());
        let general = general.unwrap();
        if let Some((millionths, single)) = decimal.coordinate() {
            prop_assert_eq!(millionths, general.to_millionths());
            prop_assert_eq!(single.to_bits(), general.to_grbl_f32().to_bits());
        }
        prop_assert_eq!(
            decimal.non_negative().map(f32::to_bits),
            (!general.is_negative()).then(|| general.to_f32().to_bits())
        );
        let natural = decimal.natural().map(i64::from);
        let is_natural = decimal.decimals == 0 && !general.is_negative();
        prop_assert_eq!(natural, is_natural.then(|| general.trunc()));
    }

    #[test]
    fn printing_and_parsing_give_the_same_number(
        mantissa in -900_000_000_000_000_000..900_000_000_000_000_000_i64,
        decimals in 0..=Decimal::MAX_DECIMALS,
    ) {
        let divisor = i64::from(power(decimals));
        let width = usize::from(decimals);
        let sign = if mantissa < 0 { "-" } else { "" };
        let whole = (mantissa / divisor).abs();
        let fraction = (mantissa % divisor).abs();
        let text = if decimals == 0 {
            std::format!("{sign}{whole}")
        } else {
            std::format!("{sign}{whole}.{fraction:0width$}")
        };
        prop_assert_eq!(number(&text), Decimal::new(mantissa, decimals));
    }

    #[test]
    fn scaling_agrees_with_wide_arithmetic(
        mantissa in -900_000_000_000_000_000..900_000_000_000_000_000_i64,
        decimals in 0..=Decimal::MAX_DECIMALS,
    ) {
        let exact = |factor: i128| {
            let product = i128::from(mantissa) * factor;
            let divisor = i128::from(power(decimals));
            let rounded = (product + divisor / 2 * product.signum()) / divisor;
            let limit = i128::from(Decimal::CONVERSION_LIMIT);
            rounded.clamp(-limit, limit) as i64
        };
        let number = Decimal::new(mantissa, decimals);
        prop_assert_eq!(number.to_millionths(), exact(1_000_000));
        prop_assert_eq!(number.inches_to_nm(), exact(25_400_000));
    }
}
