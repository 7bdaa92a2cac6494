//! What joints, ground and inertial unit have beyond the model, one effect at a time.
//!
//! Legs in the air obey the equations of `equations`, and heights of feet that stand together agree. An effect adds a column
//! to these equations. What the column explains of what is left, after all that a model has anyway, is the effect's estimate
//! (the added-variable regression of Frisch and Waugh 1933, "Partial time regressions as compared with individual trends",
//! Econometrica 1), with an error by the scatter among blocks of time.

use crate::equations::{Window, windows};
use crate::feet::Ground;
use crate::regression::{Group, SHARED, solve};
use crate::report::{SwingReport, SwingSettings};
use crate::singles::{self, Singles};
use crate::stance;
use crate::torques::Drag;
use crate::walk::Walk;
use gaitfit_log::{BLOCK_S, Estimate};
use gaitfit_model::Model;
use nalgebra::{DMatrix, DVector};
use serde::{Deserialize, Serialize};
use std::collections::BTreeMap;

/// Fewer blocks say nothing of an error.
const BLOCKS: usize = 8;

/// Kind of an effect.
#[derive(Clone, Copy, Debug, PartialEq, Eq, PartialOrd, Ord, Hash, Serialize, Deserialize)]
#[serde(rename_all = "snake_case")]
pub enum EffectKind {
    /// Dry friction grows with the motor's torque; N·m for each N·m.
    LoadFriction,
    /// A joint has other dry friction than the same joints of other legs, N·m.
    OddFriction,
    /// A joint has a spring that the same joints of other legs do not have, N·m/rad.
    OddSpring,
    /// A joint's motor gives more (positive) or less than its commands ask for, unlike the same joints of other legs; part.
    OddStrength,
    /// Links respond to their motors more (positive) or less than their masses imply; part of the torque. Play, twist and weak
    /// motors look so.
    Strength,
    /// The joint twists between motor and link, rad for each N·m.
    Elasticity,
    /// The joint has play between motor and link, rad.
    Backlash,
    /// Feet that stand together are not at one height, m, root mean square: ground that gives way, steps.
    UnevenGround,
}

/// An effect as the logs show it.
#[derive(Clone, Debug, PartialEq, Serialize, Deserialize)]
pub struct Effect {
    /// Its kind.
    pub kind: EffectKind,
    /// The joint group or joint that has it; empty of the ground.
    pub of: String,
    /// Its size in the logs, and its standard error. If it is compared, the logs are at the policy's rate.
    pub size: Estimate,
    /// Mean and standard deviation of the same estimate in logs of simulated robots without the effect; absent if there is no
    /// comparison.
    #[serde(default, skip_serializing_if = "Option::is_none")]
    pub without: Option<Estimate>,
    /// The part of what is left unexplained, in the signal that shows it, that goes with it, 0 to 1.
    pub share: f64,
    /// Rest angle of a spring, rad; absent for other effects.
    #[serde(default, skip_serializing_if = "Option::is_none")]
    pub rest: Option<f64>,
}

impl Effect {
    /// An effect that is no spring.
    pub fn new(kind: EffectKind, of: &str, size: Estimate, share: f64) -> Self {
        Self { kind, of: of.to_owned(), size, without: None, share, rest: None }
    }

    /// Whether both are of one kind and joint or group.
    pub fn is_same(&self, other: &Self) -> bool {
        (self.kind, &self.of) == (other.kind, &other.of)
    }

    /// The size beyond that of simulated robots without the effect, and its standard error.
    pub fn beyond(&self) -> Estimate {
        let Estimate { value, error } = self.size;
        match self.without {
            Some(without) => Estimate { value: value - without.value, error: error.hypot(without.error) },
            None => self.size,
        }
    }

    /// How many standard errors [`Self::beyond`] is from 0.
    pub fn sure(&self) -> f64 {
        let Estimate { value, error } = self.beyond();
        if error > 0.0 { value.abs() / error } else { 0.0 }
    }
}

