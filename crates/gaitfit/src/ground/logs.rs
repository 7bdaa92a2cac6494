//! From log files to what a fit of walking logs compares: named joints, the policy's rate, falls cut out, and doubts
//! about the data.

use super::coverage::Coverage;
use super::log_files::{self, LogFile};
use super::policy_check::{self, PolicyMatch};
use super::{rate, tilt};
use crate::config::AdaptConfig;
use crate::exit::Failure;
use crate::{log_joints, robot};
use gaitfit_learn::Interface;
use gaitfit_learn::policy::Policy;
use gaitfit_learn::task::Scene;
use gaitfit_log::{
    BaseState, CheckSpec, FindingKind, ReadOptions, Severity, Signal, Trajectory, check, falls,
    read_csv_report,
};
use serde::Serialize;
use std::collections::BTreeMap;
use std::ops::Range;
use std::path::{Path, PathBuf};

/// Counted data that a stretch of a log needs to be of use, s.
const LEAST_STRETCH_S: f64 = 1.0;
/// Counted data that a fit needs, s.
const LEAST_S: f64 = 10.0;
/// After a fall the data count again when the robot has stood this long, s.
const STANDS_S: f64 = 1.0;
/// Relative difference of gains that is worth a word.
const GAINS: f64 = 0.01;

/// A stretch of a walking log, ready to be compared with rollouts of the policy.
#[derive(Clone, Debug)]
pub struct GroundLog {
    /// As the configuration leads to it; stretches of a log that was cut say where they begin.
    pub name: String,
    /// Where it was found.
    pub path: PathBuf,
    /// Files beside it that were read too.
    pub sidecars: Vec<PathBuf>,
    /// Its samples: the policy's joints in the policy's order under the model's names, at the policy's rate, with
    /// actions and commands, all finite. Parts of the base's state that are not finite are absent.
    pub trajectory: Trajectory,
}

/// A part of a log that does not count.
#[derive(Clone, Debug, PartialEq, Serialize)]
pub struct Cut {
    /// The log's name.
    pub log: String,
    /// Where it begins, s, the log's own time.
    pub from_s: f64,
    /// Where it ends, s.
    pub to_s: f64,
    /// Why, in words.
    pub reason: String,
    /// Whether the robot fell.
    pub fall: bool,
}

/// The logs, and what to know about them.
#[derive(Clone, Debug)]
pub struct LogNotes {
    /// The data that count.
    pub logs: Vec<GroundLog>,
    /// Doubts, each one sentence.
    pub warnings: Vec<String>,
    /// Parts that do not count.
    pub cuts: Vec<Cut>,
    /// Commands covered.
    pub coverage: Coverage,
    /// Whether the actions are the policy's.
    pub policy_match: PolicyMatch,
}

