//! Joints that are alike: the same joint of every leg.

use super::AdaptConfig;
use gaitfit_model::patterns::plain;
use globset::Glob;

/// Parts of a name that say which leg a joint is on.
const SIDES: [&str; 22] = [
    "fl", "fr", "rl", "rr", "hl", "hr", "bl", "br", "lf", "rf", "lh", "rh", "lr", "l", "r", "left", "right",
    "front", "rear", "hind", "back", "middle",
];

/// Groups of joints by their names without the leg, each with exact names; `None` if the default groups contain all of
/// the joints.
pub fn by_name(joints: &[String]) -> Option<Vec<(String, Vec<String>)>> {
    // The default groups are patterns for robots like the Go2.
    let defaults = AdaptConfig::default().groups;
    let patterns: Vec<_> = defaults
        .values()
        .flatten()
        .filter_map(|pattern| Glob::new(pattern).ok())
        .map(|glob| glob.compile_matcher())
        .collect();
    // A joint in two groups would have two values for one parameter.
    let grouped = |name: &str| patterns.iter().filter(|pattern| pattern.is_match(name)).count() == 1;
    if joints.iter().all(|joint| grouped(joint)) {
        // The default groups fit this robot.
        return None;
    }
    let mut groups: Vec<(String, Vec<String>)> = Vec::new();
    // A joint's name without its side or leg is the name of its group.
    for joint in joints {
        let key = key(joint);
        match groups.iter_mut().find(|(name, _)| *name == key) {
            Some((_, alike)) => alike.push(joint.clone()),
            None => groups.push((key, vec![joint.clone()])),
        }
    }
    Some(groups)
}

/// A joint's name without its leg: `LF_HAA` and `RH_HAA` are `haa`.
fn key(name: &str) -> String {
    let plain = plain(name).to_lowercase();
    let parts: Vec<&str> = plain.split(['_', '.', '-', '/', ' ']).filter(|part| !part.is_empty()).collect();
    let rest: Vec<&str> = parts.iter().copied().filter(|part| !SIDES.contains(part)).collect();
    // A joint that is called by its side alone, such as `left`, keeps this name.
    if rest.is_empty() { plain } else { rest.join("_") }
}

#[cfg(test)]
mod tests {
    use super::*;

    #[test]
    fn default_groups_give_way_to_names_of_another_robot() {
        let config = AdaptConfig::default();
        let names = |joints: &[&str]| joints.iter().map(|&joint| joint.to_owned()).collect::<Vec<_>>();
        let quadruped = names(&["FL_hip_joint", "FR_hip_joint", "FL_calf_joint"]);
        assert_eq!(config.groups(&quadruped).len(), 3, "the default ones stay");
        let biped = names(&["Left_Knee_Pitch", "Right_Knee_Pitch", "Waist"]);
        let expected = vec![
            ("knee_pitch".to_owned(), names(&["Left_Knee_Pitch", "Right_Knee_Pitch"])),
            ("waist".to_owned(), names(&["Waist"])),
        ];
        assert_eq!(config.groups(&biped), expected);
        let stated =
            AdaptConfig { groups: [("all".to_owned(), names(&["*"]))].into(), ..AdaptConfig::default() };
        assert_eq!(stated.groups(&biped), [("all".to_owned(), names(&["*"]))]);
    }

    #[test]
    fn a_leg_leaves_the_name() {
        let keys = ["LF_HAA", "fl.hx", "left_hip_pitch_joint", "FR_calf_joint", "waist_yaw", "left"].map(key);
        assert_eq!(keys, ["haa", "hx", "hip_pitch", "calf", "waist_yaw", "left"]);
    }
}
