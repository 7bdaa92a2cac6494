//! Patterns over joint names.

use super::ThetaError;
use globset::{Glob, GlobSet, GlobSetBuilder};

/// Every joint: what a rule that is silent covers.
pub(super) fn every_joint() -> Vec<String> {
    vec!["*".to_owned()]
}

/// A joint's name without the `_joint` that robot files like to add and logs leave out.
pub(super) fn plain(joint: &str) -> &str {
    joint.strip_suffix("_joint").unwrap_or(joint)
}

/// Whether a pattern matches the joint, with or without `_joint`: `*_hip` covers `FL_hip_joint`.
pub(super) fn matches(patterns: &GlobSet, joint: &str) -> bool {
    patterns.is_match(joint) || patterns.is_match(plain(joint))
}

pub(super) fn matcher(patterns: &[String]) -> Result<GlobSet, ThetaError> {
    let wrong = |pattern: &String, error: globset::Error| ThetaError::Pattern {
        pattern: pattern.clone(),
        reason: error.kind().to_string(),
    };
    let mut set = GlobSetBuilder::new();
    for pattern in patterns {
        set.add(Glob::new(pattern).map_err(|error| wrong(pattern, error))?);
    }
    set.build().map_err(|error| wrong(&patterns.join(", "), error))
}

/// The joints that `patterns` cover, in order; at least one.
pub(super) fn covered<'a>(
    kind: &'static str,
    patterns: &[String],
    joints: &'a [String],
) -> Result<Vec<&'a String>, ThetaError> {
    let set = matcher(patterns)?;
    let covered: Vec<&String> = joints.iter().filter(|joint| matches(&set, joint)).collect();
    if covered.is_empty() {
        let joints = joints.join(", ");
        return Err(ThetaError::NoJoint { kind, patterns: patterns.to_vec(), joints });
    }
    Ok(covered)
}
