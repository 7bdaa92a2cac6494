//! What the small motions show: whether only the commanded joint moves, in the commanded direction and by the commanded amount,
//! and how late.

use gaitfit_model::Model;
use gaitfit_model::rotation::{Vec3, up};
use serde::Serialize;

use super::flight::Flown;
use super::gravity::{Load, load};
use super::log::{DT, SampledStates};
use super::plan::{Plan, SLOW, Stage};
use super::response::{Equation, response};
use super::statistics::{Measured, mean, median, robust, span};
use super::stopped::stopped;
use super::turned::mean_attitude;
use super::{Check, Finding};
use crate::robot::Robot;

/// A joint that moves by less than this part of the commanded motion does not move.
const HARDLY: f64 = 0.25;
/// Another joint that moves by more than this part of the commanded motion moves instead of it.
const INSTEAD: f64 = 0.5;
/// Change of the angle over that of the target, 1 for a joint that follows, below which the sign is wrong.
const OPPOSITE: f64 = -0.3;
/// The same ratio, above which the joint moves too far.
const TOO_FAR: f64 = 1.4;
/// A joint moves too little if it moves by less than this part of what friction allows.
const TOO_LITTLE: f64 = 0.5;
/// Reported torque over commanded torque. It is a fault if no possible ratio is in the first range, a warning if none is in the
/// second.
const GAIN: [[f64; 2]; 2] = [[0.5, 2.0], [0.9, 1.1]];
/// A zero is a fault if it is off by more than this, rad.
const ZERO: f64 = 0.1;
/// It must also be off by more than this number of its standard errors.
const SURE: f64 = 2.5;
/// A zero is judged if its standard error is below this, rad. Light links, such as a calf, weigh too little to show
/// it.
const KNOWN: f64 = 0.08;
/// Relative error of the weights in a robot's file, one link against another. A factor common to all is removed
/// before.
const WEIGHT: f64 = 0.04;
/// Joints that carry more, N·m, show how heavy the links are in all: friction hides less of their weight.
const CARRIED: f64 = 0.3;
/// Range of that factor. Beyond it the zeros are wrong, not the masses.
const MASSES: [f64; 2] = [0.8, 1.25];
/// Min error of a joint's holding torque: N·m, and as a part of the friction, which holds some of the weight.
const HOLDING: (f64, f64) = (0.01, 0.1);
/// A delay that is a warning, and one that is a fault, s.
const LATE: [f64; 2] = [0.008, 0.03];
/// Min standard error of a delay, s: commands are sent every 2 ms.
const LEAST_ERROR: f64 = 0.0005;
/// A joint's delay with a larger error does not count, s.
const WORST_ERROR: f64 = 0.003;
/// Level enough to weigh legs: the cosine of a lean of 45°.
const LEVEL: f64 = 0.7;

/// A joint's own motion.
#[derive(Clone, Debug, PartialEq, Serialize)]
pub struct JointMotion {
    /// Its name.
    pub joint: String,
    /// How far it moved, rad, highest to lowest.
    pub moved: f64,
    /// How far it was commanded to move, rad.
    pub asked: f64,
    /// The other joint that moved most meanwhile, and how far, rad.
    pub other: Option<(String, f64)>,
    /// Change of its angle over change of its target.
    pub follows: Option<f64>,
    /// Time from a target to its torque, by the motion, s; absent if the joint moves too slowly to show it.
    pub delay: Option<Measured>,
    /// Time from a target to the reported torque, s.
    pub torque_delay: Option<Measured>,
    /// Dry friction, N·m.
    pub friction: Option<Measured>,
    /// Viscous friction, N·m·s/rad.
    pub damping: Option<Measured>,
    /// Inertia about its axis, with the rotor's, kg·m².
    pub inertia: Option<Measured>,
    /// The rotor's alone, by the robot's file, kg·m².
    pub armature: Option<Measured>,
    /// Least and largest possible ratio of reported to commanded torque.
    pub torque_gain: Option<[f64; 2]>,
    /// Its reading less its true angle, by its weight, rad; absent without the robot's file.
    pub zero: Option<Measured>,
}

