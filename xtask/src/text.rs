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

/// A time to read: `1 h 2 min 3 s`, and `3.250 s` below a minute.
pub fn duration(seconds: f64) -> String {
    if seconds < 60.0 {
        return format!("{seconds:.3} s");
    }
    let seconds = seconds.round() as u64;
    let (hours, minutes, seconds) = (seconds / 3600, seconds / 60 % 60, seconds % 60);
    let hours = if hours > 0 {
        format!("{hours} h ")
    } else {
        String::new()
    };
    format!("{hours}{minutes} min {seconds} s")
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
        assert_eq!(duration(63.0), "1 min 3 s");
        assert_eq!(duration(3599.7), "1 h 0 min 0 s");
        assert_eq!(duration(3723.4), "1 h 2 min 3 s");
        assert_eq!(separated(1_234_567), "1 234 567");
    }
}
