//! Numbers of the robot as a whole: torque noise, mass and centre of mass of the base, a load on it, friction of the floor,
//! errors of sensors.

use super::file::MAX_VALUE;
use super::{Defaults, Entry, Modification, ReadContext, SavedParameter, ThetaError, ThetaFileError};
use gaitfit_sim::Candidate;
use serde::{Deserialize, Serialize};

/// A number of the robot as a whole.
#[derive(Clone, Copy, Debug, PartialEq, Eq, Hash, Serialize, Deserialize)]
#[serde(rename_all = "snake_case")]
pub enum RobotNumber {
    /// Standard deviation of a Gaussian torque on every joint at every physics step, N·m.
    TorqueNoise,
    /// Mass added to the base, kg.
    BaseMass,
    /// Shift of the base's centre of mass forward, m, body frame.
    BaseComX,
    /// Shift of the base's centre of mass to the left, m, body frame.
    BaseComY,
    /// Shift of the base's centre of mass upward, m, body frame.
    BaseComZ,
    /// Mass of a load fixed to the base, a point, kg.
    PayloadMass,
    /// Where the load is, forward, m, body frame.
    PayloadX,
    /// Where the load is, to the left, m, body frame.
    PayloadY,
    /// Where the load is, upward, m, body frame.
    PayloadZ,
    /// Sliding friction of the floor over the model's.
    FloorFriction,
    /// By which part the time constant of the ground's contacts is longer than the model's.
    GroundSoftness,
    /// Roll of the inertial unit's mounting error, rad; see [`gaitfit_sim::Sensors`].
    ImuRoll,
    /// Pitch of the inertial unit's mounting error, rad.
    ImuPitch,
    /// Reading of the gyro at rest about the unit's x axis, rad/s.
    GyroBiasX,
    /// Reading of the gyro at rest about the unit's y axis, rad/s.
    GyroBiasY,
    /// Reading of the gyro at rest about the unit's z axis, rad/s.
    GyroBiasZ,
    /// Time constant of the filter of the sensors of joint velocity, s.
    VelocityLag,
}

impl RobotNumber {
    /// Every one.
    pub const ALL: [Self; 17] = [
        Self::TorqueNoise,
        Self::BaseMass,
        Self::BaseComX,
        Self::BaseComY,
        Self::BaseComZ,
        Self::PayloadMass,
        Self::PayloadX,
        Self::PayloadY,
        Self::PayloadZ,
        Self::FloorFriction,
        Self::GroundSoftness,
        Self::ImuRoll,
        Self::ImuPitch,
        Self::GyroBiasX,
        Self::GyroBiasY,
        Self::GyroBiasZ,
        Self::VelocityLag,
    ];

    /// Name in files and tables.
    pub fn name(self) -> &'static str {
        match self {
            Self::TorqueNoise => "torque_noise",
            Self::BaseMass => "base_mass",
            Self::BaseComX => "base_com_x",
            Self::BaseComY => "base_com_y",
            Self::BaseComZ => "base_com_z",
            Self::PayloadMass => "payload_mass",
            Self::PayloadX => "payload_x",
            Self::PayloadY => "payload_y",
            Self::PayloadZ => "payload_z",
            Self::FloorFriction => "floor_friction",
            Self::GroundSoftness => "ground_softness",
            Self::ImuRoll => "imu_roll",
            Self::ImuPitch => "imu_pitch",
            Self::GyroBiasX => "gyro_bias_x",
            Self::GyroBiasY => "gyro_bias_y",
            Self::GyroBiasZ => "gyro_bias_z",
            Self::VelocityLag => "velocity_lag",
        }
    }

    /// Unit.
    pub fn unit(self) -> &'static str {
        match self {
            Self::TorqueNoise => "N·m",
            Self::BaseMass | Self::PayloadMass => "kg",
            Self::BaseComX | Self::BaseComY | Self::BaseComZ => "m",
            Self::PayloadX | Self::PayloadY | Self::PayloadZ => "m",
            Self::FloorFriction | Self::GroundSoftness => "-",
            Self::ImuRoll | Self::ImuPitch => "rad",
            Self::GyroBiasX | Self::GyroBiasY | Self::GyroBiasZ => "rad/s",
            Self::VelocityLag => "s",
        }
    }

    /// Bounds, start and deviation of a rule that does not give them.
    pub fn defaults(self) -> Defaults {
        let (lower, upper, start, deviation) = match self {
            // Costs do not mind noise near 0, so a search that begins there can stay there.
            Self::TorqueNoise => (0.0, 10.0, 1.0, 0.5),
            Self::BaseMass => (-2.0, 5.0, 0.0, 0.5),
            Self::BaseComX | Self::BaseComY | Self::BaseComZ => (-0.1, 0.1, 0.0, 0.01),
            // A load of nothing has no place, and least squares does not come away from it: the search begins with some.
            Self::PayloadMass => (0.0, 10.0, 2.0, 0.5),
            Self::PayloadX | Self::PayloadY | Self::PayloadZ => (-0.5, 0.5, 0.0, 0.05),
            Self::FloorFriction => (0.1, 3.0, 1.0, 0.1),
            Self::GroundSoftness => (0.0, 5.0, 0.0, 0.3),
            Self::ImuRoll | Self::ImuPitch => (-0.1, 0.1, 0.0, 0.01),
            Self::GyroBiasX | Self::GyroBiasY | Self::GyroBiasZ => (-0.2, 0.2, 0.0, 0.02),
            Self::VelocityLag => (0.0, 0.02, 0.0, 0.002),
        };
        Defaults { lower, upper, start, deviation }
    }

    /// Smallest value with a meaning.
    fn lower_limit(self) -> f64 {
        match self {
            Self::TorqueNoise | Self::PayloadMass | Self::GroundSoftness | Self::VelocityLag => 0.0,
            // Contacts without any friction are another kind, which a fit cannot reach.
            Self::FloorFriction => 1e-3,
            _ => f64::NEG_INFINITY,
        }
    }

    fn value_mut(self, candidate: &mut Candidate) -> &mut f64 {
        match self {
            Self::TorqueNoise => &mut candidate.torque_noise,
            Self::BaseMass => &mut candidate.robot.base_mass,
            Self::BaseComX => &mut candidate.robot.base_com[0],
            Self::BaseComY => &mut candidate.robot.base_com[1],
            Self::BaseComZ => &mut candidate.robot.base_com[2],
            Self::PayloadMass => &mut candidate.robot.payload_mass,
            Self::PayloadX => &mut candidate.robot.payload_position[0],
            Self::PayloadY => &mut candidate.robot.payload_position[1],
            Self::PayloadZ => &mut candidate.robot.payload_position[2],
            Self::FloorFriction => &mut candidate.robot.friction_scale,
            Self::GroundSoftness => &mut candidate.robot.ground_softness,
            Self::ImuRoll => &mut candidate.sensors.imu_tilt[0],
            Self::ImuPitch => &mut candidate.sensors.imu_tilt[1],
            Self::GyroBiasX => &mut candidate.sensors.gyro_bias[0],
            Self::GyroBiasY => &mut candidate.sensors.gyro_bias[1],
            Self::GyroBiasZ => &mut candidate.sensors.gyro_bias[2],
            Self::VelocityLag => &mut candidate.robot.velocity_lag,
        }
    }
}

