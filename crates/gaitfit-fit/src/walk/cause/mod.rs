//! A cause of what logs show: something that the robot has and its model lacks.

mod effect;

pub use effect::{of_effect, singles, twisting};

use gaitfit_log::Estimate;
use serde::{Deserialize, Serialize};

/// The kind of a cause.
#[derive(Clone, Copy, Debug, PartialEq, Eq, Hash, Serialize, Deserialize)]
#[serde(rename_all = "snake_case")]
pub enum CauseKind {
    /// Joint velocities are read late or through a filter.
    VelocityLag,
    /// The gyro reads a rate at rest.
    GyroBias,
    /// The inertial unit is tilted, or the floor slopes.
    Tilt,
    /// Joint positions come in steps.
    EncoderStep,
    /// Dry friction grows with the motor's torque.
    LoadFriction,
    /// Joints twist between motor and link.
    Elasticity,
    /// Joints have play between motor and link.
    Backlash,
    /// One joint has other friction than the same joint of other legs.
    OddFriction,
    /// One joint has a spring that the same joint of other legs does not have.
    OddSpring,
    /// The motor of one joint gives more or less torque than the same joint of other legs.
    OddStrength,
    /// The ground gives way, or is uneven.
    Ground,
}

/// Something that the robot has and its model lacks.
#[derive(Clone, Debug, PartialEq, Serialize, Deserialize)]
pub struct Cause {
    /// The kind.
    pub kind: CauseKind,
    /// The joint group or joint that has it; empty where it is of the whole robot.
    pub of: String,
    /// Its size, in `unit`, and the standard error.
    pub size: Estimate,
    /// Unit of the size.
    pub unit: String,
    /// The size over the smallest one that changes how a robot walks; the list is ordered by it.
    pub weight: f64,
    /// The cause with its evidence and its remedy, in a sentence.
    pub text: String,
}

impl Cause {
    /// The sentence without its remedy.
    pub fn effect(&self) -> &str {
        self.text.split(REMEDY).next().unwrap_or_default()
    }
}

/// The words before a remedy.
const REMEDY: &str = " (fit it";

/// Smallest sizes that change how a robot walks.
pub(super) mod matters {
    /// Lag of joint velocities, s.
    pub const LAG: f64 = 1e-3;
    /// Rate that the gyro reads at rest, rad/s.
    pub const GYRO: f64 = 0.003;
    /// Tilt of the inertial unit, rad.
    pub const TILT: f64 = 0.005;
    /// Step of joint positions, rad.
    pub const STEP: f64 = 0.0015;
    /// Friction under load, N·m for each N·m of the motor's torque.
    pub const LOAD: f64 = 0.03;
    /// Twist between motor and link, rad for each N·m.
    pub const TWIST: f64 = 0.0015;
    /// Play between motor and link, rad.
    pub const PLAY: f64 = 0.01;
    /// Difference of a joint's dry friction from that of its siblings, N·m.
    pub const FRICTION: f64 = 0.05;
    /// Stiffness of a spring on a single joint, N·m/rad.
    pub const SPRING: f64 = 2.0;
    /// Difference of a motor's strength from that of its siblings, part of the torque.
    pub const STRENGTH: f64 = 0.12;
    /// Difference in height of feet that stand together, root mean square, m.
    pub const HEIGHT: f64 = 0.006;
}
