//! Numbers of the robot as a whole: torque noise, mass and centre of mass of the base, a load on it, friction of the floor,
//! errors of sensors.

use super::read_context::ReadContext;
use super::saved::MAX_VALUE;
use super::{Defaults, Entry, Modification, SavedParameter, ThetaError, ThetaFileError};
use gaitfit_sim::Candidate;
use serde::{Deserialize, Serialize};

/// Makes [`RobotNumber`] of its table. A row: documentation, variant, name in files; unit; smallest value with a meaning; what
/// a search takes where a rule is silent (lower, upper, start, deviation); where the number stands in a candidate.
macro_rules! robot_numbers {
    ($($(#[doc = $doc:literal])* $variant:ident $name:ident; $unit:literal; $least:expr; $search:expr; { $($place:tt)+ };)*) => {
        /// A number of the robot as a whole.
        #[derive(Clone, Copy, Debug, PartialEq, Eq, Hash, Serialize, Deserialize)]
        #[serde(rename_all = "snake_case")]
        pub enum RobotNumber {
            $($(#[doc = $doc])* $variant,)*
        }

        impl RobotNumber {
            /// Every one.
            pub const ALL: &[Self] = &[$(Self::$variant),*];

            /// Name in files and tables.
            pub fn name(self) -> &'static str {
                match self {
                    $(Self::$variant => stringify!($name),)*
                }
            }

            /// Unit; `-` for a ratio.
            pub fn unit(self) -> &'static str {
                match self {
                    $(Self::$variant => $unit,)*
                }
            }

            /// What it is, in words.
            pub fn description(self) -> &'static str {
                match self {
                    $(Self::$variant => concat!($($doc),*).trim_ascii(),)*
                }
            }

            /// Bounds, start and deviation of a rule that does not give them.
            pub fn defaults(self) -> Defaults {
                let (lower, upper, start, deviation) = match self {
                    $(Self::$variant => $search,)*
                };
                Defaults { lower, upper, start, deviation }
            }

            /// Smallest value with a meaning.
            fn lower_limit(self) -> f64 {
                match self {
                    $(Self::$variant => $least,)*
                }
            }

            /// The number of `candidate`.
            pub fn value(self, candidate: &Candidate) -> f64 {
                match self {
                    $(Self::$variant => candidate.$($place)+,)*
                }
            }

            fn value_mut(self, candidate: &mut Candidate) -> &mut f64 {
                match self {
                    $(Self::$variant => &mut candidate.$($place)+,)*
                }
            }
        }
    };
}

robot_numbers! {
    /// Standard deviation of a Gaussian torque on every joint at every physics step, N·m.
    TorqueNoise torque_noise; "N·m"; 0.0;
    // Costs do not mind noise near 0, so a search that begins there can stay there.
    (0.0, 10.0, 1.0, 0.5); { torque_noise };

    /// Mass added to the base, kg.
    BaseMass base_mass; "kg"; f64::NEG_INFINITY;
    (-2.0, 5.0, 0.0, 0.5); { robot.base_mass };

    /// Shift of the base's centre of mass forward, m, body frame.
    BaseComX base_com_x; "m"; f64::NEG_INFINITY;
    (-0.1, 0.1, 0.0, 0.01); { robot.base_com[0] };

    /// Shift of the base's centre of mass to the left, m, body frame.
    BaseComY base_com_y; "m"; f64::NEG_INFINITY;
    (-0.1, 0.1, 0.0, 0.01); { robot.base_com[1] };

    /// Shift of the base's centre of mass upward, m, body frame.
    BaseComZ base_com_z; "m"; f64::NEG_INFINITY;
    (-0.1, 0.1, 0.0, 0.01); { robot.base_com[2] };

    /// Mass of a load fixed to the base, a point, kg.
    PayloadMass payload_mass; "kg"; 0.0;
    // A load of nothing has no place, and least squares does not come away from it: the search begins with some.
    (0.0, 10.0, 2.0, 0.5); { robot.payload_mass };

    /// Where the load is, forward, m, body frame.
    PayloadX payload_x; "m"; f64::NEG_INFINITY;
    (-0.5, 0.5, 0.0, 0.05); { robot.payload_position[0] };

    /// Where the load is, to the left, m, body frame.
    PayloadY payload_y; "m"; f64::NEG_INFINITY;
    (-0.5, 0.5, 0.0, 0.05); { robot.payload_position[1] };

    /// Where the load is, upward, m, body frame.
    PayloadZ payload_z; "m"; f64::NEG_INFINITY;
    (-0.5, 0.5, 0.0, 0.05); { robot.payload_position[2] };

    /// Sliding friction of the floor over the model's.
    FloorFriction floor_friction; "-"; 1e-3;
    // Contacts without any friction are another kind, which a fit cannot reach.
    (0.1, 3.0, 1.0, 0.1); { robot.friction_scale };

    /// By which part the time constant of the ground's contacts is longer than the model's.
    GroundSoftness ground_softness; "-"; 0.0;
    (0.0, 5.0, 0.0, 0.3); { robot.ground_softness };

    /// Least impedance of the ground's contacts at first touch, MuJoCo's `solimp[0]`: firm feet have 0.9, soft ones less.
    GroundImpedance ground_impedance; "-"; 0.0;
    (0.0, 0.99, 0.9, 0.2); { robot.ground_impedance };

    /// Roll of the inertial unit's mounting error, rad.
    ImuRoll imu_roll; "rad"; f64::NEG_INFINITY;
    (-0.1, 0.1, 0.0, 0.01); { sensors.imu_tilt[0] };

    /// Pitch of the inertial unit's mounting error, rad.
    ImuPitch imu_pitch; "rad"; f64::NEG_INFINITY;
    (-0.1, 0.1, 0.0, 0.01); { sensors.imu_tilt[1] };

    /// Reading of the gyro at rest about the unit's x axis, rad/s.
    GyroBiasX gyro_bias_x; "rad/s"; f64::NEG_INFINITY;
    (-0.2, 0.2, 0.0, 0.02); { sensors.gyro_bias[0] };

    /// Reading of the gyro at rest about the unit's y axis, rad/s.
    GyroBiasY gyro_bias_y; "rad/s"; f64::NEG_INFINITY;
    (-0.2, 0.2, 0.0, 0.02); { sensors.gyro_bias[1] };

    /// Reading of the gyro at rest about the unit's z axis, rad/s.
    GyroBiasZ gyro_bias_z; "rad/s"; f64::NEG_INFINITY;
    (-0.2, 0.2, 0.0, 0.02); { sensors.gyro_bias[2] };

    /// Time constant of the filter of the sensors of joint velocity, s; clamped robots show it, too.
    VelocityLag velocity_lag; "s"; 0.0;
    (0.0, 0.02, 0.0, 0.002); { robot.velocity_lag };

    /// Age of the inertial unit's readings, s: orientation and rates; at most two control periods.
    ImuDelay imu_delay; "s"; 0.0;
    (0.0, 0.02, 0.0, 0.002); { robot.imu_delay };
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
        // Not `clamp`, which panics if a rule's bounds are in the wrong order: `Entry::check` refuses them later.
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
    let number = RobotNumber::ALL.iter().copied().find(|number| number.name() == parameter.kind)?;
    let checked = context.check(parameter, number.lower_limit(), MAX_VALUE);
    Some(checked.map(|()| *number.value_mut(candidate) = parameter.value))
}
