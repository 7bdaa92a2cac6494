//! `manifest.json`: what made a run.

use crate::Error;
use crate::files;
use crate::machine::{Machine, machine};
use crate::run::inputs::Inputs;
use crate::run::{RunFolder, latest_path};
use serde::{Deserialize, Serialize};
use std::path::Path;

/// Name of the file.
const MANIFEST: &str = "manifest.json";

#[derive(Serialize)]
struct Manifest<'a> {
    gaitfit: &'static str,
    command: Vec<String>,
    folder: String,
    begun: &'a str,
    #[serde(skip_serializing_if = "Option::is_none")]
    ended: Option<String>,
    seeds: &'a [u64],
    device: String,
    machine: Machine,
    inputs: &'a Inputs,
}

/// Writes the manifest of a run that began at `begun`, and ended at `ended` if it has.
pub fn write(
    folder: &RunFolder,
    seeds: &[u64],
    devices: &str,
    inputs: &Inputs,
    begun: &str,
    ended: Option<String>,
) -> Result<(), Error> {
    let manifest = Manifest {
        gaitfit: env!("CARGO_PKG_VERSION"),
        // Arguments may be paths that are not UTF-8; `args` would panic on them.
        command: std::env::args_os().map(|argument| argument.to_string_lossy().into_owned()).collect(),
        folder: std::env::current_dir().map(|folder| folder.display().to_string()).unwrap_or_default(),
        begun,
        ended,
        seeds,
        device: devices.to_owned(),
        machine: machine(),
        inputs,
    };
    folder.write_json(MANIFEST, &manifest)
}

/// Part of a manifest that has the inputs.
#[derive(Deserialize)]
struct Saved {
    inputs: Inputs,
}

/// The inputs of the run that a folder holds, if it was begun.
///
/// # Errors
/// A file that is damaged.
pub fn inputs(folder: &RunFolder) -> Result<Option<Inputs>, Error> {
    let Some(text) = folder.read(MANIFEST)? else { return Ok(None) };
    serde_json::from_str::<Saved>(&text).map(|saved| Some(saved.inputs)).map_err(|error| {
        let problem = format!("{error}. Restore it, or start afresh without --resume.");
        Error::content(&folder.path().join(MANIFEST), problem)
    })
}

/// The name of the devices that the latest run `name` within `runs` was last on, if there is one and its manifest has it.
pub fn last_devices(runs: &Path, name: &str) -> Option<String> {
    #[derive(Deserialize)]
    struct Named {
        device: String,
    }
    let folder = latest_path(runs, name)?;
    let text = files::read_text(&folder.join(MANIFEST), files::MAX_BYTES).ok()?;
    Some(serde_json::from_str::<Named>(&text).ok()?.device)
}
