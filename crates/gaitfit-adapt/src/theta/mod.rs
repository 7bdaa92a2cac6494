//! θ: what a fit changes in the simulated robot, as named entries with unit, bounds, start and deviation.
//!
//! Each [`Modification`] owns some entries and applies their values to a [`Candidate`]; θ puts any of them together.
//! They are built from rules over joint patterns, so that the same configuration serves robots with other joint
//! counts. A new modification is a file here with its rule, a line in [`Rules`], and, if its numbers are not single
//! ones, a table of its own in [`ThetaFile`].

mod checksum;
mod entry;
mod features;
mod file;
mod file_error;
mod joint_parameters;
mod modification;
mod network_kind;
mod networks;
mod prior;
mod read_context;
mod robot_numbers;
mod rules;
mod saved;
mod sharing;

pub use entry::Entry;
pub use file::MAX_REASON;
pub use file_error::ThetaFileError;
use file_error::short;
pub use gaitfit_physics::{JointParameter, SearchDefaults as Defaults};
pub use joint_parameters::ParameterRule;
pub use modification::{Found, LinearSpring, Modification};
pub use network_kind::{NETWORK_LAYERS, NetworkName};
pub use networks::{NetworkRule, NetworkStart};
pub use prior::Prior;
pub use robot_numbers::{RobotNumber, RobotRule};
pub use rules::Rules;
pub use saved::{SavedNetwork, SavedParameter, ThetaFile};
pub use sharing::Sharing;

use gaitfit_model::patterns::PatternError;
use gaitfit_model::{shown, shown_number};
use gaitfit_sim::Candidate;
use std::collections::{HashMap, HashSet};
use std::ops::Range;
use std::sync::Arc;

