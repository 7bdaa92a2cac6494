//! Reading robot files.

use crate::{Error, files};
use gaitfit_model::patterns::plain;
use gaitfit_model::{Model, ReadOptions, Root};
use std::path::{Path, PathBuf};

/// The built-in Go2.
pub fn go2() -> Result<Model, Error> {
    Ok(gaitfit_model::builtin::go2()?)
}

/// Whether a robot is the built-in Go2 or a file of it: the built-in tasks are that robot's.
pub fn is_go2(model: &Model) -> bool {
    let Ok(go2) = gaitfit_model::builtin::go2() else { return false };
    let names = |model: &Model| -> Vec<String> {
        let mut names: Vec<_> = model.joints.iter().map(|joint| plain(&joint.name).to_owned()).collect();
        // Files may list the joints in another order; it is the same robot.
        names.sort_unstable();
        names
    };
    model.name == go2.name && names(model) == names(&go2)
}

/// How the robot's base hangs in the world.
#[derive(Clone, Copy, Debug, PartialEq, Eq)]
pub enum Hold {
    /// As the file says.
    File,
    /// Clamped: a robot that floats in its file hangs in the air and touches nothing of the file's world. A robot that
    /// its file fixes, such as an arm on a table, keeps that world.
    Clamped,
}

impl Hold {
    /// How a file is read.
    pub fn options(self, lenient: bool) -> ReadOptions {
        let root = (self == Self::Clamped).then_some(Root::Fixed);
        ReadOptions { lenient, root, add_floor: true, in_the_air: root.is_some(), ..ReadOptions::default() }
    }
}

/// Reads an MJCF or URDF robot for a world of its own: a floating robot whose file has no floor gets one.
pub fn read(path: &Path, lenient: bool, hold: Hold) -> Result<Model, Error> {
    Ok(gaitfit_model::read(path, &hold.options(lenient))?)
}

/// The name of the built-in Go2.
pub const GO2: &str = "unitree-go2";

/// Whether `robot` is the name of the built-in Go2, and no file.
pub fn is_built_in(robot: &Path) -> bool {
    // A file or folder that happens to have this name is meant instead.
    robot == Path::new(GO2) && !robot.exists()
}

/// [`read`]s a robot that floats or stands as its file says, or the built-in Go2 by its name.
///
/// # Errors
/// A file that cannot be read, or that no robot can be made of.
pub fn named(robot: &Path, lenient: bool) -> Result<Model, Error> {
    if is_built_in(robot) { go2() } else { read(robot, lenient, Hold::File) }
}

/// Reads an MJCF or URDF robot as MuJoCo reads it: without a floor that the file does not have.
pub fn as_written(path: &Path, lenient: bool) -> Result<Model, Error> {
    Ok(gaitfit_model::read(path, &ReadOptions { lenient, ..Default::default() })?)
}

/// Names of the robot's joints, in its order.
pub fn joint_names(model: &Model) -> Vec<String> {
    model.joints.iter().map(|joint| joint.name.clone()).collect()
}

/// Remarks on a robot that was read, to know before trusting what it shows: what was added or mended, what a
/// lenient reading took away, what bounds no torque or touches no ground.
pub fn remarks(model: &Model) -> Vec<String> {
    let changed = model.changed.iter().map(|change| format!("{} {}", change.what, change.how));
    let names: Vec<String> = model.joints.iter().map(|joint| joint.name.clone()).collect();
    // Joint names become names of columns, which cannot hold every text.
    let unwritable = gaitfit_log::check_names(None, &names).err();
    let unwritable = unwritable.map(|error| format!("logs of this robot cannot be written: {error}"));
    changed.chain(model.warnings()).chain(unwritable).collect()
}

/// The files that a robot's file names, and those that they name: what it includes, and its height fields. What is
/// missing, or is not read, is not looked for.
pub fn parts(robot: &Path) -> Vec<PathBuf> {
    let home = robot.parent().unwrap_or(Path::new(""));
    let mut folders = vec![home.to_owned()];
    // Included files may include others: each is opened once, and `paths` also keeps circles from going on.
    let (mut paths, mut open) = (Vec::<PathBuf>::new(), vec![robot.to_owned()]);
    while let Some(path) = open.pop() {
        // A broken file is named by the reader of robots, not here.
        let Ok(text) = files::read_text(&path, files::MAX_BYTES) else { continue };
        // Some robot files have a document type, which the parser refuses by default.
        let options = roxmltree::ParsingOptions { allow_dtd: true, ..Default::default() };
        let Ok(document) = roxmltree::Document::parse_with_options(&text, options) else { continue };
        let elements = || document.descendants().filter(roxmltree::Node::is_element);
        for compiler in elements().filter(|one| one.has_tag_name("compiler")) {
            // MuJoCo looks for height fields where it looks for meshes.
            let named = ["assetdir", "meshdir"].into_iter().filter_map(|name| compiler.attribute(name));
            folders.extend(named.map(|folder| home.join(folder)));
        }
        for element in elements() {
            let includes = element.has_tag_name("include");
            let Some(file) = element.attribute("file").filter(|_| includes || element.has_tag_name("hfield"))
            else {
                continue;
            };
            // Any of the folders may hold the part: which one depends on the file that names it.
            let places = folders.iter().map(|folder| folder.join(file)).filter(|path| path.is_file());
            for path in places.collect::<Vec<_>>() {
                if !paths.contains(&path) {
                    paths.push(path.clone());
                    open.extend(includes.then_some(path));
                }
            }
        }
    }
    paths
}

#[cfg(test)]
#[allow(clippy::unwrap_used, reason = "a failed unwrap is a failed test")]
mod tests {
    use super::*;

    #[test]
    fn a_clamped_robot_hangs_above_the_floor_of_its_file() {
        let folder = tempfile::tempdir().unwrap();
        let path = folder.path().join("go2.xml");
        std::fs::write(&path, gaitfit_model::builtin::GO2).unwrap();
        let pairs = |hold| read(&path, false, hold).unwrap().pairs.len();
        assert!(pairs(Hold::File) > 0);
        assert_eq!(pairs(Hold::Clamped), 0);
    }

    #[test]
    fn a_robots_parts_are_found() {
        let folder = tempfile::tempdir().unwrap();
        let write = |name: &str, text: &str| {
            let path = folder.path().join(name);
            std::fs::create_dir_all(path.parent().unwrap()).unwrap();
            std::fs::write(&path, text).unwrap();
            path
        };
        let robot = write(
            "robots/a.xml",
            r#"<mujoco><compiler meshdir="heights"/><include file="../b.xml"/><asset><mesh file="m.stl"/></asset></mujoco>"#,
        );
        write("b.xml", r#"<mujoco><asset><hfield file="h.png"/></asset><include file="a.xml"/></mujoco>"#);
        write("robots/heights/h.png", "x");
        write("robots/heights/m.stl", "x");
        let mut paths: Vec<PathBuf> = parts(&robot).iter().map(|path| path.canonicalize().unwrap()).collect();
        paths.sort();
        let root = folder.path().canonicalize().unwrap();
        assert_eq!(paths, ["b.xml", "robots/a.xml", "robots/heights/h.png"].map(|name| root.join(name)));
    }
}
