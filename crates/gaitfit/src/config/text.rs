//! The text `gaitfit config` prints.

/// A configuration with every setting at its default, commented. `robot` and `logs` have no default.
pub const DEFAULTS: &str = include_str!("adapt.toml");

#[cfg(test)]
#[allow(clippy::unwrap_used, reason = "a failed unwrap is a failed test")]
mod tests {
    use super::*;
    use crate::config::AdaptConfig;

    #[test]
    fn the_printed_defaults_are_the_defaults() {
        let parsed: AdaptConfig = toml::from_str(DEFAULTS).unwrap();
        assert_eq!(parsed, AdaptConfig::default());
    }

    #[test]
    fn every_setting_is_printed() {
        let table: toml::Table = toml::from_str(DEFAULTS).unwrap();
        for (key, value) in toml::Table::try_from(AdaptConfig::default()).unwrap() {
            let printed = table.get(&key).unwrap_or_else(|| panic!("`{key}` is missing"));
            for (inner, _) in value.as_table().into_iter().flatten() {
                assert!(printed.get(inner).is_some(), "`{key}.{inner}` is missing");
            }
        }
        for optional in
            ["name", "kp", "kd", "validate_gains", "rmse_rad", "truth", "published", "lower", "upper"]
        {
            assert!(DEFAULTS.contains(optional), "`{optional}` is not mentioned");
        }
    }
}
