//! From log files to what a fit of walking logs compares: named joints, the policy's rate, falls cut out, and doubts
//! about the data.

use super::counted::{count, enough, filled, long_enough, shorten};
use super::coverage::Coverage;
use super::cuts::{self, Cut, CutKind, Down};
use super::falling::Falling;
use super::log_files::{self, LogFile};
use super::mounting;
use super::policy_check::{self, PolicyMatch};
pub use super::recorded::{Purpose, Read};
use super::simulator::IMU_COLUMNS;
use super::{doubts, rate, reference, wheels};
use crate::Error;
use crate::arrangement;
use crate::log::Log;
use crate::log_check;
use crate::log_joints;
use crate::machine;
use crate::settings::AdaptConfig;
use gaitfit_learn::task::Task;
use gaitfit_log::{
    BaseState, CheckSpec, Fall, FallSign, Finding, FindingKind, ReadOptions, Signal, Trajectory, check,
    falls, read_csv_report,
};
use gaitfit_policy::Interface;
use gaitfit_policy::Policy;
use gaitfit_policy::walker::WalkerError;
use gaitfit_sim::pool;
use std::collections::BTreeSet;
use std::path::Path;

/// Max numbers in all logs of a fit together. A fit needs about ten times their memory, 0.8 GB.
const MAX_VALUES: usize = 10_000_000;

/// The logs, and what was noticed in them.
#[derive(Clone, Debug)]
pub struct LogNotes {
    /// Log files that were read.
    pub files: usize,
    /// The data that count.
    pub logs: Vec<Log>,
    /// Doubts, each one sentence.
    pub warnings: Vec<String>,
    /// Parts that do not count.
    pub cuts: Vec<Cut>,
    /// Falls of the robot, and its time on its feet.
    pub falling: Falling,
    /// Commands covered.
    pub coverage: Coverage,
    /// Whether the actions are the policy's.
    pub policy_match: PolicyMatch,
}

impl LogNotes {
    /// Log files in which the robot fell.
    pub fn falls(&self) -> usize {
        let fallen = self.cuts.iter().filter(|cut| cut.kind == CutKind::Fall).map(|cut| cut.log.as_str());
        fallen.collect::<BTreeSet<&str>>().len()
    }

    /// Seconds of data that do not count.
    pub fn cut_seconds(&self) -> f64 {
        self.cuts.iter().map(|cut| cut.to_s - cut.from_s).sum()
    }

    /// Parts of the policy's commands without data, in words.
    pub fn uncovered(&self) -> Vec<String> {
        self.coverage.uncovered()
    }
}

/// Reads the logs `named` for a fit of `policy` in `scene`, or for its validation.
///
/// # Errors
/// Missing files or no logs; logs that lack signals that a fit needs; logs slower than the policy; too little data;
/// actions that are not the policy's. Each message states what to record next time.
pub fn read(
    named: &[String],
    purpose: Purpose,
    config: &AdaptConfig,
    config_path: &Path,
    policy: &Policy,
    scene: &Task,
) -> Result<LogNotes, Error> {
    let (files, mut warnings) = log_files::find(named, config_path)?;
    let reads = open_all(files, policy, config, scene, &mut warnings)?;
    // Asked after each step that may leave too little, so that the message names the step.
    let enough =
        |logs: &[Log], removed: &[Cut]| enough(purpose, config, config_path, reads.len(), logs, removed);
    let margin = config.fall_margin();
    // First the parts in which the robot is on its feet, by what the logs show themselves.
    let (stretches, mut removed, mut on_feet_s) = on_feet(&reads, config, scene)?;
    let mut logs = long_enough(stretches, config, &mut warnings);
    warnings.extend(filled(&logs));
    enough(&logs, &removed)?;
    let policy_match = follow(policy, config, scene, &logs, &mut warnings)?;
    // Without the base's orientation the policy's actions show falls, but only if they are the policy's.
    if policy_match.agrees() && !policy_match.exact {
        let before = seconds(&logs);
        let left = cuts::cut_felt(policy, logs, margin, &mut removed)?;
        // A robot that the policy felt falling was not on its feet either.
        on_feet_s -= before - seconds(&left);
        logs = long_enough(left, config, &mut warnings);
        enough(&logs, &removed)?;
    }
    warnings.extend(cuts::cut_text(&removed, reads.len()));
    // Falls are cut before the logs are shortened, so that each has its full horizon of walking.
    if config.simulation.horizon_seconds > 0.0 {
        for log in &mut logs {
            shorten(log, config.skip_seconds() + config.simulation.horizon_seconds)?;
        }
        enough(&logs, &removed)?;
    }
    let commands =
        logs.iter().flat_map(|log| log.trajectory.command.iter().flat_map(|rows| rows.chunks_exact(3)));
    let coverage = Coverage::new(commands, scene.walker.interface.control_dt, &scene.settings.command);
    if purpose == Purpose::Fit {
        warnings.extend(coverage.warnings());
    }
    warnings.extend(doubts::targets_differ(&logs, &scene.walker.interface));
    for log in &mut logs {
        drop_broken_base(&mut log.trajectory);
    }
    // All falls of a log count, also those behind the horizon.
    let falling =
        Falling { falls: removed.iter().filter(|cut| cut.kind == CutKind::Fall).count(), seconds: on_feet_s };
    Ok(LogNotes { files: reads.len(), logs, warnings, cuts: removed, falling, coverage, policy_match })
}