/// Results of the small motions.
#[derive(Clone, Debug, PartialEq, Serialize)]
pub struct Moved {
    /// The reason for stopping them; absent after an orderly end.
    pub reason: Option<String>,
    /// Commands sent.
    pub commands: usize,
    /// Commands that the guard changed.
    pub changed: u64,
    /// Joints that moved alone, in that order.
    pub joints: Vec<JointMotion>,
    /// Time from a target to its torque by the motion, all joints together, s.
    pub delay: Option<Measured>,
    /// Time from a target to the reported torque, all joints together, s.
    pub torque_delay: Option<Measured>,
    /// Weight of the links over that of the robot's file, by the torques that hold them.
    pub mass_factor: Option<f64>,
}

/// Evaluates the motions, and returns what is wrong. `model`: the robot's file, for weights.
pub fn moved(
    flown: &Flown,
    sampled: &SampledStates,
    robot: &Robot,
    model: Option<&Model>,
) -> (Moved, Vec<Finding>) {
    let mut findings = Vec::new();
    stopped(flown, sampled, robot, &mut findings);
    let (mut joints, mut mass_factor) = (Vec::new(), None);
    if let Some(plan) = &flown.plan {
        // Which way is down decides the weights; a robot that hangs askew or has no orientation gets none.
        let vertical = mean_attitude(&flown.heard).map(up).filter(|up| up[2] > LEVEL);
        // Joint by joint: what its motion shows, and what it carries.
        let motions = plan.order().iter().filter_map(|&motor| {
            let (one, carried) = joint(sampled, robot, plan, motor, model.zip(vertical))?;
            Some((one, carried, f64::from(plan.kp()[motor])))
        });
        let motions: Vec<_> = motions.collect();
        // A wrong total mass would look like wrong zeros of all joints, so it is removed before zeros are judged.
        mass_factor = heavier(motions.iter().filter_map(|(_, carried, _)| carried.as_ref()));
        for (mut one, carried, kp) in motions {
            if let (Some(carried), Some(factor)) = (carried, mass_factor) {
                (one.zero, one.armature) = carried.zero(factor);
            }
            judge(&one, kp, &mut findings);
            joints.push(one);
        }
    }
    let delay = together(joints.iter().filter_map(|one| one.delay));
    let torque_delay = together(joints.iter().filter_map(|one| one.torque_delay));
    // The motion shows when torque acts; reported torques may be late themselves.
    if let Some(delay) = delay.or(torque_delay) {
        judge_delay(delay, &mut findings);
    }
    let reason = flown.reason.as_ref().map(ToString::to_string);
    let (commands, changed) = (flown.sent.len(), flown.changed);
    (Moved { reason, commands, changed, joints, delay, torque_delay, mass_factor }, findings)
}

/// The delay of all joints, from the delays of each.
fn together(measured: impl Iterator<Item = Measured>) -> Option<Measured> {
    let delays: Vec<f64> = measured.filter(|one| one.error < WORST_ERROR).map(|one| one.value).collect();
    // A median, because a joint with much friction may be far off.
    let Measured { value, error } = robust(&delays);
    // A median of three bears one wrong value; of two, none.
    (delays.len() >= 3).then_some(Measured { value, error: error.max(LEAST_ERROR) })
}

/// The rows in which a joint moves alone; `None` if its motion was not finished.
fn window(sampled: &SampledStates, motor: usize) -> Option<std::ops::Range<usize>> {
    let begin = sampled.rows.iter().position(|row| row.stage == Stage::Joint(motor))?;
    let end = begin + sampled.rows[begin..].iter().take_while(|row| row.stage == Stage::Joint(motor)).count();
    // Rows after it show that the motion was not stopped within this stage.
    (sampled.rows.len() > end).then_some(begin..end)
}

