//! The robots of a batch: the nominal one, varied.

use gaitfit_model::Model;
use gaitfit_physics::{Params, PhysicsError, Robot};
use gaitfit_random::{Purpose, Stream};

use super::RandomisationSettings;
use super::command::within;

/// Whether robots differ by chance at all.
pub(super) fn varies(settings: &RandomisationSettings) -> bool {
    // Taken apart field by field, so that a new setting cannot be forgotten here.
    let RandomisationSettings { base_mass, base_com, kp, kd, floor_friction, frictionloss, armature, delay } =
        settings;
    let ranges = [base_mass, kp, kd, floor_friction, frictionloss, armature, delay];
    *base_com != 0.0 || ranges.into_iter().any(|[low, high]| low != high)
}

/// Robot `environment` of a randomised batch around `robot`.
pub(super) fn randomised(
    model: &Model,
    robot: &Robot,
    settings: &RandomisationSettings,
    seed: u64,
    environment: u32,
) -> Result<Params<f64>, PhysicsError> {
    let stream = Stream::new(seed, Purpose::RANDOMISATION).environment(environment);
    let mut robot = robot.clone();
    // Each quantity has a draw number of its own, so a new one does not change the others.
    robot.base_mass += within(stream, 0, settings.base_mass);
    for (k, shift) in robot.base_com.iter_mut().enumerate() {
        *shift += within(stream, 1 + k as u32, [-settings.base_com, settings.base_com]);
    }
    let (kp, kd) = (within(stream, 4, settings.kp), within(stream, 5, settings.kd));
    robot.kp.iter_mut().for_each(|gain| *gain *= kp);
    robot.kd.iter_mut().for_each(|gain| *gain *= kd);
    robot.friction_scale *= within(stream, 6, settings.floor_friction);
    let (friction, armature) =
        (within(stream, 7, settings.frictionloss), within(stream, 8, settings.armature));
    robot.frictionloss.iter_mut().for_each(|loss| *loss += friction);
    robot.armature.iter_mut().for_each(|inertia| *inertia += armature);
    let delay = within(stream, 9, settings.delay);
    robot.delay.iter_mut().for_each(|time| *time += delay);
    robot.params(model)
}
