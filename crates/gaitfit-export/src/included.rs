//! Files that a robot's MJCF includes. An export changes only the robot's own file.

use super::MAX_BYTES;
use super::mjcf::ONE_FILE;
use super::xml::parse;
use gaitfit_model::shown_path;
use gaitfit_run::files;
use gaitfit_settings::Error;
use roxmltree::{Document, Node};
use std::path::Path;

/// Settings of the compiler that decide what numbers of the robot's own file mean.
const COMPILER: [&str; 3] = ["angle", "settotalmass", "inertiafromgeom"];
/// What the flags of a file switch off and a fit may have.
const FLAGS: [&str; 4] = ["frictionloss", "passive", "damper", "spring"];

/// Refuses a robot with the text `text` whose included files state something that the export reads from the robot's own
/// file or replaces there. With `gains` it replaces actuators and controls of keyframes.
///
/// # Errors
/// Such a file, or one that cannot be read.
pub(super) fn check(text: &str, robot: &Path, gains: bool) -> Result<(), Error> {
    // MuJoCo looks for all included files from the folder of the robot's own file.
    let folder = robot.parent().unwrap_or(Path::new(""));
    let mut names = named(&parse(text)?);
    // The robot's reader has refused files that include themselves, so this ends.
    while let Some(name) = names.pop() {
        let path = folder.join(name);
        let text = files::read_text(&path, MAX_BYTES).map_err(|source| Error::unreadable(&path, source))?;
        let document = parse(&text)?;
        if let Some(node) = document.descendants().find(|node| matters(node, gains)) {
            return Err(Error::failed(format!(
                "{}: it has <{}>, and the robot's file includes it. The export changes only the robot's own file. \
                 {ONE_FILE}",
                shown_path(&path),
                node.tag_name().name()
            )));
        }
        names.extend(named(&document));
    }
    Ok(())
}

/// The files that a document includes.
fn named(document: &Document<'_>) -> Vec<String> {
    let includes = document.descendants().filter(|node| node.has_tag_name("include"));
    includes.filter_map(|node| node.attribute("file")).map(str::to_owned).collect()
}

fn matters(node: &Node<'_, '_>, gains: bool) -> bool {
    match node.tag_name().name() {
        "compiler" => COMPILER.iter().any(|name| node.has_attribute(*name)),
        "flag" => FLAGS.iter().any(|name| node.attribute(*name) == Some("disable")),
        "actuator" | "key" => gains,
        _ => false,
    }
}
