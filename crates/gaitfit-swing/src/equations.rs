//! The equation of motion of a joint in the air, averaged over short windows.
//!
//! Motor torque = d(momentum)/dt + rest + friction·sign(q̇) + damping·q̇ + armature·q̈ + offset. Each side is multiplied by a
//! smooth bump φ that vanishes at both ends of a window and integrated; integration by parts takes the time derivatives off
//! the momentum and q̇. So nothing is differentiated, and the noise of differences does not pull armature towards 0 (the
//! weak form: Messenger & Bortz 2021, "Weak SINDy", Multiscale Modeling & Simulation 19(3)).

use crate::feet::Ground;
use crate::report::SwingSettings;
use crate::torques::{Bump, driven, friction_lead};
use crate::walk::Walk;
use gaitfit_model::Model;

/// Share of a torque limit from which on a motor counts as saturated: there the PD law does not state its torque.
const SATURATED: f64 = 0.97;
/// A joint that rests in a window may be held by friction of any size below its own; such windows do not count. Mean of
/// the smoothed |sign(q̇)|.
const MOVES: f64 = 0.6;
/// A joint this near to its limit may touch its stop, rad.
const STOP_RAD: f64 = 0.03;

/// One averaged equation.
#[derive(Clone, Debug)]
pub(crate) struct Window {
    pub joint: usize,
    pub log: usize,
    /// Number of the swing among those of the joint in the log.
    pub swing: usize,
    /// Seconds from the log's start to the window's middle.
    pub at: f64,
    /// Height that the joint's limb keeps in the window and around it, m.
    pub clearance: f64,
    /// Factor of friction: the sign of the velocity, averaged, in each law of [`crate::FrictionLaw::ALL`].
    pub signs: [f64; 2],
    /// Factors of damping and of armature: the mean velocity and acceleration of the joint.
    pub rates: [f64; 2],
    /// Position gain, N·m/rad.
    pub stiffness: f64,
    /// Mean position, rad.
    pub angle: f64,
    /// Motor torque without the target's part, N·m.
    pub motor: f64,
    /// Change of the torque with an error of the base's acceleration, kg·m, world axes.
    pub lever: [f64; 3],
    /// Torque without the target's part, less what inertia and gravity need, N·m.
    pub known: f64,
    /// The target's part of the torque at each delay, N·m.
    pub driven: Vec<f64>,
}

impl Window {
    /// The target's part of the torque at a delay, in steps from the shortest one, N·m.
    pub fn driven_at(&self, delay: f64) -> f64 {
        Delay::new(delay, self.driven.len()).driven(self)
    }

    /// The side of the equation that is known at a delay, in steps from the shortest one.
    pub fn torque(&self, delay: f64) -> f64 {
        self.known + self.driven_at(delay)
    }
}

/// A delay between two of those at which windows have a torque.
#[derive(Clone, Copy, Debug)]
pub(crate) struct Delay {
    low: usize,
    high: usize,
    fraction: f64,
}

impl Delay {
    /// `steps`: from the shortest delay. `delays`: how many delays a window has.
    pub fn new(steps: f64, delays: usize) -> Self {
        // `high` must exist. A delay beyond the table follows the line through the two delays at its end.
        let low = (steps.max(0.0) as usize).min(delays.saturating_sub(2));
        let high = (low + 1).min(delays.saturating_sub(1));
        Self { low, high, fraction: steps - low as f64 }
    }

    /// The target's part of a window's torque, N·m.
    pub fn driven(&self, window: &Window) -> f64 {
        let [low, high] = [self.low, self.high].map(|place| window.driven[place]);
        low + self.fraction * (high - low)
    }
}

