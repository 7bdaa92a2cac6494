//! Files that the command line names to be written.

use crate::{Access, Error};
use std::fs::File;
use std::io::Write;
use std::path::Path;

/// Refuses a name that does not end in `.ending`, or that is not a file.
pub fn check(path: &Path, option: &str, ending: &str) -> Result<(), Error> {
    let shown = path.display();
    if path.extension().is_none_or(|found| !found.eq_ignore_ascii_case(ending)) {
        return Err(Error::settings(format!("{shown}: {option} writes a file whose name ends in .{ending}")));
    }
    // Replacing a device or a pipe by a file would break it for every other program.
    if path.exists() && !path.is_file() {
        return Err(Error::settings(format!(
            "{shown}: exists and is not a regular file; name a file to write"
        )));
    }
    Ok(())
}

/// Writes a file whole or not at all.
pub fn write(path: &Path, bytes: &[u8]) -> Result<(), Error> {
    write_with(path, |file| file.write_all(bytes))
}

/// Writes a file whole or not at all; `fill` writes what it holds, and flushes its own buffers.
pub fn write_with(path: &Path, fill: impl FnOnce(&mut File) -> std::io::Result<()>) -> Result<(), Error> {
    let parent = path.parent().filter(|parent| !parent.as_os_str().is_empty()).unwrap_or(Path::new("."));
    let whole = || -> std::io::Result<()> {
        let mut file = crate::run::readable(&mut tempfile::Builder::new()).tempfile_in(parent)?;
        fill(file.as_file_mut())?;
        file.as_file().sync_all()?;
        file.persist(path).map_err(|error| error.error)?;
        Ok(())
    };
    whole().map_err(|source| Error::File {
        access: Access::Write,
        path: path.to_owned(),
        source,
        remedy: "; nothing was changed".to_owned(),
    })
}
