//! θ: the simulator parameters a fit changes, as named entries with unit, bounds, start and deviation.
//!
//! A value is applied to every joint its entry covers. Entries are built from rules over joint patterns, so
//! that the same configuration serves robots with other joint counts.

mod quantity;
mod rules;

pub use quantity::{Defaults, Quantity};
pub use rules::{ParameterRule, Sharing};

use serde::{Deserialize, Serialize};

/// One entry of θ: a quantity shared by some joints.
#[derive(Clone, Debug, PartialEq, Serialize, Deserialize)]
pub struct Entry {
    /// Name, for example `frictionloss_hip`.
    pub name: String,
    /// What it changes.
    pub quantity: Quantity,
    /// Unit of the value.
    pub unit: String,
    /// The joints it covers, robot joint names.
    pub joints: Vec<String>,
    /// Lower bound.
    pub lower: f64,
    /// Upper bound.
    pub upper: f64,
    /// First mean of the search.
    pub start: f64,
    /// First standard deviation of the search.
    pub deviation: f64,
}

/// The entries of θ, in order; a vector of values runs parallel to them.
#[derive(Clone, Debug, Default, PartialEq, Serialize, Deserialize)]
pub struct Theta {
    /// The entries.
    pub entries: Vec<Entry>,
}

/// Why θ cannot be built.
#[derive(Clone, Debug, PartialEq, thiserror::Error)]
pub enum ThetaError {
    /// Bounds, start or deviation are out of order.
    #[error(
        "parameter `{name}`: lower {lower}, start {start}, upper {upper}, deviation {deviation} are out of order; \
         needed: lower < upper, lower ≤ start ≤ upper, deviation > 0, all finite"
    )]
    Order {
        /// Entry.
        name: String,
        /// Its lower bound.
        lower: f64,
        /// Its start.
        start: f64,
        /// Its upper bound.
        upper: f64,
        /// Its deviation.
        deviation: f64,
    },
    /// Bounds reach outside what the quantity can be.
    #[error("parameter `{name}`: {kind} below {least} has no meaning; raise its lower bound {lower}")]
    Meaningless {
        /// Entry.
        name: String,
        /// Quantity.
        kind: &'static str,
        /// Smallest meaningful value.
        least: f64,
        /// The lower bound asked for.
        lower: f64,
    },
    /// A pattern is not valid.
    #[error("`{pattern}` is no joint pattern: {reason}")]
    Pattern {
        /// The pattern.
        pattern: String,
        /// What is wrong with it.
        reason: String,
    },
    /// A rule matches nothing.
    #[error("parameter {kind} with joints {patterns:?} covers no joint; the robot has {joints}")]
    NoJoint {
        /// Quantity.
        kind: &'static str,
        /// The rule's patterns.
        patterns: Vec<String>,
        /// The robot's joints.
        joints: String,
    },
    /// A joint belongs to no group, or to several.
    #[error(
        "parameter {kind} is per group, and joint `{joint}` is in {found}; every joint it covers needs exactly \
         one group: change [groups], or limit the entry with `joints`"
    )]
    Group {
        /// Quantity.
        kind: &'static str,
        /// Joint.
        joint: String,
        /// The groups found.
        found: String,
    },
    /// Two entries change the same quantity of the same joint.
    #[error(
        "parameters `{first}` and `{second}` both set {kind} of joint `{joint}`; limit one with `joints`"
    )]
    Overlap {
        /// One entry.
        first: String,
        /// The other.
        second: String,
        /// Quantity.
        kind: &'static str,
        /// Joint.
        joint: String,
    },
    /// Two entries have the same name.
    #[error("two parameters are called `{0}`; give one of them another `name`")]
    SameName(String),
    /// There is nothing to fit.
    #[error("there is no [[parameter]] to fit; add one, `gaitfit config` shows the kinds")]
    Empty,
}

impl Theta {
    /// Entries from rules. `groups` are names with joint patterns; `joints` are the robot's joint names.
    pub fn from_rules(
        rules: &[ParameterRule],
        groups: &[(String, Vec<String>)],
        joints: &[String],
    ) -> Result<Self, ThetaError> {
        let mut entries = Vec::new();
        for rule in rules {
            entries.extend(rule.entries(groups, joints)?);
        }
        let theta = Self { entries };
        theta.check()?;
        Ok(theta)
    }

