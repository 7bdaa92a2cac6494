//! Joints that are alike: the same joint of every leg.

use super::AdaptConfig;
use gaitfit_model::patterns::{plain, without_leg};
use globset::Glob;
use std::collections::HashSet;

/// Parts of a name that say which leg a joint is on.
const SIDES: [&str; 24] = [
    "fl", "fr", "rl", "rr", "hl", "hr", "bl", "br", "lf", "rf", "lm", "rm", "lh", "rh", "lr", "l", "r",
    "left", "right", "front", "rear", "hind", "back", "middle",
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
    let mut seen = HashSet::new();
    // A joint's name without its side or leg is the name of its group.
    for joint in joints {
        let (mut key, leg) = key(joint);
        // Two joints of one limb are not alike, though their names may be: `left.knee` and `left_knee`.
        if !seen.insert((key.clone(), leg)) {
            key = plain(joint).to_lowercase();
            while groups.iter().any(|(name, _)| *name == key) {
                key.push('_');
            }
        }
        match groups.iter_mut().find(|(name, _)| *name == key) {
            Some((_, alike)) => alike.push(joint.clone()),
            None => groups.push((key, vec![joint.clone()])),
        }
    }
    Some(groups)
}

/// A joint's name without its leg, and its leg: `LF_HAA` and `RH_HAA` are `haa` of `lf` and `rh`.
fn key(name: &str) -> (String, String) {
    let whole = plain(name);
    let without = without_leg(whole);
    let prefix = whole[..whole.len() - without.len()].to_lowercase();
    let plain = without.to_lowercase();
    let parts = plain.split(['_', '.', '-', '/', ' ']).filter(|part| !part.is_empty());
    let (sides, rest): (Vec<&str>, Vec<&str>) = parts.partition(|part| SIDES.contains(part));
    let leg = prefix + &sides.join("_");
    // A joint that is called by its side alone, such as `left`, keeps this name.
    let rest = if rest.is_empty() { plain } else { rest.join("_") };
    (rest, leg)
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
        let keys = ["LF_HAA", "fl.hx", "left_hip_pitch_joint", "FR_calf_joint", "waist_yaw", "left"];
        assert_eq!(keys.map(|name| key(name).0), ["haa", "hx", "hip_pitch", "calf", "waist_yaw", "left"]);
        let keys = ["leg0_femur", "leg_12.femur", "LMFemur", "RRFemur", "leg0", "j11"];
        assert_eq!(keys.map(|name| key(name).0), ["femur", "femur", "femur", "femur", "leg0", "j11"]);
    }

    #[test]
    fn joints_of_one_limb_are_not_alike() {
        let names = ["left.j1", "left_j1", "right.j1"].map(str::to_owned);
        let groups = by_name(&names).unwrap_or_default();
        let expected = [("j1", vec!["left.j1", "right.j1"]), ("left_j1", vec!["left_j1"])];
        let expected = expected.map(|(name, joints)| {
            (name.to_owned(), joints.into_iter().map(str::to_owned).collect::<Vec<String>>())
        });
        assert_eq!(groups, expected);
    }
}
