//! The files that a configuration's `logs` name: files, folders and patterns.

use crate::Error;
use crate::paths;
use gaitfit_log::{check_entry, csv_files};
use gaitfit_model::shown_path;
use globset::GlobBuilder;
use std::collections::BTreeSet;
use std::path::{Path, PathBuf};

/// Most files of one configuration, and most folder entries looked at for one pattern.
const MAX_FILES: usize = 100_000;

/// A log file and what to call it.
#[derive(Clone, Debug, PartialEq, Eq)]
pub struct LogFile {
    /// The name in messages.
    pub name: String,
    /// The path to it.
    pub path: PathBuf,
}

/// The files that `named` lists, in its order, files of one entry by name; and warnings about those listed twice,
/// which are taken once. An entry is a file, a folder (all its `*.csv`) or a pattern (`logs/run_*.csv`), seen from
/// the current directory or else from the configuration's folder.
///
/// # Errors
/// An entry that names nothing.
pub fn find(named: &[String], config_path: &Path) -> Result<(Vec<LogFile>, Vec<String>), Error> {
    let mut files: Vec<LogFile> = Vec::new();
    let mut seen = BTreeSet::new();
    let mut warnings = Vec::new();
    for entry in named {
        for path in of_entry(entry, config_path)? {
            // The same file may be named through a link or another relative path.
            let identity = path.canonicalize().unwrap_or_else(|_| path.clone());
            if !seen.insert(identity) {
                warnings.push(format!("{}: `logs` names this file twice; it counts once", path.display()));
                continue;
            }
            if files.len() == MAX_FILES {
                return Err(Error::settings(format!("`logs` names more than {MAX_FILES} files")));
            }
            files.push(LogFile { name: path.display().to_string(), path });
        }
    }
    if files.is_empty() {
        return Err(Error::settings(format!(
            "{}: `logs` names no files; name the robot's logs, their folder, or a pattern such as \"logs/*.csv\"",
            config_path.display()
        )));
    }
    Ok((files, warnings))
}

fn of_entry(entry: &str, config_path: &Path) -> Result<Vec<PathBuf>, Error> {
    // A file whose name looks like a pattern is that file.
    let pattern = entry.contains(['*', '?', '[', '{'])
        && !Path::new(entry).exists()
        && !beside(entry, config_path).exists();
    if pattern {
        return matching(entry, config_path);
    }
    let path = paths::find(entry, "log", config_path)?;
    if !path.is_dir() {
        return Ok(vec![path]);
    }
    let files = csv_files(&path).map_err(Error::failed)?;
    if files.is_empty() {
        return Err(Error::settings(format!(
            "{}: the folder {} holds no *.csv files; name the folder with the robot's logs",
            config_path.display(),
            path.display()
        )));
    }
    Ok(files)
}

fn beside(entry: &str, config_path: &Path) -> PathBuf {
    config_path.parent().unwrap_or(Path::new("")).join(entry)
}

/// Files that match a pattern; a `*` does not cross folders, `**` does.
fn matching(entry: &str, config_path: &Path) -> Result<Vec<PathBuf>, Error> {
    let here = PathBuf::from(entry);
    let beside = beside(entry, config_path);
    let mut passed_over = None;
    // As for single files: the current directory comes before the configuration's folder.
    for pattern in [&here, &beside] {
        let text = pattern.to_string_lossy();
        let glob = GlobBuilder::new(&text).literal_separator(true).build().map_err(|error| {
            Error::settings(format!(
                "{}: `logs` has `{entry}`, which is no file pattern: {}",
                config_path.display(),
                error.kind()
            ))
        })?;
        // The folders before the first wildcard are names.
        let plain = |part: &std::path::Component<'_>| {
            !part.as_os_str().to_string_lossy().contains(['*', '?', '[', '{'])
        };
        let root: PathBuf = pattern.components().take_while(plain).collect();
        // `**` stands for any number of folders; a number bounds the search.
        let depth =
            if text.contains("**") { 16 } else { pattern.components().count() - root.components().count() };
        let matcher = glob.compile_matcher();
        let mut paths = Vec::new();
        walk(&root, depth, &mut 0, &mut |path, linked_folder| {
            if linked_folder {
                passed_over.get_or_insert_with(|| path.to_owned());
            } else if matcher.is_match(path) {
                paths.push(path.to_owned());
            }
        })?;
        paths.iter().try_for_each(|path| check_entry(path)).map_err(Error::failed)?;
        if !paths.is_empty() {
            // Folders list their files in any order; the fit must not depend on it.
            paths.sort();
            return Ok(paths);
        }
    }
    let link = passed_over.map_or_else(String::new, |link| {
        let target = std::fs::read_link(&link).unwrap_or_default();
        format!(
            ". The link {} to the folder {} was not followed: patterns do not follow links to folders, which may lead in \
             circles; name that folder itself",
            shown_path(&link),
            shown_path(&target)
        )
    });
    Err(Error::settings(format!(
        "{}: no file matches the log pattern `{entry}` (seen from the current directory and from the configuration's \
         folder); correct the pattern, or record logs there{link}",
        config_path.display()
    )))
}

