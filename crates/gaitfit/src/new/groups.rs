//! Joints that are alike: the same joint of every leg.

use crate::settings::AdaptConfig;
use gaitfit_model::Model;
use gaitfit_model::glob::Glob;
use gaitfit_model::patterns::plain;

/// Parts of a name that say which leg a joint is on.
const SIDES: [&str; 22] = [
    "fl", "fr", "rl", "rr", "hl", "hr", "bl", "br", "lf", "rf", "lh", "rh", "lr", "l", "r", "left", "right",
    "front", "rear", "hind", "back", "middle",
];

/// Groups of a robot's joints, by name and with exact names; `None` if the default groups hold all of them.
pub fn of(model: &Model) -> Option<Vec<(String, Vec<String>)>> {
    let defaults = AdaptConfig::default().groups();
    let patterns: Vec<_> = defaults
        .iter()
        .flat_map(|(_, patterns)| patterns)
        .filter_map(|pattern| Glob::new(pattern).ok())
        .collect();
    let grouped = |name: &str| patterns.iter().filter(|pattern| pattern.matches(name)).count() == 1;
    if model.joints.iter().all(|joint| grouped(&joint.name)) {
        return None;
    }
    let mut groups: Vec<(String, Vec<String>)> = Vec::new();
    for joint in &model.joints {
        let key = key(&joint.name);
        match groups.iter_mut().find(|(name, _)| *name == key) {
            Some((_, joints)) => joints.push(joint.name.clone()),
            None => groups.push((key, vec![joint.name.clone()])),
        }
    }
    Some(groups)
}

/// A joint's name without its leg: `LF_HAA` and `RH_HAA` are `haa`.
fn key(name: &str) -> String {
    let plain = plain(name).to_lowercase();
    let parts: Vec<&str> = plain.split(['_', '.', '-', '/', ' ']).filter(|part| !part.is_empty()).collect();
    let rest: Vec<&str> = parts.iter().copied().filter(|part| !SIDES.contains(part)).collect();
    if rest.is_empty() { plain } else { rest.join("_") }
}

#[cfg(test)]
mod tests {
    use super::key;

    #[test]
    fn a_leg_leaves_the_name() {
        let keys = ["LF_HAA", "fl.hx", "left_hip_pitch_joint", "FR_calf_joint", "waist_yaw", "left"].map(key);
        assert_eq!(keys, ["haa", "hx", "hip_pitch", "calf", "waist_yaw", "left"]);
    }
}
