//! Joints that a mending reading locks, and where they stood in keyframes.

use std::collections::HashSet;

use crate::attributes::Context;
use crate::kinematics::Frame;
use crate::orientation::compose;
use crate::shown::shown;
use crate::spec::BodySpec;
use crate::xml::At;

/// Where joints that were locked stood in `qpos` and `qvel`.
#[derive(Debug, Default)]
pub(crate) struct Locked {
    qpos: HashSet<usize>,
    qvel: HashSet<usize>,
    nq: usize,
    nv: usize,
}

impl Locked {
    /// A keyframe's `qpos` without the locked joints; as it is if it is of another length than the file's.
    pub fn left_of_qpos(&self, qpos: Vec<f64>) -> Vec<f64> {
        left(qpos, &self.qpos, self.nq)
    }

    /// The same of `qvel`.
    pub fn left_of_qvel(&self, qvel: Vec<f64>) -> Vec<f64> {
        left(qvel, &self.qvel, self.nv)
    }
}

fn left(values: Vec<f64>, without: &HashSet<usize>, length: usize) -> Vec<f64> {
    if values.len() != length {
        return values;
    }
    values
        .into_iter()
        .enumerate()
        .filter(|(place, _)| !without.contains(place))
        .map(|(_, value)| value)
        .collect()
}

/// A joint that is locked.
pub(crate) struct Lock {
    pub at: At,
    pub joint: String,
    /// Where it stays, from its reference, rad or m.
    pub position: f64,
    /// Why, in words.
    pub how: String,
}

/// Locks joints.
pub(crate) fn lock(ctx: &mut Context, locks: &[Lock], bodies: &mut [BodySpec]) -> Locked {
    let mut locked = Locked::default();
    let (mut q, mut v) = (0, 0);
    for body in bodies.iter_mut() {
        if body.free.is_some() {
            (q, v) = (q + 7, v + 6);
        }
        let mut kept = Vec::new();
        let alone = body.joints.len() == 1;
        for (joint, at) in std::mem::take(&mut body.joints) {
            match locks.iter().find(|lock| lock.joint == joint.name) {
                None => kept.push((joint, at)),
                Some(Lock { at, position, how, .. }) => {
                    locked.qpos.insert(q);
                    locked.qvel.insert(v);
                    if alone && *position != 0.0 {
                        let moved = joint.moved_by(&Frame::WORLD, *position);
                        (body.pos, body.quat) =
                            compose((body.pos, body.quat), (moved.position, moved.quaternion));
                    }
                    ctx.note(*at, format!("joint \"{}\"", shown(&joint.name)), how.as_str());
                }
            }
            (q, v) = (q + 1, v + 1);
        }
        body.joints = kept;
    }
    (locked.nq, locked.nv) = (q, v);
    locked
}
