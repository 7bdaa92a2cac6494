//! Joint names and patterns over them, with one meaning wherever a file names joints.
//!
//! A pattern is a glob: `*` stands for any letters, `?` for one, `[FR]` for one of a list, `{hip,calf}` for one of some
//! words. A final `_joint` does not matter, neither in the pattern nor in the joint's name: `*_hip`, `*_hip_joint` and
//! `FL_hip` all cover `FL_hip_joint`. A text that is a joint's name, such as `leg[0]`, means that joint alone. In a table
//! of numbers ([`table`]) a plain name goes before patterns, and of several
//! patterns that cover a joint the last one counts. A pattern that covers no joint is an error.

use globset::{Glob, GlobMatcher, escape};

use crate::shown::shown;

/// Names that an error suggests.
const NEAREST: usize = 3;

/// Why joints are not found.
#[derive(Clone, Debug, PartialEq, Eq, thiserror::Error)]
pub enum PatternError {
    /// Not a glob.
    #[error(
        "`{}` is no joint pattern: {reason}; write a name with * for what may be anything",
        shown(pattern)
    )]
    Syntax {
        /// The pattern.
        pattern: String,
        /// What is wrong with it.
        reason: String,
    },
    /// Covers no joint.
    #[error("`{}` matches no joint of {}; {}", shown(pattern), shown(robot), suggestion(nearest))]
    NoJoint {
        /// The pattern.
        pattern: String,
        /// Whose joints were looked at.
        robot: String,
        /// The names that are most like it, best first.
        nearest: Vec<String>,
    },
}

fn suggestion(nearest: &[String]) -> String {
    match nearest {
        [] => "it has none".to_owned(),
        names => {
            let names: Vec<String> = names.iter().map(|name| shown(name)).collect();
            format!("the nearest names are {}", names.join(", "))
        }
    }
}

/// A joint's name without the `_joint` that robot files like to add and logs leave out.
pub fn plain(joint: &str) -> &str {
    // A joint may be called `_joint` and nothing else.
    joint.strip_suffix("_joint").filter(|name| !name.is_empty()).unwrap_or(joint)
}

/// Legs that names begin with in capitals: left or right with front, middle, hind, rear or back.
const LEGS: [&str; 17] =
    ["LF", "RF", "LM", "RM", "LH", "RH", "LR", "RR", "FL", "FR", "RL", "ML", "MR", "HL", "HR", "BL", "BR"];

/// A joint's name without a leg's number or capitals at its beginning: `leg0_hip`, `leg_0_hip` and `LFHip` are `hip` or `Hip`.
pub fn without_leg(joint: &str) -> &str {
    let separator = ['_', '.', '-', '/', ' '];
    let numbered = ["leg", "Leg", "LEG"].iter().find_map(|leg| {
        let rest = joint.strip_prefix(leg)?;
        let number = rest.strip_prefix(separator).unwrap_or(rest);
        let after = number.trim_start_matches(|letter: char| letter.is_ascii_digit());
        // Without a digit it is no number.
        let after = after.strip_prefix(separator).filter(|_| after.len() < number.len())?;
        (!after.is_empty()).then_some(after)
    });
    let capitals = || {
        let after = LEGS.iter().find_map(|leg| joint.strip_prefix(leg))?;
        let mut letters = after.chars();
        // A word begins behind the leg.
        let word = letters.next()?.is_ascii_uppercase() && letters.next()?.is_ascii_lowercase();
        word.then_some(after)
    };
    numbered.or_else(capitals).unwrap_or(joint)
}

/// A pattern over joint names.
#[derive(Clone, Debug)]
pub struct Pattern {
    text: String,
    whole: GlobMatcher,
    plain: GlobMatcher,
}

impl Pattern {
    /// Reads a pattern.
    ///
    /// # Errors
    /// [`PatternError::Syntax`].
    pub fn new(text: &str) -> Result<Self, PatternError> {
        let compiled = |glob: &str| match Glob::new(glob) {
            Ok(glob) => Ok(glob.compile_matcher()),
            Err(error) => {
                Err(PatternError::Syntax { pattern: text.to_owned(), reason: error.kind().to_string() })
            }
        };
        Ok(Self { text: text.to_owned(), whole: compiled(text)?, plain: compiled(plain(text))? })
    }

    /// Reads a pattern over these `joints`: a text that is the name of one means that one.
    ///
    /// # Errors
    /// [`PatternError::Syntax`].
    pub fn over<S: AsRef<str>>(text: &str, joints: &[S]) -> Result<Self, PatternError> {
        if joints.iter().any(|joint| plain(joint.as_ref()) == plain(text)) {
            Ok(Self { text: text.to_owned(), ..Self::new(&escape(text))? })
        } else {
            Self::new(text)
        }
    }

    /// As it was written.
    pub fn text(&self) -> &str {
        &self.text
    }

    /// Whether it matches the joint.
    pub fn covers(&self, joint: &str) -> bool {
        // The pattern may end in `_joint` where the joint does not, or the other way round. A name may hold letters that mean
        // something else in a pattern.
        self.names(joint) || self.whole.is_match(joint) || self.plain.is_match(plain(joint))
    }

