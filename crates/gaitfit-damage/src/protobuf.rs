//! Nested messages of protocol buffers (protobuf.dev/programming-guides/encoding), damaged so that their lengths still fit.

use crate::Draws;

/// A field as the wire has it.
#[derive(Clone)]
enum Field {
    /// A number of up to ten bytes.
    Number(u64),
    /// Four or eight bytes.
    Fixed(Vec<u8>),
    /// Text, bytes, packed numbers.
    Bytes(Vec<u8>),
    /// Bytes that can be read as a message.
    Message(Vec<(u64, Field)>),
}

/// `file` with one to three fields changed, removed, repeated, or replaced by others of the file, at any depth.
pub fn protobuf(file: &[u8], draws: &mut Draws) -> Vec<u8> {
    let Some(mut fields) = fields(file, 0) else { return crate::bytes(file, draws) };
    for _ in 0..=draws.below(3) {
        let donor = chosen(&mut fields.clone(), draws).cloned();
        let Some(field) = chosen(&mut fields, draws) else { break };
        change(field, donor, draws);
        shuffle(&mut fields, draws);
    }
    let mut out = Vec::new();
    write(&fields, &mut out);
    out
}

/// The fields of a message; `None` for bytes that are none.
fn fields(mut rest: &[u8], depth: usize) -> Option<Vec<(u64, Field)>> {
    let mut out = Vec::new();
    while !rest.is_empty() {
        let key = number(&mut rest)?;
        let mut take = |count: usize| {
            let (taken, after) = rest.split_at_checked(count)?;
            rest = after;
            Some(taken.to_vec())
        };
        // Wire types: 0 varint, 1 eight bytes, 2 length and content, 5 four bytes. 3 and 4 are deprecated groups.
        let field = match key % 8 {
            0 => Field::Number(number(&mut rest)?),
            1 => Field::Fixed(take(8)?),
            5 => Field::Fixed(take(4)?),
            2 => {
                let length = usize::try_from(number(&mut rest)?).ok()?;
                let (content, after) = rest.split_at_checked(length)?;
                rest = after;
                // Text may happen to read as a message. Damage then still keeps the lengths right, so that does no
                // harm.
                match fields(content, depth + 1).filter(|inner| depth < 8 && !inner.is_empty()) {
                    Some(inner) => Field::Message(inner),
                    None => Field::Bytes(content.to_vec()),
                }
            }
            _ => return None,
        };
        // Field numbers begin at 1.
        if key / 8 == 0 {
            return None;
        }
        out.push((key / 8, field));
    }
    Some(out)
}

fn number(rest: &mut &[u8]) -> Option<u64> {
    let mut value = 0;
    for place in 0..10 {
        let (byte, after) = rest.split_first()?;
        *rest = after;
        value |= u64::from(byte & 0x7f) << (7 * place).min(63);
        if byte & 0x80 == 0 {
            return Some(value);
        }
    }
    None
}

/// A field anywhere in the tree. Every step into a message is as likely as an end at it.
fn chosen<'a>(fields: &'a mut [(u64, Field)], draws: &mut Draws) -> Option<&'a mut (u64, Field)> {
    if fields.is_empty() {
        return None;
    }
    let at = draws.below(fields.len());
    let inside = matches!(&fields[at].1, Field::Message(inner) if !inner.is_empty()) && draws.below(4) > 0;
    if !inside {
        return fields.get_mut(at);
    }
    match &mut fields[at].1 {
        Field::Message(inner) => chosen(inner, draws),
        _ => None,
    }
}

fn change(field: &mut (u64, Field), donor: Option<(u64, Field)>, draws: &mut Draws) {
    if let Some(donor) = donor.filter(|_| draws.below(3) == 0) {
        // Another field's content under this field's number, or all of it.
        *field = if draws.below(2) == 0 { donor } else { (field.0, donor.1) };
        return;
    }
    match &mut field.1 {
        Field::Number(value) => {
            // Numbers at which lengths, counts and signs go wrong.
            *value = *draws.one(&[
                0,
                1,
                2,
                11,
                i64::MAX as u64,
                u64::MAX,
                1 << 31,
                value.wrapping_add(1),
                value.wrapping_sub(1),
                *value << 8,
            ]);
        }
        Field::Fixed(bytes) => {
            let byte = draws.below(bytes.len());
            bytes[byte] = *draws.one(&[0, 0x7f, 0x80, 0xff]);
        }
        Field::Bytes(bytes) => *bytes = crate::bytes(bytes, draws),
        Field::Message(inner) => {
            let at = draws.below(inner.len());
            match draws.below(3) {
                0 if !inner.is_empty() => drop(inner.remove(at)),
                1 if !inner.is_empty() => inner.push(inner[at].clone()),
                _ => field.0 = 1 + draws.below(20) as u64,
            }
        }
    }
}

/// Sometimes removes, repeats or swaps fields of the outer message.
fn shuffle(fields: &mut Vec<(u64, Field)>, draws: &mut Draws) {
    let (a, b) = (draws.below(fields.len()), draws.below(fields.len()));
    match draws.below(12) {
        0 if !fields.is_empty() => drop(fields.remove(a)),
        1 if !fields.is_empty() => fields.push(fields[a].clone()),
        2 if !fields.is_empty() => fields.swap(a, b),
        _ => {}
    }
}

fn write(fields: &[(u64, Field)], out: &mut Vec<u8>) {
    for (number, field) in fields {
        let kind = match field {
            Field::Number(_) => 0,
            Field::Fixed(bytes) if bytes.len() == 8 => 1,
            Field::Fixed(_) => 5,
            Field::Bytes(_) | Field::Message(_) => 2,
        };
        varint(number << 3 | kind, out);
        match field {
            Field::Number(value) => varint(*value, out),
            Field::Fixed(bytes) => out.extend(bytes),
            Field::Bytes(bytes) => {
                varint(bytes.len() as u64, out);
                out.extend(bytes);
            }
            Field::Message(inner) => {
                let mut content = Vec::new();
                write(inner, &mut content);
                varint(content.len() as u64, out);
                out.extend(content);
            }
        }
    }
}

fn varint(mut value: u64, out: &mut Vec<u8>) {
    while value >= 0x80 {
        out.push(value as u8 | 0x80);
        value >>= 7;
    }
    out.push(value as u8);
}

#[cfg(test)]
mod tests {
    use super::*;

    #[test]
    fn what_is_not_damaged_comes_back() {
        let file = [8, 0x96, 1, 18, 4, 10, 2, b'h', b'i', 29, 0, 0, 0x80, 0x3f];
        let mut out = Vec::new();
        write(&fields(&file, 0).unwrap_or_default(), &mut out);
        assert_eq!(out, file);
        assert!((0..50).any(|seed| protobuf(&file, &mut Draws::new(seed)) != file));
    }
}
