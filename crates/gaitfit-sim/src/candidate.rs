//! A simulated robot as a fit may have changed it.

use gaitfit_model::Model;
use gaitfit_physics::{
    ActionDelta, JointModification, JointNetwork, NETWORK_WEIGHTS, NetworkScales, Parts, Real, ResidAct,
    Robot,
};

use crate::{Sensors, SimError};

/// Quantity that a set of joint networks corrects.
#[derive(Clone, Copy, Debug, PartialEq, Eq, Hash)]
pub enum NetworkKind {
    /// Position targets, rad, at the policy's rate.
    ActionDelta,
    /// Torques, N·m, at every physics step.
    ResidAct,
}

/// One network a joint; see [`gaitfit_physics::JointNetwork`] for their form.
#[derive(Clone, Debug, PartialEq)]
pub struct JointNetworks {
    /// Quantity that they correct.
    pub kind: NetworkKind,
    /// The joints, by index in the model.
    pub joints: Vec<usize>,
    /// Angles at which the position inputs are 0, rad; one a joint of `joints`.
    pub rest: Vec<f64>,
    /// `joints × NETWORK_WEIGHTS`.
    pub weights: Vec<f64>,
    /// Units of inputs and output.
    pub scales: NetworkScales,
}

impl JointNetworks {
    /// The networks as the step of `model` takes them.
    ///
    /// # Errors
    /// Joints that the robot lacks; weights that are not finite, or not 97 a joint.
    pub fn compile<T: Real>(&self, model: &Model) -> Result<JointModification<T::K>, SimError> {
        let refuse = |value: String, must| {
            Err(SimError::Option { option: "a candidate's joint networks", value, must })
        };
        let count = self.joints.len();
        if self.weights.len() != count * NETWORK_WEIGHTS || self.rest.len() != count {
            let value = format!("{} weights and {} rest angles", self.weights.len(), self.rest.len());
            // 97 is `NETWORK_WEIGHTS`.
            return refuse(value, "97 weights and a rest angle for every joint");
        }
        if self.weights.iter().chain(&self.rest).any(|x| !x.is_finite()) {
            return refuse("not finite".to_owned(), "finite");
        }
        let mut networks = Vec::with_capacity(count);
        for ((&joint, rest), weights) in
            self.joints.iter().zip(&self.rest).zip(self.weights.chunks_exact(NETWORK_WEIGHTS))
        {
            if joint >= model.joints.len() {
                return refuse(format!("joint {joint}"), "of joints of the robot");
            }
            // `chunks_exact` gives exactly so many, so no index is missing.
            let weights = std::array::from_fn(|index| weights[index]);
            networks.push(JointNetwork::new::<T>(joint, &weights, self.scales, *rest));
        }
        Ok(match self.kind {
            NetworkKind::ActionDelta => JointModification::ActionDelta(ActionDelta(networks)),
            NetworkKind::ResidAct => JointModification::ResidAct(ResidAct(networks)),
        })
    }
}

/// The modifications of the drives of robots with these networks, as the step of `model` takes them: first the networks, then
/// the other parts.
///
/// # Errors
/// Networks that do not fit the robot.
pub fn modifications<T: Real>(
    model: &Model,
    networks: &[JointNetworks],
    parts: Parts,
) -> Result<Vec<JointModification<T::K>>, SimError> {
    let others = parts.modifications(model.joints.len()).into_iter().map(Ok);
    // All memory behind the first sensor counts as memory of sensors, so the networks come first.
    networks.iter().map(|one| one.compile::<T>(model)).chain(others).collect()
}

/// Everything in which a simulated robot may differ from its file.
#[derive(Clone, Debug, PartialEq)]
pub struct Candidate {
    /// Parameters of joints and base. The gains are those of the recording or the policy that it is simulated with.
    pub robot: Robot,
    /// Networks; applied in this order.
    pub networks: Vec<JointNetworks>,
    /// Standard deviation of Gaussian torques added to every joint at every physics step, N·m.
    pub torque_noise: f64,
    /// Errors of its sensors.
    pub sensors: Sensors,
}

impl Candidate {
    /// The robot of the file.
    pub fn nominal(model: &Model) -> Self {
        Self {
            robot: Robot::nominal(model),
            networks: Vec::new(),
            torque_noise: 0.0,
            sensors: Sensors::default(),
        }
    }

    /// The robot with the given gains (one a model joint), and the candidate's factors on them multiplied in.
    pub fn robot(&self, kp: &[f64], kd: &[f64]) -> Robot {
        let product = |a: &[f64], b: &[f64]| a.iter().zip(b).map(|(x, y)| x * y).collect();
        // The factors are in the products now and must not act twice.
        let ones = vec![1.0; kp.len()];
        Robot {
            kp: product(&self.robot.kp_scale, kp),
            kd: product(&self.robot.kd_scale, kd),
            kp_scale: ones.clone(),
            kd_scale: ones,
            ..self.robot.clone()
        }
    }
}
