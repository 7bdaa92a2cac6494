//! Doubts about walking logs that do not keep them from being used, each in a sentence.

use super::recorded::Read;
use crate::log::Log;
use crate::machine;
use crate::world::trained_task;
use gaitfit_learn::task::Task;
use gaitfit_log::{CheckSpec, FindingKind, Severity, check};
use gaitfit_policy::walker::Walker;
use gaitfit_policy::{Interface, Policy};
use gaitfit_sim::pool;
use std::collections::BTreeMap;

/// Relative difference of gains that is worth a word.
const GAINS: f64 = 0.01;
/// The same of physics steps.
const STEP: f64 = 0.05;

/// The doubts of the checks of logs, each kind once. In some walks of any robot noise decides how joints follow: such findings
/// count only if most logs have them.
pub fn findings(reads: &[Read], scene: &Task) -> Vec<String> {
    // Falls and gaps are cut, coverage is looked at, short stretches are left out: those have their own words.
    let reported_elsewhere = [
        FindingKind::TooShort,
        FindingKind::TimeGap,
        FindingKind::Stuck,
        FindingKind::Lying,
        FindingKind::Fallen,
        FindingKind::Hanging,
        FindingKind::NotFinite,
        FindingKind::ConstantSignal,
        FindingKind::MissingJoint,
    ];
    let mut kinds: BTreeMap<FindingKind, (usize, String)> = BTreeMap::new();
    // Each log is checked on its own, so the checks run in parallel.
    let checked = pool::map(reads.len(), machine::threads(), |at| {
        let log = &reads[at].trajectory;
        check(log, &CheckSpec::of_robot(scene.walker.batch.model(), &log.joints))
    });
    for (read, checked) in reads.iter().zip(checked) {
        // Each kind counts once a log, so that the number below is one of logs.
        let mut seen = Vec::new();
        for finding in read.noticed.iter().cloned().chain(checked) {
            if finding.severity == Severity::Note
                || reported_elsewhere.contains(&finding.kind)
                || seen.contains(&finding.kind)
            {
                continue;
            }
            seen.push(finding.kind);
            let text = || format!("{}: {}: {}", read.file.name, finding.kind, finding.message);
            kinds.entry(finding.kind).or_insert_with(|| (0, text())).0 += 1;
        }
    }
    kinds.retain(|kind, (count, _)| {
        let noisy = [FindingKind::JointNotFollowing, FindingKind::VelocityMismatch, FindingKind::VelocityLag]
            .contains(kind);
        !noisy || 2 * *count > reads.len()
    });
    let text = |(count, text): (usize, String)| match count {
        1 => text,
        2 => format!("{text} (1 more log has similar findings)"),
        _ => format!("{text} ({} more logs have similar findings)", count - 1),
    };
    kinds.into_values().map(text).collect()
}

/// Logs that say they are another robot's or were made with other gains.
pub fn other_robots(reads: &[Read], interface: &Interface) -> Vec<String> {
    let mut warnings = Vec::new();
    // A policy without a robot's name fits any robot.
    let known = !interface.robot.is_empty();
    let other_robot =
        |read: &&Read| known && read.trajectory.robot.as_ref().is_some_and(|robot| *robot != interface.robot);
    if let Some(read) = reads.iter().find(other_robot) {
        warnings.push(format!(
            "{}: the log is of robot `{}`, the policy for `{}`",
            read.file.name,
            read.trajectory.robot.as_deref().unwrap_or_default(),
            interface.robot
        ));
    }
    // Log and interface list their gains in the policy's order.
    let differs = |read: &Read| {
        let gains = read.trajectory.gains.as_ref()?;
        [("kp", &gains.kp, &interface.kp), ("kd", &gains.kd, &interface.kd)].into_iter().find_map(
            |(what, log, policy)| {
                let mut pairs = interface.joints.iter().zip(log.iter().zip(policy));
                let (joint, (log, policy)) =
                    pairs.find(|(_, (log, policy))| (*log - *policy).abs() > GAINS * policy.abs())?;
                Some((what, joint.clone(), *log, *policy))
            },
        )
    };
    if let Some((read, (what, joint, log, policy))) =
        reads.iter().find_map(|read| Some((read, differs(read)?)))
    {
        warnings.push(format!(
            "{}: the log was made with {what} {log} of joint `{joint}`, and the policy has {policy}; the simulated robot has \
             the policy's gains",
            read.file.name
        ));
    }
    warnings
}

/// Logs of a simulator whose physics step differs from that of the robot which the fit assumes. Then the model seems to lack
/// something, because friction acts at another time. A simulator whose task has a robot step stands for a robot with that step.
pub fn other_step(reads: &[Read], policy: &Policy, walker: &Walker) -> Option<String> {
    let trained = trained_task(policy).ok().flatten();
    if trained.is_some_and(|task| task.robot_timestep.is_some()) {
        return None;
    }
    let stands_for = walker.batch.options().emulated_step.unwrap_or(walker.physics_step());
    let stated = |read: &Read| {
        let step = read.trajectory.simulated_step?;
        ((step - stands_for).abs() > STEP * stands_for).then(|| (step, read.file.name.clone()))
    };
    let (step, name) = reads.iter().find_map(stated)?;
    // Rounded to a microsecond: steps are computed as a period over a number, with many digits.
    let milliseconds = |step: f64| (1e6 * step).round() / 1e3;
    Some(format!(
        "{name}: the log was simulated in physics steps of {} ms, but this fit assumes a robot with steps of {} ms. Set \
         `robot_timestep = {step}` in [simulation] (in a loop: [adapt.simulation])",
        milliseconds(step),
        milliseconds(stands_for)
    ))
}

/// Whether the logged targets are what the policy's interface makes of the logged actions.
pub fn targets_differ(logs: &[Log], interface: &Interface) -> Option<String> {
    let joints = interface.joints.len();
    let (mut squares, mut samples) = (vec![0.0; joints], 0.0);
    for log in logs {
        let (Some(target), Some(action)) = (&log.trajectory.target, &log.trajectory.action) else { continue };
        for (target, action) in target.chunks_exact(joints).zip(action.chunks_exact(joints)) {
            for joint in 0..joints {
                // As the interface clips the action before it scales it.
                let clip = interface.clip(joint);
                let meant = interface.default_pose[joint]
                    + interface.action_scale[joint] * action[joint].clamp(-clip, clip);
                squares[joint] += (target[joint] - meant).powi(2);
            }
            samples += 1.0;
        }
    }
    let rms = |joint: usize| (squares[joint] / samples).sqrt();
    let worst = (0..joints).max_by(|&a, &b| rms(a).total_cmp(&rms(b)))?;
    // 0.02 rad is far above the rounding of logs, so that only a real difference is named.
    (rms(worst) > 0.02).then(|| {
        format!(
            "the logged targets are not default pose + scale × action as the policy has them (off by {:.3} rad RMS at \
             {}): was the robot driven with another pose or scale?",
            rms(worst),
            interface.joints[worst]
        )
    })
}
