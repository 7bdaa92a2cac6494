//! A policy from a path, whatever wrote it.

use super::file::{bytes, ending};
use super::foreign::{self, Known};
use super::{Description, messages, onnx, torch, weights};
use gaitfit_policy::invalid;
use gaitfit_policy::{Interface, Policy, PolicyError};
use std::path::{Path, PathBuf};

/// Reads a policy: `.safetensors` and `.onnx` written by this program, an `.onnx` with the metadata of mjlab or with
/// unitree_rl_lab's `deploy.yaml` beside it, or a `.toml` that describes a policy trained elsewhere ([`Description`]).
/// What had to be assumed is in [`Policy::notes`].
///
/// # Errors
/// [`PolicyError`], always with the file's name.
pub fn read(path: &Path) -> Result<Policy, PolicyError> {
    let inside = |source| PolicyError::In { path: path.to_owned(), source: Box::new(source) };
    match ending(path).as_deref() {
        Some("safetensors") => weights::read(&bytes(path)?).map_err(inside),
        Some("onnx") => onnx_file(path, &bytes(path)?).map_err(inside),
        // Notes on what was assumed come before those on the weights.
        Some("toml") => {
            let (description, notes) = description(path)?;
            let mut policy = description.load(folder(path)).map_err(inside)?;
            policy.notes.splice(0..0, notes);
            Ok(policy)
        }
        Some(ending) if torch::ENDINGS.contains(&ending) => {
            Err(inside(torch::refuse(path, &bytes(path)?, None)))
        }
        _ => {
            // A name that is mistyped has no ending either.
            std::fs::metadata(path).map_err(|source| PolicyError::Read { path: path.to_owned(), source })?;
            Err(inside(invalid("no policy by its ending; give a .safetensors, .onnx or .toml file")))
        }
    }
}

/// Returns a policy's interface and the settings of the task it was trained on (empty where they are not
/// known): of any file that [`read`] reads, or of a description that names no `file`.
///
/// # Errors
/// As [`read`].
pub fn interface_of(path: &Path) -> Result<(Interface, String), PolicyError> {
    if ending(path).as_deref() == Some("toml")
        && let Ok(mut table) = toml::from_str::<toml::Table>(&text(path)?)
        && !table.contains_key("file")
    {
        let inside = |source| PolicyError::In { path: path.to_owned(), source: Box::new(source) };
        // A description must have `file`, which is not read here.
        table.insert("file".to_owned(), String::new().into());
        let interface =
            Description::from_table(table).and_then(|description| description.interface_in(folder(path)));
        return Ok((interface.map_err(inside)?, String::new()));
    }
    let policy = read(path)?;
    Ok((policy.interface, policy.provenance.task))
}

/// The files that [`read`] reads: the one named, the weights that a description names, and what says more of them.
///
/// # Errors
/// A description that cannot be read.
pub fn files_of(path: &Path) -> Result<Vec<PathBuf>, PolicyError> {
    let mut files = vec![path.to_owned()];
    if ending(path).as_deref() == Some("toml") {
        let (description, _) = description(path)?;
        files.push(folder(path).join(description.file));
        let reference = description.reference.as_ref().and_then(|source| source.file());
        files.extend(reference.map(|file| folder(path).join(file)));
        files
            .extend(description.encoder.and_then(|encoder| encoder.file).map(|file| folder(path).join(file)));
    }
    // Collected first, because the loop below adds to the list.
    let graphs: Vec<PathBuf> =
        files.iter().filter(|file| ending(file).as_deref() == Some("onnx")).cloned().collect();
    for graph in graphs {
        // What cannot be read is refused with its reason when the policy is.
        let others = bytes(&graph).and_then(|bytes| onnx::others(&bytes)).unwrap_or_default();
        files.extend(others.into_iter().map(|file| folder(&graph).join(file)));
    }
    if let Some(beside) =
        // The weights: the second file of a description, else the file itself.
        files.iter().take(2).next_back().filter(|file| ending(file).as_deref() == Some("onnx"))
    {
        files.extend(foreign::unitree_file(beside));
    }
    Ok(files)
}

/// The files of a policy that carry no checksum, so that damage to them cannot be seen: those of other programs, and of
/// earlier versions of this one.
///
/// # Errors
/// Files that cannot be read.
pub fn unsealed(path: &Path) -> Result<Vec<PathBuf>, PolicyError> {
    let mut unsealed = Vec::new();
    for file in files_of(path)? {
        let sealed = match ending(&file).as_deref() {
            Some("safetensors") => weights::is_sealed(&bytes(&file)?),
            Some("onnx") => onnx::is_sealed(&bytes(&file)?),
            // Texts that people write.
            _ => true,
        };
        if !sealed {
            unsealed.push(file);
        }
    }
    Ok(unsealed)
}

