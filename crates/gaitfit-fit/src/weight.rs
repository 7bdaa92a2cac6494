//! The robot's own weight as a check of joints: torques that hold a leg up say which joint it is and which way it
//! turns.
//!
//! A controller's torque at each sample of a log is kp (q_des − q) − kd q̇. If the robot is clamped, this torque
//! carries the weight of the links below the joint, overcomes friction, and accelerates the links. So w / kp + b q̇ + c
//! sign(q̇) is fitted to x = q_des − q, where w is the torque of the weight at the logged angles (by virtual work: the
//! moment of every mass that the joint carries, about the joint's axis). With a wrong joint or a wrong sign, w does not
//! fit.

use gaitfit_log::{BLOCK_S, Finding, FindingKind, Severity, Signal, Trajectory};
use gaitfit_model::Model;
use gaitfit_model::kinematics::{Frame, body_frames};
use gaitfit_model::rotation::{IDENTITY, dot};
use nalgebra::{Matrix3, Vector3};
use std::collections::BTreeMap;

/// Most samples that are looked at.
const MAX_SAMPLES: usize = 600;
/// Smallest torque of the weight, N·m RMS, that can be distinguished from friction. The weights of two hypotheses must
/// differ by as much.
const HEAVY: f64 = 0.25;
/// One hypothesis beats another if its residual is below this share of the other's.
const CLEARLY: f64 = 0.6;
/// Speed, rad/s, at which dry friction has its sign.
const SLIDES: f64 = 0.05;
/// Overshoot of limits, rad, and part of the samples beyond it, of columns that cannot be that joint's.
const BEYOND: f64 = 0.2;
const OFTEN: f64 = 0.02;

/// Torques, N·m, of slides forces, N, that hold every joint's load up at the angles `q`, in the model's joint order;
/// base level.
fn holding(model: &Model, q: &[f64]) -> Vec<f64> {
    let frames = body_frames(model, &Frame { position: [0.0; 3], quaternion: IDENTITY }, q);
    let gravity = model.options.gravity;
    let mut torques = vec![0.0; model.joints.len()];
    for (number, body) in model.bodies.iter().enumerate() {
        let (weight, centre) = (gravity.map(|g| body.mass * g), frames[number].point(body.ipos));
        let mut carrier = Some(number);
        // Every joint between this mass and the base carries it.
        while let Some(at) = carrier {
            for (joint, part) in model.joints.iter().enumerate().filter(|(_, joint)| joint.body == at) {
                torques[joint] -= dot(part.axis_at(&frames[at]).lever(centre), weight);
            }
            carrier = model.bodies[at].parent;
        }
    }
    torques
}

/// A log as the checks take it: some of its samples.
struct Samples {
    /// q, q̇, q_des − q; one row a sample.
    rows: Vec<(Vec<f64>, Vec<f64>, Vec<f64>)>,
    /// Length of the log, s.
    seconds: f64,
}

impl Samples {
    /// The samples of a log that has targets and stands still with its base; `None` otherwise.
    fn new(log: &Trajectory) -> Option<Self> {
        let target = log.target.as_ref()?;
        let walks = log.command.iter().flatten().any(|part| part.abs() > 0.0);
        let turns = log.base.iter().filter_map(|base| base.angular_velocity.as_ref()).flatten();
        // In a walk the ground's forces load joints too, and [`holding`] takes the base to be level and at rest.
        if walks || turns.into_iter().any(|rate| rate.abs() > 0.5) || log.len() < 50 {
            return None;
        }
        let width = log.joints.len();
        // The checks compute the robot's weight for every sample and joint, so only some samples are taken.
        let every = log.len().div_ceil(MAX_SAMPLES);
        let row = |sample: usize| {
            let at_sample = |values: &[f64]| values[sample * width..(sample + 1) * width].to_vec();
            let q = at_sample(&log.position);
            let away = at_sample(target).iter().zip(&q).map(|(target, q)| target - q).collect();
            (q, at_sample(&log.velocity), away)
        };
        let rows: Vec<_> = (0..log.len()).step_by(every).map(row).collect();
        let whole =
            rows.iter().flat_map(|(q, dq, away)| q.iter().chain(dq).chain(away)).all(|x| x.is_finite());
        whole.then_some(Self { rows, seconds: log.duration() })
    }
}

/// One joint over a block of samples: means of the weight's torque, of the speed, of its sign, and of x = q_des − q.
type Block = [f64; 4];

