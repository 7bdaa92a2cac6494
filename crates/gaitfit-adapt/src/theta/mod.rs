//! θ: what a fit changes in the simulated robot, as named entries with unit, bounds, start and deviation.
//!
//! Each [`Modification`] owns some entries and applies their values to a [`Candidate`]; θ puts any of them together.
//! They are built from rules over joint patterns, so that the same configuration serves robots with other joint
//! counts. A new modification is a file here with its rule, a line in [`Rules`], and, if its numbers are not single
//! ones, a table of its own in [`ThetaFile`].

mod entry;
mod features;
mod file;
mod joint_parameters;
mod modification;
mod networks;
mod robot_numbers;
mod rules;
mod sharing;

pub use entry::Entry;
use file::ReadContext;
pub use file::{SavedNetwork, SavedParameter, ThetaFile, ThetaFileError};
pub use gaitfit_physics::{JointParameter, SearchDefaults as Defaults};
pub use joint_parameters::ParameterRule;
pub use modification::{Found, Modification};
pub use networks::{NetworkName, NetworkRule, NetworkStart};
pub use robot_numbers::{RobotNumber, RobotRule};
pub use rules::Rules;
pub use sharing::Sharing;

use gaitfit_model::patterns::PatternError;
use gaitfit_sim::Candidate;
use std::collections::HashMap;
use std::ops::Range;
use std::sync::Arc;

/// Modifications with their entries in one row; a vector of values runs parallel to the entries.
#[derive(Clone, Debug, Default)]
pub struct Theta {
    modifications: Vec<Arc<dyn Modification>>,
    entries: Vec<Entry>,
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
    /// Bounds reach outside what the parameter can be.
    #[error("parameter `{name}`: {kind} below {least} has no meaning; raise its lower bound {lower}")]
    Meaningless {
        /// Entry.
        name: String,
        /// Parameter.
        kind: &'static str,
        /// Smallest meaningful value.
        least: f64,
        /// The lower bound asked for.
        lower: f64,
    },
    /// Patterns do not fit the robot's joints.
    #[error("parameter {kind}: {source}")]
    Joints {
        /// What is searched.
        kind: &'static str,
        /// Which pattern, and why not.
        source: PatternError,
    },
    /// A joint belongs to no group, or to several.
    #[error(
        "parameter {kind} is per group, and joint `{joint}` is in {found}; every joint it covers needs exactly \
         one group: change [groups], or limit the entry with `joints`"
    )]
    Group {
        /// Parameter.
        kind: &'static str,
        /// Joint.
        joint: String,
        /// The groups found.
        found: String,
    },
    /// Two entries change the same thing, of the same joint if it is a joint's.
    #[error("parameters `{first}` and `{second}` both set {kind}{of}; limit one with `joints`, or remove it")]
    Overlap {
        /// One entry.
        first: String,
        /// The other.
        second: String,
        /// What they change.
        kind: &'static str,
        /// ` of joint …`, or nothing.
        of: String,
    },
    /// A number of a network rule makes no sense.
    #[error(
        "networks {kind}: {what} is {value:e}; scales must be 1e-6 to 1e6, regularisation at least 0 and finite"
    )]
    Network {
        /// What they correct.
        kind: &'static str,
        /// The number.
        what: &'static str,
        /// Its value.
        value: f64,
    },
    /// Rest angles do not fit the joints.
    #[error("networks {kind}: there are {count} rest angles for {joints} joints; needed: one each, finite")]
    Rest {
        /// What they correct.
        kind: &'static str,
        /// Rest angles.
        count: usize,
        /// Joints.
        joints: usize,
    },
    /// Two entries have the same name.
    #[error(
        "two rules give `{0}`; leave one out, limit one to other `joints`, or give a [[parameter]] another `name`"
    )]
    SameName(String),
    /// There is nothing to fit.
    #[error("there is no [[parameter]] to fit; add one, `gaitfit config` shows the kinds")]
    Empty,
}

impl Theta {
    /// Modifications together, in their order.
    ///
    /// # Errors
    /// [`ThetaError::Empty`]; [`ThetaError::SameName`] and [`ThetaError::Overlap`] where two do not go together.
    pub fn new(modifications: Vec<Box<dyn Modification>>) -> Result<Self, ThetaError> {
        let modifications: Vec<Arc<dyn Modification>> = modifications.into_iter().map(Arc::from).collect();
        let entries: Vec<Entry> =
            modifications.iter().flat_map(|one| one.entries().iter().cloned()).collect();
        if entries.is_empty() {
            return Err(ThetaError::Empty);
        }
        let theta = Self { modifications, entries };
        theta.check()?;
        Ok(theta)
    }

