//! Torques that motion and gravity need at every grid point, averaged by a bump in time.

use crate::dynamics::JointMomentum;
use crate::walk::Walk;
use gaitfit_model::rotation::Vec3;
use gaitfit_model::{Joint, Model};

/// A bump in time and its slope, for averages that are integrated by parts.
#[derive(Clone, Debug)]
pub(crate) struct Bump {
    /// Grid points on either side of the middle.
    pub half: usize,
    /// Weights; their sum is 1.
    pub weights: Vec<f64>,
    /// Derivatives of the weights with time, 1/s.
    pub slopes: Vec<f64>,
}

impl Bump {
    /// A bump of a length in s on a grid of `step` s: (1 − x²)³, which has two vanishing derivatives at its ends.
    pub fn new(length: f64, step: f64) -> Self {
        // With fewer than two points on each side the slope would be 0 at all of them.
        let half = (0.5 * length / step).round().max(2.0) as usize;
        let place = |k: usize| k as f64 / half as f64 - 1.0;
        let value = |x: f64| (1.0 - x * x).max(0.0).powi(3);
        let total: f64 = (0..=2 * half).map(|k| value(place(k))).sum();
        let slope = |x: f64| -6.0 * x * (1.0 - x * x).max(0.0).powi(2) / (half as f64 * step);
        Self {
            half,
            weights: (0..=2 * half).map(|k| value(place(k)) / total).collect(),
            slopes: (0..=2 * half).map(|k| slope(place(k)) / total).collect(),
        }
    }
}

/// Resistance of a joint besides that of the links it moves.
#[derive(Clone, Copy, Debug, Default, PartialEq)]
pub struct Drag {
    /// Coulomb friction, N·m.
    pub friction: f64,
    /// Viscous damping, N·m·s/rad.
    pub damping: f64,
    /// Armature, kg·m².
    pub armature: f64,
}

/// How far ahead of its velocity's sign a joint's friction turns, s, in MuJoCo's and this engine's law. There friction is a
/// soft constraint that brakes towards the reference acceleration −b q̇ with b = 2/(dmax·timeconst): it turns where
/// q̈ + b q̇ does, which is q̇ a time of 1/b later (MuJoCo's documentation, "Computation", solver parameters).
pub(crate) fn friction_lead(joint: &Joint) -> f64 {
    // A negative solref states stiffness and damping directly (MuJoCo's documentation, the same section). MuJoCo's
    // defaults, 0.02 s and dmax 0.95, give 9.5 ms.
    let [time, damping] = joint.solref_friction;
    let rate = if time > 0.0 {
        2.0 / (joint.solimp_friction[1] * time)
    } else {
        -damping / joint.solimp_friction[1]
    };
    if rate > 0.0 && rate.is_finite() { (1.0 / rate).min(0.02) } else { 0.0 }
}

/// Share of the area of (1 − x²)³ that lies below x.
fn area(x: f64) -> f64 {
    let x = x.clamp(-1.0, 1.0);
    let x2 = x * x;
    // The integral x − x³ + 3/5 x⁵ − x⁷/7, divided by its whole, 32/35.
    0.5 + 35.0 / 32.0 * x * (1.0 - x2 + 0.6 * x2 * x2 - x2 * x2 * x2 / 7.0)
}

/// Mean of a joint's target, held from sample to sample and acting `delay` s late, rad, under a bump around the time
/// `middle`. Exact, however coarse the log.
pub(crate) fn driven(walk: &Walk, bump: &Bump, joint: usize, middle: f64, delay: f64) -> f64 {
    let half = bump.half as f64 * walk.step;
    let delay = delay + walk.lead;
    let times = &walk.sample_times;
    let at = |time: f64| area((time + delay - middle) / half);
    // The sample whose target acts when the bump begins.
    let first = times.partition_point(|time| *time <= middle - half - delay).saturating_sub(1);
    // The target is a staircase: each of its steps counts with the area of the bump above it.
    let mut sum = 0.0;
    let mut before = 0.0;
    for sample in first..times.len() {
        // The last target is held beyond the log's end.
        let after = times.get(sample + 1).map_or(1.0, |next| at(*next));
        sum += (after - before) * walk.targets[sample * walk.joints + joint];
        before = after;
        // The rest of the staircase lies behind the bump.
        if after >= 1.0 {
            break;
        }
    }
    sum
}

/// The momentum form of all joints at all grid points.
#[derive(Clone, Debug)]
pub(crate) struct Needed {
    /// Momenta, N·m·s; `len × joints`; NaN where they are not known.
    pub momentum: Vec<f64>,
    /// The rest of the torque, springs of the file too, N·m; `len × joints`.
    pub rest: Vec<f64>,
}

impl Needed {
    /// For a base that moves at `velocity`, m/s, world axes, and joints without drag.
    pub fn new(model: &Model, walk: &Walk, velocity: &[Vec3]) -> Self {
        let joints = walk.joints;
        // Points in gaps or without a known base velocity stay NaN, so that no window uses them.
        let nothing = vec![f64::NAN; walk.points() * joints];
        let mut needed = Self { momentum: nothing.clone(), rest: nothing };
        for point in 0..walk.points() {
            if !walk.valid[point] || !velocity[point].iter().all(|v| v.is_finite()) {
                continue;
            }
            for (joint, parameters) in model.joints.iter().enumerate() {
                let place = point * joints + joint;
                let JointMomentum { momentum, rest, .. } = walk.poses.momenta[place].boosted(velocity[point]);
                needed.momentum[place] = momentum;
                needed.rest[place] = rest + parameters.stiffness * (walk.q[place] - parameters.springref);
            }
        }
        needed
    }

    /// The same for joints with these properties (model order).
    pub fn with_drag(&self, model: &Model, walk: &Walk, drag: &[Drag]) -> Self {
        let mut needed = self.clone();
        for (joint, Drag { friction, damping, armature }) in drag.iter().enumerate() {
            let lead = (friction_lead(&model.joints[joint]) / walk.step).round() as usize;
            for point in 0..walk.points() {
                let place = point * walk.joints + joint;
                let dq = walk.dq[place];
                needed.momentum[place] += armature * dq;
                needed.rest[place] += friction * walk.sign(joint, point, lead) + damping * dq;
            }
        }
        needed
    }

    /// Motor torque that the PD law gives, less what inertia and gravity need, N·m, averaged around `centre`: what
    /// friction, armature and contact take. NaN where a bump meets a gap or a joint has no gains.
    pub fn left(&self, walk: &Walk, bump: &Bump, joint: usize, centre: usize, delay: f64) -> f64 {
        // A bump that does not lie inside the log has no whole weight.
        let Some(first) = centre.checked_sub(bump.half) else { return f64::NAN };
        if centre + bump.half >= walk.points() {
            return f64::NAN;
        }
        let [kp, kd] = walk.gains[joint];
        let mut sum = kp * driven(walk, bump, joint, centre as f64 * walk.step, delay);
        for (k, (weight, slope)) in bump.weights.iter().zip(&bump.slopes).enumerate() {
            let place = (first + k) * walk.joints + joint;
            let motor = -kp * walk.q[place] - kd * walk.dq[place];
            sum += weight * (motor - self.rest[place]) + slope * self.momentum[place];
        }
        sum
    }
}