    fn check(&self) -> Result<(), ThetaError> {
        if self.entries.is_empty() {
            return Err(ThetaError::Empty);
        }
        for (index, entry) in self.entries.iter().enumerate() {
            entry.check()?;
            for other in &self.entries[..index] {
                if other.name == entry.name {
                    return Err(ThetaError::SameName(entry.name.clone()));
                }
                let shared = entry.joints.iter().find(|&joint| other.joints.contains(joint));
                if let (true, Some(joint)) = (other.quantity == entry.quantity, shared) {
                    return Err(ThetaError::Overlap {
                        first: other.name.clone(),
                        second: entry.name.clone(),
                        kind: entry.quantity.name(),
                        joint: joint.clone(),
                    });
                }
            }
        }
        Ok(())
    }

    /// Number of entries.
    pub fn len(&self) -> usize {
        self.entries.len()
    }

    /// Whether there are no entries: the robot as its file says.
    pub fn is_empty(&self) -> bool {
        self.entries.is_empty()
    }

    /// The first mean of the search, one value an entry.
    pub fn start(&self) -> Vec<f64> {
        self.entries.iter().map(|entry| entry.start).collect()
    }

    /// Largest value any entry of `quantity` may take; `None` without such an entry.
    pub fn largest(&self, quantity: Quantity) -> Option<f64> {
        let bounds = self.entries.iter().filter(|entry| entry.quantity == quantity);
        bounds.map(|entry| entry.upper).reduce(f64::max)
    }

    /// Calls `set(quantity, joint index, value)` for every joint every entry covers; `joints` gives the order.
    pub fn apply(&self, values: &[f64], joints: &[String], mut set: impl FnMut(Quantity, usize, f64)) {
        for (entry, &value) in self.entries.iter().zip(values) {
            for name in &entry.joints {
                if let Some(joint) = joints.iter().position(|joint| joint == name) {
                    set(entry.quantity, joint, value);
                }
            }
        }
    }
}

impl Entry {
    fn check(&self) -> Result<(), ThetaError> {
        let Entry { lower, upper, start, deviation, .. } = *self;
        let finite = [lower, upper, start, deviation].iter().all(|value| value.is_finite());
        if !(finite && lower < upper && lower <= start && start <= upper && deviation > 0.0) {
            return Err(ThetaError::Order { name: self.name.clone(), lower, start, upper, deviation });
        }
        let least = self.quantity.least();
        if lower < least {
            return Err(ThetaError::Meaningless {
                name: self.name.clone(),
                kind: self.quantity.name(),
                least,
                lower,
            });
        }
        Ok(())
    }

    /// Whether `value` lies on a bound: within a thousandth of the range of it.
    pub fn at_bound(&self, value: f64) -> bool {
        let near = 1e-3 * (self.upper - self.lower);
        value - self.lower < near || self.upper - value < near
    }
}

#[cfg(test)]
#[allow(clippy::unwrap_used, reason = "a failed unwrap is a failed test")]
mod tests {
    use super::*;

    fn joints() -> Vec<String> {
        ["FL", "FR"]
            .iter()
            .flat_map(|leg| ["hip", "thigh", "calf"].map(|part| format!("{leg}_{part}")))
            .collect()
    }

    fn groups() -> Vec<(String, Vec<String>)> {
        ["hip", "thigh", "calf"].map(|name| (name.to_owned(), vec![format!("*_{name}")])).to_vec()
    }

    fn rule(kind: Quantity, per: Sharing, patterns: &[&str]) -> ParameterRule {
        ParameterRule {
            per,
            joints: patterns.iter().map(|&pattern| pattern.to_owned()).collect(),
            ..ParameterRule::new(kind)
        }
    }

