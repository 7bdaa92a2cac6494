//! What reading left out or added, in lines that a person reads: things of one kind are one line.

use std::collections::HashMap;

use serde::Serialize;

use crate::model::{Model, Root};
use crate::shown::{listed, shown};
use crate::urdf::COLLISION_MESH;

/// Max number of links that a message names.
const NAMED_LINKS: usize = 4;

/// Things of one kind that a file has and its model does not.
#[derive(Clone, Debug, PartialEq, Serialize)]
pub struct LeftOut {
    /// What, with how many: `36 visual meshes`; a single thing with its name, and the first of those that matter.
    pub what: String,
    /// Why.
    pub why: String,
    /// How many.
    pub count: usize,
    /// Line of the first, from 1 (0: not from one place).
    pub line: u32,
    /// Line of the last.
    pub last_line: u32,
    /// Whether the motion stays the same without it, up to contact between the robot's own parts. Else it was left out
    /// because the reading was lenient.
    pub harmless: bool,
}

/// Max number of joints named in a warning.
const MAX_NAMES: usize = 4;

impl Model {
    /// Things that the model leaves out of its file, those of one kind together, in the order of the first of each.
    pub fn left_out(&self) -> Vec<LeftOut> {
        let mut groups: Vec<(LeftOut, String)> = Vec::new();
        let mut places: HashMap<(String, &str, bool), usize> = HashMap::new();
        for dropped in &self.dropped {
            let kind = kind(&dropped.what);
            // The first thing of a kind makes its group, so groups have the file's order.
            let place = *places.entry((kind.clone(), &dropped.why, dropped.harmless)).or_insert(groups.len());
            if place == groups.len() {
                let group = LeftOut {
                    what: dropped.what.clone(),
                    why: dropped.why.clone(),
                    count: 0,
                    line: dropped.line,
                    last_line: dropped.line,
                    harmless: dropped.harmless,
                };
                groups.push((group, kind));
            }
            let group = &mut groups[place].0;
            group.count += 1;
            (group.line, group.last_line) = (group.line.min(dropped.line), group.last_line.max(dropped.line));
        }
        let named = |(group, kind): (LeftOut, String)| match group.count {
            // A single thing keeps its name.
            1 => group,
            count => {
                // The name stands between the first two quotation marks.
                let first = group.what.split('"').nth(1).filter(|_| !group.harmless);
                let such = first.map(|name| format!(", such as \"{name}\"")).unwrap_or_default();
                LeftOut { what: format!("{}{such}", plural(count, &kind)), ..group }
            }
        };
        groups.into_iter().map(named).collect()
    }

    /// What to know before trusting a simulation of this robot: what a lenient reading took away, joints without a bound
    /// on their torque, no contact with the ground.
    pub fn warnings(&self) -> Vec<String> {
        let mut warnings = Vec::new();
        for group in self.left_out().iter().filter(|group| !group.harmless) {
            warnings.push(format!("the robot is read without {}: {}", group.what, group.why));
        }
        if let Some(unbounded) = self.unbounded() {
            warnings.push(format!(
                "{unbounded}: torques grow without bound; give the actuators a `forcerange`, motors a `ctrlrange`, or \
                 the joints an `actuatorfrcrange` (URDF: <limit effort=\"...\"/>)"
            ));
        }
        if let Some(uneven) = self.uneven() {
            warnings.push(uneven);
        }
        if self.root == Root::Floating && self.pairs.is_empty() {
            warnings.push(match self.feet_of_meshes() {
                Some(meshes) => {
                    format!("nothing of the robot touches the ground, so it falls without end: {meshes}")
                }
                None => {
                    let no_floor = self.planes.is_empty() && self.obstacles.is_empty();
                    let why = match (no_floor, self.geoms.is_empty()) {
                        (true, _) => "the file has no floor",
                        (_, true) => "no geom of it collides here",
                        _ => {
                            "contacts are off, or `contype` and `conaffinity` of floor and robot do not meet"
                        }
                    };
                    format!("nothing of the robot touches the ground ({why}): it falls without end")
                }
            });
        }
        warnings
    }

    /// Why nothing of a robot touches the ground whose links collide as meshes alone, and what to write into its file;
    /// `None` of another robot.
    pub fn feet_of_meshes(&self) -> Option<String> {
        let all = self.dropped.iter().filter_map(|one| one.what.strip_prefix(COLLISION_MESH));
        let links: Vec<&str> = all.collect();
        if links.is_empty() || !self.pairs.is_empty() {
            return None;
        }
        let named = listed(&links, NAMED_LINKS);
        Some(format!(
            "the collision shapes of {named} are meshes, and meshes do not collide here. Give each foot's link a ball \
             as well, where the foot is: <collision><origin xyz=\"0 0 -0.2\"/><geometry><sphere \
             radius=\"0.02\"/></geometry></collision>"
        ))
    }

