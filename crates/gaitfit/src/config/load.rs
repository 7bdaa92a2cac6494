//! Reading a configuration: the file, then `--set`; errors with file, line, column and the nearest key.

use super::AdaptConfig;
use crate::exit::Failure;
use std::path::Path;
use toml::{Table, Value};

/// Largest configuration file.
const MOST_BYTES: u64 = 16 << 20;

/// Reads `path` and applies `sets` (`a.b=c`; list entries by number, `parameter.0.upper=1`).
pub fn load(path: &Path, sets: &[String]) -> Result<AdaptConfig, Failure> {
    let text = read(path).map_err(|error| {
        Failure::usage(format!(
            "cannot read the configuration {}: {error}. `gaitfit config` prints one to start from.",
            path.display()
        ))
    })?;
    let from_file: AdaptConfig = toml::from_str(&text).map_err(|error| located(path, &text, &error))?;
    if sets.is_empty() {
        return Ok(from_file);
    }
    let mut table: Table = toml::from_str(&text).map_err(|error| located(path, &text, &error))?;
    for set in sets {
        apply(&mut table, set)?;
        table.clone().try_into::<AdaptConfig>().map_err(|error| {
            Failure::usage(format!("--set {set}: {}{}", error.message().trim_end(), nearest(error.message())))
        })?;
    }
    table.try_into().map_err(|error| Failure::usage(format!("{}: {error}", path.display())))
}

/// The text of a regular file of moderate size: a pipe would hang, a device would fill the memory.
fn read(path: &Path) -> std::io::Result<String> {
    let refuse = |why: &str| std::io::Error::new(std::io::ErrorKind::InvalidInput, why.to_owned());
    let data = std::fs::metadata(path)?;
    if !data.is_file() {
        return Err(refuse("not a regular file"));
    }
    if data.len() > MOST_BYTES {
        return Err(refuse("larger than 16 MiB, no configuration"));
    }
    std::fs::read_to_string(path)
}

/// The paragraph for an error at a place of the file.
fn located(path: &Path, text: &str, error: &toml::de::Error) -> Failure {
    let place = error.span().map(|span| line_and_column(text, span.start)).unwrap_or_default();
    let message = error.message().trim_end();
    Failure::usage(format!("{}{place}: {message}{}", path.display(), nearest(message)))
}

fn line_and_column(text: &str, offset: usize) -> String {
    let before = text.get(..offset.min(text.len())).unwrap_or_default();
    let line = before.matches('\n').count() + 1;
    let column = before.rsplit('\n').next().unwrap_or_default().chars().count() + 1;
    format!(":{line}:{column}")
}

/// The known name nearest to the unknown one in a message such as "unknown field `a`, expected one of `b`, `c`".
fn nearest(message: &str) -> String {
    if !message.starts_with("unknown ") {
        return String::new();
    }
    let mut quoted = message.split('`').skip(1).step_by(2);
    let Some(unknown) = quoted.next() else { return String::new() };
    let scored = quoted.map(|known| (strsim::jaro_winkler(unknown, known), known));
    match scored.max_by(|a, b| a.0.total_cmp(&b.0)) {
        Some((score, known)) if score > 0.6 => format!(". Did you mean `{known}`?"),
        _ => String::new(),
    }
}

/// Sets one value of a table by its dotted path.
fn apply(table: &mut Table, set: &str) -> Result<(), Failure> {
    let wrong = |why: String| Failure::usage(format!("--set {set}: {why}"));
    let (path, text) = set
        .split_once('=')
        .ok_or_else(|| wrong("write it as key=value, for example optimizer.seeds=3".to_owned()))?;
    let mut root = Value::Table(std::mem::take(table));
    let mut at = &mut root;
    for key in path.split('.').map(str::trim) {
        at = enter(at, key).ok_or_else(|| wrong(format!("there is no `{key}` in `{path}`")))?;
    }
    *at = parse_value(text.trim());
    if let Value::Table(changed) = root {
        *table = changed;
    }
    Ok(())
}

/// The value under `key`, made when a table lacks it; `None` where there can be none.
fn enter<'a>(at: &'a mut Value, key: &str) -> Option<&'a mut Value> {
    match at {
        Value::Table(table) if !key.is_empty() => {
            Some(table.entry(key).or_insert_with(|| Value::Table(Table::new())))
        }
        Value::Array(array) => array.get_mut(key.parse::<usize>().ok()?),
        _ => None,
    }
}

/// A TOML value; what is none is taken as a plain string.
fn parse_value(text: &str) -> Value {
    let parsed = toml::from_str::<Table>(&format!("value = {text}")).ok();
    match parsed.filter(|table| table.len() == 1).and_then(|mut table| table.remove("value")) {
        Some(value) => value,
        None => Value::String(text.to_owned()),
    }
}

#[cfg(test)]
#[allow(clippy::unwrap_used, reason = "a failed unwrap is a failed test")]
mod tests {
    use super::*;
    use crate::config::CostName;
    use gaitfit_log::PerJoint;
    use std::io::Write;

    fn load_text(text: &str, sets: &[&str]) -> Result<AdaptConfig, Failure> {
        let mut file = tempfile::NamedTempFile::new().unwrap();
        file.write_all(text.as_bytes()).unwrap();
        let sets: Vec<String> = sets.iter().map(|&set| set.to_owned()).collect();
        load(file.path(), &sets)
    }

    #[test]
    fn an_unknown_key_is_refused_with_its_place_and_the_nearest_key() {
        let error = load_text("robot = \"a\"\n[optimizer]\npopulaton = 3\n", &[]).unwrap_err();
        assert_eq!(error.exit, crate::exit::Exit::Usage);
        assert!(error.message.contains(":3:1:"), "{error}");
        assert!(error.message.contains("Did you mean `population`?"), "{error}");
        let error = load_text("[[parameter]]\nkind = \"armatur\"\n", &[]).unwrap_err();
        assert!(error.message.contains("Did you mean `armature`?"), "{error}");
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
        assert_eq!(config.costs, [CostName::Wass]);
        assert_eq!(config.gains.kp, Some(PerJoint::All(20.0)));
        assert_eq!(config.robot, "a/b.xml");
    }

    #[test]
    fn a_wrong_set_is_named() {
        for (set, word) in [
            ("optimizer.seedz=3", "`seeds`"),
            ("optimizer", "key=value"),
            ("parameter.7.upper=1", "`7`"),
            ("optimizer.seeds=\"many\"", "invalid type"),
            ("optimizer..seeds=1", "``"),
        ] {
            let error = load_text("[[parameter]]\nkind = \"delay\"\n", &[set]).unwrap_err();
            assert!(error.message.contains(set) && error.message.contains(word), "{error}");
        }
    }

    #[test]
    fn gains_are_a_number_or_patterns() {
        let config = load_text("gains.kp = { \"*_hip\" = 20, \"*_calf\" = 40 }\n", &[]).unwrap();
        assert!(matches!(config.gains.kp, Some(PerJoint::Named(entries)) if entries.len() == 2));
        let error = load_text("gains.kp = true\n", &[]).unwrap_err();
        assert!(error.message.contains("one number for all joints"), "{error}");
    }
}