    #[test]
    fn fric_arm_has_six_numbers_with_the_papers_bounds() {
        let theta = Theta::from_rules(&ParameterRule::fric_arm(), &groups(), &joints()).unwrap();
        let names: Vec<_> = theta.entries.iter().map(|entry| entry.name.as_str()).collect();
        assert_eq!(
            names,
            [
                "frictionloss_hip",
                "frictionloss_thigh",
                "frictionloss_calf",
                "armature_hip",
                "armature_thigh",
                "armature_calf"
            ]
        );
        let hip = &theta.entries[0];
        assert_eq!((hip.lower, hip.upper, hip.start, hip.deviation), (0.0, 0.5, 0.0, 0.1));
        assert_eq!(hip.joints, ["FL_hip", "FR_hip"]);
        assert_eq!(theta.entries[3].deviation, 0.05);
    }

    #[test]
    fn one_value_for_all_one_for_each_and_one_for_a_pattern() {
        let rules = [
            rule(Quantity::Delay, Sharing::All, &["*"]),
            rule(Quantity::EncoderBias, Sharing::Joint, &["*_calf"]),
            rule(Quantity::Damping, Sharing::All, &["*_hip"]),
        ];
        let theta = Theta::from_rules(&rules, &groups(), &joints()).unwrap();
        let names: Vec<_> = theta.entries.iter().map(|entry| entry.name.as_str()).collect();
        assert_eq!(names, ["delay", "encoder_bias_FL_calf", "encoder_bias_FR_calf", "damping_hip"]);
        assert_eq!(theta.largest(Quantity::Delay), Some(0.1));

        let mut set = Vec::new();
        theta.apply(&[0.01, 0.02, 0.03, 0.04], &joints(), |quantity, joint, value| {
            if quantity == Quantity::EncoderBias {
                set.push((joint, value));
            }
        });
        assert_eq!(set, [(2, 0.02), (5, 0.03)]);
    }

    #[test]
    fn patterns_and_names_leave_out_a_final_joint() {
        let joints = ["FL_hip_joint".to_owned(), "FL_calf_joint".to_owned()];
        let rules = [rule(Quantity::Delay, Sharing::Joint, &["*_hip"])];
        let theta = Theta::from_rules(&rules, &groups(), &joints).unwrap();
        assert_eq!(theta.entries[0].name, "delay_FL_hip");
        assert_eq!(theta.entries[0].joints, ["FL_hip_joint"]);
    }

    #[test]
    fn a_bound_below_its_start_is_refused_by_name() {
        let mut low = rule(Quantity::Armature, Sharing::Group, &["*"]);
        low.upper = Some(0.1);
        low.start = Some(0.2);
        let error = Theta::from_rules(&[low], &groups(), &joints()).unwrap_err();
        assert!(error.to_string().contains("armature_hip"), "{error}");
        let mut negative = rule(Quantity::Armature, Sharing::Group, &["*"]);
        negative.lower = Some(-0.1);
        let error = Theta::from_rules(&[negative], &groups(), &joints()).unwrap_err();
        assert!(matches!(error, ThetaError::Meaningless { .. }), "{error}");
    }

    #[test]
    fn overlapping_unmatched_and_ungrouped_joints_are_refused() {
        let twice = [
            rule(Quantity::Delay, Sharing::All, &["*"]),
            ParameterRule { name: Some("late".into()), ..rule(Quantity::Delay, Sharing::All, &["*_hip"]) },
        ];
        let error = Theta::from_rules(&twice, &groups(), &joints()).unwrap_err();
        assert!(matches!(error, ThetaError::Overlap { .. }), "{error}");
        let error =
            Theta::from_rules(&[rule(Quantity::Delay, Sharing::All, &["*_wheel"])], &groups(), &joints())
                .unwrap_err();
        assert!(matches!(error, ThetaError::NoJoint { .. }), "{error}");
        let error =
            Theta::from_rules(&[rule(Quantity::Delay, Sharing::Group, &["*"])], &groups()[..2], &joints())
                .unwrap_err();
        assert!(error.to_string().contains("FL_calf"), "{error}");
    }

    #[test]
    fn a_value_on_a_bound_is_seen() {
        let theta = Theta::from_rules(&ParameterRule::fric_arm(), &groups(), &joints()).unwrap();
        assert!(theta.entries[0].at_bound(0.0) && theta.entries[0].at_bound(0.4999));
        assert!(!theta.entries[0].at_bound(0.01));
    }
}
