//! Which of a file's bodies is the robot, and how its root is attached.

use crate::attributes::Context;
use crate::error::ModelError;
use crate::model::{FreeJoint, Model, Root};
use crate::shown::shown;
use crate::spec::Spec;

impl Model {
    /// The robot in the air: without the planes, boxes and height fields of the world, which nothing touches then. Contacts
    /// between its own parts stay.
    #[must_use]
    pub fn in_the_air(self) -> Self {
        Self { planes: Vec::new(), obstacles: Vec::new(), pairs: Vec::new(), ..self }
    }
}

/// Whether `body` is `root` or below it.
pub(crate) fn is_below(spec: &Spec, mut body: usize, root: usize) -> bool {
    // Parents have smaller numbers than their children, so the climb stops at `root` or passes it.
    while body > root {
        body = spec.bodies[body].parent;
    }
    body == root
}

/// The robot of a file.
pub(crate) struct Robot {
    /// Its root body.
    pub root: usize,
    /// The file has other moving bodies, which were dropped.
    pub others_move: bool,
}

/// The one child of the world with joints below it (or on it).
pub(crate) fn choose_robot(ctx: &mut Context, spec: &Spec) -> Result<Option<Robot>, ModelError> {
    let mut best: Option<(usize, usize)> = None;
    let mut moving = Vec::new();
    for (index, body) in spec.bodies.iter().enumerate().skip(1).filter(|(_, b)| b.parent == 0) {
        // Bodies below this one have larger numbers, so the search begins with it.
        let joints: usize = (index..spec.bodies.len())
            .filter(|&b| is_below(spec, b, index))
            .map(|b| spec.bodies[b].joints.len())
            .sum();
        // Scenery: nothing of it moves.
        if joints == 0 && body.free.is_none() {
            continue;
        }
        moving.push(index);
        // Of several the one with most joints, and the first of equals.
        if best.is_none_or(|(_, max)| joints > max) {
            best = Some((index, joints));
        }
    }
    let Some((root, _)) = best else { return Ok(None) };
    for &other in moving.iter().filter(|&&b| b != root) {
        ctx.refuse(
            spec.bodies[other].at,
            format!("body \"{}\"", shown(&spec.bodies[other].name)),
            format!("a second moving body beside \"{}\"", shown(&spec.bodies[root].name)),
            "keep one robot in the file",
        )?;
    }
    Ok(Some(Robot { root, others_move: moving.len() > 1 }))
}

/// How the root is attached: as the file has it, or as `wanted`.
pub(crate) fn attach(
    ctx: &Context,
    spec: &Spec,
    root: usize,
    wanted: Option<Root>,
) -> Result<Root, ModelError> {
    let body = &spec.bodies[root];
    let root_kind = if body.free.is_some() { Root::Floating } else { Root::Fixed };
    // A root on hinges is held by them; a free joint beside them would be another robot.
    match wanted {
        Some(Root::Floating) if !body.joints.is_empty() => Err(ctx.invalid(
            body.at,
            format!("root body \"{}\" hangs on joints and cannot float", shown(&body.name)),
            "leave the base as the file has it",
        )),
        Some(other) => Ok(other),
        None => Ok(root_kind),
    }
}

/// What resists the motion of the root's free joint, less what the file's flags switch off.
pub(crate) fn free_joint(spec: &Spec, root: usize) -> Option<FreeJoint> {
    let mut free = spec.bodies[root].free_joint?;
    if spec.disabled.frictionloss {
        free.frictionloss = 0.0;
    }
    if spec.disabled.damper {
        free.damping = 0.0;
    }
    (!free.is_plain()).then_some(free)
}

/// For every body the topmost body it is rigidly joined to; 0 is the world.
pub(crate) fn weld_roots(spec: &Spec, root: usize, floating: bool, member: &[bool]) -> Vec<usize> {
    let mut welds = vec![0; spec.bodies.len()];
    for (index, body) in spec.bodies.iter().enumerate().skip(1) {
        // Parents come before their children, so the parent's weld is known.
        let moves = if index == root {
            floating || !body.joints.is_empty()
        } else {
            // A free body of another robot moves too, although it is dropped.
            !body.joints.is_empty() || (body.free.is_some() && !member[index])
        };
        welds[index] = if moves { index } else { welds[body.parent] };
    }
    welds
}