/// Opens `files`, each set of data once, and adds what is doubtful about them to `warnings`.
fn open_all(
    files: Vec<LogFile>,
    policy: &Policy,
    config: &AdaptConfig,
    scene: &Task,
    warnings: &mut Vec<String>,
) -> Result<Vec<Read>, Error> {
    let mut reads: Vec<Read> = Vec::with_capacity(files.len());
    let mut values = 0;
    for file in files {
        let read = open(file, config, scene)?;
        // A copy under another name would weigh twice.
        if let Some(other) = reads.iter().find(|other| same_data(&other.trajectory, &read.trajectory)) {
            warnings
                .push(format!("{}: the same data as {}; it counts once", read.file.name, other.file.name));
            continue;
        }
        // Counted over all logs together, because all are in memory together.
        values += numbers(&read.trajectory);
        if values > MAX_VALUES {
            return Err(Error::failed(format!(
                "{}: the logs up to here hold more than {MAX_VALUES} numbers, the maximum of a fit. Name fewer logs, \
                 or, where they are faster than the policy, take one row of many: `gaitfit import LOG.csv --every 10 \
                 --out LESS.csv`.",
                read.file.path.display()
            )));
        }
        reads.push(read);
    }
    warnings.extend(reads.iter().filter_map(|read| read.even.clone()));
    warnings.extend(reads.iter().filter_map(|read| read.motion.clone()));
    warnings.extend(mounting::settle(&mut reads, policy));
    // Judged after `mounting::settle`, which may have corrected a turned unit.
    let checked =
        pool::map(reads.len(), machine::threads(), |at| check(&reads[at].trajectory, &CheckSpec::default()));
    for (read, findings) in reads.iter().zip(checked) {
        let turned = |finding: &&Finding| finding.kind == FindingKind::ImuMounting;
        let findings: Vec<Finding> = findings.iter().filter(turned).cloned().collect();
        log_check::refuse(&log_check::allowed(findings, &config.allow, &read.allowed), &read.file.path, &[])?;
    }
    warnings.extend(doubts::findings(&reads, scene));
    warnings.extend(doubts::other_robots(&reads, &scene.walker.interface));
    warnings.extend(doubts::other_step(&reads, policy, &scene.walker));
    let rates = rate::text(reads.iter().map(|read| read.trajectory.rate_hz));
    if rates.contains(", ") {
        warnings.push(format!(
            "the logs were recorded at {rates} Hz; all are brought to the policy's {:.4} Hz",
            1.0 / scene.walker.interface.control_dt
        ));
    }
    Ok(reads)
}

/// The stretches in which the robot is on its feet, what was cut from the logs for them, and their time, s.
fn on_feet(reads: &[Read], config: &AdaptConfig, scene: &Task) -> Result<(Vec<Log>, Vec<Cut>, f64), Error> {
    let spec = cuts::fall_spec(scene);
    let (mut stretches, mut removed, mut seconds) = (Vec::new(), Vec::new(), 0.0);
    for read in reads {
        let fallen: Vec<_> = falls(&read.trajectory, &spec)
            .into_iter()
            // If the user allows a finding, it does not count as a fall.
            .filter(|fall| !is_allowed(fall, &config.allow))
            .map(|fall| Down {
                samples: fall.samples,
                reason: fall.sign.to_string(),
                // A robot that hangs or is stuck does not walk, but it has not fallen either.
                fall: !matches!(fall.sign, FallSign::Hanging | FallSign::Stuck),
            })
            .collect();
        let (kept, cut) = cuts::keep(&read.file.name, &read.trajectory, &fallen, config.fall_margin());
        seconds += kept.iter().map(|stretch| stretch.len() as f64 * read.trajectory.dt()).sum::<f64>();
        // Resampled stretch by stretch, so that no row spans a cut.
        for stretch in kept {
            stretches.push(count(read, stretch, scene)?);
        }
        removed.extend(cut);
    }
    Ok((stretches, removed, seconds))
}

