//! Message definitions as bags carry them (`ros2msg`): a type's text, then the texts of the types that it uses.

use super::MessageError;
use super::builtin;
use super::limits::{MAX_BYTES, MAX_FIELDS, MAX_NAME, MAX_TYPES};
use std::collections::HashMap;
use std::rc::Rc;

/// Type of one element of a field.
#[derive(Clone, Copy, Debug, PartialEq, Eq)]
pub(crate) enum Base {
    Bool,
    U8,
    I8,
    U16,
    I16,
    U32,
    I32,
    U64,
    I64,
    F32,
    F64,
    Text,
    WideText,
    /// A type of the schema, by number.
    Type(usize),
}

/// Number of a field's values.
#[derive(Clone, Copy, Debug, PartialEq, Eq)]
pub(crate) enum Count {
    One,
    Fixed(usize),
    Sequence,
}

/// A field of a type.
#[derive(Clone, Debug)]
pub(crate) struct Field {
    pub name: Rc<str>,
    pub base: Base,
    pub count: Count,
}

/// Types by number; number 0 is the message's own.
#[derive(Clone, Debug)]
pub(crate) struct Schema {
    pub types: Vec<Vec<Field>>,
}

/// `pkg/Name` of a type as ROS (`pkg/msg/Name`) or DDS (`pkg::msg::dds_::Name_`) writes it.
pub(crate) fn short_name(name: &str) -> String {
    let parts: Vec<&str> =
        name.split(['/', ':']).filter(|part| !part.is_empty() && *part != "msg" && *part != "dds_").collect();
    match parts.as_slice() {
        [package, .., kind] => format!("{package}/{}", kind.strip_suffix('_').unwrap_or(kind)),
        [kind] => (*kind).to_owned(),
        [] => String::new(),
    }
}

/// A field as it is written, before types are known by number.
type Written<'a> = (&'a str, &'a str, Count);

/// Reads the definition of the type called `name`. Types that the text lacks are those of ROS and Unitree that
/// [`builtin`] knows.
pub(crate) fn parse(name: &str, text: &str) -> Result<Schema, MessageError> {
    if text.len() > MAX_BYTES {
        return Err(MessageError::DefinitionBytes);
    }
    let named = |name: &str| match short_name(name) {
        name if name.len() > MAX_NAME => Err(MessageError::TypeName),
        name => Ok(name),
    };
    let root = named(name)?;
    let mut texts: HashMap<String, &str> = HashMap::new();
    let mut rest = text;
    let mut key = root.clone();
    // First the text is cut into definitions, by name.
    loop {
        // A line of at least ten `=` ends a definition; the next line names the type that follows.
        let mut at = 0;
        let end = rest.split_inclusive('\n').find_map(|line| {
            let start = at;
            at += line.len();
            let bare = line.trim();
            (bare.len() >= 10 && bare.bytes().all(|byte| byte == b'=')).then_some((start, at))
        });
        let (definition, after) =
            end.map_or((rest, None), |(start, after)| (&rest[..start], Some(&rest[after..])));
        if texts.len() >= MAX_TYPES {
            return Err(MessageError::DefinitionTypes);
        }
        if !definition.trim().is_empty() || !key.is_empty() {
            // The first definition of a name counts.
            texts.entry(std::mem::take(&mut key)).or_insert(definition);
        }
        let Some(after) = after else { break };
        let (first, others) = after.split_once('\n').unwrap_or((after, ""));
        let Some(name) = first.trim().strip_prefix("MSG:") else {
            return Err(MessageError::Separator);
        };
        key = named(name.trim())?;
        rest = others;
    }
    if texts.get(&root).is_none_or(|own| own.trim().is_empty()) {
        match builtin::definition(&root) {
            Some(own) => drop(texts.insert(root.clone(), own)),
            None => return Err(MessageError::NoDefinition(root)),
        }
    }

    // Then types are numbered as fields refer to them, beginning with the root; types that nothing refers to
    // are not read.
    let mut numbers: HashMap<String, usize> = HashMap::from([(root.clone(), 0)]);
    let mut waiting = vec![root];
    let mut types: Vec<Vec<Field>> = Vec::new();
    let mut fields = 0;
    // Types wait in the order of their numbers, so the next one's number is the count of those that are read.
    while let Some(name) = waiting.get(types.len()).cloned() {
        let definition = match texts.get(&name) {
            Some(definition) => definition,
            None => builtin::definition(&name).ok_or_else(|| MessageError::NoDefinition(name.clone()))?,
        };
        let package = name.split('/').next().unwrap_or("").to_owned();
        let mut list = Vec::new();
        for line in definition.lines() {
            let Some((kind, field, count)) = field(line)? else { continue };
            fields += 1;
            if fields > MAX_FIELDS {
                return Err(MessageError::DefinitionFields);
            }
            let base = match primitive(kind) {
                Some(base) => base,
                None => {
                    let full = match kind {
                        "Header" => "std_msgs/Header".to_owned(),
                        "time" | "builtin_interfaces/Time" => "builtin_interfaces/Time".to_owned(),
                        "duration" => "builtin_interfaces/Duration".to_owned(),
                        _ if kind.contains('/') => short_name(kind),
                        _ => format!("{package}/{kind}"),
                    };
                    let next = numbers.len();
                    let number = *numbers.entry(full.clone()).or_insert(next);
                    if number == next {
                        if next >= MAX_TYPES {
                            return Err(MessageError::DefinitionTypes);
                        }
                        waiting.push(full);
                    }
                    Base::Type(number)
                }
            };
            list.push(Field { name: field.into(), base, count });
        }
        types.push(list);
    }
    Ok(Schema { types })
}

