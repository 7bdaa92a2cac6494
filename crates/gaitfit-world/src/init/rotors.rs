//! Rotor inertia of robots whose file gives none.

use super::anatomy::Anatomy;
use super::sizes::{Sizes, tidy};
use gaitfit_model::Model;

/// Largest rotor inertia over m l². It gives the built-in Go2's 0.01 kg·m².
const LARGEST: f64 = 0.0073;
/// The largest over the smallest in training. Motors of humanoids have rotors that are smaller for their size.
const SPREAD: f64 = 3.0;
const BIPED_SPREAD: f64 = 10.0;

/// A guess at the rotor inertia of every joint, kg·m².
#[derive(Clone, Copy, Debug, PartialEq)]
pub struct Rotors {
    /// Rotor inertia of the nominal robot, kg·m².
    pub smallest: f64,
    /// Largest rotor inertia in training, kg·m².
    pub largest: f64,
    /// Whether the robot's file has the smallest already, because `init` wrote it there.
    pub in_file: bool,
}

impl Rotors {
    /// A guess by the robot's size; `None` if a joint of the legs has a rotor in the file.
    pub fn guess(model: &Model, anatomy: &Anatomy, sizes: &Sizes) -> Option<Self> {
        // One rotor in the file shows that its author knew them, so the others are meant to be without.
        let bare = anatomy.moved.iter().all(|&joint| model.joints[joint].armature == 0.0);
        bare.then(|| {
            let largest = LARGEST * sizes.mass * sizes.leg * sizes.leg;
            let spread = if anatomy.biped() { BIPED_SPREAD } else { SPREAD };
            Self { smallest: tidy(largest / spread), largest: tidy(largest), in_file: false }
        })
    }

    /// Gives every joint with a motor the smallest rotor.
    pub fn write(&mut self, model: &mut Model) {
        let Model { joints, actuators, .. } = model;
        for (index, joint) in joints.iter_mut().enumerate() {
            // In a file without actuators every joint counts as one with a motor.
            if actuators.is_empty() || actuators.iter().any(|actuator| actuator.joint == index) {
                joint.armature = joint.armature.max(joint.kind.like("kg·m²", self.smallest));
            }
        }
        self.in_file = true;
    }

    /// Range of rotor inertia that the training adds to what the file has, kg·m².
    pub fn added(&self) -> [f64; 2] {
        // The training adds to what the file has, and that is the smallest already.
        if self.in_file { [0.0, tidy(self.largest - self.smallest)] } else { [self.smallest, self.largest] }
    }

    /// Smallest rotor inertia that is added to what the file has, kg·m²: no robot of the training has less.
    pub fn unwritten(&self) -> f64 {
        if self.in_file { 0.0 } else { self.smallest }
    }
}
