//! Torques from targets: the PD controller with its delay, and the model's own actuators.

use gaitfit_model::Model;

use crate::modify::Engaged;
use crate::robot::MAX_SPEED;
use crate::{JointParams, Params, Real, Settings, State};

/// What drives one joint during one physics step.
#[derive(Clone, Copy, Debug)]
pub struct Drive<T> {
    /// Torque, N·m.
    pub torque: T,
    /// Minus its derivative by joint velocity, N·m·s/rad (used where actuators are integrated implicitly).
    pub damping: T,
    /// A further such derivative, N·m·s/rad, that enters the solver's matrix under all settings, so that contacts feel
    /// it too.
    pub resistance: T,
    /// The gear between motor and link, where a step has gears: the link then feels this and neither the rotor's inertia
    /// nor its friction and damping.
    pub gear: Option<Engaged<T>>,
}

impl<T: Real> Drive<T> {
    /// No torque.
    pub fn zero() -> Self {
        Self { torque: T::zero(), damping: T::zero(), resistance: T::zero(), gear: None }
    }
}

/// PD torques of all joints in the physics step that begins `clock` physics steps after the start of a control period
/// of `substeps`.
///
/// `targets` holds the sent targets (rad; rad/s where `velocities` is set), newest first: `targets[k · joints + j]` was sent `k` control periods
/// ago. A target acts from its sending time plus the joint's delay until the next one does; the step uses the
/// mean over its own duration of the target in force, so that the result is continuous in the delay. The oldest
/// target stands for all before it.
///
/// With the settings' `centred` the mean is over the interval around the step's start instead.
///
/// torque = clamp(torque_scale · (kp (target − reading) − kd q̇) + torque_offset, ± torque_limit),
/// reading = q + encoder_bias. Where a joint's target is a velocity, kd · target stands for the term with kp. Where a joint has a no-load speed its limits are those of [`motor`].
#[inline(always)]
pub(crate) fn pd<T: Real>(
    settings: &Settings,
    velocities: &[bool],
    params: &Params<T>,
    state: &State<T>,
    targets: &[T],
    clock: T,
    substeps: usize,
    drives: &mut [Drive<T>],
) {
    let n = drives.len();
    let taps = targets.len() / n;
    let z = T::zero();
    // Slices of one length, which is looked at once.
    let (joints, newest, velocities) = (&params.joints[..n], &targets[..n], &velocities[..n]);
    let (qpos, qvel) = (&state.qpos[..n], &state.qvel[..n]);
    for j in 0..n {
        let p = &joints[j];
        // A history of one target leaves nothing to delay.
        let mut target = newest[j];
        if taps > 1 {
            // In units of one physics step: this step covers [start, start + 1] on the clock of effects.
            let lead = settings.drive_lead();
            let begin = if lead == 0.0 { clock } else { clock - T::lit(lead / settings.timestep) };
            let start = begin - p.delay * T::lit(1.0 / settings.timestep);
            let end = start + T::lit(1.0);
            let mut sum = z;
            for k in 0..taps {
                // Target k counts with the part of this step in which it is in force: from its sending until
                // that of target k − 1. The newest has no end, the oldest no beginning.
                // In physics steps: the next newer target was sent k − 1 control periods before this one began.
                let until = T::lit((1.0 - k as f64) * substeps as f64);
                let upper = if k == 0 { end } else { end.min(until) };
                let since = T::lit(-(k as f64) * substeps as f64);
                let lower = if k + 1 == taps { start } else { start.max(since) };
                sum = targets[k * n + j].fma((upper - lower).max(z), sum);
            }
            // The parts cover the step, whose length is 1 here, so the weighted sum is the mean.
            target = sum;
        }
        // The same branch for all lanes: the kind of a target is part of the robot's structure.
        let push = if velocities[j] { p.kd * target } else { p.kp * (target - (qpos[j] + p.encoder_bias)) };
        let torque = p.torque_scale.fma(p.kd.fnma(qvel[j], push), p.torque_offset);
        // Without a no-load speed the limit is the same in both directions and at every speed.
        let mut reach = [Reach { limit: p.torque_limit, fall: z }; 2];
        let falling = p.no_load_speed.unless_ge(T::lit(MAX_SPEED));
        if T::enter(falling) {
            let [up, down] = [motor(p, qvel[j]), motor(p, -qvel[j])];
            T::leave(falling);
            reach = [up.merge(falling, reach[0]), down.merge(falling, reach[1])];
        }
        let [up, down] = reach;
        drives[j].torque = torque.clamp(-down.limit, up.limit);
        drives[j].resistance = z;
        // A saturated torque does not depend on velocity, but for what its limit does.
        drives[j].damping = if settings.implicit_actuators {
            let below = T::select_lt(-down.limit, torque, p.torque_scale * p.kd, down.fall);
            T::select_lt(torque, up.limit, below, up.fall)
        } else {
            z
        };
    }
}

