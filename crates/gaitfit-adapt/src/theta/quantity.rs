//! The quantities θ can change.

use gaitfit_sim::RobotParams;
use serde::{Deserialize, Serialize};

/// A quantity of a joint.
#[derive(Clone, Copy, Debug, PartialEq, Eq, Hash, Serialize, Deserialize)]
#[serde(rename_all = "snake_case")]
pub enum Quantity {
    /// Dry (Coulomb) friction torque, N·m.
    #[serde(rename = "frictionloss")]
    FrictionLoss,
    /// Reflected rotor inertia, kg·m².
    Armature,
    /// Viscous damping, N·m·s/rad.
    Damping,
    /// Time from a position target being sent to it acting, s.
    Delay,
    /// Encoder reading minus true joint angle, rad.
    EncoderBias,
    /// Delivered torque over commanded torque.
    TorqueScale,
    /// Constant torque added to the PD torque, N·m.
    TorqueOffset,
    /// True position gain over the stated one.
    KpScale,
    /// True velocity gain over the stated one.
    KdScale,
}

/// What an entry takes when its rule is silent.
#[derive(Clone, Copy, Debug, PartialEq)]
pub struct Defaults {
    /// Lower bound.
    pub lower: f64,
    /// Upper bound.
    pub upper: f64,
    /// First mean.
    pub start: f64,
    /// First standard deviation.
    pub deviation: f64,
}

impl Quantity {
    /// Every quantity.
    pub const ALL: [Quantity; 9] = [
        Quantity::FrictionLoss,
        Quantity::Armature,
        Quantity::Damping,
        Quantity::Delay,
        Quantity::EncoderBias,
        Quantity::TorqueScale,
        Quantity::TorqueOffset,
        Quantity::KpScale,
        Quantity::KdScale,
    ];

    /// Name in files and tables.
    pub fn name(self) -> &'static str {
        match self {
            Quantity::FrictionLoss => "frictionloss",
            Quantity::Armature => "armature",
            Quantity::Damping => "damping",
            Quantity::Delay => "delay",
            Quantity::EncoderBias => "encoder_bias",
            Quantity::TorqueScale => "torque_scale",
            Quantity::TorqueOffset => "torque_offset",
            Quantity::KpScale => "kp_scale",
            Quantity::KdScale => "kd_scale",
        }
    }

    /// Unit; `-` for a ratio.
    pub fn unit(self) -> &'static str {
        match self {
            Quantity::FrictionLoss | Quantity::TorqueOffset => "N·m",
            Quantity::Armature => "kg·m²",
            Quantity::Damping => "N·m·s/rad",
            Quantity::Delay => "s",
            Quantity::EncoderBias => "rad",
            Quantity::TorqueScale | Quantity::KpScale | Quantity::KdScale => "-",
        }
    }

    /// Bounds, start and deviation of a rule that does not give them. Friction loss and armature: Dao and
    /// Fern's FricArm.
    pub fn defaults(self) -> Defaults {
        let (lower, upper, start, deviation) = match self {
            Quantity::FrictionLoss => (0.0, 0.5, 0.0, 0.1),
            Quantity::Armature => (0.0, 0.5, 0.0, 0.05),
            Quantity::Damping => (0.0, 2.0, 0.0, 0.1),
            Quantity::Delay => (0.0, 0.1, 0.0, 0.01),
            Quantity::EncoderBias => (-0.1, 0.1, 0.0, 0.01),
            Quantity::TorqueScale => (0.5, 1.5, 1.0, 0.05),
            Quantity::TorqueOffset => (-1.0, 1.0, 0.0, 0.1),
            Quantity::KpScale | Quantity::KdScale => (0.5, 2.0, 1.0, 0.1),
        };
        Defaults { lower, upper, start, deviation }
    }

    /// This quantity of each of a robot's joints.
    pub fn of_joints(self, robot: &mut RobotParams) -> &mut Vec<f64> {
        match self {
            Quantity::FrictionLoss => &mut robot.frictionloss,
            Quantity::Armature => &mut robot.armature,
            Quantity::Damping => &mut robot.damping,
            Quantity::Delay => &mut robot.delay,
            Quantity::EncoderBias => &mut robot.encoder_bias,
            Quantity::TorqueScale => &mut robot.torque_scale,
            Quantity::TorqueOffset => &mut robot.torque_offset,
            Quantity::KpScale => &mut robot.kp_scale,
            Quantity::KdScale => &mut robot.kd_scale,
        }
    }

    /// Smallest value with a meaning.
    pub fn least(self) -> f64 {
        match self {
            Quantity::EncoderBias | Quantity::TorqueOffset => f64::NEG_INFINITY,
            _ => 0.0,
        }
    }
}
