//! Another file of the same robot: projects with closed loops or ball joints often have a serial model beside it.

use super::look;
use crate::files;
use gaitfit_model::{ReadOptions, Root, shown_path};
use std::path::{Path, PathBuf};

/// Max number of files that are looked at, and of bytes of each.
const MAX_FILES: usize = 48;
const MAX_BYTES: u64 = 4 << 20;
/// Smallest share of a file's joints whose names the robot must have.
const SAME: f64 = 0.5;

/// A sentence that names another file near `path`: one with the same robot's joints, for which a task can be written;
/// `None` without one.
pub(super) fn advice(path: &Path) -> Option<String> {
    let text = files::read_text(path, MAX_BYTES).ok()?;
    let mut best: Option<(usize, PathBuf)> = None;
    for file in beside(path) {
        // As `init` reads it, because the file only has to be good enough for that.
        let options = ReadOptions { add_floor: true, mend: true, ..ReadOptions::default() };
        let Ok(mut model) = gaitfit_model::read(&file, &options) else { continue };
        // The file at `path` does not read, so names are looked for in its text.
        let named = |joint: &&gaitfit_model::Joint| text.contains(&format!("\"{}\"", joint.name));
        let common = model.joints.iter().filter(named).count();
        if model.root != Root::Floating || (common as f64) < SAME * model.joints.len() as f64 || common == 0 {
            continue;
        }
        // As `init` would do it, so that the advice names only files that it takes.
        super::feet::fit_feet(&mut model, false);
        // Of equals the first one stays: `beside` lists the file's own folder first.
        let better = best.as_ref().is_none_or(|(most, _)| common > *most);
        if better && look(&model).is_ok() {
            best = Some((common, file));
        }
    }
    let (common, file) = best?;
    Some(format!("{} has {common} joints of the same names and reads: try it instead.", shown_path(&file)))
}

/// Robot files in the folder of `path` and in the folders next to it.
fn beside(path: &Path) -> Vec<PathBuf> {
    let absolute = std::path::absolute(path).unwrap_or_else(|_| path.to_path_buf());
    let Some(folder) = absolute.parent() else { return Vec::new() };
    let list = |folder: &Path| -> Vec<PathBuf> {
        let entries = std::fs::read_dir(folder).into_iter().flatten().flatten();
        let mut paths: Vec<PathBuf> = entries.map(|entry| entry.path()).collect();
        // The order of a folder's entries differs between machines, and the first files win.
        paths.sort();
        paths
    };
    let mut folders = vec![folder.to_path_buf()];
    folders.extend(list(folder).into_iter().filter(|path| path.is_dir()));
    if let Some(above) = folder.parent() {
        folders.extend(list(above).into_iter().filter(|path| path.is_dir() && path != folder));
    }
    let robot = |file: &PathBuf| {
        let ending = file.extension().is_some_and(|ending| ending == "xml" || ending == "urdf");
        ending
            && *file != absolute
            && file.metadata().is_ok_and(|data| data.is_file() && data.len() <= MAX_BYTES)
    };
    folders.iter().flat_map(|folder| list(folder)).filter(robot).take(MAX_FILES).collect()
}