/// Means over blocks of half a second of a joint's weight, speed and x at each of `rows`: what accelerates it goes to
/// and fro within.
fn blocks(rows: impl ExactSizeIterator<Item = (f64, f64, f64)>, seconds: f64) -> Vec<Block> {
    let length = (rows.len() as f64 * BLOCK_S / seconds).ceil().max(1.0) as usize;
    // A smooth sign: below `SLIDES` the sign of a measured speed is mostly noise.
    let samples: Vec<Block> = rows.map(|(w, speed, x)| [w, speed, (speed / SLIDES).tanh(), x]).collect();
    samples
        .chunks(length)
        .map(|block| {
            std::array::from_fn(|k| block.iter().map(|row| row[k]).sum::<f64>() / block.len() as f64)
        })
        .collect()
}

/// The sum of squares of x that weight, speed and its sign leave unexplained, with the gain that fits best, or with
/// `kp`.
fn unexplained(blocks: &[Block], kp: Option<f64>) -> f64 {
    let mut square = 0.0;
    let mut normal = Matrix3::<f64>::zeros();
    let mut right = Vector3::<f64>::zeros();
    for &[w, speed, sign, x] in blocks {
        // With a known gain the weight's part is moved to the known side, and its column is empty.
        let x = kp.map_or(x, |kp| x - w / kp);
        let row = Vector3::new(if kp.is_some() { 0.0 } else { w }, speed, sign);
        normal += row * row.transpose();
        right += row * x;
        square += x * x;
    }
    // Keeps the equations solvable where a joint does not move.
    normal += Matrix3::identity() * (1e-9 * normal.trace().max(f64::MIN_POSITIVE));
    let Some(mut fit) = normal.cholesky().map(|factor| factor.solve(&right)) else { return f64::INFINITY };
    if fit[0] < 0.0 {
        // A weight never pushes up: without it.
        let part = normal.fixed_view::<2, 2>(1, 1).into_owned();
        let rest = part.cholesky().map(|factor| factor.solve(&right.fixed_rows::<2>(1).into_owned()));
        fit = rest.map_or_else(Vector3::zeros, |rest| Vector3::new(0.0, rest[0], rest[1]));
    }
    // Without the weight the fit is no minimum of all three, so this is not `fit · right`.
    let explained = 2.0 * fit.dot(&right) - (fit.transpose() * normal * fit)[0];
    (square - explained).max(0.0)
}

/// The joints' type: their name without the leg's, so that siblings share it.
fn kind(name: &str) -> String {
    let name = name.strip_suffix("_joint").unwrap_or(name).to_lowercase();
    let legs = [
        "fl", "fr", "rl", "rr", "hl", "hr", "lf", "rf", "lh", "rh", "left", "right", "l", "r", "front",
        "rear", "hind",
    ];
    name.split('_').filter(|part| !legs.contains(part)).collect::<Vec<_>>().join("_")
}