/// Largest torque in one direction, N·m, and how much it falls with the velocity in that direction, N·m·s/rad.
#[derive(Clone, Copy)]
struct Reach<T> {
    limit: T,
    fall: T,
}

impl<T: Real> Reach<T> {
    #[inline(always)]
    fn merge(self, guard: T::Guard, before: Self) -> Self {
        Self { limit: self.limit.merge(guard, before.limit), fall: self.fall.merge(guard, before.fall) }
    }
}

/// Largest torque of a direct-current motor that turns at velocity `qd` in the torque's direction:
/// clip(stall_torque · (1 − q̇ / no_load_speed), 0, torque_limit), as Isaac Lab's `DCMotor` has it.
#[inline(always)]
fn motor<T: Real>(p: &JointParams<T>, qd: T) -> Reach<T> {
    let (z, most) = (T::zero(), T::lit(MAX_SPEED));
    let fall = p.stall_torque.div(p.no_load_speed);
    let line = fall.fma(-qd, p.stall_torque);
    // Between the flat limit and 0 the line itself is the limit. On either side the limit does not change with
    // speed.
    let slope = T::select_lt(line, p.torque_limit, T::select_lt(z, line, fall, z), z);
    // Of a motor without a no-load speed in another lane nothing falls.
    Reach {
        limit: T::select_lt(p.no_load_speed, most, line.max(z).min(p.torque_limit), p.torque_limit),
        fall: T::select_lt(p.no_load_speed, most, slope, z),
    }
}

/// Target history long enough for delays up to `max_delay` (s) at control period `period` (s); the mean over a
/// step can reach back half a step more if `centred`.
pub fn delay_taps(max_delay: f64, period: f64, centred: bool) -> usize {
    let reach = max_delay + if centred { 0.5 * period } else { 0.0 };
    // One more than whole periods, because a step may see the change from one target to the next.
    if reach > 0.0 { (reach / period).ceil() as usize + 1 } else { 1 }
}

/// Drives from the model's actuators at controls `ctrl` (MuJoCo's `actuator` computation without dynamics).
///
/// `ctrl` is as long as `model.actuators`; `qpos_joints` and `qvel_joints` hold one value a joint.
pub fn actuate(model: &Model, ctrl: &[f64], qpos_joints: &[f64], qvel_joints: &[f64]) -> Vec<Drive<f64>> {
    let mut drives = vec![Drive::<f64>::zero(); model.joints.len()];
    for (actuator, &u) in model.actuators.iter().zip(ctrl) {
        let u = actuator.ctrlrange.map_or(u, |[low, high]| u.max(low).min(high));
        let j = actuator.joint;
        let [b0, b1, b2] = actuator.bias;
        // MuJoCo's joint transmission: the actuator's length is `gear` times the joint's position.
        let (length, velocity) = (actuator.gear * qpos_joints[j], actuator.gear * qvel_joints[j]);
        let force = actuator.gain * u + b0 + b1 * length + b2 * velocity;
        let (limited, saturated) = match actuator.forcerange {
            Some([low, high]) => (force.max(low).min(high), force <= low || force >= high),
            None => (force, false),
        };
        drives[j].torque += actuator.gear * limited;
        // A force at its limit does not depend on velocity, so it damps nothing.
        if !saturated {
            // The gear enters twice: in the actuator's velocity, and in the torque that its force makes.
            drives[j].damping -= actuator.gear * actuator.gear * b2;
        }
    }
    for (drive, joint) in drives.iter_mut().zip(&model.joints) {
        if let Some([low, high]) = joint.actuatorfrcrange {
            // A torque at the joint's limit does not depend on velocity, as with an actuator's own.
            if drive.torque <= low || drive.torque >= high {
                drive.damping = 0.0;
            }
            drive.torque = drive.torque.max(low).min(high);
        }
    }
    drives
}
