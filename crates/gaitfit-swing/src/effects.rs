//! What joints, ground and inertial unit have beyond the model, one effect at a time.
//!
//! Legs in the air obey the equations of `equations`, and heights of feet that stand together agree. An effect adds a column
//! to these equations. What the column explains of what is left, after all that a model has anyway, is the effect's estimate
//! (the added-variable regression of Frisch and Waugh 1933, "Partial time regressions as compared with individual trends",
//! Econometrica 1), with an error by the scatter among blocks of time.

use crate::added::Equations;
use crate::effect::{Effect, EffectKind};
use crate::equations::{Window, windows};
use crate::regression::Group;
use crate::report::{SwingReport, SwingSettings};
use crate::scene::Scene;
use crate::singles::{self, Singles};
use crate::stance;
use crate::walk::Walk;
use gaitfit_log::Estimate;
use gaitfit_model::Model;

/// All effects of the walks of one robot, as large as they come out, each alone. `swings`: what [`crate::estimate_walks`] found
/// in the same walks.
pub fn effects(model: &Model, walks: &[Walk], swings: &SwingReport, settings: &SwingSettings) -> Vec<Effect> {
    let scene = Scene::new(model, walks, swings, settings);
    let Scene { groups, settings, delay, grounds, .. } = &scene;
    let of_log =
        |log: usize| windows(model, &walks[log], &grounds[log], settings, settings.window_s, *delay, log);
    let seen: Vec<Window> = gaitfit_pool::map(walks.len(), settings.threads, of_log).concat();
    let law = crate::FrictionLaw::ALL.iter().position(|law| *law == swings.law).unwrap_or_default();
    let steps = (delay - settings.delay_range_s[0]) / settings.delay_step_s;
    let (mut effects, mut of_joints) = (Vec::new(), Singles::default());
    for (name, joints) in groups {
        let in_air =
            |window: &&Window| window.clearance > swings.clearance_m && joints.contains(&window.joint);
        let group = Group::new(seen.iter().filter(in_air).collect(), law);
        effects.extend(of_swings(model, name, joints, &group, steps, law));
        let seen = singles::seen(&seen, joints, settings, swings.clearance_m);
        of_joints.add(name, joints, &Group::new(seen, law), steps);
    }
    effects.extend(of_joints.odd(model));
    effects.extend(stance::effects(&scene));
    effects
}

/// The tilt of the IMU about the base's x and y axes, rad, that remains in the walks if the joints of `group` twist under load.
/// A robot on soft joints leans, which looks like a tilted IMU. Absent if the walks cannot separate tilt and twist.
pub fn tilt_beside_twist(
    model: &Model,
    walks: &[Walk],
    swings: &SwingReport,
    settings: &SwingSettings,
    group: &str,
) -> Option<[Estimate; 2]> {
    stance::tilt_beside_twist(&Scene::new(model, walks, swings, settings), group)
}

/// Effects that the swings of one group show. `steps`: the delay in steps.
fn of_swings(
    model: &Model,
    name: &str,
    joints: &[usize],
    group: &Group<'_>,
    steps: f64,
    law: usize,
) -> Vec<Effect> {
    // Without enough equations, or with unknowns that they do not determine, no effect can be told apart.
    let Some(equations) = Equations::new(group, steps) else { return Vec::new() };
    let Some(base) = equations.base() else { return Vec::new() };
    // `window.motor` lacks the target's part, which depends on the delay.
    let motor = |window: &Window| window.motor + window.driven_at(steps);
    let column =
        |of: &dyn Fn(&Window) -> f64| -> Vec<f64> { group.windows.iter().map(|window| of(window)).collect() };
    let mut effects = Vec::new();
    let mut add = |kind: EffectKind, of: &str, column: &[f64], scale: f64| {
        if let Some((size, share)) = base.added(column) {
            let size = Estimate { value: scale * size.value, error: scale.abs() * size.error };
            effects.push(Effect::new(kind, of, size, share));
        }
    };
    add(EffectKind::LoadFriction, name, &column(&|one| one.signs[law] * motor(one).abs()), 1.0);
    // More torque than asked for stands on the known side.
    add(EffectKind::Strength, name, &column(&motor), -1.0);
    // A joint without siblings in its group cannot be odd.
    if joints.len() > 1 {
        let odd = |joint: usize| {
            let friction = column(&|one: &Window| if one.joint == joint { one.signs[law] } else { 0.0 });
            let (size, share) = base.added(&friction)?;
            Some(Effect::new(EffectKind::OddFriction, &model.joints[joint].name, size, share))
        };
        effects.extend(joints.iter().filter_map(|&joint| odd(joint)));
    }
    effects
}
