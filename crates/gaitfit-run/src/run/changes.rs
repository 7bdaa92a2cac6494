//! Settings of a run that is to be continued, beside those it was begun with.

use gaitfit_model::escaped;
use toml::{Table, Value};

/// Max number of characters of a value in a message.
const MAX_SHOWN: usize = 120;

/// `settings` without those called `free`, dotted names such as `train.iterations`.
pub fn bound(mut settings: Table, free: &[&str]) -> Value {
    for name in free {
        remove(&mut settings, name);
    }
    Value::Table(settings)
}

fn remove(table: &mut Table, name: &str) {
    match name.split_once('.') {
        None => {
            table.remove(name);
        }
        Some((first, rest)) => {
            if let Some(Value::Table(inner)) = table.get_mut(first) {
                remove(inner, rest);
            }
        }
    }
}

/// The first setting that differs, in words; `None` if all are the same.
pub fn difference(saved: &Value, wanted: &Value) -> Option<String> {
    at("", saved, wanted)
}

/// `path`: where the values are.
fn at(path: &str, saved: &Value, wanted: &Value) -> Option<String> {
    let inner = |key: &str| if path.is_empty() { key.to_owned() } else { format!("{path}.{key}") };
    match (saved, wanted) {
        (Value::Table(saved), Value::Table(wanted)) => {
            // Keys that were removed or changed come first, in the saved order; then keys that are new.
            for (key, value) in saved {
                let difference = match wanted.get(key) {
                    Some(other) => at(&inner(key), value, other),
                    None => Some(format!("`{}` was {}, now it is not set", inner(key), shown(value))),
                };
                if difference.is_some() {
                    return difference;
                }
            }
            let (key, value) = wanted.iter().find(|(key, _)| !saved.contains_key(*key))?;
            Some(format!("`{}` was not set, now it is {}", inner(key), shown(value)))
        }
        (Value::Array(saved), Value::Array(wanted))
            // Arrays of tables of equal length are compared entry by entry, so that the message names the entry.
            if saved.len() == wanted.len() && saved.iter().chain(wanted).all(Value::is_table) =>
        {
            let mut entries = saved.iter().zip(wanted).enumerate();
            entries.find_map(|(index, (saved, wanted))| at(&inner(&index.to_string()), saved, wanted))
        }
        // Not a number is what it was.
        (Value::Float(saved), Value::Float(wanted)) if saved.to_bits() == wanted.to_bits() => None,
        _ => (saved != wanted).then(|| format!("`{path}` was {}, now it is {}", shown(saved), shown(wanted))),
    }
}

fn shown(value: &Value) -> String {
    escaped(&value.to_string(), MAX_SHOWN)
}

#[cfg(test)]
#[allow(clippy::unwrap_used, reason = "a failed unwrap is a failed test")]
mod tests {
    use super::*;

    fn compare(saved: &str, wanted: &str, free: &[&str]) -> Option<String> {
        let table = |text: &str| bound(toml::from_str(text).unwrap(), free);
        difference(&table(saved), &table(wanted))
    }

    #[test]
    fn the_first_difference_is_named_wherever_it_lies() {
        let text = "a = 1\n[[p]]\nx = 0.5\n[[p]]\nx = 1.5\n[t]\ny = nan\n";
        assert_eq!(compare(text, text, &[]), None);
        let changed = text.replace("x = 1.5", "x = 2.5");
        assert_eq!(compare(text, &changed, &[]).unwrap(), "`p.1.x` was 1.5, now it is 2.5");
        let more = format!("{text}z = 3\n");
        assert_eq!(compare(text, &more, &[]).unwrap(), "`t.z` was not set, now it is 3");
        assert_eq!(compare(&more, text, &[]).unwrap(), "`t.z` was 3, now it is not set");
    }

    #[test]
    fn free_settings_do_not_count() {
        let text = "a = 1\n[t]\ny = 2\nz = 3\n";
        let changed = "a = 9\n[t]\ny = 8\nz = 3\n";
        assert_eq!(compare(text, changed, &["a", "t.y", "none.such"]), None);
        assert_eq!(compare(text, changed, &["a"]).unwrap(), "`t.y` was 2, now it is 8");
    }

    #[test]
    fn long_values_are_cut_and_control_characters_escaped() {
        let text = compare("a = \"x\"\n", &format!("a = \"\\u001b{}\"\n", "y".repeat(5000)), &[]).unwrap();
        assert!(text.len() < 400 && !text.contains('\u{1b}'), "{text}");
    }
}