fn joint(
    sampled: &SampledStates,
    robot: &Robot,
    plan: &Plan,
    motor: usize,
    file: Option<(&Model, Vec3)>,
) -> Option<(JointMotion, Option<Carried>)> {
    let window = window(sampled, motor)?;
    let rows = &sampled.rows;
    let travelled = |index: usize| span(rows[window.clone()].iter().map(|row| f64::from(row.state.q[index])));
    let others =
        (0..robot.motors.len()).filter(|index| *index != motor).map(|index| (index, travelled(index)));
    // A joint that moves instead of the commanded one shows a wrong order.
    let other = others.max_by(|a, b| a.1.total_cmp(&b.1));
    // Up, back, down and back again. The quick motion after them does not count for the amount.
    let response = response(sampled, window.clone(), motor, (2.0 * SLOW / DT) as usize);
    let equation = response.and_then(|response| response.equation);
    let carried = file.zip(equation).and_then(|(file, equation)| {
        Some(Carried { load: weigh(sampled, robot, &window, motor, file)?, equation })
    });
    let torque = response.and_then(|response| response.torque);
    let motion = JointMotion {
        joint: robot.motors[motor].joint.clone(),
        moved: travelled(motor),
        // From one end of the motion to the other.
        asked: 2.0 * f64::from(plan.amplitude()[motor]),
        other: other.map(|(index, far)| (robot.motors[index].joint.clone(), far)),
        follows: response.map(|response| response.follows),
        delay: equation.and_then(|equation| equation.delay),
        torque_delay: torque.map(|torque| torque.delay),
        friction: equation.map(|equation| equation.friction),
        damping: equation.map(|equation| equation.damping),
        inertia: equation.and_then(|equation| equation.inertia),
        armature: None,
        torque_gain: torque.map(|torque| torque.gain),
        zero: None,
    };
    Some((motion, carried))
}

/// Returns the load of a joint by the robot's file.
fn weigh(
    sampled: &SampledStates,
    robot: &Robot,
    window: &std::ops::Range<usize>,
    motor: usize,
    (model, up): (&Model, Vec3),
) -> Option<Load> {
    // Joints of the model that the robot has no motor for stay at their reference.
    let mut q: Vec<f64> = model.joints.iter().map(|joint| joint.reference).collect();
    for (index, one) in robot.motors.iter().enumerate() {
        if let Some(joint) = model.find_joint(&one.joint) {
            let angles: Vec<f64> =
                sampled.rows[window.clone()].iter().map(|row| f64::from(row.state.q[index])).collect();
            q[joint] = mean(&angles);
        }
    }
    Some(load(model, model.find_joint(&robot.motors[motor].joint)?, &q, up))
}

/// Load of a joint by the robot's file, and its equation of motion.
struct Carried {
    load: Load,
    equation: Equation,
}

/// Weight of the links over that of the file: the middle of all joints.
fn heavier<'c>(loads: impl Iterator<Item = &'c Carried>) -> Option<f64> {
    let mut none = true;
    let factors: Vec<f64> = loads
        .inspect(|_| none = false)
        .filter(|one| one.load.torque.abs() > CARRIED)
        .map(|one| one.equation.weight.value / one.load.torque)
        .collect();
    // Fewer joints cannot tell a heavy robot from a wrong zero: then the file's masses count.
    let factor = if factors.len() >= 3 { median(&factors).clamp(MASSES[0], MASSES[1]) } else { 1.0 };
    (!none).then_some(factor)
}

impl Carried {
    /// The joint's zero by its weight, and the rotor's inertia: the joint's without that of the links.
    fn zero(&self, factor: f64) -> (Option<Measured>, Option<Measured>) {
        let Equation { weight, friction, inertia, .. } = self.equation;
        let Load { torque, slope, inertia: links } = self.load;
        let holding = HOLDING.0 + HOLDING.1 * friction.value.abs();
        let error = weight.error.hypot(WEIGHT * torque).hypot(holding);
        let slope = factor * slope;
        // To first order in the zero, with the slope at the reading:
        // torque(reading − zero) = weight.
        // Where the links stand upright or hang straight down the slope is near 0. Then the error is huge, and
        // nobody judges the zero.
        let zero = Measured {
            value: (factor * torque - weight.value) / slope,
            error: error / slope.abs().max(1e-6),
        };
        let links = factor * links;
        let armature = inertia.map(|inertia| Measured {
            value: inertia.value - links,
            error: inertia.error.hypot(WEIGHT * links),
        });
        (zero.value.is_finite().then_some(zero), armature)
    }
}

