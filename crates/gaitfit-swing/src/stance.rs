//! What feet that stand together show: play and twist of joints, ground that gives way.
//!
//! Feet that stand on level ground are at one height. Angles of the motors and the base's orientation say at which height
//! each is. What they disagree by goes with the torques of the joints (a joint that twists or has play), or stays (ground
//! that gives way, steps). A tilted inertial unit or a sloping floor and errors of the encoders' zeros are taken out first.

use crate::added::{Base, block};
use crate::effect::{Effect, EffectKind};
use crate::feet::Foot;
use crate::scene::Scene;
use crate::standing::{MIN_FEET, STANDS, tilt_lever};
use crate::torques::Bump;
use gaitfit_log::Estimate;
use gaitfit_model::Root;
use gaitfit_model::rotation::sub;
use nalgebra::{DMatrix, DVector};

/// Time over which a joint's torque is averaged, s.
const TORQUE_S: f64 = 0.03;
/// Torque at which a joint with play surely lies on one side of it, N·m.
const SIDE_NM: f64 = 0.5;

/// Pairs of standing feet that are looked at, over all logs: neighbours are alike, so more would not be surer but
/// take more memory.
const MAX_PAIRS: usize = 60_000;
/// A column counts if at least this part of its square does not follow from earlier columns.
const OWN_PART: f64 = 1e-3;

/// One pair of standing feet: what each effect adds to the difference of their heights.
struct Pair {
    block: u64,
    between: f64,
    tilt: [f64; 2],
    /// One a joint: an error of its encoder's zero of 1 rad.
    zeros: Vec<f64>,
    /// One a group: twist under 1 N·m, and half the play.
    twist: Vec<f64>,
    play: Vec<f64>,
}

impl Pair {
    fn is_finite(&self) -> bool {
        let numbers = [&[self.between][..], &self.tilt, &self.zeros, &self.twist, &self.play];
        numbers.into_iter().flatten().all(|number| number.is_finite())
    }
}

/// See [`crate::effects()`].
pub(crate) fn effects(scene: &Scene<'_>) -> Vec<Effect> {
    let Some(pairs) = Pairs::new(scene) else { return Vec::new() };
    let mut effects = Vec::new();
    // First with the tilt alone: what is left of the heights is the unevenness of the ground, errors of encoders
    // included.
    let tilts = pairs.rows(|pair| pair.tilt.to_vec());
    if let Some(base) = pairs.base(&tilts) {
        effects.push(Effect::new(EffectKind::UnevenGround, "", base.scatter(), 1.0));
    }
    // The torque of a standing leg's joint rarely changes its sign, so play looks like a wrong zero of its encoder.
    let rows = independent(pairs.rows(|pair| [&pair.tilt[..], &pair.zeros].concat()));
    let Some(base) = pairs.base(&rows) else { return effects };
    let mut add = |kind: EffectKind, of: &str, scale: f64, column: Vec<f64>| {
        if let Some((size, share)) = base.added(&column) {
            let size = Estimate { value: scale * size.value, error: scale * size.error };
            effects.push(Effect::new(kind, of, size, share));
        }
    };
    for (place, (name, _)) in scene.groups.iter().enumerate() {
        add(EffectKind::Elasticity, name, 1.0, pairs.column(|pair| pair.twist[place]));
        // The column holds half of the play, see `Pair::play`.
        add(EffectKind::Backlash, name, 2.0, pairs.column(|pair| pair.play[place]));
    }
    effects
}

/// See [`crate::tilt_beside_twist()`].
pub(crate) fn tilt_beside_twist(scene: &Scene<'_>, group: &str) -> Option<[Estimate; 2]> {
    let place = scene.groups.iter().position(|(name, _)| name == group)?;
    let pairs = Pairs::new(scene)?;
    let about = |axis: usize| {
        let rows = pairs.rows(|pair| vec![pair.twist[place], pair.tilt[1 - axis]]);
        let (tilt, _) = pairs.base(&rows)?.added(&pairs.column(|pair| pair.tilt[axis]))?;
        Some(tilt)
    };
    Some([about(0)?, about(1)?])
}

/// The rows without the columns that follow from earlier ones, by the pivots of a Cholesky factorisation of their products.
fn independent(rows: Vec<Vec<f64>>) -> Vec<Vec<f64>> {
    let columns = rows.first().map_or(0, Vec::len);
    let mut left = DMatrix::<f64>::zeros(columns, columns);
    for row in &rows {
        let row = DVector::from_column_slice(row);
        left.ger(1.0, &row, &row, 1.0);
    }
    let whole: Vec<f64> = (0..columns).map(|k| left[(k, k)]).collect();
    let mut kept = Vec::new();
    for k in 0..columns {
        let pivot = left[(k, k)];
        if pivot > OWN_PART * whole[k] {
            kept.push(k);
            let column = left.column(k).into_owned();
            left.ger(-1.0 / pivot, &column, &column, 1.0);
        }
    }
    rows.into_iter().map(|row| kept.iter().map(|&k| row[k]).collect()).collect()
}

/// The pairs of standing feet of all walks.
struct Pairs {
    pairs: Vec<Pair>,
    weights: Vec<f64>,
    blocks: Vec<u64>,
    heights: Vec<f64>,
}

