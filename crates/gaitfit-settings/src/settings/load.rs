//! Reading a configuration: the file, then `--set`; errors with file, line, column and the nearest key.

use super::messages::{MAX_MESSAGE, MAX_SET, explained, line_and_column, located, tamed};
use crate::Error;
use crate::files::read_text;
use serde::de::DeserializeOwned;
use std::borrow::Cow;
use std::path::Path;
use toml::Spanned;
use toml::de::{DeTable, DeValue, Deserializer};

/// Largest configuration file.
pub(super) const MAX_BYTES: u64 = 16 << 20;

/// A command's settings.
pub trait Configuration: DeserializeOwned {
    /// Command that prints a file to start from, for advice.
    const PRINTED_BY: &'static str;
    /// A `--set` that may stand as an example.
    const EXAMPLE: &'static str;

    /// Fills in defaults that depend on other settings, before the table is read. What is already there keeps its
    /// place in the file.
    fn complete(_table: &mut DeTable<'_>) {}
}

/// Reads `path` (without one: the defaults) and applies `sets` (`a.b=c`; list entries by number,
/// `parameter.0.upper=1`).
pub fn load<C: Configuration>(path: Option<&Path>, sets: &[String]) -> Result<C, Error> {
    // A log or a robot in the place of a configuration gets a message of its own.
    if let Some(other) = path.and_then(no_configuration) {
        return Err(Error::settings(other));
    }
    // Tables borrow from these texts.
    let text = path
        .map(|path| read_text(path, MAX_BYTES).map_err(|error| unreadable::<C>(path, &error)))
        .transpose()?;
    let values = sets.iter().map(|set| value_text(set, C::EXAMPLE)).collect::<Result<Vec<_>, _>>()?;
    let mut table = DeTable::new();
    if let (Some(path), Some(text)) = (path, &text) {
        let located = |error| located(path, text, &error);
        table = DeTable::parse(text).map_err(located)?.into_inner();
        if let Some((wrong, place)) = too_large("", &table) {
            return Err(Error::settings(format!(
                "{}{}: {wrong}",
                path.display(),
                line_and_column(text, place)
            )));
        }
        // Read once for the file and once after every `--set`, so that an error names the one that is wrong.
        understand::<C>(table.clone()).map_err(located)?;
    }
    for (set, (key, line)) in sets.iter().zip(&values) {
        // Checked after each `--set`, because each may make the table too large or wrong.
        apply(&mut table, set, key, line)?;
        let wrong = |wrong: &str| Error::settings(format!("--set {}: {wrong}", tamed(set, MAX_SET)));
        if let Some((large, _)) = too_large("", &table) {
            return Err(wrong(&large));
        }
        understand::<C>(table.clone()).map_err(|error| wrong(&explained(&error)))?;
    }
    understand(table).map_err(|error| Error::settings(tamed(error.message(), MAX_MESSAGE)))
}

/// The first whole number that TOML does not have, in words, and its place.
pub(super) fn too_large(path: &str, table: &DeTable<'_>) -> Option<(String, usize)> {
    table.iter().find_map(|(key, value)| {
        let path =
            if path.is_empty() { key.get_ref().to_string() } else { format!("{path}.{}", key.get_ref()) };
        too_large_value(&path, value)
    })
}

fn too_large_value(path: &str, value: &Spanned<DeValue<'_>>) -> Option<(String, usize)> {
    match value.get_ref() {
        DeValue::Table(table) => too_large(path, table),
        DeValue::Array(array) => array.iter().find_map(|value| too_large_value(path, value)),
        // The parser keeps the digits as text, so a number of any length comes this far.
        DeValue::Integer(number) if i64::from_str_radix(number.as_str(), number.radix()).is_err() => {
            let shown = tamed(&number.to_string(), MAX_SET);
            let (min, max) = (i64::MIN, i64::MAX);
            Some((format!("`{path}` has {shown}; whole numbers go from {min} to {max}"), value.span().start))
        }
        _ => None,
    }
}

/// Names the kind of a file that by its ending is no configuration, and the command that takes it.
fn no_configuration(path: &Path) -> Option<String> {
    let shown = path.display();
    let ending = path.extension()?.to_string_lossy().to_lowercase();
    let what = match ending.as_str() {
        "csv" => {
            format!(
                "a log. `gaitfit new --robot ROBOT --logs {shown} --out my-robot.toml` writes a configuration"
            )
        }
        "xml" | "mjcf" | "urdf" => {
            format!(
                "a robot. `gaitfit new --robot {shown} --logs LOGS --out my-robot.toml` writes a configuration"
            )
        }
        "safetensors" | "onnx" => {
            format!(
                "a policy. `gaitfit new --policy {shown} --logs LOGS --out my-robot.toml` writes a configuration"
            )
        }
        _ => return None,
    };
    Some(format!("{shown} is no configuration but {what}"))
}

fn unreadable<C: Configuration>(path: &Path, error: &std::io::Error) -> Error {
    Error::settings(format!(
        "cannot read the configuration {}: {error}. `{}` prints one to start from.",
        path.display(),
        C::PRINTED_BY
    ))
}

/// The settings of a table.
fn understand<C: Configuration>(mut table: DeTable<'_>) -> Result<C, toml::de::Error> {
    C::complete(&mut table);
    // The whole table has no place of its own in the file; its keys and values have theirs.
    C::deserialize(Deserializer::from(Spanned::new(0..0, table)))
}

/// Lays `over` upon `under`, key by key; tables are merged, everything else is replaced. Places in the file are those
/// of `over`.
/// With `clear = true` a table leaves nothing of the one that it is laid upon.
pub fn merge<'a>(under: &mut DeTable<'a>, mut over: DeTable<'a>) {
    // A `clear` that is no truth value is left, and is refused when the table is read.
    if matches!(over.get(CLEAR).map(Spanned::get_ref), Some(DeValue::Boolean(_))) {
        let clear = over.remove(CLEAR);
        if matches!(clear.as_ref().map(Spanned::get_ref), Some(DeValue::Boolean(true))) {
            *under = DeTable::new();
        }
    }
    for (key, mut value) in over {
        match under.get_mut(&key) {
            // A new table may hold `clear` keys of its own, so it is laid upon an empty one.
            None => {
                if let DeValue::Table(own) = value.get_mut() {
                    let changes = std::mem::take(own);
                    merge(own, changes);
                }
                under.insert(key, value);
            }
            Some(old) => {
                let span = value.span();
                let merged = match (taken(old.get_mut()), value.into_inner()) {
                    (DeValue::Table(mut inner), DeValue::Table(changes)) => {
                        merge(&mut inner, changes);
                        DeValue::Table(inner)
                    }
                    // A table that replaces a value: again laid upon an empty one.
                    (_, DeValue::Table(changes)) => {
                        let mut inner = DeTable::new();
                        merge(&mut inner, changes);
                        DeValue::Table(inner)
                    }
                    (_, value) => value,
                };
                *old = Spanned::new(span, merged);
            }
        }
    }
}