/// The time of logs, s.
fn seconds(logs: &[Log]) -> f64 {
    logs.iter().map(|log| log.trajectory.len() as f64 * log.trajectory.dt()).sum()
}

/// Compares the actions of `logs` with the policy's, and adds to `warnings` what is doubtful.
///
/// # Errors
/// Actions that are not the policy's.
fn follow(
    policy: &Policy,
    config: &AdaptConfig,
    scene: &Task,
    logs: &[Log],
    warnings: &mut Vec<String>,
) -> Result<PolicyMatch, Error> {
    let trajectories: Vec<&Trajectory> = logs.iter().map(|log| &log.trajectory).collect();
    let policy_match = policy_check::check(policy, &trajectories);
    // A function of the caller that failed makes every number below meaningless.
    if policy.has_failed() {
        return Err(Error::failed(WalkerError::Failed));
    }
    let policy_name = config.policy.as_deref().unwrap_or("the policy");
    let names: Vec<&str> = logs.iter().map(|log| log.name.as_str()).collect();
    let judged = policy_match.judge(policy_name, &names);
    // A search for the reason costs many runs of the policy, so it is made only if actions do not follow.
    let diagnosis = match policy_match.agrees() {
        true => None,
        false => arrangement::of_logs(policy, scene.walker.batch.model(), &trajectories),
    };
    warnings.extend(judged.map_err(|error| match &diagnosis {
        Some(diagnosis) => error.advised(diagnosis.text()),
        None => error,
    })?);
    warnings.extend(diagnosis.map(|diagnosis| diagnosis.text()));
    Ok(policy_match)
}

fn open(file: LogFile, config: &AdaptConfig, scene: &Task) -> Result<Read, Error> {
    let model = scene.walker.batch.model();
    // The limit of this fit instead of the reader's own.
    let options = ReadOptions { max_values: MAX_VALUES, ..ReadOptions::default() };
    let (trajectory, report) = read_csv_report(&file.path, &options).map_err(Error::failed)?;
    let (mut trajectory, joints) =
        // From here on joints have the robot's names and the policy's order.
        log_joints::of_robot(&trajectory, &file.path, &config.joint_names, model, &scene.walker.joints)?;
    let shown = file.path.display();
    if trajectory.command.is_none() {
        return Err(Error::failed(format!(
            "{shown}: the log has no commands (columns vx_cmd, vy_cmd, wz_cmd), and the simulated robot needs the \
             commands of the real one. Record the command of every sample next time; if it was constant, add the \
             three columns now."
        )));
    }
    wheels::settle(&mut trajectory, &scene.walker.interface)
        .map_err(|what| Error::failed(format!("{shown}: {what}")))?;
    let motion = reference::settle(&mut trajectory, &scene.walker.interface, &file.name)
        .map_err(|what| Error::failed(format!("{shown}: {what}")))?;
    // A log of targets alone: actions follow from the policy's pose and scale.
    if trajectory.action.is_none() {
        let Some(target) = &trajectory.target else {
            return Err(Error::failed(format!(
                "{shown}: the log has neither actions (columns act_…) nor position targets (qdes_…), so the policy's \
                 outputs are unknown. Record the policy's outputs of every step next time."
            )));
        };
        trajectory.action = Some(actions_of(target, &scene.walker.interface));
    }
    let base = trajectory.base.as_ref();
    let imu = base.is_some_and(|base| base.quaternion.is_some() && base.angular_velocity.is_some());
    // Costs of short predictions start in the unit's readings at every sample.
    if !imu && let Some(cost) = config.costs.iter().find(|cost| cost.needs_imu()) {
        return Err(Error::failed(format!(
            "{shown}: the cost {cost} needs what an IMU measures at every sample, and the log lacks it: columns \
             {IMU_COLUMNS}. Record them next time; \"wass\" does without."
        )));
    }
    if let Some(hole) = &report.imu_hole
        && let Some(cost) = config.costs.iter().find(|cost| cost.needs_imu())
    {
        return Err(Error::failed(format!(
            "{shown}:{}: column {} `{}` has no number, and the cost {cost} needs what an IMU measures at every sample. Cut \
             the log there, or fill the gap from the samples beside it; \"wass\" does without.",
            hole.line, hole.column, hole.name
        )));
    }
    plausible(&trajectory, &shown.to_string())?;
    let mut findings = report.findings();
    findings.extend(check(&trajectory, &CheckSpec::of_robot(model, &trajectory.joints)));
    let findings = log_check::allowed(findings, &config.allow, &report.allowed);
    // How the unit is mounted is judged once all logs are read: the policy may show it.
    let later: Vec<FindingKind> = log_check::PARTS.into_iter().chain([FindingKind::ImuMounting]).collect();
    log_check::refuse(&findings, &file.path, &later)?;
    // Torques that are sent beside the targets are not in the policy's actions, so the simulation would lack
    // them.
    let drives = |finding: &&Finding| finding.kind == FindingKind::FeedForward;
    if let Some(drives) =
        findings.iter().find(drives).filter(|_| !config.allow.contains(&FindingKind::FeedForward))
    {
        return Err(Error::failed(format!(
            "{shown}: {}: {}. A walking robot is simulated by its policy's actions alone: record a walk whose motors get \
             position targets only.",
            drives.kind, drives.message
        )));
    }
    rate::check(trajectory.rate_hz, scene.walker.interface.control_dt, &shown.to_string())?;
    let even = report.even_rows.map(|even| format!("{}: {even}", file.name));
    Ok(Read {
        file,
        sidecars: report.sidecars,
        joints,
        noticed: report.noticed,
        allowed: report.allowed,
        trajectory,
        even,
        motion,
        mounting: None,
    })
}