    /// θ of joint parameters alone. `groups` are names with joint patterns; `joints` are the robot's joint names.
    ///
    /// # Errors
    /// As [`ParameterRule::modification`] and [`Self::new`].
    pub fn from_rules(
        rules: &[ParameterRule],
        groups: &[(String, Vec<String>)],
        joints: &[String],
    ) -> Result<Self, ThetaError> {
        Self::new(rules.iter().map(|rule| rule.modification(groups, joints)).collect::<Result<_, _>>()?)
    }

    /// Refuses equal names, and two modifications that set the same thing of the same joint.
    fn check(&self) -> Result<(), ThetaError> {
        let mut names: HashMap<&str, ()> = HashMap::new();
        let mut set: HashMap<(&str, &str), (usize, &str)> = HashMap::new();
        for (number, (_, part)) in self.parts().enumerate() {
            for entry in &self.entries[part] {
                let joints = entry.joints.iter().map(String::as_str);
                let whole = entry.joints.is_empty().then_some("");
                for joint in joints.chain(whole) {
                    let (other, first) = *set.entry((entry.kind, joint)).or_insert((number, &entry.name));
                    if other != number && first != entry.name {
                        return Err(ThetaError::Overlap {
                            first: first.to_owned(),
                            second: entry.name.clone(),
                            kind: entry.kind,
                            of: if joint.is_empty() { String::new() } else { format!(" of joint `{joint}`") },
                        });
                    }
                }
                if names.insert(&entry.name, ()).is_some() {
                    return Err(ThetaError::SameName(entry.name.clone()));
                }
            }
        }
        Ok(())
    }

    /// The modifications, each with where its entries are.
    pub fn parts(&self) -> impl Iterator<Item = (&dyn Modification, Range<usize>)> {
        let mut from = 0;
        self.modifications.iter().map(move |modification| {
            let part = from..from + modification.entries().len();
            from = part.end;
            (modification.as_ref(), part)
        })
    }

    /// The entries.
    pub fn entries(&self) -> &[Entry] {
        &self.entries
    }

    /// Number of entries.
    pub fn len(&self) -> usize {
        self.entries.len()
    }

    /// Whether there are no entries: the robot as its file says.
    pub fn is_empty(&self) -> bool {
        self.entries.is_empty()
    }

    /// The first mean of the search of a run with `seed`, one value an entry.
    pub fn start(&self, seed: u64) -> Vec<f64> {
        self.modifications.iter().flat_map(|modification| modification.start(seed)).collect()
    }

    /// Largest value any entry of `parameter` may take; `None` without such an entry.
    pub fn largest(&self, parameter: JointParameter) -> Option<f64> {
        let bounds = self.entries.iter().filter(|entry| entry.kind == parameter.name());
        bounds.map(|entry| entry.upper).reduce(f64::max)
    }

    /// What is added to every cost for the size of the values.
    pub fn regularisation(&self, values: &[f64]) -> f64 {
        self.parts()
            .filter_map(|(modification, part)| Some(modification.regularisation(values.get(part)?)))
            .sum()
    }

    /// Applies `values`, one an entry, to `candidate`, whose joints are `joints` in this order. What θ does not name
    /// stays.
    pub fn apply(&self, values: &[f64], joints: &[String], candidate: &mut Candidate) {
        for (modification, part) in self.parts() {
            if let Some(values) = values.get(part) {
                modification.apply(values, joints, candidate);
            }
        }
    }
}

#[cfg(test)]
#[allow(clippy::unwrap_used, reason = "a failed unwrap is a failed test")]
mod tests {
    use super::*;

    /// A robot of `joints` joints on which nothing is set.
    fn tests_candidate(joints: usize) -> Candidate {
        let body = |joint| {
            format!(
                "<body><inertial pos='0 0 0' mass='1' diaginertia='1 1 1'/><joint name='{joint}' axis='0 0 1'/>"
            )
        };
        let bodies: String = (0..joints).map(body).chain((0..joints).map(|_| "</body>".to_owned())).collect();
        let text = format!("<mujoco><worldbody>{bodies}</worldbody></mujoco>");
        Candidate::nominal(&gaitfit_model::read_mjcf_str(&text, &Default::default()).unwrap())
    }