/// The key with which a table replaces the one that it is laid upon.
pub const CLEAR: &str = "clear";

/// The value, leaving a placeholder.
pub fn taken<'a>(value: &mut DeValue<'a>) -> DeValue<'a> {
    std::mem::replace(value, DeValue::Boolean(false))
}

/// The key of a `--set`, and its value as the line `value = …`.
fn value_text<'a>(set: &'a str, example: &str) -> Result<(&'a str, String), Error> {
    // The first `=` ends the key. The value may contain more of them.
    match set.split_once('=') {
        Some((key, value)) if !key.trim().is_empty() => Ok((key, format!("value = {}", value.trim()))),
        _ => Err(Error::settings(format!(
            "--set {}: write it as key=value, for example {example}",
            tamed(set, MAX_SET)
        ))),
    }
}

/// Sets one value of a table by its dotted path.
fn apply<'a>(table: &mut DeTable<'a>, set: &str, path: &str, line: &'a str) -> Result<(), Error> {
    // Taken out, because the way leads through tables and lists alike.
    let mut root = DeValue::Table(std::mem::take(table));
    let mut at = &mut root;
    for key in path.split('.').map(str::trim) {
        at = enter(at, key).ok_or_else(|| {
            let [set, key, path] = [set, key, path].map(|text| tamed(text, MAX_SET));
            Error::settings(match key.is_empty() {
                true => format!("--set {set}: `{path}` has an empty name between its dots"),
                false => format!("--set {set}: there is no `{key}` in `{path}`"),
            })
        })?;
    }
    *at = parse_value(line);
    // A path has at least one name, so only what lies within `root` was replaced, and it is still a table.
    if let DeValue::Table(changed) = root {
        *table = changed;
    }
    Ok(())
}

