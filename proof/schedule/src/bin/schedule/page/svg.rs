//! Drawing: scales, ticks and the few shapes that the pictures are made of.
//!
//! Colours are classes of the page's style sheet, so that a picture follows light and dark.

use std::fmt::{self, Display, Write as _};

/// Text that is safe between tags and in attributes.
pub(super) fn escaped(text: &str) -> String {
    let mut safe = String::with_capacity(text.len());
    for letter in text.chars() {
        match letter {
            '&' => safe.push_str("&amp;"),
            '<' => safe.push_str("&lt;"),
            '>' => safe.push_str("&gt;"),
            '"' => safe.push_str("&quot;"),
            _ => safe.push(letter),
        }
    }
    safe
}

/// A coordinate: two decimals at most, none when they are zero.
pub(super) struct At(pub(super) f64);

impl Display for At {
    fn fmt(&self, f: &mut fmt::Formatter<'_>) -> fmt::Result {
        let text = format!("{:.2}", self.0);
        f.write_str(text.trim_end_matches('0').trim_end_matches('.'))
    }
}

/// A linear scale from values to pixels.
#[derive(Debug, Clone, Copy)]
pub(super) struct Scale {
    /// The values at both ends.
    pub(super) values: (f64, f64),
    /// The pixels there.
    pub(super) pixels: (f64, f64),
}

impl Scale {
    /// Where a value lies.
    pub(super) fn at(&self, value: f64) -> f64 {
        let share = (value - self.values.0) / (self.values.1 - self.values.0);
        self.pixels.0 + share * (self.pixels.1 - self.pixels.0)
    }

    /// Round values, about `count` of them.
    pub(super) fn ticks(&self, count: f64) -> Vec<f64> {
        let (low, high) = self.values;
        let step = round_up((high - low) / count);
        let first = (low / step).ceil() as i64;
        let last = (high / step + 1e-9).floor() as i64;
        (first..=last).map(|index| index as f64 * step).collect()
    }
}

/// The next number that is 1, 2 or 5 times a power of ten.
pub(super) fn round_up(value: f64) -> f64 {
    let power = 10_f64.powf(value.max(1e-9).log10().floor());
    let steps = [1.0, 2.0, 5.0, 10.0];
    let step = steps
        .into_iter()
        .find(|step| step * power >= value * 0.999_999);
    step.unwrap_or(10.0) * power
}

/// The number of a tick, as short as possible.
pub(super) fn number(value: f64) -> String {
    At(value).to_string()
}

/// A picture that grows.
#[derive(Debug, Default)]
pub(super) struct Picture {
    body: String,
}

impl Picture {
    pub(super) fn rectangle(&mut self, class: &str, x: f64, y: f64, width: f64, height: f64) {
        let (x, y, width, height) = (At(x), At(y), At(width), At(height));
        let _ = write!(
            self.body,
            r#"<rect class="{class}" x="{x}" y="{y}" width="{width}" height="{height}"/>"#
        );
    }

    pub(super) fn line(&mut self, class: &str, from: (f64, f64), to: (f64, f64)) {
        let path = format!("M{} {}L{} {}", At(from.0), At(from.1), At(to.0), At(to.1));
        self.path(class, &path);
    }

    pub(super) fn path(&mut self, class: &str, path: &str) {
        let _ = write!(self.body, r#"<path class="{class}" d="{path}"/>"#);
    }

    /// Text; a class says where it is anchored.
    pub(super) fn text(&mut self, class: &str, x: f64, y: f64, text: &str) {
        let (x, y, text) = (At(x), At(y), escaped(text));
        let _ = write!(
            self.body,
            r#"<text class="{class}" x="{x}" y="{y}">{text}</text>"#
        );
    }

    /// Puts a hint on what `draw` draws.
    pub(super) fn hinted(&mut self, hint: &str, draw: impl FnOnce(&mut Self)) {
        let _ = write!(self.body, "<g><title>{}</title>", escaped(hint));
        draw(self);
        self.body.push_str("</g>");
    }

    /// The picture, with a description for screen readers.
    pub(super) fn finish(self, width: f64, height: f64, label: &str) -> String {
        format!(
            "<div class=\"picture\"><svg viewBox=\"0 0 {} {}\" role=\"img\" aria-label=\"{}\">{}</svg></div>\n",
            At(width),
            At(height),
            escaped(label),
            self.body
        )
    }
}

#[cfg(test)]
mod tests {
    use super::*;

    #[test]
    fn ticks_are_round_numbers_within_the_scale() {
        let scale = Scale {
            values: (0.0, 20.0),
            pixels: (0.0, 1.0),
        };
        assert_eq!(scale.ticks(8.0), [0.0, 5.0, 10.0, 15.0, 20.0]);
        let scale = Scale {
            values: (-3.0, 1.0),
            pixels: (0.0, 1.0),
        };
        assert_eq!(scale.ticks(4.0), [-3.0, -2.0, -1.0, 0.0, 1.0]);
        assert_eq!(round_up(0.3), 0.5);
        assert_eq!(round_up(425.0), 500.0);
    }

    #[test]
    fn numbers_and_names_cannot_break_the_page() {
        assert_eq!(
            escaped("Vec<u8> & \"x\""),
            "Vec&lt;u8&gt; &amp; &quot;x&quot;"
        );
        assert_eq!(At(1.0).to_string(), "1");
        assert_eq!(At(0.125).to_string(), "0.12");
        assert_eq!(At(120.0).to_string(), "120");
    }
}