    /// Torque ranges that are not the same to both sides, in words: the simulation clamps alike.
    fn uneven(&self) -> Option<String> {
        let of_joint = |joint: usize| {
            let clamp = self.joints[joint].actuatorfrcrange;
            let actuators = self.actuators.iter().filter(|actuator| actuator.joint == joint);
            let ranges = actuators.flat_map(|actuator| {
                // The control of a servo is a position or a velocity, so its range bounds no torque.
                [actuator.ctrlrange.filter(|_| actuator.bias == [0.0; 3]), actuator.forcerange]
            });
            ranges.chain([clamp]).flatten().find(|[low, high]| -low != *high)
        };
        // The first such joint stands for all.
        let (joint, [low, high]) = (0..self.joints.len()).find_map(|j| Some((j, of_joint(j)?)))?;
        let bound = symmetric([low, high]);
        let (kind, name) = (self.joints[joint].kind, shown(&self.joints[joint].name));
        let (what, unit) = (if kind.is_hinge() { "torque" } else { "force" }, kind.unit("N·m"));
        Some(format!(
            "the {what} range of joint {name} is {low} to {high} {unit}: {what}s are clamped to both sides alike, here to ±{bound}"
        ))
    }

    /// Which driven joints have no bound on their torque, in words; `None` if all have one.
    fn unbounded(&self) -> Option<String> {
        let all = self.actuators.is_empty();
        let driven: Vec<usize> =
            (0..self.joints.len()).filter(|&j| self.is_driven(j) && !self.only_follows(j)).collect();
        let free: Vec<usize> = driven.iter().copied().filter(|&j| self.effort(j).is_none()).collect();
        if free.is_empty() {
            return None;
        }
        // Where no joint has a bound, names say nothing more.
        if free.len() == driven.len() {
            let what = if all { "joint" } else { "actuator" };
            return Some(format!("no {what} of the robot has an effort limit"));
        }
        let names: Vec<String> = free.iter().take(MAX_NAMES).map(|&j| shown(&self.joints[j].name)).collect();
        let more = if free.len() > MAX_NAMES { ", ..." } else { "" };
        let (count, of, names) = (free.len(), driven.len(), names.join(", "));
        Some(format!("{count} of {of} driven joints have no effort limit ({names}{more})"))
    }
}

/// The kind of a thing, without its name: `visual mesh` of `geom "shell" (mesh, visual)`.
fn kind(what: &str) -> String {
    let mut bare = String::new();
    // Between two quotation marks stands a name: every second part.
    for (index, part) in what.split('"').enumerate() {
        if index % 2 == 0 {
            bare.push_str(if index > 0 { part } else { part.trim_end() });
        }
    }
    let shape = bare.strip_prefix("geom (").and_then(|rest| rest.strip_suffix(')'));
    match shape.map(|shape| shape.strip_suffix(", visual").ok_or(shape)) {
        Some(Ok(shape)) => format!("visual {shape}"),
        Some(Err(shape)) => format!("colliding {shape}"),
        None => bare,
    }
}

/// `36 visual meshes`, or `4 × <transmission>` for what has no simple plural.
fn plural(count: usize, kind: &str) -> String {
    // An ending makes the plural of one or two plain words; a tag or an attribute stays as it is written.
    let words = kind.split(' ').count();
    if words > 2 || !kind.chars().all(|c| c.is_ascii_alphabetic() || c == ' ') {
        return format!("{count} × {kind}");
    }
    let ending = kind.strip_suffix('y').map(|stem| format!("{stem}ies"));
    let plain = if ["sh", "x", "s"].iter().any(|end| kind.ends_with(end)) { "es" } else { "s" };
    format!("{count} {}", ending.unwrap_or_else(|| format!("{kind}{plain}")))
}

/// The bound of a torque range in the simulation, which clamps to both sides alike: the smaller of the two, or the larger
/// one if the other side gives nothing.
pub(crate) fn symmetric([low, high]: [f64; 2]) -> f64 {
    let (down, up) = (-low, high);
    if down > 0.0 && up > 0.0 { down.min(up) } else { down.max(up).max(0.0) }
}

#[cfg(test)]
mod tests {
    use super::*;

    #[test]
    fn things_lose_their_names_and_get_a_plural() {
        for (what, many) in [
            ("geom \"shell\" (mesh, visual)", "2 visual meshes"),
            ("geom \"shell\" (box, visual)", "2 visual boxes"),
            ("geom \"a\" (mesh)", "2 colliding meshes"),
            ("body \"b\"", "2 bodies"),
            ("actuator \"b\"", "2 actuators"),
            ("`dont_collapse` of <joint> \"foot\"", "2 × `dont_collapse` of <joint>"),
            ("<gazebo>", "2 × <gazebo>"),
            ("collision mesh of <link> \"trunk\"", "2 × collision mesh of <link>"),
            ("geom \"a\" (primitive fitted to a mesh, visual)", "2 × visual primitive fitted to a mesh"),
        ] {
            assert_eq!(plural(2, &kind(what)), many);
        }
    }
}