/// All windows of a log, of `length` s. `delay`: as known so far, s, for saturated motors.
pub(crate) fn windows(
    model: &Model,
    walk: &Walk,
    ground: &Ground,
    settings: &SwingSettings,
    length: f64,
    delay: f64,
    log: usize,
) -> Vec<Window> {
    let (points, joints) = (walk.points(), walk.joints);
    let needed = &ground.needed;
    let bump = Bump::new(length, walk.step);
    let hop = (settings.hop_s / walk.step).round().max(1.0) as usize;
    let reach = bump.half + (settings.margin_s / walk.step).round() as usize;
    let skip = (settings.skip_s / walk.step).round() as usize;
    let min = settings.clearances_m.first().copied().unwrap_or_default();
    let delays: Vec<f64> = settings.delays().collect();
    let mut windows = Vec::new();
    for joint in (0..joints).filter(|&joint| walk.gains[joint].iter().all(|gain| gain.is_finite())) {
        let [kp, kd] = walk.gains[joint];
        let limit = model.effort(joint).unwrap_or(f64::INFINITY);
        let lead = (friction_lead(&model.joints[joint]) / walk.step).round() as usize;
        let [low, high] = model.joints[joint].range.unwrap_or([f64::NEG_INFINITY, f64::INFINITY]);
        let index = |point: usize| point * joints + joint;
        let free = |point: usize| {
            let q = walk.q[index(point)];
            walk.valid[point]
                && q > low + STOP_RAD
                && q < high - STOP_RAD
                && needed.momentum[index(point)].is_finite()
                && ground.clearance[index(point)] > min
                && ground.stands[index(point)] < settings.stands
        };
        let mut begin = skip;
        let mut swing = 0;
        while begin < points {
            if !free(begin) {
                begin += 1;
                continue;
            }
            let end = (begin..points).find(|&point| !free(point)).unwrap_or(points);
            swing += 1;
            // Windows of all joints have common middles, so that rows of one moment can share an error of the base's
            // acceleration.
            let mut centre = (begin + reach).next_multiple_of(hop);
            while centre + reach < end {
                let around = centre - reach..=centre + reach;
                let mut window = Window {
                    joint,
                    log,
                    swing,
                    at: centre as f64 * walk.step,
                    clearance: around
                        .map(|point| ground.clearance[index(point)])
                        .fold(f64::INFINITY, f64::min),
                    signs: [0.0; 2],
                    rates: [0.0; 2],
                    stiffness: kp,
                    angle: 0.0,
                    motor: 0.0,
                    // The torque changes by d(by_base · v)/dt, which is by_base · a for a lever that hardly changes
                    // in a window.
                    lever: walk.poses.momenta[index(centre)].by_base[0],
                    known: 0.0,
                    driven: Vec::new(),
                };
                let (mut moves, mut saturated) = (0.0, false);
                for (k, point) in (centre - bump.half..=centre + bump.half).enumerate() {
                    let (q, dq) = (walk.q[index(point)], walk.dq[index(point)]);
                    let (weight, change) = (bump.weights[k], bump.slopes[k]);
                    let sign = walk.sign(joint, point, 0);
                    moves += weight * sign.abs();
                    window.signs[0] += weight * sign;
                    window.signs[1] += weight * walk.sign(joint, point, lead);
                    window.motor += weight * (-kp * q - kd * dq);
                    window.angle += weight * q;
                    window.rates[0] += weight * dq;
                    // By parts: ∫ φ q̈ dt = −∫ φ̇ q̇ dt, and below −∫ φ dp/dt dt = ∫ φ̇ p dt. The bump vanishes at
                    // both ends.
                    window.rates[1] -= change * dq;
                    window.known += weight * (-kp * q - kd * dq - needed.rest[index(point)])
                        + change * needed.momentum[index(point)];
                    // A saturated motor's torque depends on the delay, so the best delay so far decides.
                    let target = walk.target(joint, point as f64 * walk.step, delay);
                    saturated |= (kp * (target - q) - kd * dq).abs() > SATURATED * limit;
                }
                if moves > MOVES && !saturated && window.known.is_finite() {
                    let torque = |delay: &f64| kp * driven(walk, &bump, joint, window.at, *delay);
                    window.driven = delays.iter().map(torque).collect();
                    if window.driven.iter().all(|torque| torque.is_finite()) {
                        windows.push(window);
                    }
                }
                centre += hop;
            }
            begin = end;
        }
    }
    windows
}