/// Modifications with their entries in one row; a vector of values runs parallel to the entries.
#[derive(Clone, Debug, Default)]
pub struct Theta {
    modifications: Vec<Arc<dyn Modification>>,
    entries: Vec<Entry>,
    /// The prior of each entry; empty without priors.
    priors: Vec<Option<Prior>>,
    /// For each entry, the index of the entry that is the strength of its motors.
    strengths: Vec<Option<usize>>,
    /// The same with [`Theta::load`].
    loads: Vec<Option<usize>>,
    /// Cost of a distance of one standard error from a prior.
    prior_weight: f64,
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
    #[error("parameter `{name}`: {kind} below {min} has no meaning; raise its lower bound {lower}")]
    Meaningless {
        /// Entry.
        name: String,
        /// Parameter.
        kind: &'static str,
        /// Smallest meaningful value.
        min: f64,
        /// The lower bound asked for.
        lower: f64,
    },
    /// Bounds reach beyond what a theta.toml can say, or what can be simulated.
    #[error(
        "parameter `{name}`: its bounds {} to {} reach beyond {}; bring them nearer to what it can be",
        shown_number(*lower),
        shown_number(*upper),
        short(*max)
    )]
    Wide {
        /// Entry.
        name: String,
        /// Lower bound.
        lower: f64,
        /// Upper bound.
        upper: f64,
        /// Largest value.
        max: f64,
    },
    /// Patterns do not fit the robot's joints.
    #[error("parameter {kind}: {source}")]
    Joints {
        /// The searched parameter.
        kind: &'static str,
        /// The pattern, and what is wrong with it.
        source: PatternError,
    },
    /// One value, or bounds, for hinges and slides, whose units differ.
    #[error(
        "parameter {kind} has one value or the same numbers for hinge `{hinge}` and slide `{slide}`, whose units differ; write a rule for each, with \
         `joints`"
    )]
    Kinds {
        /// Parameter.
        kind: &'static str,
        /// A hinge that it covers.
        hinge: String,
        /// A slide that it covers.
        slide: String,
    },
    /// Gears in a robot with slides.
    #[error(
        "{kind} is a parameter of gears. Gears are simulated only in robots without slides, and this robot has slides; leave {kind} out"
    )]
    SlidingGears {
        /// Parameter.
        kind: &'static str,
    },
    /// A network of a slide.
    #[error("networks correct hinges, and joint `{joint}` slides; leave it out of the rule's `joints`")]
    SlidingNetwork {
        /// The slide.
        joint: String,
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
        /// The quantity that both change.
        kind: &'static str,
        /// ` of joint …`, or nothing.
        of: String,
    },
    /// A number of a network rule makes no sense.
    #[error(
        "networks {kind}: {what} is {value:e}; scales must be 1e-6 to 1e6, regularisation at least 0 and finite"
    )]
    Network {
        /// Kind of the networks.
        kind: &'static str,
        /// The number.
        what: &'static str,
        /// Its value.
        value: f64,
    },
    /// Rest angles do not fit the joints.
    #[error("networks {kind}: there are {count} rest angles for {joints} joints; needed: one each, finite")]
    Rest {
        /// Kind of the networks.
        kind: &'static str,
        /// Rest angles.
        count: usize,
        /// Joints.
        joints: usize,
    },
    /// The prior of an entry cannot be used.
    #[error("the prior of `{}` {why}", shown(name))]
    Prior {
        /// The name it was given for.
        name: String,
        /// What is wrong, in words that follow the name.
        why: String,
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
        let theta = Self {
            modifications,
            entries,
            priors: Vec::new(),
            strengths: Vec::new(),
            loads: Vec::new(),
            prior_weight: 0.0,
        };
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
        let mut names: HashSet<&str> = HashSet::new();
        // Owner and first entry of each pair of kind and joint; "" stands for the whole robot.
        let mut set: HashMap<(&str, &str), (usize, &str)> = HashMap::new();
        for (number, (_, part)) in self.parts().enumerate() {
            for entry in &self.entries[part] {
                let joints = entry.joints.iter().map(String::as_str);
                let whole = entry.joints.is_empty().then_some("");
                for joint in joints.chain(whole) {
                    let (other, first) = *set.entry((entry.kind, joint)).or_insert((number, &entry.name));
                    // Entries of one modification may share a joint: a network has many weights for one.
                    // Equal names get an error of their own below.
                    if other != number && first != entry.name {
                        return Err(ThetaError::Overlap {
                            first: first.to_owned(),
                            second: entry.name.clone(),
                            kind: entry.kind,
                            of: if joint.is_empty() { String::new() } else { format!(" of joint `{joint}`") },
                        });
                    }
                }
                if !names.insert(&entry.name) {
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
        let starts = self.modifications.iter().flat_map(|modification| modification.start(seed));
        // An entry with a prior starts at it, whatever its modification would draw.
        let known = |at: usize| self.prior(at).map(|_| self.entries[at].start);
        starts.enumerate().map(|(at, start)| known(at).unwrap_or(start)).collect()
    }

    /// Largest value any entry of `parameter` may take; `None` without such an entry.
    pub fn largest(&self, parameter: JointParameter) -> Option<f64> {
        let bounds = self.entries.iter().filter(|entry| entry.kind == parameter.name());
        bounds.map(|entry| entry.upper).reduce(f64::max)
    }

    /// The amount that the size of the values adds to every cost.
    pub fn regularisation(&self, values: &[f64]) -> f64 {
        self.parts()
            .filter_map(|(modification, part)| Some(modification.regularisation(values.get(part)?)))
            .sum()
    }

    /// The springs that `values`, one an entry, put on joints: one a joint, in the order of the entries.
    pub fn springs(&self, values: &[f64]) -> Vec<LinearSpring> {
        let mut springs: Vec<LinearSpring> = Vec::new();
        for (modification, part) in self.parts() {
            for one in values.get(part).map(|values| modification.springs(values)).unwrap_or_default() {
                match springs.iter_mut().find(|spring| spring.joint == one.joint) {
                    Some(spring) => {
                        // Springs on one joint act side by side, so their torques add up.
                        spring.stiffness += one.stiffness;
                        spring.torque += one.torque;
                    }
                    None => springs.push(one),
                }
            }
        }
        springs
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
mod theta_test;
