//! The interface of every change of the simulated robot.

use super::{Entry, SavedParameter, ThetaFile};
use gaitfit_model::JointKind;
use gaitfit_sim::Candidate;
use std::fmt::Debug;

/// A value of an entry as a fit found it.
#[derive(Clone, Copy, Debug, Default, PartialEq)]
pub struct Found {
    /// The value.
    pub value: f64,
    /// Standard deviation over seeds, where there are several.
    pub spread: Option<f64>,
}

/// A torque −stiffness · angle + torque on a joint. Of a slide a force, in N and m.
#[derive(Clone, Debug, PartialEq)]
pub struct LinearSpring {
    /// Joint name.
    pub joint: String,
    /// Whether it turns or slides.
    pub kind: JointKind,
    /// N·m/rad.
    pub stiffness: f64,
    /// Torque at angle 0, N·m.
    pub torque: f64,
}

impl LinearSpring {
    /// Angle without torque, rad.
    pub fn rest(&self) -> f64 {
        self.torque / self.stiffness
    }
}

/// A change of the simulated robot by some numbers: one file of this folder each. [`super::Theta`] combines them.
pub trait Modification: Debug + Send + Sync {
    /// Its numbers.
    fn entries(&self) -> &[Entry];

    /// Applies `values`, one an entry, to `candidate`; `joints` are the robot's joint names, in the candidate's
    /// order. Joints that `joints` lacks are passed over.
    fn apply(&self, values: &[f64], joints: &[String], candidate: &mut Candidate);

    /// First mean of the search of a run with `seed`, one value an entry.
    fn start(&self, _seed: u64) -> Vec<f64> {
        self.entries().iter().map(|entry| entry.start).collect()
    }

    /// The amount that the size of the values adds to every cost.
    fn regularisation(&self, _values: &[f64]) -> f64 {
        0.0
    }

    /// The linear springs on joints that `values` describe, one value for each entry; by default none.
    fn springs(&self, _values: &[f64]) -> Vec<LinearSpring> {
        Vec::new()
    }

    /// Writes the result, one for each entry, into a file that [`ThetaFile::candidate`] reads.
    fn save(&self, estimates: &[Found], file: &mut ThetaFile) {
        file.parameter.extend(self.entries().iter().zip(estimates).map(|(entry, estimate)| SavedParameter {
            name: entry.name.clone(),
            kind: entry.kind.to_owned(),
            joints: entry.joints.clone(),
            value: estimate.value,
            unit: entry.unit.clone(),
            spread: estimate.spread,
            lower: Some(entry.lower),
            upper: Some(entry.upper),
            at_bound: Some(entry.at_bound(estimate.value)),
            interval: None,
            identified: None,
        }));
    }
}
