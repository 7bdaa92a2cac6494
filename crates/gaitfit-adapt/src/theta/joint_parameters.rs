//! Parameters of joints: friction loss, armature, delay and the like.

use super::read_context::ReadContext;
use super::saved::MAX_VALUE;
use super::sharing::Share;
use super::{
    Defaults, Entry, JointParameter, LinearSpring, Modification, SavedParameter, Sharing, ThetaError,
    ThetaFileError,
};
use gaitfit_model::patterns::covered;
use gaitfit_model::{Joint, JointKind, Model};
use gaitfit_sim::Candidate;
use serde::{Deserialize, Serialize};

/// Every joint: what a rule that is silent covers.
pub(super) fn every_joint() -> Vec<String> {
    vec!["*".to_owned()]
}

/// Longest delay that the engine simulates, s.
const LONGEST_DELAY: f64 = 1.0;

/// A rule: a parameter, the joints it covers, and what it takes instead of the parameter's defaults.
#[derive(Clone, Debug, PartialEq, Serialize, Deserialize)]
#[serde(deny_unknown_fields)]
pub struct ParameterRule {
    /// Parameter.
    pub kind: JointParameter,
    /// How many joints share a value.
    #[serde(default)]
    pub per: Sharing,
    /// Patterns over joint names, with or without a final `_joint`; a joint is covered when any matches.
    #[serde(default = "every_joint")]
    pub joints: Vec<String>,
    /// Name of the entry, or its first part where there are several.
    #[serde(default, skip_serializing_if = "Option::is_none")]
    pub name: Option<String>,
    /// Lower bound.
    #[serde(default, skip_serializing_if = "Option::is_none")]
    pub lower: Option<f64>,
    /// Upper bound.
    #[serde(default, skip_serializing_if = "Option::is_none")]
    pub upper: Option<f64>,
    /// First mean.
    #[serde(default, skip_serializing_if = "Option::is_none")]
    pub start: Option<f64>,
    /// First standard deviation.
    #[serde(default, skip_serializing_if = "Option::is_none")]
    pub deviation: Option<f64>,
    /// Whether the joints are hinges or slides, which sets the unit and the defaults: see [`Self::by_kind`].
    #[serde(skip)]
    pub joint_kind: JointKind,
}

impl ParameterRule {
    /// A rule over all joints with the parameter's defaults, one value a group.
    pub fn new(kind: JointParameter) -> Self {
        Self {
            kind,
            per: Sharing::Group,
            joints: every_joint(),
            name: None,
            lower: None,
            upper: None,
            start: None,
            deviation: None,
            joint_kind: JointKind::Hinge,
        }
    }

    /// FricArm: friction loss and armature of every group (Dao and Fern).
    pub fn fric_arm() -> Vec<Self> {
        vec![Self::new(JointParameter::FrictionLoss), Self::new(JointParameter::Armature)]
    }

    /// Splits the rule into one for hinges and one for slides, because their units differ. With `scales` the rule's numbers are
    /// for hinges, and slides get the corresponding ones ([`JointKind::like`]).
    ///
    /// # Errors
    /// Patterns that do not fit; one value, or numbers, for joints of both kinds; gears in a robot with slides.
    pub fn by_kind(&self, model: &Model, scales: bool) -> Result<Vec<Self>, ThetaError> {
        let unit = self.kind.unit();
        // Where both kinds have the same unit, one rule is enough.
        if JointKind::Slide.unit(unit) == unit || !model.has_slides() {
            return Ok(vec![self.clone()]);
        }
        if matches!(self.kind, JointParameter::Play | JointParameter::Compliance) {
            return Err(ThetaError::SlidingGears { kind: self.kind.name() });
        }
        let names: Vec<&str> = model.joints.iter().map(|joint| joint.name.as_str()).collect();
        let wrong = |source| ThetaError::Joints { kind: self.kind.name(), source };
        let places = covered(&self.joints, &model.name, &names).map_err(wrong)?;
        let (hinges, slides): (Vec<&Joint>, Vec<&Joint>) =
            places.into_iter().map(|place| &model.joints[place]).partition(|joint| joint.kind.is_hinge());
        let rule_for = |joints: &[&Joint], joint_kind: JointKind| {
            let number = |value: Option<f64>| {
                value.map(|value| if scales { joint_kind.like(unit, value) } else { value })
            };
            // Names replace the patterns, because a pattern may cover both kinds.
            Self {
                joints: joints.iter().map(|joint| joint.name.clone()).collect(),
                joint_kind,
                lower: number(self.lower),
                upper: number(self.upper),
                start: number(self.start),
                deviation: number(self.deviation),
                ..self.clone()
            }
        };
        let numbers = [self.lower, self.upper, self.start, self.deviation];
        // A shared value, or numbers in the unit of one kind, cannot be those of both.
        let one = self.per == Sharing::All || (!scales && numbers.iter().any(Option::is_some));
        match (hinges.first(), slides.first()) {
            (Some(hinge), Some(slide)) if one => Err(ThetaError::Kinds {
                kind: self.kind.name(),
                hinge: hinge.name.clone(),
                slide: slide.name.clone(),
            }),
            (Some(_), Some(_)) => {
                Ok(vec![rule_for(&hinges, JointKind::Hinge), rule_for(&slides, JointKind::Slide)])
            }
            (None, Some(_)) => {
                // The patterns cover no hinge, so they stay.
                let joints = self.joints.clone();
                Ok(vec![Self { joints, ..rule_for(&slides, JointKind::Slide) }])
            }
            // Hinges alone: the rule already has their unit.
            _ => Ok(vec![self.clone()]),
        }
    }

