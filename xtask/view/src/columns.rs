//! Numbers as few bytes: columns of varints, packed and written as text.

/// Packs harder than this for hardly anything.
const LEVEL: u8 = 7;

/// A number that is never negative: 7 bits in each byte, the lowest first.
pub(crate) fn varint(bytes: &mut Vec<u8>, mut value: u64) {
    while value >= 0x80 {
        bytes.push(value as u8 | 0x80);
        value >>= 7;
    }
    bytes.push(value as u8);
}

/// A number with a sign, which is in the lowest bit.
pub(crate) fn signed(bytes: &mut Vec<u8>, value: i64) {
    varint(bytes, (value << 1 ^ value >> 63).cast_unsigned());
}

/// A column of numbers, each as the difference to the one before.
#[derive(Debug, Clone, Default)]
pub(crate) struct Column {
    last: i64,
    pub(crate) bytes: Vec<u8>,
}

impl Column {
    pub(crate) fn push(&mut self, value: i64) {
        signed(&mut self.bytes, value - self.last);
        self.last = value;
    }
}

/// Packs bytes, and writes them with letters, digits, `+` and `/`.
pub(crate) fn packed(bytes: &[u8]) -> String {
    base64(&miniz_oxide::deflate::compress_to_vec(bytes, LEVEL))
}

fn base64(bytes: &[u8]) -> String {
    const DIGITS: &[u8; 64] = b"ABCDEFGHIJKLMNOPQRSTUVWXYZabcdefghijklmnopqrstuvwxyz0123456789+/";
    let mut text = String::with_capacity(bytes.len().div_ceil(3) * 4);
    for three in bytes.chunks(3) {
        let byte = |index: usize| u32::from(three.get(index).copied().unwrap_or(0));
        let bits = byte(0) << 16 | byte(1) << 8 | byte(2);
        for index in 0..4 {
            let digit = DIGITS[(bits >> (18 - 6 * index) & 63) as usize];
            text.push(if index <= three.len() {
                char::from(digit)
            } else {
                '='
            });
        }
    }
    text
}

#[cfg(test)]
mod tests {
    use super::*;

    #[test]
    fn text_is_base64() {
        for (bytes, text) in [
            ("", ""),
            ("f", "Zg=="),
            ("fo", "Zm8="),
            ("foo", "Zm9v"),
            ("foob", "Zm9vYg=="),
            ("fooba", "Zm9vYmE="),
            ("foobar", "Zm9vYmFy"),
        ] {
            assert_eq!(base64(bytes.as_bytes()), text);
        }
        assert_eq!(base64(&[0xfb, 0xff, 0xbf]), "+/+/");
    }

    #[test]
    fn small_numbers_take_a_byte() {
        let mut bytes = Vec::new();
        signed(&mut bytes, 63);
        signed(&mut bytes, -64);
        varint(&mut bytes, 127);
        assert_eq!(bytes, [126, 127, 127]);
        varint(&mut bytes, 128);
        signed(&mut bytes, i64::MIN);
        assert_eq!(
            bytes[3..],
            [0x80, 1, 255, 255, 255, 255, 255, 255, 255, 255, 255, 1]
        );
    }
}
