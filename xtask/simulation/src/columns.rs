//! Numbers as few bytes: columns of varints.

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
pub(crate) struct ColumnWriter {
    last: i64,
    pub(crate) bytes: Vec<u8>,
}

impl ColumnWriter {
    pub(crate) fn push(&mut self, value: i64) {
        signed(&mut self.bytes, value - self.last);
        self.last = value;
    }
}

#[cfg(test)]
mod tests {
    use super::*;

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
