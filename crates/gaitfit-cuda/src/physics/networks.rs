//! Networks on joints as the threads of an environment share them.

use gaitfit_model::Model;
use gaitfit_physics::trace::{Known, Traced};
use gaitfit_physics::{
    ActionDelta, JointModification, JointNetwork, Modify, NETWORK_WEIGHTS, NetworkScales, Owner, ResidAct,
};
use gaitfit_sim::{JointNetworks, SimError};

use crate::emit::Seating;

/// Networks on every joint that threads compute alike, and which of their numbers are those that were asked for.
#[derive(Clone, Debug, PartialEq)]
pub struct Shared {
    /// The networks asked for; behind those of each modification, further ones on the same joints of the other limbs.
    /// Without weights, which are 0, those change nothing.
    pub modifications: Vec<JointModification<Known>>,
    /// Whether each number that they remember is of a network asked for.
    pub memory: Vec<bool>,
    /// Whether each weight is of a network asked for.
    pub weights: Vec<bool>,
}

impl Shared {
    /// Threads compute limbs alike, so a network on one limb's joint needs one on the same joint of the others. `joints`:
    /// those of the robot.
    pub fn new(modifications: &[JointModification<Known>], seating: &Seating, joints: usize) -> Self {
        let mut shared = Self { modifications: Vec::new(), memory: Vec::new(), weights: Vec::new() };
        for modification in modifications {
            let count = Modify::<Known>::memory(modification);
            let own: Vec<Owner> =
                (0..count).map(|place| Modify::<Known>::memory_owner(modification, place)).collect();
            // Counterparts in lane 0: a joint whose counterpart has a network needs one as well.
            let twins: Vec<Owner> = own.iter().map(|&owner| seating.place(owner).1).collect();
            let lacking = |joint: &usize| {
                let owner = Owner::Joint(*joint);
                !own.contains(&owner) && twins.contains(&seating.place(owner).1)
            };
            // All weights 0, so the added network changes nothing.
            let without = |joint: usize| {
                let scales = NetworkScales { position: 1.0, velocity: 1.0, output: 1.0 };
                JointNetwork::new::<Traced>(joint, &[0.0; NETWORK_WEIGHTS], scales, 0.0)
            };
            let further: Vec<JointNetwork<Known>> = (0..joints).filter(lacking).map(without).collect();
            let mut weights = 0;
            modification.clone().visit_weights_mut(|_, _| weights += 1);
            shared.weights.extend(std::iter::repeat_n(true, weights));
            shared.weights.extend(std::iter::repeat_n(false, further.len() * NETWORK_WEIGHTS));
            let whole = match modification {
                JointModification::ActionDelta(ActionDelta(asked)) => {
                    JointModification::ActionDelta(ActionDelta([asked.as_slice(), &further].concat()))
                }
                JointModification::ResidAct(ResidAct(asked)) => {
                    JointModification::ResidAct(ResidAct([asked.as_slice(), &further].concat()))
                }
                // On all joints already.
                other => other.clone(),
            };
            // The added networks' numbers stand behind the ones that were asked for.
            shared.memory.extend((0..Modify::<Known>::memory(&whole)).map(|place| place < count));
            shared.modifications.push(whole);
        }
        shared
    }
}

/// Weights of networks as the step visits them, scales folded in: what [`super::Batch::write_weights`] takes of a candidate.
///
/// # Errors
/// Networks that do not fit the robot.
pub(crate) fn weights(model: &Model, networks: &[JointNetworks]) -> Result<Vec<f64>, SimError> {
    let mut weights = Vec::new();
    for one in networks {
        let mut compiled: JointModification<f32> = one.compile::<f32>(model)?;
        compiled.visit_weights_mut(|_, weight| weights.push(f64::from(*weight)));
    }
    Ok(weights)
}