/// Whether the configuration allows what the fall shows.
fn is_allowed(fall: &Fall, allowed: &[FindingKind]) -> bool {
    let kind = match fall.sign {
        FallSign::Tilt => FindingKind::Fallen,
        FallSign::Height | FallSign::Lying => FindingKind::Lying,
        FallSign::Stuck => FindingKind::Stuck,
        FallSign::Hanging => FindingKind::Hanging,
        // What the log itself states is no finding of a check that a setting could allow.
        FallSign::Stated => return false,
    };
    allowed.contains(&kind)
}

/// Actions that give these targets: (target − default pose) / scale; 0 where the scale is.
pub(crate) fn actions_of(target: &[f64], interface: &Interface) -> Vec<f64> {
    let joints = interface.joints.len();
    let action = |(place, target): (usize, &f64)| {
        let joint = place % joints;
        let scale = interface.action_scale[joint];
        if scale == 0.0 { 0.0 } else { (target - interface.default_pose[joint]) / scale }
    };
    target.iter().enumerate().map(action).collect()
}

/// Largest joint angle, speed, action or command that a log may contain. A larger one is a decoder's mistake. It alone
/// would decide the signal's range, which scales the costs.
const WILD: f64 = 1e4;

fn plausible(trajectory: &Trajectory, shown: &str) -> Result<(), Error> {
    let wild = |values: &[f64]| values.iter().position(|x| x.is_nan() || x.abs() > WILD);
    let refuse = |what: String, sample: usize, value: f64| {
        Err(Error::failed(format!("{shown}: {what} of sample {sample} is {value}; cut or repair the log.")))
    };
    let width = trajectory.joints.len();
    for signal in [Signal::Position, Signal::Velocity, Signal::Action] {
        let Some(values) = trajectory.signal(signal) else { continue };
        if let Some(bad) = wild(values) {
            let what = format!("{}{}", signal.prefix(), trajectory.joints[bad % width]);
            return refuse(what, bad / width, values[bad]);
        }
    }
    // The base's state is not looked at here: `drop_broken_base` leaves out parts with holes.
    let commands = trajectory.command.as_deref().unwrap_or_default();
    match wild(commands) {
        Some(bad) => refuse(["vx_cmd", "vy_cmd", "wz_cmd"][bad % 3].to_owned(), bad / 3, commands[bad]),
        None => Ok(()),
    }
}

/// Count of the numbers that a log holds.
fn numbers(log: &Trajectory) -> usize {
    let base = log.base.as_ref();
    let optional = [
        log.target.as_ref(),
        log.action.as_ref(),
        log.command.as_ref(),
        base.and_then(|base| base.position.as_ref()),
        base.and_then(|base| base.quaternion.as_ref()),
        base.and_then(|base| base.linear_velocity.as_ref()),
        base.and_then(|base| base.angular_velocity.as_ref()),
    ];
    log.len()
        + log.position.len()
        + log.velocity.len()
        + optional.into_iter().flatten().map(Vec::len).sum::<usize>()
}

fn same_data(a: &Trajectory, b: &Trajectory) -> bool {
    a.position == b.position && a.velocity == b.velocity && a.action == b.action
}

/// Leaves out the state of the base if it has gaps.
fn drop_broken_base(trajectory: &mut Trajectory) {
    let Some(base) = &mut trajectory.base else { return };
    let parts =
        [&mut base.position, &mut base.quaternion, &mut base.linear_velocity, &mut base.angular_velocity];
    for part in parts {
        if part.as_ref().is_some_and(|values| values.iter().any(|x| !x.is_finite())) {
            *part = None;
        }
    }
    if *base == BaseState::default() {
        trajectory.base = None;
    }
}
