//! Inverse inertias at the reference pose, which set how soft MuJoCo's constraints are.
//!
//! `body_invweight0` is the mean diagonal of J M⁻¹ Jᵀ at the body's centre of mass, translation and rotation
//! apart; `dof_invweight0` the diagonal of M⁻¹ (MuJoCo, `mj_setConst`). Both depend on masses and armature, so
//! they are made anew for every robot whose parameters change.

use std::ops::Range;

use gaitfit_model::{Cholesky, Model};

use crate::compile::compile_with;
use crate::dense::{bodies, carries, mass_matrix, subspaces};
use crate::params::{JointParams, LinkInertia, PairInvweight, RobotParams};
use crate::seat::seats;
use crate::state::{Motion, State};
use crate::tree::TINY;
use crate::vec3::*;
use crate::{BodyChange, Params, PhysicsError, Preset, Settings};

/// Inverse inertias of one robot.
pub(crate) struct Invweights {
    /// Translational (1/kg) and rotational (1/(kg·m²)), one a body.
    pub bodies: Vec<[f64; 2]>,
    /// One a joint, 1/(kg·m²).
    pub joints: Vec<f64>,
    /// Of a floating base's translation (1/kg) and rotation (1/(kg·m²)), each the mean over three axes; else 1.
    pub free: [f64; 2],
}

/// Inverse inertias with the given link inertias, changed bodies and armature.
pub(crate) fn invweights(
    model: &Model,
    links: &[LinkInertia<f64>],
    changes: &[BodyChange],
    armature: &[f64],
) -> Result<Invweights, PhysicsError> {
    // Nothing is solved here, so the preset has no effect.
    let settings = Settings::new(&model.options, Preset::Fast);
    let tree = compile_with::<f64>(model, &settings, false)?;
    // The mass matrix reads nothing else of a joint.
    let joint = |armature: &f64| JointParams { armature: *armature, ..JointParams::uniform(0.0) };
    let params = Params {
        links: links.to_vec(),
        joints: armature.iter().map(joint).collect(),
        pairs: vec![PairInvweight { translation: 1.0, rotation: 1.0 }; tree.pairs.len()],
        free: vec![1.0; tree.free_weights()],
        robot: RobotParams::nominal(),
    };
    let mut state = State::<f64>::new(&tree);
    if tree.floating {
        state.base_quaternion = model.bodies[0].quat;
        state.base_position = model.bodies[0].pos;
    }
    // MuJoCo evaluates them at `qpos0`.
    for (q, joint) in state.qpos.iter_mut().zip(&model.joints) {
        *q = joint.reference;
    }
    let mass = mass_matrix(&tree, &params, &state);
    let n = tree.nv();
    let factor = Cholesky::new(mass, n);
    let links = bodies(&tree, &params, &state);
    let axes = subspaces(&tree, &links);
    let (seats, _) = seats(model);

    let bodies = model
        .bodies
        .iter()
        .zip(&seats)
        .zip(changes)
        .map(|((body, seat), change)| {
            let Motion { rotation, position, .. } = &links[seat.link].motion;
            let ipos = change.moved(body.ipos);
            let com = add(*position, rotate(rotation, add(seat.position, rotate(&seat.rotation, ipos))));
            let mut sums = [0.0; 2];
            for (part, sum) in sums.iter_mut().enumerate() {
                for k in 0..3 {
                    // Row of the Jacobian of the centre of mass, along or about the world's axis k.
                    let row: Vec<f64> = axes
                        .iter()
                        .map(|(moved, axis)| {
                            if !carries(&tree, *moved, seat.link) {
                                0.0
                            } else if part == 0 {
                                cross_add(axis[0], com, axis[1])[k]
                            } else {
                                axis[0][k]
                            }
                        })
                        .collect();
                    // J M⁻¹ Jᵀ: the inverse inertia of this direction.
                    *sum += factor.inverse_form(&row);
                }
            }
            // MuJoCo leaves bodies that nothing moves at zero; here they never touch.
            [(sums[0] / 3.0).max(TINY), (sums[1] / 3.0).max(TINY)]
        })
        .collect();
    let first = n - tree.joints();
    let weight = |dof: usize| factor.inverse_diagonal(dof);
    let joints = (0..tree.joints()).map(|j| weight(first + j)).collect();
    // MuJoCo takes one mean of a free joint's translations and one of its rotations.
    let mean = |dofs: Range<usize>| dofs.map(weight).sum::<f64>() / 3.0;
    let free = if tree.floating { [mean(0..3), mean(3..6)] } else { [1.0; 2] };
    Ok(Invweights { bodies, joints, free })
}
