//! The base's motion as a log has it.

use gaitfit_model::rotation::rotate_back;

/// The base's motion as one sample of a log has it; what the log lacks is absent.
#[derive(Clone, Copy, Debug, Default, PartialEq)]
pub struct BaseSample {
    /// Position, m, world frame.
    pub position: Option<[f64; 3]>,
    /// Orientation, wxyz, unit.
    pub quaternion: Option<[f64; 4]>,
    /// Linear velocity, m/s, world frame.
    pub linear_velocity: Option<[f64; 3]>,
    /// Angular velocity, rad/s, body frame.
    pub angular_velocity: Option<[f64; 3]>,
}

impl BaseSample {
    /// A world vector in the body frame.
    pub(crate) fn to_body(self, vector: [f64; 3]) -> Option<[f64; 3]> {
        Some(rotate_back(self.quaternion?, vector))
    }
}