    /// Fills in the parameter's defaults where the rule is silent.
    pub fn resolve(&mut self) {
        let defaults = defaults(self.kind, self.joint_kind);
        self.lower.get_or_insert(defaults.lower);
        self.upper.get_or_insert(defaults.upper);
        self.start.get_or_insert(defaults.start);
        self.deviation.get_or_insert(defaults.deviation);
    }

    /// The modification for a robot with these `joints`; `groups` are names with joint patterns.
    ///
    /// # Errors
    /// [`ThetaError`] if patterns or numbers do not fit.
    pub fn modification(
        &self,
        groups: &[(String, Vec<String>)],
        joints: &[String],
    ) -> Result<Box<dyn Modification>, ThetaError> {
        let entries = self.entries(groups, joints)?;
        for entry in &entries {
            entry.check(self.kind.least(), upper_limit(self.kind))?;
        }
        Ok(Box::new(JointParameters { parameter: self.kind, joint_kind: self.joint_kind, entries }))
    }

    /// The rule's entries for a robot, groups in the order of their first joint.
    fn entries(&self, groups: &[(String, Vec<String>)], joints: &[String]) -> Result<Vec<Entry>, ThetaError> {
        let kind = self.kind.name();
        let shares = self.per.shares(kind, &self.joints, groups, joints)?;
        let named = |share: &Share<'_>| match &self.name {
            // The only entry takes the name as it is.
            Some(name) if self.per == Sharing::All => name.clone(),
            name => share.named(name.as_deref().unwrap_or(kind)),
        };
        Ok(shares.into_iter().map(|share| self.entry(named(&share), share.joints)).collect())
    }

    fn entry(&self, name: String, joints: Vec<&String>) -> Entry {
        let defaults = defaults(self.kind, self.joint_kind);
        Entry {
            name,
            kind: self.kind.name(),
            unit: self.joint_kind.unit(self.kind.unit()).to_owned(),
            joints: joints.into_iter().cloned().collect(),
            lower: self.lower.unwrap_or(defaults.lower),
            upper: self.upper.unwrap_or(defaults.upper),
            start: self.start.unwrap_or(defaults.start),
            deviation: self.deviation.unwrap_or(defaults.deviation),
        }
    }
}

/// The values that a search takes if a rule does not state them. A parameter without it is not read from files, and a rule of it gets
/// bounds that are refused.
fn defaults(parameter: JointParameter, kind: JointKind) -> Defaults {
    let none = Defaults { lower: f64::NAN, upper: f64::NAN, start: f64::NAN, deviation: f64::NAN };
    parameter.search_of(kind).unwrap_or(none)
}

/// Largest value of a parameter.
fn upper_limit(parameter: JointParameter) -> f64 {
    if parameter == JointParameter::Delay { LONGEST_DELAY } else { MAX_VALUE }
}

/// One parameter of some joints.
#[derive(Debug)]
struct JointParameters {
    parameter: JointParameter,
    joint_kind: JointKind,
    entries: Vec<Entry>,
}

impl Modification for JointParameters {
    fn entries(&self) -> &[Entry] {
        &self.entries
    }

    fn springs(&self, values: &[f64]) -> Vec<LinearSpring> {
        // A stiffness pulls towards angle 0; a torque is a spring without stiffness.
        let spring = |value: f64| match self.parameter {
            JointParameter::Stiffness => Some((value, 0.0)),
            JointParameter::SpringTorque => Some((0.0, value)),
            _ => None,
        };
        let entry = |(entry, value): (&Entry, &f64)| {
            let (stiffness, torque) = spring(*value)?;
            let kind = self.joint_kind;
            let joints = entry.joints.iter().cloned();
            Some(joints.map(move |joint| LinearSpring { joint, kind, stiffness, torque }).collect::<Vec<_>>())
        };
        self.entries.iter().zip(values).filter_map(entry).flatten().collect()
    }

    fn apply(&self, values: &[f64], joints: &[String], candidate: &mut Candidate) {
        let of_joints = candidate.robot.joints_mut(self.parameter);
        for (entry, &value) in self.entries.iter().zip(values) {
            for name in &entry.joints {
                if let Some(joint) = joints.iter().position(|joint| joint == name) {
                    of_joints[joint] = value;
                }
            }
        }
    }
}

/// Applies a parameter of a file, if its kind is a joint's.
pub(super) fn read(
    parameter: &SavedParameter,
    context: &ReadContext<'_>,
    candidate: &mut Candidate,
) -> Option<Result<(), ThetaFileError>> {
    // A file may hold only parameters that a fit can search.
    let kind = JointParameter::searched().find(|one| one.name() == parameter.kind)?;
    Some(context.check(parameter, kind.least(), upper_limit(kind)).and_then(|()| {
        if parameter.joints.is_empty() {
            return Err(ThetaFileError::NoJoints { name: parameter.name.clone() });
        }
        for name in &parameter.joints {
            candidate.robot.joints_mut(kind)[context.joint(name)?] = parameter.value;
        }
        Ok(())
    }))
}
