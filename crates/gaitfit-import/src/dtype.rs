//! NumPy's types of numbers: bytes to f64.

/// A type that is read: numbers, and words of fixed length.
#[derive(Clone, Copy, Debug, PartialEq, Eq)]
pub(crate) struct DType {
    kind: u8,
    size: usize,
    big: bool,
}

impl DType {
    /// A type such as `<f8`, `|b1`, `<U12`. `None` for what is not read: objects, dates, complex numbers, structures.
    pub fn parse(text: &str) -> Option<DType> {
        let (order, rest) = match text.as_bytes().first()? {
            // `|` has no order and `=` is the writer's, which is taken for little-endian.
            b'<' | b'|' | b'=' => (b'<', &text[1..]),
            b'>' => (b'>', &text[1..]),
            _ => (b'<', text),
        };
        let kind = *rest.as_bytes().first()?;
        let size: usize = rest.get(1..)?.parse().ok()?;
        let known = match kind {
            b'f' => matches!(size, 2 | 4 | 8),
            b'i' | b'u' => matches!(size, 1 | 2 | 4 | 8),
            b'b' => size == 1,
            // The size comes from the file: no name of a joint has so many letters.
            b'U' | b'S' => size < 1 << 16,
            _ => false,
        };
        known.then_some(DType { kind, size, big: order == b'>' })
    }

    /// Returns the same type in the byte order of `order`: `<`, `>`, `=` or `|`.
    pub fn ordered(self, order: &str) -> DType {
        match order {
            ">" => DType { big: true, ..self },
            "<" => DType { big: false, ..self },
            _ => self,
        }
    }

    /// Bytes of one element.
    pub fn bytes(self) -> usize {
        if self.kind == b'U' { 4 * self.size } else { self.size }
    }

    /// Whether elements are words.
    pub fn is_text(self) -> bool {
        matches!(self.kind, b'U' | b'S')
    }

    /// The number in `bytes`, which are as many as [`DType::bytes`] says.
    pub fn number(self, bytes: &[u8]) -> Option<f64> {
        // Brought into little-endian order and widened to 8 bytes, so that one read serves all sizes.
        let mut raw = [0u8; 8];
        let raw = raw.get_mut(..self.size)?;
        raw.copy_from_slice(bytes.get(..self.size)?);
        if self.big {
            raw.reverse();
        }
        let mut word = [0u8; 8];
        word[..self.size].copy_from_slice(raw);
        let bits = u64::from_le_bytes(word);
        Some(match (self.kind, self.size) {
            (b'f', 8) => f64::from_bits(bits),
            (b'f', 4) => f64::from(f32::from_bits(bits as u32)),
            (b'f', 2) => half(bits as u16),
            (b'b' | b'u', _) => bits as f64,
            (b'i', 1) => f64::from(bits as u8 as i8),
            (b'i', 2) => f64::from(bits as u16 as i16),
            (b'i', 4) => f64::from(bits as u32 as i32),
            (b'i', 8) => bits as i64 as f64,
            _ => return None,
        })
    }

    /// The word in `bytes`, without the zeros at its end.
    pub fn text(self, bytes: &[u8]) -> Option<String> {
        match self.kind {
            b'S' => {
                let end = bytes.iter().rposition(|byte| *byte != 0).map_or(0, |last| last + 1);
                String::from_utf8(bytes[..end].to_vec()).ok()
            }
            b'U' => {
                let letters = bytes.chunks_exact(4).map(|four| {
                    let four: [u8; 4] = four.try_into().unwrap_or_default();
                    if self.big { u32::from_be_bytes(four) } else { u32::from_le_bytes(four) }
                });
                letters.take_while(|letter| *letter != 0).map(char::from_u32).collect()
            }
            _ => None,
        }
    }
}

/// A number of IEEE 754's binary16.
fn half(bits: u16) -> f64 {
    let sign = if bits & 0x8000 == 0 { 1.0 } else { -1.0 };
    let exponent = i32::from((bits >> 10) & 0x1f);
    let fraction = f64::from(bits & 0x3ff);
    sign * match exponent {
        // Subnormal numbers: the fraction's last bit is worth 2⁻²⁴.
        0 => fraction * 2f64.powi(-24),
        31 if fraction == 0.0 => f64::INFINITY,
        31 => f64::NAN,
        _ => (1.0 + fraction / 1024.0) * 2f64.powi(exponent - 15),
    }
}

#[cfg(test)]
mod tests {
    use super::*;

    #[test]
    fn numbers_of_every_type_are_read() {
        let number = |name: &str, bytes: &[u8]| DType::parse(name).and_then(|dtype| dtype.number(bytes));
        assert_eq!(number("<f8", &1.5f64.to_le_bytes()), Some(1.5));
        assert_eq!(number(">f4", &(-2.25f32).to_be_bytes()), Some(-2.25));
        assert_eq!(number("<f2", &0x3e00u16.to_le_bytes()), Some(1.5));
        assert_eq!(number("<f2", &0xfc00u16.to_le_bytes()), Some(f64::NEG_INFINITY));
        assert_eq!(number("<f2", &0x0001u16.to_le_bytes()), Some(2f64.powi(-24)));
        assert_eq!(number("<i4", &(-7i32).to_le_bytes()), Some(-7.0));
        assert_eq!(number("|u1", &[200]), Some(200.0));
        assert_eq!(number("|i1", &[200]), Some(-56.0));
        assert_eq!(number("|b1", &[1]), Some(1.0));
        assert_eq!(number("<f8", &[0; 7]), None);
        for refused in ["|O", "<c16", "<M8", "f3", "", "<", "<f", "<U99999999"] {
            assert_eq!(DType::parse(refused), None, "{refused}");
        }
        let word: Vec<u8> = "FL".chars().flat_map(|c| u32::from(c).to_le_bytes()).chain([0; 8]).collect();
        assert_eq!(DType::parse("<U4").and_then(|dtype| dtype.text(&word)).as_deref(), Some("FL"));
    }
}
