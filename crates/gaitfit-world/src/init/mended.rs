//! A robot file for a first task: as it is if it reads, else mended and written anew.
//!
//! What a strict reading refuses is mended where the robot stays the same to walk with: feet that are meshes get simple shapes,
//! links without mass get a mass, motors without rotor inertia get one, unknown parts are left out. The result is a robot file
//! of its own, which every command and MuJoCo read as any other; every change is listed in it.

use super::anatomy::made_up;
use super::feet::{Added, fit_feet};
use super::gains::Source;
use super::{Guess, InitError, Look, look, look_with, rotors, twin};
use crate::Error;
use crate::robot::{self, Hold};
use gaitfit_model::{Changed, Model, ReadOptions, read_mjcf_str, shown, shown_path};
use std::path::{Path, absolute};

/// A robot that a task can be written for.
#[derive(Clone, Debug, PartialEq)]
pub struct Prepared {
    /// The robot.
    pub model: Model,
    /// Its task.
    pub look: Look,
    /// The mended robot as MJCF; absent where its own file reads.
    pub file: Option<String>,
    /// Changes of the mending, most important first.
    pub mended: Vec<Guess>,
}

/// Options for preparing a robot file.
#[derive(Clone, Copy, Debug, Default, PartialEq, Eq)]
pub struct Preparation<'a> {
    /// Drop what the engine cannot simulate.
    pub lenient: bool,
    /// Fit the feet to the file's meshes even if other shapes of it touch the ground.
    pub feet_from_mesh: bool,
    /// Write the robot as a file of its own even if it reads as it is.
    pub one_file: bool,
    /// The folder that a mended file will be written to; the current one without it.
    pub folder: Option<&'a Path>,
}

/// Reads the robot at `path`, mends it where that is needed, and looks at it.
///
/// # Errors
/// A file that reads neither plainly nor mended, or a robot that cannot walk; the message of the plain reading, and what keeps
/// the file from being mended.
pub fn prepare(path: &Path, how: Preparation) -> Result<Prepared, Error> {
    let Preparation { lenient, feet_from_mesh, one_file, .. } = how;
    let plain = plainly(path, lenient);
    // A file that reads plainly is mended only on request.
    let refusal = match plain {
        Ok(prepared) if !feet_from_mesh && !one_file => return Ok(prepared),
        Ok(_) => None,
        Err(error) => Some(error),
    };
    let Some(refusal) = refusal else { return mend(path, how) };
    // A mending changes shapes and names; it cannot help a file that is missing or no XML.
    if !mendable(&refusal) {
        return Err(refusal);
    }
    match mend(path, how) {
        Ok(prepared) => Ok(prepared),
        Err(other) => {
            let (first, second) = (refusal.to_string(), other.to_string());
            let mut advice = Vec::new();
            // A second refusal for the same reason says nothing new, so only the words after the place are compared.
            if !second.contains(first.rsplit(": ").next().unwrap_or(&first)) {
                advice.push(format!("It cannot be mended either: {second}"));
            }
            // Closed chains are beyond any mending, but another file of the same robot may have them opened.
            let looped =
                ["loop", "ball joint"].iter().any(|word| first.contains(word) || second.contains(word));
            advice.extend(twin::advice(path).filter(|_| looped));
            if advice.is_empty() {
                return Err(refusal);
            }
            Err(Error::Advised { source: Box::new(refusal), advice: format!("\n{}", advice.join("\n")) })
        }
    }
}

fn plainly(path: &Path, lenient: bool) -> Result<Prepared, Error> {
    let model = robot::read(path, lenient, Hold::File)?;
    let look = look(&model).map_err(|error| looked(path, &error))?;
    Ok(Prepared { model, look, file: None, mended: Vec::new() })
}

/// An error of a look at the robot of a file.
fn looked(path: &Path, error: &InitError) -> Error {
    Error::failed(format!("{}: {error}", path.display()))
}

/// Whether another reading may help.
fn mendable(error: &Error) -> bool {
    use gaitfit_model::ModelError::{Io, Syntax};
    !matches!(error, Error::Robot(Io { .. } | Syntax { .. }))
}

