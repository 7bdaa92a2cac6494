//! Which joints share what is searched.

use super::ThetaError;
use gaitfit_model::patterns::{Pattern, covered, plain};
use serde::{Deserialize, Serialize};

/// How many joints share a value, or a network.
#[derive(Clone, Copy, Debug, Default, PartialEq, Eq, Serialize, Deserialize)]
#[serde(rename_all = "lowercase")]
pub enum Sharing {
    /// One a group.
    #[default]
    Group,
    /// One a joint.
    Joint,
    /// One for all joints of the rule.
    All,
}

/// Joints that share.
pub(super) struct Share<'a> {
    /// The group, the joint without `_joint`, or where all share the words of their patterns, of `*` none.
    name: String,
    /// The joints, at least one.
    pub(super) joints: Vec<&'a String>,
}

impl Share<'_> {
    /// Name of what they share: `damping` of `*_hip` is `damping_hip`.
    pub(super) fn named(&self, what: &str) -> String {
        if self.name.is_empty() { what.to_owned() } else { format!("{what}_{}", self.name) }
    }
}

impl Sharing {
    /// The joints of the robot that `patterns` cover, by what they share; groups (names with joint patterns) in the
    /// order of their first joint.
    ///
    /// # Errors
    /// [`ThetaError`] if a pattern is invalid or covers no joint, or a joint is not in exactly one group.
    pub(super) fn shares<'a>(
        self,
        kind: &'static str,
        patterns: &[String],
        groups: &[(String, Vec<String>)],
        joints: &'a [String],
    ) -> Result<Vec<Share<'a>>, ThetaError> {
        let wrong = |source| ThetaError::Joints { kind, source };
        let places = covered(patterns, "the robot", joints).map_err(wrong)?;
        let covered: Vec<&String> = places.into_iter().map(|place| &joints[place]).collect();
        match self {
            Self::All => Ok(vec![Share { name: words(patterns), joints: covered }]),
            Self::Joint => Ok(covered
                .into_iter()
                .map(|joint| Share { name: plain(joint).to_owned(), joints: vec![joint] })
                .collect()),
            Self::Group => {
                let mut shares: Vec<Share<'a>> = Vec::new();
                // Patterns are compiled once, not for each joint.
                let compiled: Vec<(&str, Vec<Pattern>)> = groups
                    .iter()
                    .map(|(name, patterns)| {
                        let patterns = patterns.iter().map(|pattern| Pattern::over(pattern, joints));
                        Ok((name.as_str(), patterns.collect::<Result<Vec<_>, _>>().map_err(wrong)?))
                    })
                    .collect::<Result<_, ThetaError>>()?;
                for joint in covered {
                    let groups: Vec<&str> = compiled
                        .iter()
                        .filter(|(_, patterns)| patterns.iter().any(|pattern| pattern.covers(joint)))
                        .map(|(name, _)| *name)
                        .collect();
                    // A joint in no group or in two would get no value, or two.
                    let [group] = groups[..] else {
                        let found = if groups.is_empty() { "none".to_owned() } else { groups.join(" and ") };
                        return Err(ThetaError::Group { kind, joint: joint.clone(), found });
                    };
                    // Groups keep the order of the robot's joints.
                    match shares.iter_mut().find(|share| share.name == group) {
                        Some(share) => share.joints.push(joint),
                        None => shares.push(Share { name: group.to_owned(), joints: vec![joint] }),
                    }
                }
                Ok(shares)
            }
        }
    }
}

/// The text of patterns without the wildcards at their ends.
fn words(patterns: &[String]) -> String {
    let word =
        |pattern: &'_ String| pattern.trim_matches(|letter: char| !letter.is_alphanumeric()).to_owned();
    patterns.iter().map(word).filter(|word| !word.is_empty()).collect::<Vec<_>>().join("_")
}