/// Walks of one robot, and what is known of its joints from its legs in the air.
pub(crate) struct Scene<'a> {
    pub model: &'a Model,
    pub walks: &'a [Walk],
    pub groups: Vec<(String, Vec<usize>)>,
    pub settings: SwingSettings,
    /// Delay of targets, s.
    pub delay: f64,
    /// Friction, damping and armature, one entry a joint.
    pub drag: Vec<Drag>,
    /// One entry a walk.
    pub grounds: Vec<Ground>,
}

impl<'a> Scene<'a> {
    fn new(model: &'a Model, walks: &'a [Walk], swings: &SwingReport, settings: &SwingSettings) -> Self {
        let groups = settings.groups_of(model);
        let settings = settings.of_walks(walks);
        let delay = swings.delay.value;
        let mut drag = vec![Drag::default(); model.joints.len()];
        for (name, joints) in &groups {
            if let Some(group) = swings.groups.iter().find(|group| group.group == *name) {
                joints.iter().for_each(|&joint| drag[joint] = group.drag());
            }
        }
        // The second look knows from the first how the base moves.
        let grounds = gaitfit_pool::map(walks.len(), settings.threads, |log| {
            let first = Ground::new(model, &walks[log], delay, &drag, None);
            Ground::new(model, &walks[log], delay, &drag, Some(&first))
        });
        Self { model, walks, groups, settings, delay, drag, grounds }
    }
}

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
    let Some(equations) = Equations::new(group, steps) else { return Vec::new() };
    let Some(base) = equations.base() else { return Vec::new() };
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

/// The equations of a group's swings at a delay.
pub(crate) struct Equations {
    rows: Vec<Vec<f64>>,
    /// The sides that are known, N·m.
    pub known: Vec<f64>,
    weights: Vec<f64>,
    blocks: Vec<u64>,
}

impl Equations {
    /// `steps`: the delay in steps. Absent if the windows do not determine the group's numbers.
    pub fn new(group: &Group<'_>, steps: f64) -> Option<Self> {
        let solution = solve(group, steps)?;
        // The delay is a number of the model too.
        let row = |window: &&Window| {
            let mut row = vec![0.0; group.columns()];
            group.row(window).iter().for_each(|&(place, factor)| row[place] += factor);
            row.push(window.torque(steps + 0.5) - window.torque(steps - 0.5));
            row
        };
        Some(Self {
            rows: group.windows.iter().map(row).collect(),
            known: group.windows.iter().map(|window| window.torque(steps)).collect(),
            weights: solution.weights,
            blocks: group.windows.iter().map(|window| block(window.log, window.at)).collect(),
        })
    }

    /// The equations solved; absent if they do not determine their unknowns.
    pub fn base(&self) -> Option<Base<'_>> {
        Base::new(&self.rows, &self.known, &self.weights, &self.blocks)
    }
}

/// A block of time of a log. The log has the upper half of the number, the block the lower one.
pub(crate) fn block(log: usize, at: f64) -> u64 {
    ((log as u64) << 32) + (at.max(0.0) / BLOCK_S) as u64
}

/// Equations that a model has anyway, solved, to which one column more is added.
pub(crate) struct Base<'a> {
    rows: &'a [Vec<f64>],
    weights: &'a [f64],
    blocks: &'a [u64],
    /// Inverse of the normal matrix.
    inverse: DMatrix<f64>,
    /// Residuals: the known side of each equation less what the solution explains of it.
    left: Vec<f64>,
}

