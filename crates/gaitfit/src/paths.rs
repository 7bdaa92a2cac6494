//! Where a configuration's relative paths lead.

use crate::Error;
use std::path::{Path, PathBuf};

/// The file `named` in the configuration `config`: as seen from the current directory, or else from the
/// configuration's own folder.
pub fn find(named: &str, what: &str, config: &Path) -> Result<PathBuf, Error> {
    let here = PathBuf::from(named);
    if here.exists() {
        return Ok(here);
    }
    let beside = config.parent().unwrap_or(Path::new("")).join(&here);
    if beside.exists() {
        return Ok(beside);
    }
    let looked = if here.is_absolute() || beside == here {
        String::new()
    } else {
        format!(" (looked for {} and {} in the current directory)", beside.display(), here.display())
    };
    Err(Error::settings(format!(
        "{}: {what} `{named}` does not exist{looked}. Run from the folder its path starts from, or correct the \
         path in the file or with --set.",
        config.display()
    )))
}
