//! Pieces that the pages of several commands are made of.

use crate::Error;
use crate::machine::machine;
use gaitfit_view::Setting;
use serde::Serialize;

/// A resolved configuration, one line a value.
pub fn settings<C: Serialize>(config: &C) -> Result<Vec<Setting>, Error> {
    fn flatten(name: &str, value: &toml::Value, into: &mut Vec<Setting>) {
        match value {
            toml::Value::Table(table) => {
                for (key, value) in table {
                    let name = if name.is_empty() { key.clone() } else { format!("{name}.{key}") };
                    flatten(&name, value, into);
                }
            }
            // Arrays of tables are listed by number, plain arrays stay one value.
            toml::Value::Array(array) if array.iter().any(toml::Value::is_table) => {
                for (index, value) in array.iter().enumerate() {
                    flatten(&format!("{name}.{index}"), value, into);
                }
            }
            _ => into.push(Setting { name: name.to_owned(), value: value.to_string() }),
        }
    }
    let value = toml::Value::try_from(config)
        .map_err(|error| Error::failed(format!("cannot list the settings: {error}")))?;
    let mut settings = Vec::new();
    flatten("", &value, &mut settings);
    Ok(settings)
}

/// Program and machine.
pub fn versions() -> Vec<Setting> {
    let machine = machine();
    [
        ("gaitfit", machine.gaitfit.to_owned()),
        ("platform", machine.platform),
        ("processor", machine.processor),
        ("threads", machine.threads.to_string()),
        ("features", machine.features.join(", ")),
    ]
    .map(|(name, value)| Setting { name: name.to_owned(), value })
    .to_vec()
}
