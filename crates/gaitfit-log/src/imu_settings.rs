//! Readings of an inertial unit's columns that differ from their names.

use crate::BaseState;
use gaitfit_model::rotation::{
    Quat, from_rpy, inverse, normalize, product, quat_of, rotate, rotate_back, vec_of,
};
use serde::{Deserialize, Serialize};

/// Order of a quaternion's components in the columns w, x, y, z.
#[derive(Clone, Copy, Debug, Default, PartialEq, Eq, Serialize, Deserialize)]
#[serde(rename_all = "lowercase")]
pub enum QuaternionOrder {
    /// w, x, y, z, as named.
    #[default]
    Wxyz,
    /// x, y, z, w under the names w, x, y, z.
    Xyzw,
}

/// Frame of the rates.
#[derive(Clone, Copy, Debug, Default, PartialEq, Eq, Serialize, Deserialize)]
#[serde(rename_all = "lowercase")]
pub enum RateFrame {
    /// The base's, as a gyroscope measures them.
    #[default]
    Body,
    /// The world's, as many simulators report them.
    World,
}

/// Unit of the rates.
#[derive(Clone, Copy, Debug, Default, PartialEq, Eq, Serialize, Deserialize)]
pub enum RateUnit {
    /// rad/s
    #[default]
    #[serde(rename = "rad")]
    Radians,
    /// °/s
    #[serde(rename = "deg")]
    Degrees,
}

impl RateUnit {
    /// rad/s in one unit.
    pub(crate) fn radians(self) -> f64 {
        match self {
            Self::Radians => 1.0,
            Self::Degrees => 1f64.to_radians(),
        }
    }
}

/// How an inertial unit's columns are to be read. A key that is absent is judged by the data.
///
/// In a log's sidecar file it is the table `[imu]`, above a header `# imu.frame = "world"` and so on.
#[derive(Clone, Copy, Debug, Default, PartialEq, Serialize, Deserialize)]
#[serde(default, deny_unknown_fields)]
pub struct ImuSettings {
    /// Order of the quaternion's components.
    pub order: Option<QuaternionOrder>,
    /// Frame of the rates.
    pub frame: Option<RateFrame>,
    /// Unit of the rates.
    pub unit: Option<RateUnit>,
    /// Whether the rates have the opposite sign.
    pub negated: Option<bool>,
    /// How the unit is mounted: roll, pitch and yaw of its axes in the base's frame, degrees.
    pub mounting: Option<[f64; 3]>,
}

impl ImuSettings {
    /// Fills keys that `self` lacks from `other`.
    #[must_use]
    pub fn or(self, other: Self) -> Self {
        Self {
            order: self.order.or(other.order),
            frame: self.frame.or(other.frame),
            unit: self.unit.or(other.unit),
            negated: self.negated.or(other.negated),
            mounting: self.mounting.or(other.mounting),
        }
    }

    /// Whether nothing is stated.
    pub fn is_empty(&self) -> bool {
        *self == Self::default()
    }

    /// Orientation and rates of the base, of columns that are as stated.
    pub fn apply(&self, base: &mut BaseState) {
        // The order of the four steps matters: rates are turned by an orientation that is already right.
        if self.order == Some(QuaternionOrder::Xyzw)
            && let Some(quaternion) = &mut base.quaternion
        {
            quaternion.chunks_exact_mut(4).for_each(|q| q.rotate_right(1));
        }
        let mut factor = self.unit.unwrap_or_default().radians();
        if self.negated == Some(true) {
            factor = -factor;
        }
        // A factor of 1 leaves all bits as they are.
        if let Some(rates) = base.angular_velocity.as_mut().filter(|_| factor != 1.0) {
            rates.iter_mut().for_each(|rate| *rate *= factor);
        }
        if self.frame == Some(RateFrame::World)
            && let (Some(rates), Some(quaternion)) = (&mut base.angular_velocity, &base.quaternion)
        {
            for (w, q) in rates.chunks_exact_mut(3).zip(quaternion.chunks_exact(4)) {
                w.copy_from_slice(&rotate_back(unit(q), vec_of(w)));
            }
        }
        // A mounting of zeros leaves all bits as they are.
        if let Some(angles) = self.mounting.filter(|angles| angles.iter().any(|angle| *angle != 0.0)) {
            let [roll, pitch, yaw] = angles.map(f64::to_radians);
            let of_base = from_rpy(roll, pitch, yaw);
            // The orientation is that of the unit; the mounting taken away, it is that of the base.
            for q in base.quaternion.iter_mut().flat_map(|all| all.chunks_exact_mut(4)) {
                let of_unit: Quat = quat_of(q);
                q.copy_from_slice(&product(of_unit, inverse(of_base)));
            }
            for w in base.angular_velocity.iter_mut().flat_map(|all| all.chunks_exact_mut(3)) {
                w.copy_from_slice(&rotate(of_base, vec_of(w)));
            }
        }
    }
}

/// A quaternion of length 1; NaN stays NaN.
fn unit(q: &[f64]) -> Quat {
    if q.iter().all(|x| x.is_finite()) { normalize(quat_of(q)) } else { [f64::NAN; 4] }
}