    fn joints() -> Vec<String> {
        ["FL", "FR"]
            .iter()
            .flat_map(|leg| ["hip", "thigh", "calf"].map(|part| format!("{leg}_{part}")))
            .collect()
    }

    fn groups() -> Vec<(String, Vec<String>)> {
        ["hip", "thigh", "calf"].map(|name| (name.to_owned(), vec![format!("*_{name}")])).to_vec()
    }

    fn rule(kind: JointParameter, per: Sharing, patterns: &[&str]) -> ParameterRule {
        ParameterRule {
            per,
            joints: patterns.iter().map(|&pattern| pattern.to_owned()).collect(),
            ..ParameterRule::new(kind)
        }
    }

    #[test]
    fn fric_arm_has_six_numbers_with_the_papers_bounds() {
        let theta = Theta::from_rules(&ParameterRule::fric_arm(), &groups(), &joints()).unwrap();
        let names: Vec<_> = theta.entries().iter().map(|entry| entry.name.as_str()).collect();
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
        let hip = &theta.entries()[0];
        assert_eq!((hip.lower, hip.upper, hip.start, hip.deviation), (0.0, 0.5, 0.0, 0.1));
        assert_eq!(hip.joints, ["FL_hip", "FR_hip"]);
        assert_eq!(theta.entries()[3].deviation, 0.05);
    }

    #[test]
    fn one_value_for_all_one_for_each_and_one_for_a_pattern() {
        let rules = [
            rule(JointParameter::Delay, Sharing::All, &["*"]),
            rule(JointParameter::EncoderBias, Sharing::Joint, &["*_calf"]),
            rule(JointParameter::Damping, Sharing::All, &["*_hip"]),
        ];
        let theta = Theta::from_rules(&rules, &groups(), &joints()).unwrap();
        let names: Vec<_> = theta.entries().iter().map(|entry| entry.name.as_str()).collect();
        assert_eq!(names, ["delay", "encoder_bias_FL_calf", "encoder_bias_FR_calf", "damping_hip"]);
        assert_eq!(theta.largest(JointParameter::Delay), Some(0.1));

        let mut candidate = tests_candidate(6);
        theta.apply(&[0.01, 0.02, 0.03, 0.04], &joints(), &mut candidate);
        assert_eq!(candidate.robot.encoder_bias, [0.0, 0.0, 0.02, 0.0, 0.0, 0.03]);
        assert_eq!(candidate.robot.delay, [0.01; 6]);
        assert_eq!(candidate.robot.damping, [0.04, 0.0, 0.0, 0.04, 0.0, 0.0]);
    }

    #[test]
    fn patterns_and_names_leave_out_a_final_joint() {
        let joints = ["FL_hip_joint".to_owned(), "FL_calf_joint".to_owned()];
        let rules = [rule(JointParameter::Delay, Sharing::Joint, &["*_hip"])];
        let theta = Theta::from_rules(&rules, &groups(), &joints).unwrap();
        assert_eq!(theta.entries()[0].name, "delay_FL_hip");
        assert_eq!(theta.entries()[0].joints, ["FL_hip_joint"]);
    }

    #[test]
    fn a_bound_below_its_start_is_refused_by_name() {
        let mut low = rule(JointParameter::Armature, Sharing::Group, &["*"]);
        low.upper = Some(0.1);
        low.start = Some(0.2);
        let error = Theta::from_rules(&[low], &groups(), &joints()).unwrap_err();
        assert!(error.to_string().contains("armature_hip"), "{error}");
        let mut negative = rule(JointParameter::Armature, Sharing::Group, &["*"]);
        negative.lower = Some(-0.1);
        let error = Theta::from_rules(&[negative], &groups(), &joints()).unwrap_err();
        assert!(matches!(error, ThetaError::Meaningless { .. }), "{error}");
    }

    #[test]
    fn overlapping_unmatched_and_ungrouped_joints_are_refused() {
        let twice = [
            rule(JointParameter::Delay, Sharing::All, &["*"]),
            ParameterRule {
                name: Some("late".into()),
                ..rule(JointParameter::Delay, Sharing::All, &["*_hip"])
            },
        ];
        let error = Theta::from_rules(&twice, &groups(), &joints()).unwrap_err();
        assert!(matches!(error, ThetaError::Overlap { .. }), "{error}");
        let error = Theta::from_rules(
            &[rule(JointParameter::Delay, Sharing::All, &["*_wheel"])],
            &groups(),
            &joints(),
        )
        .unwrap_err();
        assert!(matches!(error, ThetaError::Joints { .. }), "{error}");
        let error = Theta::from_rules(
            &[rule(JointParameter::Delay, Sharing::Group, &["*"])],
            &groups()[..2],
            &joints(),
        )
        .unwrap_err();
        assert!(error.to_string().contains("FL_calf"), "{error}");
    }

