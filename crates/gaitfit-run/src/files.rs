//! Files that a user names: those that are read, and those that a command writes.

use crate::{Access, Error};
use std::fs::{self, File};
use std::io::{self, ErrorKind, Write};
use std::path::{Path, PathBuf};

pub use gaitfit_log::regular_file::{read, read_text, regular};

/// Max number of bytes of a file that a run may have written, and of one that is only hashed.
pub const MAX_BYTES: u64 = 2 << 30;

/// A file that a command writes.
#[derive(Clone, Copy, Debug)]
pub struct Output<'a> {
    /// Where.
    pub path: &'a Path,
    /// Option that names it on the command line, such as `--report`.
    pub option: &'a str,
    /// Ending that its name must have, without the dot; `None` takes any.
    pub ending: Option<&'a str>,
}

/// Refuses outputs that cannot be written, two that are one file, and one that is an input: before any work is done.
///
/// # Errors
/// As it says, naming option, file and remedy.
pub fn check<'a>(outputs: &[Output<'_>], inputs: impl IntoIterator<Item = &'a Path>) -> Result<(), Error> {
    for output in outputs {
        output.check()?;
    }
    // Links and relative paths to one file become equal, so that two names of it are noticed.
    let places: Vec<PathBuf> = outputs.iter().map(|output| place(output.path)).collect();
    for (number, (output, at)) in outputs.iter().zip(&places).enumerate() {
        if let Some(other) = places[..number].iter().position(|place| place == at) {
            return Err(Error::settings(format!(
                "{}: {} and {} are the same file; give each a name of its own",
                output.path.display(),
                outputs[other].option,
                output.option
            )));
        }
    }
    // An input that is replaced at the end would be lost.
    for input in inputs {
        let read = place(input);
        if let Some(number) = places.iter().position(|place| *place == read) {
            return Err(Error::settings(format!(
                "{}: {} would replace a file that this command reads; name another file",
                outputs[number].path.display(),
                outputs[number].option
            )));
        }
    }
    Ok(())
}

impl Output<'_> {
    fn check(&self) -> Result<(), Error> {
        let Self { path, option, ending } = self;
        let shown = path.display();
        let ends =
            |ending: &str| path.extension().is_some_and(|extension| extension.eq_ignore_ascii_case(ending));
        if let Some(ending) = ending.filter(|ending| !ends(ending)) {
            return Err(Error::settings(format!(
                "{shown}: {option} writes a file whose name ends in .{ending}"
            )));
        }
        // Replacing a device or a pipe by a file would break it for every other program.
        if path.exists() && !path.is_file() {
            return Err(Error::settings(format!(
                "{shown}: exists and is not a regular file; name a file to write"
            )));
        }
        // Only a file tells whether a folder takes files.
        tempfile::tempfile_in(folder_of(path)).map(|_| ()).map_err(|source| Error::File {
            access: Access::Write,
            path: path.to_path_buf(),
            source,
            remedy: format!("; {option} needs a folder that exists and can be written to. Nothing was done."),
        })
    }
}

/// The folder that a file lies in.
fn folder_of(path: &Path) -> &Path {
    path.parent().filter(|parent| !parent.as_os_str().is_empty()).unwrap_or(Path::new("."))
}

/// Where a file is or will be, whatever names lead there.
fn place(path: &Path) -> PathBuf {
    fs::canonicalize(path).unwrap_or_else(|_| {
        // A file that does not exist yet has no canonical path, but its folder has one.
        let folder = fs::canonicalize(folder_of(path)).unwrap_or_else(|_| folder_of(path).to_owned());
        path.file_name().map_or_else(|| folder.clone(), |name| folder.join(name))
    })
}

/// Returns a remedy for an error that says that a file has no room; else nothing.
pub(crate) fn room(error: &io::Error) -> &'static str {
    match error.kind() {
        ErrorKind::StorageFull | ErrorKind::QuotaExceeded | ErrorKind::FileTooLarge => {
            "; free some space, or raise the limit of file sizes (`ulimit -f`)"
        }
        _ => "",
    }
}