/// The type, name and count of the field on a line; `None` for comments, constants and empty lines.
fn field(line: &str) -> Result<Option<Written<'_>>, MessageError> {
    let line = line.split('#').next().unwrap_or("").trim();
    let Some((kind, rest)) = line.split_once(char::is_whitespace) else {
        return if line.is_empty() { Ok(None) } else { Err(MessageError::Field(line.to_owned())) };
    };
    let rest = rest.trim();
    let name = rest.split(|c: char| c.is_whitespace() || c == '=').next().unwrap_or("");
    // A constant, whose value is no part of a message.
    if rest[name.len()..].trim_start().starts_with('=') {
        return Ok(None);
    }
    if name.is_empty() || name.len() > MAX_NAME || kind.len() > MAX_NAME {
        return Err(MessageError::Field(line.to_owned()));
    }
    let (kind, count) = match kind.split_once('[') {
        None => (kind, Count::One),
        Some((kind, size)) => {
            let size = size.strip_suffix(']').ok_or_else(|| MessageError::Field(line.to_owned()))?;
            let count = match size {
                "" => Count::Sequence,
                bounded if bounded.starts_with("<=") => Count::Sequence,
                fixed => Count::Fixed(fixed.parse().map_err(|_| MessageError::Field(line.to_owned()))?),
            };
            (kind, count)
        }
    };
    // string<=10
    let kind = kind.split('<').next().unwrap_or(kind);
    Ok(Some((kind, name, count)))
}

fn primitive(kind: &str) -> Option<Base> {
    Some(match kind {
        "bool" => Base::Bool,
        "byte" | "char" | "uint8" => Base::U8,
        "int8" => Base::I8,
        "uint16" => Base::U16,
        "int16" => Base::I16,
        "uint32" => Base::U32,
        "int32" => Base::I32,
        "uint64" => Base::U64,
        "int64" => Base::I64,
        "float32" => Base::F32,
        "float64" => Base::F64,
        "string" => Base::Text,
        "wstring" => Base::WideText,
        _ => return None,
    })
}

#[cfg(test)]
mod tests {
    use super::*;

    #[test]
    fn definitions_of_bags_are_read() -> Result<(), MessageError> {
        let text = "# a comment\nstd_msgs/Header header\nuint8 MODE=3 # a constant\nstring<=10 label \"none\"\n\
                    Part[2] parts\nfloat64[<=4] few\n\
                    ================================================================================\nMSG: pkg/Part\n\
                    float32 q 1.5\nint16[] counts\n\
                    ================================================================================\n\
                    MSG: std_msgs/Header\nbuiltin_interfaces/Time stamp\nstring frame_id\n";
        let schema = parse("pkg/msg/Thing", text)?;
        let shape: Vec<(&str, Base, Count)> =
            schema.types[0].iter().map(|field| (&*field.name, field.base, field.count)).collect();
        assert_eq!(
            shape,
            [
                ("header", Base::Type(1), Count::One),
                ("label", Base::Text, Count::One),
                ("parts", Base::Type(2), Count::Fixed(2)),
                ("few", Base::F64, Count::Sequence),
            ]
        );
        assert_eq!(schema.types[2].len(), 2);
        // builtin_interfaces/Time is known without the file.
        assert_eq!(schema.types.len(), 4);
        assert!(parse("pkg/msg/Thing", "Lost x\n").is_err());
        assert!(parse("pkg/msg/Thing", "float32\n").is_err());
        Ok(())
    }

    #[test]
    fn names_of_types_are_one() {
        for name in ["unitree_go/msg/LowState", "unitree_go::msg::dds_::LowState_", "unitree_go/LowState"] {
            assert_eq!(short_name(name), "unitree_go/LowState");
        }
    }
}
