//! The robot file that a policy was trained on: kept in the policy, and found again where none is named.

use crate::robot::Hold;
use crate::run::inputs::{hash, hash_file};
use crate::world::WorldSettings;
use crate::{Error, robot};
use gaitfit_model::{Model, shown};
use gaitfit_policy::{Policy, RobotFile};
use std::path::{Path, PathBuf};

/// Max number of folders above a policy, and of parts at the end of a path, that are looked at.
const MAX_DEPTH: usize = 16;

/// Returns what a policy keeps of the robot file of its training: path, hash, and how it was read.
///
/// # Errors
/// A file that cannot be read.
pub fn record(path: &Path, lenient: bool) -> Result<RobotFile, Error> {
    let absolute = std::path::absolute(path).map_err(|error| Error::unreadable(path, error))?;
    Ok(RobotFile { path: absolute.display().to_string(), sha256: fingerprint(path)?, lenient })
}

/// SHA-256 of a robot's file; of its own and its parts' hashes, where it includes files or height fields.
fn fingerprint(path: &Path) -> Result<String, Error> {
    let whole = hash_file(path)?;
    let parts = robot::parts(path);
    if parts.is_empty() {
        return Ok(whole);
    }
    // Hashes of hashes, so that no part has to be read into memory together with another.
    let mut hashes = vec![whole];
    for part in &parts {
        hashes.push(hash_file(part)?);
    }
    Ok(hash(hashes.concat().as_bytes()))
}

/// `asked` with the robot file of the policy's training, where it names none, and what to know of that. If it names the
/// same file, this is read as leniently as there.
///
/// # Errors
/// The file is missing or has changed.
pub fn settled(asked: &WorldSettings, policy: &Policy) -> Result<(WorldSettings, Vec<String>), Error> {
    let mut settings = asked.clone();
    // The built-in robot has no file, and asked for by name it overrides the training's.
    if asked.robot.as_deref().is_some_and(robot::is_built_in) {
        settings.robot = None;
        return Ok((settings, Vec::new()));
    }
    let Some(recorded) = &policy.provenance.robot_file else { return Ok((settings, Vec::new())) };
    let mut notes = Vec::new();
    match &asked.robot {
        // Another file is read as strictly as asked: what the training dropped says nothing of it.
        Some(path) => settings.lenient |= as_leniently(path, recorded),
        None => {
            let (path, note) = find(&asked.policy, recorded, &policy.interface.robot)?;
            settings.robot = Some(path);
            settings.lenient |= recorded.lenient;
            notes.extend(note);
        }
    }
    Ok((settings, notes))
}

/// The robot of the policy at `path`: the file `asked`, or else that of the policy's training, or the built-in Go2.
///
/// # Errors
/// A file that cannot be read; that of the training is not there any more, or is another now.
pub fn model(policy: &Policy, path: &Path, asked: Option<&Path>, lenient: bool) -> Result<Model, Error> {
    let recorded = policy.provenance.robot_file.as_ref();
    match (asked, recorded) {
        (Some(asked), _) => {
            let lenient = lenient || recorded.is_some_and(|recorded| as_leniently(asked, recorded));
            robot::read(asked, lenient, Hold::File)
        }
        (None, Some(recorded)) => {
            let (file, _) = find(path, recorded, &policy.interface.robot)?;
            robot::read(&file, lenient || recorded.lenient, Hold::File)
        }
        (None, None) => robot::go2(),
    }
}

/// Names the robot of the policy's training in `config`, the configuration at `path`, where it names no other.
///
/// # Errors
/// A policy that cannot be read; the robot file of its training is not there any more, or is another now.
pub fn of_policy(config: &mut crate::settings::AdaptConfig, path: &Path) -> Result<(), Error> {
    let Some(named) = config.policy.as_ref().filter(|_| config.robot.is_empty()) else { return Ok(()) };
    let file = crate::policy_file::find(&crate::paths::find(named, "policy", path)?)?.path;
    let policy = gaitfit_policy_files::read(&file).map_err(Error::failed)?;
    if let Some(recorded) = &policy.provenance.robot_file {
        let (robot, _) = find(&file, recorded, &policy.interface.robot)?;
        config.robot = robot.display().to_string();
        config.lenient |= recorded.lenient;
    }
    Ok(())
}

/// Whether `path` is the robot file of a training that read it leniently. A file that cannot be read is not; it is
/// refused with its reason where it is read.
pub fn as_leniently(path: &Path, recorded: &RobotFile) -> bool {
    recorded.lenient && fingerprint(path).is_ok_and(|hash| hash == recorded.sha256)
}