fn judge(one: &JointMotion, kp: f64, findings: &mut Vec<Finding>) {
    let mut say = |finding: Finding| findings.push(finding.at_joint(&one.joint));
    let far = one.other.as_ref().filter(|(_, far)| *far > INSTEAD * one.asked);
    // A joint that hardly moved shows nothing more.
    if one.moved < HARDLY * one.asked {
        say(match far {
            Some((other, far)) => Finding::fault(
                Check::Order,
                format!(
                    "its command moves {other} by {far:.2} rad, and the joint itself by {:.3}",
                    one.moved
                ),
                "Joints are in another order in commands than in states: check `slot` in the robot's file and the motors' cables",
            ),
            None => Finding::fault(
                Check::Moves,
                format!("it was commanded to move by {:.2} rad and moved by {:.3}", one.asked, one.moved),
                "The joint sticks, or its motor ignores commands: move it by hand with the power off, then check the motor's mode, \
                 gains and cable",
            ),
        });
        return;
    }
    if let Some((other, far)) = far {
        say(Finding::warning(
            Check::Order,
            format!("{other} moved too, by {far:.2} rad"),
            "Look at both joints: one may hold too weakly, or touch the other",
        ));
    }
    let Some(follows) = one.follows else { return };
    let friction = one.friction.map_or(0.0, |friction| friction.value.max(0.0));
    // Dry friction stops a joint up to friction / kp before its target, at each end of the motion. The bound of 0.3
    // keeps a friction that is overestimated from excusing a joint that hardly moves.
    let free = (1.0 - 2.0 * friction / (kp * one.asked).max(1e-9)).clamp(0.3, 1.0);
    if follows < OPPOSITE {
        say(Finding::fault(
            Check::Sign,
            format!("it moves against its command: by {follows:.2} times the commanded motion"),
            "The sign of its commands is not that of its angle: check the robot's file and the joint's direction in the vendor's documentation",
        ));
        return;
    }
    if follows > TOO_FAR || follows < TOO_LITTLE * free {
        say(Finding::fault(
            Check::Amount,
            format!("it moves by {follows:.2} times the commanded motion"),
            format!(
                "Check its gear and gains (kp {kp} N·m/rad here); its friction by this motion is {friction:.2} N·m"
            ),
        ));
    }
    if let Some([low, high]) = one.torque_gain.filter(|[low, high]| low <= high) {
        // The possible ratio nearest to 1: if 1 is possible, nothing is wrong.
        let nearest = 1.0f64.clamp(low, high);
        let outside = |[low, high]: [f64; 2]| nearest < low || nearest > high;
        let problem = format!("its motor reports {low:.2} to {high:.2} times the torque of its command");
        let remedy = "Check whether kp and kd are in N·m/rad and N·m·s/rad at the joint, and its gear ratio; a fit finds it as torque_scale";
        if outside(GAIN[0]) {
            say(Finding::fault(Check::Gains, problem, remedy));
        } else if outside(GAIN[1]) {
            say(Finding::warning(Check::Gains, problem, remedy));
        }
    }
    let wrong = |zero: &Measured| {
        zero.error < KNOWN && zero.value.abs() > ZERO && zero.value.abs() > SURE * zero.error
    };
    if let Some(zero) = one.zero.filter(wrong) {
        say(Finding::fault(
            Check::Zero,
            format!(
                "by the weight that it holds, its angle reads {:.2} ± {:.2} rad too much",
                zero.value, zero.error
            ),
            "Calibrate its encoder's zero; if it is right, its sign or order is wrong, or the robot's file lacks a load",
        ));
    }
}

fn judge_delay(delay: Measured, findings: &mut Vec<Finding>) {
    if delay.value < LATE[0] {
        return;
    }
    let problem =
        format!("targets take {:.1} ± {:.1} ms until they act", 1e3 * delay.value, 1e3 * delay.error);
    let remedy =
        "Train and fit with this delay (the prior is in preflight.toml), or look for what holds messages up";
    findings.push(match delay.value > LATE[1] {
        true => Finding::fault(Check::Delay, problem, remedy),
        false => Finding::warning(Check::Delay, problem, remedy),
    });
}