fn folder(path: &Path) -> &Path {
    path.parent().unwrap_or(Path::new(""))
}

/// A policy from an ONNX file alone.
fn onnx_file(path: &Path, bytes: &[u8]) -> Result<Policy, PolicyError> {
    // This program's own metadata come first, because they state everything.
    if let Some(policy) = onnx::read_own(bytes, Some(folder(path)))? {
        return Ok(policy);
    }
    let name = path.file_name().map(|name| name.to_string_lossy().into_owned()).unwrap_or_default();
    let Some(Known { mut table, notes }) = known_of_foreign(path, bytes)? else {
        return Err(onnx::without_metadata(&name, bytes, Some(folder(path))));
    };
    table.insert("file".into(), name.into());
    let mut policy = Description::from_table(table)?.load(folder(path))?;
    policy.notes.splice(0..0, notes.into_iter().map(|note| note.text));
    Ok(policy)
}

/// Returns the description of an ONNX file by another program, inside or beside it.
fn known_of_foreign(path: &Path, bytes: &[u8]) -> Result<Option<Known>, PolicyError> {
    // Metadata inside the file belong to it for certain. A file beside it may be of another policy.
    if let Some(known) = onnx::foreign(bytes, Some(folder(path)))? {
        return Ok(Some(known));
    }
    let Some(beside) = foreign::unitree_file(path) else { return Ok(None) };
    let inside = |source| PolicyError::In { path: beside.clone(), source: Box::new(source) };
    let text = text(&beside)?;
    foreign::unitree(&text).map(Some).map_err(inside)
}

/// Returns the interface that a weights file states; a description need not repeat it.
///
/// # Errors
/// What another program says of it, if that is wrong.
fn known(path: &Path) -> Result<Option<Known>, PolicyError> {
    // A file that cannot be read is reported when its weights are.
    let Ok(bytes) = bytes(path) else { return Ok(None) };
    let interface = match ending(path).as_deref() {
        Some("safetensors") => weights::interface(&bytes),
        Some("onnx") => onnx::interface(&bytes),
        _ => None,
    };
    match interface {
        Some(interface) => {
            Ok(toml::Table::try_from(interface).ok().map(|table| Known { table, ..Known::default() }))
        }
        None if ending(path).as_deref() == Some("onnx") => known_of_foreign(path, &bytes)
            .map_err(|source| PolicyError::In { path: path.to_owned(), source: Box::new(source) }),
        None => Ok(None),
    }
}

/// A description, completed by what its weights file says, and notes on that.
fn description(path: &Path) -> Result<(Description, Vec<String>), PolicyError> {
    let inside = |source| PolicyError::In { path: path.to_owned(), source: Box::new(source) };
    let text = text(path)?;
    let Ok(given) = toml::from_str::<toml::Table>(&text) else {
        // Where the mistake is.
        return Ok((Description::parse(&text).map_err(inside)?, Vec::new()));
    };
    if let Some(kind) = messages::other_kind(&given) {
        return Err(inside(invalid(kind)));
    }
    let file = given.get("file").and_then(toml::Value::as_str).filter(|file| !file.is_empty());
    match file.map_or(Ok(None), |file| known(&folder(path).join(file))) {
        Ok(None) => Ok((Description::parse(&text).map_err(inside)?, Vec::new())),
        // A description that says all that the file should say needs nothing of it.
        Err(of_file) => match Description::parse(&text) {
            Ok(description) => Ok((description, Vec::new())),
            // Only where the description lacks something the weights file could have given, that file's error
            // is the better one.
            Err(error) if error.to_string().contains("missing field") => Err(of_file),
            Err(error) => Err(inside(error)),
        },
        Ok(Some(Known { table: mut entries, notes })) => {
            let notes = notes.into_iter();
            let notes = notes.filter(|note| note.entries.iter().any(|key| !given.contains_key(*key)));
            let notes = notes.map(|note| note.text).collect();
            // A slip in a name has a place in the text; what the file adds has none.
            if let Err(error) = Description::parse(&text)
                && error.to_string().contains("unknown ")
            {
                return Err(inside(error));
            }
            // What the description states wins over the file.
            entries.extend(given);
            Ok((Description::from_table(entries).map_err(inside)?, notes))
        }
    }
}

fn text(path: &Path) -> Result<String, PolicyError> {
    String::from_utf8(bytes(path)?).map_err(|error| PolicyError::In {
        path: path.to_owned(),
        source: Box::new(invalid(format!(
            "not a text in UTF-8, from byte {} on; a description is a TOML file",
            error.utf8_error().valid_up_to()
        ))),
    })
}
