//! A decoded message.

use std::rc::Rc;

/// A field's value.
#[derive(Clone, Debug, PartialEq)]
pub(crate) enum Value {
    Number(f64),
    Text(String),
    Numbers(Vec<f64>),
    List(Vec<Value>),
    Struct(Vec<(Rc<str>, Value)>),
}

impl Value {
    /// A field, by the first of `names` that there is.
    pub fn get(&self, names: &[&str]) -> Option<&Value> {
        let Value::Struct(fields) = self else { return None };
        names
            .iter()
            .find_map(|name| fields.iter().find(|(field, _)| &**field == *name).map(|(_, value)| value))
    }

    /// A number.
    pub fn number(&self) -> Option<f64> {
        match self {
            Value::Number(number) => Some(*number),
            _ => None,
        }
    }

    /// Numbers; an empty list has none.
    pub fn numbers(&self) -> Option<Vec<f64>> {
        match self {
            Value::Numbers(numbers) => Some(numbers.clone()),
            Value::List(items) => items.iter().map(Value::number).collect(),
            _ => None,
        }
    }

    /// Words.
    pub fn words(&self) -> Option<Vec<&str>> {
        let Value::List(items) = self else { return None };
        items
            .iter()
            .map(|item| match item {
                Value::Text(text) => Some(text.as_str()),
                _ => None,
            })
            .collect()
    }

    /// Items of a list of structures.
    pub fn items(&self) -> Option<&[Value]> {
        match self {
            Value::List(items) => Some(items),
            _ => None,
        }
    }

    /// The value of a JSON message.
    pub fn from_json(json: &serde_json::Value) -> Value {
        match json {
            // JSON has no NaN: writers put null in its place.
            serde_json::Value::Null => Value::Number(f64::NAN),
            serde_json::Value::Bool(flag) => Value::Number(f64::from(u8::from(*flag))),
            serde_json::Value::Number(number) => Value::Number(number.as_f64().unwrap_or(f64::NAN)),
            serde_json::Value::String(text) => Value::Text(text.clone()),
            serde_json::Value::Array(items) => Value::List(items.iter().map(Value::from_json).collect()),
            serde_json::Value::Object(fields) => {
                let field = |(name, value): (&String, &serde_json::Value)| {
                    (name.as_str().into(), Value::from_json(value))
                };
                Value::Struct(fields.iter().map(field).collect())
            }
        }
    }
}