fn mend(path: &Path, how: Preparation) -> Result<Prepared, Error> {
    let options = ReadOptions { lenient: how.lenient, add_floor: true, mend: true, ..ReadOptions::default() };
    let mut model = gaitfit_model::read(path, &options)?;
    let added = fit_feet(&mut model, how.feet_from_mesh);
    name_geoms(&mut model);
    let mut mended = changes(&model, &added);
    // Rotors go into the file, so that training, fits and exports all have them.
    let mut rotors = rotors(&model).map_err(|error| looked(path, &error))?;
    if let Some(rotors) = &mut rotors {
        rotors.write(&mut model);
        let text = format!(
            "rotor inertia of {:?} kg·m² in every joint that has a motor and no rotor in the file (a guess)",
            rotors.smallest
        );
        mended.push(Guess { what: "rotors", found: text });
    }
    let mut comments = vec![
        format!("Written by `gaitfit init` from {}: one file without includes and meshes.", shown_path(path)),
        "What it mended, and why; change here what is wrong:".to_owned(),
    ];
    comments.extend(mended.iter().map(|change| format!("- {}: {}", change.what, change.found)));
    let source = std::mem::take(&mut model.source);
    let named = source.file().and_then(|file| seen_from(how.folder.unwrap_or(Path::new("")), file));
    let text = model.to_mjcf(&comments, named.as_deref()).map_err(Error::failed)?;
    // Training reads the written file, so the look is that of the model in it.
    let read = read_mjcf_str(&text, &ReadOptions { add_floor: true, ..ReadOptions::default() })?;
    let model = Model { source, ..read };
    let look = look_with(&model, Source::Likely, rotors).map_err(|error| looked(path, &error))?;
    Ok(Prepared { model, look, file: Some(text), mended })
}

/// A file as seen from a folder, so that both can move together.
fn seen_from(folder: &Path, file: &Path) -> Option<String> {
    let folder = Path::new(".").join(folder);
    let (folder, file) = (folder.canonicalize().or_else(|_| absolute(&folder)).ok()?, absolute(file).ok()?);
    let file = file.parent()?.canonicalize().ok()?.join(file.file_name()?);
    let shared = folder.components().zip(file.components()).take_while(|(one, other)| one == other).count();
    // Nothing in common, as on two drives: then only the whole path leads there.
    if shared == 0 {
        return Some(file.to_str()?.to_owned());
    }
    let up = folder.components().skip(shared).map(|_| Some(".."));
    let down = file.components().skip(shared).map(|part| part.as_os_str().to_str());
    Some(up.chain(down).collect::<Option<Vec<_>>>()?.join("/"))
}

/// Renames geoms whose names were made up after their links, so that a reader of the new file finds them.
fn name_geoms(model: &mut Model) {
    for geom in 0..model.geoms.len() {
        if !made_up(&model.geoms[geom].name) {
            continue;
        }
        let link = &model.bodies[model.geoms[geom].body].name;
        let stem =
            format!("{}_{}", link.strip_suffix("_link").unwrap_or(link), model.geoms[geom].shape.name());
        let mut name = stem.clone();
        let mut number = 1;
        while model.geoms.iter().any(|other| other.name == name) {
            number += 1;
            name = format!("{stem}_{number}");
        }
        model.geoms[geom].name = name;
    }
}

/// Changes of the mending, those of one kind together.
fn changes(model: &Model, added: &[Added]) -> Vec<Guess> {
    let mut guesses = Vec::new();
    let mut say = |what: &'static str, text: String| guesses.push(Guess { what, found: text });
    for shape in added.iter().filter(|shape| shape.foot) {
        say("foot", format!("{}: {}", shown(&shape.geom), shape.how));
    }
    for shape in added.iter().filter(|shape| !shape.foot) {
        say("base", format!("{}: {}", shown(&shape.geom), shape.how));
    }
    for (change, count) in grouped(&model.changed) {
        let more = if count > 1 { format!(" (and {} more like it)", count - 1) } else { String::new() };
        // The floor counts separately: it is not a part of the robot.
        let what = if change.what.starts_with("floor") { "floor" } else { "mended" };
        say(what, format!("{}: {}{more}", change.what, change.how));
    }
    for group in model.left_out().iter().filter(|group| !group.harmless) {
        say("left out", format!("{}: {}", group.what, group.why));
    }
    guesses
}

/// Changes of one kind together: those whose words but for the names are the same.
fn grouped(changes: &[Changed]) -> Vec<(&Changed, usize)> {
    let kind = |change: &Changed| -> String {
        let text = format!("{} {}", change.what, change.how);
        // Names stand in quotes, so every second part is outside of them.
        let outside: Vec<&str> = text.split('"').step_by(2).collect();
        outside.concat().chars().filter(|letter| !letter.is_ascii_digit()).collect()
    };
    let mut groups: Vec<(String, &Changed, usize)> = Vec::new();
    for change in changes {
        let kind = kind(change);
        match groups.iter_mut().find(|(other, ..)| *other == kind) {
            Some((_, _, count)) => *count += 1,
            None => groups.push((kind, change, 1)),
        }
    }
    groups.into_iter().map(|(_, change, count)| (change, count)).collect()
}
