//! A candidate robot: the model's joint parameters, changed joint by joint.

use gaitfit_model::Model;
use gaitfit_physics::Robot;

/// Parameters that an adaptation may change. Vectors hold one entry a model joint.
#[derive(Clone, Debug, PartialEq)]
pub struct RobotParams {
    /// Reflected rotor inertia, kg·m².
    pub armature: Vec<f64>,
    /// Viscous damping, N·m·s/rad.
    pub damping: Vec<f64>,
    /// Dry friction torque, N·m.
    pub frictionloss: Vec<f64>,
    /// Actuation delay, s.
    pub delay: Vec<f64>,
    /// Encoder reading minus true angle, rad.
    pub encoder_bias: Vec<f64>,
    /// Factor on the PD torque.
    pub torque_scale: Vec<f64>,
    /// Constant torque added to the PD torque, N·m: weight, springs and cables that the model lacks.
    pub torque_offset: Vec<f64>,
    /// Factor on the recording's position gain.
    pub kp_scale: Vec<f64>,
    /// Factor on the recording's velocity gain.
    pub kd_scale: Vec<f64>,
    /// Mass added to the root body, kg.
    pub base_mass: f64,
    /// Shift of the root body's centre of mass, m, body frame.
    pub base_com: [f64; 3],
}

impl RobotParams {
    /// The model's own numbers: no delay, no bias, unit scales.
    pub fn nominal(model: &Model) -> Self {
        let robot = Robot::nominal(model);
        let ones = vec![1.0; model.joints.len()];
        Self {
            armature: robot.armature,
            damping: robot.damping,
            frictionloss: robot.frictionloss,
            delay: robot.delay,
            encoder_bias: robot.encoder_bias,
            torque_scale: robot.torque_scale,
            torque_offset: robot.torque_offset,
            kp_scale: ones.clone(),
            kd_scale: ones,
            base_mass: 0.0,
            base_com: [0.0; 3],
        }
    }

    /// The robot of the physics with PD gains `kp` and `kd` (one a joint), scaled.
    pub fn robot(&self, model: &Model, kp: &[f64], kd: &[f64]) -> Robot {
        let product = |a: &[f64], b: &[f64]| a.iter().zip(b).map(|(x, y)| x * y).collect();
        Robot {
            armature: self.armature.clone(),
            damping: self.damping.clone(),
            frictionloss: self.frictionloss.clone(),
            delay: self.delay.clone(),
            encoder_bias: self.encoder_bias.clone(),
            torque_scale: self.torque_scale.clone(),
            torque_offset: self.torque_offset.clone(),
            kp: product(&self.kp_scale, kp),
            kd: product(&self.kd_scale, kd),
            base_mass: self.base_mass,
            base_com: self.base_com,
            ..Robot::nominal(model)
        }
    }
}
