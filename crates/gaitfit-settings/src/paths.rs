//! Where a configuration's relative paths lead, and how it names a file.

use crate::Error;
use std::path::{Path, PathBuf};

/// `file` as the configuration `out`, which is to be written, names it: paths are looked up in the current folder first,
/// then in the configuration's. One that is written elsewhere gets the whole path.
pub fn named(file: &Path, out: &Path) -> String {
    let here = out.parent().is_none_or(|folder| folder.as_os_str().is_empty() || folder == Path::new("."));
    // A file that does not exist yet has no whole path, and keeps the name that it was given.
    let whole = if here { None } else { std::fs::canonicalize(file).ok() };
    whole.as_deref().unwrap_or(file).display().to_string()
}

/// The file `named` in the configuration `config`: as seen from the current directory, or else from the
/// configuration's own folder.
pub fn find(named: &str, what: &str, config: &Path) -> Result<PathBuf, Error> {
    // The current directory comes first, as for every path on a command line.
    let here = PathBuf::from(named);
    if here.exists() {
        return Ok(here);
    }
    let beside = config.parent().unwrap_or(Path::new("")).join(&here);
    if beside.exists() {
        return Ok(beside);
    }
    // The built-in robot has a name, but no file.
    if what == "robot" && crate::robot::is_built_in(&here) {
        return Err(Error::settings(format!(
            "{}: {what} `{named}`: the built-in Go2 is used where no robot is named; leave the name out",
            config.display()
        )));
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