impl LogNotes {
    /// Log files in which the robot fell.
    pub fn falls(&self) -> usize {
        let mut fallen: Vec<&str> =
            self.cuts.iter().filter(|cut| cut.fall).map(|cut| cut.log.as_str()).collect();
        fallen.dedup();
        fallen.len()
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

/// A log as read, joints in the policy's order.
struct Read {
    file: LogFile,
    sidecars: Vec<PathBuf>,
    trajectory: Trajectory,
}

/// Reads `config.logs` for fits of `policy` in `scene`.
///
/// # Errors
/// Files that are not there or no logs, signals that a fit needs and the logs lack, logs slower than the policy, too
/// little data, actions that are not the policy's; each says what to record next time.
pub fn read(
    config: &AdaptConfig,
    config_path: &Path,
    policy: &Policy,
    scene: &Scene,
) -> Result<LogNotes, Failure> {
    let (files, mut warnings) = log_files::find(&config.logs, config_path)?;
    let mut reads: Vec<Read> = Vec::with_capacity(files.len());
    for file in files {
        let read = open(file, config, scene)?;
        if let Some(other) = reads.iter().find(|other| same_data(&other.trajectory, &read.trajectory)) {
            warnings
                .push(format!("{}: the same data as {}; it counts once", read.file.name, other.file.name));
            continue;
        }
        reads.push(read);
    }
    warnings.extend(findings(&reads, scene));
    warnings.extend(other_robots(&reads, &scene.interface));
    let rates = rate::text(reads.iter().map(|read| read.trajectory.rate_hz));
    if rates.contains(", ") {
        warnings.push(format!(
            "the logs were recorded at {rates} Hz; all are brought to the policy's {:.4} Hz",
            1.0 / scene.interface.control_dt
        ));
    }

    let spec = fall_spec(scene);
    let margin = config.falls.margin_seconds;
    let skipped = config.simulation.skip_seconds;
    let (mut stretches, mut cuts) = (Vec::new(), Vec::new());
    for read in &reads {
        let fallen: Vec<_> = falls(&read.trajectory, &spec)
            .into_iter()
            .map(|fall| (fall.samples, fall.sign.to_string()))
            .collect();
        let (kept, removed) = keep(&read.file.name, &read.trajectory, &fallen, margin);
        for stretch in kept {
            stretches.push(count(read, stretch, scene)?);
        }
        cuts.extend(removed);
    }
    let mut logs = long_enough(stretches, skipped, &mut warnings);
    enough(config, config_path, &logs, &cuts)?;

    let trajectories: Vec<&Trajectory> = logs.iter().map(|log| &log.trajectory).collect();
    let policy_match = policy_check::check(policy, &trajectories);
    let policy_name = config.policy.as_deref().unwrap_or("the policy");
    let names: Vec<&str> = logs.iter().map(|log| log.name.as_str()).collect();
    warnings.extend(policy_match.judge(policy_name, &names)?);
    if policy_match.agrees() && !policy_match.exact {
        logs = long_enough(cut_felt(policy, logs, margin, &mut cuts)?, skipped, &mut warnings);
        enough(config, config_path, &logs, &cuts)?;
    }
    warnings.extend(cut_text(&cuts, reads.len()));
    let commands =
        logs.iter().flat_map(|log| log.trajectory.command.iter().flat_map(|rows| rows.chunks_exact(3)));
    let coverage = Coverage::new(commands, scene.interface.control_dt, &scene.settings.command);
    warnings.extend(coverage.warnings());
    warnings.extend(targets_differ(&logs, &scene.interface));
    for log in &mut logs {
        drop_broken_base(&mut log.trajectory);
    }
    Ok(LogNotes { logs, warnings, cuts, coverage, policy_match })
}

fn open(file: LogFile, config: &AdaptConfig, scene: &Scene) -> Result<Read, Failure> {
    let model = scene.batch.model();
    let (trajectory, report) =
        read_csv_report(&file.path, &ReadOptions::default()).map_err(Failure::failed)?;
    let (mut trajectory, _) =
        log_joints::of_robot(&trajectory, &file.path, &config.joint_names, model, &scene.joints)?;
    let shown = file.path.display();
    if trajectory.command.is_none() {
        return Err(Failure::failed(format!(
            "{shown}: the log has no commands (columns vx_cmd, vy_cmd, wz_cmd), and the simulated robot must be asked \
             for what the real one was. Record the command of every sample next time; if it was constant, add the \
             three columns now."
        )));
    }
    if trajectory.action.is_none() {
        let Some(target) = &trajectory.target else {
            return Err(Failure::failed(format!(
                "{shown}: the log has neither actions (columns act_…) nor position targets (qdes_…), so nothing says \
                 what the policy did. Record the policy's outputs of every step next time."
            )));
        };
        trajectory.action = Some(actions_of(target, &scene.interface));
    }
    finite(&trajectory, &shown.to_string())?;
    let findings = check(&trajectory, &CheckSpec::default());
    let broken = [FindingKind::Malformed, FindingKind::NonMonotonicTime, FindingKind::RateMismatch];
    if let Some(finding) =
        findings.iter().find(|finding| finding.severity == Severity::Error && broken.contains(&finding.kind))
    {
        return Err(Failure::failed(format!(
            "{shown}: {}: {}. `gaitfit inspect` shows the log; cut or repair it.",
            finding.kind,
            finding.message.trim_end_matches('.')
        )));
    }
    rate::check(trajectory.rate_hz, scene.interface.control_dt, &shown.to_string())?;
    Ok(Read { file, sidecars: report.sidecars, trajectory })
}

/// Actions that give these targets: (target − default pose) / scale; 0 where the scale is.
fn actions_of(target: &[f64], interface: &Interface) -> Vec<f64> {
    let joints = interface.joints.len();
    let action = |(place, target): (usize, &f64)| {
        let joint = place % joints;
        let scale = interface.action_scale[joint];
        if scale == 0.0 { 0.0 } else { (target - interface.default_pose[joint]) / scale }
    };
    target.iter().enumerate().map(action).collect()
}

fn finite(trajectory: &Trajectory, shown: &str) -> Result<(), Failure> {
    let refuse = |what: String, sample: usize| {
        Err(Failure::failed(format!(
            "{shown}: {what} of sample {sample} is not a number; cut or repair the log."
        )))
    };
    let width = trajectory.joints.len();
    for signal in [Signal::Position, Signal::Velocity, Signal::Action] {
        let bad = trajectory.signal(signal).and_then(|values| values.iter().position(|x| !x.is_finite()));
        if let Some(bad) = bad {
            return refuse(format!("{}{}", signal.prefix(), trajectory.joints[bad % width]), bad / width);
        }
    }
    let commands = trajectory.command.as_deref().unwrap_or_default();
    match commands.iter().position(|x| !x.is_finite()) {
        Some(bad) => refuse(["vx_cmd", "vy_cmd", "wz_cmd"][bad % 3].to_owned(), bad / 3),
        None => Ok(()),
    }
}

fn same_data(a: &Trajectory, b: &Trajectory) -> bool {
    a.position == b.position && a.velocity == b.velocity && a.action == b.action
}

/// What the checks of a log doubt, each kind once. Following is judged on noise in some walks of any robot: it counts
/// where most logs show it.
fn findings(reads: &[Read], scene: &Scene) -> Vec<String> {
    // Falls and gaps are cut, coverage is looked at, short stretches are left out: those have their own words.
    let told = [
        FindingKind::TooShort,
        FindingKind::TimeGap,
        FindingKind::Stuck,
        FindingKind::Lying,
        FindingKind::Fallen,
        FindingKind::NotFinite,
        FindingKind::ConstantSignal,
        FindingKind::MissingJoint,
    ];
    let mut kinds: BTreeMap<FindingKind, (usize, String)> = BTreeMap::new();
    for read in reads {
        let spec = robot::check_spec(scene.batch.model(), &read.trajectory.joints);
        let mut seen = Vec::new();
        for finding in check(&read.trajectory, &spec) {
            if finding.severity == Severity::Note
                || told.contains(&finding.kind)
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
        let noisy = [FindingKind::JointNotFollowing, FindingKind::VelocityMismatch].contains(kind);
        !noisy || 2 * *count > reads.len()
    });
    let text = |(count, text): (usize, String)| match count {
        1 => text,
        _ => format!("{text} ({} more logs have the like)", count - 1),
    };
    kinds.into_values().map(text).collect()
}

/// Logs that say they are another robot's or were made with other gains.
fn other_robots(reads: &[Read], interface: &Interface) -> Vec<String> {
    let mut warnings = Vec::new();
    let of = |read: &&Read| read.trajectory.robot.as_ref().is_some_and(|robot| *robot != interface.robot);
    if let Some(read) = reads.iter().find(of) {
        warnings.push(format!(
            "{}: the log is of robot `{}`, the policy for `{}`",
            read.file.name,
            read.trajectory.robot.as_deref().unwrap_or_default(),
            interface.robot
        ));
    }
    let differs = |read: &Read| {
        let gains = read.trajectory.gains.as_ref()?;
        let pairs = gains.kp.iter().zip(&interface.kp).chain(gains.kd.iter().zip(&interface.kd));
        pairs
            .into_iter()
            .find(|(log, policy)| (*log - *policy).abs() > GAINS * policy.abs())
            .map(|(l, p)| (*l, *p))
    };
    if let Some((read, (log, policy))) = reads.iter().find_map(|read| Some((read, differs(read)?))) {
        warnings.push(format!(
            "{}: the log was made with a gain of {log} where the policy has {policy}; the simulated robot has the \
             policy's",
            read.file.name
        ));
    }
    warnings
}

/// What tells a fallen robot: its trunk on the ground, by the task's rule.
fn fall_spec(scene: &Scene) -> CheckSpec {
    let model = scene.batch.model();
    let pose = |(&joint, &angle): (&usize, &f64)| (model.joints[joint].name.clone(), angle);
    CheckSpec {
        default_pose: scene.joints.iter().zip(&scene.interface.default_pose).map(pose).collect(),
        lying_height: Some(scene.settings.fall.height).filter(|&height| height > 0.0),
        ..CheckSpec::default()
    }
}

/// The sample ranges of `log` that count, and the cuts between them: from `margin` s before a fall (samples, and what
/// showed it) until the robot has stood for a second, and where samples were lost.
fn keep(
    name: &str,
    log: &Trajectory,
    falls: &[(Range<usize>, String)],
    margin: f64,
) -> (Vec<Range<usize>>, Vec<Cut>) {
    let (time, samples) = (&log.time, log.len());
    let at = |seconds: f64| (seconds * log.rate_hz).ceil() as usize;
    let mut cuts = Vec::new();
    let mut kept = Vec::new();
    let mut begin = 0;
    for (fall, reason) in falls {
        let start = fall.start.saturating_sub(at(margin));
        let end = if fall.end >= samples { samples } else { (fall.end + at(STANDS_S)).min(samples) };
        kept.push(begin..start.max(begin));
        begin = end.max(begin);
        let (from_s, to_s) = (time[start], time[end - 1]);
        cuts.push(Cut { log: name.to_owned(), from_s, to_s, reason: reason.clone(), fall: true });
    }
    kept.push(begin..samples);
    let mut whole = Vec::new();
    for range in kept {
        let mut begin = range.start;
        for next in range.start + 1..range.end {
            if time[next] - time[next - 1] > rate::LONG_GAP_S.max(3.0 * log.dt()) {
                whole.push(begin..next);
                let (from_s, to_s) = (time[next - 1], time[next]);
                let reason = "samples were lost".to_owned();
                cuts.push(Cut { log: name.to_owned(), from_s, to_s, reason, fall: false });
                begin = next;
            }
        }
        whole.push(begin..range.end);
    }
    whole.retain(|range| !range.is_empty());
    (whole, cuts)
}

/// Cuts falls that only the policy felt (see [`tilt`]) out of logs without the base's orientation.
fn cut_felt(
    policy: &Policy,
    logs: Vec<GroundLog>,
    margin: f64,
    cuts: &mut Vec<Cut>,
) -> Result<Vec<GroundLog>, Failure> {
    let trajectories: Vec<&Trajectory> = logs.iter().map(|log| &log.trajectory).collect();
    let spread = policy_check::spread(&trajectories, policy.interface.joints.len());
    let mut left = Vec::with_capacity(logs.len());
    for log in logs {
        let leaning: Vec<_> = tilt::falls(policy, &log.trajectory, &spread)
            .into_iter()
            .map(|range| (range, "the policy acts as if the base leaned by more than 50°".to_owned()))
            .collect();
        if leaning.is_empty() {
            left.push(log);
            continue;
        }
        let (kept, removed) = keep(&log.name, &log.trajectory, &leaning, margin);
        cuts.extend(removed);
        for range in kept {
            let failed =
                |error: gaitfit_log::LogError| Failure::failed(format!("{}: {error}", log.path.display()));
            let trajectory = log.trajectory.slice(range).map_err(failed)?;
            let name =
                format!("{} from {:.2} s", log.name, trajectory.time.first().copied().unwrap_or_default());
            left.push(GroundLog { name, trajectory, ..log.clone() });
        }
    }
    Ok(left)
}

/// The logs that are long enough to count, and warnings about the others.
fn long_enough(logs: Vec<GroundLog>, skipped: f64, warnings: &mut Vec<String>) -> Vec<GroundLog> {
    let least = LEAST_STRETCH_S + skipped;
    let (long, short): (Vec<_>, Vec<_>) =
        logs.into_iter().partition(|log| log.trajectory.duration() >= least);
    for log in short {
        let seconds = log.trajectory.duration();
        warnings.push(format!(
            "{}: {seconds:.2} s of data are too short to count; {least} s are the least",
            log.name
        ));
    }
    long
}

/// A stretch at the policy's rate.
fn count(read: &Read, stretch: Range<usize>, scene: &Scene) -> Result<GroundLog, Failure> {
    let whole = stretch.len() == read.trajectory.len();
    let failed =
        |error: gaitfit_log::LogError| Failure::failed(format!("{}: {error}", read.file.path.display()));
    let trajectory = read.trajectory.slice(stretch).map_err(failed)?;
    let trajectory = rate::to_control(&trajectory, scene.interface.control_dt).map_err(failed)?;
    let name = if whole {
        read.file.name.clone()
    } else {
        format!("{} from {:.2} s", read.file.name, trajectory.time.first().copied().unwrap_or_default())
    };
    Ok(GroundLog { name, path: read.file.path.clone(), sidecars: read.sidecars.clone(), trajectory })
}

fn cut_text(cuts: &[Cut], logs: usize) -> Vec<String> {
    let mut warnings = Vec::new();
    for (fall, what) in [(true, "the robot fell"), (false, "samples were lost")] {
        let these: Vec<&Cut> = cuts.iter().filter(|cut| cut.fall == fall).collect();
        let Some(first) = these.first() else { continue };
        let seconds: f64 = these.iter().map(|cut| cut.to_s - cut.from_s).sum();
        let mut names: Vec<&str> = these.iter().map(|cut| cut.log.as_str()).collect();
        names.dedup();
        let why = if fall { format!(", {}", first.reason) } else { String::new() };
        warnings.push(format!(
            "{what} in {} of {logs} logs; {seconds:.1} s do not count (the first: {} from {:.2} to {:.2} s{why})",
            names.len(),
            first.log,
            first.from_s,
            first.to_s
        ));
    }
    warnings
}

/// Refuses too little data.
fn enough(config: &AdaptConfig, config_path: &Path, logs: &[GroundLog], cuts: &[Cut]) -> Result<(), Failure> {
    let skipped = config.simulation.skip_seconds;
    let seconds: f64 = logs.iter().map(|log| log.trajectory.duration() - skipped).sum();
    if seconds >= LEAST_S {
        return Ok(());
    }
    let shown = config_path.display();
    let fell: f64 = cuts.iter().filter(|cut| cut.fall).map(|cut| cut.to_s - cut.from_s).sum();
    Err(Failure::failed(if logs.is_empty() && fell > 0.0 {
        format!(
            "{shown}: in all logs the robot falls or does not walk before {LEAST_STRETCH_S} s have passed ({}). A fit \
             needs walking: record next time with slower commands, on better ground, or with a policy that stands; \
             `gaitfit inspect` shows a log.",
            cuts.first().map_or("", |cut| &cut.reason)
        )
    } else {
        let because = if fell > 0.0 { format!(" ({fell:.1} s of falls are cut)") } else { String::new() };
        format!(
            "{shown}: the logs hold {seconds:.1} s of walking that count{because}; a fit needs at least {LEAST_S} s, \
             and does well with some minutes: record more, with varied commands."
        )
    }))
}

/// Whether the logged targets are what the policy's interface makes of the logged actions.
fn targets_differ(logs: &[GroundLog], interface: &Interface) -> Option<String> {
    let joints = interface.joints.len();
    let clip = interface.action_clip.unwrap_or(f64::INFINITY);
    let (mut squares, mut samples) = (vec![0.0; joints], 0.0);
    for log in logs {
        let (Some(target), Some(action)) = (&log.trajectory.target, &log.trajectory.action) else { continue };
        for (target, action) in target.chunks_exact(joints).zip(action.chunks_exact(joints)) {
            for joint in 0..joints {
                let meant = interface.default_pose[joint]
                    + interface.action_scale[joint] * action[joint].clamp(-clip, clip);
                squares[joint] += (target[joint] - meant).powi(2);
            }
            samples += 1.0;
        }
    }
    let rms = |joint: usize| (squares[joint] / samples).sqrt();
    let worst = (0..joints).max_by(|&a, &b| rms(a).total_cmp(&rms(b)))?;
    (rms(worst) > 0.02).then(|| {
        format!(
            "the logged targets are not default pose + scale × action as the policy has them (off by {:.3} rad RMS at \
             {}): was the robot driven with another pose or scale?",
            rms(worst),
            interface.joints[worst]
        )
    })
}

/// A base state with holes is none.
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
