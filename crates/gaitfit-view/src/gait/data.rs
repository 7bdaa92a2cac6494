//! Content of a picture of a gait, in plain vectors.

/// A few seconds of walking. Every list over time has one entry a sample of `time_s`; missing numbers are NaN, and
/// an empty list leaves its part out.
#[derive(Clone, Debug, Default, PartialEq)]
pub struct GaitPicture {
    /// Sample times, s, ascending.
    pub time_s: Vec<f64>,
    /// Feet from top to bottom; by convention FL, FR, RL, RR.
    pub feet: Vec<FootTrack>,
    /// Commanded and measured velocity: forward (m/s), left (m/s), yaw rate (rad/s), in the heading frame.
    pub velocity: [VelocityTrack; 3],
    /// Joint torque by frequency, one a joint group (hip, thigh, calf).
    pub spectra: Vec<TorqueSpectrum>,
}

/// One foot over time.
#[derive(Clone, Debug, Default, PartialEq)]
pub struct FootTrack {
    /// Its name.
    pub name: String,
    /// Whether it touches the ground.
    pub contact: Vec<bool>,
    /// Height of its lowest point above the ground, m.
    pub height_m: Vec<f64>,
}

/// One component of the base's velocity over time.
#[derive(Clone, Debug, Default, PartialEq)]
pub struct VelocityTrack {
    /// Commanded velocity.
    pub command: Vec<f64>,
    /// Velocity of the base.
    pub measured: Vec<f64>,
}

/// Power spectral density of the torques of a group of joints.
#[derive(Clone, Debug, Default, PartialEq)]
pub struct TorqueSpectrum {
    /// Name of the group.
    pub group: String,
    /// Whether joints of the group slide: their torques are forces.
    pub slides: bool,
    /// Frequencies, Hz, ascending.
    pub frequency_hz: Vec<f64>,
    /// One-sided density averaged over the group's joints, (N·m)²/Hz (slides: N²/Hz); without the mean torque.
    pub density: Vec<f64>,
}