    #[test]
    fn everything_combines_and_clashes_are_named() {
        let rest = [0.1, 0.8, -1.5, -0.1, 0.8, -1.5];
        let spring =
            NetworkRule { joints: vec!["FR_calf".into()], ..NetworkRule::new(NetworkName::ResidAct) };
        let delta =
            NetworkRule { joints: vec!["*_calf".into()], ..NetworkRule::new(NetworkName::ActionDelta) };
        let mut rules = Rules {
            parameter: ParameterRule::fric_arm(),
            network: vec![spring, delta],
            robot: vec![RobotRule::new(RobotNumber::TorqueNoise), RobotRule::new(RobotNumber::BaseComY)],
        };
        let theta = rules.theta(&groups(), &joints(), &rest).unwrap();
        assert_eq!(theta.len(), 6 + 3 * 97 + 2);
        assert_eq!(theta.entries()[6].name, "resid_act_FR_calf_0");
        assert_eq!(theta.entries()[6 + 97 + 96].name, "action_delta_FL_calf_96");
        let values: Vec<f64> = (0..theta.len()).map(|index| 0.001 * index as f64).collect();
        let mut candidate = tests_candidate(6);
        theta.apply(&values, &joints(), &mut candidate);
        assert_eq!(candidate.robot.armature[5], 0.005);
        assert_eq!(
            (candidate.networks[0].joints.as_slice(), candidate.networks[0].rest[0]),
            (&[5][..], -1.5)
        );
        assert_eq!(candidate.networks[0].weights, values[6..6 + 97]);
        assert_eq!(candidate.networks[1].joints, [2, 5]);
        assert_eq!(candidate.networks[1].weights, values[6 + 97..6 + 3 * 97]);
        assert_eq!((candidate.torque_noise, candidate.robot.base_com[1]), (values[297], values[298]));

        rules.robot.push(RobotRule::new(RobotNumber::TorqueNoise));
        let error = rules.theta(&groups(), &joints(), &rest).unwrap_err();
        assert_eq!(error, ThetaError::SameName("torque_noise".into()));
        rules.robot.pop();
        rules.network.push(NetworkRule::new(NetworkName::ResidAct));
        let error = rules.theta(&groups(), &joints(), &rest).unwrap_err();
        assert!(error.to_string().contains("resid_act"), "{error}");
        let error = rules.theta(&groups(), &joints(), &rest[..3]).unwrap_err();
        assert!(matches!(error, ThetaError::Rest { count: 3, joints: 6, .. }), "{error}");
        rules.network[2].output_scale = 0.0;
        let error = rules.theta(&groups(), &joints(), &rest).unwrap_err();
        assert!(error.to_string().contains("output_scale"), "{error}");
    }

    #[test]
    fn networks_start_at_no_output_and_only_the_last_layer_is_regularised() {
        let rest = [0.0; 6];
        let rule = NetworkRule {
            start: NetworkStart::Random,
            regularisation: 2.0,
            ..NetworkRule::new(NetworkName::ResidAct)
        };
        let theta = Theta::new(vec![rule.modification(&[], &joints(), &rest).unwrap()]).unwrap();
        let (one, two) = (theta.start(1), theta.start(2));
        assert_eq!(one, theta.start(1));
        assert_ne!(one, two);
        for (index, network) in one.chunks_exact(97).enumerate() {
            let (hidden, last) = network.split_at(92);
            assert!(hidden.iter().all(|weight| weight.abs() <= 1.0 && *weight != 0.0), "{index}");
            assert_eq!(last, [0.0; 5]);
        }
        assert_ne!(one[..97], one[97..194], "joints differ");
        assert_eq!(theta.regularisation(&one), 0.0);
        let mut values = one;
        values[92..97].copy_from_slice(&[0.1, 0.2, 0.0, -0.2, 0.4]);
        assert!((theta.regularisation(&values) - 2.0 * 0.25 / 6.0).abs() < 1e-15);
        let zero = NetworkRule::new(NetworkName::ResidAct).modification(&[], &joints(), &rest).unwrap();
        assert_eq!(Theta::new(vec![zero]).unwrap().start(1), vec![0.0; 582]);
    }