/// Names joints whose torques fit the robot's weight only if their sign is turned, of a clamped robot's log with all
/// joints, targets and gains; of others nothing.
pub fn signs(log: &Trajectory, model: &Model) -> Vec<Finding> {
    let (Some(samples), Some(gains)) = (Samples::new(log), &log.gains) else { return Vec::new() };
    let width = model.joints.len();
    // `order` leads from the log's columns to the model's joints.
    let order: Vec<usize> = log.joints.iter().filter_map(|joint| model.find_joint(joint)).collect();
    // The weight on a joint depends on all angles of the limb, so no joint may be missing.
    if log.joints.len() != width || order.len() != width {
        return Vec::new();
    }
    // The torque that holds the load of `column`'s joint. `sign` −1 mirrors the joint's angle first.
    let hold = |q: &[f64], column: usize, sign: f64| {
        let mut angles = vec![0.0; width];
        order.iter().enumerate().for_each(|(at, &joint)| angles[joint] = q[at]);
        angles[order[column]] *= sign;
        // A mirrored joint turns the other way, so its torque changes its sign as its angle does.
        sign * holding(model, &angles)[order[column]]
    };
    let mut joints = Vec::new();
    // Without a position gain the distance to the target says nothing of the torque.
    for joint in (0..width).filter(|&joint| gains.kp[joint] > 0.0) {
        // Weight at the logged angles, and with this joint mirrored.
        let [weights, turned] = [1.0, -1.0]
            .map(|sign| samples.rows.iter().map(|(q, ..)| hold(q, joint, sign)).collect::<Vec<f64>>());
        let kp = gains.kp[joint];
        let regressed = |weights: &[f64]| {
            let rows =
                samples.rows.iter().zip(weights).map(|((_, dq, away), w)| (*w, dq[joint], away[joint]));
            let blocks = blocks(rows, samples.seconds);
            // The regression is one of angles. Times the gain its residual is a torque, as `HEAVY` is.
            kp * (unexplained(&blocks, Some(kp)) / blocks.len().max(1) as f64).sqrt()
        };
        let (as_is, flipped) = (regressed(&weights), regressed(&turned));
        // If both weights are alike, the log cannot tell the signs apart.
        let apart: f64 = weights.iter().zip(&turned).map(|(a, b)| (a - b).powi(2)).sum();
        let apart = (apart / weights.len() as f64).sqrt();
        let heavy = model.joints[order[joint]].kind.like("N·m", HEAVY);
        if apart > 2.0 * heavy && as_is > heavy && flipped < CLEARLY * as_is {
            joints.push((joint, as_is, flipped, model.joints[order[joint]].kind.unit("N·m")));
        }
    }
    let finding = |(joint, as_is, flipped, unit): (usize, f64, f64, &str)| Finding {
        kind: FindingKind::JointSign,
        severity: Severity::Error,
        joints: vec![log.joints[joint].clone()],
        span: None,
        message: format!(
            "the torques of {} do not hold the robot's weight ({as_is:.2} {unit} RMS off), and do with the opposite sign \
             ({flipped:.2} {unit}). If position, velocity and target of this joint are mirrored, negate its columns. If they belong to \
             the joint on the other side, rename them",
            log.joints[joint]
        ),
    };
    joints.into_iter().map(finding).collect()
}

/// Finding on the order of a log's numbered joints.
#[derive(Clone, Debug, PartialEq)]
pub enum Order {
    /// The log shows that the assumed order is right.
    Shown,
    /// The log does not show the order.
    Unknown,
    /// Another usual order fits, and the assumed one does not: the joint of each column.
    Other(Vec<String>),
}

/// Judges the order in which a log's joints were named after the robot's, beside the other usual orders of robots with
/// legs: those of Unitree's motors (FR, FL, RR, RL), of the robot's file, and each by joint type. Limits decide, and
/// for a clamped robot its weight.
pub fn order(log: &Trajectory, model: &Model) -> Order {
    let names: Vec<String> = model.joints.iter().map(|joint| joint.name.clone()).collect();
    if log.joints.len() != names.len() || log.validate().is_err() || log.is_empty() {
        // A log that does not fit the model has no order to judge.
        return Order::Unknown;
    }
    // Column k was taken for `assumed[k]`, and is `order[k]` in truth.
    let assumed: Vec<usize> = log.joints.iter().filter_map(|joint| model.find_joint(joint)).collect();
    if assumed.len() != names.len() {
        return Order::Unknown;
    }
    let samples = Samples::new(log);
    // Beyond a limit an order is impossible; without targets only limits decide.
    let score = |order: &[usize]| -> Option<f64> {
        if beyond(log, model, order) {
            return None;
        }
        // NaN: the order is possible and has no measure. `is_finite` below leaves such orders out of the
        // comparison.
        let Some(samples) = &samples else { return Some(f64::NAN) };
        Some(misfit(samples, model, order, &names))
    };
    let here = score(&assumed);
    let others: Vec<(Vec<usize>, f64)> = usual_orders(&names)
        .into_iter()
        .filter(|order| *order != assumed)
        .filter_map(|order| {
            let value = score(&order)?;
            Some((order, value))
        })
        .collect();
    let best = others.iter().filter(|(_, value)| value.is_finite()).min_by(|a, b| a.1.total_cmp(&b.1));
    let named = |order: &[usize]| order.iter().map(|&joint| names[joint].clone()).collect();
    // In this order: the assumed one clearly better, another clearly better, then what limits alone say.
    match (here, best) {
        (Some(here), Some((_, best))) if here < CLEARLY * best => Order::Shown,
        (Some(here), Some((order, best))) if *best < CLEARLY * here => Order::Other(named(order)),
        // Limits exclude all other usual orders.
        (Some(_), None) if others.is_empty() => Order::Shown,
        // The assumed order is beyond limits. Another one is named only if no third comes near it.
        (None, Some((order, best))) => {
            let rivals = others.iter().filter(|(_, value)| *value < best / CLEARLY).count();
            if rivals == 1 { Order::Other(named(order)) } else { Order::Unknown }
        }
        (None, None) if others.len() == 1 => Order::Other(named(&others[0].0)),
        _ => Order::Unknown,
    }
}