/// Hands all files at most `depth` folders below `folder` to `take`; a folder that is not there has none. `take` also
/// gets links to folders, with `true`: they are not followed, because they may lead in circles.
fn walk(
    folder: &Path,
    depth: usize,
    visited: &mut usize,
    take: &mut dyn FnMut(&Path, bool),
) -> Result<(), Error> {
    let entries = match folder {
        // A pattern without a folder searches the current one, whose `.` must not become a part of names.
        folder if folder.as_os_str().is_empty() => list(Path::new(".")).map(|paths| {
            paths
                .into_iter()
                .map(|path| path.strip_prefix(".").map_or(path.clone(), Path::to_owned))
                .collect()
        })?,
        folder if folder.is_dir() => list(folder)?,
        _ => Vec::new(),
    };
    for path in entries {
        *visited += 1;
        if *visited > MAX_FILES {
            return Err(Error::settings(format!(
                "more than {MAX_FILES} files lie below {}; name the logs' folder more closely",
                folder.display()
            )));
        }
        // `is_dir` follows links, so a link to a folder must be asked for by itself.
        if path.is_dir() && !path.is_symlink() {
            if depth > 1 {
                walk(&path, depth - 1, visited, take)?;
            }
        } else {
            take(&path, path.is_dir());
        }
    }
    Ok(())
}

/// A folder's entries, by name.
fn list(folder: &Path) -> Result<Vec<PathBuf>, Error> {
    let refused = |error: std::io::Error| {
        Error::failed(format!("cannot read the folder {}: {error}", folder.display()))
    };
    let mut paths = std::fs::read_dir(folder)
        .map_err(refused)?
        .map(|entry| entry.map(|entry| entry.path()))
        .collect::<Result<Vec<PathBuf>, _>>()
        .map_err(refused)?;
    paths.sort();
    Ok(paths)
}

#[cfg(test)]
#[allow(clippy::unwrap_used, reason = "a failed unwrap is a failed test")]
mod tests {
    use super::*;

    fn names(entries: &[&str], config: &Path) -> Result<(Vec<String>, usize), Error> {
        let entries: Vec<String> = entries.iter().map(|&entry| entry.to_owned()).collect();
        let (files, warnings) = find(&entries, config)?;
        let name = |file: LogFile| file.path.file_name().unwrap().to_string_lossy().into_owned();
        Ok((files.into_iter().map(name).collect(), warnings.len()))
    }

    #[test]
    fn files_folders_and_patterns_beside_the_configuration() {
        let folder = tempfile::tempdir().unwrap();
        let config = folder.path().join("adapt.toml");
        std::fs::create_dir_all(folder.path().join("logs/old")).unwrap();
        for file in ["logs/b.csv", "logs/a.csv", "logs/notes.txt", "logs/old/c.csv", "d.csv"] {
            std::fs::write(folder.path().join(file), "").unwrap();
        }
        let same = |entries: &[&str], expected: &[&str], twice: usize| {
            let (files, warnings) = names(entries, &config).unwrap();
            assert_eq!(files, expected);
            assert_eq!(warnings, twice);
        };
        same(&["d.csv"], &["d.csv"], 0);
        same(&["logs"], &["a.csv", "b.csv"], 0);
        same(&["logs/*.csv"], &["a.csv", "b.csv"], 0);
        same(&["**/*.csv"], &["d.csv", "a.csv", "b.csv", "c.csv"], 0);
        same(&["logs/b.csv", "logs"], &["b.csv", "a.csv"], 1);
        let wrong = |entries: &[&str], part: &str| {
            let text = names(entries, &config).unwrap_err().to_string();
            assert!(text.contains(part), "{text}");
        };
        wrong(&["logs/x*.csv"], "no file matches");
        wrong(&["other"], "does not exist");
        wrong(&["logs/[.csv"], "no file pattern");
        wrong(&[], "names no files");
        std::fs::create_dir(folder.path().join("empty")).unwrap();
        wrong(&["empty"], "holds no *.csv");
    }

    #[cfg(unix)]
    #[test]
    fn links_to_logs_are_followed_and_others_named() {
        use std::os::unix::fs::symlink;
        let folder = tempfile::tempdir().unwrap();
        let config = folder.path().join("adapt.toml");
        for name in ["logs", "runs/3"] {
            std::fs::create_dir_all(folder.path().join(name)).unwrap();
            std::fs::write(folder.path().join(name).join("a.csv"), "").unwrap();
        }
        symlink("../runs/3/a.csv", folder.path().join("logs/b.csv")).unwrap();
        for entry in ["logs", "logs/*.csv"] {
            assert_eq!(names(&[entry], &config).unwrap(), (vec!["a.csv".to_owned(), "b.csv".to_owned()], 0));
        }
        symlink("gone.csv", folder.path().join("logs/c.csv")).unwrap();
        symlink("3", folder.path().join("runs/latest")).unwrap();
        for (entry, parts) in [
            ("logs", ["c.csv: a link to gone.csv", "does not exist"]),
            ("logs/*.csv", ["c.csv: a link to gone.csv", "does not exist"]),
            ("runs/l*/*.csv", ["runs/latest to the folder 3", "name that folder itself"]),
        ] {
            let error = names(&[entry], &config).unwrap_err().to_string();
            assert!(parts.iter().all(|part| error.contains(part)), "{entry}: {error}");
        }
    }
}