impl Pairs {
    /// Absent for robots whose feet do not stand alike.
    fn new(scene: &Scene<'_>) -> Option<Self> {
        let feet = scene.grounds.first().and_then(|ground| ground.feet.first()).map_or(0, Vec::len);
        if scene.model.root == Root::Fixed || feet < MIN_FEET {
            return None;
        }
        let standing = scene.grounds.iter().flat_map(|ground| &ground.feet);
        let count: usize =
            standing.map(|feet| pairs_of(feet.iter().filter(|foot| stands(foot)).count())).sum();
        let every = count.div_ceil(MAX_PAIRS).max(1);
        let pairs: Vec<Pair> = (0..scene.walks.len()).flat_map(|log| scene.pairs(log, every)).collect();
        Some(Self {
            weights: vec![1.0; pairs.len()],
            blocks: pairs.iter().map(|pair| pair.block).collect(),
            heights: pairs.iter().map(|pair| pair.between).collect(),
            pairs,
        })
    }

    fn rows(&self, row: impl Fn(&Pair) -> Vec<f64>) -> Vec<Vec<f64>> {
        self.pairs.iter().map(row).collect()
    }

    fn column(&self, of: impl Fn(&Pair) -> f64) -> Vec<f64> {
        self.pairs.iter().map(of).collect()
    }

    /// The heights, explained by `rows`.
    fn base<'a>(&'a self, rows: &'a [Vec<f64>]) -> Option<Base<'a>> {
        Base::new(rows, &self.heights, &self.weights, &self.blocks)
    }
}

/// Whether a foot stands.
fn stands(foot: &Foot) -> bool {
    foot.stands > STANDS && foot.load.is_finite()
}

/// Pairs of that many feet.
fn pairs_of(feet: usize) -> usize {
    feet * feet.saturating_sub(1) / 2
}

/// A foot that stands.
struct StandingFoot<'a> {
    foot: &'a Foot,
    /// The joints above it, and how far 1 rad of each lowers it, m.
    levers: Vec<(usize, f64)>,
}

impl StandingFoot<'_> {
    /// Height by which angles of these joints, rad, lower the foot, m.
    fn lowered(&self, joints: &[usize], angle: impl Fn(usize) -> f64) -> f64 {
        let of_group = self.levers.iter().filter(|(joint, _)| joints.contains(joint));
        of_group.map(|&(joint, lever)| lever * angle(joint)).sum()
    }
}

impl Scene<'_> {
    /// Pairs of feet that stand in a walk, the log of that number, at one of `every` points of its grid.
    fn pairs(&self, log: usize, every: usize) -> Vec<Pair> {
        let Self { model, groups, delay, drag, .. } = self;
        let (walk, ground) = (&self.walks[log], &self.grounds[log]);
        let mut pairs = Vec::new();
        // Drag is taken off: what is left of the motor's torque is what the contact takes.
        let needed = ground.needed.with_drag(model, walk, drag);
        let bump = Bump::new(TORQUE_S, walk.step);
        for point in (0..walk.points()).step_by(every).filter(|&point| walk.valid[point]) {
            let ends = ground.feet[point].iter().zip(&walk.poses.ends).filter(|(foot, _)| stands(foot));
            let feet: Vec<StandingFoot<'_>> = ends
                .map(|(foot, end)| {
                    let heights = walk.poses.levers(point, end).iter().map(|lever| lever[2]);
                    StandingFoot { foot, levers: end.chain.iter().copied().zip(heights).collect() }
                })
                .collect();
            if feet.len() < 2 {
                continue;
            }
            let turn = walk.quaternion[point];
            let torque: Vec<f64> = (0..walk.joints)
                .map(|joint| needed.left(walk, &bump, joint, point, *delay))
                // Without gains a joint's torque is unknown. With 0 it has no part in twist and play.
                .map(|torque| if torque.is_finite() { torque } else { 0.0 })
                .collect();
            // Every pair of standing feet is one equation: differences of heights do not depend on the base's
            // height.
            for (k, one) in feet.iter().enumerate() {
                for other in &feet[k + 1..] {
                    let between = sub(one.foot.point, other.foot.point);
                    let apart = |joints: &[usize], angle: &dyn Fn(usize) -> f64| {
                        one.lowered(joints, angle) - other.lowered(joints, angle)
                    };
                    let of_groups = |angle: &dyn Fn(usize) -> f64| -> Vec<f64> {
                        groups.iter().map(|(_, joints)| apart(joints, angle)).collect()
                    };
                    let pair = Pair {
                        block: block(log, point as f64 * walk.step),
                        between: between[2],
                        tilt: tilt_lever(turn, between),
                        zeros: (0..walk.joints).map(|joint| apart(&[joint], &|_| 1.0)).collect(),
                        twist: of_groups(&|joint| torque[joint]),
                        // Play moves a joint to the side that its torque pushes to. A smooth step, because at
                        // small torques the side is not sure.
                        play: of_groups(&|joint| (torque[joint] / SIDE_NM).tanh()),
                    };
                    pairs.extend(Some(pair).filter(Pair::is_finite));
                }
            }
        }
        pairs
    }
}
