//! What feet that stand together show: play and twist of joints, ground that gives way.
//!
//! Feet that stand on level ground are at one height. Angles of the motors and the base's orientation say at which height
//! each is. What they disagree by goes with the torques of the joints (a joint that twists or has play), or stays (ground
//! that gives way, steps). A tilted inertial unit or a sloping floor are taken out first.

use crate::effects::{Base, Effect, EffectKind, block};
use crate::feet::{Foot, Ground};
use crate::poses::End;
use crate::standing::MIN_FEET;
use crate::torques::{Bump, Drag};
use crate::walk::Walk;
use gaitfit_log::Estimate;
use gaitfit_model::rotation::{cross, rotate_back, sub, up};
use gaitfit_model::{Model, Root};

/// Feet that stand this much count.
const STANDS: f64 = 0.5;
/// Time over which a joint's torque is averaged, s.
const TORQUE_S: f64 = 0.03;
/// Torque at which a joint with play surely lies on one side of it, N·m.
const SIDE_NM: f64 = 0.5;

/// Moments that are looked at, over all logs: neighbours are alike, and more would not be surer.
const MAX_POINTS: usize = 60_000;

/// One pair of standing feet: what each effect adds to the difference of their heights.
struct Pair {
    block: u64,
    between: f64,
    tilt: [f64; 2],
    /// One a group: twist under 1 N·m, and half the play.
    twist: Vec<f64>,
    play: Vec<f64>,
}

/// See [`crate::effects()`].
pub(crate) fn effects(
    model: &Model,
    walks: &[Walk],
    grounds: &[Ground],
    groups: &[(String, Vec<usize>)],
    delay: f64,
    drag: &[Drag],
) -> Vec<Effect> {
    let feet = grounds.first().and_then(|ground| ground.feet.first()).map_or(0, Vec::len);
    if model.root == Root::Fixed || feet < MIN_FEET {
        return Vec::new();
    }
    let every = walks.iter().map(Walk::points).sum::<usize>().div_ceil(MAX_POINTS).max(1);
    let look = Look { model, groups, delay, drag, every };
    let seen = walks.iter().zip(grounds).enumerate();
    let pairs: Vec<Pair> = seen.flat_map(|(log, (walk, ground))| look.pairs(walk, ground, log)).collect();
    let weights = vec![1.0; pairs.len()];
    let blocks: Vec<u64> = pairs.iter().map(|pair| pair.block).collect();
    let heights: Vec<f64> = pairs.iter().map(|pair| pair.between).collect();
    let tilts: Vec<Vec<f64>> = pairs.iter().map(|pair| pair.tilt.to_vec()).collect();
    let mut found = Vec::new();
    if let Some(base) = Base::new(&tilts, &heights, &weights, &blocks) {
        found.push(Effect::new(EffectKind::UnevenGround, "", base.scatter(), 1.0));
        let mut add = |kind: EffectKind, of: &str, scale: f64, column: Vec<f64>| {
            if let Some((size, share)) = base.added(&column) {
                let size = Estimate { value: scale * size.value, error: scale * size.error };
                found.push(Effect::new(kind, of, size, share));
            }
        };
        for (place, (name, _)) in groups.iter().enumerate() {
            add(EffectKind::Elasticity, name, 1.0, pairs.iter().map(|pair| pair.twist[place]).collect());
            add(EffectKind::Backlash, name, 2.0, pairs.iter().map(|pair| pair.play[place]).collect());
        }
    }
    found
}

/// What is looked at in every walk.
struct Look<'a> {
    model: &'a Model,
    groups: &'a [(String, Vec<usize>)],
    /// Delay of targets, s.
    delay: f64,
    /// Friction, damping and armature, one entry a joint.
    drag: &'a [Drag],
    /// Every how many grid points feet are looked at.
    every: usize,
}

impl Look<'_> {
    /// Pairs of feet that stand in a walk, the log of that number.
    fn pairs(&self, walk: &Walk, ground: &Ground, log: usize) -> Vec<Pair> {
        let Self { model, groups, delay, drag, every } = *self;
        let mut pairs = Vec::new();
        let needed = ground.needed.with_drag(model, walk, drag);
        let bump = Bump::new(TORQUE_S, walk.step);
        for point in (0..walk.points()).step_by(every).filter(|&point| walk.valid[point]) {
            let feet: Vec<(&Foot, &End)> = ground.feet[point]
                .iter()
                .zip(&walk.poses.ends)
                .filter(|(foot, _)| foot.stands > STANDS && foot.load.is_finite())
                .collect();
            if feet.len() < 2 {
                continue;
            }
            let turn = walk.quaternion[point];
            let torque: Vec<f64> = (0..walk.joints)
                .map(|joint| needed.left(walk, &bump, joint, point, delay))
                .map(|torque| if torque.is_finite() { torque } else { 0.0 })
                .collect();
            // How far an effect lowers a foot.
            let lowered = |end: &End, joints: &[usize], by: &dyn Fn(f64) -> f64| -> f64 {
                let levers = end.chain.iter().zip(walk.poses.levers(point, end));
                levers
                    .filter(|(joint, _)| joints.contains(joint))
                    .map(|(&joint, lever)| lever[2] * by(torque[joint]))
                    .sum()
            };
            for (k, (foot, end)) in feet.iter().enumerate() {
                for (other, other_end) in &feet[k + 1..] {
                    let between = sub(foot.point, other.point);
                    let lever = cross(rotate_back(turn, between), up(turn));
                    let apart = |joints: &[usize], by: &dyn Fn(f64) -> f64| {
                        lowered(end, joints, by) - lowered(other_end, joints, by)
                    };
                    pairs.push(Pair {
                        block: block(log, point as f64 * walk.step),
                        between: between[2],
                        tilt: [lever[0], lever[1]],
                        twist: groups.iter().map(|(_, joints)| apart(joints, &|torque| torque)).collect(),
                        play: groups
                            .iter()
                            .map(|(_, joints)| apart(joints, &|torque| (torque / SIDE_NM).tanh()))
                            .collect(),
                    });
                }
            }
        }
        pairs
    }
}