/// Refuses what is there and is no regular file: opening a pipe would wait for ever.
pub(crate) fn no_pipe(path: &Path) -> io::Result<()> {
    match regular(path) {
        Err(error) if error.kind() == ErrorKind::InvalidInput => {
            // The kind tells callers that something is in the place of the file.
            Err(io::Error::new(ErrorKind::AlreadyExists, error))
        }
        _ => Ok(()),
    }
}

/// Temporary files are private by default; these become results that others may read, as the umask says.
#[cfg(unix)]
pub fn readable<'a, 'b, 'c>(builder: &'c mut tempfile::Builder<'a, 'b>) -> &'c mut tempfile::Builder<'a, 'b> {
    use std::os::unix::fs::PermissionsExt;
    builder.permissions(std::fs::Permissions::from_mode(0o666))
}

/// Leaves the permissions to the system.
#[cfg(not(unix))]
pub fn readable<'a, 'b, 'c>(builder: &'c mut tempfile::Builder<'a, 'b>) -> &'c mut tempfile::Builder<'a, 'b> {
    builder
}

/// Writes a file whole or not at all.
pub fn write(path: &Path, bytes: &[u8]) -> Result<(), Error> {
    write_with(path, |file| file.write_all(bytes))
}

/// Writes a file whole or not at all; `fill` writes what it holds, and flushes its own buffers.
pub fn write_with(path: &Path, fill: impl FnOnce(&mut File) -> io::Result<()>) -> Result<(), Error> {
    let whole = || -> io::Result<()> {
        // In the same folder, because a rename is only atomic within one file system.
        let mut file = readable(&mut tempfile::Builder::new()).tempfile_in(folder_of(path))?;
        fill(file.as_file_mut())?;
        // Before the rename: after a power failure the name must not lead to an empty file.
        file.as_file().sync_all()?;
        file.persist(path).map_err(|error| error.error)?;
        Ok(())
    };
    whole().map_err(|source| Error::File {
        access: Access::Write,
        path: path.to_owned(),
        remedy: format!("; nothing was changed{}", room(&source)),
        source,
    })
}

#[cfg(test)]
#[allow(clippy::unwrap_used, reason = "a failed unwrap is a failed test")]
mod tests {
    use super::*;

    #[cfg(unix)]
    #[test]
    fn outputs_are_neither_each_other_nor_an_input() {
        let folder = tempfile::tempdir().unwrap();
        let path = |name: &str| folder.path().join(name);
        for (name, to) in [("link.html", "page.html"), ("in.html", "model.html")] {
            std::os::unix::fs::symlink(path(to), path(name)).unwrap();
        }
        let checked = |outputs: &[(&str, PathBuf)], inputs: &[PathBuf]| {
            let outputs: Vec<Output<'_>> =
                outputs.iter().map(|(option, path)| Output { path, option, ending: Some("html") }).collect();
            check(&outputs, inputs.iter().map(PathBuf::as_path)).map_err(|error| error.to_string())
        };
        let two = |second: PathBuf| checked(&[("--report", path("page.html")), ("--replay", second)], &[]);
        two(path("other.html")).unwrap();
        for second in [path("page.html"), path("./page.html")] {
            let error = two(second).unwrap_err();
            assert!(error.contains("--report and --replay are the same file"), "{error}");
        }
        fs::write(path("page.html"), "earlier").unwrap();
        assert!(two(path("link.html")).unwrap_err().contains("same file"));
        fs::write(path("model.html"), "robot").unwrap();
        let error = checked(&[("--report", path("in.html"))], &[path("model.html")]).unwrap_err();
        assert!(error.contains("would replace a file that this command reads"), "{error}");
        let error = checked(&[("--report", path("none/page.html"))], &[]).unwrap_err();
        assert!(error.contains("none/page.html") && error.contains("--report needs a folder"), "{error}");
    }
}
