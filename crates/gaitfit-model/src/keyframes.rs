//! Keyframes: defaults filled in, lengths checked, the base added or left out with the root.

use crate::attributes::Context;
use crate::error::ModelError;
use crate::model::{Keyframe, Model, Root};
use crate::rotation::normalize;
use crate::shown::shown;
use crate::spec::{KeySpec, Spec};

/// Fills `model.keyframes` from the file's keys; joints and actuators are in place already.
pub(crate) fn fill_keyframes(
    ctx: &mut Context,
    model: &mut Model,
    spec: &Spec,
    root: usize,
) -> Result<(), ModelError> {
    let body = &spec.bodies[root];
    let in_file = if body.free.is_some() { Root::Floating } else { Root::Fixed };
    let joints = model.joints.len();
    let rest: Vec<f64> = model.joints.iter().map(|j| j.reference).collect();
    let base: Vec<f64> = body.pos.iter().chain(&body.quat).copied().collect();
    // A keyframe is as long as the file's own root makes it, whatever the caller wants of the root.
    let (base_q, base_v) = if in_file == Root::Floating { (7, 6) } else { (0, 0) };
    for key in &spec.keys {
        let whole = |joint_part: &[f64]| -> Vec<f64> {
            if base_q == 7 { base.iter().chain(joint_part).copied().collect() } else { joint_part.to_vec() }
        };
        let qpos = key.qpos.clone().unwrap_or_else(|| whole(&rest));
        let qvel = key.qvel.clone().unwrap_or_else(|| vec![0.0; base_v + joints]);
        // A mending reading drops some actuators; a pose is of use without controls.
        let stated = key.ctrl.clone().filter(|ctrl| !ctx.mend || ctrl.len() == model.actuators.len());
        let ctrl = stated.unwrap_or_else(|| vec![0.0; model.actuators.len()]);
        let lengths = [
            ("qpos", qpos.len(), base_q + joints),
            ("qvel", qvel.len(), base_v + joints),
            ("ctrl", ctrl.len(), model.actuators.len()),
        ];
        if !accept_lengths(ctx, key, &lengths)? {
            continue;
        }
        let (mut base_pose, joint_pos) = (qpos[..base_q].to_vec(), &qpos[base_q..]);
        if base_q == 7 {
            // Files round the quaternion.
            let quat = normalize([base_pose[3], base_pose[4], base_pose[5], base_pose[6]]);
            base_pose[3..].copy_from_slice(&quat);
        }
        let (mut base_vel, joint_vel) = (qvel[..base_v].to_vec(), &qvel[base_v..]);
        // A caller may clamp a floating robot, or let a fixed one float.
        match (in_file, model.root) {
            (Root::Floating, Root::Fixed) => {
                base_pose.clear();
                base_vel.clear();
            }
            (Root::Fixed, Root::Floating) => {
                base_pose = base.clone();
                base_vel = vec![0.0; 6];
            }
            _ => {}
        }
        base_pose.extend_from_slice(joint_pos);
        base_vel.extend_from_slice(joint_vel);
        model.keyframes.push(Keyframe { name: key.name.clone(), qpos: base_pose, qvel: base_vel, ctrl });
    }
    Ok(())
}

fn accept_lengths(
    ctx: &mut Context,
    key: &KeySpec,
    lengths: &[(&str, usize, usize)],
) -> Result<bool, ModelError> {
    for (name, got, want) in lengths {
        if got != want {
            let what = format!("keyframe \"{}\": `{name}` has {got} numbers", shown(&key.name));
            if !ctx.drops() {
                return Err(ctx.invalid(key.at, what, format!("give {want}")));
            }
            ctx.refuse(key.at, what, format!("the model needs {want}"), "correct it")?;
            return Ok(false);
        }
    }
    Ok(true)
}
