//! A table in parts that can be made apart from each other, on other machines for example: what the cells of a scenario
//! share, and then each cell, for each seed. [`super::run`] takes parts that are made as they are.

use super::{Kind, Opened, Request};
use crate::watch::Watch;
use crate::{Error, loop_, robot};
use serde::{Deserialize, Serialize};
use std::collections::BTreeSet;
use std::path::PathBuf;

pub(super) const SHARED: &str = "shared";
pub(super) const CELLS: &str = "cells";

/// Written last: a folder that has it is finished.
pub(super) const SEED: &str = "seed.json";
/// The logs of a scenario, in the folder of what its cells share.
pub(super) const LOGS: &str = "logs";

/// Kind of a part.
#[derive(Clone, Copy, Debug, PartialEq, Eq, Serialize, Deserialize)]
#[serde(rename_all = "lowercase")]
pub enum PartKind {
    /// Logs and references of a scenario.
    Shared,
    /// A cell.
    Cell,
}

/// A part of a table.
#[derive(Clone, Debug, PartialEq, Eq, Serialize, Deserialize)]
pub struct Part {
    /// What it is.
    pub kind: PartKind,
    /// The scenario's name, or the cell's.
    pub name: String,
    /// The scenario's name.
    pub scenario: String,
    /// Which seed, from 1.
    pub seed: u64,
    /// Its folder in the table's folder.
    pub folder: String,
    /// Whether there is nothing left to do.
    pub finished: bool,
}

/// A table in parts.
#[derive(Clone, Debug, Serialize)]
pub struct Plan {
    /// The table's folder.
    pub run_folder: String,
    /// Its parts; those of a scenario's cells need what the scenario shares.
    pub parts: Vec<Part>,
    /// Every file that a part reads, as settings and command line lead there.
    pub files: Vec<PathBuf>,
}

impl Part {
    /// The folder of what its scenario shares.
    pub(super) fn needs(&self) -> String {
        format!("{SHARED}/{}/seed-{}", self.scenario, self.seed)
    }
}

/// The parts of a table.
///
/// # Errors
/// As [`super::run`], before anything is computed.
pub fn plan(request: &Request) -> Result<Plan, Error> {
    let opened = Opened::new(request)?;
    let at = |folder: &str| opened.folder.path().join(folder);
    let selected = || opened.experiments.iter().filter(|one| one.selected);
    let mut parts: Vec<Part> = Vec::new();
    for seed in 1..=request.seeds {
        let part = |kind, name: &str, scenario: &str| {
            let within = if kind == PartKind::Shared { SHARED } else { CELLS };
            let folder = format!("{within}/{name}/seed-{seed}");
            let finished = match kind {
                PartKind::Cell => at(&folder).join(SEED).exists(),
                // References are trained too; whether they are is theirs to say.
                PartKind::Shared => opened.kind == Kind::Identification && at(&folder).join(LOGS).is_dir(),
            };
            let (name, scenario) = (name.to_owned(), scenario.to_owned());
            Part { kind, name, scenario, seed, folder, finished }
        };
        // Each scenario once, and in the same order on every machine.
        let scenarios: BTreeSet<&str> = selected().map(|one| one.scenario.as_str()).collect();
        parts.extend(scenarios.into_iter().map(|one| part(PartKind::Shared, one, one)));
        parts.extend(selected().map(|one| part(PartKind::Cell, &one.paper.name, &one.scenario)));
    }
    let mut files = BTreeSet::new();
    // A machine that makes one part needs the files of all cells, as it reads the whole table.
    for one in &opened.experiments {
        files.insert(one.file.clone());
        let setup = loop_::Setup::open(one.config.clone(), &one.file, request.threads)?;
        files.extend(setup.inputs.files.keys().map(PathBuf::from));
        files.extend(setup.robot.iter().flat_map(|path| robot::parts(path)));
    }
    let run_folder = opened.folder.path().display().to_string();
    Ok(Plan { run_folder, parts, files: files.into_iter().collect() })
}

/// Begins or resumes one part of a table, in the table's folder.
///
/// # Errors
/// As [`super::run`].
pub fn make(request: &Request, part: &Part, watch: &Watch<'_>) -> Result<(), Error> {
    let opened = Opened::new(request)?;
    opened.run(request, watch).part(part)
}
