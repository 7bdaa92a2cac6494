//! CDR, the encoding of ROS 2 messages (OMG DDS-XTypes 1.3, clause 7.4): plain CDR of version 1 and 2.
//!
//! Plain CDR of version 2 is that of final types. Before lists of anything but numbers it has their size in bytes.
//! Types in a message that are not final have one too. A definition does not state this, so such messages are refused
//! by their length.

use super::MessageError;
use super::limits::DEEPEST;
use super::schema::{Base, Count, Schema};
use super::value::Value;

/// Max number of elements of a message. Each takes some tens of bytes; pictures and point clouds are not counted.
const MAX_ELEMENTS: usize = 4_000_000;
/// Sequences of bytes longer than this are pictures or point clouds and are passed over.
const MAX_KEPT: usize = 1 << 16;

struct Reader<'a> {
    bytes: &'a [u8],
    at: usize,
    big: bool,
    /// Version 2.
    second: bool,
    /// Elements that may still be read: types without content take no bytes.
    fuel: usize,
}

/// Decodes one message.
pub(crate) fn decode(schema: &Schema, message: &[u8]) -> Result<Value, MessageError> {
    let (head, bytes) = message.split_at_checked(4).ok_or(MessageError::NoHead)?;
    let (big, second) = match [head[0], head[1]] {
        // CDR, big and little endian; then version 2.
        [0, 0] => (true, false),
        [0, 1] => (false, false),
        [0, 6] => (true, true),
        [0, 7] => (false, true),
        _ => {
            return Err(MessageError::Cdr([head[0], head[1]]));
        }
    };
    // Types without content take no bytes, so the message's length alone does not bound the number of elements.
    let fuel = (bytes.len() * 8 + 10_000).min(MAX_ELEMENTS);
    let mut reader = Reader { bytes, at: 0, big, second, fuel };
    let value = reader.structure(schema, 0, 0)?;
    // Less than four bytes behind the fields are padding.
    if second && bytes.len() - reader.at >= 4 {
        return Err(MessageError::Length);
    }
    Ok(value)
}

impl<'a> Reader<'a> {
    fn structure(&mut self, schema: &Schema, number: usize, depth: usize) -> Result<Value, MessageError> {
        if depth > DEEPEST {
            return Err(MessageError::Deep);
        }
        let fields = schema.types.get(number).ok_or(MessageError::NoType)?;
        let mut out = Vec::with_capacity(fields.len());
        for field in fields {
            let end = match field.count {
                Count::Fixed(_) | Count::Sequence if self.second && !is_number(field.base) => {
                    let size = self.unsigned(4)? as usize;
                    Some(self.at.saturating_add(size))
                }
                _ => None,
            };
            let value = match field.count {
                Count::One => self.one(schema, field.base, depth)?,
                Count::Fixed(count) => self.many(schema, field.base, count, depth)?,
                Count::Sequence => {
                    let count = self.unsigned(4)? as usize;
                    self.many(schema, field.base, count, depth)?
                }
            };
            if end.is_some_and(|end| end != self.at) {
                return Err(MessageError::Length);
            }
            out.push((field.name.clone(), value));
        }
        Ok(Value::Struct(out))
    }

    fn one(&mut self, schema: &Schema, base: Base, depth: usize) -> Result<Value, MessageError> {
        // A definition may nest and repeat so that a short message makes very many values.
        self.fuel = self.fuel.checked_sub(1).ok_or(MessageError::Elements)?;
        Ok(match base {
            Base::Type(number) => self.structure(schema, number, depth + 1)?,
            Base::Text => {
                let size = self.unsigned(4)? as usize;
                let text = self.take(size)?;
                // The length of a text counts its final zero.
                let text = text.strip_suffix(&[0]).unwrap_or(text);
                Value::Text(String::from_utf8_lossy(text).into_owned())
            }
            Base::WideText => {
                // No quantity of a log is wide text, so it is only passed over.
                let size = self.unsigned(4)? as usize;
                self.take(size.saturating_mul(2))?;
                Value::Text(String::new())
            }
            _ => Value::Number(self.number(base)?),
        })
    }

    fn many(
        &mut self,
        schema: &Schema,
        base: Base,
        count: usize,
        depth: usize,
    ) -> Result<Value, MessageError> {
        // Every element takes a byte, or is without content.
        if count > self.bytes.len() - self.at {
            return Err(MessageError::Sequence);
        }
        if !is_number(base) {
            let mut items = Vec::new();
            for _ in 0..count {
                items.push(self.one(schema, base, depth)?);
            }
            return Ok(Value::List(items));
        }
        // Pictures and point clouds come as such sequences, and hold nothing of a log.
        if matches!(base, Base::U8 | Base::I8 | Base::Bool) && count > MAX_KEPT {
            self.take(count)?;
            return Ok(Value::Numbers(Vec::new()));
        }
        self.fuel = self.fuel.checked_sub(count).ok_or(MessageError::Elements)?;
        let mut numbers = Vec::with_capacity(count);
        for _ in 0..count {
            numbers.push(self.number(base)?);
        }
        Ok(Value::Numbers(numbers))
    }

    fn number(&mut self, base: Base) -> Result<f64, MessageError> {
        Ok(match base {
            Base::Bool | Base::U8 => self.unsigned(1)? as f64,
            Base::I8 => f64::from(self.unsigned(1)? as u8 as i8),
            Base::U16 => self.unsigned(2)? as f64,
            Base::I16 => f64::from(self.unsigned(2)? as u16 as i16),
            Base::U32 => self.unsigned(4)? as f64,
            Base::I32 => f64::from(self.unsigned(4)? as u32 as i32),
            Base::U64 => self.unsigned(8)? as f64,
            Base::I64 => self.unsigned(8)? as i64 as f64,
            Base::F32 => f64::from(f32::from_bits(self.unsigned(4)? as u32)),
            Base::F64 => f64::from_bits(self.unsigned(8)?),
            Base::Text | Base::WideText | Base::Type(_) => return Err(MessageError::NotANumber),
        })
    }