/// A rule: a number, and what it takes instead of its defaults.
#[derive(Clone, Debug, PartialEq, Serialize, Deserialize)]
#[serde(deny_unknown_fields)]
pub struct RobotRule {
    /// Which number.
    pub kind: RobotNumber,
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
}

impl RobotRule {
    /// A rule with the number's defaults.
    pub fn new(kind: RobotNumber) -> Self {
        Self { kind, lower: None, upper: None, start: None, deviation: None }
    }

    /// Fills in the defaults where the rule is silent.
    pub fn resolve(&mut self) {
        let defaults = self.kind.defaults();
        self.lower.get_or_insert(defaults.lower);
        self.upper.get_or_insert(defaults.upper);
        self.start.get_or_insert(self.default_start());
        self.deviation.get_or_insert(defaults.deviation);
    }

    /// The default start, within the rule's own bounds.
    fn default_start(&self) -> f64 {
        let defaults = self.kind.defaults();
        let (lower, upper) = (self.lower.unwrap_or(defaults.lower), self.upper.unwrap_or(defaults.upper));
        defaults.start.min(upper).max(lower)
    }

    /// The modification.
    ///
    /// # Errors
    /// [`ThetaError`] if the numbers are out of order.
    pub fn modification(&self) -> Result<Box<dyn Modification>, ThetaError> {
        let defaults = self.kind.defaults();
        let entry = Entry {
            name: self.kind.name().to_owned(),
            kind: self.kind.name(),
            unit: self.kind.unit().to_owned(),
            joints: Vec::new(),
            lower: self.lower.unwrap_or(defaults.lower),
            upper: self.upper.unwrap_or(defaults.upper),
            start: self.start.unwrap_or_else(|| self.default_start()),
            deviation: self.deviation.unwrap_or(defaults.deviation),
        };
        entry.check(self.kind.lower_limit(), MAX_VALUE)?;
        Ok(Box::new(OneNumber { number: self.kind, entry: [entry] }))
    }
}

/// One number of the robot.
#[derive(Debug)]
struct OneNumber {
    number: RobotNumber,
    entry: [Entry; 1],
}

impl Modification for OneNumber {
    fn entries(&self) -> &[Entry] {
        &self.entry
    }

    fn apply(&self, values: &[f64], _joints: &[String], candidate: &mut Candidate) {
        if let Some(&value) = values.first() {
            *self.number.value_mut(candidate) = value;
        }
    }
}

/// Applies a parameter of a file, if its kind is a number of the robot.
pub(super) fn read(
    parameter: &SavedParameter,
    context: &ReadContext<'_>,
    candidate: &mut Candidate,
) -> Option<Result<(), ThetaFileError>> {
    let number = RobotNumber::ALL.into_iter().find(|number| number.name() == parameter.kind)?;
    let checked = context.check(parameter, number.lower_limit(), MAX_VALUE);
    Some(checked.map(|()| *number.value_mut(candidate) = parameter.value))
}