/// The value under `key`, made when a table lacks it; `None` where there can be none.
fn enter<'a, 't>(at: &'a mut DeValue<'t>, key: &str) -> Option<&'a mut DeValue<'t>> {
    match at {
        DeValue::Table(table) if !key.is_empty() => {
            // A `--set` has no place in the file.
            let key = Spanned::new(0..0, Cow::Owned(key.to_owned()));
            let empty = || Spanned::new(0..0, DeValue::Table(DeTable::new()));
            Some(table.entry(key).or_insert_with(empty).get_mut())
        }
        // Entries of a list can be changed, but not added.
        DeValue::Array(array) => array.get_mut(key.parse::<usize>().ok()?).map(Spanned::get_mut),
        _ => None,
    }
}

/// The TOML value of a line `value = …`; what is none is taken as a plain string.
fn parse_value(line: &str) -> DeValue<'_> {
    // Shells remove quotes, so a path or name need not have any.
    let parsed = DeTable::parse(line).ok().map(Spanned::into_inner);
    // A value with line breaks could add further keys to the line. It is then a plain string.
    match parsed.filter(|table| table.len() == 1).and_then(|mut table| table.remove("value")) {
        Some(value) => value.into_inner(),
        None => DeValue::String(Cow::Borrowed(line.strip_prefix("value = ").unwrap_or(line))),
    }
}

#[cfg(test)]
#[allow(clippy::unwrap_used, reason = "a failed unwrap is a failed test")]
mod tests {
    use super::*;
    use crate::settings::{AdaptConfig, TrainConfig};
    use gaitfit_adapt::cost::CostKind;
    use gaitfit_log::PerJoint;
    use std::io::Write;

    fn load_text(text: &str, sets: &[&str]) -> Result<AdaptConfig, Error> {
        let mut file = tempfile::NamedTempFile::new().unwrap();
        file.write_all(text.as_bytes()).unwrap();
        let sets: Vec<String> = sets.iter().map(|&set| set.to_owned()).collect();
        load(Some(file.path()), &sets)
    }

    fn train(text: &str) -> Result<TrainConfig, Error> {
        let mut file = tempfile::NamedTempFile::new().unwrap();
        file.write_all(text.as_bytes()).unwrap();
        load(Some(file.path()), &[])
    }

    #[test]
    fn an_unknown_key_is_refused_with_its_place_and_the_nearest_key() {
        let error = load_text("robot = \"a\"\n[optimizer]\npopulaton = 3\n", &[]).unwrap_err();
        assert_eq!(error.kind(), gaitfit_run::ErrorKind::Settings);
        assert!(error.to_string().contains(":3:1:"), "{error}");
        assert!(error.to_string().contains("Did you mean `population`?"), "{error}");
        let error = load_text("[adapt]\nswings = true\n", &[]).unwrap_err();
        assert!(error.to_string().contains("run `gaitfit loop`"), "{error}");
        let error = load_text("[[parameter]]\nkind = \"armatur\"\n", &[]).unwrap_err();
        assert!(error.to_string().contains("Did you mean `armature`?"), "{error}");
    }

    #[test]
    fn set_changes_nested_listed_and_new_values() {
        let text = "[[parameter]]\nkind = \"delay\"\nper = \"all\"\n";
        let sets = [
            "parameter.0.upper=0.05",
            "optimizer.seeds=2",
            "costs=[\"wass\"]",
            "gains.kp=20",
            "robot=a/b.xml",
        ];
        let config = load_text(text, &sets).unwrap();
        assert_eq!(config.parameter[0].upper, Some(0.05));
        assert_eq!(config.optimizer.seeds, 2);
        assert_eq!(config.costs, [CostKind::Wass]);
        assert_eq!(config.gains.kp, Some(PerJoint::All(20.0)));
        assert_eq!(config.robot, "a/b.xml");
        let text = load_text("", &["robot=value = a.xml"]).unwrap().robot;
        assert_eq!(text, "value = a.xml", "a value may begin as the line does");
    }