    /// Whether it is the joint's name, with or without a final `_joint`.
    pub fn names(&self, joint: &str) -> bool {
        plain(&self.text) == plain(joint)
    }

    /// The error of a pattern that covers none of the `joints` of `robot`.
    fn unmatched<S: AsRef<str>>(&self, robot: &str, joints: &[S]) -> PatternError {
        let wanted = plain(&self.text);
        let mut scored: Vec<(f64, &str)> = joints
            .iter()
            .map(|joint| (strsim::sorensen_dice(wanted, plain(joint.as_ref())), joint.as_ref()))
            .collect();
        // A stable sort: of equally near names the robot's first one comes first.
        scored.sort_by(|a, b| b.0.total_cmp(&a.0));
        let nearest = scored.into_iter().take(NEAREST).map(|(_, joint)| joint.to_owned()).collect();
        PatternError::NoJoint { pattern: self.text.clone(), robot: robot.to_owned(), nearest }
    }
}

/// Reads some patterns.
///
/// # Errors
/// [`PatternError::Syntax`] of the first that is none.
pub fn compile<S: AsRef<str>>(patterns: &[S]) -> Result<Vec<Pattern>, PatternError> {
    patterns.iter().map(|pattern| Pattern::new(pattern.as_ref())).collect()
}

/// Places of the `joints` that any of the patterns covers, in the joints' order. `robot`: whose joints they are, for the
/// error (`go2`, `the log`).
///
/// # Errors
/// [`PatternError`] for a pattern that is none or covers no joint.
pub fn covered<P: AsRef<str>, S: AsRef<str>>(
    patterns: &[P],
    robot: &str,
    joints: &[S],
) -> Result<Vec<usize>, PatternError> {
    let patterns = patterns.iter().map(|pattern| Pattern::over(pattern.as_ref(), joints));
    let patterns = patterns.collect::<Result<Vec<_>, _>>()?;
    // Each pattern must cover something: a typing error must not shorten a list in silence.
    for pattern in &patterns {
        if !joints.iter().any(|joint| pattern.covers(joint.as_ref())) {
            return Err(pattern.unmatched(robot, joints));
        }
    }
    let any = |joint: &str| patterns.iter().any(|pattern| pattern.covers(joint));
    Ok((0..joints.len()).filter(|&index| any(joints[index].as_ref())).collect())
}

/// For each of the `joints` the value of a table by name or pattern; `None` where no entry covers it. A plain name goes
/// before patterns; of several patterns the last one counts. `robot`: whose joints they are, for the error.
///
/// # Errors
/// [`PatternError`] for a pattern that is none or covers no joint.
pub fn table<'e, T: Clone + 'e, S: AsRef<str>>(
    entries: impl IntoIterator<Item = (&'e String, &'e T)>,
    robot: &str,
    joints: &[S],
) -> Result<Vec<Option<T>>, PatternError> {
    let mut values: Vec<Option<T>> = vec![None; joints.len()];
    let mut named = vec![false; joints.len()];
    for (text, value) in entries {
        let pattern = Pattern::over(text, joints)?;
        let mut matches = false;
        for ((slot, named), joint) in values.iter_mut().zip(&mut named).zip(joints) {
            let name = pattern.names(joint.as_ref());
            if name || pattern.covers(joint.as_ref()) {
                matches = true;
                // A plain name always sets the value; a pattern does not replace one that a name has set.
                if name || !*named {
                    *slot = Some(value.clone());
                }
                *named |= name;
            }
        }
        if !matches {
            return Err(pattern.unmatched(robot, joints));
        }
    }
    Ok(values)
}

/// The first entry of a [`table`] whose value no joint gets because a later, wider one with another value covers its joints
/// too; and that later one.
///
/// # Errors
/// [`PatternError`] as of [`table`].
pub fn without_effect<'e, T: PartialEq + 'e, S: AsRef<str>>(
    entries: impl IntoIterator<Item = (&'e String, &'e T)>,
    robot: &str,
    joints: &[S],
) -> Result<Option<(&'e str, &'e str)>, PatternError> {
    let entries: Vec<(&String, &T)> = entries.into_iter().collect();
    let places: Vec<usize> = (0..entries.len()).collect();
    // For each joint the entry whose value it gets.
    let taken = table(entries.iter().map(|(text, _)| *text).zip(&places), robot, joints)?;
    let mut covers: Vec<Vec<bool>> = Vec::with_capacity(entries.len());
    for (text, _) in &entries {
        let pattern = Pattern::over(text, joints)?;
        covers.push(joints.iter().map(|joint| pattern.covers(joint.as_ref())).collect());
    }
    let count = |entry: usize| covers[entry].iter().filter(|covered| **covered).count();
    for (entry, (text, value)) in
        entries.iter().enumerate().filter(|(entry, _)| !taken.contains(&Some(*entry)))
    {
        // Narrower entries that together cover a wide one are its exceptions.
        let wider = |later: &usize| {
            entries[*later].1 != *value
                && count(*later) > count(entry)
                && covers[entry].iter().zip(&covers[*later]).all(|(own, other)| *other || !*own)
        };
        if let Some(later) = (entry + 1..entries.len()).find(wider) {
            return Ok(Some((text.as_str(), entries[later].0.as_str())));
        }
    }
    Ok(None)
}

