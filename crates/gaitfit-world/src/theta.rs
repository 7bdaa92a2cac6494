//! Files of fitted parameters.

use crate::{Error, files};
use gaitfit_adapt::ThetaFile;
use gaitfit_learn::task::TaskSettings;
use gaitfit_model::Model;
use gaitfit_sim::Candidate;
use std::path::{Path, PathBuf};

/// Largest theta.toml: networks of a hundred joints take a quarter of a megabyte.
const MAX_BYTES: u64 = 16 << 20;

/// The theta.toml that `path` names: itself, or that of the run folder.
pub fn find(path: &Path) -> PathBuf {
    let inside = path.join("theta.toml");
    if inside.is_file() { inside } else { path.to_owned() }
}

/// Reads a theta.toml.
pub fn read(path: &Path) -> Result<ThetaFile, Error> {
    let text = files::read_text(path, MAX_BYTES).map_err(|source| gaitfit_run::Error::File {
        access: gaitfit_run::Access::Read,
        path: path.to_owned(),
        source,
        remedy: "; give the theta.toml of a `gaitfit fit` run".to_owned(),
    })?;
    ThetaFile::parse(&text).map_err(|error| Error::failed(format!("{}: {error}", path.display())))
}

/// Returns doubts about the file at `path`, on the robot of `model`, at a physics step, s, where there is one.
pub fn doubts(file: &ThetaFile, path: &Path, model: &Model, step: Option<f64>) -> Vec<String> {
    let stepped = step.and_then(|step| file.step_doubt(step));
    let doubts = file.robot_doubt(model).into_iter().chain(stepped).chain(file.value_doubts());
    doubts.map(|doubt| format!("{}: {doubt}", path.display())).collect()
}

/// Gives a task the contacts of the robot's own parts that the fit simulated, unless the task has some.
pub fn add_self_contact(file: &ThetaFile, settings: &mut TaskSettings) {
    // What the task asks for wins over the fit.
    if settings.self_contact.is_off() {
        settings.self_contact.clone_from(&file.self_contact);
    }
}

/// Adds no rotor inertia to robots whose rotors a fit has found.
pub fn keep_rotors(file: &ThetaFile, settings: &mut TaskSettings) {
    if file.parameter.iter().any(|parameter| parameter.kind == "armature") {
        settings.randomisation.armature = [0.0; 2];
    }
}

/// The robot of `model` as the file at `path` has it.
pub fn candidate(file: &ThetaFile, path: &Path, model: &Model) -> Result<Candidate, Error> {
    on(Candidate::nominal(model), file, path, model)
}

/// The robot `candidate` of `model` with everything the file at `path` says.
pub fn on(candidate: Candidate, file: &ThetaFile, path: &Path, model: &Model) -> Result<Candidate, Error> {
    file.apply(model, candidate).map_err(|error| Error::failed(format!("{}: {error}", path.display())))
}