    #[test]
    fn a_wrong_set_is_named() {
        for (set, word) in [
            ("optimizer.seedz=3", "`seeds`"),
            ("optimizer", "key=value"),
            ("parameter.7.upper=1", "`7`"),
            ("optimizer.seeds=\"many\"", "expected a whole number, 0 or more"),
            ("optimizer.generations=-1", "expected a whole number, 0"),
            ("=", "write it as key=value"),
            ("=3", "write it as key=value"),
            ("optimizer..seeds=1", "an empty name between its dots"),
        ] {
            let error = load_text("[[parameter]]\nkind = \"delay\"\n", &[set]).unwrap_err();
            assert!(error.to_string().contains(set) && error.to_string().contains(word), "{error}");
        }
    }

    #[test]
    fn gains_are_a_number_or_patterns() {
        let config = load_text("gains.kp = { \"*_hip\" = 20, \"*_calf\" = 40 }\n", &[]).unwrap();
        assert!(matches!(config.gains.kp, Some(PerJoint::Named(entries)) if entries.len() == 2));
        let error = load_text("gains.kp = true\n", &[]).unwrap_err();
        assert!(error.to_string().contains("one number for all joints"), "{error}");
    }

    #[test]
    fn a_wrong_task_setting_has_its_place_in_the_file() {
        for (text, words) in [
            ("[task.command]\nz = 1\n", [":2:1:", "unknown field `z`"]),
            ("[task]\n\nhight = 1\n", [":3:1:", "Did you mean `height`?"]),
            ("[task.command]\nx = \"fast\"\n", [":2:5:", "invalid type"]),
            ("[task.command]\n\nx = [1.0]\n", [":3:5:", "invalid length"]),
            ("[task]\nbase = \"bipe\"\n", [":2:8:", "Did you mean `biped`?"]),
            ("[ppo]\ngama = 1\n", [":2:1:", "Did you mean `gamma`?"]),
            ("[train]\niterations = -3\n", [":2:14:", "invalid value"]),
            ("\ntask = 3\n", [":2:8:", "invalid type"]),
        ] {
            let error = train(text).unwrap_err();
            assert!(words.iter().all(|word| error.to_string().contains(word)), "{text}: {error}");
        }
    }

    #[test]
    fn numbers_that_toml_does_not_have_are_named() {
        let huge = "18446744073709551615";
        let error = train(&format!("\nseeds = [1, {huge}]\n")).unwrap_err();
        assert!(error.to_string().contains(&format!(":2:13: `seeds` has {huge}")), "{error}");
        let error = load::<TrainConfig>(None, &[format!("seeds=[{huge}]")]).unwrap_err();
        assert!(error.to_string().contains("`seeds` has"), "{error}");
        assert_eq!(error.key(), Some("seeds"));
        let error = load_text("", &[&format!("optimizer.seed={huge}")]).unwrap_err();
        assert_eq!(error.key(), Some("optimizer.seed"));
        assert!(train("seeds = [9223372036854775807]\n").is_ok());
    }

    #[test]
    fn messages_have_neither_long_numbers_nor_control_characters() {
        let digits = "9".repeat(300);
        for set in [
            format!("optimizer.seeds={digits}"),
            "optimizer.seeds=1e300".to_owned(),
            format!("optimizer.seeds=\"{digits}\""),
            format!("optimizer.{digits}=1"),
            "optimizer.\u{1b}[2J=1".to_owned(),
            format!("\u{1b}{}", "x".repeat(5000)),
        ] {
            let error = load_text("", &[&set]).unwrap_err().to_string();
            assert!(!error.contains('\u{1b}') && !error.contains(&"9".repeat(41)), "{error}");
            assert!(!error.contains(&"0".repeat(41)) && error.len() < 1500, "{}: {error}", error.len());
        }
    }

    #[test]
    fn a_resolved_configuration_reads_as_itself() {
        for text in ["", "task = \"biped\"\n", "[task.policy.default_pose]\n\"FL_*\" = 0.2\n"] {
            let config = train(text).unwrap();
            let resolved = toml::to_string_pretty(&config).unwrap();
            assert_eq!(train(&resolved).unwrap(), config, "{resolved}");
        }
    }
}