#[cfg(test)]
#[allow(clippy::unwrap_used, reason = "a failed unwrap is a failed test")]
mod tests {
    use super::*;

    const ROBOT: [&str; 4] = ["FL_hip_joint", "FL_calf_joint", "RR_hip_joint", "RR_calf_joint"];
    const LOG: [&str; 4] = ["FL_hip", "FL_calf", "RR_hip", "RR_calf"];

    fn numbers(entries: &[(&str, f64)], joints: &[&str]) -> Result<Vec<Option<f64>>, PatternError> {
        let owned: Vec<(String, f64)> =
            entries.iter().map(|(name, value)| ((*name).to_owned(), *value)).collect();
        table(owned.iter().map(|(name, value)| (name, value)), "go2", joints)
    }

    #[test]
    fn a_final_joint_matters_on_neither_side() {
        for joints in [ROBOT, LOG] {
            for pattern in ["*_hip", "*_hip_joint", "??_hip", "{FL,RR}_hip_joint"] {
                assert_eq!(covered(&[pattern], "go2", &joints).unwrap(), [0, 2], "{pattern}");
            }
            assert_eq!(covered(&["RR_calf_joint", "FL_hip"], "go2", &joints).unwrap(), [0, 3]);
            assert_eq!(covered(&["*"], "go2", &joints).unwrap(), [0, 1, 2, 3]);
        }
        assert_eq!(covered(&["*joint"], "go2", &ROBOT).unwrap(), [0, 1, 2, 3]);
        assert!(covered(&["hip"], "go2", &ROBOT).is_err(), "a pattern matches whole names");
    }

    #[test]
    fn names_go_before_patterns_and_later_patterns_before_earlier() {
        for joints in [ROBOT, LOG] {
            let values = numbers(&[("FL_hip", 1.0), ("*", 2.0), ("*_calf_joint", 3.0)], &joints).unwrap();
            assert_eq!(values, [Some(1.0), Some(3.0), Some(2.0), Some(3.0)]);
        }
        assert_eq!(numbers(&[("*_hip", 1.0)], &LOG).unwrap(), [Some(1.0), None, Some(1.0), None]);
    }

    #[test]
    fn a_joints_name_means_that_joint_whatever_letters_it_has() {
        let joints = ["leg[01]", "leg0", "a*", "ab", "x{", "y?"];
        for (place, joint) in joints.iter().enumerate() {
            assert_eq!(covered(&[joint], "it", &joints).unwrap(), [place], "{joint}");
            assert!(numbers(&[(*joint, 1.0)], &joints).unwrap()[place].is_some(), "{joint}");
        }
        assert_eq!(covered(&["a*b", "leg?"], "it", &joints).unwrap(), [1, 3]);
    }

    #[test]
    fn entries_that_later_ones_cover_are_found() {
        let found = |entries: &[(&str, f64)]| {
            let owned: Vec<(String, f64)> =
                entries.iter().map(|(name, value)| ((*name).to_owned(), *value)).collect();
            let entries = owned.iter().map(|(name, value)| (name, value));
            let pair = without_effect(entries, "go2", &ROBOT).unwrap();
            pair.map(|(lost, winner)| (lost.to_owned(), winner.to_owned()))
        };
        assert_eq!(found(&[("*_hip", 1.0), ("*", 2.0)]), Some(("*_hip".to_owned(), "*".to_owned())));
        for right in [
            &[("*", 2.0), ("*_hip", 1.0)][..],
            &[("FL_hip", 1.0), ("*", 2.0)],
            &[("*_hip", 2.0), ("*", 2.0)],
            &[("FL_*", 1.0), ("*_hip", 2.0)],
            &[("*", 1.0), ("*_hip", 2.0), ("*_calf", 3.0)],
        ] {
            assert_eq!(found(right), None, "{right:?}");
        }
    }

    #[test]
    fn errors_name_pattern_robot_and_what_is_near() {
        let error = numbers(&[("*", 1.0), ("*_claf", 2.0)], &ROBOT).unwrap_err();
        assert_eq!(
            error.to_string(),
            "`*_claf` matches no joint of go2; the nearest names are FL_calf_joint, RR_calf_joint, FL_hip_joint"
        );
        let error = covered(&["[a"], "go2", &ROBOT).unwrap_err();
        assert!(matches!(error, PatternError::Syntax { .. }), "{error}");
        let error = covered::<_, &str>(&["*"], "a box", &[]).unwrap_err();
        assert_eq!(error.to_string(), "`*` matches no joint of a box; it has none");
        let error = covered(&["\u{1b}[2J\u{9b}"], "go2", &ROBOT).unwrap_err().to_string();
        assert!(!error.chars().any(char::is_control), "{error}");
    }
}
