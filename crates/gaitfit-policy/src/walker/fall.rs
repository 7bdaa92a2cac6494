//! When a robot counts as fallen.

use gaitfit_model::rotation::quat_of;
use gaitfit_model::shown;
use gaitfit_sim::{Batch, Motion};
use globset::Glob;
use serde::{Deserialize, Serialize};

use super::WalkerError;
use super::feet::nearest;
use crate::frames;

/// When a robot counts as fallen.
#[derive(Clone, Debug, PartialEq, Serialize, Deserialize)]
#[serde(deny_unknown_fields)]
pub struct FallSettings {
    /// Patterns over names of geoms that must not touch the ground.
    pub contacts: Vec<String>,
    /// Angle between wanted and actual posture, degrees.
    pub tilt: f64,
    /// Lowest height of the base's origin above the ground under it, m.
    pub height: f64,
}

/// Min normal force that counts as touching, N.
pub const TOUCH: f32 = 1.0;

/// Counts the geoms in `places` that touch the ground; `forces` are of one environment
/// ([`Motion::normal_force`]).
///
/// # Panics
/// If a place is outside of `forces`: an error of the caller.
pub fn touching(forces: &[f32], places: &[usize]) -> usize {
    places.iter().filter(|&&place| forces[place] > TOUCH).count()
}

/// The rules of a fall on a robot.
pub(super) struct Fall {
    /// Places in [`Motion::normal_force`] of geoms that must not touch the ground.
    pub(super) geoms: Vec<usize>,
    /// Geoms in all.
    contacts: usize,
    pub(super) least_uprightness: f32,
    pub(super) height: f32,
    pub(super) posture: [f32; 3],
}

impl Fall {
    /// `settings` on the robot of `batch`; `posture`: gravity in the body frame in the wanted posture.
    pub(super) fn new(
        batch: &Batch,
        settings: &FallSettings,
        posture: [f64; 3],
    ) -> Result<Self, WalkerError> {
        let model = batch.model();
        let contacts = batch.contact_geoms().len();
        let name = |place: usize| model.geoms[batch.contact_geoms()[place]].name.as_str();
        let refuse = |what: String| Err(WalkerError::Option { option: "fall.contacts", what });
        let mut geoms = Vec::new();
        for pattern in &settings.contacts {
            let Ok(glob) = Glob::new(pattern) else {
                return refuse(format!("has `{}`, which is no pattern", shown(pattern)));
            };
            let matcher = glob.compile_matcher();
            let before = geoms.len();
            geoms.extend((0..contacts).filter(|&place| matcher.is_match(name(place))));
            // A pattern that matches nothing is a slip, and falls would go unseen.
            if geoms.len() == before {
                return refuse(format!(
                    "has `{}`, which matches no geom of {} that may touch the ground; {}",
                    shown(pattern),
                    shown(&model.name),
                    nearest(pattern, (0..contacts).map(name))
                ));
            }
        }
        Ok(Self {
            geoms,
            contacts,
            // The cosine falls as the angle grows, so the largest tilt gives the least uprightness.
            least_uprightness: settings.tilt.to_radians().cos() as f32,
            height: settings.height as f32,
            posture: posture.map(|x| x as f32),
        })
    }

    pub(super) fn uprightness(&self, up: [f32; 3]) -> f32 {
        frames::uprightness(up, self.posture)
    }

    /// `ground`: height of the ground under the base, m.
    pub(super) fn fallen(&self, motion: &Motion, index: usize, ground: f32) -> bool {
        let forces = &motion.normal_force[index * self.contacts..(index + 1) * self.contacts];
        let up = frames::up(quat_of(&motion.base_quaternion[4 * index..]));
        // A state that is not finite fails all three comparisons. Callers that count falls test for it separately.
        touching(forces, &self.geoms) > 0
            || self.uprightness(up) < self.least_uprightness
            || motion.base_position[3 * index + 2] - ground < self.height
    }
}