/// The robot file of a training, and a note if it has moved: where it was, or at the same place as seen from the current
/// folder or from one above the policy, if it is the same file.
///
/// # Errors
/// The file is missing or has changed.
pub fn find(policy: &Path, recorded: &RobotFile, name: &str) -> Result<(PathBuf, Option<String>), Error> {
    let was = Path::new(&recorded.path);
    let same = |path: &Path| path.is_file() && fingerprint(path).is_ok_and(|hash| hash == recorded.sha256);
    // Compared by content: a path alone may lead to a file that was edited since.
    if same(was) {
        return Ok((nearby(was), None));
    }
    if let Some(path) = places(policy, was).into_iter().find(|path| same(path)) {
        let note = format!(
            "the robot file of the training is {} now; it was {}",
            path.display(),
            shown(&recorded.path)
        );
        return Ok((path, Some(note)));
    }
    let (policy, file) = (policy.display(), shown(&recorded.path));
    let lenient = if recorded.lenient { " --lenient" } else { "" };
    Err(Error::settings(if was.exists() {
        format!(
            "{policy}: the robot file that it was trained on, {file}, has changed since (SHA-256 {} then). Restore it, or \
             take it as it is now: --robot {file}{lenient}",
            // Twelve digits identify a file for a person; the policy has all of them.
            recorded.sha256.get(..12).unwrap_or(&recorded.sha256)
        )
    } else {
        format!(
            "{policy}: the robot file that it was trained on, {file} (robot `{}`), is not there any more. Name the file \
             with --robot FILE{lenient}",
            shown(name)
        )
    }))
}

/// A path in the current folder without that folder's name, as a user would write it.
fn nearby(path: &Path) -> PathBuf {
    let here = std::env::current_dir().ok();
    here.and_then(|here| path.strip_prefix(here).ok().map(Path::to_owned)).unwrap_or_else(|| path.to_owned())
}

/// Where a file may be that has moved together with the policy: ends of its path, the longest first, as seen from the
/// current folder and from the folders above the policy.
fn places(policy: &Path, was: &Path) -> Vec<PathBuf> {
    let absolute = std::path::absolute(policy).unwrap_or_else(|_| policy.to_owned());
    // Without the root, because the ends are joined to other folders.
    let parts: Vec<_> = was.components().skip(1).collect();
    let from = parts.len().saturating_sub(MAX_DEPTH);
    let mut places = Vec::new();
    for start in from..parts.len() {
        let end: PathBuf = parts[start..].iter().collect();
        places.push(end.clone());
        places.extend(absolute.ancestors().skip(1).take(MAX_DEPTH).map(|folder| folder.join(&end)));
    }
    places
}

#[cfg(test)]
#[allow(clippy::unwrap_used, reason = "a failed unwrap is a failed test")]
mod tests {
    use super::*;
    use std::fs;

    /// A robot file and a policy's place in a project of its own.
    fn project() -> (tempfile::TempDir, PathBuf, PathBuf) {
        let folder = tempfile::tempdir().unwrap();
        let root = folder.path().join("project");
        fs::create_dir_all(root.join("robots")).unwrap();
        fs::create_dir_all(root.join("runs/walk/seed-1")).unwrap();
        let robot = root.join("robots/spot.xml");
        fs::write(&robot, "<mujoco><include file=\"legs.xml\"/></mujoco>").unwrap();
        fs::write(root.join("robots/legs.xml"), "<mujoco/>").unwrap();
        let policy = root.join("runs/walk/seed-1/policy.safetensors");
        (folder, robot, policy)
    }

    #[test]
    fn the_file_of_the_training_is_found_where_it_was_and_with_a_project_that_moved() {
        let (folder, robot, policy) = project();
        let recorded = record(&robot, true).unwrap();
        assert_eq!(find(&policy, &recorded, "spot").unwrap(), (robot, None));
        let moved = folder.path().join("elsewhere");
        fs::rename(folder.path().join("project"), &moved).unwrap();
        let policy = moved.join("runs/walk/seed-1/policy.safetensors");
        let (path, note) = find(&policy, &recorded, "spot").unwrap();
        assert_eq!(path, moved.join("robots/spot.xml"));
        assert!(note.unwrap().contains("it was "), "a note says that it moved");
    }

    #[test]
    fn a_file_that_is_gone_or_changed_is_named_with_the_remedy() {
        let (_folder, robot, policy) = project();
        let recorded = record(&robot, true).unwrap();
        // A change of an included file counts too.
        fs::write(robot.with_file_name("legs.xml"), "<mujoco model=\"other\"/>").unwrap();
        let changed = find(&policy, &recorded, "spot").unwrap_err().to_string();
        for word in ["spot.xml", "has changed", "--robot", "--lenient", "policy.safetensors"] {
            assert!(changed.contains(word), "`{word}` is not in `{changed}`");
        }
        fs::remove_file(&robot).unwrap();
        let gone = find(&policy, &recorded, "spot").unwrap_err().to_string();
        assert!(gone.contains("spot.xml") && gone.contains("not there any more"), "{gone}");
        assert!(gone.contains("--robot FILE --lenient"), "{gone}");
    }
}
