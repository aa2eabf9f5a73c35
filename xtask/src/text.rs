//! Numbers, times and rows of a summary, as every tool prints them.

#[cfg(feature = "terminal")]
use anstream::println;
#[cfg(feature = "terminal")]
use owo_colors::OwoColorize;

/// Prints one row of a summary.
#[cfg(feature = "terminal")]
pub fn row(name: &str, value: &str) {
    println!("{:>16}  {value}", name.dimmed());
}

/// A time to read: `1 h 02 min 03.4 s`.
pub fn duration(seconds: f64) -> String {
    let (hours, rest) = ((seconds / 3600.0).floor(), seconds % 3600.0);
    let (minutes, rest) = ((rest / 60.0).floor(), rest % 60.0);
    if hours > 0.0 {
        format!("{hours} h {minutes:02} min {rest:04.1} s")
    } else if minutes > 0.0 {
        format!("{minutes} min {rest:04.1} s")
    } else {
        format!("{rest:.3} s")
    }
}

/// A number with its digits in groups of three.
pub fn separated(number: u64) -> String {
    let digits = number.to_string();
    let mut text = String::new();
    for (index, digit) in digits.chars().enumerate() {
        if index > 0 && (digits.len() - index).is_multiple_of(3) {
            text.push(' ');
        }
        text.push(digit);
    }
    text
}

#[cfg(test)]
mod tests {
    use super::*;

    #[test]
    fn durations_are_readable() {
        assert_eq!(duration(3.25), "3.250 s");
        assert_eq!(duration(63.0), "1 min 03.0 s");
        assert_eq!(duration(3723.4), "1 h 02 min 03.4 s");
        assert_eq!(separated(1_234_567), "1 234 567");
    }
}