    /// A number of `size` bytes, aligned to its size.
    fn unsigned(&mut self, size: usize) -> Result<u64, MessageError> {
        // Alignment counts from the first byte after the head. In version 2 numbers of 8 bytes are aligned to 4.
        let alignment = size.min(if self.second { 4 } else { 8 });
        let padding = (alignment - self.at % alignment) % alignment;
        self.take(padding)?;
        let bytes = self.take(size)?;
        let join = |sum: u64, byte: &u8| (sum << 8) | u64::from(*byte);
        Ok(if self.big { bytes.iter().fold(0, join) } else { bytes.iter().rev().fold(0, join) })
    }

    fn take(&mut self, count: usize) -> Result<&'a [u8], MessageError> {
        let end = self.at.checked_add(count).filter(|end| *end <= self.bytes.len());
        let end = end.ok_or(MessageError::CutShort)?;
        let taken = &self.bytes[self.at..end];
        self.at = end;
        Ok(taken)
    }
}

fn is_number(base: Base) -> bool {
    !matches!(base, Base::Type(_) | Base::Text | Base::WideText)
}

#[cfg(test)]
mod tests {
    use super::super::schema;
    use super::*;

    #[test]
    fn numbers_are_aligned_and_of_either_byte_order() -> Result<(), MessageError> {
        let schema = schema::parse("p/T", "uint8 a\nfloat64 b\nint16[] c\nstring d\nuint8 e\nuint32 f")?;
        let mut little = vec![0, 1, 0, 0, 7, 0, 0, 0, 0, 0, 0, 0];
        little.extend(1.5f64.to_le_bytes());
        little.extend([2, 0, 0, 0, 0xff, 0xff, 3, 0]);
        little.extend([3, 0, 0, 0, b'h', b'i', 0, 9]);
        little.extend([5, 0, 0, 0]);
        let value = decode(&schema, &little)?;
        let number = |name: &str| value.get(&[name]).and_then(Value::number);
        assert_eq!(
            (number("a"), number("b"), number("e"), number("f")),
            (Some(7.0), Some(1.5), Some(9.0), Some(5.0))
        );
        assert_eq!(value.get(&["c"]).and_then(Value::numbers), Some(vec![-1.0, 3.0]));
        assert_eq!(value.get(&["d"]), Some(&Value::Text("hi".into())));
        let mut big = vec![0, 0, 0, 0, 7, 0, 0, 0, 0, 0, 0, 0];
        big.extend(1.5f64.to_be_bytes());
        big.extend([0; 20]);
        assert_eq!(decode(&schema, &big)?.get(&["b"]).and_then(Value::number), Some(1.5));
        // CDR version 2 aligns to four bytes at most.
        let mut second = vec![0, 7, 0, 0, 7, 0, 0, 0];
        second.extend(1.5f64.to_le_bytes());
        second.extend([0; 16]);
        assert_eq!(decode(&schema, &second)?.get(&["b"]).and_then(Value::number), Some(1.5));
        for end in 0..little.len() {
            assert!(decode(&schema, &little[..end]).is_err(), "{end}");
        }
        Ok(())
    }

    #[test]
    fn lists_of_version_2_have_their_size_before_them() -> Result<(), MessageError> {
        let text = "string[] name\nfloat64[] position\nP[1] end\n==========\nMSG: p/P\nint32 x";
        let schema = schema::parse("p/T", text)?;
        // Size and count of the names; one of two bytes, with its zero, and padding; count and number; size and point.
        let words: [&[u8]; 9] = [
            &[11, 0, 0, 0],
            &[1, 0, 0, 0],
            &[3, 0, 0, 0],
            b"hi\0\0",
            &[1, 0, 0, 0],
            &1.5f64.to_le_bytes(),
            &[4, 0, 0, 0],
            &[9, 0, 0, 0],
            &[0; 3],
        ];
        let message = |words: &[&[u8]]| [&[0u8, 7, 0, 0][..], &words.concat()].concat();
        let value = decode(&schema, &message(&words))?;
        assert_eq!(value.get(&["name"]).and_then(Value::words), Some(vec!["hi"]));
        assert_eq!(value.get(&["position"]).and_then(Value::numbers), Some(vec![1.5]));
        let end = value.get(&["end"]).and_then(Value::items).and_then(|items| items.first());
        assert_eq!(end.and_then(|end| end.get(&["x"])).and_then(Value::number), Some(9.0));
        // Another size, and more bytes than the fields have, are of types that are not final.
        let mut wrong = words;
        wrong[0] = &[12, 0, 0, 0];
        assert_eq!(decode(&schema, &message(&wrong)), Err(MessageError::Length));
        wrong = words;
        wrong[8] = &[0; 4];
        assert_eq!(decode(&schema, &message(&wrong)), Err(MessageError::Length));
        Ok(())
    }

    #[test]
    fn sequences_of_nothing_do_not_take_for_ever() -> Result<(), MessageError> {
        let text = "A[100000] a\n==========\nMSG: p/A\nB[100000] b\n==========\nMSG: p/B\nC[100000] c\n==========\nMSG: p/C\n";
        let schema = schema::parse("p/T", text)?;
        assert!(decode(&schema, &vec![0; 100_004]).is_err());
        let circle = schema::parse("p/T", "T[1] t")?;
        assert!(decode(&circle, &[0; 16]).is_err());
        Ok(())
    }
}
