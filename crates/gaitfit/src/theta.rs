//! Files of fitted parameters.

use crate::Error;
use gaitfit_adapt::ThetaFile;
use gaitfit_model::Model;
use gaitfit_sim::Candidate;
use std::path::Path;

/// Reads a theta.toml.
pub fn read(path: &Path) -> Result<ThetaFile, Error> {
    // Asked before opening: a pipe without a writer would hang.
    if std::fs::metadata(path).is_ok_and(|data| !data.is_file()) {
        return Err(Error::failed(format!("{}: not a regular file; name a theta.toml", path.display())));
    }
    let text = std::fs::read_to_string(path)
        .map_err(|error| Error::failed(format!("cannot read {}: {error}", path.display())))?;
    ThetaFile::parse(&text).map_err(|error| Error::failed(format!("{}: {error}", path.display())))
}

/// The robot of `model` as the file at `path` has it.
pub fn candidate(file: &ThetaFile, path: &Path, model: &Model) -> Result<Candidate, Error> {
    on(Candidate::nominal(model), file, path, model)
}

/// The robot `candidate` of `model` with everything the file at `path` says.
pub fn on(candidate: Candidate, file: &ThetaFile, path: &Path, model: &Model) -> Result<Candidate, Error> {
    file.apply(model, candidate).map_err(|error| Error::failed(format!("{}: {error}", path.display())))
}