    #[test]
    fn of_features_only_the_last_layer_is_searched_and_whole_networks_are_simulated_and_saved() {
        let rule = NetworkRule {
            start: NetworkStart::Features,
            per: Sharing::Group,
            regularisation: 2.0,
            ..NetworkRule::new(NetworkName::ResidAct)
        };
        let theta = Theta::new(vec![rule.modification(&groups(), &joints(), &[0.0; 6]).unwrap()]).unwrap();
        let names: Vec<&str> = theta.entries().iter().map(|entry| entry.name.as_str()).collect();
        assert_eq!(names.len(), 3 * 5);
        assert_eq!(names[..2], ["resid_act_hip_friction", "resid_act_hip_damping"]);
        assert_eq!(theta.start(7), [0.0; 15]);
        let mut values = vec![0.0; 15];
        values[5..10].copy_from_slice(&[0.1, 0.2, 0.0, -0.2, 0.4]);
        assert!((theta.regularisation(&values) - 2.0 * 0.25 / 3.0).abs() < 1e-15);

        let mut candidate = tests_candidate(6);
        theta.apply(&values, &joints(), &mut candidate);
        let networks = &candidate.networks[0];
        let thigh = networks.joints.iter().position(|&joint| joints()[joint] == "FL_thigh").unwrap();
        let weights = networks.weights.chunks_exact(97).nth(thigh).unwrap();
        assert_eq!(weights[92..96], values[5..9]);
        assert!(weights[..92].iter().any(|weight| *weight != 0.0));
        let found: Vec<Found> = values.iter().map(|&value| Found { value, spread: None }).collect();
        let saved = ThetaFile::new(&theta, &found, "legs", "wass", 0.1);
        let of_thigh = saved.network.iter().find(|network| network.joint == "FL_thigh").unwrap();
        assert_eq!(of_thigh.weights, weights);
    }

    #[test]
    fn a_network_that_a_group_shares_acts_on_each_of_its_joints() {
        let rest = [0.1, 0.8, -1.5, -0.1, 0.8, -1.4];
        let rule = NetworkRule {
            per: Sharing::Group,
            joints: vec!["*_hip".into(), "*_calf".into()],
            regularisation: 1.0,
            ..NetworkRule::new(NetworkName::ActionDelta)
        };
        let theta = Theta::new(vec![rule.modification(&groups(), &joints(), &rest).unwrap()]).unwrap();
        assert_eq!(theta.len(), 2 * 97);
        assert_eq!(theta.entries()[97].name, "action_delta_calf_0");
        assert_eq!(theta.entries()[97].joints, ["FL_calf", "FR_calf"]);
        let values: Vec<f64> = (0..theta.len()).map(|index| 0.001 * index as f64).collect();
        let mut candidate = tests_candidate(6);
        theta.apply(&values, &joints(), &mut candidate);
        let networks = &candidate.networks[0];
        assert_eq!(
            (networks.joints.as_slice(), networks.rest.as_slice()),
            (&[0, 3, 2, 5][..], &[0.1, -0.1, -1.5, -1.4][..])
        );
        for (network, weights) in networks.weights.chunks_exact(97).enumerate() {
            assert_eq!(weights, &values[97 * (network / 2)..][..97]);
        }
        let last: f64 =
            [92..97, 189..194].into_iter().flatten().map(|at: usize| values[at] * values[at]).sum();
        assert!((theta.regularisation(&values) - last / 2.0).abs() < 1e-15);
        // One for all joints is called after them, so that two such rules go together.
        let all = |joint: &str| {
            let rule = NetworkRule { per: Sharing::All, joints: vec![joint.into()], ..rule.clone() };
            rule.modification(&groups(), &joints(), &rest).unwrap()
        };
        let theta = Theta::new(vec![all("*_hip"), all("*_calf")]).unwrap();
        assert_eq!(theta.len(), 2 * 97);
        assert_eq!(theta.entries()[97].name, "action_delta_calf_0");
        let error = rule.modification(&groups()[..2], &joints(), &rest).unwrap_err();
        assert!(matches!(error, ThetaError::Group { .. }), "{error}");
    }

    #[test]
    fn a_value_on_a_bound_is_seen() {
        let theta = Theta::from_rules(&ParameterRule::fric_arm(), &groups(), &joints()).unwrap();
        assert!(theta.entries()[0].at_bound(0.0) && theta.entries()[0].at_bound(0.4999));
        assert!(!theta.entries()[0].at_bound(0.01));
    }
}