impl<'a> Base<'a> {
    /// `None` where the equations do not determine their unknowns, or are of too few blocks.
    pub fn new(rows: &'a [Vec<f64>], known: &[f64], weights: &'a [f64], blocks: &'a [u64]) -> Option<Self> {
        let columns = rows.first()?.len();
        let distinct: std::collections::BTreeSet<u64> = blocks.iter().copied().collect();
        if distinct.len() < BLOCKS || rows.len() < 3 * (columns + SHARED) {
            return None;
        }
        let mut normal = DMatrix::zeros(columns, columns);
        for (row, weight) in rows.iter().zip(weights) {
            let row = DVector::from_column_slice(row);
            normal.ger(*weight, &row, &row, 1.0);
        }
        let inverse = normal.cholesky()?.inverse();
        let mut base = Self { rows, weights, blocks, inverse, left: Vec::new() };
        base.left = base.without(known);
        Some(base)
    }

    /// The unknowns if `column` were the known side.
    pub fn values(&self, column: &[f64]) -> DVector<f64> {
        let mut right = DVector::zeros(self.inverse.nrows());
        for ((row, value), weight) in self.rows.iter().zip(column).zip(self.weights) {
            right.axpy(weight * value, &DVector::from_column_slice(row), 1.0);
        }
        &self.inverse * right
    }

    /// A column less what the rows explain of it.
    fn without(&self, column: &[f64]) -> Vec<f64> {
        let values = self.values(column);
        let explained = |row: &Vec<f64>| row.iter().zip(values.iter()).map(|(a, b)| a * b).sum::<f64>();
        self.rows.iter().zip(column).map(|(row, value)| value - explained(row)).collect()
    }

    /// Root mean square of what the equations leave, with its error by the scatter of blocks.
    pub fn scatter(&self) -> Estimate {
        let mut sums: BTreeMap<u64, [f64; 2]> = BTreeMap::new();
        for ((left, weight), block) in self.left.iter().zip(self.weights).zip(self.blocks) {
            let sum = sums.entry(*block).or_default();
            sum[0] += weight * left * left;
            sum[1] += weight;
        }
        let total: f64 = sums.values().map(|[_, weight]| weight).sum();
        let mean = sums.values().map(|[square, _]| square).sum::<f64>() / total;
        let variance: f64 =
            sums.values().map(|[square, weight]| (square - mean * weight).powi(2)).sum::<f64>()
                / total.powi(2);
        let value = mean.max(0.0).sqrt();
        // The error of a root, to first order: half the error of the square over the root.
        Estimate { value, error: 0.5 * variance.sqrt() / value.max(1e-12) }
    }

    /// The unknown of `column` in the equations, and the part of what they leave that it explains.
    pub fn added(&self, column: &[f64]) -> Option<(Estimate, f64)> {
        let rest = self.without(column);
        let sum =
            |of: &dyn Fn(usize) -> f64| -> f64 { (0..rest.len()).map(|k| self.weights[k] * of(k)).sum() };
        let square = sum(&|k| rest[k] * rest[k]);
        let before = sum(&|k| self.left[k] * self.left[k]);
        let whole: f64 = column.iter().zip(self.weights).map(|(x, w)| w * x * x).sum();
        // What the rows explain already, but for rounding, says nothing.
        if !(square > 1e-6 * whole && before > 0.0) {
            return None;
        }
        let value = sum(&|k| rest[k] * self.left[k]) / square;
        // Errors within a block go together (Liang and Zeger 1986), so scores are summed by block before they are
        // squared.
        let mut scores: BTreeMap<u64, f64> = BTreeMap::new();
        for k in 0..rest.len() {
            let left = self.left[k] - value * rest[k];
            *scores.entry(self.blocks[k]).or_default() += self.weights[k] * rest[k] * left;
        }
        let count = scores.len() as f64;
        let variance =
            scores.values().map(|score| score * score).sum::<f64>() / square.powi(2) * count / (count - 1.0);
        let after = sum(&|k| (self.left[k] - value * rest[k]).powi(2));
        let size = Estimate { value, error: variance.sqrt() };
        size.value.is_finite().then_some((size, (1.0 - after / before).clamp(0.0, 1.0)))
    }
}