/// Orders that recordings of robots with legs number joints in, where the names tell legs and types.
fn usual_orders(names: &[String]) -> Vec<Vec<usize>> {
    let leg = |name: &str| {
        let lower = name.to_lowercase();
        ["fl", "fr", "rl", "rr"].into_iter().find(|leg| lower.starts_with(&format!("{leg}_")))
    };
    let legs: Option<Vec<&str>> = names.iter().map(|name| leg(name)).collect();
    let Some(legs) = legs else { return Vec::new() };
    // The orders differ in the sequence of legs, and in whether they go leg by leg. Types stay in the file's
    // order.
    let mut kinds: Vec<String> = Vec::new();
    for name in names {
        let kind = kind(name);
        if !kinds.contains(&kind) {
            kinds.push(kind);
        }
    }
    let find =
        |wanted: &str, of: &str| (0..names.len()).find(|&at| legs[at] == wanted && kind(&names[at]) == of);
    let mut orders = Vec::new();
    // Sequences of legs, each leg by leg and type by type.
    for sequence in [["fl", "fr", "rl", "rr"], ["fr", "fl", "rr", "rl"]] {
        let by_leg: Option<Vec<usize>> = sequence
            .iter()
            .flat_map(|leg| kinds.iter().map(move |kind| (leg, kind)))
            .map(|(l, k)| find(l, k))
            .collect();
        let by_kind: Option<Vec<usize>> = kinds
            .iter()
            .flat_map(|kind| sequence.iter().map(move |leg| (leg, kind)))
            .map(|(l, k)| find(l, k))
            .collect();
        orders.extend([by_leg, by_kind].into_iter().flatten());
    }
    // With one joint a leg both ways are the same order, which would be its own rival.
    orders.dedup();
    // A leg with two joints of one type would leave a column without a joint.
    orders.retain(|order: &Vec<usize>| order.len() == names.len());
    orders
}

/// Whether columns lie beyond the limits of the joints that `order` makes of them.
fn beyond(log: &Trajectory, model: &Model, order: &[usize]) -> bool {
    order.iter().enumerate().any(|(column, &joint)| {
        let Some([low, high]) = model.joints[joint].range else { return false };
        let values = log.column_at(Signal::Position, column).unwrap_or_default();
        let over = model.joints[joint].kind.like("rad", BEYOND);
        // Single samples may overshoot a limit. An order is impossible only if many do.
        let outside = values.iter().filter(|q| **q < low - over || **q > high + over).count();
        outside as f64 > OFTEN * values.len() as f64
    })
}

/// The part of the squares of q_des − q that weight and friction leave unexplained, mean over groups of siblings,
/// which share a gain.
fn misfit(samples: &Samples, model: &Model, order: &[usize], names: &[String]) -> f64 {
    let width = order.len();
    // The weights depend on the order, because each column is another joint's angle.
    let weights: Vec<Vec<f64>> = samples
        .rows
        .iter()
        .map(|(q, ..)| {
            let mut angles = vec![0.0; width];
            order.iter().enumerate().for_each(|(column, &joint)| angles[joint] = q[column]);
            holding(model, &angles)
        })
        .collect();
    let mut groups: BTreeMap<String, Vec<Block>> = BTreeMap::new();
    for (column, &joint) in order.iter().enumerate() {
        let rows =
            samples.rows.iter().zip(&weights).map(|((_, dq, away), w)| (w[joint], dq[column], away[column]));
        // Siblings share a gain, so they are one regression.
        groups.entry(kind(&names[joint])).or_default().extend(blocks(rows, samples.seconds));
    }
    // Relative to the square of x, so that soft joints count as much as stiff ones.
    let part = |group: &Vec<Block>| {
        let square: f64 = group.iter().map(|block| block[3] * block[3]).sum();
        unexplained(group, None) / square.max(f64::MIN_POSITIVE)
    };
    groups.values().map(part).sum::<f64>() / groups.len().max(1) as f64
}

#[cfg(test)]
#[path = "weight_test.rs"]
mod tests;
