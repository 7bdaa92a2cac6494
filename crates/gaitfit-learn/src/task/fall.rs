//! When a robot counts as fallen.

use gaitfit_sim::Motion;

use super::Scene;
use super::moment::up_axis;

/// Least normal force that counts as touching, N.
const TOUCH: f32 = 1.0;

/// How many of the geoms in `places` touch the ground; `forces` are of one environment.
pub(super) fn touching(forces: &[f32], places: &[usize]) -> usize {
    places.iter().filter(|&&place| forces[place] > TOUCH).count()
}

/// Cosine of the angle between gravity in the body frame (`−up`) and where it is in the task's posture.
pub(super) fn uprightness(scene: &Scene, up: [f32; 3]) -> f32 {
    (0..3).map(|k| -up[k] * scene.settings.posture[k] as f32).sum()
}

/// Whether environment `index` has fallen by the task's rules: it touches the ground with what must not, leans too
/// far, or is too low.
pub(crate) fn fallen(scene: &Scene, motion: &Motion, index: usize) -> bool {
    let geoms = scene.batch.contact_geoms().len();
    let forces = &motion.normal_force[index * geoms..(index + 1) * geoms];
    let up = up_axis(&motion.base_quaternion[4 * index..4 * index + 4]);
    let fall = &scene.settings.fall;
    touching(forces, &scene.fall_geoms) > 0
        || uprightness(scene, up) < fall.tilt.to_radians().cos() as f32
        || motion.base_position[3 * index + 2] < fall.height as f32
}
